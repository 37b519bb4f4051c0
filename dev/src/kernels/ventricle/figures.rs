//! Settings, figures and errors of the benchmark of a 3D beat.

use std::fmt;

use cardiotwin_mechanics::organ::RankFigures;
use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_worker::team::Team;
use serde::{Serialize, Serializer};

/// Kind of finite elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Element {
    /// Default element of a cohort.
    Linear,
    /// Linear element with a plain penalty at each integration point, as in the paper.
    Pointwise,
}

/// Settings of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VentricleBench {
    /// Approximate number of nodes in the mesh.
    pub nodes: usize,
    /// Kind of finite elements.
    pub element: Element,
    /// Length of the beat \[ms\]. A part of a beat is enough to time kernels and their shares.
    pub cycle_ms: f64,
    /// Time step outside of late filling, or interval of the samples where steps are controlled \[ms\].
    pub step_ms: f64,
    /// Longest time step in late filling \[ms\]; 0 for the same step as elsewhere.
    pub diastolic_step_ms: f64,
    /// Longest controlled time step \[ms\]; steps are of one length where it is not longer than that.
    pub longest_step_ms: f64,
    /// Tolerated error of a controlled step over its length \[mmHg/s and mL/s\].
    pub step_tolerance: f64,
    /// Relative tolerance of Newton's method.
    pub tolerance: f64,
}

/// Time of one core per tetrahedron \[ns\], by kernel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NsPerTet {
    /// Volume ratios, stretches and nodal pressures.
    pub deform: f64,
    /// Forces alone, as after an accepted step.
    pub forces: f64,
    /// Forces and stiffness, with the scatter into the matrix.
    pub forces_tangent_scatter: f64,
}

/// Wall time of the beat \[s\], by the state of the valves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SecondsPerPhase {
    /// The mitral valve is open.
    pub filling: f64,
    /// Both valves are closed, before ejection.
    pub isovolumic_contraction: f64,
    /// The aortic valve is open.
    pub ejection: f64,
    /// Both valves are closed, after ejection.
    pub relaxation: f64,
}

/// Biomarkers that the benchmark reports, in the order of its rows.
pub(super) const REPORTED: [Biomarker; 5] = [
    Biomarker::PMax,
    Biomarker::Ptd90,
    Biomarker::DpdtMax,
    Biomarker::DpdtMin,
    Biomarker::Sv,
];

/// Writes the biomarkers of [`REPORTED`]; one that the beat does not have is null.
pub(super) fn reported<S: Serializer>(found: &Biomarkers, to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(REPORTED.map(|biomarker| (biomarker.key(), found.get(biomarker))))
}

/// A rank's part of the mesh, its communication in the beat and its memory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[expect(non_snake_case, reason = "units in names")]
pub struct OfRank {
    /// Part of the mesh and communication.
    #[serde(flatten)]
    pub figures: RankFigures,
    /// Largest resident memory of the rank's process; `None` for a thread.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_memory_MB: Option<f64>,
}

/// A beat and its costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(non_snake_case, reason = "units in names")]
pub struct VentricleTiming {
    /// Number of nodes in the mesh.
    pub nodes: usize,
    /// Number of tetrahedra in the mesh.
    pub elements: usize,
    /// Number of degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Kind of finite elements.
    pub element: Element,
    /// Number of ranks, which are threads or processes.
    pub threads: usize,
    /// Time and reason if the beat did not reach its end.
    pub diverged: Option<String>,
    /// Conditions of success that the beat does not meet.
    pub failed_checks: Vec<String>,
    /// Number of time steps in the beat.
    pub steps: usize,
    /// Number of steps that failed and were repeated with a shorter step.
    pub steps_cut: usize,
    /// Wall time of the beat.
    pub seconds_total: f64,
    /// Processor time of the beat, summed over ranks.
    pub processor_seconds_total: f64,
    /// Wall time of the beat by phase.
    pub seconds_per_phase: SecondsPerPhase,
    /// Wall time of mesh, fibres and activation.
    pub seconds_mesh: f64,
    /// Wall time of the inflation to end-diastole, which uses one rank up to 3,000 nodes and all
    /// ranks beyond.
    pub seconds_inflation: f64,
    /// Wall time from the end of the inflation to the first step: partition and sparsity patterns.
    pub seconds_setup: f64,
    /// Largest resident memory up to the end of the beat, summed over processes. With several beats
    /// in one run, counting starts at the end of the previous beat.
    pub peak_memory_MB: f64,
    /// The same, counted from the partition on. It leaves out mesh, fibres and inflation, whose
    /// memory is free again by then.
    pub beat_peak_memory_MB: f64,
    /// Newton iterations, including those of failed steps.
    pub newton_iterations: usize,
    /// Newton iterations per step.
    pub newton_per_step: f64,
    /// Krylov iterations of the linear solver, including those of failed steps.
    pub krylov_iterations: usize,
    /// Krylov iterations per Newton iteration.
    pub krylov_per_newton: f64,
    /// Times of the passes over elements.
    pub ns_per_tet: NsPerTet,
    /// Time of one iteration of conjugate gradients with all ranks at work.
    pub ms_per_krylov_iteration: f64,
    /// Memory traffic of one iteration if caches keep nothing.
    pub MB_per_krylov_iteration: f64,
    /// Memory traffic of the iterations per second.
    pub krylov_GB_per_s: f64,
    /// Triad bandwidth of the machine on as many threads.
    pub triad_GB_per_s: f64,
    /// Time of an iteration divided by the time that the triad would need for the same traffic.
    pub krylov_over_bandwidth_bound: f64,
    /// Number of elements on the fullest rank, divided by an equal share. It shows the cost of
    /// unequal parts and of elements at cuts, which several ranks compute.
    pub elements_of_fullest_rank_over_share: f64,
    /// Mesh part and communication of each rank.
    pub ranks: Vec<OfRank>,
    /// Biomarkers of the beat.
    #[serde(serialize_with = "reported")]
    pub biomarkers: Biomarkers,
    /// Model name of the processor.
    pub processor: String,
}

/// The benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct BenchError {
    what: &'static str,
    source: Box<dyn std::error::Error + Send + Sync>,
}

/// A source error with what failed.
pub(super) fn failed<E: std::error::Error + Send + Sync + 'static>(
    what: &'static str,
) -> impl FnOnce(E) -> BenchError {
    move |error| BenchError {
        what,
        source: Box::new(error),
    }
}

/// Ranks that compute the beat.
#[derive(Debug, Clone, Copy)]
pub enum Ranks<'a> {
    /// Threads of this process, by number.
    Threads(usize),
    /// Processes; this one is rank 0, and the others call `follow`.
    Team(&'a Team),
}

impl Ranks<'_> {
    pub(super) fn n(self) -> usize {
        match self {
            Self::Threads(n) => n,
            Self::Team(team) => team.n_ranks(),
        }
    }
}

impl fmt::Display for VentricleTiming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (phases, tet, found) = (&self.seconds_per_phase, &self.ns_per_tet, &self.biomarkers);
        writeln!(
            f,
            "{} nodes, {} tetrahedra ({:?}), {} ranks",
            self.nodes, self.elements, self.element, self.threads
        )?;
        if let Some(diverged) = &self.diverged {
            writeln!(f, "diverged {diverged}")?;
        }
        self.failed_checks
            .iter()
            .try_for_each(|check| writeln!(f, "failed: {check}"))?;
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
            "before: mesh {:.1} s, inflation {:.1} s, set-up {:.1} s; peak memory {:.0} MB, {:.0} MB from the partition on",
            self.seconds_mesh,
            self.seconds_inflation,
            self.seconds_setup,
            self.peak_memory_MB,
            self.beat_peak_memory_MB
        )?;
        writeln!(
            f,
            "ns a tetrahedron and rank: deform {:.0}, forces {:.0}, forces, tangent and scatter {:.0}",
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
        if self.ranks.len() > 1 {
            let of = |what: fn(&OfRank) -> f64| {
                let all = || self.ranks.iter().map(what);
                (
                    all().sum::<f64>() / self.ranks.len() as f64,
                    all().fold(0.0, f64::max),
                )
            };
            let (messages, most_messages) = of(|r| r.figures.halo_messages as f64);
            let (sent, most_sent) = of(|r| 1e-6 * r.figures.halo_bytes as f64);
            let (ghosts, most_ghosts) = of(|r| r.figures.ghosts as f64);
            writeln!(
                f,
                "a rank, mean and most: {ghosts:.0} and {most_ghosts:.0} ghosts, {messages:.0} and {most_messages:.0} halos sent, \
                 {sent:.1} and {most_sent:.1} MB in them; {} reductions; elements of the fullest rank {:.3} of an equal share",
                self.ranks[0].figures.reductions, self.elements_of_fullest_rank_over_share
            )?;
        }
        let shown = |value: Option<f64>| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"))
        };
        write!(
            f,
            "P_max {} mmHg, PTD90 {} ms, dPdt_max {} and dPdt_min {} mmHg/ms, SV {} mL",
            shown(found.p_max_mmhg),
            shown(found.ptd90_ms),
            shown(found.dpdt_max_mmhg_per_ms),
            shown(found.dpdt_min_mmhg_per_ms),
            shown(found.sv_ml)
        )
    }
}
