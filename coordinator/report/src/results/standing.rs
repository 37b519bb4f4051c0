//! State of a patient in a few words.

use cardiotwin_schemas::record::{PatientRecord, Step1Quality};
use cardiotwin_schemas::status::PatientState;

use crate::table::Tone;

/// Tone and words of a patient's state.
#[must_use]
pub fn standing(patient: &PatientRecord) -> (Tone, String) {
    let step = patient.status.step.replace("step-", "step ");
    if let Some(failure) = &patient.failure {
        let class = failure.class.as_str();
        return (Tone::Bad, format!("failed in {step} ({class})"));
    }
    match (patient.status.state, &patient.step1) {
        (PatientState::Done, Some(summary)) => {
            let stalled = if summary.quality == Step1Quality::Converged {
                ""
            } else {
                "; step 1 stalled"
            };
            match &patient.verdict {
                Some(verdict) if verdict.personalised && stalled.is_empty() => {
                    (Tone::Good, verdict.to_string())
                }
                Some(verdict) => (Tone::Doubtful, format!("{verdict}{stalled}")),
                None => (Tone::Quiet, format!("not verified{stalled}")),
            }
        }
        (PatientState::Done, None) => (Tone::Good, "finished".to_owned()),
        (state @ (PatientState::Failed | PatientState::Cancelled), _) => {
            (Tone::Bad, format!("{state} in {step}"))
        }
        // A patient is in no step before its first task.
        (state, _) if patient.status.step == "-" => (Tone::Quiet, state.to_string()),
        (state, _) => (Tone::Quiet, format!("{step}: {state}")),
    }
}
