//! Time left for progress bars: of the run from its finished patients, of a task from its progress.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use cardiotwin_engine::{EngineEvent, Pace, PatientEnding};
use cardiotwin_schemas::ids::PatientId;

use super::estimate::left_ms;
use super::table::duration;

/// Steps that a patient or member of a sweep begins with.
const FIRST: [&str; 2] = ["step-0", "task"];
/// Time before which the speed of a task is not known.
const LEAST: Duration = Duration::from_secs(3);

/// Time spent by a patient in this process.
#[derive(Debug, Clone, Copy)]
struct Spent {
    ended: Duration,
    at_work_since: Option<Instant>,
    /// Whether no earlier process has worked for the patient.
    is_whole: bool,
}

impl Spent {
    fn until(&self, now: Instant) -> Duration {
        let at_work = self.at_work_since.map(|since| now.duration_since(since));
        self.ended + at_work.unwrap_or_default()
    }
}

/// Beginning of a phase of a task.
#[derive(Debug, Clone)]
struct Phase {
    name: String,
    since: Instant,
    from: f64,
}

/// Times of the patients at work.
#[derive(Debug, Default)]
pub struct TimeLeft {
    spent: BTreeMap<PatientId, Spent>,
    phases: BTreeMap<PatientId, Phase>,
    done_ms: Vec<i64>,
    n_open: usize,
}

fn ms(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX)
}

impl TimeLeft {
    /// Takes an event into account.
    pub fn on(&mut self, event: &EngineEvent, now: Instant) {
        match event {
            EngineEvent::Started {
                patients, settled, ..
            } => self.n_open = patients.saturating_sub(*settled),
            EngineEvent::TaskStarted { patient, step, .. } => {
                let spent = self.spent.entry(patient.clone()).or_insert(Spent {
                    ended: Duration::ZERO,
                    at_work_since: None,
                    is_whole: FIRST.iter().any(|first| step.starts_with(first)),
                });
                spent.at_work_since = Some(now);
                self.phases.remove(patient);
            }
            EngineEvent::TaskPublished { patient, .. }
            | EngineEvent::AttemptFailed { patient, .. } => {
                if let Some(spent) = self.spent.get_mut(patient) {
                    spent.ended = spent.until(now);
                    spent.at_work_since = None;
                }
            }
            EngineEvent::PatientEnded {
                patient,
                ending,
                over,
                of,
            } => {
                self.n_open = of.saturating_sub(*over);
                self.phases.remove(patient);
                if let Some(spent) = self.spent.remove(patient)
                    && spent.is_whole
                    && matches!(ending, PatientEnding::Done)
                {
                    self.done_ms.push(ms(spent.until(now)));
                }
            }
            _ => {}
        }
    }

    /// Time until the run ends, in words; empty if not enough is known.
    pub fn of_run(&self, now: Instant) -> String {
        let mut open_ms: Vec<i64> = self.spent.values().map(|s| ms(s.until(now))).collect();
        open_ms.resize(self.n_open.max(open_ms.len()), 0);
        let at_work = self.spent.values().filter(|s| s.at_work_since.is_some());
        let pace = Pace {
            done_ms: self.done_ms.clone(),
            n_at_work: at_work.count(),
            open_ms,
        };
        left_ms(&pace)
            .map(|left| in_words(1e-3 * left))
            .unwrap_or_default()
    }

    /// Time until a phase of a patient's task ends, in words; empty if not enough is known.
    pub fn of_task(
        &mut self,
        patient: &PatientId,
        phase: &str,
        (done, total): (f64, Option<f64>),
        now: Instant,
    ) -> String {
        let known = self.phases.get(patient);
        let Some(begin) = known.filter(|begin| begin.name == phase && begin.from <= done) else {
            let begin = Phase {
                name: phase.to_owned(),
                since: now,
                from: done,
            };
            self.phases.insert(patient.clone(), begin);
            return String::new();
        };
        let elapsed = now.duration_since(begin.since);
        match total {
            Some(total) if done > begin.from && total > done && elapsed >= LEAST => {
                in_words(elapsed.as_secs_f64() * (total - done) / (done - begin.from))
            }
            _ => String::new(),
        }
    }
}

fn in_words(seconds: f64) -> String {
    format!("about {} left", duration(seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn started(patient: &str, step: &str) -> EngineEvent {
        EngineEvent::TaskStarted {
            patient: patient.into(),
            step: step.into(),
            generation: 1,
        }
    }

    fn published(patient: &str) -> EngineEvent {
        EngineEvent::TaskPublished {
            patient: patient.into(),
            step: "step-1".into(),
            note: String::new(),
        }
    }

    fn ended(patient: &str, over: usize) -> EngineEvent {
        EngineEvent::PatientEnded {
            patient: patient.into(),
            ending: PatientEnding::Done,
            over,
            of: 4,
        }
    }

    #[test]
    fn a_run_takes_as_long_as_its_finished_patients_say() {
        let begin = Instant::now();
        let at = |s: u64| begin + Duration::from_secs(s);
        let mut left = TimeLeft::default();
        let all = EngineEvent::Started {
            patients: 4,
            settled: 0,
            adopted: 0,
        };
        left.on(&all, at(0));
        left.on(&started("a", "step-0"), at(0));
        left.on(&started("b", "step-0"), at(0));
        assert_eq!(left.of_run(at(10)), "", "nobody is done");
        left.on(&published("a"), at(20));
        // Waiting is not work.
        left.on(&started("a", "step-1 iteration 1"), at(40));
        left.on(&published("a"), at(60));
        left.on(&ended("a", 1), at(60));
        left.on(&published("b"), at(10));
        left.on(&started("c", "step-0"), at(60));
        left.on(&started("b", "step-1 iteration 1"), at(60));
        // a took 40 s; 30, 40 and 40 s are left of b, c and d, on two workers.
        assert_eq!(left.of_run(at(60)), "about 55.0 s left");
    }

    #[test]
    fn a_patient_that_an_earlier_process_began_is_no_measure() {
        let begin = Instant::now();
        let mut left = TimeLeft::default();
        left.on(&started("a", "step-2"), begin);
        left.on(&ended("a", 1), begin + Duration::from_secs(1));
        left.on(&started("b", "step-0"), begin);
        assert_eq!(left.of_run(begin + Duration::from_secs(2)), "");
    }

    #[test]
    fn a_task_goes_on_as_fast_as_its_phase_did() {
        let begin = Instant::now();
        let at = |s: u64| begin + Duration::from_secs(s);
        let mut left = TimeLeft::default();
        let id = PatientId::from("a");
        let mut of =
            |phase: &str, done: f64, s: u64| left.of_task(&id, phase, (done, Some(100.0)), at(s));
        assert_eq!(of("inflate", 50.0, 0), "", "the speed is not known");
        assert_eq!(of("inflate", 60.0, 1), "", "too early");
        assert_eq!(of("inflate", 75.0, 10), "about 10.0 s left");
        assert_eq!(of("beat", 1.0, 11), "", "another phase");
        assert_eq!(of("beat", 100.0, 20), "", "nothing is left");
        assert_eq!(left.of_task(&id, "beat", (2.0, None), at(30)), "");
    }
}
