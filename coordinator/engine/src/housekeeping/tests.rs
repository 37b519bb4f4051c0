//! Random histories on disk: whatever is run, killed, requested, cleaned, archived and purged, in
//! any order, no file is lost that a rerun, the report or provenance needs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::{RunRecord, TaskRecord};
use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::tests::{Bench, personalised};
use crate::{Reader, Stage, cancel, rerun, retry};

/// An event in the history of a run.
#[derive(Debug, Clone)]
enum Happening {
    /// A coordinator that loses this number of attempts, and simulations that diverge above this
    /// peak stress.
    Run {
        lost: u32,
        diverges_above_kpa: Option<u8>,
    },
    /// Step 1 is rerun with another damping.
    Rerun {
        patient: usize,
        damping_percent: u8,
    },
    Retry {
        patient: usize,
    },
    Cancel {
        patient: usize,
    },
    Clean {
        with_series: bool,
    },
    Archive {
        with_series: bool,
    },
    /// A scratch file system that empties itself: one file in `every` below the attempts is
    /// removed.
    Purge {
        every: usize,
    },
}

fn happening() -> impl Strategy<Value = Happening> {
    prop_oneof![
        4 => (0u32..4, proptest::option::of(100u8..200))
            .prop_map(|(lost, diverges_above_kpa)| Happening::Run { lost, diverges_above_kpa }),
        2 => (0usize..2, 30u8..100).prop_map(|(patient, damping_percent)| Happening::Rerun { patient, damping_percent }),
        1 => (0usize..2).prop_map(|patient| Happening::Retry { patient }),
        1 => (0usize..2).prop_map(|patient| Happening::Cancel { patient }),
        3 => any::<bool>().prop_map(|with_series| Happening::Clean { with_series }),
        1 => any::<bool>().prop_map(|with_series| Happening::Archive { with_series }),
        1 => (1usize..4).prop_map(|every| Happening::Purge { every }),
    ]
}

const PATIENTS: [&str; 2] = ["P1", "P2"];

fn layer(value: serde_json::Value) -> SettingsLayer {
    serde_json::from_value(value).unwrap()
}

/// All files below a folder with the hashes of their contents.
fn contents(folder: &Path) -> BTreeMap<PathBuf, String> {
    let mut files = Vec::new();
    walk(folder, folder, &mut files).unwrap();
    let read = |(file, _): (PathBuf, u64)| match fs::read(folder.join(&file)) {
        Ok(bytes) => Some((file, sha256_hex(&bytes))),
        // SQLite removes its log when the last connection is closed, a moment after the end of the
        // run.
        Err(_) if file.to_string_lossy().starts_with("cardiotwin.db-") => None,
        Err(error) => panic!("{}: {error}", file.display()),
    };
    files.into_iter().filter_map(read).collect()
}

/// Files named by the record, which the report, the export and later tasks read. They are collected
/// independently of `classes`.
fn named(record: &RunRecord) -> Vec<(PathBuf, String)> {
    fn of<T>(task: Option<&TaskRecord<T>>) -> Vec<(PathBuf, String)> {
        let files = task.into_iter().flat_map(|task| {
            task.artefacts
                .iter()
                .map(|artefact| (task.directory.join(&artefact.file), artefact.sha256.clone()))
        });
        files.collect()
    }
    let mut files = Vec::new();
    for patient in &record.patients {
        files.extend(of(patient.step0.as_ref()));
        for iteration in &patient.iterations {
            files.extend(of(iteration.proposal.as_ref()));
            files.extend(of(iteration.run.as_ref()));
        }
        files.extend(of(patient.targets.as_ref()));
        files.extend(of(patient.cell_fit.as_ref()));
        files.extend(of(patient.verification.as_ref()));
    }
    files
}

/// Files that must remain after `clean`, and must be in an archive: those that existed before and
/// may still be needed.
fn needed(
    before: &BTreeMap<PathBuf, String>,
    settled: &[String],
    with_series: bool,
) -> Vec<PathBuf> {
    let is_needed = |file: &Path| {
        let mut parts = file
            .components()
            .map(|part| part.as_os_str().to_string_lossy().into_owned());
        if parts.next().as_deref() != Some("attempts") {
            return true;
        }
        let attempt = parts.nth(1).unwrap_or_default();
        let inside: PathBuf = parts.collect();
        let scratch = inside.starts_with("checkpoint") || inside == Path::new("nodal.csv.part");
        let series = inside.starts_with("vtu");
        let is_settled = settled.iter().any(|key| attempt.starts_with(key.as_str()));
        // A task that a patient needs continues from its checkpoints.
        !is_settled || !(scratch || (series && with_series))
    };
    before
        .keys()
        .filter(|file| is_needed(file))
        .cloned()
        .collect()
}

/// First 16 digits of the keys of the tasks that have a result in the database, or that no patient
/// who is not done has in its chain.
async fn settled(run_dir: &Path) -> Vec<String> {
    let loaded = Writer::look(run_dir).await.unwrap();
    let unfinished = loaded
        .patients
        .iter()
        .filter(|(row, _, _)| row.state != Patient::Done);
    let needed: Vec<&str> = unfinished
        .filter_map(|(row, _, _)| loaded.steps.get(&row.id))
        .flat_map(|steps| steps.values().map(TaskKey::as_str))
        .collect();
    let tasks = loaded.tasks.iter().filter(|task| {
        matches!(task.state, Task::Published { .. }) || !needed.contains(&task.key.as_str())
    });
    tasks.map(|task| task.key[..16].to_owned()).collect()
}

async fn live(history: Vec<Happening>) {
    let bench = Bench::new(vec![
        personalised(PATIENTS[0], 8.0),
        personalised(PATIENTS[1], 9.0),
    ]);
    let run_dir = bench.path().to_owned();
    bench.leaves_files();
    bench.run().await;
    let own = run_dir.join("notes of mine.txt");
    fs::write(&own, "mine").unwrap();
    let mut purged = false;
    for (n, happening) in history.iter().enumerate() {
        let before = contents(&run_dir);
        match happening {
            Happening::Run {
                lost,
                diverges_above_kpa,
            } => {
                bench.may_fail(*lost, diverges_above_kpa.map(f64::from));
                bench.run().await;
            }
            Happening::Rerun {
                patient,
                damping_percent,
            } => {
                let settings =
                    layer(json!({ "step1": { "damping": f64::from(*damping_percent) / 100.0 } }));
                rerun(
                    &run_dir,
                    &PatientId::from(PATIENTS[*patient]),
                    Stage::Step1,
                    &settings,
                )
                .await
                .unwrap();
            }
            // Refused if nothing failed; then nothing has happened.
            Happening::Retry { patient } => {
                drop(retry(&run_dir, &PatientId::from(PATIENTS[*patient])).await)
            }
            Happening::Cancel { patient } => {
                drop(cancel(&run_dir, Some(&PatientId::from(PATIENTS[*patient]))).await);
            }
            Happening::Clean { with_series } => {
                let settled = settled(&run_dir).await;
                let said = clean(&run_dir, *with_series, true).await.unwrap();
                let done = clean(&run_dir, *with_series, false).await.unwrap();
                assert_eq!(said, done, "a dry run says what is done");
                let after = contents(&run_dir);
                for file in needed(&before, &settled, *with_series) {
                    // Lock and lease name their last holder, and the database's files belong to
                    // SQLite.
                    let name = file.to_string_lossy();
                    let is_of_holders = name == "coordinator.lock" || file.starts_with("lease");
                    if !name.starts_with("cardiotwin.db") && !is_of_holders {
                        assert_eq!(
                            after.get(&file),
                            before.get(&file),
                            "clean took {} after {:?}",
                            file.display(),
                            &history[..=n]
                        );
                    }
                }
                assert!(
                    clean(&run_dir, *with_series, true)
                        .await
                        .unwrap()
                        .files
                        .is_empty(),
                    "clean leaves nothing to clean"
                );
            }
            Happening::Archive { with_series } => {
                archived(&bench, &before, *with_series, n, purged).await
            }
            Happening::Purge { every } => {
                purged = true;
                for (file, _) in before
                    .iter()
                    .filter(|(file, _)| file.starts_with("attempts"))
                    .step_by(*every)
                {
                    fs::remove_file(run_dir.join(file)).unwrap();
                }
            }
        }
        assert_eq!(
            fs::read_to_string(&own).unwrap(),
            "mine",
            "what is not ours is never touched"
        );
        if !purged {
            let record = Reader::open(&run_dir)
                .await
                .unwrap()
                .record()
                .await
                .unwrap();
            for (file, hash) in named(&record) {
                let found = fs::read(&file).unwrap_or_else(|e| {
                    panic!("{} after {:?}: {e}", file.display(), &history[..=n])
                });
                assert_eq!(sha256_hex(&found), hash, "{}", file.display());
            }
        }
    }
    // Tasks with a result are not computed again, whatever was cleaned, and every patient can be
    // finished.
    bench.may_fail(0, None);
    for patient in PATIENTS {
        drop(retry(&run_dir, &PatientId::from(patient)).await);
    }
    let (last, _) = bench.run().await;
    assert_eq!((last.done, last.unfinished), (2, 0), "after {history:?}");
    clean(&run_dir, true, false).await.unwrap();
    let (again, submitted) = bench.run().await;
    assert!(
        again.nothing_to_do() && submitted.is_empty(),
        "{submitted:?} again after {history:?}"
    );
}

#[tokio::test]
async fn checkpoints_of_a_failed_simulation_go_once_its_patient_is_done() {
    let bench = Bench::new(vec![personalised(PATIENTS[0], 8.0)]);
    bench.leaves_files();
    bench.may_fail(0, Some(150.0));
    let (summary, _) = bench.run().await;
    let record = Reader::open(bench.path()).await.unwrap();
    let record = record.record().await.unwrap();
    let failed = (record.patients[0].iterations.iter()).find(|i| i.failure.is_some());
    assert!(failed.is_some() && summary.done == 1, "{summary:?}");
    let books = Writer::look(bench.path()).await.unwrap();
    let aborted: Vec<String> = (books.tasks.iter())
        .filter(|task| matches!(task.state, Task::Failed { .. }))
        .map(|task| task.key[..16].to_owned())
        .collect();
    let cleaned = clean(bench.path(), false, false).await.unwrap();
    let is_of = |file: &PathBuf| {
        aborted
            .iter()
            .any(|key| file.to_string_lossy().contains(key))
    };
    assert!(cleaned.files.iter().any(is_of), "{aborted:?}: {cleaned:?}");
}

/// An archive holds every file that is needed, agrees with its own list, and is a run that reads
/// the same as the first.
async fn archived(
    bench: &Bench,
    before: &BTreeMap<PathBuf, String>,
    with_series: bool,
    n: usize,
    purged: bool,
) {
    let run_dir = bench.path();
    let elsewhere = tempfile::tempdir().unwrap();
    let target = elsewhere.path().join(format!("copy-{n}"));
    let settled = settled(run_dir).await;
    archive(run_dir, &target, with_series).await.unwrap();
    let copied = contents(&target);
    // `archive` leaves scratch behind, and series as well unless they are requested.
    for file in needed(before, &settled, !with_series) {
        let is_ours_alone = file.starts_with("lease") || file == Path::new("coordinator.lock");
        if !file.to_string_lossy().starts_with("cardiotwin.") && !is_ours_alone {
            assert_eq!(
                copied.get(&file),
                before.get(&file),
                "the archive lacks {}",
                file.display()
            );
        }
    }
    let listed = fs::read_to_string(target.join(MANIFEST)).unwrap();
    for line in listed.lines() {
        let (hash, file) = line.split_once("  ").unwrap();
        assert_eq!(copied[Path::new(file)], hash, "{file}");
    }
    assert_eq!(
        listed.lines().count() + 1,
        copied.len(),
        "every file of the archive is listed, but the list"
    );
    let of = |record: RunRecord| -> Vec<_> {
        record
            .patients
            .into_iter()
            .map(|p| {
                (
                    p.status.patient,
                    p.status.state,
                    p.step1,
                    p.verification_cost,
                )
            })
            .collect()
    };
    let first = of(Reader::open(run_dir).await.unwrap().record().await.unwrap());
    let copy = Reader::open(&target).await.unwrap().record().await.unwrap();
    if !purged {
        assert!(
            named(&copy)
                .iter()
                .all(|(file, _)| file.starts_with(&target) && file.is_file()),
            "it stands by itself"
        );
    }
    assert_eq!(of(copy), first);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, max_shrink_iters: 60, ..ProptestConfig::default() })]
    #[test]
    fn clean_and_archive_never_remove_what_is_needed(history in proptest::collection::vec(happening(), 1..9)) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(live(history));
    }
}

#[tokio::test]
async fn a_purged_file_is_made_again_only_where_somebody_reads_it() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.leaves_files();
    bench.refuses(Some("targets"));
    let (summary, submitted) = bench.run().await;
    assert_eq!(
        (summary.failed, submitted.last()),
        (1, Some(&"targets")),
        "step 1 is done, the targets are not"
    );
    let best = |record: cardiotwin_schemas::record::PatientRecord| {
        let k = record.step1.as_ref().unwrap().best_iteration as usize;
        record.iterations[k - 1].run.clone().unwrap()
    };
    let before = best(bench.patient("P1").await);
    fs::remove_dir_all(bench.path().join("attempts")).unwrap();
    retry(bench.path(), &PatientId::from("P1")).await.unwrap();
    bench.refuses(None);
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 1);
    // The beat whose traces the targets read is computed again; neither step 0 nor the other
    // iterations are.
    assert_eq!(
        submitted,
        [
            "organ-beat",
            "targets",
            "cell-fit",
            "organ-beat",
            "posterior"
        ]
    );
    let after = best(bench.patient("P1").await);
    assert_eq!(
        (&after.key, after.generation),
        (&before.key, before.generation + 1)
    );

    fs::remove_dir_all(bench.path().join("attempts")).unwrap();
    let (again, submitted) = bench.run().await;
    assert!(
        again.nothing_to_do() && submitted.is_empty(),
        "nobody reads them any more: {submitted:?}"
    );
}
