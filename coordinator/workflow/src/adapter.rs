//! Between the schemas' step 1 and calibrate's fixed point: names and units agree, only the types differ.

use std::collections::BTreeMap;

use cardiotwin_calibrate::fixed_point::{
    self, Biomarker, Bounds, Cost, Outcome, PARAMETERS, Parameter, Parameters, Settings, Stop,
    Weights,
};
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::settings::{Step1Settings, StopRule, Update};

/// The biomarkers that step 1 looks at.
pub fn biomarkers(b: &Biomarkers) -> fixed_point::Biomarkers {
    fixed_point::Biomarkers {
        p_max_mmhg: b.p_max_mmhg,
        dpdt_max_mmhg_per_ms: b.dpdt_max_mmhg_per_ms,
        dpdt_min_mmhg_per_ms: b.dpdt_min_mmhg_per_ms,
        ptd90_ms: b.ptd90_ms,
        tau_vd_ms: b.tau_vd_ms,
        tau_vr_ms: b.tau_vr_ms,
        sv_ml: b.sv_ml,
    }
}

/// Those alone, so that a proposal's key depends on nothing else.
pub fn of_step1(b: &Biomarkers) -> Biomarkers {
    Biomarkers {
        p_max_mmhg: b.p_max_mmhg,
        dpdt_max_mmhg_per_ms: b.dpdt_max_mmhg_per_ms,
        dpdt_min_mmhg_per_ms: b.dpdt_min_mmhg_per_ms,
        ptd90_ms: b.ptd90_ms,
        tau_vd_ms: b.tau_vd_ms,
        tau_vr_ms: b.tau_vr_ms,
        sv_ml: b.sv_ml,
        ..Biomarkers::default()
    }
}

/// What a simulation tells step 1. Without a whole beat pressure alone counts: hardly any volume has moved.
pub fn outcome(beat: &OrganBeatResult) -> Outcome {
    let found = biomarkers(&beat.biomarkers);
    match beat.failed_valve() {
        None => Outcome::Simulated(found),
        Some(_) => Outcome::NoWholeBeat(fixed_point::Biomarkers {
            tau_vd_ms: None,
            tau_vr_ms: None,
            sv_ml: None,
            ..found
        }),
    }
}

/// The six updated parameters.
pub fn parameters(p: &Step1Parameters) -> Parameters {
    let mut parameters = Parameters::default();
    for (parameter, value) in PARAMETERS.into_iter().zip(p.updated()) {
        parameters.set(parameter, value);
    }
    parameters
}

/// The same as an array in the order of [`cardiotwin_schemas::settings::STEP1_PARAMETERS`].
pub fn values(p: &Parameters) -> [f64; 6] {
    PARAMETERS.map(|parameter| p.get(parameter))
}

fn named(name: &str) -> Result<Parameter, String> {
    PARAMETERS
        .into_iter()
        .find(|parameter| parameter.key() == name)
        .ok_or_else(|| {
            let known: Vec<&str> = PARAMETERS.into_iter().map(Parameter::key).collect();
            format!(
                "step1 names parameter {name}; expected one of {}",
                known.join(", ")
            )
        })
}

/// Step 1's settings for the loop, or what is wrong with them. Only space mapping has weights.
pub fn settings(s: &Step1Settings, update: Update) -> Result<Settings, String> {
    let bounds = s.bounds.iter().map(|(name, [lower, upper])| {
        Ok((
            named(name)?,
            Bounds {
                lower: *lower,
                upper: *upper,
            },
        ))
    });
    Ok(Settings {
        tolerance: s.tolerance,
        damping: s.damping,
        max_iterations: s.max_iterations as usize,
        stagnation_iterations: s.stall_iterations as usize,
        stagnation_fraction: s.stall_improvement,
        bounds: bounds.collect::<Result<_, String>>()?,
        frozen: s
            .frozen
            .iter()
            .map(|name| named(name))
            .collect::<Result<_, String>>()?,
        stop: match s.stop {
            StopRule::Auto if update == Update::SpaceMapping => Stop::NoPromise,
            StopRule::Auto | StopRule::FirstConverged => Stop::FirstConverged,
            StopRule::BestOfLimit => Stop::BestOfLimit,
        },
        weights: match update {
            Update::SpaceMapping => weights(&s.weights)?,
            Update::Auto | Update::FixedPoint => Weights::default(),
        },
    })
}

fn weights(given: &BTreeMap<String, f64>) -> Result<Weights, String> {
    given
        .iter()
        .try_fold(Weights::default(), |weights, (name, weight)| {
            let biomarker = Biomarker::named(name).ok_or_else(|| {
                format!(
                    "step1.weights names biomarker {name}; expected one of {}",
                    Biomarker::ALL.map(Biomarker::key).join(", ")
                )
            })?;
            Ok(weights.with(biomarker, *weight))
        })
}

/// (simulated − measured) / measured by biomarker: the schemas' sign, the opposite of the cost's terms.
pub fn relative_differences(cost: &Cost) -> BTreeMap<String, f64> {
    cost.terms
        .iter()
        .map(|term| (term.biomarker.key().to_owned(), -term.relative_difference))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::settings::{STEP1_BIOMARKERS, STEP1_PARAMETERS};

    #[test]
    fn both_sides_mean_the_same_six_in_the_same_order() {
        assert_eq!(PARAMETERS.map(Parameter::key), STEP1_PARAMETERS);
        assert_eq!(Biomarker::ALL.map(Biomarker::key), STEP1_BIOMARKERS);
        let start = Step1Parameters::default();
        assert_eq!(values(&parameters(&start)), start.updated());
    }

    #[test]
    fn an_unknown_name_is_told_with_the_known_ones() {
        let mut wrong = Step1Settings::default();
        wrong.frozen.push("tau_XX".into());
        let message = settings(&wrong, Update::FixedPoint).unwrap_err();
        assert!(
            message.contains("tau_XX") && message.contains("tau_SR_ref_ms"),
            "{message}"
        );
        settings(&Step1Settings::default(), Update::FixedPoint)
            .unwrap()
            .validate()
            .unwrap();
        let mut wrong = Step1Settings::default();
        wrong.weights.insert("SV".into(), 1.0);
        let message = settings(&wrong, Update::SpaceMapping).unwrap_err();
        assert!(
            message.contains("SV;") && message.contains("SV_mL"),
            "{message}"
        );
    }
}
