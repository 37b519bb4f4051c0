//! Pilots of the run: who they are, who waits for them, and what they teach.

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ_law::LawLesson;
use cardiotwin_store::pilots::{LESSONS, PILOTS, Pilots};
use cardiotwin_workflow::derivation::Teaching;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::pilots::{has_taught, lesson};

use super::Books;
use crate::EngineError;

impl Books {
    pub fn pilots(&self) -> &Pilots {
        &self.school.pilots
    }

    pub fn has_lessons(&self) -> bool {
        self.school.lessons.is_some()
    }

    /// Keeps the pilots with the run.
    pub fn set_pilots(&mut self, pilots: Pilots) {
        let text = serde_json::to_string(&pilots).expect("names are JSON");
        self.put_meta(PILOTS, &text);
        self.school.pilots = pilots;
    }

    /// Keeps what the pilots teach with the run; `None` if they are to teach again.
    pub fn set_lessons(&mut self, lessons: Option<Vec<LawLesson>>) {
        if self.school.lessons == lessons {
            return;
        }
        let text = serde_json::to_string(&lessons).expect("lessons are JSON");
        self.put_meta(LESSONS, &text);
        self.school.lessons = lessons;
    }

    /// Whether a patient is one of the pilots.
    pub fn is_pilot(&self, i: usize) -> bool {
        self.is_named_a_pilot(&self.patients[i].row.status.patient)
    }

    fn is_named_a_pilot(&self, name: &str) -> bool {
        (self.school.pilots.names.iter()).any(|pilot| pilot.as_str() == name)
    }

    /// Whether a patient learns from the pilots.
    pub fn is_pupil(&self, i: usize) -> Result<bool, EngineError> {
        // Without pilots no plan is parsed: a sweep has many members.
        if self.school.pilots.names.is_empty() || self.is_pilot(i) {
            return Ok(false);
        }
        Ok(self.plan(i)?.n_pilots() > 0)
    }

    /// What a patient learns from the pilots.
    pub fn teaching(&self, i: usize) -> Result<Teaching<'_>, EngineError> {
        Ok(match &self.school.lessons {
            _ if !self.is_pupil(i)? => Teaching::None,
            Some(lessons) => Teaching::Lessons(lessons),
            None => Teaching::Awaited(self.pilots_at_work()),
        })
    }

    /// Whether a patient has to wait for pilots.
    pub fn awaits_pilots(&self, i: usize) -> Result<bool, EngineError> {
        Ok(matches!(self.teaching(i)?, Teaching::Awaited(_)))
    }

    /// Pilots that have not ended, or that a person or the site ended.
    fn pilots_at_work(&self) -> Vec<PatientId> {
        let names = self.school.pilots.names.iter();
        let is_at_work = |name: &&PatientId| {
            self.by_name(name.as_str())
                .is_none_or(|i| !has_taught(&self.patients[i].row.state))
        };
        names.filter(is_at_work).cloned().collect()
    }

    /// Gathers what the pilots teach, as soon as all have ended. Returns whether it is there.
    pub fn gather_lessons(&mut self) -> Result<bool, EngineError> {
        if self.has_lessons() {
            return Ok(true);
        }
        if self.school.pilots.names.is_empty() || !self.pilots_at_work().is_empty() {
            return Ok(false);
        }
        let mut lessons = Vec::new();
        for name in &self.school.pilots.names {
            let Some(i) = self.by_name(name.as_str()) else {
                continue;
            };
            let chain = &self.patients[i].chain;
            lessons.extend(lesson(self.plan(i)?, chain, &|key| self.settled(key)));
        }
        if self.has_absent() {
            return Ok(false); // the decision asks for the outcomes and is made again
        }
        self.set_lessons(Some(lessons));
        Ok(true)
    }

    /// Whether a patient waits for pilots of whom none will end in this run without a person.
    pub fn waits_in_vain(&self, i: usize) -> Result<bool, EngineError> {
        let Teaching::Awaited(pilots) = self.teaching(i)? else {
            return Ok(false);
        };
        let goes_on = |pilot: &PatientId| {
            let pilot = self.by_name(pilot.as_str()).map(|i| &self.patients[i]);
            pilot.is_some_and(|pilot| pilot.selected && !pilot.row.state.is_final())
        };
        Ok(!pilots.iter().any(goes_on))
    }

    /// Number of selected patients that wait in vain.
    pub fn held(&self) -> usize {
        let waits = |i: &usize| {
            self.patients[*i].selected
                && !self.patients[*i].row.state.is_final()
                && self.waits_in_vain(*i).unwrap_or(false)
        };
        (0..self.patients.len()).filter(waits).count()
    }

    /// Whom a patient waits for and what a person can do, in words; `None` if it does not wait for
    /// pilots.
    pub(super) fn waits_for(&self, i: usize) -> Option<String> {
        let Ok(Teaching::Awaited(pilots)) = self.teaching(i) else {
            return None;
        };
        let names: Vec<&str> = pilots.iter().map(|pilot| pilot.as_str()).collect();
        let pilot = if names.len() == 1 { "pilot" } else { "pilots" };
        let waits = format!("waits for {pilot} {}", names.join(", "));
        let held = pilots.iter().find_map(|pilot| {
            let why = match self.by_name(pilot.as_str()).map(|i| &self.patients[i].row) {
                None => "is not in the run",
                Some(row) if !row.active => "is not in the cohort any more",
                Some(row) => match row.state {
                    Patient::Cancelled { .. } => "was cancelled",
                    Patient::Failed { .. } => "failed",
                    _ => return None,
                },
            };
            Some((pilot, why))
        });
        Some(match held {
            None => waits,
            Some((pilot, why)) => {
                format!("{waits}: {pilot} {why}; `retry {pilot}`, or `run --set workflow.pilots=0`")
            }
        })
    }

    /// Marks the rows of the patients who learn from pilots, because they show the pilots' states.
    pub(super) fn touch_pupils(&mut self) {
        for i in 0..self.patients.len() {
            if !self.patients[i].row.state.is_final() && self.is_pupil(i).unwrap_or(false) {
                self.dirty_patients.insert(i);
            }
        }
    }
}
