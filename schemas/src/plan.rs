//! The coordinator's plan of a patient in a run: resolved settings and hashed inputs.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarkers;
use crate::external::{ExternalOrgan, ExternalSettings};
use crate::ids::PatientId;
use crate::organ::{
    BeatCount, CellStretch, CirculationSpec, ContractionSpec, OrganSpec, Step1Parameters,
    ValveParameters,
};
use crate::organ_law::{LawLesson, LawSamples};
use crate::outcome::PassiveStateResult;
use crate::patient::Noise;
use crate::posterior::{PosteriorSpec, TwinBeat};
use crate::settings::{ActivationSettings, Fidelity, Settings, StartMode, Surrogate};
use crate::shared::Shared;
use crate::task::{
    CellInOrgan, InputFile, LearnLawSpec, OrganBeatSpec, PassiveStateSpec, Step1ProposalSpec,
    Step1Run, Step3ProposalSpec, Step3Run, TaskSpec,
};

/// Proposals and posteriors of all patients draw the same random numbers, so that only the data
/// make a difference.
const PROPOSAL_SEED: u64 = 1;

/// Chain of tasks of a patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Workflow {
    /// Step 0, step 1, targets, step 2, verification.
    Personalise,
    /// Three no-op tasks, to measure the orchestration.
    Noop {
        /// How long each task sleeps.
        sleep_ms: u64,
    },
    /// A single task, which is an element of a sweep.
    Task {
        /// The task.
        task: Box<TaskSpec>,
    },
}

/// A patient ready to run. All tasks of the patient follow from this and from the outcomes so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ResolvedPatient {
    /// Pseudonym of the patient.
    pub id: PatientId,
    /// Chain of tasks.
    pub workflow: Workflow,
    /// Patient from whose stream random numbers are drawn; absent if the patient has its own
    /// stream. Members of a sweep share the stream of their patient so that they differ only in
    /// what the sweep varies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random_stream: Option<PatientId>,
    /// Task of step 0, which contains all measured inputs by content.
    pub step0: PassiveStateSpec,
    /// Measured calcium transient, for `step2.calcium = "median-trace"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium: Option<InputFile>,
    /// File with what other organs taught about the organ's law (`workflow.law`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<InputFile>,
    /// Noise of the traces as stated by the clinic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Files of an external solver, by the names used in its command.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub external_files: Vec<InputFile>,
    /// Settings with all layers merged. They include those of the executor, which never enter a
    /// task's key.
    #[serde(deserialize_with = "crate::earlier::settings")]
    #[schemars(with = "Settings")]
    pub settings: Shared<Settings>,
    /// Effects accepted for this patient.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<crate::organ::EffectSpec>,
    /// Whether effects or corrections were accepted although held-out data did not confirm them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_unconfirmed: bool,
}

impl ResolvedPatient {
    /// Patient from whose stream the random numbers are drawn.
    #[must_use]
    pub fn random_stream(&self) -> &PatientId {
        self.random_stream.as_ref().unwrap_or(&self.id)
    }

    /// Whether parameters are sought in the organ's law.
    #[must_use]
    pub fn uses_the_organs_law(&self) -> bool {
        self.workflow == Workflow::Personalise
            && self.settings.solver.fidelity == Fidelity::FiniteElement
            && self.settings.workflow.surrogate == Surrogate::OrganLaw
    }

    /// Number of pilots who teach the organ's law in this patient's cohort; 0 if the patient has
    /// nothing to do with pilots.
    #[must_use]
    pub fn n_pilots(&self) -> u32 {
        match self.uses_the_organs_law() {
            true => self.settings.workflow.pilots,
            false => 0,
        }
    }

    /// Task that learns the law before this patient's first beat from what pilots teach.
    #[must_use]
    pub fn learn_law_spec(&self, lessons: &[LawLesson]) -> LearnLawSpec {
        LearnLawSpec {
            learner: self.id.clone(),
            start: self.law.clone(),
            lessons: lessons.to_vec(),
        }
    }

    /// Task of step 0. Settings take precedence, because a rerun may have changed them after the
    /// inputs were read.
    #[must_use]
    pub fn step0_spec(&self) -> PassiveStateSpec {
        let solver = &self.settings.solver;
        let in_3d = solver.fidelity == Fidelity::FiniteElement;
        PassiveStateSpec {
            start: solver.start,
            activation: solver.activation,
            finite_element: in_3d.then(|| solver.finite_element.anatomy(&self.effects)),
            own_mesh: self.step0.own_mesh.clone().filter(|_| in_3d),
            guccione_c_kpa: self.step0.guccione_c_kpa.filter(|_| in_3d),
            ..self.step0.clone()
        }
    }

    /// A beat of the organ from step 0, with the patient's effects.
    #[must_use]
    pub fn beat_spec(
        &self,
        step0: &PassiveStateResult,
        contraction: ContractionSpec,
        valves: ValveParameters,
        beats: BeatCount,
    ) -> OrganBeatSpec {
        let solver = &self.settings.solver;
        let mut effects = step0.circulation.effects.clone();
        effects.extend(self.effects.iter().cloned());
        let in_3d = matches!(step0.organ, OrganSpec::FiniteElement(_));
        OrganBeatSpec {
            cycle_length_ms: self.step0.cycle_length_ms,
            time_step_ms: solver.time_step_ms,
            shortest_step_ms: solver.shortest_step_ms,
            newton_iterations: if in_3d {
                solver.finite_element.newton_iterations
            } else {
                solver.newton_iterations
            },
            organ: self.organ(step0),
            circulation: CirculationSpec {
                effects,
                ..step0.circulation.clone()
            },
            valves,
            contraction,
            cell_stretch: CellStretch {
                origin: solver.cell_stretch,
                slack_stretch: solver.slack_stretch,
            },
            beats,
            measured_end_diastolic_volume_ml: step0.measured.edv_ml,
            noise_windows: step0.noise_windows,
            finite_element: in_3d.then(|| solver.finite_element.equations()),
        }
    }

    /// The simulated organ: that of step 0, or an external solver in the same state.
    fn organ(&self, step0: &PassiveStateResult) -> OrganSpec {
        match (&step0.organ, self.settings.solver.fidelity) {
            (
                OrganSpec::Reduced {
                    passive,
                    activation,
                },
                Fidelity::External,
            ) => OrganSpec::External(Box::new(ExternalOrgan {
                passive: *passive,
                activation: *activation,
                settings: ExternalSettings {
                    files: BTreeMap::new(),
                    ..self.settings.solver.external.clone()
                },
                files: self.external_files.clone(),
            })),
            (organ, _) => organ.clone(),
        }
    }

    /// Converts a beat for use in a search, where the one-fibre ventricle replaces the simulated
    /// organ.
    fn in_search(&self, step0: &PassiveStateResult, beat: OrganBeatSpec) -> OrganBeatSpec {
        let newton_iterations = self.settings.solver.newton_iterations;
        OrganBeatSpec {
            organ: step0.organ.clone(),
            newton_iterations,
            finite_element: None,
            ..beat
        }
    }

    /// Task that proposes the next simulation of step 1, by space mapping.
    ///
    /// - `start`: initial guess
    /// - `law`: beats from which the organ's law is learned
    #[must_use]
    pub fn step1_proposal_spec(
        &self,
        step0: &PassiveStateResult,
        start: &Step1Parameters,
        runs: Vec<Step1Run>,
        law: Option<Vec<LawSamples>>,
    ) -> Step1ProposalSpec {
        let Settings { solver, step1, .. } = &*self.settings;
        let contraction = ContractionSpec::Tanh {
            parameters: start.tanh,
        };
        let beat = self.beat_spec(
            step0,
            contraction,
            start.valves,
            BeatCount::Fixed { n: solver.beats },
        );
        Step1ProposalSpec {
            beat: self.in_search(step0, beat),
            measured: step0.measured,
            runs,
            bounds: step1.bounds.clone(),
            frozen: step1.frozen.clone(),
            weights: step1.weights.clone(),
            prior: law.as_ref().and(self.law.clone()),
            law,
            seed: PROPOSAL_SEED,
        }
    }

    /// Task that proposes the next simulation of step 3, by space mapping.
    ///
    /// - `cell`: cell and beats at the start of step 3
    /// - `runs`: the verification beat and those of step 3 so far; empty for the fit of step 2's cell
    ///   in the organ
    /// - `law`: beats with a cell from which the organ's law is learned, in addition to step 1's
    #[must_use]
    pub fn step3_proposal_spec(
        &self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        runs: Vec<Step3Run>,
        law: &[LawSamples],
    ) -> Step3ProposalSpec {
        let step3 = &self.settings.step3;
        let law = cell.law_with(law);
        let CellInOrgan { beat, step1, .. } = cell.clone();
        Step3ProposalSpec {
            parameters: step3.moved(&beat.valves),
            traces: step3.traces(step0, beat.cycle_length_ms),
            beat: self.in_search(step0, beat),
            measured: step0.measured,
            runs,
            step1,
            uncertainty_percent: step3.uncertainty_percent.clone(),
            prior: law.as_ref().and(self.law.clone()),
            law,
            seed: PROPOSAL_SEED,
        }
    }

    /// Task that computes the uncertainty of a twin.
    ///
    /// - `cell`: cell and beats at the start of step 3
    /// - `law`: beats with a cell from which the organ's law is learned, in addition to step 1's
    #[must_use]
    pub fn posterior_spec(
        &self,
        step0: &PassiveStateResult,
        cell: &CellInOrgan,
        twin: TwinBeat,
        law: &[LawSamples],
    ) -> PosteriorSpec {
        let Settings {
            step3, posterior, ..
        } = &*self.settings;
        let beat = cell.beat.with_parameters(&twin.parameters);
        PosteriorSpec {
            parameters: step3.moved(&cell.beat.valves),
            beat: self.in_search(step0, beat),
            twin,
            measured: step0.measured,
            samples: step0.samples.clone(),
            noise: self.noise.clone().unwrap_or_default(),
            uncertainty_percent: step3.uncertainty_percent.clone(),
            settings: *posterior,
            law: cell.law_with(law),
            prior: cell.law.as_ref().and(self.law.clone()),
            seed: PROPOSAL_SEED,
        }
    }

    /// A patient of three no-op tasks that sleep for `sleep_ms` each.
    #[must_use]
    pub fn noop(id: &str, sleep_ms: u64) -> Self {
        Self::without_data(PatientId::from(id), Workflow::Noop { sleep_ms })
    }

    /// A member of a run without measured data: an element of a sweep, or a no-op.
    #[must_use]
    pub fn without_data(id: PatientId, workflow: Workflow) -> Self {
        let step0 = PassiveStateSpec {
            cycle_length_ms: 1000.0,
            pressure: None,
            volume: None,
            biomarkers: Biomarkers::default(),
            end_diastolic_pressure_mmhg: None,
            end_diastolic_volume_ml: None,
            diastasis_time_ms: None,
            diastasis_volume_ml: None,
            aortic_systolic_mmhg: None,
            aortic_diastolic_mmhg: None,
            wall_volume_ml: None,
            passive_exponent: None,
            afterload: None,
            left_atrial_pressure_mmhg: None,
            flows: crate::filling::FlowMeasurements::default(),
            start: StartMode::EndDiastole,
            activation: ActivationSettings::default(),
            biomarker_factors: BTreeMap::new(),
            passive_law: None,
            corrections: Vec::new(),
            finite_element: None,
            own_mesh: None,
            guccione_c_kpa: None,
        };
        Self {
            id,
            workflow,
            random_stream: None,
            step0,
            calcium: None,
            law: None,
            noise: None,
            external_files: Vec::new(),
            settings: Shared::default(),
            effects: Vec::new(),
            is_unconfirmed: false,
        }
    }
}
