//! `cardiotwin fit afterload` and `discover --afterload` on measured records.

use std::path::Path;

use serde_json::Value;

use crate::schema::misfits;
use crate::support::{Cohort, cardiotwin};

const FLOW: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/afterload/human-1999/flow.csv"
);
const PRESSURE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/afterload/human-1999/pressure.csv"
);

fn schema(name: &str) -> Value {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../schemas/json")
        .join(name);
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

#[test]
fn the_windkessel_of_the_human_record_has_its_reference_values() {
    let folder = tempfile::tempdir().unwrap();
    let call = [
        "fit",
        "afterload",
        FLOW,
        PRESSURE,
        "--json",
        "--plot",
        "fit.svg",
    ];
    let answer = cardiotwin(folder.path(), &call).json();
    assert_eq!(
        misfits(&answer, &schema("fit-afterload.schema.json")),
        Vec::<String>::new()
    );
    let load = &answer["afterload"];
    for (key, expected) in [
        ("characteristic_resistance_mmHg_s_per_mL", 0.030_04),
        ("peripheral_resistance_mmHg_s_per_mL", 0.741_33),
        ("compliance_mL_per_mmHg", 1.832_96),
    ] {
        let found = load[key].as_f64().unwrap();
        assert!(
            (found / expected - 1.0).abs() < 1e-3,
            "{key}: {found} {expected}"
        );
    }
    assert!((answer["root_mean_square_mmHg"].as_f64().unwrap() - 2.8568).abs() < 1e-3);
    let plot = std::fs::read_to_string(folder.path().join("fit.svg")).unwrap();
    assert!(
        plot.starts_with("<svg xmlns") && plot.matches("<circle").count() > 160,
        "{plot}"
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "nothing else is written"
    );
}

/// The wave reflection is the effect that three elements lack in the human record, and the gap also
/// shrinks on data held out.
#[test]
fn the_human_record_lacks_a_reflection() {
    let folder = tempfile::tempdir().unwrap();
    let call = [
        "discover",
        "--afterload",
        FLOW,
        PRESSURE,
        "--json",
        "found.json",
        "--plot",
        "found.svg",
    ];
    let said = cardiotwin(folder.path(), &call).expect(0);
    assert!(said.out.contains("found: tube_reflection"), "{}", said.out);
    let answer: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("found.json")).unwrap()).unwrap();
    assert_eq!(
        misfits(&answer, &schema("afterload-discovery.schema.json")),
        Vec::<String>::new()
    );
    let gap = |key: &str| answer[key].as_f64().unwrap();
    assert!(
        gap("gap_after") < 0.6 * gap("gap_before")
            && gap("gap_heldout_after") < 0.6 * gap("gap_heldout_before")
    );
    assert_eq!(
        (answer["none"].as_bool(), &answer["accepted"][0]),
        (Some(false), &"tube_reflection".into())
    );
    assert_eq!(answer["organ"]["effects"][0]["name"], "wave_reflection");
    assert!(
        std::fs::read_to_string(folder.path().join("found.svg"))
            .unwrap()
            .contains("held out")
    );
    cardiotwin(
        folder.path(),
        &[
            "discover",
            "--afterload",
            FLOW,
            PRESSURE,
            "--effects",
            "atrial_kick",
        ],
    )
    .expect(2)
    .complains_of(&["atrial_kick", "tube_reflection"]);
}

/// `check` accepts the lines for `patient.toml`, and a run uses them.
#[test]
fn a_fitted_load_becomes_a_patients_afterload() {
    let cohort = Cohort::quick_of("01-CoA");
    let lines = cohort
        .call(&["fit", "afterload", FLOW, PRESSURE, "--toml"])
        .expect(0)
        .out;
    let file = cohort.path().join("patients/01-CoA/patient.toml");
    let patient = std::fs::read_to_string(&file).unwrap();
    let (before, rest) = patient.split_once("[afterload]").unwrap();
    let after = &rest[rest.find("\n[").unwrap()..];
    std::fs::write(&file, format!("{before}{lines}{after}")).unwrap();
    cohort.call(&["check"]).expect(0);
    std::fs::write(
        &file,
        format!("{before}{}{after}", lines.replace("= 0.74", "= -0.74")),
    )
    .unwrap();
    let said = cohort.call(&["check"]).expect(1);
    assert!(
        said.out.contains("peripheral_resistance_mmHg_s_per_mL"),
        "{said:?}"
    );
}

#[test]
fn a_bad_record_is_refused_with_file_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let sound = std::fs::read_to_string(FLOW).unwrap();
    let refused = |flow: &str, parts: &[&str]| {
        std::fs::write(folder.path().join("bad.csv"), flow).unwrap();
        let call = ["fit", "afterload", "bad.csv", PRESSURE, "--json"];
        let said = cardiotwin(folder.path(), &call)
            .expect(3)
            .complains_of(parts);
        assert!(
            said.out.is_empty() && said.err.contains("nothing was fitted"),
            "{said:?}"
        );
    };
    refused(
        &sound.replace("flow_mL_per_s", "flow_L_per_min"),
        &["flow_mL_per_s", "1 L/min = 16.6667 mL/s"],
    );
    refused(
        &sound.replace("flow_mL_per_s", "flow"),
        &["flow_mL_per_s", "units are never guessed"],
    );
    refused(
        &sound.replace("\n20,", "\n15,"),
        &["time_ms", "15 ms a second time"],
    );
    refused(
        &sound.replace("\n20,", "\n20,NaN"),
        &["flow_mL_per_s", "a finite number in mL/s"],
    );
    let still: String = (0..100).map(|i| format!("{},5\n", 5 * i)).collect();
    refused(
        &format!("time_ms,flow_mL_per_s\n{still}"),
        &["without an ejection", "change the sign"],
    );
    let later: String = (0..100)
        .map(|i| format!("{},{}\n", 9000 + 5 * i, i % 40))
        .collect();
    cardiotwin(folder.path(), &["fit", "afterload", FLOW, FLOW])
        .expect(3)
        .complains_of(&[
            "pressure_mmHg",
            "are the two files swapped on the command line",
        ]);
    std::fs::write(
        folder.path().join("bad.csv"),
        format!("time_ms,flow_mL_per_s\n{later}"),
    )
    .unwrap();
    cardiotwin(folder.path(), &["fit", "afterload", "bad.csv", PRESSURE])
        .expect(3)
        .complains_of(&[
            "0 samples at times with a measured flow",
            "the same instant",
        ]);
    cardiotwin(
        folder.path(),
        &["fit", "afterload", FLOW, PRESSURE, "--confidence", "95"],
    )
    .expect(2);
}

/// Kind 22 of the fixtures: units, signs and clocks of flow and pressure that no aorta has.
#[test]
fn what_no_aorta_has_is_refused_or_warned_of() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures/public-reports/22-afterload-units-and-sync");
    for (flow, pressure, code, part) in [
        ("flow.csv", "p_kpa.csv", 3, "a mean pressure of 12.0 mmHg"),
        ("flow_Lmin.csv", "pressure.csv", 3, "1 L/min is 16.7 mL/s"),
        (
            "flow_neg.csv",
            "pressure.csv",
            3,
            "a mean flow of -112.95 mL/s",
        ),
        (
            "flow.csv",
            "p_shift-40.csv",
            0,
            "but the mean pressure over the mean flow is 0.799",
        ),
    ] {
        let said = cardiotwin(&folder, &["fit", "afterload", flow, pressure]).expect(code);
        let told = format!("{}{}", said.out, said.err);
        assert!(told.contains(part), "{flow} {pressure}: {told}");
    }
    let sound = cardiotwin(&folder, &["fit", "afterload", "flow.csv", "pressure.csv"]).expect(0);
    let told = format!("{}{}", sound.out, sound.err);
    for part in ["a mean pressure of", "a mean flow of", "R1 + R2 ="] {
        assert!(!told.contains(part), "{told}");
    }
    // Times in s under ms, and a mean pressure in place of a pulse.
    let other = tempfile::tempdir().unwrap();
    let moved = |name: &str, change: &dyn Fn(f64, &str) -> String| {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        let rows = text.lines().map(|line| match line.split_once(',') {
            Some((time, value)) if time.parse::<f64>().is_ok() => {
                change(time.parse().unwrap(), value)
            }
            _ => line.to_owned(),
        });
        rows.collect::<Vec<String>>().join("\n") + "\n"
    };
    for name in ["flow.csv", "pressure.csv"] {
        let text = moved(name, &|time, value| format!("{:.6},{value}", 1e-3 * time));
        std::fs::write(other.path().join(name), text).unwrap();
    }
    let flat = moved("pressure.csv", &|time, _| format!("{time},90.0"));
    std::fs::write(other.path().join("flat.csv"), flat).unwrap();
    std::fs::copy(folder.join("flow.csv"), other.path().join("whole.csv")).unwrap();
    for (flow, pressure, part) in [
        ("flow.csv", "pressure.csv", "a beat of 0.825"),
        ("whole.csv", "flat.csv", "a pulse pressure of 0.000 mmHg"),
    ] {
        cardiotwin(other.path(), &["fit", "afterload", flow, pressure])
            .expect(3)
            .complains_of(&[part, "expected"]);
    }
    let search = ["discover", "--afterload", "flow.csv", "p_shift-40.csv"];
    let said = cardiotwin(&folder, &search).expect(0);
    assert!(
        said.out
            .starts_with("undecided: timing_misalignment has probability"),
        "{}",
        said.out
    );
}

/// Records in kPa, L/min or with the other sign give resistances that no artery has: they are refused,
/// unless their rule is accepted by its name.
#[test]
fn records_in_other_units_are_refused_until_they_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let scaled = |file: &str, name: &str, factor: f64| {
        let text = std::fs::read_to_string(file).unwrap();
        let rows = text.lines().map(|line| {
            let (time, value) = line.split_once(',').unwrap();
            let value = value.parse::<f64>().map(|v| (v * factor).to_string());
            format!("{time},{}\n", value.unwrap_or_else(|_| "HEAD".to_owned()))
        });
        let head = text.lines().next().unwrap().split_once(',').unwrap().1;
        let text = rows.collect::<String>().replace("HEAD", head);
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    scaled(FLOW, "litres.csv", 0.06);
    scaled(FLOW, "turned.csv", -1.0);
    scaled(PRESSURE, "kpa.csv", 0.133_322);
    for (flow, pressure, rule, found) in [
        (
            "litres.csv",
            PRESSURE,
            "aortic-mean-flow",
            "a mean flow of 6.78 mL/s",
        ),
        (
            "turned.csv",
            PRESSURE,
            "aortic-mean-flow",
            "a mean flow of -112.95 mL/s",
        ),
        (
            FLOW,
            "kpa.csv",
            "aortic-mean-pressure",
            "a mean pressure of 12.0 mmHg",
        ),
    ] {
        let fit = ["fit", "afterload", flow, pressure];
        let accept = format!("--accept {rule}");
        let refused = cardiotwin(folder.path(), &fit);
        assert_eq!(
            (refused.code, refused.out.as_str()),
            (3, ""),
            "{}",
            refused.err
        );
        refused.complains_of(&[found, &accept]);
        let override_it = [&fit[..], &["--accept", rule]].concat();
        cardiotwin(folder.path(), &override_it).expect(0);
        let search = ["discover", "--afterload", flow, pressure];
        let refused = cardiotwin(folder.path(), &search);
        assert_eq!(
            (refused.code, refused.out.as_str()),
            (3, ""),
            "{}",
            refused.err
        );
        refused.complains_of(&[found, &format!("--accept-rule {rule}")]);
    }
    let both = ["fit", "afterload", "litres.csv", "kpa.csv"];
    cardiotwin(folder.path(), &both).expect(3).complains_of(&[
        "aortic-mean-flow",
        "aortic-mean-pressure",
        "errors in the traces: 2",
    ]);
    let search = ["discover", "--afterload", "litres.csv", PRESSURE];
    let accepted = [
        &search[..],
        &[
            "--accept-rule",
            "aortic-mean-flow",
            "--effects",
            "tube_reflection",
        ],
    ]
    .concat();
    cardiotwin(folder.path(), &accepted).expect(0);
    let misspelt = ["fit", "afterload", FLOW, PRESSURE, "--accept", "mean-flow"];
    cardiotwin(folder.path(), &misspelt)
        .expect(3)
        .complains_of(&["names of rules", "aortic-mean-flow"]);
    let cuff = ["fit", "afterload", "litres.csv", "--cuff", "120/80"];
    cardiotwin(folder.path(), &cuff)
        .expect(3)
        .complains_of(&["aortic-mean-flow"]);
}
