//! A tick on a cluster that could not write.

use cardiotwin_engine::{EngineError, StoreError};

use super::error::CliError;
use super::exit::Exit;
use super::talk::Talk;

/// A tick that could not write is no failure of the run: jobs continue, and the next tick writes.
///
/// # Errors
/// Every other error.
pub fn without_a_tick(error: EngineError, talk: &Talk) -> Result<Exit, CliError> {
    let EngineError::Store(error @ StoreError::Busy { .. }) = error else {
        return Err(error.into());
    };
    talk.insist(&format!(
        "this tick did nothing: {error}; jobs go on, and the next `cardiotwin advance` takes up \
         their results"
    ));
    Ok(Exit::Unfinished)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::talk::ColourChoice;

    #[test]
    fn a_locked_database_ends_a_tick_without_a_failure_and_other_errors_do_not() {
        let talk = Talk::new(ColourChoice::Never, true);
        let busy = StoreError::Busy {
            file: "run/cardiotwin.db".into(),
            holder: "process 7 (sqlite3)".into(),
            since: "2026-07-30T12:34:56.789Z".into(),
        };
        assert_eq!(
            without_a_tick(busy.into(), &talk).unwrap(),
            Exit::Unfinished
        );
        let full = EngineError::NoSpace {
            path: "run".into(),
            free_mb: 0,
        };
        assert_eq!(without_a_tick(full, &talk).unwrap_err().exit(), Exit::Store);
    }
}
