//! Recognition of errors by which a folder may not be written.

use std::error::Error;
use std::io::{self, ErrorKind};

use cardiotwin_engine::{EngineError, StoreError};

use super::error::CliError;

/// Whether the system refused to write: a read-only database, or a refusal somewhere in the chain of
/// causes.
pub fn is_denied(error: &CliError) -> bool {
    if let CliError::Store(StoreError::ReadOnly { .. })
    | CliError::Engine(EngineError::Store(StoreError::ReadOnly { .. })) = error
    {
        return true;
    }
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(error) = cause {
        let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
        if let Some(ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) = kind {
            return true;
        }
        cause = error.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_found_among_the_causes() {
        let denied = |kind: ErrorKind| {
            let error = CliError::file("create", "/run")(kind.into());
            is_denied(&error)
        };
        assert!(denied(ErrorKind::PermissionDenied) && denied(ErrorKind::ReadOnlyFilesystem));
        assert!(!denied(ErrorKind::NotFound));
        assert!(!is_denied(&CliError::Usage("permission denied".into())));
    }
}
