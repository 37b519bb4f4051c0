//! Classes of a run's files by their purpose, which decides how long they are kept. Pure functions.

use std::collections::HashSet;
use std::path::{Component, Path};

use cardiotwin_protocol::names;
use serde::Serialize;

/// Purpose of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// The run's database with its snapshot and log.
    Database,
    /// Provenance: what was requested, which process did it, how it ended.
    Record,
    /// Computed results, which a rerun, the report and later tasks read.
    Results,
    /// Scripts and logs of a cluster's jobs.
    Jobs,
    /// The report, the patients' models, and tables.
    Report,
    /// Series of VTU files, which are made on request and read by no later task.
    Series,
    /// Checkpoints and working folders.
    Scratch,
    /// Files in a folder of the run that the program did not write.
    Unknown,
}

impl Class {
    /// All classes, in the order of tables.
    pub const ALL: [Self; 8] = [
        Self::Database,
        Self::Record,
        Self::Results,
        Self::Jobs,
        Self::Report,
        Self::Series,
        Self::Scratch,
        Self::Unknown,
    ];

    /// Name of the class in tables.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Database => "database",
            Self::Record => "record",
            Self::Results => "results",
            Self::Jobs => "jobs",
            Self::Report => "report",
            Self::Series => "series",
            Self::Scratch => "scratch",
            Self::Unknown => "unknown",
        }
    }

    /// Purpose of the class, and how long its files are kept.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Database => "database and records of the run; kept",
            Self::Record => "specification, provenance and outcome; kept",
            Self::Results => "traces, fits and meshes, read by reruns and the report; kept",
            Self::Jobs => "scripts and logs of a cluster's jobs; kept",
            Self::Report => "report, models, exported tables; kept",
            Self::Series => "VTU series; `clean --series` removes them",
            Self::Scratch => {
                "checkpoints and working folders; `clean` removes those of finished and aborted tasks"
            }
            Self::Unknown => "foreign files; never touched",
        }
    }
}

/// State of an attempt's task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Retention {
    /// The database has no such task.
    Foreign,
    /// The attempt is not over, so a worker may be using its files.
    InUse,
    /// The attempt is over, but its task has no result yet: the next attempt continues from its
    /// checkpoints.
    Unsettled,
    /// The attempt is over without a result, and no patient needs its task any more.
    Aborted,
    /// The task has a result.
    Settled,
}

/// Files of an attempt that are its record.
const RECORD: [&str; 10] = [
    names::SPEC,
    names::CLAIM,
    names::OUTCOME,
    names::ALLOCATION,
    names::FORMER_FENCE,
    names::LOG,
    names::PROGRESS,
    "rank-failure.json",
    "external/external.log",
    "external/parameters.json",
];

/// Class of a file of an attempt.
///
/// - `file`: path relative to the attempt's directory
/// - `artefacts`: files that the attempt's outcome names
#[must_use]
pub fn of_attempt(file: &Path, artefacts: &HashSet<String>) -> Class {
    let name = file.to_string_lossy();
    match first(file) {
        "vtu" => Class::Series,
        _ if RECORD.contains(&&*name) || name == "external/parameters.toml" => Class::Record,
        _ if artefacts.contains(&*name) => Class::Results,
        _ => Class::Scratch,
    }
}

/// Class of a file of a run outside of attempts; `file` is relative to the run's folder.
#[must_use]
pub fn of_run(file: &Path) -> Class {
    let name = file.to_string_lossy();
    match first(file) {
        "slurm" => Class::Jobs,
        "models" | "results" | "tables" | "export" | "report-patients" => Class::Report,
        "lease" | "notices" | "requests" => Class::Record,
        "coordinator.lock" | "sweep.json" => Class::Record,
        "report.html" | "discover.json" => Class::Report,
        _ if name.starts_with("cardiotwin.") => Class::Database,
        _ => Class::Unknown,
    }
}

fn first(file: &Path) -> &str {
    match file.components().next() {
        Some(Component::Normal(name)) => name.to_str().unwrap_or_default(),
        _ => "",
    }
}

/// Whether `clean` may remove a file of an attempt.
#[must_use]
pub fn is_removable(class: Class, standing: Retention, with_series: bool) -> bool {
    matches!(standing, Retention::Settled | Retention::Aborted)
        && (class == Class::Scratch || (with_series && class == Class::Series))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn files_are_known_by_their_names() {
        let artefacts = HashSet::from(["traces.csv".to_owned(), "vtu/beat.pvd".to_owned()]);
        for (file, class) in [
            ("spec.json", Class::Record),
            ("traces.csv", Class::Results),
            ("nodal.csv", Class::Scratch),
            ("checkpoint/beat.bin", Class::Scratch),
            ("vtu/beat.pvd", Class::Series),
            ("external/external.log", Class::Record),
            ("external/traces.csv", Class::Scratch),
        ] {
            assert_eq!(of_attempt(Path::new(file), &artefacts), class, "{file}");
        }
        for (file, class) in [
            ("cardiotwin.db-wal", Class::Database),
            ("slurm/ct-1/job.sh", Class::Jobs),
            ("report.html", Class::Report),
            ("report-patients/01-CoA.html", Class::Report),
            ("export/traces.csv", Class::Report),
            ("sweep.json", Class::Record),
            ("notes.txt", Class::Unknown),
        ] {
            assert_eq!(of_run(Path::new(file)), class, "{file}");
        }
    }

    proptest! {
        /// Whatever an attempt left and whatever the state of its task: records, results and
        /// checkpoints that a next attempt needs stay.
        #[test]
        fn nothing_is_removed_that_somebody_needs(
            names in proptest::collection::vec("(checkpoint/|external/|vtu/|)[a-z]{1,6}(\\.csv|\\.json|\\.bin|)", 0..12),
            named in proptest::collection::vec(any::<bool>(), 12),
            standing in prop_oneof![Just(Retention::Foreign), Just(Retention::InUse), Just(Retention::Unsettled), Just(Retention::Aborted), Just(Retention::Settled)],
            with_series in any::<bool>(),
        ) {
            let artefacts: HashSet<String> =
                names.iter().zip(&named).filter(|(name, named)| **named && !name.starts_with("vtu/")).map(|(name, _)| name.clone()).collect();
            for name in names.iter().map(String::as_str).chain(RECORD) {
                let class = of_attempt(Path::new(name), &artefacts);
                let removed = is_removable(class, standing, with_series);
                prop_assert!(!(removed && (artefacts.contains(name) || RECORD.contains(&name))), "{name} was needed");
                prop_assert!(!(removed && [Retention::Foreign, Retention::InUse, Retention::Unsettled].contains(&standing)), "{name} of {standing:?}");
                prop_assert!(!(removed && name.starts_with("vtu/") && !with_series), "{name} was not asked for");
            }
        }
    }
}
