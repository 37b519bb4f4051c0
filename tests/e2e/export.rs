//! Output of `export` for other programs and people: openCARP's files, and an RO-Crate that an
//! independent validator accepts.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::support::{Cohort, cardiotwin};

fn lines(file: &Path) -> Vec<String> {
    let text =
        std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    text.lines().map(str::to_owned).collect()
}

#[test]
fn a_personalised_model_is_handed_to_opencarp() {
    let cohort = Cohort::quick_of("02-CoA");
    let run = [
        "run",
        "--no-report",
        "--quiet",
        "--fidelity",
        "finite-element",
        "--mesh-nodes",
        "500",
    ];
    cohort.call(&run).expect(0);
    cohort.call(&["export", "--opencarp"]).expect(0);
    let folder = cohort.path().join("run/export/opencarp/02-CoA");
    let of = |name: &str| lines(&folder.join(name));
    let count = |lines: &[String]| {
        lines[0]
            .parse::<usize>()
            .expect("a file begins with a number")
    };
    let (points, elements, fibres) = (of("heart.pts"), of("heart.elem"), of("heart.lon"));
    let n_nodes = count(&points);
    assert!((300..1500).contains(&n_nodes) && points.len() == n_nodes + 1);
    assert_eq!(count(&elements), elements.len() - 1);
    assert_eq!((fibres[0].as_str(), fibres.len()), ("2", elements.len()));
    for element in &elements[1..] {
        let words: Vec<&str> = element.split(' ').collect();
        assert!(
            words[0] == "Tt"
                && words[1..5]
                    .iter()
                    .all(|node| node.parse::<usize>().is_ok_and(|i| i < n_nodes))
        );
    }
    assert_eq!(of("heart.unloaded.pts").len(), points.len());
    let activation: Vec<f64> = of("activation.dat")
        .iter()
        .map(|line| line.parse().expect("a number"))
        .collect();
    assert_eq!(activation.len(), n_nodes);
    assert!(
        activation.iter().any(|t| *t > 0.0)
            && activation
                .iter()
                .all(|t| *t == -1.0 || (0.0..400.0).contains(t))
    );
    // The personalised parameters have the plugin's names.
    let patient = cohort.patient("02-CoA");
    let peak = &patient["step1"]["parameters"]["tanh"]["Smax_ref_kPa"];
    assert!(
        of("tanh.par")
            .iter()
            .any(|line| line.contains(&format!("Tpeak={peak},"))),
        "{peak}"
    );
    let fitted = patient["cell_fit"]["result"]["parameters"]
        .as_array()
        .expect("fitted parameters");
    let n_tm = fitted
        .iter()
        .find(|p| p["name"] == "n_Tm")
        .expect("n_Tm is fitted")["value"]
        .as_f64()
        .expect("a number");
    assert!(
        of("land17.par")
            .iter()
            .any(|line| line.contains(&format!("nperm={n_tm},"))),
        "{n_tm}"
    );
    let calcium: Vec<f64> = of("calcium.csv")[1..]
        .iter()
        .map(|line| {
            line.split(',')
                .nth(1)
                .and_then(|value| value.parse().ok())
                .expect("a number")
        })
        .collect();
    let peak = fitted
        .iter()
        .find(|p| p["name"] == "Ca_max_uM")
        .and_then(|p| p["value"].as_f64())
        .expect("fitted");
    let found = calcium.iter().copied().fold(0.0, f64::max);
    assert!(
        (found / peak - 1.0).abs() < 1e-3,
        "{found} uM against {peak}"
    );
}

/// Python with packages of PyPI, installed once per build folder; `None`, with a message, if that
/// is not possible.
fn python() -> Option<PathBuf> {
    let test = std::env::current_exe().expect("a test knows its own path");
    let place = test
        .parent()
        .and_then(Path::parent)
        .expect("tests lie in target/PROFILE/deps")
        .join("crate-reader");
    let python = place.join("bin/python");
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("e2e");
    let ready = || {
        Command::new(&python)
            .args(["-c", "import rocrate, rocrate_validator"])
            .output()
    };
    if !ready().is_ok_and(|said| said.status.success()) {
        let _ = Command::new("python3")
            .args(["-m", "venv"])
            .arg(&place)
            .output();
        let list = here.join("requirements.txt");
        let _ = Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--requirement"])
            .arg(list)
            .output();
    }
    match ready() {
        Ok(said) if said.status.success() => Some(python),
        _ => {
            cardiotwin_not_tested::not_tested(
                "python-packages",
                "rocrate and roc-validator (python3-venv, network)",
            );
            None
        }
    }
}

#[test]
fn a_run_is_shared_as_a_crate_that_others_can_read() {
    let cohort = Cohort::quick_of("02-CoA");
    cohort.call(&["run", "--no-report", "--quiet"]).expect(0);
    let make = [
        "export",
        "--ro-crate",
        "--license",
        "https://creativecommons.org/licenses/by/4.0/",
        "--author",
        "A. Modeller",
    ];
    let with_inputs = [&make[..], &["--with-inputs"]].concat();
    for arguments in [&make[..], &with_inputs[..]] {
        cohort.call(arguments).expect(0);
        let place = cohort.path().join("run/export/ro-crate");
        let metadata =
            std::fs::read_to_string(place.join("ro-crate-metadata.json")).expect("it was written");
        let record = std::fs::read_to_string(place.join("patients/02-CoA/record.json"))
            .expect("it was written");
        let input = std::fs::read(cohort.path().join("patients/02-CoA/pressure.csv"))
            .expect("the cohort's");
        let hash = cardiotwin_schemas::hash::sha256_hex(&input);
        assert!(
            metadata.contains(&hash) && record.contains(&hash),
            "inputs are named by their content"
        );
        assert!(metadata.contains("CreateAction") && metadata.contains("cardiotwin-worker"));
        // Nothing identifies this machine.
        let here = cohort.path().to_string_lossy().into_owned();
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        for text in [&metadata, &record] {
            assert!(
                !text.contains(&here) && !text.contains(&format!("\"{}\"", host.trim())),
                "{here}, {host}"
            );
        }
        let kept = place.join("patients/02-CoA/inputs/pressure.csv");
        assert_eq!(
            std::fs::read(&kept).ok(),
            (arguments.len() > make.len()).then_some(input)
        );
        if let Some(python) = python() {
            let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("e2e/validate_crate.py");
            let said = Command::new(python)
                .arg("-B")
                .arg(script)
                .arg(&place)
                .output()
                .expect("python starts");
            let words = String::from_utf8_lossy(&said.stdout).into_owned()
                + &String::from_utf8_lossy(&said.stderr);
            assert!(said.status.success(), "{words}");
        }
    }
}

/// The file of traces of a patient's verification beat.
fn traces_of(cohort: &Cohort, patient: &str) -> PathBuf {
    let record = cohort.patient(patient);
    let beat = &record["verification"];
    let traces = beat["artefacts"]
        .as_array()
        .and_then(|all| all.iter().find(|artefact| artefact["name"] == "traces"))
        .unwrap_or_else(|| panic!("no traces in {beat}"));
    let text = |value: &serde_json::Value| value.as_str().expect("a text").to_owned();
    Path::new(&text(&beat["directory"])).join(text(&traces["file"]))
}

#[test]
fn an_edited_file_is_found_by_verify_and_left_out_by_export() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort.call(&["run", "--no-report"]).expect(0);
    let said = cohort.call(&["verify"]).expect(0);
    assert!(
        said.out.contains(" files checked: ") && said.out.contains(" as stored\n"),
        "{}",
        said.out
    );
    cohort.call(&["export"]).expect(0);

    let traces = traces_of(&cohort, "01-CoA");
    let text = std::fs::read_to_string(&traces).unwrap();
    // One digit, so that the size stays.
    let last = text.rfind(|c: char| c.is_ascii_digit()).unwrap();
    let digit = if text[last..].starts_with('1') {
        "2"
    } else {
        "1"
    };
    let edited = format!("{}{digit}{}", &text[..last], &text[last + 1..]);
    std::fs::write(&traces, edited).unwrap();
    let said = cohort.call(&["export"]).expect(1);
    assert!(
        said.err
            .contains("was changed after it was written, and is left out"),
        "{}",
        said.err
    );
    let exported = std::fs::read_to_string(cohort.run_dir().join("export/traces.csv")).unwrap();
    assert!(
        exported.contains(",step1,") && !exported.contains(",step2,pressure"),
        "{exported:.600}"
    );

    let input = cohort.path().join("patients/01-CoA/pressure.csv");
    let measured = std::fs::read(&input).unwrap();
    std::fs::remove_file(&input).unwrap();
    let said = cohort.call(&["verify"]).expect(1);
    assert!(
        said.out.contains("traces.csv") && said.out.contains("changed"),
        "{}",
        said.out
    );
    assert!(
        said.out.contains("pressure.csv") && said.out.contains("missing"),
        "{}",
        said.out
    );
    assert!(said.out.ends_with("1 changed, 1 missing\n"), "{}", said.out);
    let said = cohort.call(&["verify", "--json"]).expect(1);
    let answer: serde_json::Value = serde_json::from_str(&said.out).unwrap();
    let files = answer["files"].as_array().unwrap();
    let of = |standing: &str| {
        files
            .iter()
            .filter(|file| file["standing"] == standing)
            .count()
    };
    assert_eq!((of("changed"), of("missing")), (1, 1));
    assert_eq!(answer["as_stored"], files.len() - 2);

    std::fs::write(&traces, text).unwrap();
    std::fs::write(&input, measured).unwrap();
    let said = cohort.call(&["verify"]).expect(0);
    said.complains_of(&["not checked", "models/*/model.toml"]);
    cohort.call(&["export"]).expect(0);

    // A copy of cohort and run is checked against its own files.
    let elsewhere = tempfile::tempdir().unwrap();
    let copy = elsewhere.path().join("copy");
    let copied = std::process::Command::new("cp")
        .args(["-r".as_ref(), cohort.path().as_os_str(), copy.as_os_str()])
        .status();
    assert!(copied.unwrap().success());
    std::fs::write(&input, "0,0\n").unwrap();
    let said = cardiotwin(&copy, &["verify"]).expect(0);
    said.complains_of(&["the cohort's files are those in", "/copy;"]);
    let own = copy.join("patients/01-CoA/pressure.csv");
    std::fs::write(&own, "0,0\n").unwrap();
    let said = cardiotwin(&copy, &["verify", "--json"]).expect(1);
    assert!(
        said.out.contains("copy/patients/01-CoA/pressure.csv"),
        "{}",
        said.out
    );
    let said = cardiotwin(&copy, &["export"]).expect(1);
    said.complains_of(&["copy/patients/01-CoA/pressure.csv was changed"]);
}
