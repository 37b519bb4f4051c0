//! Time that each shortcut of the time steps saves, and its error in the biomarkers against a run
//! with a tight tolerance.

use std::fmt;

use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_schemas::biomarkers::Biomarkers;
use serde::Serialize;

use super::figures::{BenchError, REPORTED, Ranks, VentricleBench};
use super::measure::{Beat, beat};
use super::subject::Subject;
use cardiotwin_worker::stop::StopFlag;

/// Relative tolerance of the tight run.
const TIGHT: f64 = 1e-8;

/// One way to run the beat.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shortcut {
    /// Difference from the default settings.
    pub name: String,
    /// Wall time of the beat.
    pub seconds: f64,
    /// Newton iterations per step.
    pub newton_per_step: f64,
    /// Krylov iterations per step.
    pub krylov_per_step: f64,
    /// Time and reason if the beat did not reach its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diverged: Option<String>,
    /// Biomarkers of the beat.
    #[serde(serialize_with = "super::figures::reported")]
    pub biomarkers: Biomarkers,
    /// Relative differences of the biomarkers from the tight run's \[%\], in the order in
    /// which they are written.
    pub off_percent: [Option<f64>; 5],
}

/// All runs of the comparison, the tight one first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shortcuts {
    /// Number of nodes in the mesh.
    pub nodes: usize,
    /// Number of tetrahedra in the mesh.
    pub elements: usize,
    /// Number of threads; factorisation and multigrid use one.
    pub threads: usize,
    /// One row for each way.
    pub rows: Vec<Shortcut>,
}

fn off(found: &Biomarkers, tight: &Biomarkers) -> [Option<f64>; 5] {
    REPORTED.map(|biomarker| Some(100.0 * (found.get(biomarker)? / tight.get(biomarker)? - 1.0)))
}

/// Name, settings, time step and late-filling step (both as multiples of the default step), and
/// whether the solver's state is discarded after each step.
type Way = (&'static str, StepSettings, [f64; 2], bool);

fn ways(tolerance: f64) -> Vec<Way> {
    let usual = StepSettings {
        relative_tolerance: tolerance,
        ..StepSettings::default()
    };
    let tight = StepSettings {
        relative_tolerance: TIGHT,
        linear: LinearSolver::Direct,
        max_iterations: 40,
        ..usual
    };
    vec![
        (
            "tight: tolerance 1e-8, double precision, factorised",
            tight,
            [1.0, 0.0],
            false,
        ),
        ("default", usual, [1.0, 0.0], false),
        (
            "Newton's tolerance 1e-6",
            StepSettings {
                relative_tolerance: 1e-6,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "Newton's tolerance 1e-3",
            StepSettings {
                relative_tolerance: 1e-3,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "no predictor",
            StepSettings {
                extrapolate: false,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "no guess from recent corrections",
            StepSettings {
                kept_corrections: 0,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "block Jacobi alone, without levels of rigid motions",
            StepSettings {
                linear: LinearSolver::BlockJacobi,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "solves begin at zero, not at the last response",
            usual,
            [1.0, 0.0],
            true,
        ),
        (
            "matrix in double precision, symmetric sweep",
            StepSettings {
                linear: LinearSolver::SymmetricSweep,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "multigrid",
            StepSettings {
                linear: LinearSolver::Multigrid,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "factorised, kept while it serves",
            StepSettings {
                linear: LinearSolver::Direct,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        (
            "factorised anew each iteration",
            StepSettings {
                linear: LinearSolver::Direct,
                keep_until: 1,
                ..usual
            },
            [1.0, 0.0],
            false,
        ),
        ("steps twice as long", usual, [2.0, 0.0], false),
        (
            "steps of late filling twice as long",
            usual,
            [1.0, 2.0],
            false,
        ),
        (
            "steps of late filling four times as long",
            usual,
            [1.0, 4.0],
            false,
        ),
        (
            "steps of late filling eight times as long",
            usual,
            [1.0, 8.0],
            false,
        ),
    ]
}

/// Runs the beats one after the other.
///
/// # Errors
/// Same as for [`super::ventricle`].
pub fn shortcuts(
    bench: &VentricleBench,
    threads: usize,
    stop: &StopFlag,
    mut report: impl FnMut(&str),
) -> Result<Shortcuts, BenchError> {
    let subject = Subject::new(
        bench.nodes,
        bench.element,
        &[Ranks::Threads(threads)],
        stop,
        &mut report,
    )?;
    let mut rows: Vec<Shortcut> = vec![];
    for (name, settings, [longer, of_filling], forgets) in ways(bench.tolerance) {
        report(name);
        let diastolic_step_ms = of_filling * bench.step_ms;
        let bench = VentricleBench {
            step_ms: longer * bench.step_ms,
            diastolic_step_ms,
            ..*bench
        };
        let ranks = Ranks::Threads(if settings.linear.is_parallel() {
            threads
        } else {
            1
        });
        let Beat {
            ventricle,
            seconds_total,
            diverged,
            biomarkers,
            ..
        } = beat(&subject, &bench, settings, ranks, stop, |ventricle, _| {
            if forgets {
                ventricle.forget_solver();
            }
        })?;
        let work = ventricle.work();
        let steps = work.steps.max(1) as f64;
        let off_percent = off(
            &biomarkers,
            rows.first().map_or(&biomarkers, |tight| &tight.biomarkers),
        );
        rows.push(Shortcut {
            name: name.to_owned(),
            seconds: seconds_total,
            newton_per_step: work.newton_iterations as f64 / steps,
            krylov_per_step: work.krylov_iterations as f64 / steps,
            diverged,
            biomarkers,
            off_percent,
        });
    }
    Ok(Shortcuts {
        nodes: subject.nodes,
        elements: subject.elements,
        threads,
        rows,
    })
}

impl fmt::Display for Shortcuts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} nodes, {} tetrahedra; {} threads where the solver has several",
            self.nodes, self.elements, self.threads
        )?;
        writeln!(
            f,
            "{:<52} {:>8} {:>7} {:>7}   {:>8} {:>8} {:>8} {:>8} {:>8}",
            "", "s", "Newton", "Krylov", "P_max", "PTD90", "dPdt_max", "dPdt_min", "SV"
        )?;
        writeln!(
            f,
            "{:<52} {:>8} {:>7} {:>7}   {:>8}",
            "", "", "a step", "a step", "% off the tight run"
        )?;
        for row in &self.rows {
            write!(
                f,
                "{:<52} {:>8.1} {:>7.2} {:>7.1}  ",
                row.name, row.seconds, row.newton_per_step, row.krylov_per_step
            )?;
            for off in row.off_percent {
                match off {
                    Some(off) => write!(f, " {off:>8.4}")?,
                    None => write!(f, " {:>8}", "-")?,
                }
            }
            match &row.diverged {
                Some(why) => writeln!(f, "  diverged {why}")?,
                None => writeln!(f)?,
            }
        }
        Ok(())
    }
}
