//! `cardiotwin prepare` on exports of laboratories' programs: the same recordings in another form
//! give the same patient.

use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::support::cardiotwin;

const RAW: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/recordings/P001-raw"
);

fn text(name: &str) -> String {
    std::fs::read_to_string(Path::new(RAW).join(name)).unwrap()
}

/// A folder with prepare.toml of the example, more settings, and files in another form.
fn folder(settings: &str, files: &[(&str, Vec<u8>)]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("raw");
    std::fs::create_dir(&raw).unwrap();
    let toml = text("prepare.toml").replace("[cine]\n", &format!("{settings}\n[cine]\n"));
    std::fs::write(raw.join("prepare.toml"), toml).unwrap();
    for (name, bytes) in files {
        std::fs::write(raw.join(name), bytes).unwrap();
    }
    (folder, raw)
}

/// Rows of the catheter's table: time in s, ventricle, aorta, electrocardiogram.
fn catheter() -> Vec<Vec<String>> {
    let text = text("catheter.csv");
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    rows.map(|line| line.split(',').map(str::to_owned).collect())
        .collect()
}

fn prepared(folder: &Path) -> Value {
    cardiotwin(folder, &["prepare", "raw", "--dry-run", "--json"]).json()
}

fn assert_same(answer: &Value, expected: &Value) {
    for key in ["cycle_length_ms", "beats", "steps"] {
        assert_eq!(answer[key], expected[key], "{key}");
    }
    // The comments name the files.
    let settings = |answer: &Value| -> Vec<String> {
        let text = answer["patient_toml"].as_str().unwrap();
        text.lines()
            .map(|line| line.split('#').next().unwrap().trim().to_owned())
            .collect()
    };
    assert_eq!(settings(answer), settings(expected));
}

fn labchart(rows: &[Vec<String>], decimal: &str) -> String {
    let mut text = format!(
        "Interval=\t0{decimal}004 s\nExcelDateTime=\t4{decimal}6e+04\t11/28/25 10:00:00\nTimeFormat=\tStartOfBlock\nDateFormat=\t\n\
         ChannelTitle=\tAoP\tLVP\tECG II\tResp\nRange=\t10 V\t10 V\t10 mV\t2 V\nUnitName=\tmmHg\tmmHg\t*\t*\n"
    );
    for (i, row) in rows.iter().enumerate() {
        let [time, lv, aorta, ecg] = [0, 1, 2, 3].map(|k| row[k].replace('.', decimal));
        let comment = if i == 700 { "\t#* Größe é" } else { "" };
        text += &format!("{time}\t{aorta}\t{lv}\t{ecg}\t0\t{comment}\r\n");
    }
    text
}

#[test]
fn exports_give_the_patient_of_the_plain_tables() {
    let plain = cardiotwin(Path::new(RAW), &["prepare", ".", "--dry-run", "--json"]).json();
    assert_eq!(plain["files"][0]["read_as"], serde_json::json!([]));
    let rows = catheter();
    let frames: Vec<String> = text("cine.csv")
        .lines()
        .filter(|l| !l.starts_with('#'))
        .skip(1)
        .map(str::to_owned)
        .collect();
    let segment: String = frames
        .iter()
        .map(|line| line.split_once(',').unwrap())
        .map(|(t, v)| format!("{t}\t{v}\t250.0\t0.0\tNaN\tNaN\n"))
        .collect();
    let segment = format!(
        "Name:\tP001\n\n\nTime[ms]\tEndovol[ml]\tEpivol[ml]\tPapvol\tRVEndovol[ml]\tRVEpivol[ml]\n{segment}"
    );
    // LabChart with decimal commas in the encoding of Windows, and a curve of Segment.
    let bytes: Vec<u8> = labchart(&rows, ",")
        .chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap())
        .collect();
    let (place, _) = folder("", &[("catheter.txt", bytes), ("cine.txt", segment.into())]);
    let answer = prepared(place.path());
    assert_same(&answer, &plain);
    let said = answer["files"].to_string();
    for part in [
        "LabChart text, Windows-1252, decimal comma, 1 block",
        "left-ventricular pressure from column `LVP (mmHg)`",
        "electrocardiogram from column `ECG II (mV)`",
        "`Größe é` (line 708)",
        "Segment's volume curve",
        "volume from column `Endovol[ml]`",
    ] {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
    // What Excel saves as CSV in Germany, and a report of cvi42 in UTF-16.
    let mut excel = "sep=;\r\nZeit (s);LVP (mmHg);AoP (mmHg);EKG (mV)\r\n".to_owned();
    for row in &rows {
        excel += &format!("{}\r\n", row.join(";").replace('.', ","));
    }
    let mut report = "Short Axis 3D LV Function (1)\n\nScientific Report Function | SAX Module\n\nEDV\t151.1 \tml\n\nVolume curve\n\
                      Phase\tTime(ms)\tLV Endo Volume(ml)\n"
        .to_owned();
    for (i, line) in frames.iter().enumerate() {
        let (t, v) = line.split_once(',').unwrap();
        report += &format!("{} \t{t} \t{v} \n", i + 1);
    }
    let wide: Vec<u8> = format!("\u{feff}{report}\nEnd of report\n")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let (place, _) = folder(
        "[catheter]\nfile = \"lab.csv\"\nformat = \"excel-csv\"\n",
        &[("lab.csv", excel.into()), ("cine.txt", wide)],
    );
    let answer = prepared(place.path());
    assert_same(&answer, &plain);
    let said = answer["files"].to_string();
    for part in [
        "cells separated by a semicolon, decimal comma, header in line 2",
        "report of cvi42, section `Volume curve`",
        "UTF-16",
    ] {
        assert!(said.contains(part), "{part:?} is not in {said}");
    }
}

#[test]
fn a_file_that_does_not_fit_is_refused_in_words() {
    let refused = |settings: &str, name: &str, content: &[u8], parts: &[&str]| {
        let (place, _) = folder(settings, &[(name, content.to_vec())]);
        cardiotwin(place.path(), &["prepare", "raw", "P001"])
            .expect(3)
            .complains_of(parts);
    };
    let named = |format: &str| format!("[catheter]\nfile = \"lab.txt\"\nformat = \"{format}\"\n");
    let chart = labchart(&catheter()[..200], ".");
    refused(
        &named("edf"),
        "lab.txt",
        chart.as_bytes(),
        &["lab.txt", "no header of EDF", "correct `format`"],
    );
    refused(
        &named("xlsx"),
        "lab.txt",
        chart.as_bytes(),
        &["prepare.toml", "format"],
    );
    refused(
        "",
        "catheter.txt",
        chart
            .replace("UnitName=\tmmHg\tmmHg\t*\t*\n", "")
            .as_bytes(),
        &["catheter.txt:1", "`LVP (V)`", "calibrated"],
    );
    refused(
        "",
        "catheter.txt",
        chart.replace("LVP", "P1").replace("AoP", "P2").as_bytes(),
        &[
            "neither a ventricular nor an aortic pressure",
            "[catheter.columns]",
        ],
    );
    refused(
        "",
        "catheter.txt",
        b"Zeit;LVP (mmHg)\n0,1;7\n0,2;8\n",
        &[
            "catheter.txt:1",
            "column `Zeit` without a unit",
            "time_ms = \"NAME\"",
        ],
    );
    refused(
        "",
        "catheter.txt",
        b"t,p\n0,001,7,5\n0,002,7,6\n",
        &[
            "catheter.txt:2",
            "commas both between cells and in the numbers",
        ],
    );
    refused(
        "",
        "catheter.xlsx",
        b"PK\x03\x04 no zip",
        &["catheter.xlsx", "no workbook"],
    );
    refused(
        "",
        "catheter.txt",
        &[0, 1, 2, 3, 0, 0],
        &["a binary file of an unknown format"],
    );
    // Columns are named as the file has them, with or without the unit.
    let settings = "[catheter.columns]\nlv_pressure_mmHg = \"P1\"\n";
    let (place, _) = folder(
        settings,
        &[(
            "catheter.txt",
            labchart(&catheter(), ".").replace("LVP", "P1").into(),
        )],
    );
    let answer = prepared(place.path());
    assert!(
        answer["files"]
            .to_string()
            .contains("left-ventricular pressure from column `P1 (mmHg)`")
    );
    refused(
        "[catheter.columns]\nlv_pressure_kPa = \"LVP\"\n",
        "catheter.txt",
        chart.as_bytes(),
        &["column `LVP (mmHg)` in mmHg"],
    );
    let (place, raw) = folder("", &[("catheter.txt", chart.into())]);
    std::fs::write(raw.join("catheter.csv"), text("catheter.csv")).unwrap();
    cardiotwin(place.path(), &["prepare", "raw", "P001"])
        .expect(3)
        .complains_of(&[
            "the files catheter.csv and catheter.txt",
            "catheter.file = \"catheter.csv\"",
        ]);
}

#[test]
fn every_bad_line_counts() {
    let bad: String = text("catheter.csv")
        .lines()
        .enumerate()
        .map(|(i, line)| {
            if (10..30).contains(&i) {
                line.replacen(',', ",x", 1) + "\n"
            } else {
                format!("{line}\n")
            }
        })
        .collect();
    let (place, _) = folder("", &[("catheter.csv", bad.into())]);
    let said = cardiotwin(place.path(), &["prepare", "raw", "P001"]).expect(3);
    said.complains_of(&["15 more lines like those before", "20 errors"]);
}

#[test]
fn the_template_of_init_is_taken_over_until_it_is_edited() {
    let place = tempfile::tempdir().unwrap();
    let patient = place.path().join("cohort/patients/P001");
    cardiotwin(place.path(), &["init", "cohort"]).expect(0);
    let call = ["prepare", RAW, "cohort/patients/P001", "--quiet"];
    cardiotwin(place.path(), &call).expect(0);
    assert!(patient.join("prepared/prepare.json").is_file());
    let page = std::fs::read_to_string(patient.join("prepared/prepare.html")).unwrap();
    for part in [
        "Excluded beats",
        "Loops before and after",
        // The example has one gap of its own.
        "Samples are missing in 1 stretch, 0.27 s in all",
        "names and units of this program",
    ] {
        assert!(page.contains(part), "{part:?} is not on the page");
    }
    let page = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!page.contains("http://") && page.contains("</html>"));
    for edit in ["patient.toml", "notes.txt"] {
        std::fs::remove_dir_all(place.path().join("cohort")).unwrap();
        cardiotwin(place.path(), &["init", "cohort"]).expect(0);
        let file = patient.join(edit);
        let before = std::fs::read_to_string(&file).unwrap_or_default();
        std::fs::write(&file, before + "# mine\n").unwrap();
        cardiotwin(place.path(), &call)
            .expect(2)
            .complains_of(&["already exists and was not created by `cardiotwin prepare`"]);
        assert!(std::fs::read_to_string(&file).unwrap().contains("# mine"));
    }
}

/// The recordings' gap is a gap of the page's lines.
#[test]
fn a_gap_of_the_recording_is_drawn_as_a_gap() {
    let rows: String = text("catheter.csv")
        .lines()
        .enumerate()
        .filter(|(i, _)| !(3000..3100).contains(i))
        .map(|(_, line)| format!("{line}\n"))
        .collect();
    let (place, _) = folder(
        "",
        &[
            ("catheter.csv", rows.into()),
            ("cine.csv", text("cine.csv").into()),
        ],
    );
    cardiotwin(place.path(), &["prepare", "raw", "P001", "--quiet"]).expect(0);
    let page = std::fs::read_to_string(place.path().join("P001/prepared/prepare.html")).unwrap();
    assert!(page.contains("Samples are missing in 2 stretches"));
    let broken = page
        .split("class=\"line out\"")
        .skip(1)
        .filter_map(|rest| rest.split(" d=\"").nth(1)?.split('"').next())
        // Beat 12 has the example's own gap, too: three stretches of samples.
        .filter(|path| path.matches('M').count() == 3)
        .count();
    assert!(broken >= 1, "no line of an excluded beat is broken");
    assert!(page.contains("of samples are missing"));
}
