//! Step 2 as tasks: the targets of the fit, and the fitted cell in the organ. Pure functions.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::outcome::{Artefact, CellFitResult, TargetsResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::CalciumSource;
use cardiotwin_schemas::task::{CellFitSpec, InputFile};

use crate::stream::stream;

/// Specification of the fit of a patient's cell.
#[must_use]
pub fn cell_fit(
    plan: &ResolvedPatient,
    targets: &TargetsResult,
    calcium: Option<InputFile>,
) -> CellFitSpec {
    let settings = plan.settings.step2.clone();
    CellFitSpec {
        cycle_length_ms: plan.step0.cycle_length_ms,
        lambda_0: targets.lambda_0,
        lambda_max: targets.lambda_max,
        targets: targets.targets,
        seed: stream(settings.seed, plan.random_stream().as_str()),
        fixed: settings.frozen.clone(),
        calcium,
        settings,
    }
}

/// Calcium as a fixed input: the measured transient, or else the median over the organ's nodes;
/// `None` if Rice's transient is fitted.
///
/// # Errors
/// [`Failure`] of class input if a fixed input is wanted and does not exist.
pub fn calcium(
    plan: &ResolvedPatient,
    targets: &TargetsResult,
    artefacts: &[Artefact],
    directory: &Path,
) -> Result<Option<InputFile>, Failure> {
    if plan.settings.step2.calcium == CalciumSource::Rice {
        return Ok(None);
    }
    if plan.calcium.is_some() {
        return Ok(plan.calcium.clone());
    }
    match artefacts
        .iter()
        .find(|a| a.name == "median")
        .filter(|_| targets.has_calcium)
    {
        Some(median) => Ok(Some(InputFile {
            name: "calcium".into(),
            path: directory.join(&median.file),
            sha256: median.sha256.clone(),
        })),
        None => Err(Failure {
            class: FailureClass::Input,
            message: "step2.calcium is \"median-trace\", but there is no calcium trace: \
                      patient.toml names none (measured.calcium), and step 1's Tanh model has no \
                      calcium to take a median of"
                .to_owned(),
            remedy: Some(
                "add calcium = \"calcium.csv\" (columns time_ms,Ca_uM from activation on) to \
                 [measured], or set step2.calcium = \"rice\"; Rice's transient stays fixed if its \
                 four parameters are removed from step2.parameters"
                    .to_owned(),
            ),
            cause: None,
        }),
    }
}

/// Parameters of the fitted cell in the organ: frozen and fitted values, without `a_p`. That is the
/// passive stress of the 0D cell, and the organ has its own.
#[must_use]
pub fn cell_parameters(plan: &ResolvedPatient, fit: &CellFitResult) -> BTreeMap<String, f64> {
    let mut parameters = plan.settings.step2.frozen.clone();
    parameters.extend(fit.parameters.iter().map(|p| (p.name.clone(), p.value)));
    parameters.remove("a_p_kPa");
    parameters
}

/// Contraction of the verification beat.
#[must_use]
pub fn contraction(
    plan: &ResolvedPatient,
    fit: &CellFitResult,
    calcium: Option<InputFile>,
) -> ContractionSpec {
    let lambda_0 = fit.lambda_0;
    let parameters = cell_parameters(plan, fit);
    match calcium {
        None => ContractionSpec::Land2017Rice {
            parameters,
            lambda_0,
        },
        Some(calcium) => ContractionSpec::Land2017Trace {
            parameters,
            lambda_0,
            calcium,
        },
    }
}
