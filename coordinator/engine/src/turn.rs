//! The one loop of the engine: observe, decide, commit, act.
//!
//! ```text
//!        ┌──────────────► act: what was committed ──► executor, scheduler, files
//!        │                       │
//!     commit ◄── decide ◄── observe: news, requests, directories, queue
//! ```
//! Three engines take its turns, each over its own books. A run on this machine
//! ([`local_loop`](super::local_loop)) and the tick of a run on a cluster ([`cluster`](super::cluster))
//! keep theirs in the store; the driver inside a job ([`in_job_loop`](super::in_job_loop)) has the
//! attempts' directories alone.
//!
//! Actions come only from what was committed, and their effects are observed in a later turn, not
//! assumed. The process may therefore be killed anywhere.

use super::EngineError;

/// An engine over its books.
pub trait Engine {
    /// What was observed, as plain data.
    type Seen;

    /// What a decision has to know before it is complete.
    type Question;

    /// Reads the world: processes, directories, the queue, signals, the clock.
    async fn observe(&mut self) -> Result<Self::Seen, EngineError>;

    /// Decides what follows from an observation. A decision reads and writes nothing outside the
    /// books in memory. It returns what it needs to know, and is called again with the answer; it
    /// is complete when it asks nothing.
    fn decide(&mut self, seen: Self::Seen) -> Result<Option<Self::Question>, EngineError>;

    /// Looks for what a decision asks.
    async fn look(&mut self, question: Self::Question) -> Result<Self::Seen, EngineError>;

    /// Makes the decisions durable.
    async fn commit(&mut self) -> Result<(), EngineError>;

    /// Executes committed actions. An action may be executed twice; the second time it changes
    /// nothing.
    async fn act(&mut self) -> Result<(), EngineError>;

    /// Whether nothing is left to observe, to commit or to execute.
    fn is_over(&self) -> bool;
}

/// Takes turns until the engine is over.
///
/// The effects of a turn's actions are committed with the next turn, those of the last actions at
/// the end.
pub async fn run<E: Engine>(engine: &mut E) -> Result<(), EngineError> {
    loop {
        let mut seen = engine.observe().await?;
        while let Some(question) = engine.decide(seen)? {
            seen = engine.look(question).await?;
        }
        engine.commit().await?;
        engine.act().await?;
        if engine.is_over() {
            engine.commit().await?;
            // The commit may have put further actions in the outbox.
            if engine.is_over() {
                return Ok(());
            }
        }
    }
}
