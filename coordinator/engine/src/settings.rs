//! A patient's plan: the cohort's files with the changes of reruns on top.

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{Settings, lay_over};
use cardiotwin_workflow::patient::Stage;
use serde::Serialize;
use serde_json::{Map, Value};

/// `given` with the tables of `overrides` laid over its settings, key by key.
///
/// # Errors
/// A `serde_json::Error` that names a key which makes no sense.
pub fn plan(
    given: &ResolvedPatient,
    overrides: &SettingsLayer,
) -> Result<ResolvedPatient, serde_json::Error> {
    let mut settings = table(&given.settings)?;
    lay_over(&mut settings, &table(overrides)?);
    Ok(ResolvedPatient {
        settings: serde_json::from_value::<Settings>(Value::Object(settings))?.into(),
        ..given.clone()
    })
}

/// Earlier overrides with later ones laid on top.
///
/// # Errors
/// None in practice: both are JSON already.
pub fn merged(
    earlier: &SettingsLayer,
    later: &SettingsLayer,
) -> Result<SettingsLayer, serde_json::Error> {
    let mut layer = table(earlier)?;
    lay_over(&mut layer, &table(later)?);
    serde_json::from_value(Value::Object(layer))
}

/// Settings as a table.
fn table<T: Serialize>(settings: &T) -> Result<Map<String, Value>, serde_json::Error> {
    serde_json::from_value(serde_json::to_value(settings)?)
}

/// The first table of a layer that acts on a stage before `from`, with that stage.
#[must_use]
pub fn acts_before(layer: &SettingsLayer, from: Stage) -> Option<(&'static str, Stage)> {
    let there = |table: &str| match table {
        "solver" => layer.solver.is_some(),
        "step1" => layer.step1.is_some(),
        "step2" => layer.step2.is_some(),
        "verification" => layer.verification.is_some(),
        "step3" => layer.step3.is_some(),
        "workflow" => layer.workflow.is_some(),
        _ => false,
    };
    FIRST_STAGES
        .into_iter()
        .find(|(table, stage)| there(table) && *stage < from)
}

/// The first stage that each table of settings acts on; later tables act on the posterior alone.
const FIRST_STAGES: [(&str, Stage); 6] = [
    ("solver", Stage::Step0),
    ("step1", Stage::Step1),
    ("step2", Stage::Step2),
    ("verification", Stage::Verification),
    ("step3", Stage::Step3),
    ("workflow", Stage::Step3),
];

/// The first stage that a setting acts on.
///
/// - `key`: dotted key, such as `step1.damping`
#[must_use]
pub fn first_stage(key: &str) -> Stage {
    let table = key.split('.').next();
    FIRST_STAGES
        .into_iter()
        .find(|(name, _)| Some(*name) == table)
        .map_or(Stage::Posterior, |(_, stage)| stage)
}

/// Whether two plans lead to the same tasks: executor settings and the paths of traces do not
/// count.
#[must_use]
pub fn same_tasks(a: &ResolvedPatient, b: &ResolvedPatient) -> bool {
    let bare = |plan: &ResolvedPatient| {
        let mut plan = plan.clone();
        plan.settings.executor = Default::default();
        for file in [&mut plan.step0.pressure, &mut plan.step0.volume]
            .into_iter()
            .flatten()
        {
            file.path.clear();
        }
        let flows = plan.step0.flows.files_mut();
        flows.for_each(|file| file.path.clear());
        plan
    };
    bare(a) == bare(b)
}
