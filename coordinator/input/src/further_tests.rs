//! Tests of measurements besides pressure and volume: their numbers, their files, and what a search
//! gets of them.

use std::fmt::Write as _;
use std::path::Path;

use super::tests::{COHORT, Folder, PATIENT, only};
use super::{Options, Report, specification};

/// A trace of 700 ms every 10 ms.
fn write(folder: &Path, name: &str, column: &str, value: impl Fn(f64) -> f64) {
    let mut text = format!("time_ms,{column}\n");
    for i in 0..70 {
        let t = 10.0 * f64::from(i);
        let _ = writeln!(text, "{t},{:.3}", value(t));
    }
    std::fs::write(folder.join("patients/P1").join(name), text).unwrap();
}

const TABLES: &str = "\n[measured.traces]\naortic_pressure = { file = \"aorta.csv\", rms_mmHg = 1.5, correlation_ms = 12 }\n\
    mitral_flow = { file = \"mitral.csv\" }\natrial_pressure = { file = \"wedge.csv\", delay_ms = 125, delay_sd_ms = 15 }\n\
    strain = { file = \"strain.csv\" }\n\n[measured.valve_times]\naortic_opening_ms = 90\naortic_closure_ms = 320\n\n\
    [measured.qrs]\nduration_ms = 140\nsd_ms = 4\n\n[[measured.loaded]]\npressure = \"pressure.csv\"\nvolume = \"volume.csv\"\n";

/// A patient with further measurements, and its folder.
fn folder(tables: &str) -> Folder {
    let folder = Folder::new(COHORT, &[("P1", &format!("{PATIENT}{tables}"))]);
    let hump = |t: f64| (std::f64::consts::PI * t / 700.0).sin();
    write(folder.path(), "aorta.csv", "pressure_mmHg", |t| {
        80.0 + 40.0 * hump(t)
    });
    write(folder.path(), "mitral.csv", "flow_mL_per_s", |t| {
        400.0 * hump(t)
    });
    write(folder.path(), "wedge.csv", "pressure_mmHg", |t| {
        8.0 + 4.0 * hump(t)
    });
    write(folder.path(), "strain.csv", "strain_percent", |t| {
        -18.0 * hump(t)
    });
    folder
}

/// What `check` says, without words on coarse traces.
fn said(folder: &Folder) -> Vec<String> {
    let (_, mut said) = folder.load(&Options::default());
    said.retain(|line| !line.contains("or more in a cycle"));
    said
}

#[test]
fn a_search_gets_every_file_with_its_noise() {
    let folder = folder(TABLES);
    assert_eq!(said(&folder), Vec::<String>::new());
    let (cohort, _) = folder.load(&Options::default());
    let cohort = cohort.unwrap();
    let mut report = Report::default();
    let spec = specification(&cohort.patients[0], &[], 1, &mut report).unwrap();
    assert_eq!(report.n_errors(), 0);
    let names: Vec<&str> = spec.files().iter().map(|file| file.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "pressure",
            "volume",
            "aortic_pressure",
            "mitral_flow",
            "atrial_pressure",
            "strain",
            "loaded_1_pressure",
            "loaded_1_volume"
        ]
    );
    assert_eq!(
        (spec.traces[0].rms, spec.traces[0].correlation_ms),
        (Some(1.5), Some(12.0))
    );
    assert_eq!(
        (spec.traces[2].delay_ms, spec.traces[2].delay_sd_ms),
        (Some(125.0), Some(15.0))
    );
    assert_eq!(spec.loaded[0].cycle_length_ms, 700.0);
    assert_eq!(spec.qrs.map(|qrs| qrs.duration_ms), Some(140.0));
    let times = spec.valve_times.unwrap();
    assert_eq!(
        (times.aortic_closure_ms, times.mitral_opening_ms),
        (Some(320.0), None)
    );
}

#[test]
fn what_is_wrong_is_named_with_its_key_and_line() {
    let with = |from: &str, to: &str| said(&folder(&TABLES.replace(from, to)));
    only(
        &with("aorta.csv", "lost.csv"),
        &[
            "measured.traces.aortic_pressure.file",
            "lost.csv",
            "patient.toml:",
        ],
    );
    only(
        &with("rms_mmHg = 1.5", "rms_mmHg = 150"),
        &[
            "measured.traces.aortic_pressure.rms_mmHg",
            "found 150 mmHg",
            "0 to 50 mmHg",
        ],
    );
    only(
        &with("delay_ms = 125", "delay_ms = 1250"),
        &["measured.traces.atrial_pressure.delay_ms", "0 to 400 ms"],
    );
    only(
        &with("aortic_closure_ms = 320", "aortic_closure_ms = 30"),
        &["measured.valve_times.aortic_closure_ms", "opening at 90 ms"],
    );
    only(
        &with("aortic_opening_ms = 90", "aortic_opening_ms = -50"),
        &["measured.valve_times.aortic_opening_ms", "0 to 700 ms"],
    );
    only(
        &with("duration_ms = 140", "duration_ms = 0.14"),
        &["measured.qrs.duration_ms", "looks like seconds"],
    );
    only(
        &with("strain = {", "strian = {"),
        &["strian", "did you mean `strain`?"],
    );
    only(
        &with("file = \"mitral.csv\"", "file = \"aorta.csv\""),
        &["aorta.csv", "flow_mL_per_s"],
    );
    // The strain's file holds fractions.
    let fractions = folder(TABLES);
    write(fractions.path(), "strain.csv", "strain_percent", |t| {
        -0.18 * (std::f64::consts::PI * t / 700.0).sin()
    });
    only(&said(&fractions), &["strain.csv", "fraction"]);
}
