//! Conversion of rows to the record that reports, exports and comparisons read.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, TaskOutcome, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::{
    IterationRecord, PatientRecord, Step3IterationRecord, TaskRecord,
};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::Stage;
use cardiotwin_workflow::task::Task;
use sqlx::Row as _;
use sqlx::sqlite::SqliteRow;

use super::StoreError;
use super::writer::parse;

/// An element of a sweep with its result.
#[derive(Debug, Clone, PartialEq)]
pub struct MemberRecord {
    /// Plan of the element.
    pub plan: ResolvedPatient,
    /// Status of the element.
    pub status: PatientStatus,
    /// Failure that holds the element; `None` if there is none.
    pub failure: Option<Failure>,
    /// Published result; `None` while there is none.
    pub task: Option<TaskRecord<TaskResult>>,
}

/// A settled task as read from the database.
#[derive(Debug)]
pub(super) struct Settled {
    state: Task,
    outcome: Option<TaskOutcome>,
    directory: PathBuf,
}

pub(super) fn settled(row: &SqliteRow, run_dir: &Path) -> Result<(TaskKey, Settled), StoreError> {
    let (key, state): (String, String) = (row.get(0), row.get(1));
    let state = parse(&state, "tasks", "state", &key)?;
    let outcome: Option<String> = row.get(2);
    let place = format!("the outcome of task {key} in the database");
    let outcome = outcome
        .map(|text| OUTCOME.read(&place, text.as_bytes()))
        .transpose()?;
    let directory: Option<String> = row.get(3);
    Ok((
        TaskKey(key),
        Settled {
            state,
            outcome,
            directory: run_dir.join(directory.unwrap_or_default()),
        },
    ))
}

impl Settled {
    pub(super) fn record<T>(
        &self,
        key: &TaskKey,
        pick: impl Fn(&TaskResult) -> Option<T>,
    ) -> Option<TaskRecord<T>> {
        let (Task::Published { generation }, Some(outcome)) = (&self.state, &self.outcome) else {
            return None;
        };
        let Ending::Succeeded { result } = &outcome.ending else {
            return None;
        };
        Some(TaskRecord {
            key: key.clone(),
            generation: *generation,
            directory: self.directory.clone(),
            artefacts: outcome.artefacts.clone(),
            provenance: outcome.provenance.clone(),
            result: pick(result)?,
        })
    }

    fn failure(&self) -> Option<Failure> {
        match &self.state {
            Task::Failed { failure, .. } => Some(failure.clone()),
            _ => None,
        }
    }
}

/// Record of an element of a sweep, which is a patient with a chain of one task.
pub(super) fn member(
    plan: ResolvedPatient,
    status: PatientStatus,
    failure: Option<Failure>,
    chain: &Chain,
    settled: &HashMap<TaskKey, Settled>,
) -> MemberRecord {
    let task = chain
        .task
        .as_ref()
        .and_then(|key| settled.get(key)?.record(key, |result| Some(result.clone())));
    MemberRecord {
        plan,
        status,
        failure,
        task,
    }
}

pub(super) fn patient(
    plan: ResolvedPatient,
    status: PatientStatus,
    failure: Option<Failure>,
    chain: Chain,
    settled: &HashMap<TaskKey, Settled>,
) -> PatientRecord {
    fn find<T>(
        settled: &HashMap<TaskKey, Settled>,
        key: Option<&TaskKey>,
        pick: impl Fn(&TaskResult) -> Option<T>,
    ) -> Option<TaskRecord<T>> {
        key.and_then(|key| settled.get(key)?.record(key, pick))
    }
    let organ_beat = |result: &TaskResult| match result {
        TaskResult::OrganBeat(r) => Some(r.clone()),
        _ => None,
    };
    let iterations = chain
        .iterations
        .iter()
        .zip(1..)
        .map(|(iteration, number)| IterationRecord {
            number,
            parameters: iteration.parameters,
            proposal: find(
                settled,
                chain.proposal(number).map(|proposal| &proposal.task),
                |result| match result {
                    TaskResult::Step1Proposal(r) => Some(r.clone()),
                    _ => None,
                },
            ),
            run: find(settled, Some(&iteration.task), organ_beat),
            failure: settled.get(&iteration.task).and_then(Settled::failure),
            cost: iteration.cost,
            relative_differences: iteration.relative_differences.clone(),
        });
    let step3_iterations = chain
        .step3_iterations
        .iter()
        .zip(1..)
        .map(|(iteration, number)| Step3IterationRecord {
            number,
            parameters: iteration.parameters.clone(),
            proposal: find(
                settled,
                chain.step3_proposal(number).map(|proposal| &proposal.task),
                |result| match result {
                    TaskResult::Step3Proposal(r) => Some(r.clone()),
                    _ => None,
                },
            ),
            run: find(settled, Some(&iteration.task), organ_beat),
            failure: settled.get(&iteration.task).and_then(Settled::failure),
            misfit: iteration.misfit,
            verdict: iteration.verdict.clone(),
        });
    let other_wall_s = chain
        .steps()
        .filter_map(|(step, key)| {
            let task = settled.get(key)?;
            let was_followed = match step.stage {
                Stage::Step1Proposal => step.number as usize <= chain.iterations.len(),
                Stage::Step3Proposal => step.number as usize <= chain.step3_iterations.len(),
                _ => true,
            };
            let has_record = was_followed && matches!(task.state, Task::Published { .. });
            (!has_record).then_some(task.outcome.as_ref()?.provenance.wall_s)
        })
        .fold(0.0, |sum, wall_s| sum + wall_s);
    PatientRecord {
        other_wall_s,
        step3_iterations: step3_iterations.collect(),
        step0: find(settled, chain.step0.as_ref(), |result| match result {
            TaskResult::PassiveState(r) => Some(r.clone()),
            _ => None,
        }),
        law: find(settled, chain.law.as_ref(), |result| match result {
            TaskResult::LearnLaw(r) => Some(r.clone()),
            _ => None,
        }),
        iterations: iterations.collect(),
        targets: find(settled, chain.targets.as_ref(), |result| match result {
            TaskResult::Targets(r) => Some(r.clone()),
            _ => None,
        }),
        cell_fit: find(settled, chain.cell_fit.as_ref(), |result| match result {
            TaskResult::CellFit(r) => Some(r.clone()),
            _ => None,
        }),
        organ_fit: find(settled, chain.organ_fit.as_ref(), |result| match result {
            TaskResult::Step3Proposal(r) => Some(r.clone()),
            _ => None,
        }),
        verification: find(settled, chain.verification.as_ref(), organ_beat),
        verification_cost: chain.verification_cost,
        // Before step 3 has decided, the verification beat is no verdict on the twin.
        verdict: (chain.verdict.clone())
            .filter(|_| status.state.is_over() || chain.step3.is_some()),
        posterior_failure: chain
            .unanswered(Stage::Posterior)
            .and_then(|key| settled.get(key)?.failure()),
        step3: chain.step3,
        posterior: find(settled, chain.posterior.as_ref(), |result| match result {
            TaskResult::Posterior(r) => Some(r.as_ref().clone()),
            _ => None,
        }),
        step1: chain.step1,
        plan,
        status,
        failure,
        before: None,
    }
}

/// The record without what only the patient's own page shows: traces, fitted parameters of the
/// cell, proposals and draws. An overview of thousands of patients keeps these in memory.
pub(super) fn without_bulk(mut record: PatientRecord) -> PatientRecord {
    let clear = |beat: &mut Option<TaskRecord<OrganBeatResult>>| {
        if let Some(beat) = beat {
            let result = &mut beat.result;
            result.samples = BeatSamples::default();
            (result.motion, result.law) = (None, None);
            result.counters.clear();
        }
    };
    if let Some(step0) = &mut record.step0 {
        step0.result.samples = BeatSamples::default();
        step0.result.counters.clear();
    }
    for iteration in &mut record.iterations {
        clear(&mut iteration.run);
    }
    for iteration in &mut record.step3_iterations {
        clear(&mut iteration.run);
    }
    clear(&mut record.verification);
    if let Some(fit) = &mut record.cell_fit {
        fit.result.parameters = Vec::new();
        fit.result.cost_terms.clear();
        fit.result.identifiability = None;
    }
    if let Some(posterior) = &mut record.posterior {
        posterior.result.draws = Vec::new();
        posterior.result.correlations = Vec::new();
        (posterior.result.pressure_mmhg, posterior.result.volume_ml) = Default::default();
        posterior.result.learned_law = None;
    }
    record.before = None;
    record
}
