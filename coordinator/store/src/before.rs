//! A patient's simulations before effects were accepted, found among all present and former tasks
//! of the chain.

use std::collections::HashMap;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::outcome::{OrganBeatResult, PassiveStateResult, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::{BeforeEffects, TaskRecord};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_workflow::patient::Stage;

use super::record::Settled;

/// A present or former task of a step.
#[derive(Debug)]
pub(super) struct Was {
    pub(super) stage: Stage,
    pub(super) key: TaskKey,
    /// `None` for a specification in an earlier format.
    pub(super) spec: Option<TaskSpec>,
}

fn beat(result: &TaskResult) -> Option<OrganBeatResult> {
    match result {
        TaskResult::OrganBeat(result) => Some(result.clone()),
        _ => None,
    }
}

/// The latest simulations of the same ventricle without any of the plan's effects; `None` if there
/// are none.
///
/// - `history`: present and former tasks of the patient's steps, oldest first
pub(super) fn before(
    plan: &ResolvedPatient,
    step0: Option<&PassiveStateResult>,
    history: &[Was],
    settled: &HashMap<TaskKey, Settled>,
) -> Option<BeforeEffects> {
    let organ = &step0?.organ;
    let simulated = |was: &Was| -> Option<TaskRecord<OrganBeatResult>> {
        let Some(TaskSpec::OrganBeat(spec)) = &was.spec else {
            return None;
        };
        let lacks = |name: &str| {
            spec.circulation
                .effects
                .iter()
                .all(|effect| effect.name != name)
        };
        if !same_ventricle(organ, &spec.organ)
            || !plan.effects.iter().all(|effect| lacks(&effect.name))
        {
            return None;
        }
        settled.get(&was.key)?.record(&was.key, beat)
    };
    let of = |stage: Stage| history.iter().rev().filter(move |was| was.stage == stage);
    // The best simulation of step 1 is the one whose nodal traces became targets.
    let taken = |was: &Was| {
        let Some(TaskSpec::Targets(targets)) = &was.spec else {
            return None;
        };
        of(Stage::Step1).filter_map(&simulated).find(|run| {
            run.artefacts
                .iter()
                .any(|artefact| artefact.name == "nodal" && artefact.sha256 == targets.nodal.sha256)
        })
    };
    let found = BeforeEffects {
        step1: of(Stage::Targets).find_map(taken),
        verification: of(Stage::Verification).find_map(&simulated),
    };
    (found.step1.is_some() || found.verification.is_some()).then_some(found)
}

/// Whether two ventricles have the same kind and, in 3D, meshes of equally many nodes.
fn same_ventricle(a: &OrganSpec, b: &OrganSpec) -> bool {
    match (a, b) {
        (OrganSpec::Reduced { .. }, OrganSpec::Reduced { .. }) => true,
        (OrganSpec::FiniteElement(a), OrganSpec::FiniteElement(b)) => {
            a.figures.nodes == b.figures.nodes
        }
        _ => false,
    }
}
