//! No-op tasks inside the coordinator, which measure orchestration without processes, directories
//! and outcome files.

use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

use cardiotwin_protocol::process;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::{AttemptId, ExternalId};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome, TaskResult};
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_store::clock;
use tokio::sync::mpsc;

use super::{AttemptFindings, DispatchError, Executor, Found, News, Order};

/// Most results that one call of [`Executor::news`] returns. They are committed together.
const LARGEST_GROUP: usize = 2048;

/// Executor of no-op tasks inside the coordinator.
#[derive(Debug)]
pub struct InProcess {
    at_once: usize,
    running: HashSet<AttemptId>,
    ended: mpsc::UnboundedReceiver<AttemptId>,
    tell: mpsc::UnboundedSender<AttemptId>,
}

impl InProcess {
    /// An executor that takes `at_once` tasks at a time.
    #[must_use]
    pub fn new(at_once: usize) -> Self {
        let (tell, ended) = mpsc::unbounded_channel();
        Self {
            at_once,
            running: HashSet::new(),
            ended,
            tell,
        }
    }

    fn outcome(attempt: AttemptId) -> News {
        let provenance = Provenance {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            threads: 1,
            ranks: 1,
            host: process::host().to_owned(),
            started: clock::now_utc(),
            ..Provenance::default()
        };
        let outcome = TaskOutcome {
            schema_version: formats::OUTCOME.version,
            attempt: attempt.clone(),
            ending: Ending::Succeeded {
                result: Box::new(TaskResult::Noop),
            },
            artefacts: Vec::new(),
            provenance,
            sha256: None,
        };
        let text = serde_json::to_string(&outcome).expect("an outcome is JSON");
        News::Ended {
            attempt,
            evidence: AttemptFindings::Outcome {
                outcome: Box::new(outcome),
                text,
            },
            claim: None,
        }
    }
}

impl Executor for InProcess {
    fn kind(&self) -> &'static str {
        "in-process"
    }

    fn free(&self) -> usize {
        self.at_once.saturating_sub(self.running.len())
    }

    async fn submit(&mut self, order: Order) -> Result<ExternalId, DispatchError> {
        let TaskSpec::Noop(noop) = &order.spec.task else {
            return Err(DispatchError::Kind {
                kind: order.spec.task.kind(),
            });
        };
        let attempt = order.spec.attempt;
        self.running.insert(attempt.clone());
        if noop.sleep_ms == 0 {
            // The receiver lives as long as `self`.
            let _ = self.tell.send(attempt);
        } else {
            let (tell, wait) = (self.tell.clone(), Duration::from_millis(noop.sleep_ms));
            tokio::spawn(async move {
                tokio::time::sleep(wait).await;
                let _ = tell.send(attempt);
            });
        }
        Ok(ExternalId(std::process::id().to_string()))
    }

    fn adopt(&mut self, _attempt: &AttemptId, _directory: &Path) -> Result<Found, DispatchError> {
        // A task inside an earlier coordinator ended with that coordinator.
        Ok(Found::Unclaimed)
    }

    fn stop(
        &mut self,
        attempt: &AttemptId,
        _directory: &Path,
        _now: bool,
    ) -> Result<bool, DispatchError> {
        // A no-op ends by itself soon enough.
        Ok(self.running.contains(attempt))
    }

    async fn news(&mut self) -> Vec<News> {
        let mut attempts = Vec::new();
        // Pending for ever if nothing runs. The caller waits for other events at the same time.
        self.ended.recv_many(&mut attempts, LARGEST_GROUP).await;
        for attempt in &attempts {
            self.running.remove(attempt);
        }
        attempts.into_iter().map(Self::outcome).collect()
    }
}
