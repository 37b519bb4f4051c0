//! Progress display of a run: bars on a terminal, plain lines elsewhere.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use cardiotwin_engine::{EngineEvent, PatientEnding};
use cardiotwin_schemas::ids::PatientId;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::event_log;
use super::talk::{Talk, Tone, harmless, paint};
use super::time_left::TimeLeft;

/// Display of engine events.
pub struct Watcher {
    talk: Talk,
    members: &'static str,
    bars: Option<Bars>,
}

struct Bars {
    all: MultiProgress,
    overall: ProgressBar,
    patients: BTreeMap<PatientId, ProgressBar>,
    left: TimeLeft,
    /// Time of the last estimate of the run's end.
    estimated: Option<Instant>,
    is_stopping: bool,
}

/// Time between two estimates of the run's end.
const PERIOD: Duration = Duration::from_secs(1);

impl Watcher {
    /// A watcher with bars on a terminal and without bars elsewhere. `members` is the plural noun
    /// for the run's members.
    #[must_use]
    pub fn new(talk: &Talk, members: &'static str) -> Self {
        let bars = talk.bars.then(|| {
            let all = MultiProgress::new();
            let overall = all.add(ProgressBar::new(0));
            overall.set_style(style(&format!(
                "{{elapsed_precise}} [{{bar:30}}] {{pos}}/{{len}} {members} {{wide_msg}}"
            )));
            overall.enable_steady_tick(Duration::from_millis(250));
            Bars {
                all,
                overall,
                patients: BTreeMap::new(),
                left: TimeLeft::default(),
                estimated: None,
                is_stopping: false,
            }
        });
        Self {
            talk: *talk,
            members,
            bars,
        }
    }

    /// Shows one event; `instead` replaces its line.
    pub fn on(&mut self, event: &EngineEvent, instead: Option<&str>) {
        event_log::log(event);
        let text = instead
            .map(str::to_owned)
            .or_else(|| line(event, self.members, self.talk.colour_err));
        if let Some(text) = text {
            self.say(text.trim_end());
        }
        if let Some(bars) = &mut self.bars {
            bars.on(event);
        }
    }

    /// Prints a line above the bars.
    pub fn say(&self, text: &str) {
        match &self.bars {
            Some(bars) => bars.all.suspend(|| self.talk.say(text)),
            None => self.talk.say(text),
        }
    }

    /// Clears the bars from the terminal at the end of the run.
    pub fn finish(self) {
        if let Some(bars) = self.bars {
            bars.patients
                .values()
                .for_each(ProgressBar::finish_and_clear);
            bars.overall.finish_and_clear();
        }
    }
}

impl Bars {
    fn on(&mut self, event: &EngineEvent) {
        let now = Instant::now();
        self.left.on(event, now);
        if !self.is_stopping && self.estimated.is_none_or(|last| now - last >= PERIOD) {
            self.estimated = Some(now);
            self.overall.set_message(self.left.of_run(now));
        }
        match event {
            EngineEvent::Started {
                patients, settled, ..
            } => {
                self.overall.set_length(*patients as u64);
                self.overall.set_position(*settled as u64);
            }
            EngineEvent::TaskStarted { patient, step, .. } => {
                let bar = self.patient(patient);
                bar.set_length(0);
                bar.set_message(harmless(step).into_owned());
            }
            EngineEvent::Progress {
                patient,
                step,
                phase,
                done,
                total,
                note,
            } => {
                let left = self.left.of_task(patient, phase, (*done, *total), now);
                let bar = self.patient(patient);
                bar.set_length(total.unwrap_or(0.0) as u64);
                bar.set_position(*done as u64);
                let message = format!("{step}  {note}  {left}");
                bar.set_message(harmless(message.trim_end()).into_owned());
            }
            EngineEvent::PatientEnded {
                patient, over, of, ..
            } => {
                if let Some(bar) = self.patients.remove(patient) {
                    bar.finish_and_clear();
                    self.all.remove(&bar);
                }
                self.overall.set_length(*of as u64);
                self.overall.set_position(*over as u64);
            }
            EngineEvent::Stopping { .. } => {
                self.overall.set_message("stopping");
                self.is_stopping = true;
            }
            _ => {}
        }
    }

    fn patient(&mut self, patient: &PatientId) -> &ProgressBar {
        let all = &self.all;
        self.patients.entry(patient.clone()).or_insert_with(|| {
            let bar = all.add(ProgressBar::new(0));
            bar.set_style(style("  {prefix:12} {wide_msg}"));
            bar.set_prefix(harmless(patient.as_str()).into_owned());
            bar
        })
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template)
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("=> ")
}

/// An event as a line; `None` for events that are not printed.
#[must_use]
pub fn line(event: &EngineEvent, members: &str, colour: bool) -> Option<String> {
    Some(match event {
        EngineEvent::Started {
            settled: 0,
            adopted: 0,
            ..
        } => return None,
        EngineEvent::Started {
            patients,
            settled,
            adopted,
        } => {
            let adopted = match adopted {
                0 => String::new(),
                n => format!("; adopted {n} still running from an earlier coordinator"),
            };
            format!("{settled} of {patients} {members} already finished{adopted}")
        }
        EngineEvent::TaskPublished {
            patient,
            step,
            note,
        } => format!("{patient}  {}  {note}", spaced(step)),
        EngineEvent::AttemptFailed {
            patient,
            step,
            generation,
            failure,
            retried,
        } => {
            let failed = paint(colour, Tone::Bad, "failed");
            let class = failure.class.as_str();
            let next = if *retried { "; retrying" } else { "" };
            format!(
                "{patient}  {}  try {generation} {failed} [{class}]: {}{next}",
                spaced(step),
                failure.message
            )
        }
        EngineEvent::Step1Ended { patient, summary } => format!("{patient}  step-1  {summary}"),
        EngineEvent::PatientEnded {
            patient,
            ending,
            over,
            of,
        } => {
            let ending = match ending {
                PatientEnding::Done => paint(colour, Tone::Good, "done"),
                PatientEnding::Failed(failure) => {
                    format!(
                        "{} [{}]: {}",
                        paint(colour, Tone::Bad, "failed"),
                        failure.class.as_str(),
                        failure.message
                    )
                }
                PatientEnding::Cancelled => paint(colour, Tone::Doubtful, "cancelled"),
            };
            format!("{patient}  {ending}  ({over} of {of})")
        }
        EngineEvent::Vanished { patients } => vanished(patients),
        EngineEvent::Request { text } => text.clone(),
        EngineEvent::DatabaseLocked { waiting } => format!(
            "waiting since {} for {}, which has locked {}: workers go on, and nothing is lost; \
             Ctrl-C twice stops",
            waiting.since,
            waiting.holder,
            waiting.file.display()
        ),
        EngineEvent::Stopping {
            running,
            draining: true,
        } => format!(
            "stopping: {running} running, waiting for short tasks to finish; Ctrl-C again stops \
             now; no finished result is lost, and the same command continues"
        ),
        EngineEvent::Stopping {
            running,
            draining: false,
        } => {
            format!(
                "stopping now: ending {running} running; no finished result is lost, and the same \
                 command continues"
            )
        }
        EngineEvent::TaskStarted { .. } | EngineEvent::Progress { .. } => return None,
    })
}

/// Sentence about patients whose folders vanished, with the first few names.
fn vanished(patients: &[PatientId]) -> String {
    const N_NAMED: usize = 5;
    let named: Vec<&str> = patients
        .iter()
        .take(N_NAMED)
        .map(PatientId::as_str)
        .collect();
    let more = match patients.len().saturating_sub(N_NAMED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    format!(
        "no folder any more: {}{more}; their results are kept, and nothing further is run for them \
         (a folder that comes back goes on)",
        named.join(", ")
    )
}

/// A step such as `step-1 iteration 3` with a double space in the place of the first one, which
/// makes two columns.
fn spaced(step: &str) -> String {
    step.replacen(' ', "  ", 1)
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::failure::{Failure, FailureClass};

    use super::*;

    #[test]
    fn lines_for_pipes_and_logs() {
        let published = EngineEvent::TaskPublished {
            patient: "01-CoA".into(),
            step: "step-1 iteration 3".into(),
            note: "cost 0.082".into(),
        };
        assert_eq!(
            line(&published, "patients", false).unwrap(),
            "01-CoA  step-1  iteration 3  cost 0.082"
        );
        let failed = EngineEvent::AttemptFailed {
            patient: "04-CoA".into(),
            step: "step-2".into(),
            generation: 1,
            failure: Failure::new(FailureClass::Site, "worker killed by signal 9"),
            retried: true,
        };
        assert_eq!(
            line(&failed, "patients", false).unwrap(),
            "04-CoA  step-2  try 1 failed [site]: worker killed by signal 9; retrying"
        );
        let stop = EngineEvent::Stopping {
            running: 2,
            draining: true,
        };
        assert!(
            line(&stop, "patients", false)
                .unwrap()
                .contains("the same command continues")
        );
    }
}
