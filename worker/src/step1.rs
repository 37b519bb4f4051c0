//! Between the schemas' step 1 and calibrate's: names and units agree, only the types differ.

use cardiotwin_calibrate::fixed_point::{Biomarker, Biomarkers as Calibrated, Settings, Weights};
use cardiotwin_calibrate::fixed_point::{Bounds, Outcome, PARAMETERS, Parameter, Parameters};
use cardiotwin_calibrate::space_mapping::Proposal;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::outcome::OrganBeatResult;
use std::collections::BTreeMap;

/// The biomarkers that step 1 looks at.
#[must_use]
pub fn biomarkers(b: &Biomarkers) -> Calibrated {
    Calibrated {
        p_max_mmhg: b.p_max_mmhg,
        dpdt_max_mmhg_per_ms: b.dpdt_max_mmhg_per_ms,
        dpdt_min_mmhg_per_ms: b.dpdt_min_mmhg_per_ms,
        ptd90_ms: b.ptd90_ms,
        tau_vd_ms: b.tau_vd_ms,
        tau_vr_ms: b.tau_vr_ms,
        sv_ml: b.sv_ml,
    }
}

/// The same in the form of files.
#[must_use]
pub fn to_schema(b: &Calibrated) -> Biomarkers {
    Biomarkers::with_organ([
        b.p_max_mmhg,
        b.dpdt_max_mmhg_per_ms,
        b.dpdt_min_mmhg_per_ms,
        b.ptd90_ms,
        b.tau_vd_ms,
        b.tau_vr_ms,
        b.sv_ml,
    ])
}

/// What biomarkers tell; without a whole beat pressure alone counts: hardly any volume has moved.
#[must_use]
pub fn told(b: &Biomarkers, whole_beat: bool) -> Outcome {
    let found = biomarkers(b);
    if whole_beat {
        Outcome::Simulated(found)
    } else {
        Outcome::NoWholeBeat(Calibrated {
            tau_vd_ms: None,
            tau_vr_ms: None,
            sv_ml: None,
            ..found
        })
    }
}

/// What a beat tells, judged by its checks.
#[must_use]
pub fn outcome(beat: &OrganBeatResult) -> Outcome {
    if beat.failed_simulation().is_some() {
        return Outcome::Failed;
    }
    told(&beat.biomarkers, beat.failed_valve().is_none())
}

/// Factors of the cheap model's biomarkers at a proposal's base, by name.
#[must_use]
pub fn factors(proposal: &Proposal) -> BTreeMap<String, f64> {
    proposal
        .correction
        .iter()
        .map(|(biomarker, factor)| (biomarker.key().to_owned(), *factor))
        .collect()
}

/// The six updated parameters.
#[must_use]
pub fn parameters(p: &Step1Parameters) -> Parameters {
    let mut parameters = Parameters::default();
    PARAMETERS
        .into_iter()
        .zip(p.updated())
        .for_each(|(parameter, value)| parameters.set(parameter, value));
    parameters
}

/// `start` with the six replaced.
#[must_use]
pub fn with(start: &Step1Parameters, p: &Parameters) -> Step1Parameters {
    start.with_updated(PARAMETERS.map(|parameter| p.get(parameter)))
}

/// Bounds, frozen parameters and weights by name; names that are none are left out, as the coordinator has refused them.
#[must_use]
pub fn settings(
    bounds: &BTreeMap<String, [f64; 2]>,
    frozen: &[String],
    weights: &BTreeMap<String, f64>,
) -> Settings {
    let named = |name: &String| {
        PARAMETERS
            .into_iter()
            .find(|parameter: &Parameter| parameter.key() == name)
    };
    let bound = |(name, [lower, upper]): (&String, &[f64; 2])| {
        // A proposal takes logarithms.
        Some((
            named(name)?,
            Bounds {
                lower: lower.max(1e-9),
                upper: *upper,
            },
        ))
    };
    Settings {
        bounds: bounds.iter().filter_map(bound).collect(),
        frozen: frozen.iter().filter_map(named).collect(),
        weights: weights
            .iter()
            .fold(Weights::default(), |all, (name, weight)| {
                Biomarker::named(name).map_or(all, |biomarker| all.with(biomarker, *weight))
            }),
        ..Settings::default()
    }
}
