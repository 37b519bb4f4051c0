//! The fields of the books, read by their names, and the changes that need no state machine.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::OnceLock;

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::task::{Task, pause_before_retry_ms};

use super::{AttemptEntry, Books, Jobs, PatientEntry, TaskEntry};

impl Books {
    pub fn run_dir(&self) -> &Path {
        &self.run_dir
    }

    pub fn patients(&self) -> &[PatientEntry] {
        &self.patients
    }

    pub fn patient(&self, i: usize) -> &PatientEntry {
        &self.patients[i]
    }

    /// Index of a patient, by name.
    pub fn by_name(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// Index of a patient, by row id.
    pub fn by_id(&self, patient_id: i64) -> Option<usize> {
        self.by_id.get(&patient_id).copied()
    }

    pub fn tasks(&self) -> &HashMap<TaskKey, TaskEntry> {
        &self.tasks
    }

    pub fn task(&self, key: &TaskKey) -> Option<&TaskEntry> {
        self.tasks.get(key)
    }

    pub fn attempts(&self) -> &HashMap<AttemptId, AttemptEntry> {
        &self.attempts
    }

    pub fn attempt(&self, id: &AttemptId) -> Option<&AttemptEntry> {
        self.attempts.get(id)
    }

    pub fn jobs(&self) -> &Jobs {
        &self.jobs
    }

    pub fn jobs_mut(&mut self) -> &mut Jobs {
        &mut self.jobs
    }

    pub fn now_ms(&self) -> i64 {
        self.now_ms
    }

    pub fn set_now_ms(&mut self, now_ms: i64) {
        self.now_ms = now_ms;
    }

    /// Sets the row id of the allocation to which new attempts belong.
    pub fn set_allocation(&mut self, allocation: i64) {
        self.allocation = allocation;
    }

    /// Actions of committed batches that are still to be executed, oldest first.
    pub fn outbox(&self) -> &[(i64, Action)] {
        &self.outbox
    }

    pub fn take_outbox(&mut self) -> Vec<(i64, Action)> {
        std::mem::take(&mut self.outbox)
    }

    /// Puts actions that could not be executed back before those that were committed since.
    pub fn keep_actions(&mut self, mut kept: Vec<(i64, Action)>) {
        kept.append(&mut self.outbox);
        self.outbox = kept;
    }

    /// Open tasks with waiting patients, by position in the cohort.
    pub fn ready(&self) -> &BTreeSet<(i64, TaskKey)> {
        &self.ready
    }

    pub fn make_ready(&mut self, position: i64, key: TaskKey) {
        self.ready.insert((position, key));
    }

    /// The ready task of the first patient.
    pub fn pop_ready(&mut self) -> Option<(i64, TaskKey)> {
        self.ready.pop_first()
    }

    /// Lets an open task wait after its last failure of the site. Its patients show until when.
    pub fn pause_after_failure(&mut self, key: &TaskKey) {
        let now_ms = self.now_ms;
        if let Some(task) = self.tasks.get_mut(key)
            && let Task::Open { site_failures, .. } = task.state
            && site_failures > 0
        {
            task.not_before_ms = now_ms + pause_before_retry_ms(site_failures);
            self.dirty_patients.extend(task.waiters.iter().copied());
        }
    }

    pub fn add_waiter(&mut self, key: &TaskKey, i: usize) {
        if let Some(task) = self.tasks.get_mut(key)
            && !task.waiters.contains(&i)
        {
            task.waiters.push(i);
        }
    }

    pub fn clear_waiters(&mut self, key: &TaskKey) {
        if let Some(task) = self.tasks.get_mut(key) {
            task.waiters.clear();
        }
    }

    /// Selects the active patients whose names are wanted: this run works on them.
    pub fn select(&mut self, is_wanted: impl Fn(&str) -> bool) {
        for patient in &mut self.patients {
            patient.selected = patient.row.active && is_wanted(&patient.row.status.patient);
        }
    }

    /// Makes a patient active at a position of the cohort.
    pub fn enrol(&mut self, i: usize, position: i64) {
        let row = &mut self.patients[i].row;
        if row.position != position || !row.active {
            (row.position, row.active) = (position, true);
            self.touch(i);
        }
    }

    /// Makes a patient inactive who is no longer in the cohort. Returns whether it was active.
    pub fn retire(&mut self, i: usize) -> bool {
        let was_active = std::mem::take(&mut self.patients[i].row.active);
        if was_active {
            self.touch(i);
        }
        was_active
    }

    /// Sets the plan as the cohort gives it, in JSON. [`Books::set_plan`] has to follow.
    pub fn set_given(&mut self, i: usize, given: String) {
        self.patients[i].plan_row.given = given;
    }

    /// Replaces a patient's plan.
    ///
    /// - `text`: the plan in JSON; `None` if it is the given one
    pub fn set_plan(&mut self, i: usize, plan: ResolvedPatient, text: Option<String>) {
        let patient = &mut self.patients[i];
        patient.plan_row.plan = text;
        patient.plan = OnceLock::from(plan);
        patient.plan_changed = true;
        self.touch(i);
    }

    /// Sets the iterations that step 1 takes over. [`Books::set_plan`] has to follow.
    pub fn set_carried(&mut self, i: usize, carried: Vec<Step1Parameters>) {
        let patient = &mut self.patients[i];
        patient.plan_row.carried = serde_json::to_string(&carried).expect("numbers are JSON");
        patient.carried = carried;
    }

    /// Sets the settings that reruns have changed. [`Books::set_plan`] has to follow.
    pub fn set_overrides(&mut self, i: usize, overrides: &SettingsLayer) {
        let text = serde_json::to_string(overrides).expect("settings are JSON");
        self.patients[i].plan_row.overrides = text;
    }

    pub fn set_chain(&mut self, i: usize, chain: Chain) {
        let patient = &mut self.patients[i];
        patient.chain = chain;
        patient.chain_changed = true;
        self.touch(i);
    }
}
