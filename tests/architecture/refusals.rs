//! What source text and manifests may not use, each rule with its reason. `docs/architecture.md` lists the imports between crates,
//! and Cargo's manifests enforce them.

/// Crates that the tests of every crate may import.
pub const FOR_TESTS: [&str; 2] = ["findings", "not-tested"];

/// The only crates whose programs and libraries contain SQL.
pub const WITH_SQL: [&str; 2] = ["cardiotwin-store", "cardiotwin-tests"];

/// Foreign paths that a folder may not use.
pub struct Refusal {
    /// Folder, from the repository's root.
    pub folder: &'static str,
    /// Folder inside of it that may.
    pub except: Option<&'static str>,
    /// Paths that the folder's files may not use.
    pub paths: &'static [&'static str],
    /// Purpose of the rule.
    pub why: &'static str,
}

/// Rules for source text. Code under `#[cfg(test)]` is exempt.
pub const REFUSALS: &[Refusal] = &[
    Refusal {
        folder: "solver",
        except: None,
        paths: &[
            "tokio",
            "sqlx",
            "clap",
            "std::env",
            "std::process",
            "std::net",
            "std::time",
        ],
        why: "numerics know no clock, environment, process, network, database or command line",
    },
    Refusal {
        folder: "worker/src",
        except: None,
        paths: &["sqlx"],
        why: "a worker never opens the database",
    },
    Refusal {
        folder: "coordinator/workflow/src",
        except: None,
        paths: &[
            "tokio",
            "sqlx",
            "std::fs",
            "std::env",
            "std::process",
            "std::net",
            "std::time",
            "rustix",
            "tracing",
        ],
        why: "state machines have no clock and no I/O",
    },
    Refusal {
        folder: "coordinator/report/src",
        except: None,
        paths: &["sqlx", "tokio", "std::net"],
        why: "reports and exports touch neither store nor network",
    },
    Refusal {
        folder: "coordinator/input/src",
        except: None,
        paths: &["sqlx", "tokio", "std::net"],
        why: "input is files",
    },
    Refusal {
        folder: "coordinator/slurm/src",
        except: Some("coordinator/slurm/src/access/"),
        paths: &[
            "tokio",
            "sqlx",
            "clap",
            "std::fs",
            "std::env",
            "std::process",
            "std::net",
            "std::time",
        ],
        why: "what a caller hands in is all that it knows: no I/O, no clock",
    },
    Refusal {
        folder: "coordinator/engine/src/cluster/decide",
        except: None,
        paths: &[
            "tokio",
            "sqlx",
            "rustix",
            "std::fs",
            "std::env",
            "std::process",
            "std::net",
            "std::time",
            "cardiotwin_protocol",
            "cardiotwin_slurm::access",
        ],
        why: "decisions on a cluster get observations as data: no folder, clock or scheduler",
    },
    Refusal {
        folder: "coordinator/dashboard/src",
        except: None,
        paths: &["sqlx", "std::fs", "std::env", "std::process"],
        why: "the server serves what its source answers, and nothing else of this machine",
    },
];

/// Crates on which no crate under `solver/` may depend.
pub const NOT_FOR_SOLVERS: &[&str] = &[
    "tokio",
    "sqlx",
    "clap",
    "indicatif",
    "tracing",
    "tracing-subscriber",
    "rustix",
    "anyhow",
    "async-trait",
    "libsqlite3-sys",
];

/// Macros that no crate under `solver/` may call outside its tests.
pub const SOLVER_MACROS: &[&str] = &["print", "println", "eprint", "eprintln", "dbg"];

/// Largest number of lines of a source file. A file of more than about 400 should be split; above
/// this number the test fails.
pub const LONGEST_FILE: usize = 840;
