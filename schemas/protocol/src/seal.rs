//! Seal of an outcome: its file states its own SHA-256, so that a change by hand, by a damaged disk or
//! by a half-copied run is found before a result is adopted.

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::outcome::TaskOutcome;

/// Value in the place of the hash while the hash is computed.
const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// The text of `outcome.json` with its seal.
///
/// # Errors
/// Any error of the JSON writer.
pub fn sealed(outcome: &TaskOutcome) -> Result<Vec<u8>, serde_json::Error> {
    let blank = TaskOutcome {
        sha256: Some(BLANK.to_owned()),
        ..outcome.clone()
    };
    let text = serde_json::to_string_pretty(&blank)?;
    let hash = sha256_hex(text.as_bytes());
    // The seal is the last key of the file.
    let at = text.rfind(BLANK).unwrap_or(text.len());
    Ok([&text[..at], &hash, &text[at + BLANK.len()..]]
        .concat()
        .into_bytes())
}

/// The SHA-256 that the outcome should state, if it differs from the stated one; `None` for a sound
/// outcome and for an outcome of an earlier version, which states none.
///
/// - `text`: content of the file from which `outcome` was read
#[must_use]
pub fn broken(outcome: &TaskOutcome, text: &str) -> Option<String> {
    let stated = outcome.sha256.as_ref()?;
    let found = sha256_hex(text.replacen(stated.as_str(), BLANK, 1).as_bytes());
    (found != *stated).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::{AttemptId, TaskKey};
    use cardiotwin_schemas::outcome::Ending;
    use cardiotwin_schemas::provenance::Provenance;

    #[test]
    fn any_change_of_an_outcome_breaks_its_seal() {
        let outcome = TaskOutcome {
            schema_version: 1,
            attempt: AttemptId {
                task: TaskKey("0".repeat(64)),
                generation: 1,
            },
            ending: Ending::Cancelled,
            artefacts: vec![],
            provenance: Provenance::default(),
            sha256: None,
        };
        let text = String::from_utf8(sealed(&outcome).unwrap()).unwrap();
        let read: TaskOutcome = serde_json::from_str(&text).unwrap();
        assert_eq!(broken(&read, &text), None);
        let again = String::from_utf8(sealed(&read).unwrap()).unwrap();
        assert_eq!(again, text);
        for (old, new) in [("\"generation\": 1", "\"generation\": 2"), ("\n}", "\n }")] {
            let edited = text.replacen(old, new, 1);
            assert_ne!(edited, text, "{old}");
            assert!(broken(&serde_json::from_str(&edited).unwrap(), &edited).is_some());
        }
        let earlier = serde_json::to_string(&outcome).unwrap();
        assert_eq!(broken(&outcome, &earlier), None);
    }
}
