//! The import rules as data, each with its reason. `docs/architecture.md` shows the same two
//! tables, which [`markdown`] writes.

/// Imports that a crate or a room of the coordinator may have.
pub struct Rule {
    /// A crate without its prefix `cardiotwin-`, or a room of the coordinator.
    pub who: &'static str,
    /// Crates or rooms of the project that it may import.
    pub may: &'static [&'static str],
    /// Purpose of the rule, as the last column of the table.
    pub why: &'static str,
}

/// Crate that the tests of every crate may import.
pub const FOR_TESTS: &str = "not-tested";

/// Rules for the workspace's crates. A crate without a row fails the test.
pub const CRATES: &[Rule] = &[
    Rule {
        who: "units",
        may: &[],
        why: "quantities stand still",
    },
    Rule {
        who: "vocabulary",
        may: &[],
        why: "biomarkers, parameters and settings have one definition, which every crate may import",
    },
    Rule {
        who: "schemas",
        may: &["vocabulary"],
        why: "formats stand still: they outlive every process",
    },
    Rule {
        who: "protocol",
        may: &["schemas"],
        why: "an attempt's directory is written and read by the same code on both sides",
    },
    Rule {
        who: "input-files",
        may: &[],
        why: "every reader of users' files refuses pipes, devices and sizes that fill the memory",
    },
    Rule {
        who: "signals",
        may: &["vocabulary", "units", "input-files"],
        why: "a trace knows no model, so measured and simulated ones are treated alike",
    },
    Rule {
        who: "lab-files",
        may: &["vocabulary", "units", "signals"],
        why: "formats of other programs have one place; bytes in, columns and words out",
    },
    Rule {
        who: "recordings",
        may: &["vocabulary", "units", "signals", "lab-files", "validation"],
        why: "beats are made of recordings without any model of a heart; lab-files and validation only in tests, benchmarks and examples",
    },
    Rule {
        who: "linalg",
        may: &[],
        why: "one matrix, one Krylov method and one way to talk between ranks for all that is solved on a mesh",
    },
    Rule {
        who: "mesh",
        may: &["vocabulary", "units", "linalg", "input-files"],
        why: "a mesh knows no material, load or task, so any solver can stand on it",
    },
    Rule {
        who: "vector-math",
        may: &[],
        why: "the cell's batches and the organ's groups share one exp and one ln",
    },
    Rule {
        who: "models",
        may: &["vocabulary", "units", "signals", "vector-math"],
        why: "models know no task, queue or file of a patient",
    },
    Rule {
        who: "cell-engine",
        may: &["vocabulary", "units", "vector-math", "models"],
        why: "the kernels know neither organ nor task; the equations, the tableau and the defaults are those of models; units only in tests",
    },
    Rule {
        who: "mechanics",
        may: &["vocabulary", "units", "linalg", "mesh", "models", "signals"],
        why: "a solver of the organ knows no task, queue or file of a patient",
    },
    Rule {
        who: "electrophysiology",
        may: &["units", "linalg", "mesh"],
        why: "potentials need tissue and activation times, no contraction; the eikonal solver alone serves the mechanics",
    },
    Rule {
        who: "calibrate",
        may: &["vocabulary", "models"],
        why: "algorithms meet models by ask and tell or by closures; the calcium fit takes its closed form from models",
    },
    Rule {
        who: "discover",
        may: &["vocabulary", "units", "models", "validation"],
        why: "the search takes arrays and numbers; files stay with who calls it; validation only in examples and tests",
    },
    Rule {
        who: "validation",
        may: &[],
        why: "the heart that judges the search shares no code with the heart that is fitted",
    },
    Rule {
        who: "worker",
        may: &[
            "schemas",
            "protocol",
            "units",
            "signals",
            "linalg",
            "mesh",
            "models",
            "cell-engine",
            "mechanics",
            "electrophysiology",
            "calibrate",
            "discover",
            "validation",
            "input-files",
        ],
        why: "one conversion from a task's spec to solver types per kind; only developers' tools and the package for Python import worker; validation only in an example",
    },
    Rule {
        who: "coordinator",
        may: &[
            "schemas",
            "protocol",
            "units",
            "signals",
            "lab-files",
            "recordings",
            "mesh",
            "models",
            "calibrate",
            "slurm",
            "workflow",
            "input-files",
            "dashboard",
        ],
        why: "keeps books and reaches the world, never simulates: it builds where MPI is absent and stays small; meshes are checked and mended, not computed with; of models it reads the catalogue of effects",
    },
    Rule {
        who: "workflow",
        may: &["schemas", "calibrate"],
        why: "decisions are pure functions, tested without the world",
    },
    Rule {
        who: "slurm",
        may: &["vocabulary"],
        why: "Slurm is data and pure decisions: whoever runs its commands hands in their answers",
    },
    Rule {
        who: "python",
        may: &["schemas", "vocabulary", "cell-engine", "worker"],
        why: "Python calls the worker's conversions and kernels in its own process; what the coordinator does it asks of the programs",
    },
    Rule {
        who: "dashboard",
        may: &["schemas"],
        why: "a web server without database and files: the run comes through a trait, so that nothing but its answers can be served",
    },
    Rule {
        who: "dev",
        may: &[
            "schemas",
            "units",
            "linalg",
            "mesh",
            "models",
            "cell-engine",
            "mechanics",
            "calibrate",
            "worker",
            "coordinator",
            "chromium",
        ],
        why: "measurements and mechanics cases reach everything, and nothing that is installed reaches them",
    },
    Rule {
        who: "tests",
        may: &["schemas", "workflow", "coordinator", "chromium"],
        why: "the system is tested from outside, through its binaries and files",
    },
    Rule {
        who: "chromium",
        may: &[],
        why: "one way to drive a browser, for tests and measurements",
    },
    Rule {
        who: FOR_TESTS,
        may: &[],
        why: "every test tells in one way that a machine cannot run it",
    },
];

/// Rules for rooms of the coordinator, the modules of `coordinator/src/lib.rs`: other rooms and
/// crates of the project that each may import.
pub const ROOMS: &[Rule] = &[
    Rule {
        who: "clock",
        may: &["schemas"],
        why: "one place reads the wall clock; workflow and report get it as an argument",
    },
    Rule {
        who: "dispatch",
        may: &["schemas", "protocol", "clock", "slurm"],
        why: "processes and schedulers are reached in one place, tested without decisions",
    },
    Rule {
        who: "store",
        may: &["schemas", "protocol", "workflow", "clock"],
        why: "SQL in one place",
    },
    Rule {
        who: "input",
        may: &[
            "schemas",
            "signals",
            "lab-files",
            "recordings",
            "mesh",
            "models",
            "units",
            "input-files",
        ],
        why: "`check` needs no engine and no store, looks at meshes with step 0's own function, and at effects with their catalogue",
    },
    Rule {
        who: "results",
        may: &["schemas", "protocol", "units"],
        why: "report, export and comparison read a run alike; records in, numbers out",
    },
    Rule {
        who: "report",
        may: &["schemas", "units", "results"],
        why: "HTML in one place; records in, files out",
    },
    Rule {
        who: "export",
        may: &["schemas", "units", "results"],
        why: "tables in one place; records in, files out",
    },
    Rule {
        who: "sweep",
        may: &["schemas", "calibrate", "results"],
        why: "a sweep's specification to members, outcomes to statistics; running them is the engine's",
    },
    Rule {
        who: "discovery",
        may: &["schemas", "results"],
        why: "findings to cases, pooled evidence, words and the patient's model; running searches is the engine's",
    },
    Rule {
        who: "preparation",
        may: &[
            "schemas",
            "signals",
            "recordings",
            "calibrate",
            "units",
            "input",
        ],
        why: "recordings that were read to a patient's files and words about each step; drawing them is the report's",
    },
    Rule {
        who: "engine",
        may: &[
            "schemas",
            "protocol",
            "workflow",
            "store",
            "dispatch",
            "calibrate",
            "clock",
            "slurm",
            "input-files",
        ],
        why: "observe, decide, commit, act: the only room that sees both decisions and world",
    },
    Rule {
        who: "cli",
        may: &[
            "engine",
            "sweep",
            "discovery",
            "preparation",
            "report",
            "export",
            "results",
            "input",
            "schemas",
            "signals",
            "recordings",
            "mesh",
            "units",
            "calibrate",
            "clock",
            "dashboard",
        ],
        why: "words and tables for people; no SQL among the commands",
    },
];

/// Foreign paths that a folder may not use.
pub struct Refusal {
    /// Folder, from the repository's root.
    pub folder: &'static str,
    /// Paths that the folder's files may not use.
    pub paths: &'static [&'static str],
    /// Purpose of the rule.
    pub why: &'static str,
}

/// Rules for source text. Code under `#[cfg(test)]` is exempt.
pub const REFUSALS: &[Refusal] = &[
    Refusal {
        folder: "solver",
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
        paths: &["sqlx"],
        why: "a worker never opens the database",
    },
    Refusal {
        folder: "coordinator/workflow/src",
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
        folder: "coordinator/src/report",
        paths: &["sqlx", "tokio", "std::net"],
        why: "a report touches neither store nor network",
    },
    Refusal {
        folder: "coordinator/src/export",
        paths: &["sqlx", "tokio", "std::net"],
        why: "an export touches neither store nor network",
    },
    Refusal {
        folder: "coordinator/src/input",
        paths: &["sqlx", "tokio", "std::net"],
        why: "input is files",
    },
    Refusal {
        folder: "coordinator/slurm/src",
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
        folder: "coordinator/dashboard/src",
        paths: &["sqlx", "std::fs", "std::env", "std::process"],
        why: "the server serves what its source answers, and nothing else of this machine",
    },
    Refusal {
        folder: "coordinator/src/dispatch",
        paths: &["sqlx"],
        why: "SQL in one place",
    },
    Refusal {
        folder: "coordinator/src/engine",
        paths: &["sqlx"],
        why: "SQL in one place",
    },
    Refusal {
        folder: "coordinator/src/cli",
        paths: &["sqlx"],
        why: "SQL in one place",
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

/// Both tables as in docs/architecture.md.
pub fn markdown() -> String {
    let mut text = String::new();
    for (title, rules) in [("crate", CRATES), ("room of the coordinator", ROOMS)] {
        text += &format!("| {title} | may import (of ours) | so that |\n|---|---|---|\n");
        for rule in rules {
            let may = if rule.may.is_empty() {
                "nothing".to_owned()
            } else {
                rule.may.join(", ")
            };
            text += &format!("| `{}` | {may} | {} |\n", rule.who, rule.why);
        }
        text.push('\n');
    }
    text
}
