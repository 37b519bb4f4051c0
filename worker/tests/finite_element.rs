//! Tasks of the finite-element ventricle: step 0 and beats of a bundled patient on the coarsest
//! mesh.

mod support;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use cardiotwin_mesh::LengthUnit;
use cardiotwin_mesh::files::vtu;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::finite_element::{FiniteElementSettings, VentricleFigures};
use cardiotwin_schemas::heart::HeartSurface;
use cardiotwin_schemas::muscle::{ActiveConvention, MuscleLaw, PassiveTissueSettings};
use cardiotwin_schemas::organ::{ContractionSpec, EffectSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, PassiveStateResult, TaskResult};
use cardiotwin_schemas::settings::StartMode;
use cardiotwin_schemas::task::{OrganBeatSpec, PassiveStateSpec, TaskSpec};
use cardiotwin_worker::checkpoint::Checkpoints;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::finite_element::checkpoint::{BeatCheckpoint, CheckpointError, FILE};
use cardiotwin_worker::nodal::NodalRows;
use cardiotwin_worker::tasks::run_task;
use support::{beat_spec, passive_state, step0, vtk_reader};

/// Settings for 01-CoA on the coarsest mesh, with steps of one length that suffices for these tests.
fn coarse() -> FiniteElementSettings {
    FiniteElementSettings {
        mesh_nodes: 500,
        longest_step_ms: 0.0,
        ..FiniteElementSettings::default()
    }
}

fn step0_spec() -> PassiveStateSpec {
    PassiveStateSpec {
        finite_element: Some(coarse().anatomy(&[])),
        ..step0("01-CoA")
    }
}

fn figures(state: &PassiveStateResult) -> VentricleFigures {
    match &state.organ {
        OrganSpec::FiniteElement(organ) => organ.figures,
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => panic!("another organ"),
    }
}

fn beat(state: &PassiveStateResult, cycle_length_ms: f64) -> OrganBeatSpec {
    let parameters = Step1Parameters::default();
    let contraction = ContractionSpec::Tanh {
        parameters: parameters.tanh,
    };
    OrganBeatSpec {
        cycle_length_ms,
        time_step_ms: 2.0,
        newton_iterations: coarse().newton_iterations,
        finite_element: Some(coarse().equations()),
        ..beat_spec(cycle_length_ms, state, &parameters, contraction)
    }
}

fn run(spec: &OrganBeatSpec, context: &mut Context) -> Ending {
    run_task(&TaskSpec::OrganBeat(Box::new(spec.clone())), context)
}

fn finished(ending: Ending) -> OrganBeatResult {
    match ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => result,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// `heart.json` holds a closed surface in two states. In the second, its volume is smaller, it is
/// shortened, and it is under stress.
fn the_heart_is_drawn(folder: &Path, figures: &VentricleFigures) {
    let text = read(folder, "heart.json");
    assert!(text.len() < 300_000, "{} bytes", text.len());
    let heart: HeartSurface = serde_json::from_slice(&text).unwrap();
    let [begin, end] = heart.states.as_slice() else {
        panic!("{:?}", heart.states.len())
    };
    assert_eq!(
        (begin.name.as_str(), begin.time_ms, end.name.as_str()),
        ("end-diastole", 0.0, "end-systole")
    );
    assert!(
        (begin.volume_ml - figures.end_diastolic_volume_ml).abs() < 0.01
            && end.volume_ml < begin.volume_ml
    );
    let n = begin.points_mm.len();
    let mut seen = vec![false; n];
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for [a, b, c] in heart.parts.iter().flat_map(|part| &part.triangles) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *edges.entry((*from.min(to), *from.max(to))).or_default() +=
                if from < to { 1 } else { -1 };
            seen[*from as usize] = true;
        }
    }
    assert!(
        edges.values().all(|n| *n == 0) && seen.iter().all(|seen| *seen),
        "closed, and no corner to spare"
    );
    for state in [begin, end] {
        assert_eq!(
            (
                state.points_mm.len(),
                state.sa_kpa.len(),
                state.lambda.len()
            ),
            (n, n, n)
        );
    }
    let muscle = heart
        .parts
        .iter()
        .filter(|part| part.contracts)
        .flat_map(|part| part.triangles.as_flattened());
    let mut relaxed = 0;
    for corner in muscle.map(|corner| *corner as usize) {
        assert_eq!(
            (begin.lambda[corner], begin.sa_kpa[corner]),
            (Some(1.0), Some(0.0))
        );
        let (stress_kpa, stretch) = (end.sa_kpa[corner].unwrap(), end.lambda[corner].unwrap());
        assert!(
            stress_kpa >= 0.0 && (0.7..1.2).contains(&stretch),
            "{stress_kpa} kPa at {stretch}"
        );
        // Tissue that was activated first may have relaxed already.
        relaxed += usize::from(stress_kpa == 0.0);
    }
    assert!(relaxed * 10 < n, "{relaxed} of {n} corners without stress");
    assert!(
        heart.parts.iter().any(|part| !part.contracts)
            && heart.parts.iter().any(|part| part.surface == "cut")
    );
    the_heart_moves(&heart);
}

/// The frames are 25 at even times, begin with the first state, and hold a whole heart.
fn the_heart_moves(heart: &HeartSurface) {
    let (begin, beat) = (&heart.states[0], heart.beat.as_ref().unwrap());
    let frames = beat.frames_mm().unwrap();
    assert_eq!(frames.len(), 25);
    let length = beat.time_ms[24];
    for (k, time) in beat.time_ms.iter().enumerate() {
        let even = length * k as f64 / 24.0;
        assert!(
            (time - even).abs() <= 2.0 + 1e-6,
            "{time} ms, expected {even}"
        );
    }
    let n = begin.points_mm.len();
    let far = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max);
    for (found, expected) in std::iter::zip(&frames[0][..n], &begin.points_mm) {
        assert!(
            far(found, expected) < 0.01,
            "{found:?}, expected {expected:?}"
        );
    }
    assert!((beat.volume_ml[0] - begin.volume_ml).abs() < 0.01);
    let ejected = (0..25).min_by(|a, b| beat.volume_ml[*a].total_cmp(&beat.volume_ml[*b]));
    let moved = std::iter::zip(&frames[0], &frames[ejected.unwrap()]).map(|(a, b)| far(a, b));
    assert!(moved.fold(0.0, f64::max) > 2.0);
    let stretch = beat.lambda.values().unwrap();
    assert_eq!(stretch.len(), 25 * frames[0].len());
    let width = beat.lambda.most - beat.lambda.least;
    for (found, expected) in std::iter::zip(&stretch[..n], &begin.lambda) {
        let (found, expected) = (found.unwrap_or(0.0), expected.unwrap_or(0.0));
        assert!((found - expected).abs() <= width / 254.0 + 1e-4);
    }
    let front = beat
        .front
        .iter()
        .flat_map(|part| part.triangles.as_flattened());
    assert!(
        front.clone().count() > 100
            && front
                .clone()
                .all(|corner| (*corner as usize) < frames[0].len())
    );
    assert!(front.clone().any(|corner| *corner as usize >= n));
    assert!(beat.front.iter().all(|part| part.surface != "cut"));
}

/// The series has a frame every 20 ms and the index, also after a beat was resumed. An independent
/// VTK reader reads it, if one can be installed.
fn a_series_is_whole(whole: &Path, resumed: &Path, figures: &VentricleFigures) {
    let index = String::from_utf8(read(whole, "vtu/beat.pvd")).unwrap();
    let names: Vec<String> = (0..=9).map(|k| format!("vtu/beat-{k:05}.vtu")).collect();
    for (k, name) in names.iter().enumerate() {
        let line = format!(
            "timestep=\"{}\" part=\"0\" file=\"{}\"",
            20 * k,
            name.trim_start_matches("vtu/")
        );
        assert!(index.contains(&line), "{line} is not in {index}");
        assert!(
            read(whole, name) == read(resumed, name),
            "{name} of the resumed beat differs"
        );
    }
    assert_eq!(index.matches("DataSet").count(), names.len());
    assert_eq!(read(resumed, "vtu/beat.pvd"), index.as_bytes());

    let last = vtu::read(&whole.join(&names[9]), LengthUnit::Millimetre).unwrap();
    assert_eq!(
        (last.mesh.n_nodes() as u64, last.mesh.n_tets() as u64),
        (figures.nodes, figures.elements)
    );
    let sum = |name: &str| -> f64 {
        last.point_fields
            .iter()
            .find(|f| f.name == name)
            .unwrap()
            .values
            .iter()
            .sum()
    };
    assert!(sum("Sa_kPa") > 0.0 && sum("displacement_mm").abs() > 0.0);
    let python = match vtk_reader::python() {
        Ok(python) => python,
        Err(why) => {
            cardiotwin_not_tested::not_tested("python-packages", format!("meshio: {why}"));
            return;
        }
    };
    let script = "import sys, meshio\nm = meshio.read(sys.argv[1])\n\
                  print(len(m.points), len(m.cells_dict['tetra']), m.point_data['lambda'].sum(), m.point_data['Sa_kPa'].sum())";
    let out = Command::new(python)
        .args(["-c", script])
        .arg(whole.join(&names[9]))
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let text = String::from_utf8(out.stdout).unwrap();
    let found: Vec<f64> = text
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    let expected = [
        figures.nodes as f64,
        figures.elements as f64,
        sum("lambda"),
        sum("Sa_kPa"),
    ];
    for (found, expected) in found.iter().zip(expected) {
        assert!(
            (found - expected).abs() < 1e-4 * expected,
            "{text} {expected:?}"
        );
    }
    assert_eq!(found.len(), 4);
}

// One test for everything that needs the ventricle, because step 0 takes most of the time.
#[test]
fn step_0_is_read_by_beats_that_stop_go_on_diverge_and_take_effects() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let spec = step0_spec();
    let state = passive_state(&spec, &mut context);
    let found = figures(&state);
    let edv = state.measured.edv_ml.unwrap();
    assert!(
        (found.end_diastolic_volume_ml - edv).abs() < 2e-3 * edv,
        "{found:?} against {edv}"
    );
    assert!(
        found.unloaded_volume_ml < found.image_volume_ml && found.image_volume_ml == 138.5,
        "{found:?}"
    );
    assert!((40.0..60.0).contains(&found.spread_ms), "{found:?}");
    let ventricle = context
        .artefacts
        .take()
        .into_iter()
        .find(|a| a.name == "ventricle")
        .unwrap();
    assert_eq!(
        ventricle.bytes as usize,
        read(folder.path(), &ventricle.file).len()
    );

    // Without interruption.
    let short = beat(&state, 190.0);
    let whole = tempfile::tempdir().unwrap();
    let result = finished(run(
        &short,
        &mut Context {
            vtu_every_ms: 20.0,
            ..Context::plain(whole.path(), 1)
        },
    ));
    assert!(
        result.counters["krylov_iterations"] > 0.0
            && result.counters["nodes"] == found.nodes as f64
    );
    assert!(
        result.biomarkers.p_max_mmhg.unwrap() > 20.0,
        "it contracts: {:?}",
        result.biomarkers
    );

    // With a checkpoint during the beat, and then resumed from it.
    let kept = tempfile::tempdir().unwrap();
    let mut writing = Context {
        checkpoints: Checkpoints::restarting(kept.path(), Path::new("nowhere"), None),
        checkpoint_ms: 50.0,
        checkpoint_apart: Duration::ZERO,
        vtu_every_ms: 20.0,
        ..Context::plain(kept.path(), 1)
    };
    finished(run(&short, &mut writing));
    let again = tempfile::tempdir().unwrap();
    let mut resuming = Context {
        checkpoints: Checkpoints::restarting(again.path(), kept.path(), None),
        vtu_every_ms: 20.0,
        ..Context::plain(again.path(), 1)
    };
    let resumed = finished(run(&short, &mut resuming));
    assert_eq!(resumed.counters["resumed_at_ms"], 150.0);
    let moved = result.motion.expect("a beat that ejects has its motion");
    assert_eq!(
        resumed.motion,
        Some(moved),
        "the resumed beat's motion differs"
    );
    assert!(
        moved.twist_epi_deg.abs() > 0.1 && (0.5..1.0).contains(&moved.least_volume_ratio),
        "{moved:?}"
    );
    for name in ["traces.csv", "nodal.csv", "heart.json"] {
        assert!(
            read(again.path(), name) == read(whole.path(), name),
            "{name} of the resumed beat differs"
        );
    }

    // The same with other numbers of threads: written on two, resumed on three and on one.
    let kept_by_two = tempfile::tempdir().unwrap();
    let mut writing = Context {
        checkpoints: Checkpoints::restarting(kept_by_two.path(), Path::new("nowhere"), None),
        checkpoint_ms: 50.0,
        checkpoint_apart: Duration::ZERO,
        ..Context::plain(kept_by_two.path(), 2)
    };
    let mut others = vec![(2.0, finished(run(&short, &mut writing)))];
    for threads in [1, 3] {
        let again = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::restarting(again.path(), kept_by_two.path(), None);
        let resumed = run(
            &short,
            &mut Context {
                checkpoints,
                ..Context::plain(again.path(), threads)
            },
        );
        others.push((f64::from(threads), finished(resumed)));
    }
    for (threads, other) in others {
        assert_eq!(other.counters["threads"], threads);
        assert_eq!(
            other.counters.get("resumed_at_ms"),
            if threads == 2.0 { None } else { Some(&150.0) }
        );
        let (want, got) = (
            result.biomarkers.p_max_mmhg.unwrap(),
            other.biomarkers.p_max_mmhg.unwrap(),
        );
        assert!(
            (got / want - 1.0).abs() < 1e-5,
            "{threads} threads: {got} for {want} mmHg"
        );
        let twist = other.motion.map(|m| m.twist_epi_deg);
        assert!(
            (twist.unwrap() - moved.twist_epi_deg).abs() < 1e-3,
            "{threads} threads: {twist:?} for {moved:?}"
        );
    }

    the_heart_is_drawn(whole.path(), &found);
    a_series_is_whole(whole.path(), again.path(), &found);

    // A checkpoint that is truncated or belongs to another task is rejected.
    let file = kept.path().join("checkpoint").join(FILE);
    let bytes = std::fs::read(&file).unwrap();
    let key = TaskSpec::OrganBeat(Box::new(short.clone()))
        .key()
        .to_string();
    assert!(BeatCheckpoint::from_bytes(&bytes, &key).is_ok());
    let foreign = BeatCheckpoint::from_bytes(&bytes, "another").unwrap_err();
    assert!(
        matches!(&foreign, CheckpointError::Foreign { .. })
            && foreign.to_string().contains("another")
    );
    assert!(matches!(
        BeatCheckpoint::from_bytes(&bytes[..bytes.len() / 2], &key),
        Err(CheckpointError::File(_))
    ));

    // A stop request also leaves a checkpoint.
    let stopped = tempfile::tempdir().unwrap();
    let mut stopping = Context {
        checkpoints: Checkpoints::restarting(stopped.path(), kept.path(), None),
        ..Context::plain(stopped.path(), 1)
    };
    let organ_beat = TaskSpec::OrganBeat(Box::new(short.clone()));
    let closed = stopped.path().join("outcome.json");
    stopping.closed = Some(closed.clone());
    std::fs::write(&closed, "").unwrap();
    assert_eq!(run_task(&organ_beat, &mut stopping), Ending::Cancelled);

    // A beat that must diverge, because no Newton iteration is accurate enough.
    let mut hopeless = OrganBeatSpec {
        newton_iterations: 1,
        shortest_step_ms: 1.0,
        ..short.clone()
    };
    hopeless.finite_element.as_mut().unwrap().tolerance = 1e-9;
    let diverged = tempfile::tempdir().unwrap();
    match run(&hopeless, &mut Context::plain(diverged.path(), 1)) {
        Ending::Diverged {
            last_good_ms,
            reason,
        } => {
            assert!(
                last_good_ms < 190.0 && reason.contains("Newton's method did not converge"),
                "{reason}"
            );
        }
        other => panic!("{other:?}"),
    }
    assert!(!read(diverged.path(), "traces.csv").is_empty());

    // An effect of the circulation takes effect; an effect on the passive law must already have
    // been present in step 0.
    let with = |name: &str, parameter: &str, value: f64| {
        let mut spec = short.clone();
        let effect = EffectSpec {
            name: name.into(),
            parameters: [(parameter.to_owned(), value)].into(),
        };
        spec.circulation.effects = vec![effect];
        run(&spec, &mut Context::plain(diverged.path(), 1))
    };
    let leaking = finished(with("mitral_regurgitation", "orifice_cm2", 0.3));
    assert!(leaking.biomarkers.p_max_mmhg < result.biomarkers.p_max_mmhg);
    let Ending::Failed { failure } = with("passive_stiffening", "exponent_factor", 2.0) else {
        panic!("not refused")
    };
    assert!(
        failure.message.contains("exponent factor of 1"),
        "{}",
        failure.message
    );
}

#[test]
fn potentials_come_after_the_beat_where_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let state = passive_state(&step0_spec(), &mut Context::plain(folder.path(), 1));
    let mut spec = beat(&state, 120.0);
    run(&spec, &mut Context::plain(folder.path(), 1));
    assert!(!folder.path().join("vm.igb").exists());
    let equations = spec.finite_element.as_mut().expect("in 3D");
    equations.potentials = Some(coarse().conduction);
    run(&spec, &mut Context::plain(folder.path(), 1));
    let nodes = figures(&state).nodes as usize;
    let igb = read(folder.path(), "vm.igb");
    assert_eq!(igb.len(), 1024 + 4 * 121 * nodes);
    assert!(
        String::from_utf8_lossy(&igb[..1024])
            .starts_with(&format!("x:{nodes} y:1 z:1 t:121 type:float"))
    );
    let csv = String::from_utf8(read(folder.path(), "vm.csv")).unwrap();
    let median = |line: usize| {
        csv.lines()
            .nth(line)
            .unwrap()
            .split(',')
            .nth(1)
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    assert_eq!(csv.lines().count(), 122);
    // Potential at rest, and on the plateau a tenth of a second after activation.
    assert!(
        (-86.0..-83.0).contains(&median(1)) && (-10.0..40.0).contains(&median(121)),
        "{} {}",
        median(1),
        median(121)
    );
    the_twin_is_left_for_paraview(folder.path(), &state);
    long_steps_in_late_filling_leave_every_row(folder.path(), &state);
}

/// Without a series, a beat with the fitted cell leaves its first and last frame for ParaView, and
/// a beat of step 1 leaves none.
fn the_twin_is_left_for_paraview(folder: &Path, state: &PassiveStateResult) {
    assert!(!folder.join("vtu").exists(), "a beat of step 1");
    let own = folder.join("twin");
    std::fs::create_dir(&own).unwrap();
    let spec = OrganBeatSpec {
        contraction: ContractionSpec::Land2017Rice {
            parameters: BTreeMap::new(),
            lambda_0: 1.0,
        },
        ..beat(state, 120.0)
    };
    finished(run(&spec, &mut Context::plain(&own, 1)));
    let index = String::from_utf8(read(&own, "vtu/beat.pvd")).unwrap();
    for (k, time) in ["0", "120"].iter().enumerate() {
        let file = format!("beat-{k:05}.vtu");
        let line = format!("timestep=\"{time}\" part=\"0\" file=\"{file}\"");
        assert!(index.contains(&line), "{line} is not in {index}");
        assert!(own.join("vtu").join(&file).is_file(), "{file}");
    }
    assert_eq!(index.matches("DataSet").count(), 2);
}

fn long_steps_in_late_filling_leave_every_row(folder: &Path, state: &PassiveStateResult) {
    let usual = beat(state, 1200.0);
    let mut long = usual.clone();
    long.finite_element
        .as_mut()
        .expect("in 3D")
        .diastolic_step_ms = 8.0;
    let nodal = |name: &str, spec: &OrganBeatSpec| {
        let own = folder.join(name);
        std::fs::create_dir(&own).unwrap();
        let result = finished(run(spec, &mut Context::plain(&own, 1)));
        let text = read(&own, "nodal.csv");
        let mut rows = NodalRows::begin(&text[..]).expect("nodal traces");
        let mut all = vec![];
        while let Some(row) = rows.next_row().expect("a row") {
            all.push(row);
        }
        (result, all)
    };
    let ((want, rows_of_usual), (got, rows)) = (nodal("usual", &usual), nodal("long", &long));
    assert!(
        got.counters["steps_tried"] < want.counters["steps_tried"] - 20.0,
        "{:?}",
        got.counters
    );
    assert_eq!(rows.len(), 601);
    for ((time, values), (want_time, want_values)) in rows.iter().zip(&rows_of_usual) {
        assert_eq!(time, want_time);
        // The second half of the values are stretches.
        let n = values.len() / 2;
        let apart = values[n..]
            .iter()
            .zip(&want_values[n..])
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(apart < 2e-3, "stretches {apart} apart at {time} ms");
    }
    let off = got.biomarkers.sv_ml.expect("SV") / want.biomarkers.sv_ml.expect("SV") - 1.0;
    assert!(off.abs() < 2e-3, "{off}");
}

#[test]
fn diastasis_starts_from_the_image_at_end_diastolic_pressure() {
    let folder = tempfile::tempdir().unwrap();
    let spec = PassiveStateSpec {
        start: StartMode::Diastasis,
        guccione_c_kpa: Some(2.0),
        ..step0_spec()
    };
    let state = passive_state(&spec, &mut Context::plain(folder.path(), 1));
    let found = figures(&state);
    assert_eq!((found.image_volume_ml, found.stiffness_kpa), (138.5, 2.0));
    assert!(
        (found.end_diastolic_volume_ml - 138.5).abs() < 0.3,
        "{found:?}"
    );
    assert_eq!(found.end_diastolic_pressure_mmhg, found.image_pressure_mmhg);
}

/// Step 0 and a beat of 01-CoA with changed settings of the wall.
fn beat_with(
    change: impl FnOnce(&mut FiniteElementSettings),
) -> (VentricleFigures, OrganBeatResult) {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let mut settings = coarse();
    change(&mut settings);
    let spec = PassiveStateSpec {
        finite_element: Some(settings.anatomy(&[])),
        ..step0("01-CoA")
    };
    let state = passive_state(&spec, &mut context);
    let beat = OrganBeatSpec {
        finite_element: Some(settings.equations()),
        ..beat(&state, spec.cycle_length_ms)
    };
    let result = finished(run(&beat, &mut context));
    assert_eq!(result.failed_check(), None);
    (figures(&state), result)
}

#[test]
fn a_cohort_has_the_laws_and_conventions_that_it_asks_for() {
    let (plain, usual) = beat_with(|_| {});
    let stroke = |result: &OrganBeatResult| result.biomarkers.sv_ml.unwrap();

    let (figures, ogden) = beat_with(|s| s.wall.muscle_law = MuscleLaw::HolzapfelOgden);
    assert!(
        (figures.end_diastolic_volume_ml / plain.end_diastolic_volume_ml - 1.0).abs() < 2e-3,
        "{figures:?}"
    );
    assert!(
        (figures.unloaded_volume_ml / plain.unloaded_volume_ml - 1.0).abs() < 0.02,
        "{figures:?}"
    );
    // The stiffness is reported as the law's modulus, a fraction of Guccione's C.
    assert!(
        figures.stiffness_kpa < 0.3 * plain.stiffness_kpa,
        "{} {}",
        figures.stiffness_kpa,
        plain.stiffness_kpa
    );
    assert!(
        (stroke(&ogden) / stroke(&usual) - 1.0).abs() < 0.3,
        "{} {}",
        stroke(&ogden),
        stroke(&usual)
    );

    // A tension per reference area exerts less force where fibres are short than the same tension
    // divided by λ.
    let (same, first) = beat_with(|s| s.wall.active_convention = ActiveConvention::FirstPiola);
    assert_eq!(
        same.stiffness_kpa, plain.stiffness_kpa,
        "the passive law is none of its business"
    );
    assert!(
        stroke(&first) < 0.97 * stroke(&usual),
        "{} {}",
        stroke(&first),
        stroke(&usual)
    );

    // The settings of Newton's method reach the beat: with shorter steps it takes more iterations.
    let (_, careful) = beat_with(|s| s.newton.farthest_mm = 0.2);
    assert!(
        (stroke(&careful) / stroke(&usual) - 1.0).abs() < 2e-3,
        "{} {}",
        stroke(&careful),
        stroke(&usual)
    );
}

#[test]
fn a_law_or_tag_that_cannot_be_is_refused_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let mut context = Context::plain(folder.path(), 1);
    let mut refused = |settings: FiniteElementSettings, guccione_c_kpa| {
        let spec = PassiveStateSpec {
            finite_element: Some(settings.anatomy(&[])),
            guccione_c_kpa,
            ..step0("01-CoA")
        };
        match run_task(&TaskSpec::PassiveState(Box::new(spec)), &mut context) {
            Ending::Failed { failure } => failure,
            other => panic!("{other:?}"),
        }
    };
    let mut tagged = coarse();
    tagged.wall.passive.insert(
        7,
        PassiveTissueSettings {
            mu_kpa: 10.0,
            kappa_kpa: 100.0,
        },
    );
    let failure = refused(tagged, None);
    assert_eq!(failure.class, FailureClass::Input);
    assert!(
        failure
            .message
            .contains("solver.finite_element.wall.passive.7"),
        "{failure:?}"
    );
    assert!(failure.message.contains("expected one of 2"), "{failure:?}");
    let mut ogden = coarse();
    ogden.wall.muscle_law = MuscleLaw::HolzapfelOgden;
    let failure = refused(ogden, Some(0.5));
    assert_eq!(failure.class, FailureClass::Input);
    assert!(
        failure.message.contains("passive.guccione_C_kPa"),
        "{failure:?}"
    );
}
