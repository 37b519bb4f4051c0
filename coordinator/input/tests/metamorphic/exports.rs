//! Variants as programs export them: records without times, dates next to times, minutes, names of other
//! leads, units twice, volumes with a point between thousands, beats of which some are cut.

use std::fmt::Write as _;

use super::further::{labchart, labchart_header, workbook};
use super::{Expected, Form, Rows, Variant, csv, exact, sound_frames, table, usual, with_ecg};

/// All variants of this page.
pub fn variants(rows: &Rows) -> Vec<Variant> {
    // The same samples in another form.
    let mut out = Vec::new();
    stamps(rows, &mut out);
    names(rows, &mut out);
    exact(&mut out);
    records(rows, &mut out);
    pressures(rows, &mut out);
    clocks(rows, &mut out);
    spikes(rows, &mut out);
    volumes(rows, &mut out);
    out
}

fn clock(s: f64) -> String {
    let (hours, minutes) = ((s / 3600.0) as usize, (s / 60.0) as usize % 60);
    format!("{hours:02}:{minutes:02}:{:06.3}", s % 60.0)
}

/// A table with other times, and their header.
fn timed(rows: &Rows, header: &str, time: impl Fn(f64) -> String) -> Vec<u8> {
    let mut text = format!("{header},LVP (mmHg),AoP (mmHg),ECG (mV)\n");
    for i in 0..rows.time_s.len() {
        let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
        let _ = writeln!(text, "{},{p},{a},{e}", time(rows.time_s[i]));
    }
    text.into_bytes()
}

/// Kind 12: dates in a column of their own, minutes, texts in a sheet, other names and units.
fn stamps(rows: &Rows, out: &mut Vec<Variant>) {
    let mut push = |what: &str, content: Vec<u8>| {
        let what = format!("12: {what}");
        out.push(Variant::same(what, "catheter.csv", content));
    };
    for begin_s in [32_400.0, 86_392.0] {
        let dated = |t: f64| {
            let s = begin_s + t;
            let day = 2 + (s / 86_400.0) as usize;
            format!("2026-03-{day:02},{}", clock(s % 86_400.0))
        };
        push(
            &format!("dates beside times from {begin_s} s"),
            timed(rows, "Date,Time", dated),
        );
    }
    push(
        "minutes and seconds",
        timed(rows, "Time", |t| clock(t)[3..].to_owned()),
    );
    push(
        "a column named Timestamp",
        timed(rows, "Timestamp", |t| format!("2026-03-02T{}Z", clock(t))),
    );
    for (unit, per_s) in [("days", 1.0 / 86_400.0), ("hours", 1.0 / 3600.0)] {
        push(
            &format!("times in {unit}"),
            timed(rows, &format!("Time ({unit})"), |t| {
                format!("{:.12}", 46_000.0 * f64::from(unit == "days") + t * per_s)
            }),
        );
    }
    let head = ["Time", "LVP (mmHg)", "AoP (mmHg)", "ECG (mV)"].map(str::to_owned);
    let cells = (0..rows.time_s.len()).map(|i| {
        let of = |k: usize| rows.channels[k][i].to_string();
        vec![clock(32_400.0 + rows.time_s[i]), of(0), of(1), of(2)]
    });
    let sheet: Vec<Vec<String>> = std::iter::once(head.to_vec()).chain(cells).collect();
    out.push(Variant::same(
        "12: times of day as texts of a sheet",
        "catheter.xlsx",
        workbook(&[sheet]),
    ));
}

/// Kinds 06 and 14: electrocardiograms of any lead and without a unit, units in the name and next to it.
fn names(rows: &Rows, out: &mut Vec<Variant>) {
    for name in [
        "EKG V5 (mV)",
        "Surface EKG (mV)",
        "ECG",
        "ECG (a.u.)",
        "Ecg lead aVF [mV]",
    ] {
        let mut form = usual();
        form.columns[3] = (name, 1.0);
        out.push(csv(format!("06: ECG named {name}"), rows, &form));
    }
    let samples = |titles: &str| {
        let mut text = labchart_header("StartOfBlock", "44562.4").replace("LVP\tAoP\tECG", titles);
        for i in 0..rows.time_s.len() {
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let _ = writeln!(text, "{:.3}\t{p}\t{a}\t{e}", rows.time_s[i]);
        }
        text
    };
    out.push(labchart(
        "14: units in titles as in UnitName=",
        samples("LVP (mmHg)\tAoP [mm Hg]\tECG, mV"),
    ));
    out.push(Variant {
        expected: Expected::Said(&["LVP (kPa) (mmHg)", "the unit of a pressure"]),
        ..labchart(
            "14: a unit in a title against UnitName=",
            samples("LVP (kPa)\tAoP\tECG"),
        )
    });
}

/// Samples of a record of one second, and bytes of its annotations.
const PER_RECORD: usize = 250;
const ANNOTATION: usize = 32;

/// An EDF file of the rows with the times of its records, of which some have none.
fn edf(rows: &Rows, kind: &str, begin_s: impl Fn(usize) -> Option<f64>) -> Vec<u8> {
    let n = rows.time_s.len() / PER_RECORD;
    let labels = ["LVP", "AoP", "ECG", "EDF Annotations"];
    let field = |text: &str, width: usize| format!("{text:width$}")[..width].to_owned();
    let mut header = field("0", 8) + &field("X X X X", 80) + &field("Startdate X X X X", 80);
    header += "01.01.2209.00.00";
    header += &(field(&(256 * 5).to_string(), 8) + &field(kind, 44));
    header += &(field(&n.to_string(), 8) + &field("1", 8) + &field("4", 4));
    labels.iter().for_each(|label| header += &field(label, 16));
    header += &field("", 4 * 80);
    ["mmHg", "mmHg", "mV", ""]
        .iter()
        .for_each(|unit| header += &field(unit, 8));
    for ends in [
        ["-300", "-300", "-30", "-1"],
        ["300", "300", "30", "1"],
        ["-32768"; 4],
        ["32767"; 4],
    ] {
        ends.iter().for_each(|end| header += &field(end, 8));
    }
    header += &field("", 4 * 80);
    let samples = PER_RECORD.to_string();
    for count in [&samples, &samples, &samples, &(ANNOTATION / 2).to_string()] {
        header += &field(count, 8);
    }
    header += &field("", 4 * 32);
    let mut bytes = header.into_bytes();
    for record in 0..n {
        for (channel, most) in [(0, 300.0), (1, 300.0), (2, 30.0)] {
            for value in &rows.channels[channel][record * PER_RECORD..(record + 1) * PER_RECORD] {
                let digital = (value + most) / (2.0 * most) * 65_535.0 - 32_768.0;
                bytes.extend((digital.round() as i16).to_le_bytes());
            }
        }
        let mut annotation = vec![0; ANNOTATION];
        if let Some(begin_s) = begin_s(record) {
            let text = format!("+{begin_s:.3}\x14\x14\0");
            annotation[..text.len()].copy_from_slice(text.as_bytes());
        }
        bytes.extend(annotation);
    }
    bytes
}

/// Kinds 03 and 07: times of records count in every header, and one that is missing hides no gap.
fn records(rows: &Rows, out: &mut Vec<Variant>) {
    let mut push = |what: String, bytes: Vec<u8>| {
        out.push(Variant::same(what, "catheter.edf", bytes));
    };
    let behind =
        |gap_s: f64| move |record: usize| record as f64 + if record > 6 { gap_s } else { 0.0 };
    for (kind, gap_s) in [
        ("EDF+D", 86_400.0),
        ("EDF+C", 7.5),
        ("", 7.5),
        ("edf+d", 7.5),
        ("EDF+C", 0.0),
    ] {
        let begin = behind(gap_s);
        push(
            format!("07: `{kind}` with a gap of {gap_s} s"),
            edf(rows, kind, |record| Some(begin(record))),
        );
    }
    for without in [0, 3, 6, 14] {
        let begin = behind(7.5);
        push(
            format!("07: record {without} without a time"),
            edf(rows, "EDF+C", |record| {
                (record != without).then(|| begin(record))
            }),
        );
    }
    push(
        "07: no record with a time".to_owned(),
        edf(rows, "EDF+C", |_| None),
    );
}

fn with(rows: &Rows, channel: usize, of: impl Fn(f64, f64) -> f64) -> Rows {
    let mut rows = rows.clone();
    let times = rows.time_s.clone();
    let values = rows.channels[channel].iter_mut().zip(times);
    values.for_each(|(v, t)| *v = of(t, *v));
    rows
}

/// Kinds 01, 02 and 25: a range that was too small for a while, an aorta of another time, hum in pressures.
fn pressures(rows: &Rows, out: &mut Vec<Variant>) {
    let alone = Form {
        order: vec![0, 1, 3],
        ..usual()
    };
    for until_s in [8.0, 11.0] {
        let cut = with(rows, 0, |t, p| if t < until_s { p.min(104.0) } else { p });
        out.push(Variant {
            expected: Expected::Said(&["of 11 beats", "below the aorta's"]),
            ..csv(
                format!("01: ventricle cut until {until_s} s"),
                &cut,
                &usual(),
            )
        });
        out.push(Variant {
            expected: Expected::SameOrWarned(&["stays at its largest value in", "of 11 beats"]),
            ..csv(
                format!("01: ventricle cut until {until_s} s, no aorta"),
                &cut,
                &alone,
            )
        });
    }
    for least in [66.0, 70.0, 75.0] {
        out.push(Variant {
            expected: Expected::SameOrWarned(&["an aortic pressure that stays at its smallest"]),
            ..csv(
                format!("01: aorta cut below {least}"),
                &with(rows, 1, |_, p| p.max(least)),
                &usual(),
            )
        });
    }
    for late in [40_usize, 60] {
        let mut moved = rows.clone();
        moved.channels[1].rotate_right(late);
        out.push(Variant {
            expected: Expected::SameOrWarned(&["an aorta that"]),
            ..csv(format!("02: aorta {} ms late", 4 * late), &moved, &usual())
        });
    }
    let hum = |t: f64| 5.0 * (std::f64::consts::TAU * 50.0 * t).sin();
    let both = with(&with(rows, 0, |t, p| p + hum(t)), 1, |t, p| p + hum(t));
    out.push(Variant {
        expected: Expected::SameOrWarned(&["ventricle's pressure has a hum", "aorta's pressure"]),
        ..csv("25: hum in the pressures", &both, &usual())
    });
}

/// Kind 06: an electrocardiogram whose clock is ahead or behind.
fn clocks(rows: &Rows, out: &mut Vec<Variant>) {
    for late in [35_isize, 60, 125, 180] {
        let n = rows.time_s.len();
        let moved = with_ecg(rows, |i, _, _| {
            rows.channels[2][(i + n - late as usize) % n]
        });
        out.push(csv(
            format!("06: ECG {} ms late", 4 * late),
            &moved,
            &usual(),
        ));
    }
}

/// Kind 25: spikes with the long tail of an amplifier, at 1 kHz.
fn spikes(rows: &Rows, out: &mut Vec<Variant>) {
    let fine = super::resampled(rows, 0.001);
    let ecg = &rows.channels[2];
    let peaks = (60..ecg.len() - 20)
        .filter(|i| ecg[*i] > 0.6 && ecg[i - 20..i + 20].iter().all(|v| *v <= ecg[*i]));
    let mut spiked = fine.clone();
    for peak in peaks {
        for j in 0..60 {
            let tail = if j < 2 {
                12.0
            } else {
                -2.0 * (-(j as f64) / 15.0).exp()
            };
            if let Some(value) = spiked.channels[2].get_mut(4 * peak - 160 + j) {
                *value += tail;
            }
        }
    }
    out.push(csv("25: spikes with a tail at 1 kHz", &spiked, &usual()));
}

/// Kinds 11 and 23: points between thousands of µL, and ends of the cycle without a contour.
fn volumes(rows: &Rows, out: &mut Vec<Variant>) {
    let catheter = (
        "catheter.csv".to_owned(),
        table(rows, &usual()).into_bytes(),
    );
    let grouped = |v: f64| {
        let whole = (1e3 * v).round() as usize;
        format!("{}.{:03}", whole / 1000, whole % 1000)
    };
    let lines = sound_frames()
        .into_iter()
        .map(|(t, v)| format!("{t};{}\n", grouped(v)));
    let text = format!("Time (ms);Volume (µL)\n{}", lines.collect::<String>());
    let cells = sound_frames()
        .into_iter()
        .map(|(t, v)| vec![t.to_string(), grouped(v)]);
    let head = vec!["Time (ms)".to_owned(), "Volume (µL)".to_owned()];
    let sheet = workbook(&[std::iter::once(head).chain(cells).collect()]);
    for (name, content) in [("cine.csv", text.into_bytes()), ("cine.xlsx", sheet)] {
        out.push(Variant {
            what: format!("11: points between thousands in {name}"),
            files: vec![catheter.clone(), (name.to_owned(), content)],
            expected: Expected::Said(&["a largest volume of 0.15", "thousands"]),
        });
    }
    let frames = sound_frames();
    // The last, a flow that rises twice in one ejection: it is one beat all the same.
    for bare in [
        vec![frames.len() - 1],
        vec![1],
        vec![frames.len() - 1, 14],
        vec![8, 9],
    ] {
        let mut cine = "time_ms,volume_mL\n".to_owned();
        for (i, (t, v)) in frames.iter().enumerate() {
            let volume = if bare.contains(&i) {
                String::new()
            } else {
                v.to_string()
            };
            let _ = writeln!(cine, "{t},{volume}");
        }
        out.push(Variant {
            what: format!("23: frames {bare:?} without a contour"),
            files: vec![catheter.clone(), ("cine.csv".to_owned(), cine.into_bytes())],
            expected: Expected::Same,
        });
    }
    for wrong in 0..frames.len() {
        let mut cine = "time_ms,volume_mL\n".to_owned();
        for (i, (t, v)) in frames.iter().enumerate() {
            let factor = if i == wrong { 2.0 } else { 1.0 };
            let _ = writeln!(cine, "{t},{}", factor * v);
        }
        out.push(Variant {
            what: format!("23: the volume of frame {wrong} is doubled"),
            files: vec![catheter.clone(), ("cine.csv".to_owned(), cine.into_bytes())],
            expected: Expected::Said(&["cine.csv", "where the volumes before and after give"]),
        });
    }
}
