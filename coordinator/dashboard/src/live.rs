//! Updates as they come. One poller asks the source while somebody looks, and sends every browser
//! only what changed.

use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::response::sse::Event;
use futures_util::Stream;
use serde::Serialize;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{Notify, broadcast, watch};

use crate::source::{CohortState, PatientRow, Source, SourceError};

/// Time between two questions to the source.
const POLL: Duration = Duration::from_millis(250);
/// Time between two attempts to read a run that could not be read.
const RETRY: Duration = Duration::from_secs(2);
/// Messages that a slow browser may be behind before it is sent everything again.
const BEHIND: usize = 64;

/// A message to the page.
#[derive(Serialize)]
struct Message<'a> {
    /// Whether `patients` replaces all rows of the page.
    whole: bool,
    /// Reason why the run cannot be read at present.
    trouble: Option<&'a str>,
    #[serde(flatten)]
    state: &'a CohortState,
    /// Rows that are new or changed.
    patients: Vec<&'a PatientRow>,
    /// Patients that are no longer in the run.
    gone: Vec<&'a str>,
}

/// Text of the message that takes a page from `before` to `now`.
fn message(before: Option<&CohortState>, now: &CohortState, trouble: Option<&str>) -> String {
    let old: HashMap<&str, &PatientRow> = before
        .into_iter()
        .flat_map(|state| &state.patients)
        .map(|row| (row.status.patient.as_str(), row))
        .collect();
    let patients: Vec<&PatientRow> = now
        .patients
        .iter()
        .filter(|row| old.get(row.status.patient.as_str()) != Some(row))
        .collect();
    let mut gone = old;
    for row in &now.patients {
        gone.remove(row.status.patient.as_str());
    }
    let mut gone: Vec<&str> = gone.into_keys().collect();
    gone.sort_unstable();
    let message = Message {
        whole: before.is_none(),
        trouble,
        state: now,
        patients,
        gone,
    };
    serde_json::to_string(&message).expect("rows of texts and numbers are JSON")
}

/// The run as the browsers know it.
#[derive(Default)]
struct Known {
    state: Option<CohortState>,
    trouble: Option<String>,
}

/// Distribution of updates.
pub struct Hub {
    known: Mutex<Known>,
    news: broadcast::Sender<Arc<str>>,
    somebody_came: Notify,
    closing: watch::Sender<bool>,
}

impl Hub {
    /// A hub without listeners.
    #[must_use]
    pub fn new() -> Self {
        Self {
            known: Mutex::default(),
            news: broadcast::Sender::new(BEHIND),
            somebody_came: Notify::new(),
            closing: watch::Sender::new(false),
        }
    }

    /// Ends all streams and the poller.
    pub fn close(&self) {
        self.closing.send_replace(true);
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Everything that is known, as a message, and the messages after it.
    fn subscribe(&self) -> (Option<Arc<str>>, broadcast::Receiver<Arc<str>>) {
        let known = self.known();
        let news = self.news.subscribe();
        let trouble = known.trouble.as_deref();
        let first = known
            .state
            .as_ref()
            .map(|state| message(None, state, trouble).into());
        drop(known);
        self.somebody_came.notify_one();
        (first, news)
    }

    /// Whether nobody listens. The state is forgotten then, because nobody keeps it current.
    fn is_alone(&self) -> bool {
        let mut known = self.known();
        let alone = self.news.receiver_count() == 0;
        if alone {
            *known = Known::default();
        }
        alone
    }

    /// Takes up a state or a trouble, and tells the listeners what is new.
    fn tell(&self, found: Result<CohortState, String>) {
        let mut known = self.known();
        let text = match found {
            Ok(now) => {
                if known.state.as_ref() == Some(&now) && known.trouble.is_none() {
                    return;
                }
                let text = message(known.state.as_ref(), &now, None);
                *known = Known {
                    state: Some(now),
                    trouble: None,
                };
                text
            }
            Err(trouble) if known.trouble.as_ref() == Some(&trouble) => return,
            Err(trouble) => {
                let state = known.state.get_or_insert_default();
                let text = message(Some(state), state, Some(&trouble));
                known.trouble = Some(trouble);
                text
            }
        };
        // Without a listener the message is not missed: the next one gets everything.
        let _ = self.news.send(text.into());
    }

    /// Asks the source again and again while somebody listens, until the hub is closed.
    pub async fn poll<S: Source>(self: Arc<Self>, source: Arc<S>) {
        let mut closing = self.closing.subscribe();
        let mut last = None;
        loop {
            let pause = if self.is_alone() {
                last = None;
                tokio::select! {
                    () = self.somebody_came.notified() => Duration::ZERO,
                    _ = closing.wait_for(|closing| *closing) => return,
                }
            } else {
                self.look(source.as_ref(), &mut last).await
            };
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                _ = closing.wait_for(|closing| *closing) => return,
            }
        }
    }

    async fn look<S: Source>(&self, source: &S, last: &mut Option<String>) -> Duration {
        let found = async {
            // The mark comes first: a change while the state is read makes another mark.
            let mark = source.mark().await?;
            if last.as_ref() == Some(&mark) {
                return Ok(());
            }
            self.tell(Ok(source.state().await?));
            *last = Some(mark);
            Ok::<_, SourceError>(())
        };
        match found.await {
            Ok(()) => POLL,
            Err(error) => {
                *last = None;
                self.tell(Err(error.to_string()));
                RETRY
            }
        }
    }

    /// Messages for one browser: the whole state first, then changes, until the hub is closed.
    pub fn stream(self: &Arc<Self>) -> impl Stream<Item = Result<Event, Infallible>> + use<> {
        let (first, news) = self.subscribe();
        let closing = self.closing.subscribe();
        let start = (Arc::clone(self), first, news, closing);
        futures_util::stream::unfold(
            start,
            |(hub, mut first, mut news, mut closing)| async move {
                loop {
                    if let Some(text) = first.take() {
                        let event = Event::default().data(text.as_ref());
                        return Some((Ok(event), (hub, None, news, closing)));
                    }
                    let received = tokio::select! {
                        received = news.recv() => received,
                        _ = closing.wait_for(|closing| *closing) => return None,
                    };
                    match received {
                        Ok(text) => first = Some(text),
                        Err(RecvError::Lagged(_)) => (first, news) = hub.subscribe(),
                        Err(RecvError::Closed) => return None,
                    }
                }
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::status::{PatientState, PatientStatus};
    use serde_json::Value;

    use super::*;

    fn row(patient: &str, note: &str) -> PatientRow {
        PatientRow {
            status: PatientStatus {
                patient: patient.into(),
                step: "step-1".into(),
                state: PatientState::Running,
                note: note.into(),
                ..PatientStatus::default()
            },
            since_ms: 0,
        }
    }

    fn state(rows: Vec<PatientRow>) -> CohortState {
        CohortState {
            cohort: "c".into(),
            patients: rows,
            ..CohortState::default()
        }
    }

    fn names(message: &str) -> Vec<String> {
        let message: Value = serde_json::from_str(message).unwrap();
        let rows = message["patients"].as_array().unwrap().iter();
        rows.map(|row| row["patient"].as_str().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn only_changed_rows_are_sent_and_lost_ones_are_named() {
        let before = state(vec![row("a", "1"), row("b", "1"), row("c", "1")]);
        let now = state(vec![row("a", "1"), row("b", "2"), row("d", "1")]);
        let text = message(Some(&before), &now, None);
        assert_eq!(names(&text), ["b", "d"]);
        let text: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(text["gone"], serde_json::json!(["c"]));
        assert_eq!(text["whole"], false);
        let whole = message(None, &now, None);
        assert_eq!(names(&whole), ["a", "b", "d"]);
    }

    #[test]
    fn whoever_comes_late_or_fell_behind_gets_everything() {
        let hub = Hub::new();
        let (nothing, mut early) = hub.subscribe();
        assert!(nothing.is_none(), "nothing is known yet");
        hub.tell(Ok(state(vec![row("a", "0")])));
        assert_eq!(names(&early.try_recv().unwrap()), ["a"]);
        for n in 1..=BEHIND + 1 {
            let note = n.to_string();
            hub.tell(Ok(state(vec![row("a", &note), row("b", "0")])));
        }
        assert!(matches!(
            early.try_recv(),
            Err(broadcast::error::TryRecvError::Lagged(_))
        ));
        let (late, _news) = hub.subscribe();
        assert_eq!(names(&late.unwrap()), ["a", "b"]);
    }

    #[test]
    fn the_same_state_is_told_once_and_a_trouble_is_taken_back() {
        let hub = Hub::new();
        let (_, mut news) = hub.subscribe();
        hub.tell(Ok(state(vec![row("a", "0")])));
        hub.tell(Ok(state(vec![row("a", "0")])));
        hub.tell(Err("the disk is gone".into()));
        hub.tell(Err("the disk is gone".into()));
        hub.tell(Ok(state(vec![row("a", "0")])));
        let mut told = Vec::new();
        while let Ok(text) = news.try_recv() {
            let text: Value = serde_json::from_str(&text).unwrap();
            told.push(text["trouble"].clone());
        }
        assert_eq!(told, [Value::Null, "the disk is gone".into(), Value::Null]);
    }

    #[test]
    fn nothing_is_remembered_while_nobody_looks() {
        let hub = Hub::new();
        let (_, news) = hub.subscribe();
        hub.tell(Ok(state(vec![row("a", "0")])));
        assert!(!hub.is_alone());
        drop(news);
        assert!(hub.is_alone());
        assert!(hub.subscribe().0.is_none());
    }
}
