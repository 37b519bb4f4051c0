//! Timing of one beat of the benchmark's ventricle.

use std::ops::ControlFlow;
use std::time::Instant;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{FiniteElementVentricle, Kernel, RankFigures};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, BeatTraces, run_observed};
use cardiotwin_models::circulation::{Circulation, LeftHeart};
use cardiotwin_models::step_control::StepControl;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_units::{Mmhg, Ms};

use super::figures::{
    BenchError, NsPerTet, OfRank, Ranks, SecondsPerPhase, VentricleBench, VentricleTiming, failed,
};
use super::subject::Subject;
use crate::kernels::{processor, triad::triad_gb_per_s};
use cardiotwin_worker::process::{cpu_s, forget_peak_memory, peak_memory_mb};
use cardiotwin_worker::stop::StopFlag;
use cardiotwin_worker::tasks::organ_beat::simulated_biomarkers;

/// Krylov iterations in one measurement.
const KRYLOV_ITERATIONS: u32 = 20;

fn circulation(cycle_length: Ms) -> Result<Circulation, BenchError> {
    let heart = LeftHeart::of_an_adult(Mmhg(9.0), cycle_length);
    heart.build().map_err(failed("no circulation"))
}

/// A computed beat with its biomarkers and costs.
pub(super) struct Beat {
    pub ventricle: FiniteElementVentricle,
    pub seconds_setup: f64,
    pub seconds_total: f64,
    pub processor_seconds_total: f64,
    pub seconds_per_phase: SecondsPerPhase,
    pub steps: usize,
    pub steps_cut: usize,
    pub diverged: Option<String>,
    pub failed_checks: Vec<String>,
    pub biomarkers: Biomarkers,
    pub of_ranks: Vec<RankFigures>,
}

/// Runs the beat and calls `each` after every step.
pub(super) fn beat(
    subject: &Subject,
    bench: &VentricleBench,
    settings: StepSettings,
    ranks: Ranks<'_>,
    stop: &StopFlag,
    mut each: impl FnMut(&mut FiniteElementVentricle, f64),
) -> Result<Beat, BenchError> {
    let begun = Instant::now();
    let cycle_length = Ms(bench.cycle_ms);
    let parts = subject.parts(cycle_length, settings)?;
    let made = match ranks {
        Ranks::Threads(n) => {
            FiniteElementVentricle::on_threads(parts, n, ThreadSettings::default())
        }
        Ranks::Team(team) => FiniteElementVentricle::lead(parts, team.comm()),
    };
    let mut ventricle = made.map_err(failed("no ventricle"))?;
    let mut blood = circulation(cycle_length)?;
    let seconds_setup = begun.elapsed().as_secs_f64();
    let before = ventricle.of_ranks();

    let (step, diastolic_step) = (Ms(bench.step_ms), Ms(bench.diastolic_step_ms));
    let settings = BeatSettings {
        step,
        diastolic_step,
        control: (bench.longest_step_ms > bench.step_ms).then_some(StepControl {
            longest: Ms(bench.longest_step_ms),
            tolerance_per_s: bench.step_tolerance,
        }),
        ..BeatSettings::one_beat(cycle_length)
    };
    let mut phases = Phases::begun();
    let (begun, cpu) = (Instant::now(), cpu_s());
    let outcome = run_observed(&mut ventricle, &mut blood, &settings, None, |seen| {
        phases.observe(&seen.progress.traces);
        let time = seen
            .progress
            .traces
            .time_ms
            .last()
            .copied()
            .unwrap_or_default();
        each(seen.ventricle, time);
        if stop.is_raised() {
            ControlFlow::Break(time)
        } else {
            ControlFlow::Continue(())
        }
    });
    let (seconds_total, processor_seconds_total) = (begun.elapsed().as_secs_f64(), cpu_s() - cpu);
    let (diverged, failed_checks, work, traces) = match outcome {
        ControlFlow::Continue(BeatOutcome::Finished(result)) => {
            let failed = result
                .checks
                .into_iter()
                .filter(|check| !check.passed)
                .map(|check| check.name);
            (None, failed.collect(), result.work, result.traces)
        }
        ControlFlow::Continue(BeatOutcome::Diverged {
            t,
            reason,
            traces,
            work,
            ..
        }) => (
            Some(format!("at {} ms: {reason}", t.0)),
            vec![],
            work,
            *traces,
        ),
        ControlFlow::Break(time) => return Err(failed("stopped on request")(Stopped(time))),
    };
    let of_ranks = ventricle
        .of_ranks()
        .into_iter()
        .zip(before)
        .map(|(after, before)| after.since(&before))
        .collect();
    Ok(Beat {
        ventricle,
        seconds_setup,
        seconds_total,
        processor_seconds_total,
        seconds_per_phase: phases.seconds,
        steps: work.n_steps,
        steps_cut: work.n_cut,
        diverged,
        failed_checks,
        biomarkers: simulated_biomarkers(&traces, None).unwrap_or_default(),
        of_ranks,
    })
}

#[derive(Debug, thiserror::Error)]
#[error("at {0} ms")]
struct Stopped(f64);

/// Runs the beat, then times its kernels.
///
/// - `before_mb`: peak memory \[MB\] of this process before the beat, as far as it belongs to this
///   beat alone
pub(super) fn measure(
    subject: &Subject,
    bench: &VentricleBench,
    (ranks, before_mb): (Ranks<'_>, f64),
    stop: &StopFlag,
    mut report: impl FnMut(&str),
) -> Result<VentricleTiming, BenchError> {
    let n_ranks = ranks.n();
    let settings = StepSettings {
        relative_tolerance: bench.tolerance,
        ..StepSettings::default()
    };
    report(&format!("beat on {n_ranks}"));
    let (begun, mut told) = (Instant::now(), 0.0);
    let done = beat(subject, bench, settings, ranks, stop, |_, time| {
        if time >= told + 50.0 * bench.step_ms {
            told = time;
            report(&format!(
                "{time:.0} of {:.0} ms, {:.1} s",
                bench.cycle_ms,
                begun.elapsed().as_secs_f64()
            ));
        }
    })?;
    let Beat {
        mut ventricle,
        seconds_total,
        biomarkers,
        ..
    } = done;

    report("kernels");
    let (nodes, elements) = (subject.nodes, subject.elements);
    let mut seconds = |kernel| fastest(|| ventricle.run(kernel));
    let per_tet = |seconds: f64| 1e9 * seconds * n_ranks as f64 / elements as f64;
    let ns_per_tet = NsPerTet {
        deform: per_tet(seconds(Kernel::Deform)),
        forces: per_tet(seconds(Kernel::Forces)),
        forces_tangent_scatter: per_tet(seconds(Kernel::Tangent)),
    };
    let ms_per_krylov_iteration =
        1e3 * seconds(Kernel::Krylov(KRYLOV_ITERATIONS)) / f64::from(KRYLOV_ITERATIONS);
    let bytes = ventricle.krylov_bytes();
    let total = ventricle.work();
    drop(ventricle);
    let Costs {
        peaks,
        beat_peak_mb,
        processor_seconds,
    } = costs(ranks, before_mb, done.processor_seconds_total);
    let triad = triad_gb_per_s(n_ranks);
    let krylov = 1e-6 * bytes / ms_per_krylov_iteration;
    let most = done.of_ranks.iter().map(|r| r.elements).max().unwrap_or(0) as f64;
    let ranks = done
        .of_ranks
        .iter()
        .zip(peaks.iter().map(Some).chain(std::iter::repeat(None)));
    Ok(VentricleTiming {
        nodes,
        elements,
        degrees_of_freedom: 3 * nodes,
        element: bench.element,
        threads: n_ranks,
        diverged: done.diverged,
        failed_checks: done.failed_checks,
        steps: done.steps,
        steps_cut: done.steps_cut,
        seconds_total,
        processor_seconds_total: processor_seconds,
        seconds_per_phase: done.seconds_per_phase,
        seconds_mesh: subject.seconds_mesh,
        seconds_inflation: subject.seconds_inflation,
        seconds_setup: done.seconds_setup,
        peak_memory_MB: peaks.iter().sum(),
        beat_peak_memory_MB: beat_peak_mb,
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
        elements_of_fullest_rank_over_share: most * n_ranks as f64 / elements as f64,
        ranks: ranks
            .map(|(figures, peak)| OfRank {
                figures: *figures,
                peak_memory_MB: peak.copied().filter(|_| peaks.len() > 1),
            })
            .collect(),
        biomarkers,
        processor: processor(),
    })
}

/// Memory and processor time of all processes.
pub(super) struct Costs {
    /// Peak memory of each process \[MB\].
    peaks: Vec<f64>,
    /// Sum over processes of the peak memory since [`anew`] \[MB\].
    beat_peak_mb: f64,
    /// Processor time of all processes \[s\].
    processor_seconds: f64,
}

/// Costs of all processes. Collective if there are several.
///
/// - `before_mb`: the peak memory that [`anew`] returned in this process
pub(super) fn costs(ranks: Ranks<'_>, before_mb: f64, own_cpu_s: f64) -> Costs {
    let beat_mb = peak_memory_mb();
    let own = [beat_mb.max(before_mb), beat_mb, own_cpu_s];
    let all = match ranks {
        Ranks::Threads(_) => vec![own.to_vec()],
        Ranks::Team(team) => team.comm().gather(&own).unwrap_or_default(),
    };
    let sum = |k: usize| all.iter().map(|costs| costs[k]).sum();
    Costs {
        peaks: all.iter().map(|costs| costs[0]).collect(),
        beat_peak_mb: sum(1),
        processor_seconds: sum(2),
    }
}

/// Resets the peak memory, so that memory freed before this call does not count. Returns the peak
/// up to the call \[MB\].
pub(super) fn anew() -> f64 {
    let before_mb = peak_memory_mb();
    forget_peak_memory();
    before_mb
}

/// Time of the fastest of several calls in seconds, because interruptions only ever add time. One
/// call is made first as a warm-up.
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

/// Divides the beat's wall time among its phases.
struct Phases {
    seconds: SecondsPerPhase,
    last: Instant,
    ejected: bool,
}

impl Phases {
    fn begun() -> Self {
        Self {
            seconds: SecondsPerPhase::default(),
            last: Instant::now(),
            ejected: false,
        }
    }

    /// Adds the time since the last output interval to the phase that the valves show at the end of
    /// it.
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
