//! Columns of a patient in tables.

use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_schemas::plan::Workflow;
use cardiotwin_schemas::record::{Step1Quality, Step1Summary};
use cardiotwin_schemas::status::{NO_INTERVALS, PatientState, PatientStatus};
use cardiotwin_store::clock;
use cardiotwin_workflow::attempt::Attempt;
use cardiotwin_workflow::patient::{Patient, Stage, Step};
use cardiotwin_workflow::task::Task;

use super::Books;

impl Books {
    /// Updates the shown columns of a patient's row from the patient's state.
    pub fn show(&mut self, i: usize) {
        let shown = self.shown(i);
        let row = &mut self.patients[i].row;
        let place = |s: &PatientStatus| {
            let iteration = s.iteration.map(|(n, _)| n);
            (s.state, s.step.clone(), iteration)
        };
        if place(&shown) != place(&row.status) {
            row.since_ms = self.now_ms;
        }
        row.status = shown;
    }

    fn shown(&self, i: usize) -> PatientStatus {
        let patient = &self.patients[i];
        let (chain, state) = (&patient.chain, &patient.row.state);
        let mut shown = PatientStatus {
            patient: patient.row.status.patient.clone(),
            step: state.step().map_or_else(|| "-".to_owned(), column),
            state: state.shown(),
            step1_cost: chain.best_cost(),
            step1_quality: chain.step1.as_ref().map(ToString::to_string),
            step2_cost: chain.step2_cost,
            ..PatientStatus::default()
        };
        if let Ok(plan) = self.plan(i)
            && plan.workflow == Workflow::Personalise
        {
            let running = state
                .step()
                .filter(|s| matches!(s.stage, Stage::Step1 | Stage::Step1Proposal))
                .map_or(0, |s| s.number);
            shown.iteration = Some((
                running.max(chain.iterations.len() as u32),
                patient.carried.len() as u32 + plan.settings.step1.max_iterations,
            ));
        }
        match state {
            Patient::Waiting => {
                shown.step = chain
                    .steps()
                    .last()
                    .map_or(shown.step, |(step, _)| column(step));
                shown.note = self.waits_for(i).unwrap_or_default();
            }
            Patient::Deciding { .. } => shown.note = self.waits_for(i).unwrap_or_default(),
            Patient::Working { step, task } => {
                let (at_work, note) = self.at_work(i, task);
                shown.state = at_work;
                let proposes = note.is_empty()
                    && matches!(step.stage, Stage::Step1Proposal | Stage::Step3Proposal);
                shown.note = if proposes {
                    "proposing the next parameters".to_owned()
                } else {
                    note
                };
            }
            Patient::Done => {
                shown.step = "done".to_owned();
                shown.note = match (&chain.verdict, &chain.step1) {
                    (Some(verdict), Some(summary))
                        if summary.quality == Step1Quality::Converged =>
                    {
                        verdict.to_string()
                    }
                    (Some(verdict), Some(summary)) => {
                        // A narrow table cuts long notes off, so the verdict's numbers come last.
                        let verdict = verdict.to_string();
                        let step1 = format!("step 1 {summary}{}", why_stalled(summary));
                        match verdict.split_once(": ") {
                            Some((headline, off)) => format!("{headline}; {step1}; {off}"),
                            None => format!("{verdict}; {step1}"),
                        }
                    }
                    (Some(verdict), None) => verdict.to_string(),
                    (None, Some(summary)) => {
                        format!("not verified; step 1 {summary}{}", why_stalled(summary))
                    }
                    (None, None) => String::new(),
                };
                if self.has_no_intervals(i) {
                    // First, because a narrow table cuts long notes off.
                    shown.note = format!("{NO_INTERVALS}; {}", shown.note);
                }
            }
            Patient::Failed { step, failure } => {
                shown.failure_class = Some(failure.class);
                shown.note = match step.stage {
                    Stage::Step1 | Stage::Step3 => {
                        format!("iteration {}: {}", step.number, failure.message)
                    }
                    Stage::Step1Proposal | Stage::Step3Proposal => {
                        format!("proposal of iteration {}: {}", step.number, failure.message)
                    }
                    _ => failure.message.clone(),
                };
            }
            Patient::Cancelled { .. } => {
                shown.note = "cancelled by request; `retry` resumes it".to_owned()
            }
        }
        shown
    }

    /// Whether a finished patient's settings ask for a posterior, which could not be sampled.
    fn has_no_intervals(&self, i: usize) -> bool {
        let chain = &self.patients[i].chain;
        // Only a twin of step 3 has a posterior.
        chain.step3.is_some()
            && chain.posterior.is_none()
            && self
                .plan(i)
                .is_ok_and(|plan| plan.settings.posterior.enabled)
    }

    /// State of a patient with a wanted task, and a note.
    fn at_work(&self, i: usize, key: &TaskKey) -> (PatientState, String) {
        let patient_id = self.patients[i].row.id;
        let Some(task) = self.tasks.get(key) else {
            return (PatientState::Waiting, String::new());
        };
        if let Some((state, note)) = self.jobs.note(patient_id) {
            // In a running job, a patient whose turn has not come waits.
            let begun =
                matches!(task.state, Task::Attempting { .. }) || state != PatientState::Running;
            return if begun {
                (state, note)
            } else {
                (PatientState::Waiting, format!("{note}, for its turn"))
            };
        }
        match &task.state {
            Task::Attempting { generation, .. } => {
                let attempt = AttemptId {
                    task: key.clone(),
                    generation: *generation,
                };
                let again = if *generation > 1 {
                    format!("try {generation}")
                } else {
                    String::new()
                };
                match self.attempts.get(&attempt).map(|a| &a.state) {
                    Some(Attempt::Unknown { .. }) => {
                        (PatientState::Unknown, "no news from the worker".to_owned())
                    }
                    _ => (PatientState::Running, again),
                }
            }
            Task::Open { generation, .. } if task.is_paused(self.now_ms) => {
                let (next, at) = (generation + 1, clock::utc_text(task.not_before_ms));
                let note = format!("try {next} begins at {at}, because try {generation} was lost");
                (PatientState::Waiting, note)
            }
            Task::Open { .. } if self.jobs.places_patients() && self.waits_for(i).is_some() => {
                (PatientState::Waiting, self.waits_for(i).unwrap_or_default())
            }
            Task::Open { .. } => match self.jobs.holds() {
                Some(holds) => (PatientState::Waiting, holds.to_owned()),
                None => (PatientState::Waiting, "for a free worker".to_owned()),
            },
            Task::Published { .. } | Task::Failed { .. } => (PatientState::Waiting, String::new()),
        }
    }
}

/// The step as shown in the table's column.
fn column(step: Step) -> String {
    match step.stage {
        Stage::Noop => step.to_string(),
        // To people a proposal is part of its step.
        Stage::Step1Proposal => Stage::Step1.to_string(),
        Stage::Step3Proposal => Stage::Step3.to_string(),
        Stage::Step2Organ => Stage::Step2.to_string(),
        stage => stage.to_string(),
    }
}

/// Why step 1 stalled, in brackets; empty for a converged step 1.
fn why_stalled(summary: &Step1Summary) -> String {
    match summary.quality {
        Step1Quality::Converged => String::new(),
        Step1Quality::Stalled { reason } => {
            format!(" ({}; `explain` says what to do)", reason.words())
        }
    }
}
