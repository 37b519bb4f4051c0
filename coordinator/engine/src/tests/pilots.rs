//! Pilots who teach the organ's law of the other patients of a run.

use std::collections::BTreeMap;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::status::{PatientState, Status};

use super::*;

/// A patient with a ventricle in 3D, in a cohort with so many pilots.
pub fn in_3d(id: &str, edp_mmhg: f64, n_pilots: u32) -> ResolvedPatient {
    let mut patient = personalised(id, edp_mmhg);
    patient.settings.solver.fidelity = Fidelity::FiniteElement;
    patient.settings.workflow.pilots = n_pilots;
    patient
}

/// Patients P1, P2, … with so many pilots.
pub fn cohort(n: u32, n_pilots: u32) -> Vec<ResolvedPatient> {
    let of = |k: u32| in_3d(&format!("P{k}"), 7.0 + f64::from(k), n_pilots);
    (1..=n).map(of).collect()
}

fn bench(patients: Vec<ResolvedPatient>) -> Bench {
    let bench = Bench::new(patients);
    bench.script(|s| s.nodes = Some(100));
    bench
}

/// Present tasks of all patients, by step.
pub async fn keys(reader: &Reader) -> BTreeMap<String, Vec<(String, TaskKey)>> {
    let mut all = BTreeMap::new();
    for patient in reader.status().await.unwrap().patients {
        let steps = reader.explain(&patient.patient.as_str().into()).await;
        let steps = steps.unwrap().into_iter().map(|s| (s.step, s.task));
        all.insert(patient.patient, steps.collect());
    }
    all
}

async fn status(bench: &Bench) -> Status {
    bench.reader().await.status().await.unwrap()
}

/// State and note of a patient.
fn standing(status: &Status, id: &str) -> (PatientState, String) {
    let patient = status.patients.iter().find(|p| p.patient == id).unwrap();
    (patient.state, patient.note.clone())
}

fn n_of(submitted: &[&str], kind: &str) -> usize {
    submitted.iter().filter(|one| **one == kind).count()
}

#[tokio::test]
async fn the_others_wait_after_step0_and_start_from_the_pilots_law() {
    let bench = bench(cohort(5, 2));
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, summary.held), (5, 0), "{submitted:?}");
    let first = submitted.iter().position(|k| *k == "learn-law").unwrap();
    assert_eq!(n_of(&submitted, "passive-state"), 5, "{submitted:?}");
    assert_eq!(n_of(&submitted[..first], "posterior"), 2, "{submitted:?}");
    assert_eq!(n_of(&submitted, "learn-law"), 3);

    let (pilot, pupil) = (bench.patient("P1").await, bench.patient("P3").await);
    assert!(pilot.law.is_none());
    let law = pupil.law.as_ref().unwrap();
    let organs = law.result.organs.iter();
    let names: Vec<&str> = organs.map(|organ| organ.patient.as_str()).collect();
    assert_eq!(names, ["P1", "P2"]);
    // All 3D beats of the pilots teach, the verification beat among them.
    let taught = &law.result.organs[0].beats;
    assert_eq!(
        taught.len(),
        pilot.iterations.len() + 1 + pilot.step3_iterations.len()
    );
    assert_eq!(pilot.start_of_the_law().unwrap(), "of the program");
    assert!(
        pupil
            .start_of_the_law()
            .unwrap()
            .starts_with("pilots P1, P2 (2 organs and "),
        "{:?}",
        pupil.start_of_the_law()
    );
    let learned = status(&bench).await.learned.unwrap();
    assert_eq!(learned.organs, ["P1", "P2"]);
    assert_eq!(learned.pressure_error_after_mmhg, Some(0.75));
    // All others start from the same file.
    let file = |record: &PatientRecord| record.law.as_ref().unwrap().artefacts[0].sha256.clone();
    assert_eq!(file(&pupil), file(&bench.patient("P5").await));
    assert!(bench.run().await.0.nothing_to_do());

    // Every patient by itself has the keys of a cohort without the setting.
    let alone = super::pilots::bench(cohort(5, 0));
    alone.run().await;
    let (with, without) = (
        keys(&bench.reader().await).await,
        keys(&alone.reader().await).await,
    );
    assert_eq!(with["P1"], without["P1"]);
    assert_eq!(with["P5"][0], without["P5"][0], "step 0");
    assert_ne!(with["P5"].last(), without["P5"].last());
}

#[tokio::test]
async fn order_and_number_of_workers_and_kills_make_no_difference() {
    let whole = bench(cohort(4, 2));
    assert_eq!(whole.run().await.0.done, 4);
    let expected = keys(&whole.reader().await).await;

    let mut shuffled = cohort(4, 2);
    shuffled.reverse();
    shuffled.swap(0, 2);
    let shuffled = bench(shuffled);
    shuffled.script(|s| s.workers = Some(1));
    assert_eq!(shuffled.run().await.0.done, 4);
    assert_eq!(keys(&shuffled.reader().await).await, expected);

    // Killed again and again, and so before, between and after the ends of the pilots.
    let mut killed = bench(cohort(4, 2));
    let mut kills = 0;
    loop {
        killed.crash = crash::CrashPoints::ending_at(10 + kills / 4 + kills % 3);
        let patients = Some(killed.patients.clone());
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        match killed
            .driven(patients, None, events, StopSignal::new())
            .await
        {
            Err(EngineError::Crashed { .. }) => kills += 1,
            summary => {
                assert_eq!(summary.unwrap().done, 4);
                break;
            }
        }
        assert!(kills < 1000, "no progress");
    }
    assert!(kills > 10, "{kills}");
    assert_eq!(keys(&killed.reader().await).await, expected);
}

#[tokio::test]
async fn a_pilot_that_fails_for_its_data_or_the_model_holds_nobody() {
    for class in [FailureClass::Input, FailureClass::Numerics] {
        let bench = bench(cohort(4, 2));
        bench.script(|s| s.fails_step0 = Some((8.0, class)));
        let (summary, _) = bench.run().await;
        assert_eq!((summary.done, summary.failed, summary.held), (3, 1, 0));
        let law = bench.patient("P3").await.law.unwrap();
        let organs = law.result.organs.iter();
        let names: Vec<&str> = organs.map(|organ| organ.patient.as_str()).collect();
        assert_eq!(names, ["P2"], "{class:?}");
    }
    // Without any beat the law stays as it is.
    let bench = bench(cohort(2, 1));
    bench.script(|s| s.fails_step0 = Some((8.0, FailureClass::Input)));
    assert_eq!(bench.run().await.0.done, 1);
    let start = bench.patient("P2").await.start_of_the_law().unwrap();
    assert_eq!(start, "the pilots made no beat that teaches");
}

#[tokio::test]
async fn a_lost_pilot_holds_the_others_until_it_is_retried() {
    let bench = bench(cohort(3, 1));
    bench.script(|s| s.fails_step0 = Some((8.0, FailureClass::Site)));
    let (summary, submitted) = bench.run().await;
    assert_eq!(
        (summary.failed, summary.unfinished, summary.held),
        (1, 2, 2)
    );
    assert_eq!(n_of(&submitted, "organ-beat"), 0, "{submitted:?}");
    let held = status(&bench).await;
    let note = "waits for pilot P1: P1 failed; `retry P1`, or `run --set workflow.pilots=0`";
    assert_eq!(standing(&held, "P2"), (PatientState::Waiting, note.into()));
    assert!(held.learned.is_none() && bench.patient("P2").await.start_of_the_law().is_none());

    bench.script(|s| s.fails_step0 = None);
    retry(bench.path(), &"P1".into()).await.unwrap();
    let waits = standing(&status(&bench).await, "P2").1;
    assert_eq!(waits, "waits for pilot P1", "the retry is a pilot at work");
    let (summary, _) = bench.run().await;
    assert_eq!((summary.done, summary.held), (3, 0));
}

#[tokio::test]
async fn a_cancelled_pilot_holds_the_others_and_without_pilots_they_go_on() {
    let mut bench = bench(cohort(3, 1));
    bench.script(|s| s.silent_on = Some("posterior"));
    // The pilot hangs in its last task, and a person cancels it.
    let stop = StopSignal::new();
    let (path, asked) = (bench.path().to_owned(), stop.clone());
    let person = async move {
        loop {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
            let Ok(reader) = Reader::open(&path).await else {
                continue;
            };
            let status = reader.status().await.unwrap();
            if status.patients.iter().any(|p| p.step == "posterior") {
                break;
            }
        }
        asked.ask();
        asked.ask();
    };
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    let ((summary, _), ()) = tokio::join!(bench.run_with(events, stop), person);
    assert_eq!((summary.done, summary.unfinished), (0, 3));
    bench.script(|s| s.silent_on = None);
    cancel(bench.path(), Some(&"P1".into())).await.unwrap();
    let note = "waits for pilot P1: P1 was cancelled; `retry P1`, or `run --set workflow.pilots=0`";
    assert_eq!(standing(&status(&bench).await, "P3").1, note);
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.cancelled, summary.held), (1, 2), "{submitted:?}");

    bench.patients = cohort(3, 0);
    let (summary, submitted) = bench.run().await;
    // Changed settings of a cancelled patient make it continue, too.
    assert_eq!((summary.done, summary.held), (3, 0));
    assert_eq!(n_of(&submitted, "learn-law"), 0);
    // With pilots again, the others learn from what the pilot has done by itself.
    bench.patients = cohort(3, 1);
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, summary.held), (3, 0));
    assert_eq!(n_of(&submitted, "learn-law"), 2);
    assert_eq!(n_of(&submitted, "passive-state"), 0);
}

#[tokio::test]
async fn a_patient_who_is_added_later_changes_no_pilot_and_repeats_nothing() {
    let mut bench = bench(cohort(3, 2));
    assert_eq!(bench.run().await.0.done, 3);
    let before = keys(&bench.reader().await).await;
    bench.patients.insert(0, in_3d("A0", 12.0, 2));
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 4);
    assert_eq!(n_of(&submitted, "passive-state"), 1, "{submitted:?}");
    assert_eq!(n_of(&submitted, "learn-law"), 1, "{submitted:?}");
    let mut after = keys(&bench.reader().await).await;
    assert!(after.remove("A0").is_some());
    assert_eq!(after, before);
    // A pilot that leaves the cohort has taught.
    bench.patients.retain(|patient| patient.id.as_str() != "P1");
    let (summary, submitted) = bench.run().await;
    assert!(
        summary.nothing_to_do() && submitted.is_empty(),
        "{submitted:?}"
    );
}

#[tokio::test]
async fn changed_data_of_a_pilot_teach_anew_and_a_rerun_of_a_pilot_does_not() {
    let mut bench = bench(cohort(3, 1));
    assert_eq!(bench.run().await.0.done, 3);
    let before = keys(&bench.reader().await).await;
    let overrides = layer(json!({ "step1": { "damping": 0.5 } }));
    rerun(bench.path(), &"P1".into(), Stage::Step1, &overrides)
        .await
        .unwrap();
    assert_eq!(bench.run().await.0.done, 3);
    let after = keys(&bench.reader().await).await;
    assert_eq!(after["P3"], before["P3"]);

    bench.patients[0].step0.end_diastolic_pressure_mmhg = Some(8.5);
    let foreseen = foresee(bench.path(), &bench.patients).await.unwrap();
    let learns = Foreseen::Redone(Step::only(Stage::LearnLaw));
    assert_eq!(foreseen[&"P3".into()], learns, "{foreseen:?}");
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 3);
    assert_eq!(n_of(&submitted, "passive-state"), 1, "{submitted:?}");
    assert_eq!(n_of(&submitted, "learn-law"), 2, "{submitted:?}");
    let after = keys(&bench.reader().await).await;
    assert_ne!(after["P3"].last(), before["P3"].last());
    assert!(bench.run().await.0.nothing_to_do());

    // More pilots are chosen again.
    bench.patients = cohort(3, 2);
    bench.patients[0].step0.end_diastolic_pressure_mmhg = Some(8.5);
    assert_eq!(bench.run().await.0.done, 3);
    assert_eq!(
        bench.patient("P3").await.law.unwrap().result.organs.len(),
        2
    );
    assert!(bench.patient("P2").await.law.is_none());
}

/// A cohort whose patients are not in 3D, or do not use the law, has no pilots.
#[tokio::test]
async fn only_patients_with_the_organs_law_teach_and_learn() {
    let mut patients = cohort(4, 1);
    patients[0].settings.solver.fidelity = Fidelity::Reduced;
    patients[1].settings.workflow.surrogate = Surrogate::OneFibre;
    let bench = bench(patients);
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, n_of(&submitted, "learn-law")), (4, 1));
    let law = bench.patient("P4").await.law.unwrap();
    assert_eq!(law.result.organs[0].patient, "P3");
    assert!(bench.patient("P1").await.start_of_the_law().is_none());
}
