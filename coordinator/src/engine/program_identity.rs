//! Which build of the coordinator decided last.
//!
//! The derivation of a patient's chain is a function of plan, outcomes and program. A finished patient whose plan stands needs
//! no new decision by the program that finished it; another build may want other tasks, of any patient.

use std::sync::OnceLock;

use cardiotwin_schemas::hash::sha256_hex;

/// Key among the store's single values.
pub const DECIDED_BY: &str = "decided_by";

/// SHA-256 of the running executable; empty where it cannot be read, which equals no stored one.
pub fn of_this_program() -> &'static str {
    static SHA256: OnceLock<String> = OnceLock::new();
    SHA256.get_or_init(|| {
        let bytes = std::env::current_exe().and_then(std::fs::read);
        bytes.map_or_else(|_| String::new(), |bytes| sha256_hex(&bytes))
    })
}

/// Whether `stored` names the running program.
pub fn is_this_program(stored: Option<&String>) -> bool {
    stored.is_some_and(|stored| !stored.is_empty() && stored == of_this_program())
}
