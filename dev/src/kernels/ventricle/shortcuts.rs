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

/// Relative tolerance of the tight run with a factorised tangent.
const TIGHT: f64 = 1e-8;
/// Relative tolerance of the tight run on meshes whose tangent is not factorised.
const TIGHT_BY_ITERATION: f64 = 1e-6;

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

/// A way to run the beat.
struct Way {
    name: &'static str,
    settings: StepSettings,
    /// Length of a step as a multiple of the usual one.
    step: f64,
    /// Longest step of late filling as a multiple of other steps; `None` for the benchmark's, which is a cohort's default.
    late_filling: Option<f64>,
    /// Whether steps are of one length, but in late filling.
    is_even: bool,
    /// Whether the solver's state is discarded after each step.
    forgets: bool,
}

/// Number of nodes up to which the tangent is factorised.
const FACTORISED: usize = 20_000;

fn ways(tolerance: f64, nodes: usize) -> Vec<Way> {
    let usual = StepSettings {
        relative_tolerance: tolerance,
        ..StepSettings::default()
    };
    let way = |name, settings| Way {
        name,
        settings,
        step: 1.0,
        late_filling: None,
        is_even: false,
        forgets: false,
    };
    let tight = if nodes > FACTORISED {
        let settings = StepSettings {
            relative_tolerance: TIGHT_BY_ITERATION,
            linear: LinearSolver::BlockJacobi,
            ..usual
        };
        way(
            "tight: tolerance 1e-6, single precision, block Jacobi",
            settings,
        )
    } else {
        let settings = StepSettings {
            relative_tolerance: TIGHT,
            linear: LinearSolver::Direct,
            max_iterations: 40,
            ..usual
        };
        way(
            "tight: tolerance 1e-8, double precision, factorised",
            settings,
        )
    };
    let late = |name, times| Way {
        late_filling: Some(times),
        is_even: true,
        ..way(name, usual)
    };
    let mut ways = vec![
        Way {
            late_filling: Some(1.0),
            ..tight
        },
        way("default", usual),
        late("steps of one length", 1.0),
        late("steps of late filling twice as long", 2.0),
        late("steps of late filling four times as long", 4.0),
        late("steps of late filling eight times as long", 8.0),
        way(
            "Newton's tolerance 1e-3",
            StepSettings {
                relative_tolerance: 1e-3,
                ..usual
            },
        ),
        way(
            "no guess from recent corrections",
            StepSettings {
                kept_corrections: 0,
                ..usual
            },
        ),
        way(
            "single precision, no levels of rigid motions",
            StepSettings {
                linear: LinearSolver::BlockJacobi,
                ..usual
            },
        ),
        Way {
            step: 2.0,
            is_even: true,
            ..way("steps twice as long", usual)
        },
    ];
    if nodes <= FACTORISED {
        ways.extend([
            way(
                "Newton's tolerance 1e-6",
                StepSettings {
                    relative_tolerance: 1e-6,
                    ..usual
                },
            ),
            way(
                "no predictor",
                StepSettings {
                    extrapolate: false,
                    ..usual
                },
            ),
            Way {
                forgets: true,
                ..way("solves begin at zero, not at the last response", usual)
            },
            way(
                "matrix in double precision, symmetric sweep",
                StepSettings {
                    linear: LinearSolver::SymmetricSweep,
                    ..usual
                },
            ),
            way(
                "multigrid",
                StepSettings {
                    linear: LinearSolver::Multigrid,
                    ..usual
                },
            ),
            way(
                "factorised, kept while it serves",
                StepSettings {
                    linear: LinearSolver::Direct,
                    ..usual
                },
            ),
        ]);
    }
    ways
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
    for way in ways(bench.tolerance, subject.nodes) {
        let Way { name, settings, .. } = way;
        report(name);
        let diastolic_step_ms =
            (way.late_filling).map_or(bench.diastolic_step_ms, |times| times * bench.step_ms);
        let bench = VentricleBench {
            step_ms: way.step * bench.step_ms,
            diastolic_step_ms,
            longest_step_ms: if way.is_even {
                0.0
            } else {
                bench.longest_step_ms
            },
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
            if way.forgets {
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
