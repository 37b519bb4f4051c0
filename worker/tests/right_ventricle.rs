//! A patient whose own mesh has both ventricles: step 0 and a beat.

mod support;

use std::fmt::Write as _;
use std::path::Path;

use cardiotwin_mesh::files::{LengthUnit, carp};
use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_schemas::finite_element::{
    FiniteElementSettings, MeshFibres, OwnMesh, OwnRightVentricle, RightPressureSpec, SurfaceSpring,
};
use cardiotwin_schemas::muscle::PassiveTissueSettings;
use cardiotwin_schemas::organ::{ContractionSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, PassiveStateResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, PassiveStateSpec, TaskSpec};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::finite_element::StoredVentricle;
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, input, passive_state, step0};

fn settings() -> FiniteElementSettings {
    let mut settings = FiniteElementSettings {
        tolerance: 1e-3,
        ..FiniteElementSettings::default()
    };
    settings.wall.passive.insert(
        2,
        PassiveTissueSettings {
            mu_kpa: 40.0,
            kappa_kpa: 1000.0,
        },
    );
    settings
}

/// Ambit's bi-ventricle, whose right wall has the tag 2, as the mesh of a patient with the
/// pressures of 01-CoA.
fn own_mesh(pressure: RightPressureSpec) -> OwnMesh {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/meshes/ambit_biv");
    let stem = folder.join("ambit_biv");
    let mesh = carp::read(&stem, LengthUnit::Micrometre).unwrap();
    let endings = [
        "pts",
        "elem",
        "endocardium.surf",
        "endo_rv.surf",
        "epicardium.surf",
        "rim.surf",
    ];
    OwnMesh {
        files: endings
            .map(|ending| input("mesh", &folder.join(format!("ambit_biv.{ending}"))))
            .to_vec(),
        unit: "um".to_owned(),
        left_ventricle: vec![1],
        fibres: MeshFibres::Rule,
        activation_times: None,
        activation_sites_mm: Landmarks::of(&mesh).unwrap().usual_sites_mm(&mesh),
        right_ventricle: Some(OwnRightVentricle {
            surface: "endo_rv".to_owned(),
            pressure,
        }),
    }
}

fn spec(pressure: RightPressureSpec) -> PassiveStateSpec {
    PassiveStateSpec {
        volume: None,
        end_diastolic_volume_ml: Some(116.1),
        diastasis_time_ms: None,
        diastasis_volume_ml: None,
        wall_volume_ml: None,
        finite_element: Some(settings().anatomy(&[])),
        own_mesh: Some(own_mesh(pressure)),
        ..step0("01-CoA")
    }
}

fn made(pressure: RightPressureSpec, folder: &Path) -> PassiveStateResult {
    std::fs::create_dir(folder).unwrap();
    passive_state(&spec(pressure), &mut Context::plain(folder, 2))
}

fn beat(state: &PassiveStateResult, cycle_length_ms: f64, folder: &Path) -> OrganBeatResult {
    let parameters = Step1Parameters::default();
    let contraction = ContractionSpec::Tanh {
        parameters: parameters.tanh,
    };
    let spec = OrganBeatSpec {
        time_step_ms: 2.0,
        finite_element: Some(settings().equations()),
        ..beat_spec(cycle_length_ms, state, &parameters, contraction)
    };
    match run_task(
        &TaskSpec::OrganBeat(Box::new(spec)),
        &mut Context::plain(folder, 2),
    ) {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => result,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

/// Pressure of a right ventricle: 5 mmHg in diastole, 25 mmHg in systole.
fn trace(folder: &Path, cycle_ms: f64) -> RightPressureSpec {
    let mut text = "time_ms,pressure_mmHg\n".to_owned();
    for t in (0..cycle_ms as u32).step_by(5) {
        let systole = ((f64::from(t) - 30.0) / 300.0).clamp(0.0, 1.0) * std::f64::consts::PI;
        writeln!(text, "{t},{}", 5.0 + 20.0 * systole.sin().powi(2)).unwrap();
    }
    let path = folder.join("right.csv");
    std::fs::write(&path, text).unwrap();
    RightPressureSpec::Trace {
        file: input("right ventricle's pressure", &path),
    }
}

#[test]
fn a_patient_with_both_ventricles_runs_through_step_0_and_a_beat() {
    let folder = tempfile::tempdir().unwrap();
    let cycle_ms = step0("01-CoA").cycle_length_ms;
    let at = |name: &str| folder.path().join(name);
    let low = made(
        RightPressureSpec::Constant { pressure_mmhg: 5.0 },
        &at("low"),
    );
    assert!(
        (low.counters["right_ventricular_volume_mL"] - 83.8).abs() < 0.1,
        "{:?}",
        low.counters
    );
    assert!(
        low.remarks
            .iter()
            .any(|r| r.contains("83.8 mL") && r.contains("5.0 mmHg")),
        "{:?}",
        low.remarks
    );
    let OrganSpec::FiniteElement(organ) = &low.organ else {
        panic!("another organ")
    };
    assert!(
        (organ.figures.end_diastolic_volume_ml - 116.1).abs() < 0.3,
        "{:?}",
        organ.figures
    );
    let stored = StoredVentricle::read(&organ.ventricle).unwrap();
    assert!(
        stored
            .about
            .surfaces
            .iter()
            .any(|name| name == "right-ventricle"),
        "{:?}",
        stored.about.surfaces
    );

    let systolic = made(trace(folder.path(), cycle_ms), &at("systolic"));
    let OrganSpec::FiniteElement(of_trace) = &systolic.organ else {
        panic!("another organ")
    };
    let [a, b] = [organ, of_trace].map(|organ| organ.figures);
    assert!(
        (b.stiffness_kpa / a.stiffness_kpa - 1.0).abs() < 1e-3,
        "both begin at 5 mmHg: {a:?} {b:?}"
    );
    let beats = [(&low, "low"), (&systolic, "systolic")]
        .map(|(state, name)| beat(state, cycle_ms, &at(name)));
    let peak = beats
        .each_ref()
        .map(|beat| beat.biomarkers.p_max_mmhg.expect("a pressure"));
    assert!(beats.iter().all(|beat| beat.failed_check().is_none()));
    assert!(
        (peak[1] - peak[0]).abs() > 0.1,
        "the right ventricle's systole is felt in the left: {peak:?} mmHg"
    );
    // Rule-based fibres rotate across the septum as across the free wall, so that the apex twists
    // against the base.
    let twist = beats
        .each_ref()
        .map(|beat| beat.motion.as_ref().expect("followed").twist_epi_deg);
    assert!(twist.iter().all(|degrees| *degrees > 5.0), "{twist:?}°");
}

#[test]
fn surfaces_that_are_not_there_and_pressures_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let constant = || RightPressureSpec::Constant { pressure_mmhg: 5.0 };
    let refused = |spec: PassiveStateSpec| match run_task(
        &TaskSpec::PassiveState(Box::new(spec)),
        &mut Context::plain(folder.path(), 1),
    ) {
        Ending::Failed { failure } => failure.message,
        other => panic!("{other:?}"),
    };
    let named = |surface: &str| {
        let right_ventricle = Some(OwnRightVentricle {
            surface: surface.to_owned(),
            pressure: constant(),
        });
        PassiveStateSpec {
            own_mesh: Some(OwnMesh {
                right_ventricle,
                ..own_mesh(constant())
            }),
            ..spec(constant())
        }
    };
    let missing = refused(named("rv"));
    assert!(
        missing.contains("no surface named rv") && missing.contains("endo_rv"),
        "{missing}"
    );
    let left = refused(named("endocardium"));
    assert!(
        left.contains("which is not the right ventricle's"),
        "{left}"
    );
    let mut settings = settings();
    settings.wall.surface.insert(
        "lung".to_owned(),
        SurfaceSpring {
            spring_kpa_per_mm: 1.0,
            ..SurfaceSpring::default()
        },
    );
    let sprung = PassiveStateSpec {
        finite_element: Some(settings.anatomy(&[])),
        ..spec(constant())
    };
    let lung = refused(sprung.clone());
    assert!(
        lung.contains("no surface named lung")
            && lung.contains("solver.finite_element.wall.surface"),
        "{lung}"
    );
    let generated = refused(PassiveStateSpec {
        own_mesh: None,
        ..sprung
    });
    assert!(
        generated.contains("solver.finite_element.wall.surface.lung"),
        "{generated}"
    );
    let empty = refused(PassiveStateSpec {
        end_diastolic_pressure_mmhg: Some(0.0),
        ..spec(constant())
    });
    assert!(
        empty.contains("the right ventricle has 5.00 mmHg"),
        "{empty}"
    );
}
