//! Tests of patients whose own mesh has both ventricles, or surfaces with springs.

use cardiotwin_schemas::finite_element::{OwnRightVentricle, RightPressureSpec};

use super::tests::{COHORT, Folder, PATIENT, only};
use super::{Cohort, Options};

const THREE_D: &str = "[solver]\nfidelity = \"finite-element\"\n";

/// A cohort of one patient with Ambit's bi-ventricle and these lines about the right ventricle, and
/// its problems.
fn said(right: &str, settings: &str, trace: Option<&str>) -> (Option<Cohort>, Vec<String>) {
    said_with("", right, settings, trace)
}

/// - `accepted`: content of `model.toml`
fn said_with(
    accepted: &str,
    right: &str,
    settings: &str,
    trace: Option<&str>,
) -> (Option<Cohort>, Vec<String>) {
    let mesh = "\n[anatomy.mesh]\nfile = \"ambit_biv\"\nunit = \"um\"\nleft_ventricle = [1]\n\
                activation_sites_mm = [[-19.2, -1.7, -41.4]]\n";
    let folder = Folder::new(
        &format!("{COHORT}{THREE_D}{settings}"),
        &[("P1", &format!("{PATIENT}{mesh}{right}"))],
    );
    let from =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/meshes/ambit_biv");
    let patient = folder.path().join("patients/P1");
    for ending in [
        "pts",
        "elem",
        "endocardium.surf",
        "epicardium.surf",
        "rim.surf",
        "endo_rv.surf",
    ] {
        let name = format!("ambit_biv.{ending}");
        std::fs::copy(from.join(&name), patient.join(&name)).unwrap();
    }
    if !accepted.is_empty() {
        std::fs::write(patient.join("model.toml"), accepted).unwrap();
    }
    if let Some(text) = trace {
        std::fs::write(patient.join("rv.csv"), text).unwrap();
    }
    folder.load(&Options {
        meshes: true,
        ..Options::default()
    })
}

fn table(lines: &str) -> String {
    format!("\n[anatomy.mesh.right_ventricle]\n{lines}\n")
}

/// Trace of a right ventricle's pressure over 700 ms, `factor` times 5 to 25 mmHg.
fn trace(factor: f64) -> String {
    use std::fmt::Write as _;
    let mut text = "time_ms,pressure_mmHg\n".to_owned();
    for t in (0..700).step_by(4) {
        let systole = (std::f64::consts::PI * f64::from(t) / 700.0).sin().powi(2);
        let _ = writeln!(text, "{t},{:.3}", factor * (5.0 + 20.0 * systole));
    }
    text
}

#[test]
fn dyssynchrony_needs_a_mesh_that_shows_where_the_septum_is() {
    let accepted = "version = 1\npatient = \"P1\"\nwritten = \"2026-01-01T00:00:00.000Z\"\n[from]\n[[effects]]\n\
                    name = \"dyssynchrony\"\nparameters = { delay_ms = 60.0 }\n";
    let right = table("surface = \"endo_rv\"\npressure_mmHg = 4");
    let said_of_it = said_with(accepted, &right, "", None).1;
    assert_eq!(said_of_it, Vec::<String>::new());
    let refused = said_with(accepted, "", "", None).1;
    let refused: Vec<String> = refused
        .into_iter()
        .filter(|said| said.contains("model.toml"))
        .collect();
    only(
        &refused,
        &[
            "dyssynchrony cannot act",
            "neither a surface `septum` nor a right ventricle",
        ],
    );
}

#[test]
fn a_right_ventricle_with_a_pressure_or_a_trace_is_taken() {
    let (cohort, said_of_it) = said(&table("surface = \"endo_rv\"\npressure_mmHg = 4"), "", None);
    assert_eq!(said_of_it, Vec::<String>::new());
    let right = |cohort: Option<Cohort>| {
        let own = cohort
            .unwrap()
            .plans()
            .remove(0)
            .step0
            .own_mesh
            .expect("a mesh");
        assert_eq!(own.files.len(), 6);
        own.right_ventricle.expect("a right ventricle")
    };
    let pressure = RightPressureSpec::Constant { pressure_mmhg: 4.0 };
    assert_eq!(
        right(cohort),
        OwnRightVentricle {
            surface: "endo_rv".to_owned(),
            pressure
        }
    );
    let of_trace = table("surface = \"endo_rv\"\npressure = \"rv.csv\"");
    let (cohort, said_of_it) = said(&of_trace, "", Some(&trace(1.0)));
    assert_eq!(said_of_it, Vec::<String>::new());
    assert!(
        matches!(right(cohort).pressure, RightPressureSpec::Trace { file } if file.path.ends_with("rv.csv"))
    );
}

#[test]
fn what_is_wrong_with_a_right_ventricle_is_said_with_key_and_line() {
    let of = |lines: &str, trace: Option<&str>| said(&table(lines), "", trace).1;
    let place = "patients/P1/patient.toml:18:15: anatomy.mesh.right_ventricle";
    only(
        &of("surface = \"endo_rv\"", None),
        &[place, "neither a pressure nor a trace", "rv_pressure.csv"],
    );
    let both = of(
        "surface = \"endo_rv\"\npressure_mmHg = 4\npressure = \"rv.csv\"",
        Some(&trace(1.0)),
    );
    only(&both, &[place, "a pressure and a trace"]);
    let high = of("surface = \"endo_rv\"\npressure_mmHg = 400", None);
    only(
        &high,
        &[
            "patient.toml:20:1: anatomy.mesh.right_ventricle.pressure_mmHg",
            "-10 to 150 mmHg",
        ],
    );
    let gone = of("surface = \"endo_rv\"\npressure = \"rv.csv\"", None);
    only(&gone, &["anatomy.mesh.right_ventricle.pressure", "rv.csv"]);
    let pascals = of(
        "surface = \"endo_rv\"\npressure = \"rv.csv\"",
        Some(&trace(133.3)),
    );
    only(
        &pascals,
        &["rv.csv", "-10 to 150 mmHg in a right ventricle"],
    );
    let named = of("surface = \"rv\"\npressure_mmHg = 4", None);
    let place = "patients/P1/patient.toml:19:1: anatomy.mesh.right_ventricle.surface";
    only(
        &named,
        &[
            place,
            "no surface named rv; surfaces there are: endo_rv, endocardium, epicardium, rim",
        ],
    );
    only(
        &of("surface = \"epicardium\"\npressure_mmHg = 4", None),
        &[place, "not the right ventricle's"],
    );
}

#[test]
fn springs_of_a_surface_that_no_mesh_has_are_said_where_they_are_set() {
    let springs = "[solver.finite_element.wall.surface.lung]\nspring_kPa_per_mm = 0.5\n";
    let of_lung = said("", springs, None).1;
    only(
        &of_lung,
        &[
            "cohort.toml:5:1: solver.finite_element.wall.surface.lung",
            "no surface named lung",
            "endo_rv",
        ],
    );
    let of_right = said("", &springs.replace("lung", "endo_rv"), None).1;
    assert_eq!(of_right, Vec::<String>::new());
    let generated = Folder::new(&format!("{COHORT}{THREE_D}{springs}"), &[("P1", PATIENT)]);
    let said = generated
        .load(&Options {
            meshes: true,
            ..Options::default()
        })
        .1;
    only(
        &said,
        &[
            "cohort.toml:5:1: solver.finite_element.wall.surface.lung",
            "no mesh of its own",
            "[settings]",
        ],
    );
    let septum = format!("{COHORT}{THREE_D}{}", springs.replace("lung", "septum"));
    let septum = Folder::new(&septum, &[("P1", PATIENT)]);
    assert_eq!(
        septum
            .load(&Options {
                meshes: true,
                ..Options::default()
            })
            .1,
        Vec::<String>::new()
    );
}
