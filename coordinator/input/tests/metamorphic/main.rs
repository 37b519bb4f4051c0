//! Changes of a recording that change nothing about the heart: shifts, units, order, names, signs,
//! pauses, dropouts, hum, spikes, steps. What is derived stays as it was, or the recording is refused
//! in words.

use std::fmt::Write as _;
use std::path::Path;

use cardiotwin_input::preparation::make;
use cardiotwin_input::{Report, read_raw};

mod exports;
mod further;
mod laboratories;
mod meshes;

/// Fifteen seconds at 250 Hz.
#[derive(Clone)]
struct Rows {
    time_s: Vec<f64>,
    /// Ventricle and aorta in mmHg, electrocardiogram in mV; NaN for a lost sample.
    channels: [Vec<f64>; 3],
}

fn sound() -> Rows {
    let whole = Path::new(env!("CARGO_MANIFEST_DIR")).join(
        "../../tests/fixtures/public-reports/03-pause-between-blocks/pause-15-s/catheter.csv",
    );
    let text = std::fs::read_to_string(whole).unwrap();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect();
    Rows {
        time_s: (0..rows.len()).map(|i| 0.004 * i as f64).collect(),
        channels: [1, 2, 3].map(|k| rows.iter().map(|row| row[k]).collect()),
    }
}

/// Form of a table.
#[derive(Clone)]
struct Form {
    /// Header of time, ventricle, aorta and electrocardiogram, with the factors by which the numbers
    /// are multiplied.
    columns: [(&'static str, f64); 4],
    order: Vec<usize>,
    separator: &'static str,
    comma: bool,
    end: &'static str,
    before: &'static str,
}

fn usual() -> Form {
    Form {
        columns: [
            ("time_s", 1.0),
            ("lv_pressure_mmHg", 1.0),
            ("aortic_pressure_mmHg", 1.0),
            ("ecg_mV", 1.0),
        ],
        order: vec![0, 1, 2, 3],
        separator: ",",
        comma: false,
        end: "\n",
        before: "",
    }
}

fn table(rows: &Rows, form: &Form) -> String {
    let mut text = form.before.to_owned();
    let names: Vec<&str> = form.order.iter().map(|k| form.columns[*k].0).collect();
    let _ = write!(text, "{}{}", names.join(form.separator), form.end);
    for i in 0..rows.time_s.len() {
        let cells: Vec<String> = form
            .order
            .iter()
            .map(|k| {
                let value = if *k == 0 {
                    rows.time_s[i]
                } else {
                    rows.channels[k - 1][i]
                };
                if value.is_nan() {
                    return String::new();
                }
                let cell = format!("{:.5}", value * form.columns[*k].1);
                if form.comma {
                    cell.replace('.', ",")
                } else {
                    cell
                }
            })
            .collect();
        let _ = write!(text, "{}{}", cells.join(form.separator), form.end);
    }
    text
}

/// What is derived: cycle, largest and end-diastolic pressure, R2 and C.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Derived {
    cycle_ms: f64,
    peak: f64,
    end_diastolic: f64,
    r2: f64,
    c: f64,
}

fn sound_folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/public-reports/00-sound/edf")
}

/// Times \[ms\] and volumes \[mL\] of the sound frames.
fn sound_frames() -> Vec<(f64, f64)> {
    let text = std::fs::read_to_string(sound_folder().join("cine.csv")).unwrap();
    text.lines()
        .skip(1)
        .filter_map(|line| line.split_once(','))
        .map(|(t, v)| (t.parse().unwrap(), v.parse().unwrap()))
        .collect()
}

/// Derived values and the warnings, or the errors.
fn derived(files: &[(String, Vec<u8>)]) -> Result<(Derived, String), String> {
    let folder = tempfile::tempdir().unwrap();
    let has_frames = files.iter().any(|(name, _)| name.starts_with("cine."));
    for file in ["cine.csv", "prepare.toml"] {
        if file == "prepare.toml" || !has_frames {
            std::fs::copy(sound_folder().join(file), folder.path().join(file)).unwrap();
        }
    }
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    let mut report = Report::default();
    let raw = read_raw(folder.path(), &mut report);
    let said: Vec<String> = report
        .findings()
        .iter()
        .map(|finding| finding.problem.to_string())
        .collect();
    let raw = raw.ok_or_else(|| said.join("\n"))?;
    let made = make(&raw, "P001").map_err(|error| error.to_string())?;
    if let Some(problem) = made.problems.iter().find(|problem| problem.is_error()) {
        return Err(problem.to_string());
    }
    let lv = made.prepared.average.lv_pressure.as_ref().unwrap();
    let load = made
        .answer
        .steps
        .iter()
        .find(|step| step.step == "afterload")
        .unwrap();
    let number = |name: &str| load.numbers.get(name).copied().unwrap_or(f64::NAN);
    let of_rules = made.problems.iter().map(ToString::to_string);
    let warnings: Vec<String> = said
        .into_iter()
        .chain(of_rules)
        .chain(made.answer.warnings.iter().cloned())
        .collect();
    let values = Derived {
        cycle_ms: made.prepared.average.cycle_length_ms,
        peak: lv.mean.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        end_diastolic: lv.mean[0],
        r2: number("peripheral_resistance_mmHg_s_per_mL"),
        c: number("compliance_mL_per_mmHg"),
    };
    Ok((values, warnings.join("\n")))
}

/// What is right for a variant.
#[derive(Debug, Clone, Copy)]
enum Expected {
    /// What is derived from the sound recording, but for rounding: the same samples in another form.
    Exact,
    /// What is derived from the sound recording, but for other beats that count.
    Same,
    /// The same, or an error with these words.
    SameOrSaid(&'static [&'static str]),
    /// The same, or another result with a warning of these words.
    SameOrWarned(&'static [&'static str]),
    /// An error with these words.
    Said(&'static [&'static str]),
}

/// A variant: its name, its files, and what is right.
struct Variant {
    what: String,
    files: Vec<(String, Vec<u8>)>,
    expected: Expected,
}

impl Variant {
    fn same(what: impl Into<String>, name: &str, content: Vec<u8>) -> Self {
        Self {
            what: what.into(),
            files: vec![(name.to_owned(), content)],
            expected: Expected::Same,
        }
    }
}

fn csv(what: impl Into<String>, rows: &Rows, form: &Form) -> Variant {
    Variant::same(what, "catheter.csv", table(rows, form).into_bytes())
}

/// The rows with a pause of `length_s` after `at_s`.
fn paused(rows: &Rows, at_s: f64, length_s: f64) -> Rows {
    let mut rows = rows.clone();
    for t in rows.time_s.iter_mut().filter(|t| **t > at_s) {
        *t += length_s;
    }
    rows
}

/// The rows with samples lost in some channels.
fn dropped(rows: &Rows, at_s: f64, length_s: f64, channels: &[usize]) -> Rows {
    let mut rows = rows.clone();
    for i in 0..rows.time_s.len() {
        if (at_s..at_s + length_s).contains(&rows.time_s[i]) {
            for k in channels {
                rows.channels[*k][i] = f64::NAN;
            }
        }
    }
    rows
}

fn with_ecg(rows: &Rows, of: impl Fn(usize, f64, f64) -> f64) -> Rows {
    let mut rows = rows.clone();
    for i in 0..rows.time_s.len() {
        rows.channels[2][i] = of(i, rows.time_s[i], rows.channels[2][i]);
    }
    rows
}

/// The rows at another step, interpolated linearly.
fn resampled(rows: &Rows, step_s: f64) -> Rows {
    let end = rows.time_s[rows.time_s.len() - 1];
    let time_s: Vec<f64> = (0..=(end / step_s) as usize)
        .map(|i| i as f64 * step_s)
        .collect();
    let at = |values: &[f64], t: f64| {
        let x = t / 0.004;
        let i = (x as usize).min(values.len() - 2);
        values[i] + (x - i as f64) * (values[i + 1] - values[i])
    };
    Rows {
        channels: [0, 1, 2].map(|k| time_s.iter().map(|t| at(&rows.channels[k], *t)).collect()),
        time_s,
    }
}

fn of_form(rows: &Rows, out: &mut Vec<Variant>) {
    let form = usual();
    out.push(csv("as it is", rows, &form));
    for shift in [1.0, 1e3, 1e5, -3.0] {
        let mut moved = rows.clone();
        moved.time_s.iter_mut().for_each(|t| *t += shift);
        out.push(csv(format!("shifted by {shift} s"), &moved, &form));
    }
    let units: [[(&str, f64); 4]; 5] = [
        [
            ("time_ms", 1e3),
            ("lv_pressure_mmHg", 1.0),
            ("aortic_pressure_mmHg", 1.0),
            ("ecg_mV", 1.0),
        ],
        [
            ("time_s", 1.0),
            ("lv_pressure_kPa", 1.0 / 7.500_616_8),
            ("aortic_pressure_kPa", 1.0 / 7.500_616_8),
            ("ecg_uV", 1e3),
        ],
        [
            ("Time (s)", 1.0),
            ("LVP (mmHg)", 1.0),
            ("AoP (mmHg)", 1.0),
            ("ECG II (mV)", 1.0),
        ],
        [
            ("Zeit [ms]", 1e3),
            ("LV pressure [hPa]", 10.0 / 7.500_616_8),
            ("Aorta [mbar]", 10.0 / 7.500_616_8),
            ("EKG [µV]", 1e3),
        ],
        [
            ("t, s", 1.0),
            ("PLV, mmHg", 1.0),
            ("Pao, mmHg", 1.0),
            ("Lead II, mV", 1.0),
        ],
    ];
    for columns in units.iter().take(4) {
        out.push(csv(
            format!("columns {}", columns[1].0),
            rows,
            &Form {
                columns: *columns,
                ..form.clone()
            },
        ));
    }
    let tabbed = Form {
        columns: units[4],
        separator: "\t",
        ..form.clone()
    };
    out.push(csv("columns PLV", rows, &tabbed));
    for order in [
        [0, 2, 1, 3],
        [3, 1, 2, 0],
        [1, 0, 3, 2],
        [2, 3, 0, 1],
        [3, 2, 1, 0],
    ] {
        out.push(csv(
            format!("order {order:?}"),
            rows,
            &Form {
                order: order.to_vec(),
                ..form.clone()
            },
        ));
    }
    let named = Form {
        columns: units[2],
        ..form.clone()
    };
    for (separator, comma) in [(";", false), (";", true), ("\t", false), ("\t", true)] {
        out.push(csv(
            format!("{separator:?}, comma {comma}"),
            rows,
            &Form {
                separator,
                comma,
                ..named.clone()
            },
        ));
    }
    for (before, end) in [
        ("", "\r\n"),
        ("# a lab\n", "\n"),
        ("# a lab\r\n# more\r\n", "\r\n"),
        ("sep=,\n", "\n"),
    ] {
        out.push(csv(
            format!("before {before:?}, end {end:?}"),
            rows,
            &Form {
                before,
                end,
                ..named.clone()
            },
        ));
    }
    let text = table(rows, &form);
    out.push(Variant::same(
        "a mark",
        "catheter.csv",
        [b"\xef\xbb\xbf".as_slice(), text.as_bytes()].concat(),
    ));
    let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    out.push(Variant::same(
        "UTF-16",
        "catheter.csv",
        [b"\xff\xfe".as_slice(), &wide].concat(),
    ));
    out.push(Variant::same(
        "lines at the end",
        "catheter.csv",
        format!("{text}\n\n").into_bytes(),
    ));
    for begin_s in [0.0, 43_195.0, 86_390.0, 50_000.0] {
        let stamp = |t: f64| {
            let s = begin_s + t;
            let (day, s) = ((s / 86_400.0) as usize, s % 86_400.0);
            let (hours, minutes) = ((s / 3600.0) as usize, (s / 60.0) as usize % 60);
            (
                day,
                format!("{hours:02}:{minutes:02}:{:06.3}", s % 60.0),
                hours,
            )
        };
        let mut dated = "Time,LVP (mmHg),AoP (mmHg),ECG (mV)\n".to_owned();
        let mut daily = "Interval=\t0.004 s\nExcelDateTime=\t4.5e+04\t1/1/2022\nTimeFormat=\tTimeOfDay\n\
                         ChannelTitle=\tLVP\tAoP\tECG\nRange=\t1 V\t1 V\t1 V\nUnitName=\tmmHg\tmmHg\tmV\n".to_owned();
        for i in 0..rows.time_s.len() {
            let (day, time, _) = stamp(rows.time_s[i]);
            let [p, a, e] = [0, 1, 2].map(|k| rows.channels[k][i]);
            let _ = writeln!(dated, "2026-02-{:02} {time},{p},{a},{e}", 28 - 1 + day);
            let _ = writeln!(daily, "{time}\t{p}\t{a}\t{e}");
        }
        out.push(Variant::same(
            format!("dates from {begin_s} s"),
            "catheter.csv",
            dated.into_bytes(),
        ));
        out.push(Variant::same(
            format!("time of day from {begin_s} s"),
            "catheter.txt",
            daily.into_bytes(),
        ));
    }
}

fn of_samples(rows: &Rows, out: &mut Vec<Variant>) {
    let form = usual();
    let without = Form {
        order: vec![0, 1, 2],
        ..form.clone()
    };
    for (of, form) in [("", &form), (", no ECG", &without)] {
        for at in [3.0, 5.2, 7.5, 9.1, 12.0] {
            for length in [0.05, 0.4, 3.0, 15.0, 60.0, 600.0, 3000.0] {
                out.push(csv(
                    format!("pause of {length} s at {at} s{of}"),
                    &paused(rows, at, length),
                    form,
                ));
            }
            for length in [0.02, 0.1, 0.5, 1.5] {
                let lost = dropped(rows, at, length, &[0, 1, 2]);
                out.push(csv(
                    format!("dropout of {length} s at {at} s{of}"),
                    &lost,
                    form,
                ));
            }
        }
        for step in [0.002, 0.005, 0.008, 0.01] {
            out.push(csv(
                format!("step {step} s{of}"),
                &resampled(rows, step),
                form,
            ));
        }
        let twice = Rows {
            time_s: (0..2 * rows.time_s.len())
                .map(|i| 0.004 * i as f64 + if i < rows.time_s.len() { 0.0 } else { 20.0 })
                .collect(),
            channels: [0, 1, 2]
                .map(|k| [rows.channels[k].clone(), rows.channels[k].clone()].concat()),
        };
        out.push(csv(format!("twice{of}"), &twice, form));
    }
    for at in [3.0, 7.5] {
        for (channels, of) in [
            ([0].as_slice(), "ventricle"),
            (&[1], "aorta"),
            (&[2], "ECG"),
        ] {
            let lost = dropped(rows, at, 0.8, channels);
            out.push(csv(format!("{of} lost at {at} s"), &lost, &form));
        }
    }
    let spiked = |ahead: usize| {
        let mut spiked = rows.clone();
        let ecg = &rows.channels[2];
        for i in 60..ecg.len() - 20 {
            let near = &ecg[i - 20..i + 20];
            if ecg[i] > 0.6 && near.iter().all(|v| *v <= ecg[i]) {
                spiked.channels[2][i - ahead] = 20.0;
            }
        }
        spiked
    };
    for ahead in [30, 40, 50] {
        out.push(csv(
            format!("spikes {} ms before R", 4 * ahead),
            &spiked(ahead),
            &form,
        ));
    }
    for factor in [-1.0, 0.1, 10.0] {
        out.push(csv(
            format!("ECG times {factor}"),
            &with_ecg(rows, |_, _, e| factor * e),
            &form,
        ));
    }
    out.push(csv(
        "ECG of 5 mV more",
        &with_ecg(rows, |_, _, e| e + 5.0),
        &form,
    ));
    out.push(csv(
        "ECG drifts",
        &with_ecg(rows, |_, t, e| e + 0.3 * t),
        &form,
    ));
    for hz in [50.0, 60.0] {
        for size in [0.02, 0.1, 0.3, 1.0] {
            let hum = with_ecg(rows, |_, t, e| {
                e + size * (std::f64::consts::TAU * hz * t).sin()
            });
            out.push(csv(format!("hum of {size} mV, {hz} Hz"), &hum, &form));
        }
    }
    out.push(csv("a flat ECG", &with_ecg(rows, |_, _, _| 0.3), &form));
}

/// Demands that variants give what the sound recording gives, but for rounding.
fn exact(variants: &mut [Variant]) {
    for variant in variants {
        if matches!(variant.expected, Expected::Same) {
            variant.expected = Expected::Exact;
        }
    }
}

/// What is wrong with the result of a variant; `None` if nothing is.
fn fault(variant: &Variant, base: &Derived) -> Option<String> {
    let has_all = |why: &str, parts: &[&str]| parts.iter().all(|part| why.contains(part));
    let found = match (derived(&variant.files), variant.expected) {
        (Err(why), Expected::Said(parts) | Expected::SameOrSaid(parts)) if has_all(&why, parts) => {
            return None;
        }
        (Err(why), _) => return Some(format!("refused: {why}")),
        (Ok((found, _)), Expected::Said(_)) => return Some(format!("read: {found:.3?}")),
        (Ok((_, warnings)), Expected::SameOrWarned(parts)) if has_all(&warnings, parts) => {
            return None;
        }
        (Ok((found, _)), _) => found,
    };
    // In ms, mmHg, mmHg, and shares of R2 and C.
    let bounds = match variant.expected {
        Expected::Exact => [0.5, 0.15, 0.15, 0.005, 0.01],
        _ => [10.0, 2.0, 1.5, 0.03, 0.12],
    };
    let differences = [
        found.cycle_ms - base.cycle_ms,
        found.peak - base.peak,
        found.end_diastolic - base.end_diastolic,
        found.r2 / base.r2 - 1.0,
        found.c / base.c - 1.0,
    ];
    let off = std::iter::zip(differences, bounds).map(|(difference, bound)| {
        // A value that is missing is off too.
        difference.is_nan() || difference.abs() > bound
    });
    off.into_iter()
        .any(|off| off)
        .then(|| format!("{found:.3?}"))
}

#[test]
fn what_changes_nothing_about_the_heart_changes_nothing_that_is_derived() {
    let rows = sound();
    let mut variants = Vec::new();
    of_form(&rows, &mut variants);
    exact(&mut variants);
    of_samples(&rows, &mut variants);
    let (base, _) = derived(&variants[0].files).unwrap();
    assert!(
        (base.cycle_ms - 953.0).abs() < 5.0 && (base.end_diastolic - 8.3).abs() < 0.3,
        "{base:?}"
    );
    variants.extend(further::variants(&rows));
    variants.extend(laboratories::variants(&rows));
    variants.extend(exports::variants(&rows));
    let mut faults: Vec<String> = variants
        .iter()
        .filter_map(|variant| Some(format!("{}: {}", variant.what, fault(variant, &base)?)))
        .collect();
    let (n_meshes, of_meshes) = meshes::faults();
    faults.extend(of_meshes);
    let n = variants.len() + n_meshes;
    let n_right = n - faults.len();
    println!(
        "{n} variants, {n_right} right ({:.1} %)\nwrong:\n{}",
        100.0 * n_right as f64 / n as f64,
        faults.join("\n")
    );
    assert!(n > 330);
    assert!(
        100 * faults.len() <= n,
        "{} of {n}:\n{}",
        faults.len(),
        faults.join("\n")
    );
}
