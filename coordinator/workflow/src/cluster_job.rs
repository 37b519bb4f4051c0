//! State machine of a cluster's job: a submission under a unique name, and its elements, each of
//! which lives and ends by itself. A job that is not an array has one element.
//!
//! ```text
//!  submission:            Accepted                        element:  Waiting ⇄ Running ──┐ Ended
//!  Intended ───────────────────────────► Accepted                     │ ▲ Vanished      ├───────► Over
//!     │  │ Doubt                            ▲                         ▼ │ Seen          │
//!     │  └──────► Doubtful ─────────────────┤ Accepted (looked up)    Unknown ──────────┤ GiveUp (fenced)
//!     │ Refused      │ Absent, after a grace│                          │ Cancel         │
//!     ▼              ▼                                                 ▼                │
//!    Void ◄──────── Void (fenced)                                     Stopping ─────────┘
//! ```
//! The name is durable before the first request to the scheduler. `Unknown` is not an ending,
//! because absence from the queue proves nothing. A job that is given up is fenced first, so that a
//! job that lives on out of sight begins and publishes nothing.

use cardiotwin_schemas::failure::FailureCause;
use cardiotwin_schemas::status::JobState;
use serde::{Deserialize, Serialize};

use super::IllegalTransition;

/// A job with its elements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClusterJob {
    /// State of the submission.
    pub submission: Submission,
    /// State of each element.
    pub elements: Vec<Element>,
}

/// State of a submission.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "submission", rename_all = "kebab-case")]
pub enum Submission {
    /// The name is durable. The job's folder shows whether the scheduler was asked.
    Intended,
    /// The scheduler was asked, but its answer is unclear: the name is looked up.
    Doubtful {
        /// Time of the request, milliseconds since 1970.
        since_ms: i64,
        /// Description of the answer.
        why: String,
    },
    /// The scheduler accepted the job.
    Accepted {
        /// Scheduler's number of the job; `None` if it is unknown.
        job: Option<u64>,
    },
    /// The submission led to no job.
    Void {
        /// Reason, for a person.
        why: String,
    },
}

/// State of an element.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "element", rename_all = "kebab-case")]
pub enum Element {
    /// The element is in the queue, or on its way there.
    Waiting,
    /// The element has nodes.
    Running,
    /// The element is visibly neither alive nor ended.
    Unknown {
        /// Time since which this is so, milliseconds since 1970.
        since_ms: i64,
        /// Reason, for a person.
        why: String,
    },
    /// The element was asked to end.
    Stopping,
    /// The element is over.
    Over {
        /// Scheduler's account of the element's end.
        ending: Ending,
    },
}

/// Ending of an element.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Ending {
    /// Cause of a failure; `None` if the element ended in order or was not wanted any more.
    pub cause: Option<FailureCause>,
    /// Description for a person.
    pub words: String,
    /// Nodes that failed, as far as they are known, in Slurm's notation.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub failed_nodes: String,
}

/// Event of a job. The first two are commands, the others observations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum JobEvent {
    /// Command: an element is not wanted any more.
    Cancel {
        /// Index of the element.
        element: usize,
    },
    /// Command: the grace time of an unknown element is over.
    GiveUp {
        /// Index of the element.
        element: usize,
    },
    /// The scheduler has the job.
    Accepted {
        /// Scheduler's number of the job; `None` if it is unknown.
        job: Option<u64>,
    },
    /// The scheduler refused the job, and would refuse the same job again.
    Refused {
        /// Message of the scheduler.
        why: String,
    },
    /// The scheduler was asked, but its answer is unclear.
    Doubt {
        /// Time of the request, milliseconds since 1970.
        at_ms: i64,
        /// Description of the answer.
        why: String,
    },
    /// A lookup was answered without the name, and the grace time since the doubt is over.
    Absent,
    /// An element was seen alive.
    Seen {
        /// Index of the element.
        element: usize,
        /// Whether the element has begun.
        runs: bool,
    },
    /// An element is not where it was.
    Vanished {
        /// Index of the element.
        element: usize,
        /// Time of this observation, milliseconds since 1970.
        at_ms: i64,
        /// Reason, for a person.
        why: String,
    },
    /// An element has no process any more, and its ending is known.
    Ended {
        /// Index of the element.
        element: usize,
        /// Scheduler's account of the element's end.
        ending: Ending,
    },
}

/// Action that follows from a transition. Each may be executed twice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JobAction {
    /// Fence an element's folder.
    Fence(usize),
    /// Cancel an element at the scheduler.
    Cancel(usize),
}

impl ClusterJob {
    /// A job whose name is about to be committed.
    #[must_use]
    pub fn intended(n_elements: usize) -> Self {
        Self {
            submission: Submission::Intended,
            elements: vec![Element::Waiting; n_elements],
        }
    }

    /// Whether no element can be live any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.elements
            .iter()
            .all(|element| matches!(element, Element::Over { .. }))
    }

    /// State of an element, for tables.
    #[must_use]
    pub fn shown(&self, element: usize) -> JobState {
        match (&self.submission, self.elements.get(element)) {
            (_, Some(Element::Over { .. }) | None) => JobState::Over,
            (Submission::Intended, _) => JobState::Submitting,
            (Submission::Doubtful { .. }, _) => JobState::Doubtful,
            (_, Some(Element::Waiting)) => JobState::Waiting,
            (_, Some(Element::Running)) => JobState::Running,
            (_, Some(Element::Unknown { .. })) => JobState::Unknown,
            (_, Some(Element::Stopping)) => JobState::Stopping,
        }
    }

    /// Next state, and the actions that follow.
    ///
    /// # Errors
    /// [`IllegalTransition`] for a command that makes no sense in this state; never for an
    /// observation.
    pub fn on(mut self, event: JobEvent) -> Result<(Self, Vec<JobAction>), IllegalTransition> {
        use JobEvent as E;
        let mut actions = Vec::new();
        match event {
            E::Accepted { job } => match &mut self.submission {
                Submission::Intended | Submission::Doubtful { .. } => {
                    self.submission = Submission::Accepted { job }
                }
                Submission::Accepted { job: known } => *known = known.or(job),
                // The job was given up and fenced. If it turns up late, it does nothing and is
                // cancelled.
                Submission::Void { .. } => {
                    actions.extend((0..self.elements.len()).map(JobAction::Cancel))
                }
            },
            E::Refused { why } => {
                if matches!(
                    self.submission,
                    Submission::Intended | Submission::Doubtful { .. }
                ) {
                    self.end_all(Some(FailureCause::Refused), &why);
                    self.submission = Submission::Void { why };
                }
            }
            E::Doubt { at_ms, why } => {
                if self.submission == Submission::Intended {
                    self.submission = Submission::Doubtful {
                        since_ms: at_ms,
                        why,
                    };
                }
            }
            E::Absent => {
                if let Submission::Doubtful { why, .. } = &self.submission {
                    let why = format!("never reached the queue: {why}");
                    actions.extend((0..self.elements.len()).map(JobAction::Fence));
                    self.end_all(None, &why);
                    self.submission = Submission::Void { why };
                }
            }
            E::Seen { element, runs } => {
                if matches!(
                    self.submission,
                    Submission::Intended | Submission::Doubtful { .. }
                ) {
                    self.submission = Submission::Accepted { job: None };
                }
                if let Some(
                    state @ (Element::Waiting | Element::Running | Element::Unknown { .. }),
                ) = self.elements.get_mut(element)
                {
                    *state = if runs {
                        Element::Running
                    } else {
                        Element::Waiting
                    };
                }
            }
            E::Vanished {
                element,
                at_ms,
                why,
            } => {
                if let Some(state @ (Element::Waiting | Element::Running)) =
                    self.elements.get_mut(element)
                {
                    *state = Element::Unknown {
                        since_ms: at_ms,
                        why,
                    };
                }
            }
            E::Ended { element, ending } => {
                if let Some(state) = self
                    .elements
                    .get_mut(element)
                    .filter(|e| !matches!(e, Element::Over { .. }))
                {
                    // An element that died because it had to stop has no cause of failure.
                    let cause = ending.cause.filter(|_| *state != Element::Stopping);
                    *state = Element::Over {
                        ending: Ending { cause, ..ending },
                    };
                    // Its processes may live on where Slurm lost sight of them.
                    actions.push(JobAction::Fence(element));
                }
            }
            E::Cancel { element } => match self.elements.get_mut(element) {
                Some(Element::Over { .. }) | None => return Err(illegal(&self, element, "cancel")),
                Some(state) => {
                    *state = Element::Stopping;
                    actions.extend([JobAction::Fence(element), JobAction::Cancel(element)]);
                }
            },
            E::GiveUp { element } => match self.elements.get_mut(element) {
                Some(state @ Element::Unknown { .. }) => {
                    let Element::Unknown { why, .. } = &*state else {
                        unreachable!("matched above")
                    };
                    let ending = Ending {
                        cause: Some(FailureCause::Lost),
                        words: format!("given up: {why}"),
                        ..Ending::default()
                    };
                    *state = Element::Over { ending };
                    actions.extend([JobAction::Fence(element), JobAction::Cancel(element)]);
                }
                _ => return Err(illegal(&self, element, "give up")),
            },
        }
        Ok((self, actions))
    }

    fn end_all(&mut self, cause: Option<FailureCause>, why: &str) {
        for element in self
            .elements
            .iter_mut()
            .filter(|e| !matches!(e, Element::Over { .. }))
        {
            *element = Element::Over {
                ending: Ending {
                    cause,
                    words: why.to_owned(),
                    ..Ending::default()
                },
            };
        }
    }
}

fn illegal(job: &ClusterJob, element: usize, event: &str) -> IllegalTransition {
    IllegalTransition {
        machine: "cluster job",
        state: job.shown(element).to_string(),
        event: event.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ending(cause: Option<FailureCause>) -> Ending {
        Ending {
            cause,
            words: "so".into(),
            ..Ending::default()
        }
    }

    fn events() -> Vec<JobEvent> {
        use JobEvent as E;
        let mut events = vec![
            E::Accepted { job: Some(7) },
            E::Accepted { job: None },
            E::Refused {
                why: "limit".into(),
            },
            E::Doubt {
                at_ms: 5,
                why: "timeout".into(),
            },
            E::Absent,
        ];
        for element in 0..3 {
            events.extend([
                E::Cancel { element },
                E::GiveUp { element },
                E::Seen {
                    element,
                    runs: element == 0,
                },
                E::Vanished {
                    element,
                    at_ms: 9,
                    why: "gone".into(),
                },
                E::Ended {
                    element,
                    ending: ending(Some(FailureCause::Walltime)),
                },
                E::Ended {
                    element,
                    ending: ending(None),
                },
            ]);
        }
        events
    }

    proptest! {
        /// Late, repeated and lost observations: an element that is over stays over, a void
        /// submission stays void, and nothing is undone.
        #[test]
        fn no_order_of_events_undoes_an_ending(order in proptest::collection::vec(0_usize..23, 0..40)) {
            let events = events();
            let mut job = ClusterJob::intended(2);
            for i in order {
                let Ok((next, actions)) = job.clone().on(events[i].clone()) else { continue };
                for (before, after) in job.elements.iter().zip(&next.elements) {
                    if matches!(before, Element::Over { .. }) {
                        prop_assert_eq!(before, after);
                    }
                    // Every ending other than a refusal comes with a fence.
                    if !matches!(before, Element::Over { .. }) && matches!(after, Element::Over { .. })
                        && !matches!(events[i], JobEvent::Refused { .. })
                    {
                        prop_assert!(actions.iter().any(|a| matches!(a, JobAction::Fence(_))), "{:?}", events[i]);
                    }
                }
                if matches!(job.submission, Submission::Void { .. }) {
                    prop_assert_eq!(&job.submission, &next.submission);
                    prop_assert!(next.is_over());
                }
                if matches!(job.submission, Submission::Accepted { .. }) {
                    let accepted = matches!(next.submission, Submission::Accepted { .. });
                    prop_assert!(accepted, "{:?}", next.submission);
                }
                job = next;
            }
        }
    }

    #[test]
    fn a_job_that_turns_up_after_it_was_given_up_is_cancelled() {
        let doubt = JobEvent::Doubt {
            at_ms: 1,
            why: "Socket timed out".into(),
        };
        let (job, _) = ClusterJob::intended(1).on(doubt).unwrap();
        let (job, actions) = job.on(JobEvent::Absent).unwrap();
        assert_eq!(actions, [JobAction::Fence(0)]);
        let (job, actions) = job.on(JobEvent::Accepted { job: Some(9) }).unwrap();
        assert_eq!(actions, [JobAction::Cancel(0)]);
        assert!(job.is_over());
    }

    #[test]
    fn what_was_stopped_died_of_nothing() {
        let (job, _) = ClusterJob::intended(1)
            .on(JobEvent::Accepted { job: Some(9) })
            .unwrap();
        let (job, _) = job.on(JobEvent::Cancel { element: 0 }).unwrap();
        let (job, _) = job
            .on(JobEvent::Ended {
                element: 0,
                ending: ending(Some(FailureCause::Cancelled)),
            })
            .unwrap();
        assert_eq!(
            job.elements,
            [Element::Over {
                ending: ending(None)
            }]
        );
    }
}
