//! Identity of the build of the coordinator that decided last.
//!
//! The derivation of a patient's chain is a function of plan, outcomes and program. A finished
//! patient with an unchanged plan needs no new decision by the program that finished it; another
//! build may derive other tasks for any patient.

use std::sync::OnceLock;

use cardiotwin_schemas::hash::sha256_of_file;

/// Key of the identity among the store's single values.
pub const DECIDED_BY: &str = "decided_by";

/// SHA-256 of the running executable. It is empty if the executable cannot be read, and then equals
/// no stored value.
pub fn of_this_program() -> &'static str {
    static SHA256: OnceLock<String> = OnceLock::new();
    SHA256.get_or_init(|| {
        let hash = std::env::current_exe().and_then(|program| sha256_of_file(&program));
        hash.unwrap_or_default()
    })
}

/// Whether `stored` is the identity of the running program.
pub fn is_this_program(stored: Option<&String>) -> bool {
    stored.is_some_and(|stored| !stored.is_empty() && stored == of_this_program())
}
