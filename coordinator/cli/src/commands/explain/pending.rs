//! Changes of settings and files since the run took the patient up, which the next run would apply.

use cardiotwin_engine::{self as engine, Foreseen, LeafChange, Stage, Step};
use cardiotwin_input::Patient;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use serde::Serialize;

use super::places::{line, places};
use crate::error::CliError;
use crate::place::Folders;
use crate::redone::EXECUTION;
use crate::talk::count;

/// Beginning of the paths of settings in a plan.
const SETTINGS: &str = "settings.";
/// Ending of the paths of files, which are known by their content.
const FILE: &str = ".path";

/// Changes that the next run would apply to a patient.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pending {
    /// First task that would be computed again; absent if none would be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub redone_from: Option<String>,
    /// Each changed value of the plan, with the layer, or the file and line, that sets it.
    pub changes: Vec<PlacedChange>,
}

/// A changed value, and where it is set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlacedChange {
    #[serde(flatten)]
    change: LeafChange,
    /// Layer, or file and line.
    set_in: Vec<String>,
}

impl Pending {
    /// Changes between the stored plan and the cohort's files; `None` without any.
    ///
    /// # Errors
    /// Errors of the store.
    pub async fn of(
        before: &ResolvedPatient,
        patient: &Patient,
        plans: &[ResolvedPatient],
        folders: &Folders,
    ) -> Result<Option<Self>, CliError> {
        let Some(now) = &patient.resolved else {
            return Ok(None);
        };
        let json = |plan: &ResolvedPatient| serde_json::to_value(plan).unwrap_or_default();
        let changes: Vec<PlacedChange> = engine::leaf_changes(&json(before), &json(now))
            .into_iter()
            .filter(|change| changes_results(&change.path))
            .map(|change| PlacedChange {
                set_in: places(&change, Some(patient), &files(now)),
                change,
            })
            .collect();
        if changes.is_empty() {
            return Ok(None);
        }
        let foreseen = engine::foresee(&folders.run, plans).await?;
        let redone_from = match foreseen.get(&PatientId(patient.id.clone())) {
            Some(Foreseen::Redone(step) | Foreseen::GoesOn(step)) => Some(step.to_string()),
            // The patient continues when the pilots have ended.
            Some(Foreseen::Waits) => Some(Step::only(Stage::LearnLaw).to_string()),
            Some(Foreseen::Stays) | None => None,
        };
        Ok(Some(Self {
            redone_from,
            changes,
        }))
    }

    /// A line for each change, below a sentence about their effect.
    #[must_use]
    pub fn words(&self) -> String {
        let effect = match &self.redone_from {
            Some(step) => format!("the next run computes from {step} on"),
            None => "no task depends on them".to_owned(),
        };
        let n = count(self.changes.len(), "value");
        let mut text = format!("\nnot run yet: {n} changed since the last run; {effect}:\n");
        for placed in &self.changes {
            text.push_str(&line(&placed.change, &placed.set_in));
        }
        text
    }
}

/// Whether results may depend on a value of the plan: settings of the execution and the places of
/// files change none.
fn changes_results(path: &str) -> bool {
    let setting = path.strip_prefix(SETTINGS).unwrap_or_default();
    !setting.starts_with(EXECUTION) && !path.ends_with(FILE)
}

/// Measured files of a plan: their names in it, and their paths.
pub fn files(plan: &ResolvedPatient) -> Vec<(String, std::path::PathBuf)> {
    [&plan.step0.pressure, &plan.step0.volume]
        .into_iter()
        .flatten()
        .map(|file| (file.name.clone(), file.path.clone()))
        .collect()
}
