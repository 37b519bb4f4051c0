//! One beat of a generated 3D ventricle, with what it costs and what that is made of.

use std::fmt;
use std::ops::ControlFlow;
use std::time::Instant;

use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, EndDiastole, FiniteElementVentricle, Kernel, PassiveState, Search, UnloadingSettings,
    VentricleParts, WallParameters,
};
use cardiotwin_mechanics::parallel::ThreadSettings;
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::eikonal::{Conduction, ENDOCARDIAL_SPEED, Speeds, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{Angles, Longitudinal, fields, frames};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, BeatTraces, run_observed};
use cardiotwin_models::circulation::{Circulation, LeftHeart};
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::GroupContraction;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};
use serde::Serialize;

use super::{processor, triad::triad_gb_per_s};
use crate::process::{cpu_s, peak_memory_mb};
use crate::tasks::organ_beat::simulated_biomarkers;

/// Cavity and wall of the generated ventricle.
const CAVITY_ML: f64 = 112.0;
const WALL_ML: f64 = 140.0;
/// Stiffness C \[kPa\] and pressure of the inflation: step 0 does no more here.
const STIFFNESS_KPA: f64 = 0.8;
const END_DIASTOLIC_MMHG: f64 = 9.0;
/// Iterations of the Krylov method in a measurement.
const KRYLOV_ITERATIONS: u32 = 20;

/// Which elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Element {
    /// Linear with nodal volume change: the workflow's default.
    Linear,
    /// Linear with a plain penalty: the paper's.
    Pointwise,
}

/// What to compute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VentricleBench {
    /// Nodes of the mesh, about.
    pub nodes: usize,
    /// Threads.
    pub threads: usize,
    /// Elements.
    pub element: Element,
    /// Length of the beat \[ms\]; kernels and their shares of a beat do not need all of it.
    pub cycle_ms: f64,
    /// Time step \[ms\].
    pub step_ms: f64,
    /// Relative tolerance of Newton's method.
    pub tolerance: f64,
}

/// Nanoseconds of one core a tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NsPerTet {
    /// Volume ratios, stretches, nodal pressures.
    pub deform: f64,
    /// Forces.
    pub forces: f64,
    /// Forces and stiffness, scattered.
    pub forces_tangent_scatter: f64,
}

/// Seconds of the beat by what the valves do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SecondsPerPhase {
    /// The mitral valve is open.
    pub filling: f64,
    /// Both valves are shut before ejection.
    pub isovolumic_contraction: f64,
    /// The aortic valve is open.
    pub ejection: f64,
    /// Both are shut after it.
    pub relaxation: f64,
}

/// Biomarkers of the beat.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[expect(non_snake_case, reason = "the field's names")]
pub struct BeatBiomarkers {
    /// Largest pressure.
    pub P_max_mmHg: Option<f64>,
    /// Width of the pressure pulse at 10 % of its height.
    pub PTD90_ms: Option<f64>,
    /// Largest and smallest slope of pressure.
    pub dPdt_max_mmHg_per_ms: Option<f64>,
    /// See above.
    pub dPdt_min_mmHg_per_ms: Option<f64>,
    /// Stroke volume.
    pub SV_mL: Option<f64>,
}

/// A beat and its cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(non_snake_case, reason = "units in names")]
pub struct VentricleTiming {
    /// Nodes.
    pub nodes: usize,
    /// Tetrahedra.
    pub elements: usize,
    /// Degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Kind of element.
    pub element: Element,
    /// Threads.
    pub threads: usize,
    /// Whether the beat reached its end; if not, why and when.
    pub diverged: Option<String>,
    /// Conditions of success that the beat does not meet.
    pub failed_checks: Vec<String>,
    /// Time steps of the beat.
    pub steps: usize,
    /// Steps that failed and were cut.
    pub steps_cut: usize,
    /// Wall time of the beat.
    pub seconds_total: f64,
    /// Processor time of the beat, all threads.
    pub processor_seconds_total: f64,
    /// Wall time of the beat by phase.
    pub seconds_per_phase: SecondsPerPhase,
    /// Wall time of mesh, fibres and activation.
    pub seconds_mesh: f64,
    /// Wall time of the inflation to end-diastole, on one thread.
    pub seconds_inflation: f64,
    /// Wall time from there to the first step: partition, matrices' patterns.
    pub seconds_setup: f64,
    /// Largest resident memory from the process's start to the beat's end.
    pub peak_memory_MB: f64,
    /// Newton iterations, of all steps tried.
    pub newton_iterations: usize,
    /// The same a step.
    pub newton_per_step: f64,
    /// Krylov iterations.
    pub krylov_iterations: usize,
    /// The same a Newton iteration.
    pub krylov_per_newton: f64,
    /// Passes over elements.
    pub ns_per_tet: NsPerTet,
    /// An iteration of conjugate gradients, all threads at work.
    pub ms_per_krylov_iteration: f64,
    /// What it moves through memory, if caches keep nothing.
    pub MB_per_krylov_iteration: f64,
    /// The same a second.
    pub krylov_GB_per_s: f64,
    /// The machine's triad on as many threads.
    pub triad_GB_per_s: f64,
    /// Time of an iteration over what the triad would need for its bytes.
    pub krylov_over_bandwidth_bound: f64,
    /// Biomarkers.
    pub biomarkers: BeatBiomarkers,
    /// The processor.
    pub processor: String,
}

/// Why there is nothing to measure.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct BenchError {
    what: &'static str,
    source: Box<dyn std::error::Error + Send + Sync>,
}

fn failed<E: std::error::Error + Send + Sync + 'static>(what: &'static str) -> impl FnOnce(E) -> BenchError {
    move |error| BenchError { what, source: Box::new(error) }
}

/// A generated mesh with fibres, and its activation times.
fn heart(nodes: usize) -> Result<(TetMesh, Vec<f64>), BenchError> {
    let spec = EllipsoidSpec::new(Ml(CAVITY_ML), Ml(WALL_ML), nodes);
    let made = generate(&spec).map_err(failed("cannot generate a ventricle"))?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    let muscle = [tags::LEFT_VENTRICLE];
    let found = fields(&mesh, &muscle, Longitudinal::FromBase).map_err(failed("no fibres"))?;
    mesh.frames = frames(&mesh, &muscle, &found, &Angles::default());
    let conduction = Conduction {
        speeds: Speeds::default(),
        endocardial_speed: Some(ENDOCARDIAL_SPEED),
        tags: muscle.to_vec(),
        sites: made.shape.fascicles().to_vec(),
    };
    let times = activation_ms(&mesh, &conduction).map_err(failed("no activation"))?;
    Ok((mesh, times))
}

fn circulation(cycle_length: Ms) -> Result<Circulation, BenchError> {
    let heart = LeftHeart::of_an_adult(Mmhg(9.0), cycle_length);
    heart.build().map_err(failed("no circulation"))
}

/// End-diastole of the image taken for unloaded.
fn inflated(anatomy: &Anatomy, wall: &WallParameters) -> Result<EndDiastole, BenchError> {
    let mut search = Search::new(UnloadingSettings::for_anatomy(anatomy));
    let mut state = PassiveState::unloaded_image(anatomy, wall).map_err(failed("no wall"))?;
    state.inflate(END_DIASTOLIC_MMHG / MMHG_PER_KPA, &mut search).map_err(failed("no end-diastole"))?;
    Ok(state.into())
}

/// Runs the beat and measures; `report` is told of what begins and how far the beat is.
///
/// # Errors
/// [`BenchError`] for a mesh that cannot be made, or a ventricle without an end-diastole.
pub fn ventricle(bench: &VentricleBench, mut report: impl FnMut(&str)) -> Result<VentricleTiming, BenchError> {
    let begun = Instant::now();
    report("mesh, fibres, activation");
    let (mesh, times) = heart(bench.nodes)?;
    let kind = match bench.element {
        Element::Linear => ElementKind::LINEAR_NODAL,
        Element::Pointwise => ElementKind::LINEAR_POINTWISE,
    };
    let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], kind).map_err(failed("no anatomy"))?;
    let (nodes, elements) = (mesh.n_nodes(), mesh.n_tets());
    drop(mesh);
    let seconds_mesh = begun.elapsed().as_secs_f64();

    report(&format!("inflation of {nodes} nodes, {elements} tetrahedra"));
    let begun = Instant::now();
    let mut wall = WallParameters::default();
    wall.muscle.c_kpa = STIFFNESS_KPA;
    let end_diastole = inflated(&anatomy, &wall)?;
    let seconds_inflation = begun.elapsed().as_secs_f64();

    report("setting up");
    let begun = Instant::now();
    let cycle_length = Ms(bench.cycle_ms);
    let tanh = TanhParameters { smax_ref_kpa: 100.0, t_cr_ms: 400.0, ..TanhParameters::default() };
    let parts = VentricleParts {
        anatomy: &anatomy,
        wall: &wall,
        end_diastole,
        contraction: GroupContraction::tanh(Tanh::new(tanh).map_err(failed("no contraction model"))?),
        activation_ms: &times,
        cycle_length,
        pressure_terms: vec![],
        viscosity: None,
        settings: StepSettings { relative_tolerance: bench.tolerance, ..StepSettings::default() },
    };
    let mut ventricle = FiniteElementVentricle::on_threads(parts, bench.threads, ThreadSettings::default())
        .map_err(failed("no ventricle"))?;
    drop((anatomy, times));
    let mut blood = circulation(cycle_length)?;
    let seconds_setup = begun.elapsed().as_secs_f64();

    let settings = BeatSettings { step: Ms(bench.step_ms), ..BeatSettings::one_beat(cycle_length) };
    let mut phases = Phases::begun();
    let (begun, cpu) = (Instant::now(), cpu_s());
    let outcome = run_observed(&mut ventricle, &mut blood, &settings, None, |seen| {
        phases.observe(&seen.progress.traces);
        let time = seen.progress.traces.time_ms.last().copied().unwrap_or_default();
        if seen.progress.intervals.is_multiple_of(50) {
            report(&format!("{time:.0} of {:.0} ms, {:.1} s", bench.cycle_ms, begun.elapsed().as_secs_f64()));
        }
        ControlFlow::<()>::Continue(())
    });
    let (seconds_total, processor_seconds_total) = (begun.elapsed().as_secs_f64(), cpu_s() - cpu);
    let peak_memory_mb = peak_memory_mb();
    let (diverged, failed_checks, work, traces) = match outcome {
        ControlFlow::Continue(BeatOutcome::Finished(result)) => {
            let failed = result.checks.into_iter().filter(|check| !check.passed).map(|check| check.name);
            (None, failed.collect(), result.work, result.traces)
        }
        ControlFlow::Continue(BeatOutcome::Diverged { t, reason, traces, work, .. }) => {
            (Some(format!("at {} ms: {reason}", t.0)), vec![], work, *traces)
        }
        ControlFlow::Break(()) => unreachable!("nothing stops it"),
    };

    report("kernels");
    let mut seconds = |kernel| fastest(|| ventricle.run(kernel));
    let per_tet = |seconds: f64| 1e9 * seconds * bench.threads as f64 / elements as f64;
    let ns_per_tet = NsPerTet {
        deform: per_tet(seconds(Kernel::Deform)),
        forces: per_tet(seconds(Kernel::Forces)),
        forces_tangent_scatter: per_tet(seconds(Kernel::Tangent)),
    };
    let ms_per_krylov_iteration = 1e3 * seconds(Kernel::Krylov(KRYLOV_ITERATIONS)) / f64::from(KRYLOV_ITERATIONS);
    let bytes = ventricle.krylov_bytes();
    let total = ventricle.work();
    drop(ventricle);
    let triad = triad_gb_per_s(bench.threads);
    let krylov = 1e-6 * bytes / ms_per_krylov_iteration;
    Ok(VentricleTiming {
        nodes,
        elements,
        degrees_of_freedom: 3 * nodes,
        element: bench.element,
        threads: bench.threads,
        diverged,
        failed_checks,
        steps: work.n_steps,
        steps_cut: work.n_cut,
        seconds_total,
        processor_seconds_total,
        seconds_per_phase: phases.seconds,
        seconds_mesh,
        seconds_inflation,
        seconds_setup,
        peak_memory_MB: peak_memory_mb,
        newton_iterations: total.newton_iterations,
        newton_per_step: total.newton_iterations as f64 / total.steps.max(1) as f64,
        krylov_iterations: total.krylov_iterations,
        krylov_per_newton: total.krylov_iterations as f64 / total.newton_iterations.max(1) as f64,
        ns_per_tet,
        ms_per_krylov_iteration,
        MB_per_krylov_iteration: 1e-6 * bytes,
        krylov_GB_per_s: krylov,
        triad_GB_per_s: triad,
        krylov_over_bandwidth_bound: triad / krylov,
        biomarkers: biomarkers(&traces),
        processor: processor(),
    })
}

fn biomarkers(traces: &BeatTraces) -> BeatBiomarkers {
    simulated_biomarkers(traces, None).map_or_else(
        |_| BeatBiomarkers::default(),
        |set| BeatBiomarkers {
            P_max_mmHg: set.p_max.map(|p| p.0),
            PTD90_ms: set.ptd90.map(|t| t.0),
            dPdt_max_mmHg_per_ms: set.dpdt_max_mmhg_per_ms,
            dPdt_min_mmHg_per_ms: set.dpdt_min_mmhg_per_ms,
            SV_mL: set.sv.map(|v| v.0),
        },
    )
}

/// Seconds of the fastest of some calls: those that nothing interrupted. One call goes before.
fn fastest(mut call: impl FnMut() -> bool) -> f64 {
    call();
    let begun = Instant::now();
    let mut best = f64::INFINITY;
    for n in 0.. {
        let before = Instant::now();
        call();
        best = best.min(before.elapsed().as_secs_f64());
        if n >= 4 && begun.elapsed().as_secs_f64() > 1.0 {
            break;
        }
    }
    best
}

/// Where the beat's time goes.
struct Phases {
    seconds: SecondsPerPhase,
    last: Instant,
    ejected: bool,
}

impl Phases {
    fn begun() -> Self {
        Self { seconds: SecondsPerPhase::default(), last: Instant::now(), ejected: false }
    }

    /// Books the time since the last output interval on what the valves are at its end.
    fn observe(&mut self, traces: &BeatTraces) {
        let open = |valve: &[bool]| valve.last().copied().unwrap_or(false);
        self.ejected |= open(&traces.aortic_open);
        let phase = match (open(&traces.mitral_open), open(&traces.aortic_open)) {
            (_, true) => &mut self.seconds.ejection,
            (true, false) => &mut self.seconds.filling,
            _ if self.ejected => &mut self.seconds.relaxation,
            _ => &mut self.seconds.isovolumic_contraction,
        };
        *phase += self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
    }
}

impl fmt::Display for VentricleTiming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (phases, tet, found) = (&self.seconds_per_phase, &self.ns_per_tet, &self.biomarkers);
        writeln!(
            f,
            "{} nodes, {} tetrahedra ({:?}), {} threads",
            self.nodes, self.elements, self.element, self.threads
        )?;
        if let Some(diverged) = &self.diverged {
            writeln!(f, "diverged {diverged}")?;
        }
        self.failed_checks.iter().try_for_each(|check| writeln!(f, "failed: {check}"))?;
        writeln!(
            f,
            "beat: {:.1} s, {:.1} s of processor time; {} steps, {} cut; {:.2} Newton iterations a step, {:.1} Krylov iterations each",
            self.seconds_total,
            self.processor_seconds_total,
            self.steps,
            self.steps_cut,
            self.newton_per_step,
            self.krylov_per_newton
        )?;
        writeln!(
            f,
            "phases: filling {:.1} s, isovolumic contraction {:.1} s, ejection {:.1} s, relaxation {:.1} s",
            phases.filling, phases.isovolumic_contraction, phases.ejection, phases.relaxation
        )?;
        writeln!(
            f,
            "before: mesh {:.1} s, inflation {:.1} s, set-up {:.1} s; peak memory {:.0} MB",
            self.seconds_mesh, self.seconds_inflation, self.seconds_setup, self.peak_memory_MB
        )?;
        writeln!(
            f,
            "ns a tetrahedron and core: deform {:.0}, forces {:.0}, forces, tangent and scatter {:.0}",
            tet.deform, tet.forces, tet.forces_tangent_scatter
        )?;
        writeln!(
            f,
            "Krylov iteration: {:.3} ms, {:.1} MB, {:.1} GB/s; triad {:.1} GB/s: {:.2} times its time",
            self.ms_per_krylov_iteration,
            self.MB_per_krylov_iteration,
            self.krylov_GB_per_s,
            self.triad_GB_per_s,
            self.krylov_over_bandwidth_bound
        )?;
        let shown = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"));
        write!(
            f,
            "P_max {} mmHg, PTD90 {} ms, dPdt_max {} and dPdt_min {} mmHg/ms, SV {} mL",
            shown(found.P_max_mmHg),
            shown(found.PTD90_ms),
            shown(found.dPdt_max_mmHg_per_ms),
            shown(found.dPdt_min_mmHg_per_ms),
            shown(found.SV_mL)
        )
    }
}
