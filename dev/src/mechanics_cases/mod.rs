//! Mechanics benchmarks that are described by a file: `cardiotwin-dev mechanics-case FILE.toml`.
//! `docs/benchmark-runner.md` describes the format.

pub mod error;
pub mod file;
pub mod model;
pub mod names;
pub mod output;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_dev_solver::prescribed::{ProblemError, RunCost, Schedule, run, settle};
use cardiotwin_mechanics::dynamics::Rayleigh;
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mechanics::statics::LoadSteps;
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;
use cardiotwin_schemas::finite_element::FiniteElementSettings;

use cardiotwin_worker::error::chain;
use cardiotwin_worker::finite_element::wall;
use cardiotwin_worker::stop::StopFlag;
pub use error::CaseError;
use file::{CaseFile, TimeTable};
use model::Model;
use output::Table;

/// Size, cost and output of a computed benchmark.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseSummary {
    /// Title in the file.
    pub title: String,
    /// Kind of finite elements.
    pub element: ElementKind,
    /// Number of tetrahedra in the mesh.
    pub n_tets: usize,
    /// Number of degrees of freedom.
    pub n_dofs: usize,
    /// Steps and iterations; for a static problem, load steps and Newton iterations.
    pub cost: RunCost,
    /// Wall time, from reading the file to the last row of the table \[s\].
    pub seconds: f64,
    /// File of the table; `None` for standard output.
    pub table: Option<PathBuf>,
}

impl std::fmt::Display for CaseSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let RunCost {
            steps,
            n_cut,
            newton_iterations,
            krylov_iterations,
            factorisations,
        } = self.cost;
        write!(
            f,
            "{} elements ({}), {} degrees of freedom: {steps} steps ({n_cut} cut), {newton_iterations} Newton and \
             {krylov_iterations} linear iterations, {factorisations} factorisations, {:.1} s",
            self.n_tets, self.element, self.n_dofs, self.seconds
        )
    }
}

/// Method of the computation: everything that does not belong to the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Method {
    element: ElementKind,
    scheme: GeneralisedAlpha,
    steps: StepSettings,
}

impl Method {
    /// The default method of a cohort.
    fn of_a_cohort() -> Self {
        let settings = FiniteElementSettings::default();
        let anatomy = settings.anatomy(&[]);
        Self {
            element: wall::element(anatomy.element, anatomy.wall.pointwise_share),
            scheme: wall::parameters(&anatomy.wall, 1.0, 0.0).scheme(),
            steps: wall::steps(&settings.equations(), settings.newton_iterations),
        }
    }

    /// The method that the file describes, or a cohort's default with `as_cohort`.
    fn of(file: &Path, parsed: &CaseFile, as_cohort: bool) -> Result<Self, CaseError> {
        let cohort = Self::of_a_cohort();
        if as_cohort {
            return Ok(cohort);
        }
        let scheme = match &parsed.time {
            TimeTable::Dynamic {
                alpha_m, alpha_f, ..
            } => GeneralisedAlpha::with_weights(*alpha_m, *alpha_f).map_err(|e| {
                let found = format!("{alpha_m}, {alpha_f}");
                CaseError::key(file, "time.alpha_m, time.alpha_f", found, e.to_string())
            })?,
            TimeTable::Static { .. } => cohort.scheme,
        };
        let solver = &parsed.solver;
        let steps = StepSettings {
            relative_tolerance: solver.relative_tolerance,
            least_pressure_kpa: solver.least_pressure_kpa,
            max_iterations: solver.max_iterations,
            linear: wall::linear_solver(solver.linear),
            ..StepSettings::default()
        };
        Ok(Self {
            element: names::element(file, &parsed.element)?,
            scheme,
            steps,
        })
    }
}

/// Reads `file`, computes it and writes the table to `out` (standard output if `None`). `progress`
/// receives a line from time to time. With `as_cohort`, elements, time integration and step
/// settings are a cohort's defaults, whatever the file says; laws, loads, supports and damping stay
/// those of the problem. If an error or `stop` ends the computation early, the table holds the rows
/// up to that time.
///
/// # Errors
/// [`CaseError`] with the file and key, or with the time that the computation reached.
pub fn run_case(
    file: &Path,
    as_cohort: bool,
    out: Option<&Path>,
    stop: &StopFlag,
    progress: &mut dyn FnMut(&str),
) -> Result<CaseSummary, CaseError> {
    let watch = Instant::now();
    let text = std::fs::read_to_string(file).map_err(|source| CaseError::Read {
        file: file.to_owned(),
        source,
    })?;
    let parsed: CaseFile = toml::from_str(&text).map_err(|source| CaseError::Format {
        file: file.to_owned(),
        source: Box::new(source),
    })?;
    let method = Method::of(file, &parsed, as_cohort)?;
    let model = Model::read(file, &parsed)?;
    let setup = model
        .problem(method.element)?
        .set_up()
        .map_err(|e| by_name(file, &parsed, &e))?;
    let (n_tets, n_dofs) = (model.mesh.n_tets(), 3 * setup.body.n_nodes());
    progress(&format!(
        "{}: {n_tets} elements ({}), {n_dofs} degrees of freedom",
        parsed.title, method.element
    ));
    let mut table = Table::create(&parsed, out)?;
    let cost = match &parsed.time {
        TimeTable::Static {
            at_ms,
            first_load_step,
        } => {
            let mut steps = LoadSteps {
                first: *first_load_step,
                ..LoadSteps::default()
            };
            steps.newton.linear = method.steps.linear;
            let (sample, report) =
                settle(&setup, *at_ms, &steps).map_err(|e| CaseError::Failed(chain(&e)))?;
            table.row(&sample)?;
            RunCost {
                steps: report.steps.len(),
                n_cut: report.n_cut,
                newton_iterations: report.iterations(),
                ..RunCost::default()
            }
        }
        TimeTable::Dynamic {
            mass_damping_per_ms,
            stiffness_damping_ms,
            ..
        } => {
            let schedule = names::schedule(file, &parsed.time)?;
            let damping = Rayleigh {
                mass_per_ms: *mass_damping_per_ms,
                stiffness_ms: *stiffness_damping_ms,
            };
            let Method { scheme, steps, .. } = &method;
            move_body(
                setup, *scheme, damping, &schedule, steps, &mut table, &watch, stop, progress,
            )?
        }
    };
    table.finish()?;
    Ok(CaseSummary {
        title: parsed.title,
        element: method.element,
        n_tets,
        n_dofs,
        cost,
        seconds: watch.elapsed().as_secs_f64(),
        table: out.map(Path::to_owned),
    })
}

/// Converts an error of the problem, and names the probe or cavity as the file does.
fn by_name(file: &Path, parsed: &CaseFile, error: &ProblemError) -> CaseError {
    match error {
        ProblemError::Probe {
            probe,
            at: [x, y, z],
            outside,
        } => {
            let name = parsed
                .probe
                .get(*probe)
                .map_or_else(|| probe.to_string(), |p| p.name.clone());
            let found = format!(
                "({x:.3}, {y:.3}, {z:.3}) mm, outside of every element (smallest barycentric coordinate in the nearest {outside:.2})"
            );
            CaseError::key(
                file,
                format!("probe {name:?}: at_mm"),
                found,
                "a place in the tissue, in mm",
            )
        }
        ProblemError::Cavity { cavity, source } => {
            let name = parsed
                .cavity
                .get(*cavity)
                .map_or_else(|| cavity.to_string(), |c| c.name.clone());
            let expected = "surfaces that enclose it but for openings";
            CaseError::key(
                file,
                format!("cavity {name:?}: surfaces"),
                source.to_string(),
                expected,
            )
        }
        error => CaseError::key(file, "mesh", chain(error), "a body that can be built"),
    }
}

#[expect(clippy::too_many_arguments, reason = "the dynamic half of `run_case`")]
fn move_body(
    setup: cardiotwin_dev_solver::prescribed::Setup,
    scheme: GeneralisedAlpha,
    damping: Rayleigh,
    schedule: &Schedule,
    settings: &StepSettings,
    table: &mut Table,
    watch: &Instant,
    stop: &StopFlag,
    progress: &mut dyn FnMut(&str),
) -> Result<RunCost, CaseError> {
    let mut failure = None;
    let mut told = 0.0;
    let result = run(
        setup,
        scheme,
        damping,
        schedule,
        settings,
        &mut |sample, cost| {
            if let Err(error) = table.row(sample) {
                failure = Some(error);
                return ControlFlow::Break(());
            }
            if stop.is_raised() {
                failure = Some(CaseError::Stopped { t_ms: sample.t_ms });
                return ControlFlow::Break(());
            }
            if watch.elapsed().as_secs_f64() > told + 10.0 {
                told = watch.elapsed().as_secs_f64();
                let RunCost {
                    newton_iterations: newton,
                    krylov_iterations: krylov,
                    ..
                } = cost;
                progress(&format!(
                    "{:.0} of {:.0} ms, {newton} Newton and {krylov} linear iterations, {told:.0} s",
                    sample.t_ms, schedule.end_ms
                ));
            }
            ControlFlow::Continue(())
        },
    );
    match failure {
        Some(error) => Err(error),
        None => result.map_err(|e| CaseError::Failed(chain(&e))),
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_mechanics::material::Law;
    use cardiotwin_mechanics::organ::WallParameters;
    use cardiotwin_schemas::finite_element::EquationSettings;

    use super::*;

    const CASE: &str = include_str!("../../../examples/benchmarks/arostica2025-lv-0a.toml");

    fn parsed() -> CaseFile {
        toml::from_str(CASE).unwrap()
    }

    #[test]
    fn verification_computes_with_what_a_ventricle_of_a_cohort_is_made_of() {
        let method = Method::of(Path::new("0a.toml"), &parsed(), true).unwrap();
        // Defaults of `organ`, which are the ventricle's own and not those of the settings.
        let steps = StepSettings::default();
        assert_eq!(
            method,
            Method {
                element: ElementKind::default(),
                scheme: WallParameters::default().scheme(),
                steps
            }
        );
        let own = Method::of(Path::new("0a.toml"), &parsed(), false).unwrap();
        assert_ne!(
            own, method,
            "the file asks for another share and other weights"
        );
    }

    #[test]
    fn a_files_parts_are_those_of_a_cohort_that_asks_for_the_same() {
        let mut file = parsed();
        let settings = FiniteElementSettings {
            newton_iterations: 20,
            ..FiniteElementSettings::default()
        };
        let equations = EquationSettings {
            tolerance: 1e-6,
            ..settings.equations()
        };
        file.element = toml::from_str("kind = \"quadratic-nodal\"").unwrap();
        file.solver.relative_tolerance = equations.tolerance;
        file.solver.max_iterations = 20;
        file.solver.linear = equations.linear_solver;
        let method = Method::of(Path::new("0a.toml"), &file, false).unwrap();
        assert_eq!(method.element, ElementKind::QUADRATIC_NODAL);
        assert_eq!(
            method.steps,
            wall::steps(&equations, settings.newton_iterations)
        );
        // The benchmark's law is the law that a cohort gets by `muscle_law = "holzapfel-ogden"`.
        let mut wall = settings.wall;
        wall.muscle_law = cardiotwin_schemas::muscle::MuscleLaw::HolzapfelOgden;
        let tissue = names::tissue(&file.tissue[0]);
        assert_eq!(tissue.law, wall::parameters(&wall, 1.0, 0.0).muscle);
        assert!(matches!(tissue.law, Law::HolzapfelOgden(_)));
    }

    #[test]
    fn an_element_is_named_or_told_by_its_parts() {
        let mut file = parsed();
        file.element = toml::from_str("kind = \"linear-nodal\"\npointwise_share = 0.1").unwrap();
        let refused = Method::of(Path::new("0a.toml"), &file, false)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("element.kind"), "{refused}");
    }
}
