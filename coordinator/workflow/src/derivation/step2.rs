//! Step 2 of the chain: targets, fit of the cell, and verification beat of the organ with that
//! cell.

use std::collections::BTreeMap;

use cardiotwin_calibrate::fixed_point;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::finite_element::Electrophysiology;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec, ValveParameters};
use cardiotwin_schemas::outcome::{CellFitResult, PassiveStateResult, TargetsResult, TaskResult};
use cardiotwin_schemas::settings::LastStep;
use cardiotwin_schemas::task::{InputFile, OrganBeatSpec, TargetsSpec, TaskSpec};
use cardiotwin_schemas::verdict::Verdict;

use super::{Derivation, Derived, Next, Published, broken, wrong_kind};
use crate::patient::{Stage, Step};
use crate::{cell_fit, organ_fit};

impl<'a> Derivation<'a, '_> {
    /// Step 2's targets, and the calcium if it is a fixed input.
    pub(super) fn targets(
        &mut self,
        best: &Published<'a>,
    ) -> Derived<(&'a TargetsResult, Option<InputFile>)> {
        let step = Step::only(Stage::Targets);
        let Some(nodal) = best.artefacts.iter().find(|a| a.name == "nodal") else {
            return Err(broken(
                step,
                FailureClass::Bug,
                format!("simulation {} wrote no nodal traces", best.key),
            ));
        };
        let path = best.directory.join(&nodal.file);
        let nodal = InputFile {
            name: "nodal".into(),
            path,
            sha256: nodal.sha256.clone(),
        };
        let done = self.result(step, TaskSpec::Targets(TargetsSpec { nodal }))?;
        let TaskResult::Targets(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.targets = Some(done.key);
        let calcium = cell_fit::calcium(self.plan, result, done.artefacts, &done.directory);
        let calcium = calcium.map_err(|failure| Next::Failed {
            step: Step::only(Stage::Step2),
            failure,
        })?;
        Ok((result, calcium))
    }

    pub(super) fn step2(
        &mut self,
        targets: &TargetsResult,
        calcium: Option<InputFile>,
    ) -> Derived<&'a CellFitResult> {
        let step = Step::only(Stage::Step2);
        let spec = cell_fit::cell_fit(self.plan, targets, calcium);
        let done = self.result(step, TaskSpec::CellFit(Box::new(spec)))?;
        let TaskResult::CellFit(result) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        self.chain.cell_fit = Some(done.key);
        self.chain.step2_cost = Some(result.cost);
        Ok(result)
    }

    /// A beat of the organ with a cell, including the potentials of a verification beat.
    pub(super) fn cell_beat(
        &self,
        step0: &PassiveStateResult,
        contraction: ContractionSpec,
        valves: ValveParameters,
    ) -> OrganBeatSpec {
        let beats = BeatCount::Fixed {
            n: self.plan.settings.solver.beats,
        };
        let mut spec = self.plan.beat_spec(step0, contraction, valves, beats);
        let settings = &self.plan.settings.solver.finite_element;
        if let Some(equations) = &mut spec.finite_element
            && settings.ep == Electrophysiology::ReactionEikonal
        {
            equations.potentials = Some(settings.conduction);
        }
        spec
    }

    /// A simulation with a cell in the organ, as step 3 sees it. A failed simulation is an answer
    /// of the model, not an error.
    pub(super) fn beat_with_cell(
        &self,
        step: Step,
        spec: OrganBeatSpec,
        parameters: BTreeMap<String, f64>,
        step0: &PassiveStateResult,
    ) -> Derived<(TaskKey, Result<organ_fit::Beat, Failure>)> {
        let task = TaskSpec::OrganBeat(Box::new(spec));
        let key = task.key();
        let done = match self.result(step, task) {
            Ok(done) => done,
            Err(Next::Failed { failure, .. }) if failure.class == FailureClass::Numerics => {
                return Ok((key, Err(failure)));
            }
            Err(next) => return Err(next),
        };
        let TaskResult::OrganBeat(beat) = done.result else {
            return Err(wrong_kind(step, done.result));
        };
        let settings = &self.plan.settings;
        let seen = organ_fit::Beat {
            parameters,
            biomarkers: Some(beat.biomarkers.organ_alone()),
            samples: Some(beat.samples.clone()),
            law: beat.law.clone(),
            shut: beat.failed_valve().map(ToString::to_string),
            predicted_misfit: None,
            misfit: Some(organ_fit::misfit(
                &settings.step3,
                step0,
                self.plan.step0.cycle_length_ms,
                beat,
            )),
            verdict: Some(Verdict::of(
                &step0.measured,
                &beat.biomarkers,
                &settings.verification.tolerance_percent,
            )),
        };
        Ok((key, Ok(seen)))
    }

    pub(super) fn verification(
        &mut self,
        step0: &PassiveStateResult,
        spec: &OrganBeatSpec,
    ) -> Derived<organ_fit::Beat> {
        let step = Step::only(Stage::Verification);
        let moved = self
            .plan
            .settings
            .step3
            .values(spec.contraction.cell_parameters(), &spec.valves);
        let (key, beat) = self.beat_with_cell(step, spec.clone(), moved.clone(), step0)?;
        let is_last = self.plan.settings.workflow.until == LastStep::Step2Verification;
        let beat = match beat {
            Err(failure) if is_last => return Err(Next::Failed { step, failure }),
            // Step 3 continues from there.
            Err(_) => organ_fit::Beat::failed(moved),
            Ok(beat) => beat,
        };
        if let Some(valve) = beat.shut.as_ref().filter(|_| is_last) {
            return Err(broken(
                step,
                FailureClass::Numerics,
                format!("the fitted cell does not complete a beat: {valve}"),
            ));
        }
        self.chain.verification_cost = beat
            .biomarkers
            .as_ref()
            .map(|found| step1_cost(&step0.measured, found));
        self.chain.verdict = beat.whole_verdict();
        self.chain.verification = Some(key);
        Ok(beat)
    }
}

/// Cost of simulated biomarkers by step 1's formula.
fn step1_cost(measured: &Biomarkers, simulated: &Biomarkers) -> f64 {
    fixed_point::Cost::of(measured, simulated).total
}
