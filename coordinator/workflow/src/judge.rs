//! Verdict on an outcome by its scientific content, never by exit code 0 alone (SPEC section 5).
//!
//! A result counts only if it answers the requested task, is finite, and passes every scientific
//! check that it carries. Any other outcome of a process that exited well is a failure of class
//! numerics, or of class bug if it contradicts its task or itself.

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers, CellBiomarkers};
use cardiotwin_schemas::discover::Findings;
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::outcome::{
    CellFitResult, CellSweepResult, Ending, LearnLawResult, OrganBeatResult, PassiveStateResult,
    ProposalResult, Step1ProposalResult, Step3ProposalResult, TargetsResult, TaskOutcome,
    TaskResult,
};
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::step1::Step1Parameter;
use cardiotwin_schemas::task::LEARN_LAW;

use super::attempt::AttemptEnding;

/// Ending of an attempt at a task of `kind`, judged by its outcome.
#[must_use]
pub fn judge(attempt: &AttemptId, kind: &str, outcome: &TaskOutcome) -> AttemptEnding {
    if &outcome.attempt != attempt {
        let message = format!(
            "the outcome found for attempt {attempt} was written by attempt {}",
            outcome.attempt
        );
        return AttemptEnding::Failed {
            failure: Failure::new(FailureClass::Bug, message),
        };
    }
    match &outcome.ending {
        Ending::Succeeded { result } => match science(kind, result) {
            Ok(()) => AttemptEnding::Succeeded,
            Err(failure) => AttemptEnding::Failed { failure },
        },
        Ending::Diverged {
            last_good_ms,
            reason,
        } => AttemptEnding::Failed {
            failure: numerics(format!("simulation ended at {last_good_ms} ms: {reason}")),
        },
        Ending::Failed { failure } => AttemptEnding::Failed {
            failure: failure.clone(),
        },
        Ending::Cancelled => AttemptEnding::Interrupted,
    }
}

fn numerics(message: String) -> Failure {
    Failure::new(FailureClass::Numerics, message)
}

/// Whether a result answers a task of `kind` and is plausible.
fn science(kind: &str, result: &TaskResult) -> Result<(), Failure> {
    match (kind, result) {
        ("passive-state", TaskResult::PassiveState(r)) => passive_state(r),
        ("organ-beat", TaskResult::OrganBeat(r)) => organ_beat(r),
        (LEARN_LAW, TaskResult::LearnLaw(r)) => learn_law(r),
        ("step1-proposal", TaskResult::Step1Proposal(r)) => step1_proposal(r),
        ("step3-proposal", TaskResult::Step3Proposal(r)) => step3_proposal(r),
        ("posterior", TaskResult::Posterior(r)) => posterior(r),
        ("targets", TaskResult::Targets(r)) => targets(r),
        ("cell-fit", TaskResult::CellFit(r)) => cell_fit(r),
        ("cell-sweep", TaskResult::CellSweep(r)) => cell_sweep(r),
        ("discover", TaskResult::Discover(r)) => discover(&r.findings),
        ("noop", TaskResult::Noop) => Ok(()),
        (kind, other) => {
            let found = match other {
                TaskResult::PassiveState(_) => "passive-state",
                TaskResult::OrganBeat(_) => "organ-beat",
                TaskResult::LearnLaw(_) => LEARN_LAW,
                TaskResult::Step1Proposal(_) => "step1-proposal",
                TaskResult::Step3Proposal(_) => "step3-proposal",
                TaskResult::Posterior(_) => "posterior",
                TaskResult::Targets(_) => "targets",
                TaskResult::CellFit(_) => "cell-fit",
                TaskResult::CellSweep(_) => "cell-sweep",
                TaskResult::Discover(_) => "discover",
                TaskResult::Noop => "noop",
            };
            Err(Failure::new(
                FailureClass::Bug,
                format!("a task of kind {kind} returned a result of {found}"),
            ))
        }
    }
}

fn learn_law(r: &LearnLawResult) -> Result<(), Failure> {
    r.organs.iter().try_for_each(|organ| {
        finite(
            "pressure error before learning",
            organ.pressure_error_before_mmhg,
        )?;
        finite(
            "pressure error after learning",
            organ.pressure_error_after_mmhg,
        )
    })
}

fn passive_state(r: &PassiveStateResult) -> Result<(), Failure> {
    let loads = &r.circulation;
    let w = &loads.afterload;
    finite("afterload R1", w.characteristic_resistance_mmhg_s_per_ml)?;
    finite("afterload R2", w.peripheral_resistance_mmhg_s_per_ml)?;
    finite("afterload C", w.compliance_ml_per_mmhg)?;
    finite(
        "Windkessel pressure at the start",
        loads.initial_windkessel_pressure_mmhg,
    )?;
    finite("left atrial pressure", loads.left_atrial_pressure_mmhg)?;
    match &r.organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => {
            positive("wall volume", passive.wall_volume_ml)?;
            positive("unloaded volume", passive.unloaded_volume_ml)?;
            positive("end-diastolic volume", passive.end_diastolic_volume_ml)?;
            positive("passive stiffness", passive.stiffness_kpa)?;
            finite("passive exponent", passive.exponent)?;
            finite(
                "end-diastolic pressure",
                passive.end_diastolic_pressure_mmhg,
            )?;
            finite("activation onset", activation.onset_ms)?;
        }
        OrganSpec::FiniteElement(organ) => {
            let figures = &organ.figures;
            positive("wall volume", figures.wall_volume_ml)?;
            positive("unloaded volume", figures.unloaded_volume_ml)?;
            positive("end-diastolic volume", figures.end_diastolic_volume_ml)?;
            positive("passive stiffness", figures.stiffness_kpa)?;
            finite(
                "end-diastolic pressure",
                figures.end_diastolic_pressure_mmhg,
            )?;
            finite("activation onset", figures.onset_ms)?;
            finite("activation spread", figures.spread_ms)?;
        }
        OrganSpec::External(_) => {
            return Err(Failure::new(
                FailureClass::Bug,
                "step 0 returned an organ of an external solver",
            ));
        }
    }
    biomarkers(&r.measured)
}

fn organ_beat(r: &OrganBeatResult) -> Result<(), Failure> {
    if r.checks.is_empty() {
        return Err(Failure::new(
            FailureClass::Bug,
            "the simulation reports no scientific check",
        ));
    }
    // The use of a beat whose valves stay shut depends on its purpose, so the workflow decides on
    // it.
    if let Some(check) = r.failed_simulation() {
        return Err(numerics(check.to_string()));
    }
    positive("smallest stretch", r.lambda_min)?;
    biomarkers(&r.biomarkers)
}

fn step1_proposal(r: &Step1ProposalResult) -> Result<(), Failure> {
    Step1Parameter::ALL
        .into_iter()
        .try_for_each(|parameter| positive(parameter.key(), r.parameters.get(parameter)))?;
    proposal(r)
}

fn step3_proposal(r: &Step3ProposalResult) -> Result<(), Failure> {
    r.parameters
        .iter()
        .try_for_each(|(name, value)| finite(name, *value))?;
    proposal(r)
}

fn proposal<P>(r: &ProposalResult<P>) -> Result<(), Failure> {
    finite("predicted cost", r.predicted_cost)?;
    finite("predicted misfit", r.predicted_misfit)?;
    biomarkers(&r.predicted)
}

fn posterior(r: &PosteriorResult) -> Result<(), Failure> {
    for (name, spread) in &r.parameters {
        [
            spread.posterior.p5,
            spread.posterior.p50,
            spread.posterior.p95,
        ]
        .iter()
        .try_for_each(|v| finite(name, *v))?;
    }
    finite(
        "expected misfit left by data and prior",
        r.sampling.left_over_expected,
    )?;
    if r.draws.is_empty() {
        return Err(numerics("no draw of the posterior was kept".into()));
    }
    Ok(())
}

fn targets(r: &TargetsResult) -> Result<(), Failure> {
    positive("first value of the median stretch", r.lambda_0)?;
    positive("largest stretch", r.lambda_max)?;
    cell_biomarkers(&r.targets)?;
    if r.n_nodes == 0 {
        return Err(numerics("no node entered the medians".into()));
    }
    Ok(())
}

fn discover(r: &Findings) -> Result<(), Failure> {
    finite("gap before", r.gap_before)?;
    finite("gap after", r.gap_after)?;
    let named = |name: &String| r.effects.iter().any(|effect| effect.name == *name);
    if r.none != r.accepted.is_empty() || !r.accepted.iter().all(named) {
        return Err(Failure::new(
            FailureClass::Bug,
            "the accepted effects contradict the ranking",
        ));
    }
    Ok(())
}

/// Failed samples are part of a sweep's result; the check is only that each sample is accounted
/// for.
fn cell_sweep(r: &CellSweepResult) -> Result<(), Failure> {
    let counted = r.n_periodic + r.n_not_periodic + r.n_stuck + r.n_refused;
    if r.n_samples == 0 || counted != r.n_samples {
        let message = format!(
            "of {} samples only {counted} are accounted for",
            r.n_samples
        );
        return Err(Failure::new(FailureClass::Bug, message));
    }
    Ok(())
}

fn cell_fit(r: &CellFitResult) -> Result<(), Failure> {
    finite("cost of the fit", r.cost)?;
    for p in &r.parameters {
        finite(&p.name, p.value)?;
        let slack = 1e-9 * (p.upper - p.lower).abs();
        if p.value < p.lower - slack || p.value > p.upper + slack {
            let message = format!(
                "fitted {} is {}, outside its bounds {} to {}",
                p.name, p.value, p.lower, p.upper
            );
            return Err(Failure::new(FailureClass::Bug, message));
        }
    }
    cell_biomarkers(&r.reached)
}

fn biomarkers(b: &Biomarkers) -> Result<(), Failure> {
    Biomarker::ALL
        .into_iter()
        .filter_map(|biomarker| Some((biomarker, b.get(biomarker)?)))
        .try_for_each(|(biomarker, value)| finite(biomarker.key(), value))
}

fn cell_biomarkers(b: &CellBiomarkers) -> Result<(), Failure> {
    finite("Sa_max", b.sa_max_kpa)?;
    finite("dSadt_max", b.dsadt_max_kpa_per_ms)?;
    finite("STD30", b.std30_ms)?;
    finite("STD50", b.std50_ms)?;
    finite("STD90", b.std90_ms)?;
    positive("lambda_min", b.lambda_min)
}

fn finite(name: &str, value: f64) -> Result<(), Failure> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(numerics(format!(
            "{name} is {value}, expected a finite value"
        )))
    }
}

fn positive(name: &str, value: f64) -> Result<(), Failure> {
    finite(name, value)?;
    if value > 0.0 {
        Ok(())
    } else {
        Err(numerics(format!(
            "{name} is {value}, expected a value above 0"
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::TaskKey;
    use cardiotwin_schemas::outcome::Check;
    use cardiotwin_schemas::provenance::Provenance;

    fn attempt(generation: u32) -> AttemptId {
        AttemptId {
            task: TaskKey::from("00"),
            generation,
        }
    }

    fn outcome(ending: Ending) -> TaskOutcome {
        let provenance = Provenance::default();
        TaskOutcome {
            schema_version: cardiotwin_schemas::formats::OUTCOME.version,
            attempt: attempt(1),
            ending,
            artefacts: vec![],
            provenance,
            sha256: None,
        }
    }

    fn beat(name: &str, passed: bool, p_max: f64) -> Ending {
        let check = Check {
            name: name.into(),
            passed,
            found: "0".into(),
            expected: "something else".into(),
        };
        Ending::Succeeded {
            result: Box::new(TaskResult::OrganBeat(OrganBeatResult {
                biomarkers: Biomarkers {
                    p_max_mmhg: Some(p_max),
                    ..Biomarkers::default()
                },
                samples: cardiotwin_schemas::samples::BeatSamples::default(),
                time_points: Default::default(),
                checks: vec![check],
                beats: 1,
                periodic: false,
                remarks: vec![],
                lambda_min: 0.8,
                motion: None,
                law: None,
                closed_loop: None,
                counters: Default::default(),
            })),
        }
    }

    fn class(ending: AttemptEnding) -> Option<FailureClass> {
        ending.failure().map(|f| f.class)
    }

    #[test]
    fn a_simulation_that_ended_well_counts_only_if_its_checks_hold_and_its_numbers_are_finite() {
        let judged = |ending| judge(&attempt(1), "organ-beat", &outcome(ending));
        assert_eq!(
            judged(beat("volume balance", true, 120.0)),
            AttemptEnding::Succeeded
        );
        assert_eq!(
            class(judged(beat("volume balance", false, 120.0))),
            Some(FailureClass::Numerics)
        );
        assert_eq!(
            class(judged(beat("volume balance", true, f64::NAN))),
            Some(FailureClass::Numerics)
        );
    }

    #[test]
    fn valves_that_stay_shut_are_no_failure_of_the_simulation_but_not_finite_numbers_are() {
        let judged = |ending| judge(&attempt(1), "organ-beat", &outcome(ending));
        assert_eq!(
            judged(beat("aortic valve opened and closed", false, 60.0)),
            AttemptEnding::Succeeded
        );
        let class = class(judged(beat(
            "aortic valve opened and closed",
            false,
            f64::NAN,
        )));
        assert_eq!(class, Some(FailureClass::Numerics));
    }

    #[test]
    fn an_answer_to_another_question_is_a_defect() {
        assert_eq!(
            class(judge(
                &attempt(1),
                "targets",
                &outcome(beat("volume balance", true, 120.0))
            )),
            Some(FailureClass::Bug)
        );
        assert_eq!(
            class(judge(
                &attempt(2),
                "organ-beat",
                &outcome(beat("volume balance", true, 120.0))
            )),
            Some(FailureClass::Bug)
        );
    }
}
