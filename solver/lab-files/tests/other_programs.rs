//! Files that other programs' own libraries wrote (tests/data/make.py) hold the same samples as the
//! table from which they were made.

use std::path::{Path, PathBuf};

use cardiotwin_lab_files::{Request, Table, TableReading, Wanted, read};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

fn wanted(quantity: &'static str, names: &[(&str, f64)], required: bool) -> Wanted {
    Wanted {
        names: names
            .iter()
            .map(|(name, factor)| ((*name).to_owned(), *factor))
            .collect(),
        required,
        may_lack: !required,
        ..Wanted::new(quantity)
    }
}

fn of_catheter() -> Vec<Wanted> {
    vec![
        wanted("time", &[("time_ms", 1.0), ("time_s", 1e3)], true),
        wanted("lv_pressure", &[("lv_pressure_mmHg", 1.0)], false),
        wanted("ecg", &[("ecg_mV", 1.0)], false),
    ]
}

fn of_cine() -> Vec<Wanted> {
    vec![
        wanted("time", &[("time_ms", 1.0)], true),
        wanted("volume", &[("volume_mL", 1.0)], true),
    ]
}

fn open(file: &Path, wanted: &[Wanted]) -> TableReading {
    let request = Request {
        file,
        wanted,
        format: None,
        sheet: None,
        block: None,
    };
    let folder = file.parent().unwrap().to_owned();
    let mut beside =
        |name: &str| std::fs::read(folder.join(name)).map_err(|error| error.to_string());
    read(&std::fs::read(file).unwrap(), &request, &mut beside)
}

fn sound(file: &Path, wanted: &[Wanted]) -> Table {
    let reading = open(file, wanted);
    reading
        .table
        .unwrap_or_else(|| panic!("{}: {:#?}", file.display(), reading.problems))
}

fn example(name: &str) -> PathBuf {
    data()
        .join("../../../../examples/recordings/P001-raw")
        .join(name)
}

/// Largest difference of two columns.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

#[test]
fn records_of_physionet_and_edf_hold_the_same_samples() {
    let truth = sound(&example("catheter.csv"), &of_catheter());
    assert!(
        truth.said.iter().all(|said| said.contains("not read")),
        "{:?}",
        truth.said
    );
    // A step of the converter: EDF's ranges in make.py, and wfdb's own choice of the gain.
    for (name, pressure, voltage) in [
        ("record16.hea", 0.01, 0.001),
        ("record212.hea", 0.05, 0.002),
        ("record32.hea", 1e-6, 1e-6),
        ("record.edf", 0.007, 0.0004),
        ("record.bdf", 0.0001, 0.0001),
    ] {
        let table = sound(&data().join(name), &of_catheter());
        let (time, lv, ecg) = (
            &table.columns["time"],
            &table.columns["lv_pressure"],
            &table.columns["ecg"],
        );
        assert_eq!(lv.len(), 500, "{name}");
        assert!(apart(time, &truth.columns["time"]) < 1e-6, "{name}");
        let worst = (
            apart(lv, &truth.columns["lv_pressure"]),
            apart(ecg, &truth.columns["ecg"]),
        );
        assert!(
            worst.0 <= pressure && worst.1 <= voltage,
            "{name}: {worst:?}"
        );
        assert!(
            table
                .said
                .join("\n")
                .contains("left-ventricular pressure from column `LVP (mmHg)`")
        );
    }
}

#[test]
fn the_curve_is_found_in_a_workbook() {
    let truth = sound(&example("cine.csv"), &of_cine());
    let table = sound(&data().join("cine.xlsx"), &of_cine());
    assert_eq!(table.columns, truth.columns);
    assert!(
        table.said.join("\n").contains("sheet `LV curve`"),
        "{:?}",
        table.said
    );
    assert_eq!(table.line(0), 5);
}

/// Half of a file, and a file with a byte in every 97 replaced, give problems and no panic.
#[test]
fn damaged_files_are_refused_or_read() {
    for entry in std::fs::read_dir(data()).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|e| e == "py" || e == "md") {
            continue;
        }
        let bytes = std::fs::read(&file).unwrap();
        let mut other = bytes.clone();
        other
            .iter_mut()
            .step_by(97)
            .for_each(|byte| *byte = byte.wrapping_add(41));
        for damaged in [
            &bytes[..bytes.len() / 2],
            &other,
            &bytes[..bytes.len().min(3)],
        ] {
            for wanted in [of_catheter(), of_cine()] {
                let request = Request {
                    file: &file,
                    wanted: &wanted,
                    format: None,
                    sheet: None,
                    block: None,
                };
                let mut beside = |_: &str| Ok(damaged.to_vec());
                let reading = read(damaged, &request, &mut beside);
                assert!(
                    reading.table.is_some() || !reading.problems.is_empty(),
                    "{}: neither a table nor a problem",
                    file.display()
                );
            }
        }
    }
}
