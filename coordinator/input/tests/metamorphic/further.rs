//! Further variants of kinds of the public reports, each made here from the sound recording: pauses,
//! electrocardiograms without samples, headers of EDF, thousands, clocks, hum and pacing.

use std::fmt::Write as _;
use std::io::Write as _;

use super::{Expected, Rows, Variant, csv, paused, table, usual, with_ecg};

/// All variants of this page.
pub fn variants(rows: &Rows) -> Vec<Variant> {
    let mut out = Vec::new();
    pauses(rows, &mut out);
    without_ecg(rows, &mut out);
    edf_headers(rows, &mut out);
    thousands(rows, &mut out);
    clocks(rows, &mut out);
    hum_and_pacing(rows, &mut out);
    out
}

/// Kind 03: several pauses, pauses off the grid of samples, and blocks of LabChart with dates.
fn pauses(rows: &Rows, out: &mut Vec<Variant>) {
    let form = usual();
    let several = |pauses: &[(f64, f64)]| {
        // From the last one on, so that the times before stay as they are.
        let ordered = pauses.iter().rev();
        ordered.fold(rows.clone(), |rows, (at, length)| {
            paused(&rows, *at, *length)
        })
    };
    for pauses in [
        [(4.1, 3.0), (9.3, 20.0)].as_slice(),
        &[(3.2, 0.7), (7.7, 61.0), (11.4, 5.0)],
        &[(6.0, 7.0013)],
        &[(8.88, 0.0307), (10.0, 3600.0)],
    ] {
        out.push(csv(
            format!("03: pauses {pauses:?}"),
            &several(pauses),
            &form,
        ));
    }
    let cut = rows.time_s.len() / 2;
    for gap_s in [2.0, 61.0] {
        let mut text = String::new();
        for (block, range) in [(0, 0..cut), (1, cut..rows.time_s.len())] {
            let begin_s = f64::from(block) * (rows.time_s[cut] + gap_s);
            let date = 44_562.4 + begin_s / 86_400.0;
            let _ = write!(
                text,
                "{}",
                labchart_header("StartOfBlock", &format!("{date:.12}"))
            );
            for i in range.clone() {
                let t = 0.004 * (i - range.start) as f64;
                let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
                let _ = writeln!(text, "{t:.3}\t{p}\t{a}\t{e}");
            }
        }
        out.push(labchart(
            format!("03: two blocks of LabChart, {gap_s} s apart"),
            text,
        ));
    }
}

pub(super) fn labchart_header(format: &str, date: &str) -> String {
    format!(
        "Interval=\t0.004 s\nExcelDateTime=\t{date}\t1/1/2022\nTimeFormat=\t{format}\n\
         ChannelTitle=\tLVP\tAoP\tECG\nRange=\t1 V\t1 V\t1 V\nUnitName=\tmmHg\tmmHg\tmV\n"
    )
}

pub(super) fn labchart(name: impl Into<String>, text: String) -> Variant {
    Variant::same(name, "catheter.txt", text.into_bytes())
}

/// Kind 06: electrocardiograms that were lost early or late, of words, of zeros, of one sample.
fn without_ecg(rows: &Rows, out: &mut Vec<Variant>) {
    let form = usual();
    let kept = |from_s: f64, to_s: f64| {
        with_ecg(rows, move |_, t, e| {
            if (from_s..to_s).contains(&t) {
                e
            } else {
                f64::NAN
            }
        })
    };
    // Where it is there, its beats count, and it is said for how long it is not there.
    let middle = with_ecg(rows, |_, t, e| {
        if (4.0..11.0).contains(&t) {
            f64::NAN
        } else {
            e
        }
    });
    for (what, rows) in [
        ("of 2 s alone", &kept(0.0, 2.0)),
        ("of the last 2 s alone", &kept(13.0, 99.0)),
        ("without its middle", &middle),
    ] {
        out.push(Variant {
            expected: Expected::SameOrWarned(&[
                "s of the recording are without an electrocardiogram",
            ]),
            ..csv(format!("06: ECG {what}"), rows, &form)
        });
    }
    out.push(csv(
        "06: ECG of zeros",
        &with_ecg(rows, |_, _, _| 0.0),
        &form,
    ));
    out.push(csv(
        "06: ECG of one sample",
        &with_ecg(rows, |i, _, _| if i == 1000 { 1.0 } else { f64::NAN }),
        &form,
    ));
    let empty = table(&with_ecg(rows, |_, _, _| f64::NAN), &form);
    for word in ["NaN", "NA", "null"] {
        let filled: String = empty
            .lines()
            .map(|line| match line.strip_suffix(',') {
                Some(line) => format!("{line},{word}\n"),
                None => format!("{line}\n"),
            })
            .collect();
        out.push(Variant::same(
            format!("06: ECG of `{word}`"),
            "catheter.csv",
            filled.into_bytes(),
        ));
    }
}

/// A signal of an EDF file.
#[derive(Clone)]
struct Signal {
    label: &'static str,
    unit: &'static str,
    /// Physical values of the least and the largest number.
    physical: [&'static str; 2],
    /// Index of the rows' channel; `None` for zeros.
    channel: Option<usize>,
}

/// Digital values of the physical ones, of all signals.
const DIGITAL: [f64; 2] = [-32_768.0, 32_767.0];
/// Samples of a record of one second.
const PER_RECORD: usize = 250;

fn signals() -> Vec<Signal> {
    let signal = |label, unit, physical, channel| Signal {
        label,
        unit,
        physical,
        channel: Some(channel),
    };
    vec![
        signal("LVP", "mmHg", ["-50", "250"], 0),
        signal("AoP", "mmHg", ["-50", "250"], 1),
        signal("ECG", "mV", ["-10", "10"], 2),
    ]
}

/// An EDF file of the rows, with the number of records that its header states.
fn edf(rows: &Rows, signals: &[Signal], stated: &str) -> Vec<u8> {
    let n = rows.time_s.len() / PER_RECORD;
    let field = |text: &str, width: usize| format!("{text:width$}")[..width].to_owned();
    let mut header = field("0", 8) + &field("X X X X", 80) + &field("Startdate X X X X", 80);
    header += "01.01.2209.00.00";
    header += &field(&(256 * (signals.len() + 1)).to_string(), 8);
    header += &(field("", 44) + &field(stated, 8) + &field("1", 8));
    header += &field(&signals.len().to_string(), 4);
    for (width, of) in [
        (
            16,
            (|s: &Signal| s.label.to_owned()) as fn(&Signal) -> String,
        ),
        (80, |_| String::new()),
        (8, |s| s.unit.to_owned()),
        (8, |s| s.physical[0].to_owned()),
        (8, |s| s.physical[1].to_owned()),
        (8, |_| DIGITAL[0].to_string()),
        (8, |_| DIGITAL[1].to_string()),
        (80, |_| String::new()),
        (8, |_| PER_RECORD.to_string()),
        (32, |_| String::new()),
    ] {
        signals
            .iter()
            .for_each(|signal| header += &field(&of(signal), width));
    }
    let mut bytes = header.into_bytes();
    for record in 0..n {
        for signal in signals {
            let [low, high] = signal.physical.map(|text| text.parse::<f64>().unwrap());
            for i in record * PER_RECORD..(record + 1) * PER_RECORD {
                let value = signal.channel.map_or(0.0, |k| rows.channels[k][i]);
                let share = if high == low {
                    0.5
                } else {
                    (value - low) / (high - low)
                };
                let digital = DIGITAL[0] + share * (DIGITAL[1] - DIGITAL[0]);
                bytes.extend((digital.round() as i16).to_le_bytes());
            }
        }
    }
    bytes
}

/// Kind 08: counts of records, ranges, units and unused signals.
fn edf_headers(rows: &Rows, out: &mut Vec<Variant>) {
    let sound = signals();
    let with = |change: &dyn Fn(&mut Vec<Signal>)| {
        let mut signals = signals();
        change(&mut signals);
        signals
    };
    let mut push = |what: &str, bytes: Vec<u8>| {
        out.push(Variant::same(format!("08: {what}"), "catheter.edf", bytes));
    };
    push("as it is", edf(rows, &sound, "15"));
    push("an unknown number of records", edf(rows, &sound, "-1"));
    push("40 records stated", edf(rows, &sound, "40"));
    push("1 record stated", edf(rows, &sound, "1"));
    let mut cut = edf(rows, &sound, "15");
    cut.truncate(cut.len() - 700);
    push("cut within the last record", cut);
    push(
        "a range from high to low",
        edf(rows, &with(&|s| s[0].physical = ["250", "-50"]), "15"),
    );
    push(
        "a unit behind which there is more",
        edf(rows, &with(&|s| s[0].unit = "mmHg\0V\0"), "15"),
    );
    push(
        "unused signals without a range",
        edf(
            rows,
            &with(&|s| {
                for (at, label) in [(0, "Temp"), (2, "Aux 1")] {
                    s.insert(
                        at,
                        Signal {
                            label,
                            unit: "",
                            physical: ["0", "0"],
                            channel: None,
                        },
                    );
                }
            }),
            "15",
        ),
    );
    let without_range = edf(rows, &with(&|s| s[1].physical = ["7", "7"]), "15");
    out.push(Variant {
        what: "08: the aorta without a range".to_owned(),
        files: vec![("catheter.edf".to_owned(), without_range)],
        expected: Expected::Said(&["AoP", "physical"]),
    });
    let odd = edf(
        rows,
        &with(&|s| {
            (s[0].label, s[1].label) = ("Channel 1", "Channel 2");
        }),
        "15",
    );
    out.push(Variant {
        what: "08: labels that say nothing".to_owned(),
        files: vec![("catheter.edf".to_owned(), odd)],
        expected: Expected::Said(&["Channel 1", "Channel 2"]),
    });
}

/// A workbook of sheets with all cells as text.
pub(super) fn workbook(sheets: &[Vec<Vec<String>>]) -> Vec<u8> {
    const TYPE: &str = "application/vnd.openxmlformats-officedocument.spreadsheetml";
    const RELATION: &str = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
    const PACKAGE: &str = "http://schemas.openxmlformats.org/package/2006";
    const MAIN: &str = "http://schemas.openxmlformats.org/spreadsheetml/2006/main";
    let (mut types, mut list, mut links) = (String::new(), String::new(), String::new());
    let mut parts = Vec::new();
    for (n, rows) in (1..).zip(sheets) {
        let mut sheet = format!("<worksheet xmlns=\"{MAIN}\"><sheetData>");
        for (i, row) in rows.iter().enumerate() {
            let _ = write!(sheet, "<row r=\"{}\">", i + 1);
            for (k, cell) in row.iter().enumerate() {
                let column = char::from(b'A' + u8::try_from(k).unwrap());
                let cell = cell.replace('\'', "&apos;");
                let _ = write!(
                    sheet,
                    "<c r=\"{column}{}\" t=\"inlineStr\"><is><t>{cell}</t></is></c>",
                    i + 1
                );
            }
            sheet += "</row>";
        }
        sheet += "</sheetData></worksheet>";
        parts.push((format!("xl/worksheets/sheet{n}.xml"), sheet));
        let _ = write!(
            types,
            "<Override PartName=\"/xl/worksheets/sheet{n}.xml\" ContentType=\"{TYPE}.worksheet+xml\"/>"
        );
        let _ = write!(
            list,
            "<sheet name=\"Sheet{n}\" sheetId=\"{n}\" r:id=\"rId{n}\"/>"
        );
        let _ = write!(
            links,
            "<Relationship Id=\"rId{n}\" Type=\"{RELATION}/worksheet\" Target=\"worksheets/sheet{n}.xml\"/>"
        );
    }
    parts.extend([
        (
            "[Content_Types].xml".to_owned(),
            format!("<Types xmlns=\"{PACKAGE}/content-types\"><Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/><Override PartName=\"/xl/workbook.xml\" ContentType=\"{TYPE}.sheet.main+xml\"/>{types}</Types>"),
        ),
        (
            "_rels/.rels".to_owned(),
            format!("<Relationships xmlns=\"{PACKAGE}/relationships\"><Relationship Id=\"rId1\" Type=\"{RELATION}/officeDocument\" Target=\"xl/workbook.xml\"/></Relationships>"),
        ),
        (
            "xl/workbook.xml".to_owned(),
            format!("<workbook xmlns=\"{MAIN}\" xmlns:r=\"{RELATION}\"><sheets>{list}</sheets></workbook>"),
        ),
        (
            "xl/_rels/workbook.xml.rels".to_owned(),
            format!("<Relationships xmlns=\"{PACKAGE}/relationships\">{links}</Relationships>"),
        ),
    ]);
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, text) in parts {
        zip.start_file(name, stored).unwrap();
        zip.write_all(text.as_bytes()).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A whole number with a mark between its thousands.
fn grouped(value: usize, mark: char) -> String {
    match value {
        0..1000 => value.to_string(),
        _ => format!("{}{mark}{:03}", value / 1000, value % 1000),
    }
}

/// Kind 11: thousands with a comma, an apostrophe, a blank or a point, in sheets and text tables.
fn thousands(rows: &Rows, out: &mut Vec<Variant>) {
    let header = ["Time (ms)", "LVP (mmHg)", "AoP (mmHg)", "ECG (mV)"];
    let cells = |mark: char| {
        let rows = rows.clone();
        let head = std::iter::once(header.map(str::to_owned).to_vec());
        head.chain((0..rows.time_s.len()).map(move |i| {
            let time = grouped(4 * i, mark);
            let mut row = vec![time];
            row.extend((0..3).map(|k| format!("{:.2}", rows.channels[k][i])));
            row
        }))
    };
    for (mark, parts) in [
        (',', ["1,000", "may be"].as_slice()),
        ('\'', &["1'000"]),
        (' ', &["1 000"]),
        ('\u{202f}', &["1\u{202f}000"]),
    ] {
        out.push(Variant {
            what: format!("11: times with {mark:?} in a sheet"),
            files: vec![(
                "catheter.xlsx".to_owned(),
                workbook(&[cells(mark).collect()]),
            )],
            expected: Expected::SameOrSaid(parts),
        });
        let lines: Vec<String> = cells(mark).map(|row| row.join(";")).collect();
        out.push(Variant {
            what: format!("11: times with {mark:?} in a text"),
            files: vec![("catheter.csv".to_owned(), lines.join("\n").into_bytes())],
            expected: Expected::SameOrSaid(&[]),
        });
    }
    // Volumes in µL next to the sound catheter.
    let catheter = table(rows, &usual()).into_bytes();
    let frames: Vec<(f64, f64)> = super::sound_frames();
    for (what, mark, decimals) in [
        ("a comma", ',', ""),
        ("a comma and a decimal point", ',', ".5"),
        ("an apostrophe", '\'', ""),
        ("a blank", ' ', ""),
    ] {
        let head = std::iter::once(vec!["Time (ms)".to_owned(), "Volume (µL)".to_owned()]);
        let rows = head.chain(frames.iter().map(|(t, v)| {
            let volume = grouped((1000.0 * v).round() as usize, mark);
            vec![t.to_string(), format!("{volume}{decimals}")]
        }));
        let sheet = workbook(&[rows.collect()]);
        out.push(Variant {
            what: format!("11: volumes with {what}"),
            files: vec![
                ("catheter.csv".to_owned(), catheter.clone()),
                ("cine.xlsx".to_owned(), sheet),
            ],
            expected: Expected::SameOrSaid(&["Volume"]),
        });
    }
}

/// Kind 14: halves of the day, dates before times, rounded times, decimal commas.
fn clocks(rows: &Rows, out: &mut Vec<Variant>) {
    let n = rows.time_s.len();
    let of = |begin_s: f64, format: &str, time: &dyn Fn(f64) -> String, comma: bool| {
        let mut text = labchart_header(format, &format!("{:.9}", 44_562.0 + begin_s / 86_400.0));
        if comma {
            text = text.replace("0.004 s", "0,004 s");
        }
        for i in 0..n {
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let mut row = format!("{p}\t{a}\t{e}");
            if comma {
                row = row.replace('.', ",");
            }
            let _ = writeln!(text, "{}\t{row}", time(begin_s + 0.004 * i as f64));
        }
        text
    };
    let halves = |t: f64| {
        let t = t % 86_400.0;
        let hours = (t / 3600.0) as usize;
        let shown = if hours.is_multiple_of(12) {
            12
        } else {
            hours % 12
        };
        let mark = if hours < 12 { "AM" } else { "PM" };
        format!(
            "{shown}:{:02}:{:06.3} {mark}",
            (t / 60.0) as usize % 60,
            t % 60.0
        )
    };
    for begin_s in [43_193.0, 86_391.5, 3_000.0] {
        out.push(labchart(
            format!("14: AM and PM from {begin_s} s"),
            of(begin_s, "TimeOfDay", &halves, false),
        ));
    }
    let dated = |t: f64| {
        let day = (t / 86_400.0) as usize;
        let t = t % 86_400.0;
        let (hours, minutes) = ((t / 3600.0) as usize, (t / 60.0) as usize % 60);
        format!(
            "{}/1/2022\t{hours:02}:{minutes:02}:{:06.3}",
            1 + day,
            t % 60.0
        )
    };
    for begin_s in [40_000.0, 86_392.0] {
        out.push(labchart(
            format!("14: dates and times from {begin_s} s"),
            of(begin_s, "TimeOfDay", &dated, false),
        ));
    }
    for decimals in [1, 2] {
        out.push(labchart(
            format!("14: times with {decimals} decimals"),
            of(0.0, "StartOfBlock", &|t| format!("{t:.decimals$}"), false),
        ));
    }
    out.push(labchart(
        "14: decimal commas and minutes",
        of(
            0.0,
            "StartOfBlock",
            &|t| format!("{}:{:06.3}", (t / 60.0) as usize, t % 60.0).replace('.', ","),
            true,
        ),
    ));
}

/// Kind 25: hum of railways and with its third harmonic, spikes of either sign and before both chambers,
/// tall waves after the R wave.
fn hum_and_pacing(rows: &Rows, out: &mut Vec<Variant>) {
    let form = usual();
    for (what, parts) in [
        ("16.7 Hz", [(16.7, 0.1)].as_slice()),
        ("50 and 150 Hz", &[(50.0, 0.2), (150.0, 0.07)]),
        ("49.6 Hz", &[(49.6, 0.3)]),
        ("60 and 120 Hz", &[(60.0, 0.3), (120.0, 0.15)]),
    ] {
        let hum = with_ecg(rows, |_, t, e| {
            let sum = |(hz, size): &(f64, f64)| size * (std::f64::consts::TAU * hz * t).sin();
            e + parts.iter().map(sum).sum::<f64>()
        });
        out.push(csv(format!("25: hum of {what}"), &hum, &form));
    }
    let ecg = &rows.channels[2];
    let peaks: Vec<usize> = (60..ecg.len() - 20)
        .filter(|i| ecg[*i] > 0.6 && ecg[i - 20..i + 20].iter().all(|v| *v <= ecg[*i]))
        .collect();
    let spiked = |spikes: &[(usize, f64)]| {
        let mut spiked = rows.clone();
        for peak in &peaks {
            for (ahead, size) in spikes {
                spiked.channels[2][peak - ahead] = *size;
            }
        }
        spiked
    };
    for (what, spikes) in [
        ("negative spikes", [(40, -20.0)].as_slice()),
        ("spikes before both chambers", &[(45, 8.0), (10, 8.0)]),
        ("spikes of two phases", &[(41, 15.0), (40, -12.0)]),
        ("small spikes", &[(35, 3.0)]),
    ] {
        out.push(csv(format!("25: {what}"), &spiked(spikes), &form));
    }
    // A wave that is taller than the R wave, 300 ms behind it.
    let tall = with_ecg(rows, |i, _, e| {
        let wave = |peak: &usize| {
            let x = (i as f64 - (*peak as f64 + 75.0)) / 6.0;
            1.6 * (-x * x).exp()
        };
        e + peaks.iter().map(wave).sum::<f64>()
    });
    out.push(csv("25: a tall wave behind the R wave", &tall, &form));
}
