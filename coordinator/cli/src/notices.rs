//! Notices to operators during a run. They are sent by a separate task: the run never waits for a
//! notice.

use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_engine::{self as engine, EngineError, EngineEvent, PatientEnding, StoreError};
use cardiotwin_schemas::notices::NoticeSettings;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;

use super::talk::Talk;

/// Interval at which notices are looked for without an event, for example on free disk space.
const EVERY: Duration = Duration::from_secs(60);

/// Task that sends pending notices after each relevant event and at regular intervals.
pub struct Notifier {
    poke: UnboundedSender<()>,
    task: JoinHandle<()>,
}

impl Notifier {
    /// Starts the task. Its first notices may be those that an earlier coordinator did not send.
    #[must_use]
    pub fn start(run_dir: &Path, settings: &NoticeSettings, talk: &Talk) -> Self {
        let (poke, poked) = unbounded_channel();
        let task = tokio::spawn(listen(poked, run_dir.to_owned(), settings.clone(), *talk));
        Self { poke, task }
    }

    /// Wakes the task if the event may cause a notice. The event is in the database already.
    pub fn on(&self, event: &EngineEvent) {
        let matters = match event {
            EngineEvent::Started { .. } => true,
            EngineEvent::PatientEnded { ending, .. } => *ending != PatientEnding::Cancelled,
            EngineEvent::Step1Ended { .. } => true,
            _ => false,
        };
        if matters {
            // The channel is closed only if the settings ask for no notices.
            let _ = self.poke.send(());
        }
    }

    /// Sends the remaining notices and ends the task.
    pub async fn finish(self) {
        drop(self.poke);
        let _ = self.task.await;
    }
}

/// Sends pending notices once, for commands that end at once.
pub async fn tell(run_dir: &Path, settings: &NoticeSettings, talk: &Talk) {
    match engine::tell(run_dir, settings).await {
        Ok(said) => said.iter().for_each(|line| talk.say(line)),
        // A run without a database has no notices.
        Err(EngineError::Store(StoreError::Missing { .. })) => {}
        Err(error) => talk.say(&format!("notices: {error}; the run continues")),
    }
}

async fn listen(
    mut poked: UnboundedReceiver<()>,
    run_dir: PathBuf,
    settings: NoticeSettings,
    talk: Talk,
) {
    if settings.is_silent() {
        return;
    }
    loop {
        let over = match tokio::time::timeout(EVERY, poked.recv()).await {
            Ok(heard) => heard.is_none(),
            Err(_) => false,
        };
        while poked.try_recv().is_ok() {}
        tell(&run_dir, &settings, &talk).await;
        if over {
            return;
        }
    }
}
