//! Pilots: patients whose 3D beats teach the organ's law of all others of the cohort
//! (`workflow.pilots`). Pure functions.

use std::collections::BTreeSet;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::organ::{CellStretch, OrganSpec};
use cardiotwin_schemas::organ_law::{LawLesson, LessonBeat};
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::plan::ResolvedPatient;

use crate::chain::Chain;
use crate::derivation::Settled;
use crate::patient::Patient;

/// Names of the pilots: the first `n` by name of these patients.
pub fn choose<'a>(n: u32, candidates: impl Iterator<Item = &'a PatientId>) -> Vec<PatientId> {
    let sorted: BTreeSet<&PatientId> = candidates.collect();
    sorted.into_iter().take(n as usize).cloned().collect()
}

/// Whether a pilot in this state has taught all that it ever will: it is done, or failed for a
/// reason that lies in its data or in the model. After any other failure a retry may bring beats.
#[must_use]
pub fn has_taught(state: &Patient) -> bool {
    match state {
        Patient::Done => true,
        Patient::Failed { failure, .. } => {
            matches!(failure.class, FailureClass::Numerics | FailureClass::Input)
        }
        Patient::Waiting
        | Patient::Working { .. }
        | Patient::Deciding { .. }
        | Patient::Cancelled { .. } => false,
    }
}

/// What a pilot teaches: all beats of its chain, in the order of the chain; `None` if there is no
/// beat with samples.
#[must_use]
pub fn lesson<'a>(
    plan: &ResolvedPatient,
    chain: &Chain,
    settled: &dyn Fn(&TaskKey) -> Option<Settled<'a>>,
) -> Option<LawLesson> {
    let result = |key: &TaskKey| match settled(key)? {
        Settled::Published { result, .. } => Some(result),
        Settled::Failed(_) => None,
    };
    let TaskResult::PassiveState(step0) = result(chain.step0.as_ref()?)? else {
        return None;
    };
    let OrganSpec::FiniteElement(organ) = &step0.organ else {
        return None;
    };
    let of_step1 = chain.iterations.iter().map(|iteration| &iteration.task);
    let of_step3 = chain
        .step3_iterations
        .iter()
        .map(|iteration| &iteration.task);
    let mut seen = BTreeSet::new();
    let beats: Vec<LessonBeat> = of_step1
        .chain(&chain.verification)
        .chain(of_step3)
        .filter(|key| seen.insert(*key))
        .filter_map(|key| match result(key)? {
            TaskResult::OrganBeat(beat) => Some(LessonBeat {
                task: key.clone(),
                samples: beat.law.clone()?,
            }),
            _ => None,
        })
        .collect();
    let solver = &plan.settings.solver;
    (!beats.is_empty()).then(|| LawLesson {
        patient: plan.id.to_string(),
        figures: organ.figures,
        cell_stretch: CellStretch {
            origin: solver.cell_stretch,
            slack_stretch: solver.slack_stretch,
        },
        beats,
    })
}
