//! An executor whose results follow formulas, so that a test can decide what fails and count the
//! submitted tasks.

use std::collections::{HashMap, VecDeque};
use std::path::Path;
use std::sync::{Arc, Mutex};

use cardiotwin_schemas::biomarkers::{Biomarkers, CellBiomarkers, NoiseWindows};
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::finite_element::{FiniteElementOrgan, VentricleFigures};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::{AttemptId, ExternalId};
use cardiotwin_schemas::organ::{
    ActivationSpec, CirculationSpec, ContractionSpec, OneFibrePassive, OrganSpec, Step1Parameters,
    WindkesselParameters,
};
use cardiotwin_schemas::organ_law::{LawSamples, LawTeacher};
use cardiotwin_schemas::outcome::{
    Artefact, CellFitResult, CellSweepResult, Check, Determination, Ending, FittedParameter,
    LearnLawResult, OrganBeatResult, PassiveStateResult, Step1ProposalResult, Step3ProposalResult,
    TargetsResult, TaskOutcome, TaskResult,
};
use cardiotwin_schemas::posterior::{
    Band, Deviations, ParameterSpread, PosteriorResult, PosteriorSpec, Sampling, Spread,
    USUAL_NOISE,
};
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::task::{AttemptSpec, InputFile, OrganBeatSpec, TaskSpec};

use crate::dispatch::{AttemptFindings, DispatchError, Executor, Found, News, Order};

/// Instructions of a test to the executor, and the executor's records for the test.
#[derive(Debug, Default)]
pub struct Script {
    /// Simulations with a peak stress above this diverge.
    pub diverges_above_kpa: Option<f64>,
    /// In simulations with a peak stress below this the aortic valve stays shut.
    pub shut_below_kpa: Option<f64>,
    /// With the fitted cell the aortic valve stays shut.
    pub fitted_cell_is_shut: bool,
    /// Biomarkers of a beat with step 2's cell are far off; with step 3's cell they are not.
    pub fitted_cell_is_off: bool,
    /// Number of attempts, of any task, that are lost first.
    pub lost_attempts: u32,
    /// Kinds of the tasks that were submitted, in order.
    pub submitted: Vec<&'static str>,
    /// Threads of each submitted task, and number of tasks that ran next to it at that time.
    pub threads_and_others: Vec<(u32, usize)>,
    /// Tasks of this kind never end.
    pub silent_on: Option<&'static str>,
    /// Attempts leave the files of a real worker: records, results and series; a lost one leaves
    /// scratch.
    pub leaves_files: bool,
    /// Tasks of this kind fail with wrong input.
    pub refuses: Option<&'static str>,
    /// The model has no answer to tasks of this kind.
    pub has_no_answer: Option<&'static str>,
    /// Number of nodes of the finite-element ventricle that step 0 makes; `None` makes a reduced
    /// ventricle.
    pub nodes: Option<u64>,
    /// Step 0 of the patient with this end-diastolic pressure \[mmHg\] fails with this class.
    pub fails_step0: Option<(f64, FailureClass)>,
    /// Number of tasks that run at once; 2 if it is absent.
    pub workers: Option<usize>,
}

#[derive(Debug, Default)]
pub struct Scripted {
    script: Arc<Mutex<Script>>,
    ended: VecDeque<News>,
    running: HashMap<AttemptId, bool>,
}

impl Scripted {
    pub fn new(script: &Arc<Mutex<Script>>) -> Self {
        Self {
            script: Arc::clone(script),
            ..Self::default()
        }
    }
}

/// Parameters whose biomarkers count as measured.
pub const TRUTH: [f64; 6] = [180.0, 25.0, 70.0, 420.0, 0.02, 0.02];

/// Biomarkers that respond to each parameter as in the heart, but less than in proportion, so that
/// the fixed point needs several iterations.
fn answer(p: [f64; 6]) -> Biomarkers {
    let [smax, tau_sr, tau_sd, t_cr, r_av, r_mv] = p;
    Biomarkers {
        p_max_mmhg: Some(4.0 * smax.powf(0.7)),
        dpdt_max_mmhg_per_ms: Some(30.0 / tau_sr.powf(0.8)),
        dpdt_min_mmhg_per_ms: Some(-60.0 / tau_sd.powf(0.8)),
        ptd90_ms: Some(2.0 * t_cr.powf(0.85)),
        tau_vd_ms: Some(300.0 * r_av.powf(0.5)),
        tau_vr_ms: Some(300.0 * r_mv.powf(0.5)),
        sv_ml: Some(70.0),
        edv_ml: Some(120.0),
        ..Biomarkers::default()
    }
}

fn cell() -> CellBiomarkers {
    CellBiomarkers {
        sa_max_kpa: 60.0,
        dsadt_max_kpa_per_ms: 1.0,
        std30_ms: 200.0,
        std50_ms: 250.0,
        std90_ms: 330.0,
        lambda_min: 0.82,
    }
}

fn passive_state(edp_mmhg: f64) -> TaskResult {
    TaskResult::PassiveState(PassiveStateResult {
        organ: OrganSpec::Reduced {
            passive: OneFibrePassive {
                wall_volume_ml: 120.0,
                unloaded_volume_ml: 50.0,
                end_diastolic_volume_ml: 120.0,
                end_diastolic_pressure_mmhg: edp_mmhg,
                stiffness_kpa: 0.5,
                exponent: 9.0,
            },
            activation: ActivationSpec {
                spread_ms: 40.0,
                groups: 16,
                onset_ms: 5.0,
            },
        },
        circulation: CirculationSpec {
            afterload: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.05,
                peripheral_resistance_mmhg_s_per_ml: 1.0,
                compliance_ml_per_mmhg: 1.5,
            },
            initial_windkessel_pressure_mmhg: 70.0,
            left_atrial_pressure_mmhg: 6.0,
            effects: vec![],
            closed: None,
        },
        measured: answer(TRUTH),
        biomarker_factors: Default::default(),
        noise_windows: NoiseWindows::default(),
        samples: cardiotwin_schemas::samples::BeatSamples::default(),
        time_points: Default::default(),
        estimates: vec![],
        diastasis_volume_error_ml: None,
        remarks: vec![],
        counters: Default::default(),
    })
}

fn finite_element(nodes: u64, edp_mmhg: f64) -> FiniteElementOrgan {
    let figures = VentricleFigures {
        nodes,
        elements: 5 * nodes,
        degrees_of_freedom: 3 * nodes,
        mean_edge_mm: 2.0,
        wall_volume_ml: 120.0,
        image_volume_ml: 110.0,
        image_pressure_mmhg: 6.0,
        unloaded_volume_ml: 50.0,
        end_diastolic_volume_ml: 120.0,
        end_diastolic_pressure_mmhg: edp_mmhg,
        stiffness_kpa: 0.5,
        exponent_factor: 1.0,
        onset_ms: 5.0,
        spread_ms: 40.0,
        epicardial_duration_share: 0.9,
    };
    let ventricle = InputFile {
        name: "ventricle".into(),
        path: "ventricle.bin".into(),
        sha256: "0".into(),
    };
    FiniteElementOrgan { ventricle, figures }
}

fn beat(biomarkers: Biomarkers, opened: bool) -> TaskResult {
    let check = |name: &str, passed| Check {
        name: name.into(),
        passed,
        found: passed.to_string(),
        expected: "true".into(),
    };
    TaskResult::OrganBeat(OrganBeatResult {
        biomarkers,
        samples: cardiotwin_schemas::samples::BeatSamples::default(),
        time_points: Default::default(),
        checks: vec![
            check("finite", true),
            check("aortic valve opened and closed", opened),
        ],
        beats: 1,
        periodic: false,
        remarks: vec![],
        lambda_min: 0.82,
        motion: None,
        law: None,
        closed_loop: None,
        counters: Default::default(),
    })
}

/// The beat with samples for the organ's law, if the organ is in 3D.
fn with_samples(beat: TaskResult, spec: &OrganBeatSpec) -> TaskResult {
    match (beat, &spec.organ) {
        (TaskResult::OrganBeat(beat), OrganSpec::FiniteElement(_)) => {
            let pressure_mmhg = beat.biomarkers.p_max_mmhg.into_iter().collect();
            TaskResult::OrganBeat(OrganBeatResult {
                law: Some(LawSamples {
                    pressure_mmhg,
                    ..LawSamples::default()
                }),
                ..beat
            })
        }
        (beat, _) => beat,
    }
}

/// The file that a task leaves, with its content.
pub fn artefact(spec: &AttemptSpec) -> (Artefact, String) {
    let (name, file, text) = match &spec.task {
        TaskSpec::LearnLaw(task) => {
            let text = serde_json::to_string(&task.lessons).unwrap();
            ("law", "law.json", text)
        }
        _ => {
            let traces = format!("traces of {}", spec.attempt.task);
            ("nodal", "nodal.csv", traces)
        }
    };
    let artefact = Artefact {
        name: name.into(),
        file: file.into(),
        sha256: sha256_hex(text.as_bytes()),
        bytes: text.len() as u64,
    };
    (artefact, text)
}

fn fitted(name: &str, value: f64, lower: f64, upper: f64) -> FittedParameter {
    FittedParameter {
        name: name.into(),
        value,
        lower,
        upper,
        ..FittedParameter::default()
    }
}

impl Script {
    pub fn ending(&self, task: &TaskSpec) -> Ending {
        if self.refuses == Some(task.kind()) {
            return Ending::Failed {
                failure: Failure::new(FailureClass::Input, "refused as the test asks"),
            };
        }
        if self.has_no_answer == Some(task.kind()) {
            return Ending::Failed {
                failure: Failure::new(FailureClass::Numerics, "no answer, as the test asks"),
            };
        }
        let result = match task {
            TaskSpec::PassiveState(spec) => {
                let edp_mmhg = spec.end_diastolic_pressure_mmhg;
                if let Some((_, class)) = self.fails_step0.filter(|f| Some(f.0) == edp_mmhg) {
                    return Ending::Failed {
                        failure: Failure::new(class, "step 0 fails as the test asks"),
                    };
                }
                let edp_mmhg = edp_mmhg.unwrap_or(8.0);
                let mut state = passive_state(edp_mmhg);
                if let (TaskResult::PassiveState(state), Some(nodes)) = (&mut state, self.nodes) {
                    state.organ =
                        OrganSpec::FiniteElement(Box::new(finite_element(nodes, edp_mmhg)));
                }
                state
            }
            TaskSpec::OrganBeat(spec) => with_samples(
                match &spec.contraction {
                    ContractionSpec::Tanh { parameters } => {
                        if self
                            .diverges_above_kpa
                            .is_some_and(|limit| parameters.smax_ref_kpa > limit)
                        {
                            return Ending::Diverged {
                                last_good_ms: 212.0,
                                reason: "Newton did not converge".into(),
                            };
                        }
                        let opened = self
                            .shut_below_kpa
                            .is_none_or(|limit| parameters.smax_ref_kpa >= limit);
                        beat(
                            answer(
                                Step1Parameters {
                                    tanh: *parameters,
                                    valves: spec.valves,
                                }
                                .updated(),
                            ),
                            opened,
                        )
                    }
                    ContractionSpec::Catalogue { name, .. } => {
                        unreachable!("no workflow plans a beat with {name}")
                    }
                    ContractionSpec::Land2017Rice { .. }
                    | ContractionSpec::Land2017Trace { .. } => {
                        let is_of_step3 = spec
                            .contraction
                            .cell_parameters()
                            .is_some_and(|p| p.contains_key("A_eff"));
                        let factor = if self.fitted_cell_is_off && !is_of_step3 {
                            1.5
                        } else {
                            1.001
                        };
                        beat(answer(TRUTH.map(|p| p * factor)), !self.fitted_cell_is_shut)
                    }
                },
                spec,
            ),
            TaskSpec::LearnLaw(spec) => TaskResult::LearnLaw(LearnLawResult {
                organs: (spec.lessons.iter())
                    .map(|lesson| LawTeacher {
                        patient: lesson.patient.clone(),
                        beats: lesson.beats.iter().map(|b| b.task.to_string()).collect(),
                        pressure_error_before_mmhg: 1.0,
                        pressure_error_after_mmhg: 0.75,
                    })
                    .collect(),
            }),
            TaskSpec::Step1Proposal(spec) => {
                // The first proposal is a rough guess; each further one halves the remaining
                // logarithmic error.
                let from = spec
                    .runs
                    .iter()
                    .rfind(|run| run.whole_beat)
                    .map_or([100.0, 40.0, 110.0, 550.0, 0.01, 0.01], |run| {
                        run.parameters.updated()
                    });
                let next = std::array::from_fn(|k| (from[k] * TRUTH[k]).sqrt());
                let predicted = answer(TRUTH);
                TaskResult::Step1Proposal(Step1ProposalResult {
                    parameters: Step1Parameters::default().with_updated(next),
                    predicted,
                    predicted_cost: 0.01,
                    predicted_misfit: 0.01,
                    from_iteration: (!spec.runs.is_empty()).then_some(spec.runs.len() as u32),
                    trust_radius: None,
                    step: None,
                    correction: Default::default(),
                    law_beats: None,
                    learned_law: None,
                    reduced_beats: 100,
                })
            }
            // A different cell, nearer to the truth with each iteration.
            TaskSpec::Step3Proposal(spec) => {
                let share = 0.5_f64.powi(spec.runs.len() as i32);
                TaskResult::Step3Proposal(Step3ProposalResult {
                    parameters: spec
                        .parameters
                        .iter()
                        .map(|(name, p)| (name.clone(), p.centre * (1.0 + share)))
                        .collect(),
                    predicted: spec.measured,
                    predicted_cost: 0.0,
                    predicted_misfit: 1.0,
                    from_iteration: (!spec.runs.is_empty()).then_some(spec.runs.len() as u32),
                    trust_radius: None,
                    step: None,
                    correction: Default::default(),
                    law_beats: None,
                    learned_law: None,
                    reduced_beats: 100,
                })
            }
            TaskSpec::Posterior(spec) => TaskResult::Posterior(Box::new(posterior(spec))),
            TaskSpec::Targets(_) => {
                let has_calcium = false;
                TaskResult::Targets(TargetsResult {
                    lambda_0: 1.0,
                    lambda_max: 1.0,
                    targets: cell(),
                    n_nodes: 16,
                    has_calcium,
                })
            }
            TaskSpec::CellFit(spec) => TaskResult::CellFit(CellFitResult {
                lambda_0: spec.lambda_0,
                parameters: vec![
                    fitted("n_Tm", 5.0, 3.0, 7.0),
                    fitted("a_p_kPa", 43.0, 1.0, 100.0),
                ],
                reached: cell(),
                targets: spec.targets,
                cost: 0.02,
                cost_terms: Default::default(),
                evaluations: 150,
                generations: 1,
                converged: true,
                unreachable_targets: vec![],
                identifiability: None,
            }),
            TaskSpec::CellSweep(spec) => {
                let n_samples =
                    u64::from(spec.n_blocks) * (2 * spec.design.parameters.len() as u64 + 2);
                TaskResult::CellSweep(CellSweepResult {
                    n_samples,
                    n_periodic: n_samples,
                    n_not_periodic: 0,
                    n_stuck: 0,
                    n_refused: 0,
                    arithmetic: "scripted".into(),
                })
            }
            TaskSpec::Discover(_) => {
                return Ending::Failed {
                    failure: Failure::new(FailureClass::Input, "no search is scripted"),
                };
            }
            TaskSpec::Noop(_) => TaskResult::Noop,
        };
        Ending::Succeeded {
            result: Box::new(result),
        }
    }
}

/// Writes the given files of an attempt and the records that every attempt has.
fn leave(order: &Order, files: &[(&str, &str)]) {
    let spec = serde_json::to_string(&order.spec).unwrap();
    for (name, text) in [
        ("spec.json", &*spec),
        ("started.json", "{}"),
        ("stderr.log", "said"),
    ]
    .iter()
    .chain(files)
    {
        let path = order.directory.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
}

impl Executor for Scripted {
    fn kind(&self) -> &'static str {
        "scripted"
    }

    fn free(&self) -> usize {
        let workers = self.script.lock().unwrap().workers.unwrap_or(2);
        workers.saturating_sub(self.running.len())
    }

    async fn submit(&mut self, order: Order) -> Result<ExternalId, DispatchError> {
        let attempt = order.spec.attempt.clone();
        let mut script = self.script.lock().unwrap();
        script.submitted.push(order.spec.task.kind());
        script
            .threads_and_others
            .push((order.spec.threads, self.running.len()));
        self.running.insert(attempt.clone(), true);
        if script.silent_on == Some(order.spec.task.kind()) {
            return Ok(ExternalId::from("1"));
        }
        let evidence = if script.lost_attempts > 0 {
            script.lost_attempts -= 1;
            if script.leaves_files {
                leave(
                    &order,
                    &[
                        ("nodal.csv.part", "half"),
                        ("checkpoint/state.bin", "half way"),
                    ],
                );
            }
            AttemptFindings::Nothing {
                class: FailureClass::Site,
                reason: "the worker was killed by signal 9".into(),
            }
        } else {
            let (made, content) = artefact(&order.spec);
            let file = made.file.clone();
            let outcome = TaskOutcome {
                schema_version: formats::OUTCOME.version,
                attempt: attempt.clone(),
                ending: script.ending(&order.spec.task),
                artefacts: vec![made],
                provenance: Provenance::default(),
                sha256: None,
            };
            let text = serde_json::to_string(&outcome).unwrap();
            // A published file must exist: a missing one counts as purged and is made again.
            let directory = &order.directory;
            std::fs::create_dir_all(directory).unwrap();
            std::fs::write(directory.join(&file), &content).unwrap();
            if script.leaves_files {
                let own = [
                    (&*file, &*content),
                    ("outcome.json", &text),
                    ("vtu/beat.pvd", "<VTKFile/>"),
                ];
                leave(&order, &own);
                leave(&order, &[("checkpoint/state.bin", "the end")]);
            }
            AttemptFindings::Outcome {
                outcome: Box::new(outcome),
                text,
            }
        };
        self.ended.push_back(News::Ended {
            attempt,
            evidence,
            claim: None,
        });
        Ok(ExternalId::from("1"))
    }

    fn adopt(&mut self, _: &AttemptId, _: &Path) -> Result<Found, DispatchError> {
        Ok(Found::Unclaimed)
    }

    fn stop(&mut self, attempt: &AttemptId, _: &Path, _: bool) -> Result<bool, DispatchError> {
        if self.running.contains_key(attempt) {
            let reason = "the worker was killed by signal 15".into();
            let evidence = AttemptFindings::Nothing {
                class: FailureClass::Site,
                reason,
            };
            self.ended.push_back(News::Ended {
                attempt: attempt.clone(),
                evidence,
                claim: None,
            });
            return Ok(true);
        }
        Ok(false)
    }

    async fn news(&mut self) -> Vec<News> {
        if self.ended.is_empty() {
            std::future::pending::<()>().await;
        }
        let news: Vec<News> = self.ended.drain(..).collect();
        for item in &news {
            if let News::Ended { attempt, .. } = item {
                self.running.remove(attempt);
            }
        }
        news
    }
}

/// A posterior as wide as its prior, with a single draw.
fn posterior(spec: &PosteriorSpec) -> PosteriorResult {
    let parameters = spec.parameters.iter().map(|(name, moved)| {
        let prior = Spread {
            p5: moved.lower,
            p50: moved.centre,
            p95: moved.upper,
        };
        let twin = spec.twin.parameters[name];
        (
            name.clone(),
            ParameterSpread {
                twin,
                posterior: prior,
                prior,
                mark: Determination::NotDetermined,
            },
        )
    });
    PosteriorResult {
        parameters: parameters.collect(),
        biomarkers: Default::default(),
        pressure_mmhg: Band::default(),
        volume_ml: Band::default(),
        correlations: vec![],
        draws: vec![spec.parameters.values().map(|moved| moved.centre).collect()],
        deviations: Deviations {
            noise: USUAL_NOISE,
            pressure_discrepancy_mmhg: 0.0,
            volume_discrepancy_ml: 0.0,
        },
        sampling: Sampling {
            converged_share: 1.0,
            left_over_expected: 1.0,
            evaluations: 1,
            is_uncorrected: false,
        },
        learned_law: None,
    }
}
