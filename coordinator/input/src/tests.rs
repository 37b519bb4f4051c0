//! Tests of whole cohorts in temporary folders, each with one error.

use std::path::Path;

use super::{Cohort, Options, Report, load};

pub(super) const COHORT: &str = "name = \"c\"\n";
pub(super) const PATIENT: &str = "id = \"P1\"\ncycle_length_ms = 700\n\n[measured]\npressure = \"pressure.csv\"\nvolume = \"volume.csv\"\n\
                       end_diastolic_pressure_mmHg = 9\n\n[preload]\nleft_atrial_pressure_mmHg = 7\n";

/// A plain beat of 700 ms: pressure every 2 ms, volume every 10 ms.
fn write_traces(folder: &Path) {
    use std::fmt::Write as _;
    let (mut pressure, mut volume) = (
        "time_ms,pressure_mmHg\n".to_owned(),
        "time_ms,volume_mL\n".to_owned(),
    );
    for i in 0..350 {
        let t = 2.0 * f64::from(i);
        let rise = 1.0 / (1.0 + (-(t - 80.0) / 12.0).exp());
        let fall = 1.0 / (1.0 + ((t - 330.0) / 20.0).exp());
        let _ = writeln!(pressure, "{t},{:.3}", 9.0 + 110.0 * rise * fall);
    }
    for i in 0..70 {
        let t = 10.0 * f64::from(i);
        let ejected = 1.0 / (1.0 + (-(t - 200.0) / 30.0).exp());
        let filled = 1.0 / (1.0 + (-(t - 450.0) / 25.0).exp());
        let _ = writeln!(volume, "{t},{:.3}", 120.0 - 70.0 * (ejected - filled));
    }
    std::fs::write(folder.join("pressure.csv"), pressure).unwrap();
    std::fs::write(folder.join("volume.csv"), volume).unwrap();
}

pub(super) struct Folder(tempfile::TempDir);

impl Folder {
    pub(super) fn new(cohort: &str, patients: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("cohort.toml"), cohort).unwrap();
        for (name, text) in patients {
            let patient = folder.path().join("patients").join(name);
            std::fs::create_dir_all(&patient).unwrap();
            std::fs::write(patient.join("patient.toml"), text).unwrap();
            write_traces(&patient);
        }
        Self(folder)
    }

    pub(super) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(super) fn load(&self, options: &Options) -> (Option<Cohort>, Vec<String>) {
        let mut report = Report::default();
        let cohort = load(self.0.path(), options, &mut report);
        let root = format!("{}/", self.0.path().display());
        let said = report
            .findings()
            .iter()
            .map(|f| f.problem.to_string().replace(&root, ""))
            .collect();
        (cohort, said)
    }

    fn said(&self) -> Vec<String> {
        self.load(&Options::default()).1
    }
}

fn one(cohort: &str, patient: &str) -> Vec<String> {
    Folder::new(cohort, &[("P1", patient)]).said()
}

#[track_caller]
pub(super) fn only(said: &[String], parts: &[&str]) {
    assert_eq!(said.len(), 1, "{said:#?}");
    for part in parts {
        assert!(said[0].contains(part), "{part:?} is not in {:?}", said[0]);
    }
}

#[test]
fn a_good_cohort_resolves_with_hashed_files() {
    let folder = Folder::new(COHORT, &[("P1", PATIENT)]);
    let (cohort, said) = folder.load(&Options::default());
    assert_eq!(said, Vec::<String>::new());
    let plans = cohort.unwrap().plans();
    let pressure = plans[0].step0.pressure.as_ref().unwrap();
    assert!(pressure.path.is_absolute() && pressure.sha256.len() == 64);
    assert_eq!(plans[0].step0.left_atrial_pressure_mmhg, Some(7.0));
}

#[test]
fn the_bundled_cohort_has_no_errors() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/coa-seven");
    let mut report = Report::default();
    let cohort = load(&directory, &Options::default(), &mut report).unwrap();
    assert_eq!(report.n_errors(), 0, "{:#?}", report.findings());
    assert_eq!(cohort.plans().len(), 7);
}

#[test]
fn settings_are_layered_per_patient_and_keep_their_origin() {
    let own = format!("{PATIENT}\n[settings.step1]\ndamping = 0.8\nstop = 'best-of-limit'\n");
    let folder = Folder::new(
        "name = \"c\"\n[step1]\ndamping = 0.9\ntolerance = 0.2\n",
        &[("P1", &own), ("P2", &PATIENT.replace("P1", "P2"))],
    );
    let options = Options {
        overrides: [(
            "P2".to_owned(),
            serde_json::json!({"step1": {"damping": 0.5}}),
        )]
        .into(),
        set: vec!["step1.tolerance=0.05".into(), "step1.damping=0.95".into()],
        ..Options::default()
    };
    let (cohort, said) = folder.load(&options);
    assert_eq!(said, Vec::<String>::new());
    let cohort = cohort.unwrap();
    let damping = |i: usize| cohort.patients[i].settings.settings.step1.damping;
    assert_eq!(
        (damping(0), damping(1)),
        (0.95, 0.5),
        "a rerun wins over --set, --set over files"
    );
    assert_eq!(cohort.settings.settings.step1.damping, 0.95);
    let origin = |i: usize, key: &str| cohort.patients[i].settings.origin(key).to_string();
    assert_eq!(origin(0, "step1.damping"), "--set");
    assert!(
        origin(0, "step1.stop").ends_with("patients/P1/patient.toml:14"),
        "{}",
        origin(0, "step1.stop")
    );
    assert_eq!(origin(1, "step1.damping"), "rerun");
    assert_eq!(origin(1, "step1.tolerance"), "--set");
}

#[test]
fn pressure_alone_and_biomarkers_alone_are_enough() {
    let alone = PATIENT.replace(
        "volume = \"volume.csv\"\n",
        "end_diastolic_volume_mL = 120\n",
    );
    assert_eq!(one(COHORT, &alone), Vec::<String>::new());
    let biomarkers = "id = \"P1\"\ncycle_length_ms = 700\n[measured]\nend_diastolic_pressure_mmHg = 9\n\
                      end_diastolic_volume_mL = 120\n[measured.biomarkers]\nP_max_mmHg = 120\nPTD90_ms = 400\n\
                      dPdt_max_mmHg_per_ms = 1.5\ndPdt_min_mmHg_per_ms = -1.2\n";
    let (cohort, said) = Folder::new(COHORT, &[("P1", biomarkers)]).load(&Options::default());
    assert_eq!(said, Vec::<String>::new());
    assert_eq!(
        cohort.unwrap().plans()[0].step0.biomarkers.p_max_mmhg,
        Some(120.0)
    );
    let said = one(COHORT, &biomarkers.replace("PTD90_ms = 400\n", ""));
    only(&said, &["patient.toml:3", "measured", "PTD90_ms"]);
}

#[test]
fn neither_volume_nor_image_is_an_error() {
    only(
        &one(COHORT, &PATIENT.replace("volume = \"volume.csv\"\n", "")),
        &["end_diastolic_volume_mL", "no volume trace"],
    );
}

#[test]
fn the_id_must_be_the_folders_name_and_unique() {
    only(
        &one(COHORT, &PATIENT.replace("P1", "P2")),
        &[
            "patients/P1/patient.toml:1",
            "id",
            "\"P2\"",
            "the folder's name",
        ],
    );
    let said = Folder::new(COHORT, &[("P1", PATIENT), ("P1-copy", PATIENT)]).said();
    assert!(
        said.iter()
            .any(|s| s.contains("in the folders P1 and P1-copy")),
        "{said:#?}"
    );
    only(
        &Folder::new(COHORT, &[("P 1", &PATIENT.replace("P1", "P 1"))]).said(),
        &["id", "letters, digits"],
    );
}

#[test]
fn missing_traces_empty_cohorts_and_missing_files() {
    only(
        &one(COHORT, &PATIENT.replace("volume.csv", "vol.csv")),
        &["patient.toml:6", "measured.volume", "no file"],
    );
    only(
        &Folder::new(COHORT, &[]).said(),
        &["cohort.toml", "patients", "no readable folder"],
    );
    let empty = Folder::new(COHORT, &[]);
    std::fs::create_dir(empty.0.path().join("patients")).unwrap();
    only(&empty.said(), &["no patient folder"]);
    std::fs::create_dir(empty.0.path().join("patients/P1")).unwrap();
    only(
        &empty.said(),
        &["patients/P1/patient.toml", "no readable file"],
    );
    std::fs::remove_file(empty.0.path().join("cohort.toml")).unwrap();
    only(
        &empty.said(),
        &["cohort.toml", "no readable file", "cardiotwin init"],
    );
}

#[test]
fn a_setting_out_of_range_is_said_once_where_it_stands() {
    let patients: Vec<(String, String)> = ["P1", "P2", "P3"]
        .iter()
        .map(|id| ((*id).to_owned(), PATIENT.replace("P1", id)))
        .collect();
    let patients: Vec<(&str, &str)> = patients
        .iter()
        .map(|(id, text)| (id.as_str(), text.as_str()))
        .collect();
    let folder = Folder::new("name = \"c\"\n[step1]\ntolerance = -1\n", &patients);
    only(
        &folder.said(),
        &["cohort.toml:3", "step1.tolerance", "found -1"],
    );
}

#[test]
fn a_default_in_conflict_is_said_where_the_conflict_was_made() {
    let own = format!("{PATIENT}\n[settings.step1.bounds]\nt_CR_ms = [100, 500]\n");
    only(
        &one(COHORT, &own),
        &[
            "patients/P1/patient.toml:13",
            "settings.step1.initial.t_CR_ms",
            "550",
        ],
    );
}

#[test]
fn problems_of_all_files_come_at_once() {
    let folder = Folder::new(
        "nam = \"c\"\n[step1]\ndampin = 2\n[step2]\npopsize = \"many\"\n",
        &[
            (
                "P1",
                &PATIENT.replace("cycle_length_ms = 700", "cycle_length_ms = 0.7"),
            ),
            (
                "P2",
                "id = \"P2\"\n[measured]\npressure = 'pressure.csv'\nvolume = 'volume.csv'\n",
            ),
            ("P3", "id = \"P3\ncycle_length_ms = 700\n"),
        ],
    );
    let said = folder.said();
    for part in [
        "did you mean `name`?",
        "did you mean `damping`?",
        "step2.popsize",
        "looks like seconds",
        "add `cycle_length_ms`",
        "patients/P3/patient.toml:1:9: found a syntax error",
    ] {
        assert!(
            said.iter().any(|s| s.contains(part)),
            "{part:?} is not in {said:#?}"
        );
    }
}

#[test]
fn a_unit_after_a_number_is_one_error_that_says_what_to_write() {
    for value in ["700 ms", "700ms", "700.0 ms # of the ECG"] {
        let text = PATIENT.replace(
            "cycle_length_ms = 700",
            &format!("cycle_length_ms = {value}"),
        );
        assert_ne!(text, PATIENT);
        let number = value
            .trim_end_matches(" # of the ECG")
            .trim_end_matches("ms");
        let remedy = format!("write {} alone", number.trim_end());
        only(&one(COHORT, &text), &["found `700", &remedy]);
    }
}

#[test]
fn start_at_diastasis_needs_the_image() {
    let text = "name = \"c\"\n[solver]\nstart = \"diastasis\"\n";
    only(&one(text, PATIENT), &["measured.diastasis", "solver.start"]);
}

#[test]
fn an_atrial_pressure_of_the_cohort_above_a_patients_own_filling_pressure() {
    let text = PATIENT.replace("[preload]\nleft_atrial_pressure_mmHg = 7\n", "");
    let said = one(
        "name = \"c\"\n[defaults]\nleft_atrial_pressure_mmHg = 15\n",
        &text,
    );
    only(
        &said,
        &[
            "preload.left_atrial_pressure_mmHg",
            "[defaults] of cohort.toml",
        ],
    );
}

#[test]
fn impossible_numbers_of_a_patient_are_named() {
    let with = |extra: &str| one(COHORT, &format!("{PATIENT}\n{extra}\n"));
    only(
        &with("[anatomy]\nwall_volume_mL = -5"),
        &["anatomy.wall_volume_mL", "found -5 mL"],
    );
    only(
        &with("[measured.diastasis]\ntime_ms = 900\nvolume_mL = 80"),
        &["measured.diastasis.time_ms", "within the beat"],
    );
    only(
        &with("[measured.aortic_pressure]\nsystolic_mmHg = 70\ndiastolic_mmHg = 110"),
        &["measured.aortic_pressure.diastolic_mmHg", "swap"],
    );
    only(
        &with("[measured.biomarkers]\ndPdt_min_mmHg_per_ms = 1.5"),
        &["dPdt_min", "found 1.5"],
    );
    only(
        &with(
            "[afterload]\ncharacteristic_resistance_mmHg_s_per_mL = 0.03\nperipheral_resistance_mmHg_s_per_mL = 900\ncompliance_mL_per_mmHg = 1",
        ),
        &["peripheral_resistance", "900 dyn s/cm5 is 0.6751 mmHg s/mL"],
    );
}

#[test]
fn an_overlay_must_be_the_patients_own_and_its_effects_are_taken() {
    let folder = Folder::new(COHORT, &[("P1", PATIENT)]);
    let path = folder.0.path().join("patients/P1/model.toml");
    let overlay = |patient: &str| {
        format!(
            "version = 1\npatient = \"{patient}\"\nwritten = \"2026-01-01T00:00:00.000Z\"\n[from]\n[[effects]]\nname = \"atrial_kick\"\n\
             parameters = {{ amplitude_mmHg = 4.0 }}\n"
        )
    };
    std::fs::write(&path, overlay("P1")).unwrap();
    let (cohort, said) = folder.load(&Options::default());
    assert_eq!(said, Vec::<String>::new());
    assert_eq!(
        cohort.unwrap().plans()[0].effects[0].parameters["amplitude_mmHg"],
        4.0
    );
    std::fs::write(&path, overlay("P7")).unwrap();
    only(&folder.said(), &["model.toml:2", "patient", "\"P7\""]);
}

#[test]
fn an_empty_cut_or_foreign_model_is_said() {
    let folder = Folder::new(COHORT, &[("P1", PATIENT)]);
    let path = folder.path().join("patients/P1/model.toml");
    let whole = "schema_version = 1\npatient = \"P1\"\nwritten = \"2026-01-01\"\n";
    std::fs::write(&path, "").unwrap();
    let said = folder.said();
    assert!(
        said.iter().any(|line| line.contains("model.toml")),
        "{said:?}"
    );
    std::fs::write(&path, &whole[..30]).unwrap();
    let said = folder.said();
    assert!(
        said.iter().any(|line| line.contains("model.toml:2")),
        "{said:?}"
    );
    std::fs::write(&path, "[tool.poetry]\nname = \"foreign\"\n").unwrap();
    let said = folder.said();
    assert!(
        said.iter().any(|line| line.contains("model.toml:1")),
        "{said:?}"
    );
}

#[test]
fn files_outside_the_cohort_are_read_only_if_the_cohort_allows_it() {
    let outside = tempfile::tempdir().unwrap();
    write_traces(outside.path());
    let named = PATIENT.replace(
        "\"pressure.csv\"",
        &format!("{:?}", outside.path().join("pressure.csv")),
    );
    let folder = Folder::new(COHORT, &[("P1", &named)]);
    only(
        &folder.said(),
        &[
            "patient.toml:5",
            "measured.pressure",
            "outside the cohort",
            "allow_outside",
        ],
    );
    let allowed = format!("{COHORT}allow_outside = true\n");
    assert_eq!(
        Folder::new(&allowed, &[("P1", &named)]).said(),
        Vec::<String>::new()
    );

    // A link is followed before it is judged; a linked folder of a patient is the user's own doing.
    let folder = Folder::new(COHORT, &[("P1", PATIENT)]);
    let volume = folder.path().join("patients/P1/volume.csv");
    std::fs::remove_file(&volume).unwrap();
    std::os::unix::fs::symlink(outside.path().join("volume.csv"), &volume).unwrap();
    only(
        &folder.said(),
        &["patient.toml:6", "measured.volume", "outside the cohort"],
    );
    let elsewhere = Folder::new(COHORT, &[("P1", PATIENT)]);
    std::fs::remove_dir_all(folder.path().join("patients/P1")).unwrap();
    std::os::unix::fs::symlink(
        elsewhere.path().join("patients/P1"),
        folder.path().join("patients/P1"),
    )
    .unwrap();
    assert_eq!(folder.said(), Vec::<String>::new());
}

#[test]
fn an_unknown_patient_is_refused_with_the_nearest() {
    let options = Options {
        only: vec!["P11".into()],
        ..Options::default()
    };
    let (_, said) = Folder::new(COHORT, &[("P1", PATIENT)]).load(&options);
    only(&said, &["--patient", "did you mean `P1`?"]);
}
