//! Telling operators while a run goes on, beside it: whatever becomes of a notice, the run does not wait for it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_schemas::notices::NoticeSettings;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;

use super::talk::Talk;
use crate::engine::{self, EngineError, EngineEvent, PatientEnding, StoreError};

/// How often the room is looked at.
const EVERY: Duration = Duration::from_secs(60);

/// Looks for something to tell whenever there may be.
pub struct Notifier {
    poke: UnboundedSender<()>,
    task: JoinHandle<()>,
}

impl Notifier {
    /// Begins with what an earlier coordinator left untold.
    #[must_use]
    pub fn start(run_dir: &Path, settings: &NoticeSettings, talk: &Talk) -> Self {
        let (poke, poked) = unbounded_channel();
        let task = tokio::spawn(listen(poked, run_dir.to_owned(), settings.clone(), *talk));
        Self { poke, task }
    }

    /// Something that may be worth telling happened: it is in the database already.
    pub fn on(&self, event: &EngineEvent) {
        let matters = match event {
            EngineEvent::Started { .. } => true,
            EngineEvent::PatientEnded { ending, .. } => *ending != PatientEnding::Cancelled,
            EngineEvent::Step1Ended { .. } => true,
            _ => false,
        };
        if matters {
            // Nobody listens only when nobody is to be told.
            let _ = self.poke.send(());
        }
    }

    /// Tells what is left to tell.
    pub async fn finish(self) {
        drop(self.poke);
        let _ = self.task.await;
    }
}

/// Tells once, for commands that do not stay.
pub async fn tell(run_dir: &Path, settings: &NoticeSettings, talk: &Talk) {
    match engine::tell(run_dir, settings).await {
        Ok(said) => said.iter().for_each(|line| talk.say(line)),
        // A run that has no database yet has nothing to tell.
        Err(EngineError::Store(StoreError::Missing { .. })) => {}
        Err(error) => talk.say(&format!("notices: {error}; the run goes on")),
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
