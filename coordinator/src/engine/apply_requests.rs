//! Applies requests of people: changed settings, retries and cancellations.

use cardiotwin_calibrate::fixed_point;
use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_workflow::patient::{Patient, PatientEvent, Stage, Step};
use cardiotwin_workflow::task::{Task, TaskEvent};

use super::requests::Request;
use super::transitions::Decider;
use super::world::World;
use super::{EngineError, PatientEnding, settings};

impl Decider {
    /// Applies a requested change. Returns one line for each effect, for a person.
    pub fn request(
        &mut self,
        world: &mut World,
        request: &Request,
    ) -> Result<Vec<String>, EngineError> {
        match request {
            Request::Rerun {
                patient,
                from,
                overrides,
            } => {
                let i = find(world, patient)?;
                self.rerun(world, i, *from, overrides)
            }
            Request::Retry { patient } => {
                let i = find(world, patient)?;
                self.retry(world, i)
            }
            Request::Cancel {
                patient: Some(patient),
            } => {
                let i = find(world, patient)?;
                if world.patients[i].row.state.is_final() {
                    let state = world.patients[i].row.state.word();
                    return Err(EngineError::Request {
                        message: format!("{patient} is {state}: nothing to cancel"),
                    });
                }
                self.cancel(world, i)
            }
            Request::Cancel { patient: None } => {
                let mut changes = Vec::new();
                for i in 0..world.patients.len() {
                    if world.patients[i].row.active && !world.patients[i].row.state.is_final() {
                        changes.extend(self.cancel(world, i)?);
                    }
                }
                Ok(changes)
            }
        }
    }

    fn cancel(&mut self, world: &mut World, i: usize) -> Result<Vec<String>, EngineError> {
        let at = world.patients[i]
            .row
            .state
            .step()
            .map_or_else(String::new, |step| format!(" at {step}"));
        world.patient_event(i, PatientEvent::Cancel)?;
        if world.patients[i].selected {
            self.ended(world, i, PatientEnding::Cancelled);
        }
        Ok(vec![format!(
            "{} cancelled{at}",
            world.patients[i].row.patient
        )])
    }

    fn rerun(
        &mut self,
        world: &mut World,
        i: usize,
        from: Stage,
        overrides: &SettingsLayer,
    ) -> Result<Vec<String>, EngineError> {
        let name = world.patients[i].row.patient.clone();
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
        let layer = settings::merged(&self.overrides(world, i)?, overrides).map_err(unread)?;
        let given: ResolvedPatient =
            serde_json::from_str(&world.patients[i].plan_row.given).map_err(unread)?;
        let plan = settings::plan(&given, &layer)
            .map_err(|error| bad(format!("settings of {name}: {error}")))?;
        fixed_point::validate(&plan.settings.step1_resolved())
            .map_err(|error| bad(format!("settings of {name}: {error}")))?;
        let mut changes = Vec::new();
        let patient = &mut world.patients[i];
        let n = patient.chain.iterations.len();
        match from {
            Stage::Step0 => patient.carried.clear(),
            // Step 1 continues from its stored iterations without repeating them, including those
            // that an earlier rerun kept.
            Stage::Step1 if n > 0 => {
                patient.carried = patient
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
        patient.plan_row.carried =
            serde_json::to_string(&patient.carried).expect("numbers are JSON");
        patient.plan_row.overrides = serde_json::to_string(&layer).expect("settings are JSON");
        if settings::same_tasks(world.plan(i)?, &plan) && from != Stage::Step1 {
            changes.push(format!(
                "{name}: no setting changed, so nothing will be redone"
            ));
        }
        self.reopen(world, i);
        self.replan(
            world,
            i,
            &given,
            &layer,
            &format!("rerun from {from}"),
            true,
        )?;
        self.decide(world, i)?;
        if changes.is_empty() {
            changes.push(format!("{name}: settings changed from {from} on"));
        }
        Ok(changes)
    }

    fn retry(&mut self, world: &mut World, i: usize) -> Result<Vec<String>, EngineError> {
        let name = world.patients[i].row.patient.clone();
        let steps = &world.patients[i].steps;
        let mut failed: Vec<(Step, TaskKey)> = steps
            .iter()
            .filter(|(_, key)| {
                world
                    .tasks
                    .get(key)
                    .is_some_and(|t| matches!(t.state, Task::Failed { .. }))
            })
            .map(|(step, key)| (*step, key.clone()))
            .collect();
        failed.sort();
        let cancelled = matches!(world.patients[i].row.state, Patient::Cancelled { .. });
        if failed.is_empty() && !cancelled {
            let state = world.patients[i].row.state.word();
            return Err(EngineError::Request {
                message: format!("{name} is {state} and none of its tasks failed"),
            });
        }
        let mut changes = Vec::new();
        for (step, key) in failed {
            world.task_event(&key, TaskEvent::Retry)?;
            changes.push(format!("{name}: {step} will be retried"));
        }
        if cancelled {
            changes.push(format!("{name} continues"));
        }
        self.reopen(world, i);
        world.plan_changed(i);
        world.patient_event(
            i,
            PatientEvent::Replan {
                reason: "retry".into(),
            },
        )?;
        self.decide(world, i)?;
        Ok(changes)
    }
}

fn find(world: &World, patient: &PatientId) -> Result<usize, EngineError> {
    world
        .by_name
        .get(patient.as_str())
        .copied()
        .filter(|&i| world.patients[i].row.active)
        .ok_or_else(|| {
            let known: Vec<&str> = world
                .patients
                .iter()
                .filter(|p| p.row.active)
                .take(20)
                .map(|p| p.row.patient.as_str())
                .collect();
            EngineError::Request {
                message: format!(
                    "no patient {patient} in this run; known patients: {}",
                    known.join(", ")
                ),
            }
        })
}
