//! `cardiotwin fit`: parameters from traces, and their way into a cohort.

use std::path::Path;

use serde_json::Value;

use crate::schema::misfits;
use crate::support::{Cohort, cardiotwin};

const TRACE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/calcium/transient.csv"
);

#[test]
fn rices_calcium_comes_from_a_measured_transient() {
    let folder = tempfile::tempdir().unwrap();
    let answer = cardiotwin(
        folder.path(),
        &["fit", "calcium", TRACE, "--json", "--plot", "fit.svg"],
    )
    .json();
    let schema = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../schemas/json/fit-calcium.schema.json"
    );
    let schema: Value = serde_json::from_str(&std::fs::read_to_string(schema).unwrap()).unwrap();
    assert_eq!(misfits(&answer, &schema), Vec::<String>::new());
    // The trace's header has the true values. An interval of 95 % is about twice as wide as these
    // bounds.
    for (key, truth, within) in [
        ("Ca_res_uM", 0.12, 0.01),
        ("Ca_max_uM", 0.7, 0.007),
        ("tau_CR_ms", 170.0, 15.0),
        ("tau_CD_ms", 60.0, 6.0),
    ] {
        assert!(
            (answer[key].as_f64().unwrap() - truth).abs() < within,
            "{key}: {}",
            answer[key]
        );
    }
    assert_eq!(answer["time_constants"], "distinct");
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

/// Numbers in nM under a header in µM: refused by the fit and by `check`, which name the unit.
#[test]
fn calcium_in_nanomoles_is_refused_with_its_unit() {
    let text = std::fs::read_to_string(TRACE).unwrap();
    let in_nm: String = text
        .lines()
        .map(
            |line| match line.split_once(',').map(|(t, c)| (t, c.parse::<f64>())) {
                Some((time, Ok(calcium))) => format!("{time},{}\n", 1000.0 * calcium),
                _ => format!("{line}\n"),
            },
        )
        .collect();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("nm.csv"), &in_nm).unwrap();
    let refused = cardiotwin(folder.path(), &["fit", "calcium", "nm.csv"]);
    assert_ne!(refused.code, 0);
    assert!(
        refused
            .err
            .contains("if the numbers are in nM: multiply by 0.001"),
        "{}",
        refused.err
    );
    cardiotwin(
        folder.path(),
        &["fit", "calcium", "nm.csv", "--accept", "calcium-range"],
    )
    .expect(0);

    let cohort = Cohort::quick_of("01-CoA");
    let patient = cohort.path().join("patients/01-CoA");
    std::fs::write(patient.join("calcium.csv"), &in_nm).unwrap();
    let file = patient.join("patient.toml");
    let plain = std::fs::read_to_string(&file).unwrap();
    let given = |more: &str| {
        let text = plain.replace(
            "[measured]\n",
            &format!("[measured]\ncalcium = \"calcium.csv\"\n{more}"),
        );
        assert_ne!(text, plain);
        std::fs::write(&file, text).unwrap();
        cohort.call(&["check"])
    };
    let refused = given("");
    let said = format!("{}{}", refused.out, refused.err);
    assert_ne!(refused.code, 0, "{said}");
    for part in [
        "measured.calcium",
        "in nM: multiply by 0.001",
        "accept = [\"calcium-range\"]",
    ] {
        assert!(said.contains(part), "{part} is not in {said}");
    }
    given("accept = [\"calcium-range\"]\n").expect(0);
}

/// Both tables, in a cohort's file: `check` accepts them, and a run fixes or bounds calcium by
/// them.
#[test]
fn a_fit_becomes_a_cohorts_default() {
    for way in ["frozen", "bounds"] {
        let cohort = Cohort::quick_of("01-CoA");
        let settings = cohort
            .call(&["fit", "calcium", TRACE, "--toml", way])
            .expect(0)
            .out;
        // TOML allows only one table of a name, so the quick settings follow in the fit's own.
        let quick = "popsize = 3\nmax_generations = 4\npolish = false\n";
        let table = if way == "frozen" {
            settings.replace("[step2]\n", &format!("[step2]\n{quick}"))
        } else {
            format!("[step2]\n{quick}\n{settings}")
        };
        std::fs::write(
            cohort.path().join("cohort.toml"),
            format!(
                "name = \"fitted\"\nsolver.fidelity = \"reduced\"\nposterior.enabled = false\n{table}"
            ),
        )
        .unwrap();
        cohort.call(&["check", "--strict"]).expect(0);
        cohort.call(&["run", "--no-report"]).expect(0);
        let patient = cohort.patient("01-CoA");
        let fitted = patient["cell_fit"]["result"]["parameters"]
            .as_array()
            .unwrap();
        let peak = fitted
            .iter()
            .find(|parameter| parameter["name"] == "Ca_max_uM");
        match (way, peak) {
            ("frozen", None) => assert_eq!(fitted.len(), 6),
            ("bounds", Some(peak)) => {
                let value = peak["value"].as_f64().unwrap();
                assert!((0.69..0.71).contains(&value), "{value}");
            }
            (_, peak) => panic!("{way}: {peak:?} among {fitted:?}"),
        }
    }
}

#[test]
fn a_bad_transient_is_refused_with_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |text: &str, parts: &[&str]| {
        std::fs::write(folder.path().join("bad.csv"), text).unwrap();
        let said = cardiotwin(folder.path(), &["fit", "calcium", "bad.csv", "--json"])
            .expect(3)
            .complains_of(parts);
        assert!(
            said.out.is_empty() && said.err.contains("nothing was fitted"),
            "{said:?}"
        );
    };
    let rows = |edit: &dyn Fn(usize, &str) -> Option<String>| -> String {
        let sound = std::fs::read_to_string(Path::new(TRACE)).unwrap();
        sound
            .lines()
            .enumerate()
            .filter_map(|(i, line)| edit(i + 1, line))
            .map(|line| line + "\n")
            .collect()
    };
    let at = |number: usize, new: &str| {
        rows(&|i, line| {
            Some(if i == number {
                new.to_owned()
            } else {
                line.to_owned()
            })
        })
    };
    refused(
        &at(3, "time_ms,calcium_nM"),
        &["bad.csv:3: calcium_uM", "`calcium_nM`", "1000 nM = 1 µM"],
    );
    refused(&at(3, "time_ms"), &["bad.csv:3: calcium_uM"]);
    refused(
        &at(20, "80,NaN"),
        &["bad.csv:20: calcium_uM", "`NaN`", "a finite number in µM"],
    );
    refused(
        &at(20, "80,-0.1"),
        &["bad.csv:20: calcium_uM", "`-0.1`", "0 or more"],
    );
    refused(
        &at(20, "70,0.6"),
        &[
            "bad.csv:20: time_ms",
            "70 ms after 75 ms",
            "increasing times",
        ],
    );
    refused(
        &rows(&|i, line| (i < 9).then(|| line.to_owned())),
        &["5 samples", "at least 8"],
    );
    refused(
        &rows(&|i, line| (i < 20).then(|| line.to_owned())),
        &["no peak", "a rise after activation at 0 ms and a fall"],
    );
    refused("", &["an empty file", "time_ms,calcium_uM"]);
    cardiotwin(folder.path(), &["fit", "calcium", "absent.csv"])
        .expect(3)
        .complains_of(&["absent.csv", "no readable file"]);
    cardiotwin(
        folder.path(),
        &["fit", "calcium", TRACE, "--confidence", "95"],
    )
    .expect(2);
}
