//! Kinds of inputs that public bug reports on other programs describe: each is read rightly, or it is
//! said what is wrong with it. The inputs are `tests/fixtures/public-reports`; every signal of them is
//! the same 15 s of `examples/recordings/P001-raw`.

use std::path::{Path, PathBuf};

use cardiotwin_input::preparation::{Made, make};
use cardiotwin_input::{Report, read_raw};
use cardiotwin_mesh::files::LengthUnit;
use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres, Intake};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/fixtures/public-reports")
        .join(name)
}

/// What `cardiotwin prepare` says and makes of a folder.
struct Seen {
    said: String,
    errors: usize,
    made: Option<Made>,
}

fn prepare_folder(folder: &Path) -> Seen {
    let mut report = Report::default();
    let raw = read_raw(folder, &mut report);
    let mut errors = 0;
    let mut said: Vec<String> = report
        .findings()
        .iter()
        .map(|found| found.problem.to_string())
        .collect();
    let made = raw.and_then(|raw| match make(&raw, "P001") {
        Ok(made) => {
            errors += made
                .problems
                .iter()
                .filter(|problem| problem.is_error())
                .count();
            said.extend(made.problems.iter().map(ToString::to_string));
            (errors == 0).then_some(made)
        }
        Err(error) => {
            said.push(error.to_string());
            None
        }
    });
    if let Some(made) = &made {
        said.extend(made.answer.warnings.iter().cloned());
        said.extend(
            made.answer
                .files
                .iter()
                .flat_map(|file| file.read_as.clone()),
        );
    }
    Seen {
        said: said.join("\n"),
        errors: errors + report.n_errors(),
        made,
    }
}

fn prepare(name: &str) -> Seen {
    prepare_folder(&fixture(name))
}

impl Seen {
    fn made(&self) -> &Made {
        self.made
            .as_ref()
            .unwrap_or_else(|| panic!("{}", self.said))
    }

    fn step(&self, step: &str, number: &str) -> f64 {
        let steps = &self.made().answer.steps;
        let found = steps.iter().find(|one| one.step == step).unwrap();
        found.numbers.get(number).copied().unwrap_or(f64::NAN)
    }

    fn peak(&self) -> f64 {
        let lv = self.made().prepared.average.lv_pressure.as_ref().unwrap();
        lv.mean.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    fn end_diastolic(&self) -> f64 {
        self.made()
            .prepared
            .average
            .lv_pressure
            .as_ref()
            .unwrap()
            .mean[0]
    }

    /// The sound result of these 15 s, as computed once from the sound recording.
    fn is_sound(&self, what: &str) {
        let made = self.made();
        let (found, kept) = (made.answer.beats.found, made.answer.beats.kept);
        assert!(
            (13..=16).contains(&found) && kept >= 8,
            "{what}: {found}, {kept}\n{}",
            self.said
        );
        let cycle = made.prepared.average.cycle_length_ms;
        assert!(
            (cycle - 953.0).abs() < 5.0,
            "{what}: cycle {cycle} ms\n{}",
            self.said
        );
        assert!(
            (self.peak() - 116.6).abs() < 1.0,
            "{what}: {} mmHg\n{}",
            self.peak(),
            self.said
        );
        let r2 = self.step("afterload", "peripheral_resistance_mmHg_s_per_mL");
        assert!((r2 - 0.743).abs() < 0.01, "{what}: R2 {r2}\n{}", self.said);
        let c = self.step("afterload", "compliance_mL_per_mmHg");
        assert!((c - 1.715).abs() < 0.06, "{what}: C {c}\n{}", self.said);
    }

    /// The same of a file that has only some nine of the fifteen seconds.
    fn is_sound_but_short(&self, what: &str) {
        let made = self.made();
        let found = made.answer.beats.found;
        assert!((8..=12).contains(&found), "{what}: {found}\n{}", self.said);
        let cycle = made.prepared.average.cycle_length_ms;
        assert!(
            (cycle - 953.0).abs() < 10.0,
            "{what}: cycle {cycle} ms\n{}",
            self.said
        );
        assert!(
            (self.peak() - 116.6).abs() < 1.5,
            "{what}: {} mmHg\n{}",
            self.peak(),
            self.said
        );
        let r2 = self.step("afterload", "peripheral_resistance_mmHg_s_per_mL");
        assert!((r2 - 0.743).abs() < 0.03, "{what}: R2 {r2}\n{}", self.said);
    }

    fn by_r_wave(&self, what: &str) {
        self.is_sound(what);
        assert_eq!(self.made().answer.beats.source, "R wave", "{what}");
        assert!(
            (self.end_diastolic() - 8.3).abs() < 0.3,
            "{what}: {} mmHg",
            self.end_diastolic()
        );
    }

    /// Beats from the foot of the pressure's rise, which comes some 20 ms after the R wave.
    fn by_rise(&self, what: &str) {
        self.is_sound(what);
        assert!(
            self.made().answer.beats.source.starts_with("rise"),
            "{what}"
        );
        assert!(
            (self.end_diastolic() - 8.3).abs() < 1.5,
            "{what}: {} mmHg",
            self.end_diastolic()
        );
    }

    fn refused(&self, what: &str, parts: &[&str]) {
        assert!(
            self.errors > 0 && self.made.is_none(),
            "{what}\n{}",
            self.said
        );
        self.says(what, parts);
    }

    fn says(&self, what: &str, parts: &[&str]) {
        for part in parts {
            assert!(
                self.said.contains(part),
                "{what}: no {part:?} in\n{}",
                self.said
            );
        }
    }
}

#[test]
fn kind_00_the_sound_recording_in_three_formats() {
    for name in ["00-sound/edf", "00-sound/labchart", "00-sound/wfdb"] {
        let seen = prepare(name);
        seen.by_r_wave(name);
        assert!(!seen.said.contains("warning"), "{name}\n{}", seen.said);
    }
}

#[test]
fn kinds_01_and_02_pressures_that_contradict_each_other_or_are_cut() {
    let seen = prepare("01-lv-pressure-clipped/at-100");
    seen.refused(
        "at 100",
        &["stays at its largest value", "below the aorta's"],
    );
    let seen = prepare("01-lv-pressure-clipped/no-aorta");
    seen.made();
    seen.says("no aorta", &["warning", "stays at its largest value"]);
    let seen = prepare("02-pressures-contradict/ventricle-halved");
    seen.refused("halved", &["largest ventricular pressure of", "wrong unit"]);
    let mut report = Report::default();
    cardiotwin_input::load(
        &fixture("02-pressures-contradict/patient-files"),
        &cardiotwin_input::Options::default(),
        &mut report,
    );
    for patient in ["halved", "a190"] {
        let told = report.findings().iter().any(|finding| {
            finding.patient.as_deref() == Some(patient)
                && finding.problem.is_error()
                && finding
                    .problem
                    .found
                    .contains("largest ventricular pressure")
        });
        assert!(told, "{patient}: {:#?}", report.findings());
    }
}

#[test]
fn kind_03_a_pause_changes_neither_cycle_nor_windkessel() {
    prepare("03-pause-between-blocks/pause-15-s").by_r_wave("15 s");
    prepare("03-pause-between-blocks/pause-60-s").by_r_wave("60 s");
    prepare("03-pause-between-blocks/pause-60-s-no-ecg").by_rise("60 s without");
}

#[test]
fn kind_03_a_pause_of_a_day_is_read_and_told_with_the_times_of_the_file() {
    const DAY_S: f64 = 86_400.0;
    let whole = fixture("03-pause-between-blocks/pause-15-s");
    let folder = tempfile::tempdir().unwrap();
    for name in ["cine.csv", "prepare.toml"] {
        std::fs::copy(whole.join(name), folder.path().join(name)).unwrap();
    }
    let text = std::fs::read_to_string(whole.join("catheter.csv")).unwrap();
    let mut out = String::new();
    for (i, line) in text.lines().enumerate() {
        let moved = line.split_once(',').filter(|_| i > 0).map(|(time, rest)| {
            let time: f64 = time.parse().unwrap();
            // The pause of 15 s is one of a day and 15 s.
            let time = if time > 16.0 { time + DAY_S } else { time };
            format!("{time:.3},{rest}")
        });
        out += &moved.unwrap_or_else(|| line.to_owned());
        out.push('\n');
    }
    std::fs::write(folder.path().join("catheter.csv"), out).unwrap();
    let seen = prepare_folder(folder.path());
    seen.by_r_wave("a day");
    seen.says("a day", &["the recording pauses for 1440.", "leave_out_ms"]);
    let short = prepare("03-pause-between-blocks/pause-15-s");
    let onsets = |seen: &Seen| -> Vec<f64> {
        let left_out = &seen.made().answer.beats.left_out;
        left_out.iter().map(|beat| beat.onset_ms).collect()
    };
    let (short, long) = (onsets(&short), onsets(&seen));
    assert_eq!(short.len(), long.len());
    for (short, long) in short.iter().zip(long) {
        let expected = short + if *short > 16_000.0 { 1e3 * DAY_S } else { 0.0 };
        assert!((long - expected).abs() < 1.0, "{long} for {expected} ms");
    }
}

#[test]
fn kind_04_a_dropout_hides_no_premature_beat() {
    let seen = prepare("04-dropout-hides-ectopic/gap-0.4-s");
    seen.by_r_wave("gap");
    let kinds: Vec<(&str, f64)> = seen
        .made()
        .answer
        .beats
        .left_out
        .iter()
        .map(|beat| (beat.kind.as_str(), beat.onset_ms))
        .collect();
    for kind in ["cut-short", "ectopic", "after-ectopic"] {
        let near = kinds
            .iter()
            .any(|(k, at)| *k == kind && (7_000.0..11_000.0).contains(at));
        assert!(near, "{kind}: {kinds:?}");
    }
}

#[test]
fn kind_05_an_empty_channel_shifts_no_column() {
    // The electrocardiogram is empty at first, or the aorta's pressure everywhere, which is said and left
    // out.
    let at_begin = prepare("05-labchart-empty-last-channel/at-begin-only");
    assert!((at_begin.peak() - 116.6).abs() < 1.0, "{}", at_begin.said);
    let seen = prepare("05-labchart-empty-last-channel/two-channels");
    seen.says(
        "two channels",
        &[
            "warning",
            "AoP (mmHg)",
            "without a single sample",
            "left out",
        ],
    );
    assert!((seen.peak() - 116.6).abs() < 1.0, "{}", seen.said);
    // Where it is the ventricle's, nothing is left to prepare.
    let text = std::fs::read_to_string(
        fixture("05-labchart-empty-last-channel/two-channels").join("catheter.txt"),
    )
    .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let copy = |name: &str| {
        let from = fixture("05-labchart-empty-last-channel/two-channels").join(name);
        std::fs::copy(from, folder.path().join(name)).unwrap();
    };
    copy("cine.csv");
    copy("prepare.toml");
    let swapped = text.replace("ChannelTitle=\tLVP\tAoP", "ChannelTitle=\tAoP\tLVP");
    assert_ne!(swapped, text);
    std::fs::write(folder.path().join("catheter.txt"), swapped).unwrap();
    prepare_folder(folder.path()).refused(
        "an empty ventricle",
        &[
            "LVP (mmHg)",
            "without a single sample",
            "export the channel",
        ],
    );
}

/// A copy of a fixture with one file changed.
fn changed(name: &str, file: &str, change: impl Fn(&str) -> String) -> Seen {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(fixture(name)).unwrap() {
        let path = entry.unwrap().path();
        let to = folder.path().join(path.file_name().unwrap());
        if path.ends_with(file) {
            let text = std::fs::read_to_string(&path).unwrap();
            let other = change(&text);
            assert_ne!(other, text, "{file}");
            std::fs::write(to, other).unwrap();
        } else {
            std::fs::copy(&path, to).unwrap();
        }
    }
    prepare_folder(folder.path())
}

#[test]
fn kind_05_a_channel_that_was_not_connected_is_left_out() {
    let flat = |text: &str| -> String {
        let of_line = |(i, line): (usize, &str)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if i > 0 {
                cells[2] = "0.0";
            }
            cells.join(",") + "\n"
        };
        text.lines().enumerate().map(of_line).collect()
    };
    let seen = changed("03-pause-between-blocks/pause-15-s", "catheter.csv", flat);
    let parts = [
        "warning",
        "`aortic_pressure_mmHg` with the value 0 alone",
        "left out",
    ];
    seen.says("flat aorta", &parts);
    assert!((seen.peak() - 116.6).abs() < 1.0, "{}", seen.said);
    assert!(seen.made().prepared.average.aortic_pressure.is_none());
}

#[test]
fn kind_06_an_electrocardiogram_without_samples_gives_way_to_the_pressure() {
    let seen = prepare("06-ecg-without-samples/empty");
    seen.by_rise("empty");
    seen.says("empty", &["electrocardiogram has no samples"]);
    let seen = prepare("06-ecg-without-samples/half");
    seen.says(
        "half",
        &["8 s of the recording are without an electrocardiogram"],
    );
    let cycle = seen.made().prepared.average.cycle_length_ms;
    assert!((cycle - 953.0).abs() < 10.0, "{cycle}");
}

#[test]
fn kind_07_times_of_records_count() {
    prepare("07-edf-gaps-in-continuous/one-gap").says("one gap", &["continuous", "1 gap of"]);
    prepare("07-edf-gaps-in-continuous/one-gap").is_sound_but_short("one gap");
    // Its only whole beat is cut short by a premature one: no beat tells the cycle.
    let seen = prepare("07-edf-gaps-in-continuous/gaps-everywhere");
    seen.says("everywhere", &["gaps of"]);
    assert!(seen.made.is_none(), "{}", seen.said);
    seen.says("everywhere", &["none of the", "usable", "cut-short"]);
}

#[test]
fn kind_08_ranges_and_counts_of_edf() {
    prepare("08-edf-ranges-and-counts/unused-channel-without-range").by_r_wave("unused");
    let seen = prepare("08-edf-ranges-and-counts/header-says-6-of-15");
    seen.by_r_wave("6 of 15");
    seen.says("6 of 15", &["but the header states"]);
    let seen = prepare("08-edf-ranges-and-counts/pressure-without-range");
    seen.refused("no range", &["LVP", "physical"]);
    let seen = prepare("08-edf-ranges-and-counts/unknown-labels");
    seen.refused("labels", &["the signals `"]);
    assert!(!seen.said.contains("15 samples"), "{}", seen.said);
}

#[test]
fn kinds_09_and_10_calibration_and_checksums_of_wfdb() {
    prepare("09-wfdb-uncalibrated/gain-0")
        .refused("gain 0", &["`LVP (gain 0: not calibrated)`", "a pressure"]);
    prepare("10-wfdb-checksum/one-sample-lost")
        .refused("checksum", &["checksum", "as the header states"]);
}

#[test]
fn kind_11_thousands_are_not_decimals() {
    let seen = prepare("11-excel-thousands/volume-in-microlitres");
    seen.refused("volume", &["which may be"]);
    let seen = prepare("11-excel-thousands/times");
    if seen.made.is_some() {
        seen.by_r_wave("times");
    } else {
        seen.refused("times", &["which may be"]);
        assert!(!seen.said.contains("sort the samples"), "{}", seen.said);
    }
}

#[test]
fn kind_12_times_of_day_are_read() {
    prepare("12-excel-time-cells/csv-date-time").by_rise("csv");
    prepare("12-excel-time-cells/hh-mm-ss").is_sound_but_short("cells");
}

#[test]
fn kind_13_hidden_sheets_are_not_read() {
    let seen = prepare("13-excel-hidden-sheet/hidden-first");
    seen.is_sound_but_short("hidden");
    seen.says(
        "hidden",
        &["sheet `calibrated`", "hidden sheets that are not read"],
    );
}

#[test]
fn kinds_14_and_15_clocks_of_labchart_and_acqknowledge() {
    for name in ["midnight", "rounded-times", "unit-in-title-only"] {
        prepare(&format!("14-labchart-clock/{name}")).by_r_wave(name);
    }
    prepare("15-acqknowledge/in-milliseconds").by_r_wave("acqknowledge");
}

#[test]
fn kinds_14_and_15_an_interval_that_contradicts_the_times_is_told() {
    let seen = changed(
        "14-labchart-clock/unit-in-title-only",
        "catheter.txt",
        |text| text.replace("Interval=\t0.004 s", "Interval=\t0.002 s"),
    );
    seen.by_r_wave("labchart");
    let parts = [
        "warning",
        "times 4.0000 ms apart",
        "an interval of 2.0000 ms",
    ];
    seen.says("labchart", &parts);
    let seen = changed("15-acqknowledge/in-milliseconds", "catheter.txt", |text| {
        text.replace("4 msec/sample", "5 msec/sample")
    });
    seen.by_r_wave("acqknowledge");
    seen.says("acqknowledge", &["an interval of 5.0000 ms"]);
}

#[test]
fn kind_23_frames_without_a_contour_are_left_out() {
    for name in ["empty-cell", "segment-nan"] {
        let seen = prepare(&format!("23-cine-unsegmented-frames/{name}"));
        seen.says(name, &["frames without a volume"]);
        let stroke = seen.step("volume", "stroke_volume_mL");
        assert!((90.0..115.0).contains(&stroke), "{name}: {stroke} mL");
    }
}

/// Human ventricles rise by 0.8 to 2 mmHg/ms, and amplifiers filter them further.
#[test]
fn kind_25_slow_rises_begin_at_their_foot() {
    for half in [2_usize, 4, 6, 8, 10] {
        let seen = changed(
            "03-pause-between-blocks/pause-60-s-no-ecg",
            "catheter.csv",
            |text| {
                let lines: Vec<&str> = text.lines().collect();
                let rows: Vec<Vec<f64>> = lines[1..]
                    .iter()
                    .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
                    .collect();
                // Twice the mean of neighbours on the same side of the pause.
                let smooth = |values: Vec<f64>| -> Vec<f64> {
                    let mean = |i: usize| {
                        let near = i.saturating_sub(half)..(i + half + 1).min(rows.len());
                        let side = near.filter(|k| (rows[*k][0] - rows[i][0]).abs() < 1.0);
                        let values: Vec<f64> = side.map(|k| values[k]).collect();
                        values.iter().sum::<f64>() / values.len() as f64
                    };
                    (0..values.len()).map(mean).collect()
                };
                let of = |k: usize| smooth(smooth(rows.iter().map(|row| row[k]).collect()));
                let (ventricle, aorta) = (of(1), of(2));
                let slope = ventricle.windows(2).map(|w| (w[1] - w[0]) / 4.0);
                let steepest = slope.fold(0.0, f64::max);
                assert!((0.8..2.0).contains(&steepest), "{half}: {steepest} mmHg/ms");
                let row = |i: usize| format!("{},{},{}\n", rows[i][0], ventricle[i], aorta[i]);
                format!("{}\n", lines[0]) + &(0..rows.len()).map(row).collect::<String>()
            },
        );
        let found = seen.end_diastolic();
        assert!(
            (found - 8.3).abs() < 1.5,
            "{half}: {found} mmHg\n{}",
            seen.said
        );
        let cycle = seen.made().prepared.average.cycle_length_ms;
        assert!((cycle - 957.0).abs() < 5.0, "{half}: {cycle} ms");
    }
}

#[test]
fn kind_25_hum_and_pacing_spikes_are_no_r_waves() {
    let seen = prepare("25-ecg-hum-and-pacing/atrial-pacing-20-mV");
    seen.by_r_wave("pacing");
    seen.says("pacing", &["pacing spikes were removed"]);
    let seen = prepare("25-ecg-hum-and-pacing/mains-0.2-mV");
    seen.is_sound("mains");
    assert!((seen.end_diastolic() - 8.3).abs() < 1.5, "{}", seen.said);
    seen.says("mains", &["the hum of mains was removed"]);
    assert!(!seen.said.contains("spikes"), "{}", seen.said);
}

/// What `cardiotwin mesh check FILE --unit mm --left-ventricle 1 --fibres FIBRES` asks.
fn for_muscle(fibres: Fibres) -> Asked<'static> {
    Asked {
        unit: LengthUnit::Millimetre,
        left_ventricle: &[1],
        fibres,
        cavity: None,
        wall: None,
        activation: Activation::Unasked,
        right_ventricle: None,
        sprung: &[],
    }
}

/// What `cardiotwin mesh check FILE --unit UNIT --left-ventricle 1` says of a mesh of the fixtures.
fn mesh(name: &str, unit: LengthUnit) -> Result<Intake, String> {
    let asked = Asked {
        unit,
        ..for_muscle(Fibres::Auto)
    };
    intake::read(&fixture(name), &asked).map_err(|error| error.to_string())
}

fn has(intake: &Intake, name: &str) -> bool {
    intake.defects.iter().any(|defect| defect.name() == name)
}

#[test]
fn kind_16_fibres_of_one_direction_are_a_placeholder() {
    let found = mesh(
        "16-carp-placeholder-fibres/default-fibres-1/heart",
        LengthUnit::Micrometre,
    );
    let found = found.unwrap();
    assert!(
        has(&found, "fibres-of-one-direction"),
        "{:#?}",
        found.defects
    );
    // Turned by a degree here and there, with both signs, they are still one direction.
    let mut turned = found.mesh.clone();
    for (e, frame) in turned.frames.iter_mut().enumerate() {
        let sign = if e % 2 == 0 { 1.0 } else { -1.0 };
        frame.fibre = [sign * 0.999_85, sign * 0.017_45, 0.0];
    }
    let asked = for_muscle(Fibres::Mesh);
    assert!(has(
        &intake::look(turned.clone(), &asked),
        "fibres-of-one-direction"
    ));
    // A part with other fibres leaves the rest a placeholder; where most differ, it is none.
    for (others, is_told) in [(1, true), (400, true), (1000, false)] {
        for (e, frame) in turned.frames.iter_mut().enumerate().take(others) {
            let (sine, cosine) = (0.7 * e as f64).sin_cos();
            frame.fibre = [0.0, cosine, sine];
        }
        let found = intake::look(turned.clone(), &asked);
        assert_eq!(has(&found, "fibres-of-one-direction"), is_told, "{others}");
    }
    // Directions that change from element to element are those of another order of elements.
    for (e, frame) in turned.frames.iter_mut().enumerate() {
        let (sine, cosine) = (0.7 * e as f64 * e as f64).sin_cos();
        frame.fibre = [0.0, cosine, sine];
    }
    let found = intake::look(turned, &asked);
    assert!(has(&found, "fibres-without-order"), "{:#?}", found.defects);
}

#[test]
fn kind_17_arrays_of_other_programs_are_read_or_named() {
    for name in ["FIB_DIR", "fiber"] {
        let found = mesh(
            &format!("17-vtu-foreign-arrays/{name}/heart.vtu"),
            LengthUnit::Millimetre,
        )
        .unwrap();
        assert_eq!(found.mesh.frames.len(), found.mesh.n_tets(), "{name}");
    }
    // Directions under a name that no reader knows: the rule makes the fibres, and a warning names the array.
    let known = std::fs::read_to_string(fixture("17-vtu-foreign-arrays/fiber/heart.vtu")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let renamed = folder.path().join("heart.vtu");
    std::fs::write(&renamed, known.replace("\"fiber\"", "\"muscle axes\"")).unwrap();
    let found = intake::read(&renamed, &for_muscle(Fibres::Auto)).unwrap();
    let told: Vec<String> = found.defects.iter().map(ToString::to_string).collect();
    assert!(
        found.mesh.frames.is_empty() && found.is_sound(),
        "{told:#?}"
    );
    assert!(
        told.iter().any(|told| told.contains("`muscle axes`")),
        "{told:#?}"
    );
    let asked_for_the_rule = intake::read(&renamed, &for_muscle(Fibres::Rule)).unwrap();
    assert!(!has(&asked_for_the_rule, "unread-directions"));
    let told = mesh(
        "17-vtu-foreign-arrays/elemTag/heart.vtu",
        LengthUnit::Millimetre,
    )
    .unwrap_err();
    assert!(
        told.contains("elemTag") && told.contains("an array called tag"),
        "{told}"
    );
    // An array that nothing reads may have any values.
    let found = mesh(
        "17-vtu-foreign-arrays/nan-lat/heart.vtu",
        LengthUnit::Millimetre,
    )
    .unwrap();
    assert!(found.mesh.tags.contains(&1));
    // A tag is a whole number, and what is read must be finite.
    let tagged = |tag: &str, fibre: &str| {
        format!(
            "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">\
             <Points><DataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>\
             <Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray>\
             <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4</DataArray>\
             <DataArray type=\"Int64\" Name=\"types\" format=\"ascii\">10</DataArray></Cells>\
             <CellData><DataArray type=\"Float64\" Name=\"tag\" format=\"ascii\">{tag}</DataArray>\
             <DataArray type=\"Float64\" Name=\"f0\" NumberOfComponents=\"3\" format=\"ascii\">{fibre}</DataArray></CellData>\
             </Piece></UnstructuredGrid></VTKFile>"
        )
    };
    let parse = |tag: &str, fibre: &str| {
        let text = tagged(tag, fibre);
        cardiotwin_mesh::files::vtu::parse(
            text.as_bytes(),
            Path::new("heart.vtu"),
            LengthUnit::Millimetre,
        )
    };
    assert_eq!(
        parse("2", "0 0 1").unwrap().mesh.frames[0].fibre,
        [0.0, 0.0, 1.0]
    );
    let told = parse("1.5", "0 0 1").unwrap_err().to_string();
    assert!(
        told.contains("tag with 1.5") && told.contains("whole numbers"),
        "{told}"
    );
    let told = parse("1", "0 nan 1").unwrap_err().to_string();
    assert!(told.contains("f0 with NaN"), "{told}");
}

#[test]
fn kind_18_physical_groups_of_gmsh() {
    for name in ["scar-in-both", "scar-in-both-22"] {
        let told = mesh(
            &format!("18-gmsh-physical-groups/{name}/heart.msh"),
            LengthUnit::Millimetre,
        )
        .unwrap_err();
        assert!(
            told.contains("\"wall\" (1)")
                && told.contains("\"scar\" (2)")
                && told.contains("one physical group"),
            "{name}: {told}"
        );
    }
    let negative = mesh(
        "18-gmsh-physical-groups/negative-endo/heart.msh",
        LengthUnit::Millimetre,
    )
    .unwrap();
    let endocardium = negative
        .mesh
        .surface("endocardium")
        .expect("the group of a turned surface");
    assert!(endocardium.triangles.len() > 100 && !negative.surfaces_found);
    // A surface in two groups has both names: the text of the same file with one surface in both.
    let text = std::fs::read_to_string(fixture("18-gmsh-physical-groups/negative-endo/heart.msh"))
        .unwrap();
    let both = text.replace(" 1 -11 4 ", " 2 -11 14 4 ");
    assert_ne!(both, text);
    let both =
        cardiotwin_mesh::files::gmsh::parse(&both, Path::new("heart.msh"), LengthUnit::Millimetre)
            .unwrap();
    let other = both.surface("surface-14").expect("the second group");
    assert_eq!(other.triangles, endocardium.triangles);
    // The groups of a partitioned file stand with its parts.
    let begin = text.find("$Entities").unwrap();
    let end = text.find("$EndEntities").unwrap();
    let entities = &text[begin..end];
    let mut parts = Vec::new();
    for (i, line) in entities.lines().skip(2).enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let dimension = match i {
            0..4 => 0,
            4..10 => 1,
            10..13 => 2,
            _ => 3,
        };
        parts.push(format!(
            "{} {dimension} {} 1 1 {}",
            words[0],
            words[0],
            words[1..].join(" ")
        ));
    }
    let partitioned = format!(
        "{}$Entities\n0 0 0 0\n$EndEntities\n$PartitionedEntities\n1\n0\n4 6 3 1\n{}\n$EndPartitionedEntities{}",
        &text[..begin],
        parts.join("\n"),
        &text[end + "$EndEntities".len()..]
    );
    let whole = cardiotwin_mesh::files::gmsh::parse(
        &partitioned,
        Path::new("heart.msh"),
        LengthUnit::Millimetre,
    )
    .unwrap();
    assert_eq!(whole.tags, negative.mesh.tags);
    assert!(whole.surface("endocardium").is_some());
}
