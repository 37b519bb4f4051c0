//! The local loop with scripted results: the whole chain, failures of each class, changed settings,
//! requests.

pub(super) mod another_build;
mod lost_workers;
pub(super) mod pilots;
pub(super) mod scripted;

use std::path::Path;
use std::sync::{Arc, Mutex};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::record::{PatientRecord, Step1Quality, Step3Ending};
use cardiotwin_schemas::settings::{ExecutorSettings, Fidelity, LastStep, Surrogate, Update};
use cardiotwin_schemas::sweep::{CellDesign, SweptParameter};
use cardiotwin_schemas::task::{CellSweepSpec, TaskSpec};
use serde_json::json;

use super::*;
use scripted::{Script, Scripted};

pub(super) struct Bench {
    dir: tempfile::TempDir,
    script: Arc<Mutex<Script>>,
    patients: Vec<ResolvedPatient>,
    clock: clock::Clock,
    /// Points at which the coordinator dies.
    crash: crash::CrashPoints,
}

pub(super) fn personalised(id: &str, edp_mmhg: f64) -> ResolvedPatient {
    let mut patient = ResolvedPatient::noop(id, 0);
    patient.workflow = Workflow::Personalise;
    patient.step0.end_diastolic_pressure_mmhg = Some(edp_mmhg);
    patient.settings.step1.tolerance = 1e-3;
    // The fixed point converges with the scripted results.
    patient.settings.solver.fidelity = Fidelity::Reduced;
    patient
}

impl Bench {
    pub(super) fn new(patients: Vec<ResolvedPatient>) -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
            script: Arc::default(),
            patients,
            clock: clock::Clock::Wall,
            crash: crash::CrashPoints::default(),
        }
    }

    pub(super) fn path(&self) -> &Path {
        self.dir.path()
    }

    pub fn script(&self, change: impl FnOnce(&mut Script)) {
        change(&mut self.script.lock().unwrap());
    }

    /// Makes attempts leave files from now on.
    pub(super) fn leaves_files(&self) {
        self.script(|s| s.leaves_files = true);
    }

    /// Loses this number of attempts, and lets simulations with a larger peak stress diverge.
    pub(super) fn may_fail(&self, lost: u32, diverges_above_kpa: Option<f64>) {
        self.script(|s| (s.lost_attempts, s.diverges_above_kpa) = (lost, diverges_above_kpa));
    }

    /// Makes tasks of this kind fail with wrong input.
    pub(super) fn refuses(&self, kind: Option<&'static str>) {
        self.script(|s| s.refuses = kind);
    }

    /// Runs the patients. Returns the kinds of the submitted tasks as well.
    pub(super) async fn run(&self) -> (RunSummary, Vec<&'static str>) {
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        self.run_with(events, StopSignal::new()).await
    }

    async fn run_with(
        &self,
        events: EventSender,
        stop: StopSignal,
    ) -> (RunSummary, Vec<&'static str>) {
        let patients = Some(self.patients.clone());
        let summary = self.driven(patients, None, events, stop).await.unwrap();
        (summary, self.script.lock().unwrap().submitted.clone())
    }

    /// Continues with the stored plans and a worker. Returns the kinds of the submitted tasks.
    async fn resume(&self, worker: Option<&Path>) -> Result<Vec<&'static str>, EngineError> {
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        self.driven(None, worker, events, StopSignal::new()).await?;
        Ok(self.script.lock().unwrap().submitted.clone())
    }

    async fn driven(
        &self,
        patients: Option<Vec<ResolvedPatient>>,
        worker: Option<&Path>,
        events: EventSender,
        stop: StopSignal,
    ) -> Result<RunSummary, EngineError> {
        let options = RunOptions {
            run_dir: self.path().to_owned(),
            chosen: None,
            cohort_name: "test".into(),
            description: String::new(),
            cohort_dir: self.path().to_owned(),
            patients,
            refused: Vec::new(),
            recognised: Default::default(),
            only: vec![],
            executor: ExecutorSettings::default(),
            worker: None,
            adopt_version: false,
            watch: false,
        };
        self.script(|s| s.submitted.clear());
        let (_lock, run_dir) = enter(self.path()).unwrap();
        let executor = Scripted::new(&self.script);
        let surroundings = Surroundings {
            clock: self.clock.clone(),
            crash: self.crash.clone(),
        };
        drive(
            options,
            &run_dir,
            worker,
            executor,
            surroundings,
            events,
            stop,
        )
        .await
    }

    pub(super) async fn reader(&self) -> Reader {
        Reader::open(self.path()).await.unwrap()
    }

    pub(super) async fn patient(&self, id: &str) -> PatientRecord {
        self.reader()
            .await
            .patient_record(&PatientId::from(id))
            .await
            .unwrap()
    }

    fn overlay(&self, id: &str, file: &str) -> ModelOverlay {
        toml::from_str(
            &std::fs::read_to_string(self.path().join("models").join(id).join(file)).unwrap(),
        )
        .unwrap()
    }
}

#[tokio::test]
async fn a_beat_on_a_large_mesh_takes_all_cores_and_nothing_runs_beside_it() {
    let cores = std::thread::available_parallelism().unwrap().get();
    for (nodes, threads) in [(8000, cores as u32), (7999, 1)] {
        let patients = (1..6)
            .map(|k| personalised(&format!("P{k}"), 7.0 + f64::from(k)))
            .collect();
        let bench = Bench::new(patients);
        bench.script(|s| s.nodes = Some(nodes));
        let (summary, submitted) = bench.run().await;
        assert_eq!((summary.done, summary.failed), (5, 0));
        let seen = bench.script.lock().unwrap().threads_and_others.clone();
        let mut beside = 0;
        let mut last = "";
        for (kind, (found, others)) in submitted.iter().zip(&seen) {
            assert_eq!(
                *found,
                if *kind == "organ-beat" { threads } else { 1 },
                "{kind} on {nodes} nodes"
            );
            // At most two tasks run at once, so the previous task is the one that runs next to this
            // one.
            beside += usize::from(*others > 0 && [*kind, last].contains(&"organ-beat"));
            last = kind;
        }
        assert_eq!(beside == 0, threads > 1, "{nodes} nodes: {seen:?}");
    }
}

fn layer(value: serde_json::Value) -> SettingsLayer {
    serde_json::from_value(value).unwrap()
}

#[tokio::test]
async fn the_whole_chain_is_walked_once_and_leaves_record_and_overlay() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    let (summary, submitted) = bench.run().await;
    assert_eq!(
        (summary.done, summary.failed, summary.stopped),
        (1, 0, false)
    );
    assert_eq!(submitted[0], "passive-state");
    assert_eq!(
        submitted[submitted.len() - 4..],
        ["targets", "cell-fit", "organ-beat", "posterior"]
    );
    let record = bench.patient("P1").await;
    let step1 = record.step1.unwrap();
    assert_eq!(step1.quality, Step1Quality::Converged);
    assert_eq!(record.iterations.len(), submitted.len() - 5);
    assert_eq!(step1.best_iteration as usize, record.iterations.len());
    assert!(step1.cost <= 1e-3 && record.iterations[0].cost.unwrap() > 0.1);
    for (found, truth) in step1.parameters.updated().into_iter().zip(scripted::TRUTH) {
        assert!((found / truth - 1.0).abs() < 0.1, "{found} for {truth}");
    }
    assert!(record.verification_cost.unwrap() < 0.01);
    assert_eq!(record.posterior.expect("a posterior").result.draws.len(), 1);
    assert!(record.verification.is_some() && record.targets.is_some() && record.step0.is_some());
    let first = &record.iterations[0].relative_differences;
    assert!(
        first["P_max_mmHg"] < 0.0,
        "simulated below measured is negative: {first:?}"
    );
    let overlay = bench.overlay("P1", "model.toml");
    assert_eq!(
        (overlay.version, overlay.tanh),
        (1, Some(step1.parameters.tanh))
    );
    assert_eq!(overlay.cell["a_p_kPa"], 43.0);

    let (again, submitted) = bench.run().await;
    assert!(again.nothing_to_do() && submitted.is_empty());
    assert_eq!(bench.overlay("P1", "model.toml").version, 1);
}

#[tokio::test]
async fn a_posterior_that_cannot_be_sampled_holds_nobody_and_is_said() {
    let bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 9.0)]);
    bench.script(|s| s.has_no_answer = Some("posterior"));
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, summary.failed), (2, 0));
    assert_eq!(
        submitted
            .iter()
            .filter(|kind| **kind == "posterior")
            .count(),
        2
    );
    let record = bench.patient("P1").await;
    assert!(record.posterior.is_none());
    assert_eq!(
        record.without_intervals().as_deref(),
        Some("uncertainty unknown: no answer, as the test asks")
    );
    assert!(
        record.status.note.starts_with("uncertainty unknown; "),
        "{}",
        record.status.note
    );
    // The model of the next run rests on tasks with results alone.
    let overlay = bench.overlay("P1", "model.toml");
    assert!(!overlay.from.contains_key("posterior") && overlay.from.contains_key("verification"));
    let (again, submitted) = bench.run().await;
    assert!(again.nothing_to_do() && submitted.is_empty());
    // A patient with intervals, or without a wish for them, is not told of.
    bench.script(|s| s.has_no_answer = None);
    let sound = Bench::new(vec![personalised("P1", 8.0)]);
    sound.run().await;
    let record = sound.patient("P1").await;
    assert_eq!(record.without_intervals(), None);
    assert!(
        !record.status.note.contains("uncertainty"),
        "{}",
        record.status.note
    );
}

#[tokio::test]
async fn space_mapping_asks_for_a_proposal_before_each_simulation_and_goes_on_after_one_that_fails()
{
    let mut patient = personalised("P1", 8.0);
    patient.settings.step1.update = Update::SpaceMapping;
    let bench = Bench::new(vec![patient]);
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 1);
    let step1 = &submitted[1..submitted.len() - 4];
    // The last proposal may promise too little gain to be simulated.
    assert!(
        step1.len() >= 4
            && step1
                .chunks(2)
                .all(|pair| ["step1-proposal", "organ-beat"].starts_with(pair)),
        "{step1:?}"
    );
    let record = bench.patient("P1").await;
    assert_eq!(record.step1.unwrap().quality, Step1Quality::Converged);
    let from: Vec<_> = record
        .iterations
        .iter()
        .map(|i| i.proposal.as_ref().map(|task| task.result.from_iteration))
        .collect();
    assert_eq!(from[..2], [Some(None), Some(Some(1))]);
    assert!(
        record
            .iterations
            .iter()
            .all(|i| i.parameters == i.proposal.as_ref().unwrap().result.parameters)
    );
    let steps: Vec<String> = bench
        .reader()
        .await
        .explain(&"P1".into())
        .await
        .unwrap()
        .into_iter()
        .map(|step| step.step)
        .collect();
    let begin = [
        "step-0",
        "step-1 proposal 1",
        "step-1 iteration 1",
        "step-1 proposal 2",
        "step-1 iteration 2",
    ];
    assert_eq!(steps[..5], begin);
    assert!(bench.run().await.0.nothing_to_do());

    // The second simulation diverges. This does not end step 1, but the scripted proposal is the
    // same again, so nothing is left to try.
    let mut patient = personalised("P2", 9.0);
    patient.settings.step1.update = Update::SpaceMapping;
    let bench = Bench::new(vec![patient]);
    bench.script(|s| s.diverges_above_kpa = Some(140.0));
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 1, "the chain goes on from the best iteration");
    let record = bench.patient("P2").await;
    assert!(
        record.iterations[1].failure.is_some() && record.iterations.len() == 2,
        "{submitted:?}"
    );
    assert_eq!(
        submitted
            .iter()
            .filter(|kind| **kind == "step1-proposal")
            .count(),
        3
    );
    let quality = record.status.step1_quality.unwrap();
    assert_eq!(quality, "stalled: best iteration 1");
}

/// Both patients are done, and the first one's chain is unchanged: the second must be decided on
/// its own.
#[tokio::test]
async fn changed_input_of_a_later_patient_is_seen_where_the_first_is_as_it_was() {
    let mut bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 9.0)]);
    bench.run().await;
    bench.patients[1].step0.end_diastolic_pressure_mmhg = Some(9.5);
    let (summary, submitted) = bench.run().await;
    assert_eq!(
        (summary.done, submitted.first()),
        (2, Some(&"passive-state"))
    );
    assert!(bench.run().await.0.nothing_to_do());
}

#[tokio::test]
async fn a_simulation_that_fails_ends_step1_as_stalled_and_a_rerun_continues_without_repeating() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.diverges_above_kpa = Some(150.0));
    let (summary, _) = bench.run().await;
    assert_eq!(summary.done, 1, "the chain goes on from the best iteration");
    let record = bench.patient("P1").await;
    let n = record.iterations.len();
    assert!(
        record.iterations[n - 1].failure.is_some() && n >= 2,
        "{n} iterations"
    );
    let quality = record.status.step1_quality.unwrap();
    assert!(quality.starts_with("stalled: best iteration"), "{quality}");

    let answer = rerun(
        bench.path(),
        &"P1".into(),
        Stage::Step1,
        &layer(json!({"step1": {"damping": 0.3}})),
    )
    .await;
    assert!(matches!(answer, Ok(Answer::Applied { .. })), "{answer:?}");
    bench.script(|s| s.diverges_above_kpa = Some(1000.0));
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 1);
    assert!(!submitted.contains(&"passive-state"));
    let record = bench.patient("P1").await;
    let simulations = submitted
        .iter()
        .filter(|kind| **kind == "organ-beat")
        .count();
    // Only new iterations and the verification beat were simulated, none of the stored iterations.
    assert_eq!(record.iterations.len(), n + simulations - 1);
    let keys: std::collections::BTreeSet<_> = record
        .iterations
        .iter()
        .map(|i| serde_json::to_string(&i.parameters).unwrap())
        .collect();
    assert_eq!(
        keys.len(),
        record.iterations.len(),
        "an iteration was repeated"
    );
    assert!(record.step1.unwrap().cost < record.iterations[n - 2].cost.unwrap());
    assert_eq!(bench.overlay("P1", "model.toml").version, 2);
    assert_eq!(bench.overlay("P1", "model.v1.toml").version, 1);
    assert_eq!(record.plan.settings.step1.damping, 0.3);
    // The override persists in the next run, although the files still give the old value.
    assert!(bench.run().await.0.nothing_to_do());
}

#[tokio::test]
async fn a_first_beat_whose_valves_stay_shut_leads_on_and_is_not_the_result() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.shut_below_kpa = Some(140.0));
    assert_eq!(bench.run().await.0.done, 1);
    let record = bench.patient("P1").await;
    let [first, second] = [&record.iterations[0], &record.iterations[1]];
    let valve = first.run.as_ref().unwrap().result.failed_valve().unwrap();
    assert_eq!(
        (valve.name.as_str(), first.failure.as_ref()),
        ("aortic valve opened and closed", None)
    );
    // Both time constants of volume count as missed by their whole value, and their valves stay
    // unchanged.
    assert!(first.cost.unwrap() > 2.0, "{:?}", first.cost);
    assert_eq!(first.relative_differences["tau_VD_ms"], -1.0);
    assert_eq!(second.parameters.valves, first.parameters.valves);
    assert!(second.parameters.tanh.smax_ref_kpa > first.parameters.tanh.smax_ref_kpa);
    let summary = record.step1.unwrap();
    assert_eq!(summary.quality, Step1Quality::Converged);
    assert!(
        record.iterations[summary.best_iteration as usize - 1]
            .run
            .as_ref()
            .unwrap()
            .result
            .failed_valve()
            .is_none()
    );
}

#[tokio::test]
async fn valves_that_never_open_fail_step1_and_in_the_verification_beat_the_patient() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.shut_below_kpa = Some(1e6));
    assert_eq!(bench.run().await.0.failed, 1);
    let record = bench.patient("P1").await;
    let failure = record.failure.unwrap();
    assert_eq!(failure.class, FailureClass::Numerics);
    assert!(
        failure
            .message
            .contains("iterations, aortic valve opened and closed"),
        "{}",
        failure.message
    );
    assert!(record.iterations.len() > 1 && record.step1.is_none());

    let mut papers = personalised("P1", 8.0);
    papers.settings.workflow.until = LastStep::Step2Verification;
    let bench = Bench::new(vec![papers]);
    bench.script(|s| s.fitted_cell_is_shut = true);
    assert_eq!(bench.run().await.0.failed, 1);
    let record = bench.patient("P1").await;
    let failure = record.failure.unwrap();
    assert_eq!(
        (failure.class, record.status.step.as_str()),
        (FailureClass::Numerics, "verification")
    );
    assert!(
        failure
            .message
            .contains("the fitted cell does not complete a beat: aortic valve"),
        "{}",
        failure.message
    );
    assert!(record.verification.is_none() && record.cell_fit.is_some());
}

#[tokio::test]
async fn step3_goes_on_from_a_cell_that_is_off_and_the_papers_workflow_ends_before() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.fitted_cell_is_off = true);
    assert_eq!(bench.run().await.0.done, 1);
    let record = bench.patient("P1").await;
    let step3 = record.step3.as_ref().unwrap();
    assert_eq!(
        (step3.ending, step3.best_iteration),
        (Step3Ending::WithinUncertainty, 1)
    );
    assert!(
        record.verdict.as_ref().unwrap().personalised
            && record.step3_iterations[0].proposal.is_some()
    );
    assert!(record.twin().unwrap().key != record.verification.as_ref().unwrap().key);

    let mut papers = personalised("P1", 8.0);
    papers.settings.workflow.until = LastStep::Step2Verification;
    let bench = Bench::new(vec![papers]);
    bench.script(|s| s.fitted_cell_is_off = true);
    assert_eq!(bench.run().await.0.done, 1);
    let record = bench.patient("P1").await;
    assert!(record.step3.is_none() && !record.verdict.unwrap().personalised);
}

#[tokio::test]
async fn step3_ends_at_its_limit_with_no_cell_that_makes_a_whole_beat() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.fitted_cell_is_shut = true);
    assert_eq!(bench.run().await.0.failed, 1);
    let record = bench.patient("P1").await;
    let failure = record.failure.unwrap();
    assert_eq!(
        (failure.class, record.status.step.as_str()),
        (FailureClass::Numerics, "step-3")
    );
    assert!(
        failure
            .message
            .contains("no cell completes a beat of the organ: aortic valve"),
        "{}",
        failure.message
    );
    assert_eq!(record.step3_iterations.len(), 4);
}

#[tokio::test]
async fn a_first_simulation_that_fails_fails_the_patient_and_a_retry_repeats_it() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.diverges_above_kpa = Some(10.0));
    let (summary, _) = bench.run().await;
    assert_eq!(summary.failed, 1);
    let status = bench.reader().await.status().await.unwrap();
    assert_eq!(
        status.patients[0].failure_class,
        Some(FailureClass::Numerics)
    );
    assert!(
        status.patients[0].note.contains("Newton did not converge"),
        "{}",
        status.patients[0].note
    );
    // Another run alone changes nothing: a failure of the numerics is not tried again by itself.
    assert_eq!(bench.run().await.1.len(), 0);
    retry(bench.path(), &"P1".into()).await.unwrap();
    let (summary, submitted) = bench.run().await;
    assert_eq!(
        (summary.failed, submitted.as_slice()),
        (1, &["organ-beat"][..])
    );
    bench.script(|s| s.diverges_above_kpa = None);
    retry(bench.path(), &"P1".into()).await.unwrap();
    assert_eq!(bench.run().await.0.done, 1);
    assert!(matches!(
        retry(bench.path(), &"P1".into()).await,
        Err(EngineError::Request { .. })
    ));
}

#[tokio::test]
async fn only_what_depends_on_a_changed_setting_is_redone_and_explain_names_it() {
    let mut bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 9.0)]);
    bench.run().await;
    bench.patients[0].settings.step2.popsize = 20;
    let (_, submitted) = bench.run().await;
    // The verification beat of the same fitted parameters is the same task.
    assert_eq!(submitted, ["cell-fit"]);
    let explained = bench.reader().await.explain(&"P1".into()).await.unwrap();
    let step2 = explained.iter().find(|e| e.step == "step-2").unwrap();
    let change = &step2.changes[0];
    assert_eq!(
        (change.path.as_str(), &change.old, &change.new),
        ("settings.popsize", &Some(json!(15)), &Some(json!(20)))
    );
    assert_eq!(step2.changes.len(), 1);
    assert!(
        explained
            .iter()
            .filter(|e| e.step != "step-2")
            .all(|e| e.changes.is_empty())
    );

    bench.patients[0].step0.end_diastolic_pressure_mmhg = Some(10.0);
    let (_, submitted) = bench.run().await;
    assert_eq!(submitted[0], "passive-state");
    assert!(bench.run().await.0.nothing_to_do());
}

#[tokio::test]
async fn equal_work_of_two_patients_is_done_once() {
    let bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 8.0)]);
    let (summary, submitted) = bench.run().await;
    assert_eq!(summary.done, 2);
    let count = |kind| submitted.iter().filter(|k| **k == kind).count();
    assert_eq!((count("passive-state"), count("targets")), (1, 1));
    // Each patient has its own seed; equal fits lead to one verification beat.
    assert_eq!(count("cell-fit"), 2);
    let explained = bench.reader().await.explain(&"P1".into()).await.unwrap();
    assert_eq!(explained[0].shared_with, [PatientId::from("P2")]);
}

#[tokio::test]
async fn a_request_reaches_a_running_coordinator_and_cancels_its_work() {
    let bench = Bench::new(vec![personalised("P1", 8.0), personalised("P2", 9.0)]);
    bench.script(|s| s.silent_on = Some("cell-fit"));
    let (events, mut told) = tokio::sync::mpsc::unbounded_channel();
    let path = bench.path().to_owned();
    let canceller = async move {
        let mut fits = 0;
        while let Some(event) = told.recv().await {
            fits += u32::from(
                matches!(&event, EngineEvent::TaskStarted { step, .. } if step == "step-2"),
            );
            if fits == 2 {
                break;
            }
        }
        let one = cancel(&path, Some(&"P1".into())).await.unwrap();
        let unknown = cancel(&path, Some(&"P9".into())).await.is_err();
        let all = cancel(&path, None).await.unwrap();
        (one, unknown, all)
    };
    let ((summary, _), (one, unknown, all)) =
        tokio::join!(bench.run_with(events, StopSignal::new()), canceller);
    assert_eq!((summary.cancelled, summary.done), (2, 0));
    assert!(matches!(one, Answer::Asked { .. }) && unknown && matches!(all, Answer::Asked { .. }));
    assert!(
        std::fs::read_dir(bench.path().join("requests"))
            .unwrap()
            .next()
            .is_none(),
        "requests are forgotten"
    );

    // The patients stay cancelled until a person wants them again.
    assert_eq!(bench.run().await.1.len(), 0);
    bench.script(|s| s.silent_on = None);
    retry(bench.path(), &"P2".into()).await.unwrap();
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.cancelled, summary.done), (1, 1));
    assert_eq!(submitted, ["cell-fit", "organ-beat", "posterior"]);
}

#[tokio::test]
async fn a_stop_leaves_what_is_silent_and_the_next_run_takes_it_up_free_of_charge() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    bench.script(|s| s.silent_on = Some("targets"));
    for _ in 0..4 {
        let stop = StopSignal::new();
        let (events, mut told) = tokio::sync::mpsc::unbounded_channel();
        let asker = stop.clone();
        tokio::spawn(async move {
            while let Some(event) = told.recv().await {
                if matches!(&event, EngineEvent::TaskStarted { step, .. } if step == "targets") {
                    asker.ask();
                    asker.ask();
                }
            }
        });
        let (summary, _) = bench.run_with(events, stop).await;
        assert_eq!((summary.unfinished, summary.stopped), (1, true));
    }
    bench.script(|s| s.silent_on = None);
    assert_eq!(bench.run().await.0.done, 1);
}

#[tokio::test]
async fn requests_that_make_no_sense_are_refused_with_the_reason() {
    let bench = Bench::new(vec![personalised("P1", 8.0)]);
    let nothing = cancel(bench.path(), None).await.unwrap_err().to_string();
    assert!(nothing.contains("nothing was run here yet"), "{nothing}");
    bench.run().await;
    let ask = async |from, value| {
        rerun(bench.path(), &"P1".into(), from, &layer(value))
            .await
            .unwrap_err()
            .to_string()
    };
    let early = ask(Stage::Step2, json!({"step1": {"damping": 0.5}})).await;
    assert!(
        early.contains("step1") && early.contains("precedes step-2"),
        "{early}"
    );
    let unknown = ask(Stage::Step1, json!({"step1": {"dampening": 0.5}})).await;
    assert!(unknown.contains("dampening"), "{unknown}");
    let senseless = ask(Stage::Step1, json!({"step1": {"damping": -1.0}})).await;
    assert!(senseless.contains("damping"), "{senseless}");
    let over = cancel(bench.path(), Some(&"P1".into()))
        .await
        .unwrap_err()
        .to_string();
    assert!(over.contains("P1 is done"), "{over}");
    assert!(
        bench.run().await.0.nothing_to_do(),
        "refused requests change nothing"
    );
}

#[test]
fn each_patient_has_its_own_stream_that_any_json_reader_keeps() {
    let (a, b) = (
        cardiotwin_workflow::derivation::stream(1, "01-CoA"),
        cardiotwin_workflow::derivation::stream(1, "02-CoA"),
    );
    assert!(a != b && a != cardiotwin_workflow::derivation::stream(2, "01-CoA"));
    assert!(a < 1 << 53 && b < 1 << 53);
}

fn element(number: u32) -> ResolvedPatient {
    let task = TaskSpec::CellSweep(Box::new(CellSweepSpec {
        design: CellDesign {
            parameters: vec![SweptParameter {
                name: "n_Tm".into(),
                lower: 3.0,
                upper: 7.0,
            }],
            skip_points: 0,
            scramble_seed: None,
            cycle_length_ms: 1000.0,
            lambda_0: 1.1,
            fixed: Default::default(),
            tolerance: 1e-4,
            organ: None,
        },
        first_block: 8 * number,
        n_blocks: 8,
    }));
    let id = PatientId(format!("chunk-{number}"));
    ResolvedPatient::without_data(
        id,
        Workflow::Task {
            task: Box::new(task),
        },
    )
}

#[tokio::test]
async fn a_coordinator_on_another_host_is_asked_and_not_overtaken() {
    let bench = Bench::new((0..1).map(element).collect());
    bench.run().await;
    let elsewhere = cardiotwin_schemas::progress::Claim {
        host: "login2".into(),
        ..dispatch::claim_of_this_process()
    };
    let lease = Lease::acquire(bench.path(), &elsewhere, |_| None, clock::now_ms()).unwrap();
    let asked = retry(bench.path(), &"chunk-0".into()).await.unwrap();
    assert!(matches!(&asked, Answer::Asked { holder } if holder.host == "login2"));
    let refused = clean(bench.path(), false, false).await.unwrap_err();
    assert!(
        matches!(&refused, EngineError::Lock(LockError::Held { .. })),
        "{refused}"
    );
    let target = bench.path().with_extension("archive");
    assert!(archive(bench.path(), &target, false).await.is_err() && !target.exists());
    drop(lease);
    clean(bench.path(), false, false).await.unwrap();
}

#[tokio::test]
async fn another_build_decides_for_all_finished_patients_and_not_the_first_alone() {
    let bench = Bench::new((0..3).map(element).collect());
    assert_eq!(bench.run().await.0.done, 3);
    another_build::decided_otherwise(bench.path(), "chunk-1", "first_block").await;
    assert_eq!(bench.resume(None).await.unwrap(), ["cell-sweep"]);
    assert_eq!(bench.resume(None).await.unwrap(), [""; 0]);
}

#[tokio::test]
async fn a_finished_run_that_wants_other_tasks_refuses_another_worker() {
    let bench = Bench::new((0..3).map(element).collect());
    let worker = bench.path().join("worker");
    std::fs::write(&worker, "the first").unwrap();
    bench.run().await;
    assert_eq!(bench.resume(Some(&worker)).await.unwrap(), [""; 0]);
    std::fs::write(&worker, "another").unwrap();
    assert_eq!(
        bench.resume(Some(&worker)).await.unwrap(),
        [""; 0],
        "nothing is computed with it"
    );
    another_build::decided_otherwise(bench.path(), "chunk-2", "first_block").await;
    let refused = bench.resume(Some(&worker)).await.unwrap_err();
    assert!(
        matches!(refused, EngineError::OtherWorker { .. }),
        "{refused}"
    );
    std::fs::write(&worker, "the first").unwrap();
    assert_eq!(bench.resume(Some(&worker)).await.unwrap(), ["cell-sweep"]);
}

#[tokio::test]
async fn elements_of_a_sweep_are_one_task_each_and_more_of_them_repeat_none() {
    let mut bench = Bench::new((0..3).map(element).collect());
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, submitted.len()), (3, 3));
    bench.patients.push(element(3));
    let (summary, submitted) = bench.run().await;
    assert_eq!((summary.done, submitted), (4, vec!["cell-sweep"]));
    let members = Reader::open(bench.path())
        .await
        .unwrap()
        .members()
        .await
        .unwrap();
    assert_eq!(
        members
            .iter()
            .map(|m| m.plan.id.as_str())
            .collect::<Vec<_>>(),
        ["chunk-0", "chunk-1", "chunk-2", "chunk-3"]
    );
    for member in members {
        let task = member.task.expect("its result is published");
        assert!(matches!(task.result, TaskResult::CellSweep(r) if r.n_samples == 32));
        assert_eq!(
            (member.status.state.as_str(), member.failure),
            ("done", None)
        );
    }
}
