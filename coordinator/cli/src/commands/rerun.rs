//! `cardiotwin rerun`: new settings for one patient from a given step on. (`retry` keeps the
//! settings.)

use cardiotwin_engine::{self as engine, Stage};
use cardiotwin_input::{Layer, Report, check_on_top, nearest};
use cardiotwin_report::results::PatientView;
use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::CELL_PARAMETERS;
use cardiotwin_schemas::step1::Step1Parameter;
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::store::open;
use crate::talk::{Talk, count};
use crate::{answer, problems};

/// Redo a patient from a step on with other settings; step 1 continues from its stored iterations
#[derive(Debug, Args)]
#[command(
    after_help = "The settings are stored for this patient and override all files until another \
                  rerun changes them.\n\
                  `cardiotwin config show --origin --patient PATIENT` shows them.\n\
                  To repeat a failed task with the same settings, use `cardiotwin retry`."
)]
pub struct RerunArgs {
    /// Name of the patient
    patient: String,
    /// First step to redo: step0, step1, targets, step2, verification, step3 or posterior
    #[arg(long, value_name = "STEP")]
    from: Stage,
    /// Damping of step 1's updates; 1 as in the paper, smaller values take shorter steps
    #[arg(long, value_name = "D")]
    damping: Option<f64>,
    /// Bounds of a parameter (may be given several times)
    #[arg(long, value_name = "KEY=LO:HI")]
    bounds: Vec<String>,
    /// Value of any other setting (may be given several times)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    of: OfCohort,
}

/// Checks the settings and requests the rerun.
///
/// # Errors
/// [`CliError::Input`] for invalid settings, [`CliError::Usage`] for invalid arguments; errors of
/// the engine.
pub async fn execute(args: &RerunArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let patient = PatientId(args.patient.clone());
    let record = open(&folders).await?.patient_record(&patient).await?;
    let mut assignments: Vec<String> = args
        .damping
        .iter()
        .map(|d| format!("step1.damping={d}"))
        .collect();
    for bounds in &args.bounds {
        assignments.push(bounds_assignment(bounds, args.from).map_err(CliError::Usage)?);
    }
    assignments.extend(args.set.iter().cloned());
    let mut report = Report::default();
    let layer = Layer::from_command_line(&assignments, &mut report);
    check_on_top(&record.plan.settings, &layer, &mut report);
    if report.n_errors() > 0 {
        problems::say(&report, talk);
        return Err(CliError::Input {
            errors: count(report.n_errors(), "error"),
        });
    }
    let overrides: SettingsLayer = serde_json::from_value(layer.into_value())
        .map_err(|error| CliError::Usage(format!("these settings cannot be stored: {error}")))?;
    let answer = engine::rerun(&folders.run, &patient, args.from, &overrides).await?;
    answer::tell(&answer, Some(&folders), talk)?;
    if args.from == Stage::Step1 && PatientView(&record).step1_converged() && only_way(&assignments)
    {
        talk.hint(
            "step 1 of this patient had converged and ends there again: a smaller \
             `--set step1.tolerance=` lets it continue",
        );
    }
    Ok(Exit::Ok)
}

/// Whether assignments change only the way of step 1, and not where it ends.
fn only_way(assignments: &[String]) -> bool {
    let of_way = ["step1.damping", "step1.bounds"];
    (assignments.iter()).all(|text| of_way.iter().any(|key| text.starts_with(key)))
}

/// `KEY=LO:HI` as an assignment to a setting of the step that fits the parameter.
fn bounds_assignment(text: &str, from: Stage) -> Result<String, String> {
    let wrong = || format!("--bounds {text}: expected KEY=LO:HI, for example t_CR_ms=200:600");
    let (key, range) = text.split_once('=').ok_or_else(wrong)?;
    let (low, high) = range.split_once(':').ok_or_else(wrong)?;
    let low: f64 = low.trim().parse().map_err(|_| wrong())?;
    let high: f64 = high.trim().parse().map_err(|_| wrong())?;
    let (organ, cell) = (
        Step1Parameter::KEYS.contains(&key),
        CELL_PARAMETERS.contains(&key),
    );
    // Smax_ref_kPa is a parameter of both models, so that `--from` decides.
    let table = match (organ, cell) {
        (true, true) if from == Stage::Step2 => "step2",
        (true, _) => "step1",
        (false, true) => "step2",
        (false, false) => {
            let known = || Step1Parameter::KEYS.iter().chain(&CELL_PARAMETERS).copied();
            let meant = nearest(key, known()).map(|meant| format!("; did you mean `{meant}`?"));
            return Err(format!(
                "--bounds {text}: unknown parameter `{key}`{}",
                meant.unwrap_or_default()
            ));
        }
    };
    Ok(format!("{table}.bounds.{key}=[{low:?}, {high:?}]"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damping_and_bounds_change_only_the_way_of_step_1() {
        let of =
            |texts: &[&str]| only_way(&texts.iter().map(|t| (*t).to_owned()).collect::<Vec<_>>());
        assert!(of(&[]) && of(&["step1.damping=0.5", "step1.bounds.t_CR_ms=[1.0, 2.0]"]));
        assert!(!of(&["step1.damping=0.5", "step1.tolerance=0.01"]));
    }

    #[test]
    fn bounds_go_to_the_step_that_fits_the_parameter() {
        let of = |text, from| bounds_assignment(text, from).unwrap();
        assert_eq!(
            of("t_CR_ms=200:600", Stage::Step1),
            "step1.bounds.t_CR_ms=[200.0, 600.0]"
        );
        assert_eq!(
            of("a_p_kPa=1:200", Stage::Step1),
            "step2.bounds.a_p_kPa=[1.0, 200.0]"
        );
        assert_eq!(
            of("Smax_ref_kPa=1:200", Stage::Step2),
            "step2.bounds.Smax_ref_kPa=[1.0, 200.0]"
        );
        assert!(
            bounds_assignment("t_CR=1:2", Stage::Step1)
                .unwrap_err()
                .contains("did you mean `t_CR_ms`?")
        );
        assert!(
            bounds_assignment("t_CR_ms=1", Stage::Step1)
                .unwrap_err()
                .contains("KEY=LO:HI")
        );
    }
}
