//! Variants as laboratories send them: pauses of days, amplifiers that cut, channels that are empty or of
//! another heart, clocks of other zones, sheets next to each other, line ends of old computers.

use std::fmt::Write as _;

use super::further::{labchart, labchart_header, workbook};
use super::{Expected, Form, Rows, Variant, csv, exact, paused, table, usual, with_ecg};

/// All variants of this page.
pub fn variants(rows: &Rows) -> Vec<Variant> {
    // The same samples in another form.
    let mut out = Vec::new();
    trimmed_rows(rows, &mut out);
    zones_and_orders(rows, &mut out);
    acqknowledge(rows, &mut out);
    sheets(rows, &mut out);
    exact(&mut out);
    cut_pressures(rows, &mut out);
    pressures_apart(rows, &mut out);
    long_pauses(rows, &mut out);
    other_ecgs(rows, &mut out);
    frames(rows, &mut out);
    out
}

fn with(rows: &Rows, channel: usize, of: impl Fn(f64) -> f64) -> Rows {
    let mut rows = rows.clone();
    rows.channels[channel].iter_mut().for_each(|v| *v = of(*v));
    rows
}

fn without_ecg() -> Form {
    Form {
        order: vec![0, 1, 2],
        ..usual()
    }
}

/// Kind 01: a top that is cut by a few mmHg, a bottom, an aorta.
fn cut_pressures(rows: &Rows, out: &mut Vec<Variant>) {
    for most in [105.0, 108.0, 110.0] {
        out.push(Variant {
            expected: Expected::Said(&["stays at its largest value", "below the aorta's"]),
            ..csv(
                format!("01: ventricle cut at {most}"),
                &with(rows, 0, |p| p.min(most)),
                &usual(),
            )
        });
        let alone = Form {
            order: vec![0, 1, 3],
            ..usual()
        };
        out.push(Variant {
            expected: Expected::SameOrWarned(&["stays at its largest value"]),
            ..csv(
                format!("01: ventricle cut at {most}, no aorta"),
                &with(rows, 0, |p| p.min(most)),
                &alone,
            )
        });
    }
    for least in [8.0, 10.0, 15.0] {
        out.push(Variant {
            expected: Expected::SameOrWarned(&["falls to its smallest value", "stays there"]),
            ..csv(
                format!("01: ventricle cut below {least}"),
                &with(rows, 0, |p| p.max(least)),
                &usual(),
            )
        });
    }
    out.push(Variant {
        expected: Expected::SameOrWarned(&["aortic pressure that stays at its largest value"]),
        ..csv(
            "01: aorta cut at 105",
            &with(rows, 1, |p| p.min(105.0)),
            &usual(),
        )
    });
}

/// Kind 02: a ventricle above the aorta.
fn pressures_apart(rows: &Rows, out: &mut Vec<Variant>) {
    let above = Expected::SameOrWarned(&["above the aorta's", "unit, scale and zero"]);
    for (what, changed) in [
        ("cmH2O given as mmHg", with(rows, 0, |p| 1.36 * p)),
        ("a zero off by 25 mmHg", with(rows, 0, |p| p + 25.0)),
    ] {
        out.push(Variant {
            expected: above,
            ..csv(format!("02: ventricle in {what}"), &changed, &usual())
        });
    }
}

/// Kind 03: pauses of a day and a week.
fn long_pauses(rows: &Rows, out: &mut Vec<Variant>) {
    const DAY_S: f64 = 86_400.0;
    for (what, changed) in [
        ("a day", paused(rows, 7.5, DAY_S)),
        ("a day, off the grid", paused(rows, 7.5, DAY_S + 0.0013)),
        ("a week", paused(rows, 5.2, 7.0 * DAY_S)),
        (
            "a day and of 20 s",
            paused(&paused(rows, 9.5, 20.0), 4.1, DAY_S),
        ),
    ] {
        out.push(csv(format!("03: pause of {what}"), &changed, &usual()));
        out.push(csv(
            format!("03: pause of {what}, no ECG"),
            &changed,
            &without_ecg(),
        ));
    }
    let cut = rows.time_s.len() / 2;
    let mut text = String::new();
    for (begin_s, range) in [(0.0, 0..cut), (DAY_S, cut..rows.time_s.len())] {
        text += &labchart_header(
            "StartOfBlock",
            &format!("{:.12}", 44_562.4 + begin_s / DAY_S),
        );
        for i in range.clone() {
            let t = 0.004 * (i - range.start) as f64;
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let _ = writeln!(text, "{t:.3}\t{p}\t{a}\t{e}");
        }
    }
    out.push(labchart("03: two blocks of LabChart, a day apart", text));
}

/// Kind 05: the tabs of empty channels at the ends of lines are gone.
fn trimmed_rows(rows: &Rows, out: &mut Vec<Variant>) {
    for spare in [1, 2] {
        for times in [true, false] {
            let mut text = labchart_header("StartOfBlock", "44562.4")
                .replace("AoP\tECG", &format!("AoP\tECG{}", "\tSpare".repeat(spare)))
                .replace("1 V\n", &format!("1 V{}\n", "\t1 V".repeat(spare)))
                .replace("mmHg\tmV", &format!("mmHg\tmV{}", "\tV".repeat(spare)));
            for i in 0..rows.time_s.len() {
                let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
                if times {
                    let _ = write!(text, "{:.3}\t", rows.time_s[i]);
                }
                let _ = writeln!(text, "{p}\t{a}\t{e}");
            }
            let with = if times { "with" } else { "without" };
            out.push(labchart(
                format!("05: {spare} empty channels without their tabs, {with} times"),
                text,
            ));
        }
    }
    // Line ends of old Macs, in both kinds of text.
    let text = table(rows, &usual()).replace('\n', "\r");
    out.push(Variant::same(
        "05: carriage returns alone",
        "catheter.csv",
        text.into_bytes(),
    ));
}

/// Kind 06: an electrocardiogram of another heart, of other names and units, of dashes.
fn other_ecgs(rows: &Rows, out: &mut Vec<Variant>) {
    let ecg = &rows.channels[2];
    for rate in [0.8, 1.3] {
        let other = with_ecg(rows, |i, _, _| ecg[(rate * i as f64) as usize % ecg.len()]);
        out.push(csv(
            format!("06: ECG of another heart, {rate} times as fast"),
            &other,
            &usual(),
        ));
    }
    for (name, factor) in [
        ("Elektrokardiogramm (mV)", 1.0),
        ("Ableitung II [mV]", 1.0),
        ("Electrocardiogram (Volts)", 1e-3),
        ("EKG (millivolts)", 1.0),
    ] {
        let mut form = usual();
        form.columns[3] = (name, factor);
        out.push(csv(format!("06: ECG named {name}"), rows, &form));
    }
    let empty = table(&with_ecg(rows, |_, _, _| f64::NAN), &usual());
    for word in ["-", "--", "none"] {
        out.push(Variant::same(
            format!("06: ECG of `{word}`"),
            "catheter.csv",
            empty.replace(",\n", &format!(",{word}\n")).into_bytes(),
        ));
    }
}

/// Kinds 12 and 14: zones that change within the recording, months before days.
fn zones_and_orders(rows: &Rows, out: &mut Vec<Variant>) {
    let of = |stamp: &dyn Fn(f64) -> String| {
        let mut text = "Time,LVP (mmHg),AoP (mmHg),ECG (mV)\n".to_owned();
        for i in 0..rows.time_s.len() {
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let _ = writeln!(text, "{},{p},{a},{e}", stamp(rows.time_s[i]));
        }
        text.into_bytes()
    };
    let clock = |s: f64| {
        let (hours, minutes) = ((s / 3600.0) as usize, (s / 60.0) as usize % 60);
        format!("{hours:02}:{minutes:02}:{:06.3}", s % 60.0)
    };
    let mut push = |what: &str, content: Vec<u8>| {
        out.push(Variant::same(
            format!("12: {what}"),
            "catheter.csv",
            content,
        ));
    };
    push(
        "times with their distance from UTC",
        of(&|t| format!("2026-03-02T{}+01:00", clock(32_400.0 + t))),
    );
    // At 7 s the clock is put forward from 2:00 to 3:00.
    push(
        "a change to summer time with zones",
        of(&|t| {
            let (s, zone) = if t < 7.0 {
                (7193.0 + t, "+01:00")
            } else {
                (7193.0 + t + 3600.0, "+02:00")
            };
            format!("2026-03-29T{}{zone}", clock(s))
        }),
    );
    for (what, day_before, day_after) in [
        ("months before days", "01/31/2026", "02/01/2026"),
        ("days before months", "31/01/2026", "01/02/2026"),
        ("two small numbers, months first", "1/2/2026", "1/3/2026"),
        ("two small numbers, days first", "2.1.2026", "3.1.2026"),
    ] {
        push(
            what,
            of(&|t| {
                let s = 86_393.0 + t;
                if s < 86_400.0 {
                    format!("{day_before} {}", clock(s))
                } else {
                    format!("{day_after} {}", clock(s - 86_400.0))
                }
            }),
        );
    }
}

/// Kind 15: rates for intervals, in AcqKnowledge's header.
fn acqknowledge(rows: &Rows, out: &mut Vec<Variant>) {
    for (rate, time, factor) in [
        ("4 msec/sample", "msec", 1e3),
        ("0.004 sec/sample", "sec", 1.0),
        ("250 samples/sec", "sec", 1.0),
        ("250 Hz", "min", 1.0 / 60.0),
        ("0.25 kHz", "msec", 1e3),
    ] {
        let mut text = format!(
            "run7.acq\n{rate}\n3 channels\nLVP\nmmHg\nAoP\nmmHg\nECG\nmV\n{time}\tCH1\tCH2\tCH3\n"
        );
        let n = rows.time_s.len();
        let _ = writeln!(text, "\t{n}\t{n}\t{n}");
        for i in 0..n {
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let _ = writeln!(text, "{:.9}\t{p}\t{a}\t{e}", factor * rows.time_s[i]);
        }
        out.push(Variant::same(
            format!("15: AcqKnowledge at {rate}"),
            "catheter.txt",
            text.into_bytes(),
        ));
    }
}

/// Kind 13: two visible sheets with the same columns and other numbers.
fn sheets(rows: &Rows, out: &mut Vec<Variant>) {
    let of = |factor: f64| {
        let head = ["Time (ms)", "LVP (mmHg)", "AoP (mmHg)", "ECG (mV)"].map(str::to_owned);
        let rows = rows.clone();
        std::iter::once(head.to_vec()).chain((0..rows.time_s.len()).map(move |i| {
            let cell = |k: usize, factor: f64| format!("{:.2}", factor * rows.channels[k][i]);
            vec![
                (4 * i).to_string(),
                cell(0, factor),
                cell(1, factor),
                cell(2, 1.0),
            ]
        }))
    };
    let sheet = |rows: &mut dyn Iterator<Item = Vec<String>>| rows.collect::<Vec<_>>();
    let (right, raw) = (sheet(&mut of(1.0)), sheet(&mut of(0.5)));
    for (what, sheets, expected) in [
        (
            "another one first",
            vec![raw.clone(), right.clone()],
            Expected::SameOrWarned(&["`Sheet1`, which is read", "`Sheet2`", "with other numbers"]),
        ),
        (
            "another one last",
            vec![right.clone(), raw],
            Expected::SameOrWarned(&["`Sheet1`, which is read", "`Sheet2`", "with other numbers"]),
        ),
        ("twice the same", vec![right.clone(), right], Expected::Same),
    ] {
        out.push(Variant {
            what: format!("13: two visible sheets, {what}"),
            files: vec![("catheter.xlsx".to_owned(), workbook(&sheets))],
            expected,
        });
    }
}

/// Kind 23: frames of dashes.
fn frames(rows: &Rows, out: &mut Vec<Variant>) {
    let catheter = table(rows, &usual()).into_bytes();
    for word in ["-", "--", "n.a.", "#DIV/0!"] {
        let mut cine = "time_ms,volume_mL\n".to_owned();
        for (i, (t, v)) in super::sound_frames().iter().enumerate() {
            let cell = if i == 20 {
                word.to_owned()
            } else {
                v.to_string()
            };
            let _ = writeln!(cine, "{t},{cell}");
        }
        out.push(Variant {
            what: format!("23: a frame of `{word}`"),
            files: vec![
                ("catheter.csv".to_owned(), catheter.clone()),
                ("cine.csv".to_owned(), cine.into_bytes()),
            ],
            expected: Expected::Same,
        });
    }
}
