//! Patients with the finite-element ventricle as organ: pictures, spread over the nodes, cost,
//! results before and after effects.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_report::html::{Pages, write_report};
use cardiotwin_schemas::finite_element::{FiniteElementOrgan, VentricleFigures};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::heart::{HeartBeat, HeartSurface, PackedValues, packed_points};
use cardiotwin_schemas::organ::{EffectSpec, OrganSpec};
use cardiotwin_schemas::outcome::Artefact;
use cardiotwin_schemas::record::{BeforeEffects, PatientRecord, RunRecord, TaskRecord};
use cardiotwin_schemas::task::InputFile;

use crate::browser::Browser;
use crate::{assert_self_contained, fixture, html, organ_law, words};

/// Largest size of a patient's four pictures, bytes. Measured: 129 kB.
const BYTES: usize = 150_000;

/// `heart.json` of a beat of 02-CoA on 500 nodes.
const HEART: &str = include_str!("heart.json");

fn keep<T>(record: &mut TaskRecord<T>, name: &str, file: &str, text: &str) {
    std::fs::write(record.directory.join(file), text).unwrap();
    let (sha256, bytes) = (sha256_hex(text.as_bytes()), text.len() as u64);
    record.artefacts.push(Artefact {
        name: name.into(),
        file: file.into(),
        sha256,
        bytes,
    });
}

fn spread() -> String {
    let mut text = "time_ms".to_owned();
    for name in ["Sa_kPa", "lambda"] {
        [5, 25, 50, 75, 95]
            .iter()
            .for_each(|level| text.push_str(&format!(",{name}_p{level}")));
    }
    for t in 0..400 {
        let rise = (f64::from(t) / 400.0 * std::f64::consts::PI).sin();
        text.push_str(&format!("\n{t}"));
        [30.0, 40.0, 50.0, 60.0, 70.0]
            .iter()
            .for_each(|peak| text.push_str(&format!(",{:.3}", peak * rise)));
        [0.76, 0.78, 0.8, 0.83, 0.9]
            .iter()
            .for_each(|least| text.push_str(&format!(",{:.4}", 1.0 - (1.0 - least) * rise)));
    }
    text + "\n"
}

fn counters(values: &[(&str, f64)]) -> BTreeMap<String, f64> {
    values
        .iter()
        .map(|(name, value)| ((*name).to_owned(), *value))
        .collect()
}

fn make_3d(patient: &mut PatientRecord, with_pictures: bool) {
    let step0 = patient.step0.as_mut().unwrap();
    let figures = VentricleFigures {
        nodes: 498,
        elements: 1878,
        degrees_of_freedom: 1494,
        mean_edge_mm: 10.1,
        wall_volume_ml: 120.0,
        image_volume_ml: 138.5,
        image_pressure_mmhg: 5.0,
        unloaded_volume_ml: 71.0,
        end_diastolic_volume_ml: 150.0,
        end_diastolic_pressure_mmhg: 7.0,
        stiffness_kpa: 0.42,
        exponent_factor: 0.8,
        onset_ms: 30.0,
        spread_ms: 50.0,
        epicardial_duration_share: 0.9,
    };
    let ventricle = InputFile {
        name: "ventricle".into(),
        path: PathBuf::from("ventricle.bin"),
        sha256: "0".into(),
    };
    step0.result.organ =
        OrganSpec::FiniteElement(Box::new(FiniteElementOrgan { ventricle, figures }));
    step0.result.counters = counters(&[
        ("seconds_mesh", 0.02),
        ("seconds_fibres", 0.003),
        ("seconds_activation", 0.05),
        ("mesh_mean_ratio_least", 0.45),
    ]);
    for run in patient.iterations.iter_mut().filter_map(|i| i.run.as_mut()) {
        run.result.counters = counters(&[
            ("time_steps", 660.0),
            ("cut_steps", 3.0),
            ("newton_iterations", 1320.0),
            ("newton_iterations_tried", 1340.0),
            ("krylov_iterations", 33_500.0),
            ("seconds_setup", 0.1),
            ("seconds_beat", 4.2),
        ]);
        if with_pictures {
            keep(run, "heart", "heart.json", &beating());
        }
    }
    if with_pictures {
        keep(
            patient.targets.as_mut().unwrap(),
            "spread",
            "spread.csv",
            &spread(),
        );
    }
}

/// [`HEART`] with frames that lead from its first state to the second and back, and without a half
/// in front of the cut.
fn beating() -> String {
    let mut heart: HeartSurface = serde_json::from_str(HEART).unwrap();
    let [begin, end] = heart.states.as_slice() else {
        panic!("two states are drawn")
    };
    let shares: Vec<f64> = (0..=24)
        .map(|k| (f64::from(k) / 24.0 * std::f64::consts::PI).sin().powi(2))
        .collect();
    let between = |a: f64, b: f64, share: f64| a + share * (b - a);
    let place = |share: f64| {
        let pairs = std::iter::zip(&begin.points_mm, &end.points_mm);
        pairs
            .map(|(a, b)| std::array::from_fn(|i| between(a[i], b[i], share)))
            .collect()
    };
    let frames: Vec<Vec<[f64; 3]>> = shares.iter().map(|share| place(*share)).collect();
    let packed = |a: &[Option<f64>], b: &[Option<f64>]| {
        let at = |share: &f64| -> Vec<Option<f64>> {
            std::iter::zip(a, b)
                .map(|(a, b)| Some(between((*a)?, (*b)?, *share)))
                .collect()
        };
        PackedValues::of(&shares.iter().flat_map(at).collect::<Vec<_>>())
    };
    let (origin_mm, step_mm, points) = packed_points(&frames);
    let of = |a: f64, b: f64| shares.iter().map(|share| between(a, b, *share)).collect();
    heart.beat = Some(HeartBeat {
        time_ms: (0..=24).map(|k| 25.0 * f64::from(k)).collect(),
        volume_ml: of(begin.volume_ml, end.volume_ml),
        pressure_mmhg: of(begin.pressure_mmhg, end.pressure_mmhg),
        origin_mm,
        step_mm,
        points,
        sa_kpa: packed(&begin.sa_kpa, &end.sa_kpa),
        lambda: packed(&begin.lambda, &end.lambda),
        front: vec![],
    });
    serde_json::to_string(&heart).unwrap()
}

/// One patient with everything that can be shown, and one whose simulations were made before
/// pictures were kept.
pub fn run(root: &Path) -> RunRecord {
    let mut run = fixture::cohort(root);
    run.patients.truncate(2);
    let [shown, old] = run.patients.as_mut_slice() else {
        unreachable!("two are left")
    };
    make_3d(shown, true);
    make_3d(old, false);
    organ_law::teach(shown);
    organ_law::propose(old, None);
    shown.plan.effects = vec![EffectSpec {
        name: "atrial_kick".into(),
        parameters: BTreeMap::new(),
    }];
    let mut step1 = shown.iterations[0].run.clone().unwrap();
    step1.result.biomarkers.end_of_beat_gap_ml = Some(10.04);
    shown.before = Some(Box::new(BeforeEffects {
        step1: Some(step1),
        verification: None,
    }));
    old.plan.effects = shown.plan.effects.clone();
    run
}

pub fn written() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    write_report(&run(folder.path()), None, Pages::All, &out).unwrap();
    (folder, out)
}

#[test]
fn a_3d_patient_has_pictures_spread_cost_and_what_an_effect_changed() {
    let (_folder, out) = written();
    let page = html(&out);
    assert_self_contained(&page);
    assert_eq!(page.matches("<svg class=\"heart\"").count(), 4);
    let pictures: usize = page
        .split("<svg class=\"heart\"")
        .skip(1)
        .map(|p| p.find("</svg>").unwrap())
        .sum();
    eprintln!(
        "pictures of a 3D patient: {pictures} bytes; the page with one more patient: {}",
        page.len()
    );
    assert!(pictures < BYTES, "{pictures} bytes");
    let text = words(&page);
    for expected in [
        "cut open along its long axis through the middle of the septum (left)",
        "active stress 0",
        "End-systole , fibre stretch",
        "Fibre stretch of the nodes : median, half and nine tenths of the wall",
        "edge: shortest / mean / longest – / 10.10 / – mm",
        "time: activation 50 ms",
        "step 1, iteration 1 660 3 2.00 25.0 100 ms 4.2 s",
        "Before and after: atrial kick",
        "volume gap at the beat's end mL 10.0",
        "misfit of the volume in late filling mL",
        "No picture: this simulation was computed by a version of the program that stored none.",
        "No spread over the nodes",
        "Accepted: atrial kick. This run has not simulated this ventricle without",
    ] {
        assert!(text.contains(expected), "missing: {expected}\n{text}");
    }
}

#[test]
fn a_damaged_picture_is_a_sentence_and_a_reduced_patient_has_none_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let mut run = run(folder.path());
    let best = run.patients[0].step1.as_ref().unwrap().best_iteration as usize;
    let beat = run.patients[0].iterations[best - 1].run.as_ref().unwrap();
    let file = beat.artefact("heart").unwrap();
    std::fs::write(&file, HEART.replacen("\"surface\"", "\"part\"", 1)).unwrap();
    write_report(&run, None, Pages::All, &out).unwrap();
    let page = html(&out);
    assert!(!page.contains("<svg class=\"heart\""));
    assert!(
        words(&page).contains(
            "heart.json: cannot be read as heart surface of version 1: missing field `surface`"
        ),
        "{}",
        words(&page)
    );

    run = fixture::cohort(folder.path());
    write_report(&run, None, Pages::All, &out).unwrap();
    assert!(!html(&out).contains("3D ventricle") && !html(&out).contains("svg.heart"));
}

#[test]
fn the_pictures_are_seen_in_both_themes_and_on_a_narrow_screen() {
    let Some(browser) = Browser::find() else {
        return;
    };
    let (_folder, out) = written();
    let script = r#"return [...document.querySelectorAll("svg.heart")].map((svg) => {
      const box = svg.getBoundingClientRect();
      const paths = [...svg.querySelectorAll("path:not([class=edge]):not([class=ghost]):not([class=scale])")];
      const outside = paths.filter((p) => { const b = p.getBoundingClientRect();
        return b.left < box.left - 1 || b.right > box.right + 1 || b.top < box.top - 1 || b.bottom > box.bottom + 1; });
      return { w: box.width, h: box.height, n: paths.length, outside: outside.length,
        colours: new Set(paths.map((p) => getComputedStyle(p).fill)).size, unpainted: paths.filter((p) => getComputedStyle(p).fill === "none").length };
    });"#;
    for (fragment, window) in [
        ("#all", (1400, 3000)),
        ("#all dark", (1400, 3000)),
        ("#01-CoA/ventricle", (500, 3000)),
    ] {
        assert_eq!(browser.complaints(&out, fragment, window), [""; 0]);
        let found = browser.measure(&out, fragment, window, script);
        let pictures = found.as_array().unwrap();
        assert_eq!(pictures.len(), 4);
        for (k, picture) in pictures.iter().enumerate() {
            let number = |name: &str| picture[name].as_f64().unwrap();
            assert!(
                number("w") > 120.0 && number("h") > 120.0 && number("outside") == 0.0,
                "{picture}"
            );
            assert!(
                number("unpainted") == 0.0 && number("n") > 100.0,
                "{picture}"
            );
            // Even at end-diastole there are shades of one colour and of the grey root.
            assert!(
                number("colours") >= if k % 2 == 0 { 4.0 } else { 20.0 },
                "{k}: {picture}"
            );
        }
        // View and scale are the same at both instants.
        let height = |k: usize| pictures[k]["h"].as_f64().unwrap();
        assert!(
            (1..4).all(|k| (height(k) - height(0)).abs() < 0.5),
            "{pictures:?}"
        );
    }
}
