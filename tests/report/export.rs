//! Exported tables and traces, as other programs read them.

use std::path::{Path, PathBuf};

use cardiotwin_report::export::export;
use cardiotwin_schemas::record::{Step3Ending, Step3Summary};
use serde_json::Value;

use crate::fixture;

fn exported() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a/b");
    let done = export(&fixture::cohort(folder.path()), &out, false).unwrap();
    assert_eq!(done.problems, Vec::<String>::new());
    assert_eq!(done.files.len(), 9);
    assert!(done.files.iter().all(|f| f.is_file()));
    (folder, out)
}

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn tables_as_csv() {
    let (_folder, out) = exported();
    for name in ["table_1", "table_2", "table_A6", "table_A7"] {
        insta::assert_snapshot!(name, text(&out, &format!("{name}.csv")));
    }
}

#[test]
fn tables_as_json_hold_what_the_csv_holds() {
    let (_folder, out) = exported();
    insta::assert_snapshot!("table_A6.json", text(&out, "table_A6.json"));
    for name in ["table_1", "table_2", "table_A6", "table_A7"] {
        let json: Value = serde_json::from_str(&text(&out, &format!("{name}.json"))).unwrap();
        let csv = text(&out, &format!("{name}.csv"));
        let columns: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
        let with_row = columns[1] == "row";
        for line in csv.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let first = if with_row { 2 } else { 1 };
            let of = match cells[0] {
                spread @ ("mean" | "SD" | "n") => &json[spread],
                patient => &json["rows"][patient],
            };
            let of = if with_row { &of[cells[1]] } else { of };
            for (column, cell) in std::iter::zip(&columns, &cells).skip(first) {
                let same = match &of[*column] {
                    Value::Null => cell.is_empty(),
                    Value::String(text) => text == cell,
                    number => number.as_f64() == cell.parse().ok(),
                };
                assert!(
                    same,
                    "{name}, {} {column}: {cell} against {}",
                    cells[0], of[*column]
                );
            }
        }
    }
}

#[test]
fn step_3_has_rows_of_biomarkers_and_columns_of_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = fixture::cohort(folder.path());
    let [cell, valve] = ["n_TRPN", "R_AV_f_mmHg_s_per_mL"];
    run.patients[0].step3 = Some(Step3Summary {
        ending: Step3Ending::WithinUncertainty,
        best_iteration: 0,
        misfit: 3.0,
        parameters: [(cell.to_owned(), 2.5), (valve.to_owned(), 0.0125)].into(),
    });
    let out = folder.path().join("export");
    export(&run, &out, false).unwrap();
    let json = |name: &str| -> Value { serde_json::from_str(&text(&out, name)).unwrap() };
    let biomarkers = json("table_2.json");
    let of = |kind: &str| biomarkers["rows"]["01-CoA"][kind]["SV_mL"].clone();
    assert_eq!(
        of("step3"),
        of("step2"),
        "the verification beat was the best"
    );
    assert!(of("step3").is_number());
    assert!(of("step3_difference_percent").is_number());
    assert_eq!(
        biomarkers["n"]["step3"]["SV_mL"], 1,
        "others have no step 3"
    );
    let table = json("table_A7.json");
    assert_eq!(table["rows"]["01-CoA"]["n_TRPN_twin"], 2.5);
    let other = &table["rows"]["02-CoA"];
    assert_eq!(other["n_TRPN_twin"], other["n_TRPN"], "step 3 left it");
    assert_eq!(
        json("table_A6.json")["rows"]["01-CoA"][format!("{valve}_twin")],
        0.0125
    );
}

#[test]
fn traces_are_long_and_tidy() {
    let (_folder, out) = exported();
    let csv = text(&out, "traces.csv");
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("patient,source,signal,time_ms,value,unit,clock")
    );
    assert!(csv.lines().all(|l| l.split(',').count() == 7));
    let mut kinds: Vec<String> = Vec::new();
    for line in lines {
        let c: Vec<&str> = line.split(',').collect();
        if c[0] == "01-CoA" {
            let kind = format!("{} {} {} since {}", c[1], c[2], c[5], c[6]);
            if kinds.last() != Some(&kind) {
                kinds.push(kind);
            }
        }
        assert!(
            c[3].parse::<f64>().is_ok() && c[4].parse::<f64>().is_ok(),
            "{line}"
        );
    }
    insta::assert_snapshot!("signals", kinds.join("\n"));
    assert!(
        csv.contains("\n01-CoA,measured,pressure,0,7.016,mmHg,beat\n"),
        "the measured trace as it was measured"
    );
}

#[test]
fn patients_in_trouble_leave_gaps_not_errors() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("export");
    let done = export(&fixture::troubled(folder.path()), &out, false).unwrap();
    assert_eq!(done.problems.len(), 1, "{:?}", done.problems);
    insta::assert_snapshot!("troubled_table_A6", text(&out, "table_A6.csv"));
}
