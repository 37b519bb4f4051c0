//! Applies requests of people: changed settings, retries and cancellations.

use cardiotwin_calibrate::fixed_point;
use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_workflow::patient::{Patient, PatientEvent, Stage, Step};
use cardiotwin_workflow::task::{Task, TaskEvent};

use super::Decider;
use crate::books::Books;
use crate::requests::Request;
use crate::{EngineError, PatientEnding, settings};

impl Decider {
    /// Applies a requested change. Returns one line for each effect, for a person.
    pub fn request(
        &mut self,
        books: &mut Books,
        request: &Request,
    ) -> Result<Vec<String>, EngineError> {
        match request {
            Request::Rerun {
                patient,
                from,
                overrides,
            } => {
                let i = find(books, patient)?;
                self.rerun(books, i, *from, overrides)
            }
            Request::Retry { patient } => {
                let i = find(books, patient)?;
                self.retry(books, i)
            }
            Request::Cancel {
                patient: Some(patient),
            } => {
                let i = find(books, patient)?;
                if books.patient(i).row.state.is_final() {
                    let state = books.patient(i).row.state.shown();
                    return Err(EngineError::Request {
                        message: format!("{patient} is {state}: nothing to cancel"),
                    });
                }
                self.cancel(books, i)
            }
            Request::Cancel { patient: None } => {
                let mut changes = Vec::new();
                for i in 0..books.patients().len() {
                    if books.patient(i).row.active && !books.patient(i).row.state.is_final() {
                        changes.extend(self.cancel(books, i)?);
                    }
                }
                Ok(changes)
            }
        }
    }

    fn cancel(&mut self, books: &mut Books, i: usize) -> Result<Vec<String>, EngineError> {
        let at = books
            .patient(i)
            .row
            .state
            .step()
            .map_or_else(String::new, |step| format!(" at {step}"));
        books.patient_event(i, PatientEvent::Cancel)?;
        if books.patient(i).selected {
            self.ended(books, i, PatientEnding::Cancelled);
        }
        Ok(vec![format!(
            "{} cancelled{at}",
            books.patient(i).row.status.patient
        )])
    }

    fn rerun(
        &mut self,
        books: &mut Books,
        i: usize,
        from: Stage,
        overrides: &SettingsLayer,
    ) -> Result<Vec<String>, EngineError> {
        let name = books.patient(i).row.status.patient.clone();
        let bad = |message: String| EngineError::Request { message };
        let unread = |source| EngineError::Plan {
            patient: name.clone(),
            source,
        };
        if let Some((table, stage)) = settings::acts_before(overrides, from) {
            return Err(bad(format!(
                "settings of `{table}` affect {stage}, which precedes {from}: rerun from {stage} \
                 instead"
            )));
        }
        let layer = settings::merged(&self.overrides(books, i)?, overrides).map_err(unread)?;
        let given: ResolvedPatient =
            serde_json::from_str(&books.patient(i).plan_row.given).map_err(unread)?;
        let plan = settings::plan(&given, &layer)
            .map_err(|error| bad(format!("settings of {name}: {error}")))?;
        fixed_point::validate(&plan.settings.step1_resolved())
            .map_err(|error| bad(format!("settings of {name}: {error}")))?;
        let mut changes = Vec::new();
        let patient = books.patient(i);
        let n = patient.chain.iterations.len();
        let mut carried = patient.carried.clone();
        match from {
            Stage::Step0 => carried.clear(),
            // Step 1 continues from its stored iterations without repeating them, including those
            // that an earlier rerun kept.
            Stage::Step1 if n > 0 => {
                carried = patient
                    .chain
                    .iterations
                    .iter()
                    .map(|iteration| iteration.parameters)
                    .collect();
                changes.push(format!(
                    "{name}: step 1 continues from its {n} stored iterations"
                ));
            }
            _ => {}
        }
        books.set_carried(i, carried);
        books.set_overrides(i, &layer);
        if settings::same_tasks(books.plan(i)?, &plan) && from != Stage::Step1 {
            changes.push(format!(
                "{name}: no setting changed, so nothing will be redone"
            ));
        }
        self.reopen(books, i);
        self.replan(
            books,
            i,
            &given,
            &layer,
            &format!("rerun from {from}"),
            true,
        )?;
        self.decide(books, i)?;
        if changes.is_empty() {
            changes.push(format!("{name}: settings changed from {from} on"));
        }
        Ok(changes)
    }

    fn retry(&mut self, books: &mut Books, i: usize) -> Result<Vec<String>, EngineError> {
        let name = books.patient(i).row.status.patient.clone();
        let steps = &books.patient(i).steps;
        let mut failed: Vec<(Step, TaskKey)> = steps
            .iter()
            .filter(|(_, key)| {
                books
                    .task(key)
                    .is_some_and(|t| matches!(t.state, Task::Failed { .. }))
            })
            .map(|(step, key)| (*step, key.clone()))
            .collect();
        failed.sort();
        let cancelled = matches!(books.patient(i).row.state, Patient::Cancelled { .. });
        if failed.is_empty() && !cancelled {
            let state = books.patient(i).row.state.shown();
            return Err(EngineError::Request {
                message: format!("{name} is {state} and none of its tasks failed"),
            });
        }
        let mut changes = Vec::new();
        for (step, key) in failed {
            books.task_event(&key, TaskEvent::Retry)?;
            changes.push(format!("{name}: {step} will be retried"));
        }
        if cancelled {
            changes.push(format!("{name} continues"));
        }
        self.reopen(books, i);
        books.plan_changed(i);
        books.patient_event(
            i,
            PatientEvent::Replan {
                reason: "retry".into(),
            },
        )?;
        self.decide(books, i)?;
        Ok(changes)
    }
}

fn find(books: &Books, patient: &PatientId) -> Result<usize, EngineError> {
    books
        .by_name(patient.as_str())
        .filter(|&i| books.patient(i).row.active)
        .ok_or_else(|| {
            let known: Vec<&str> = books
                .patients()
                .iter()
                .filter(|p| p.row.active)
                .take(20)
                .map(|p| p.row.status.patient.as_str())
                .collect();
            EngineError::Request {
                message: format!(
                    "no patient {patient} in this run; known patients: {}",
                    known.join(", ")
                ),
            }
        })
}
