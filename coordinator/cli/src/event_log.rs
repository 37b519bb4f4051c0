//! Engine events as log records for a log collector, with fields in place of sentences.

use tracing::{debug, info, trace, warn};

use cardiotwin_engine::{EngineEvent, PatientEnding};

/// Writes the record of one event: results at level `info` (`-v`), starts at `debug` (`-vv`),
/// progress at `trace` (`-vvv`).
pub fn log(event: &EngineEvent) {
    match event {
        EngineEvent::Started {
            patients,
            settled,
            adopted,
        } => {
            info!(patients, settled, adopted, "run started");
        }
        EngineEvent::TaskStarted {
            patient,
            step,
            generation,
        } => {
            debug!(%patient, step, generation, "attempt handed to the executor");
        }
        EngineEvent::Progress {
            patient,
            step,
            phase,
            done,
            total,
            note,
        } => {
            trace!(%patient, step, phase, done, total, note, "progress");
        }
        EngineEvent::TaskPublished {
            patient,
            step,
            note,
        } => info!(%patient, step, note, "task published"),
        EngineEvent::AttemptFailed {
            patient,
            step,
            generation,
            failure,
            retried,
        } => {
            let class = failure.class.as_str();
            warn!(%patient, step, generation, class, retried, reason = failure.message, "attempt failed");
        }
        EngineEvent::Step1Ended { patient, summary } => {
            info!(%patient, best = summary.best_iteration, cost = summary.cost, quality = ?summary.quality, "step 1 ended");
        }
        EngineEvent::PatientEnded {
            patient,
            ending,
            over,
            of,
        } => match ending {
            PatientEnding::Done => info!(%patient, over, of, "patient done"),
            PatientEnding::Failed(failure) => {
                warn!(%patient, over, of, class = failure.class.as_str(), reason = failure.message, "patient failed");
            }
            PatientEnding::Cancelled => info!(%patient, over, of, "patient cancelled"),
        },
        EngineEvent::Vanished { patients } => {
            for patient in patients {
                warn!(%patient, "patient vanished from the cohort");
            }
        }
        EngineEvent::Request { text } => info!(text, "request applied"),
        EngineEvent::DatabaseLocked { waiting } => {
            warn!(
                holder = waiting.holder,
                since = waiting.since,
                "database locked"
            );
        }
        EngineEvent::Stopping { running, draining } => info!(running, draining, "stopping"),
    }
}
