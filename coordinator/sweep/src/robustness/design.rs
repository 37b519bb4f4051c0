//! Members of a robustness sweep: a patient's plan with perturbed targets, perturbed guesses or another seed.

use std::collections::BTreeMap;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::robustness::{RobustnessError, perturbed_data, perturbed_guesses};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::{Step1Parameters, cell_default};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::robustness::{MemberRole, RobustnessSpec, Uncertainty};
use cardiotwin_schemas::settings::LastStep;
use cardiotwin_schemas::step1::Step1Parameter;

/// Prefix of step 2's guesses among a member's inputs, because both steps have an `Smax_ref_kPa`.
pub const STEP2_PREFIX: &str = "step2.";
/// Suffix of the original's id.
const ORIGINAL: &str = "base";
/// Name of the seed among a member's inputs.
pub const SEED: &str = "step2.seed";

/// Errors in making the members of a patient.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// The hypercube cannot be drawn.
    #[error("cannot sample around the values of patient {patient}")]
    Samples {
        /// Id of the patient.
        patient: PatientId,
        /// Reason given by the sampler.
        source: RobustnessError,
    },
    /// A fitted parameter has no default that could be varied.
    #[error(
        "step 2 of patient {patient} fits `{name}`, which has neither a default nor a value in step2.initial"
    )]
    NoGuess {
        /// Id of the patient.
        patient: PatientId,
        /// Name of the parameter.
        name: String,
    },
    /// The bounds of a parameter are in the wrong order or not finite.
    #[error(
        "{table}.bounds.{name} of patient {patient} are {lower} to {upper}; expected the lower \
         bound first"
    )]
    Bounds {
        /// Table of the settings, `step1` or `step2`.
        table: &'static str,
        /// Id of the patient.
        patient: PatientId,
        /// Name of the parameter.
        name: String,
        /// Lower bound, in the parameter's unit.
        lower: f64,
        /// Upper bound, in the parameter's unit.
        upper: f64,
    },
}

/// A personalisation that belongs to the sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// Role of the member: original, sample or seed.
    pub role: MemberRole,
    /// Varied inputs by name: see [`cardiotwin_schemas::robustness::RobustnessMember::inputs`].
    pub inputs: BTreeMap<String, f64>,
    /// Plan to be run.
    pub plan: ResolvedPatient,
}

/// All members around one patient, the original first. They draw from the patient's own stream of
/// random numbers, so that the original has exactly the tasks of the patient's own run.
///
/// # Errors
/// [`DesignError`] if the settings are invalid or leave nothing to vary.
pub fn members(
    patient: &ResolvedPatient,
    spec: &RobustnessSpec,
) -> Result<Vec<Member>, DesignError> {
    let mut all = vec![member(
        patient,
        MemberRole::Original,
        ORIGINAL.to_owned(),
        BTreeMap::new(),
    )];
    let samples = match spec.over {
        Uncertainty::Data => data(patient, spec)?,
        Uncertainty::Guess => guesses(patient, spec)?,
    };
    all.extend(samples);
    all.extend(seeds(patient, spec));
    Ok(all)
}

/// Id of a patient's original.
pub(super) fn original_of(patient: &PatientId) -> PatientId {
    named(patient, ORIGINAL)
}

fn named(patient: &PatientId, suffix: &str) -> PatientId {
    PatientId(format!("{patient}.{suffix}"))
}

fn member(
    patient: &ResolvedPatient,
    role: MemberRole,
    suffix: String,
    inputs: BTreeMap<String, f64>,
) -> Member {
    let mut plan = patient.clone();
    plan.random_stream = Some(patient.random_stream().clone());
    // The paper's tables end with the verification beat.
    plan.settings.workflow.until = LastStep::Step2Verification;
    plan.id = named(&patient.id, &suffix);
    Member { role, inputs, plan }
}

/// Suffix such as `d01`, with as many digits as the largest number needs.
fn suffix(letter: char, number: usize, of: u32) -> String {
    let width = of.to_string().len().max(2);
    format!("{letter}{number:0width$}")
}

/// Members with perturbed targets. The factors are the same for each patient and biomarker, so that
/// patients can be compared.
fn data(patient: &ResolvedPatient, spec: &RobustnessSpec) -> Result<Vec<Member>, DesignError> {
    let n = spec.n_samples as usize;
    let factors = perturbed_data(&[1.0; Biomarker::OF_COST.len()], spec.range, n, spec.seed)
        .map_err(|source| DesignError::Samples {
            patient: patient.id.clone(),
            source,
        })?;
    let measured = measured(patient);
    let members = factors.iter().zip(1..).map(|(sample, number)| {
        let named = Biomarker::COST_KEYS
            .iter()
            .zip(sample)
            .filter(|(name, _)| measured.contains(name));
        let factors: BTreeMap<String, f64> = named
            .map(|(name, factor)| ((*name).to_owned(), *factor))
            .collect();
        let mut member = member(
            patient,
            MemberRole::Sample,
            suffix('d', number, spec.n_samples),
            factors.clone(),
        );
        member.plan.step0.biomarker_factors = factors;
        member
    });
    Ok(members.collect())
}

/// Targets of step 1 that the patient's data determine.
fn measured(patient: &ResolvedPatient) -> Vec<&'static str> {
    let step0 = &patient.step0;
    let of_trace = |biomarker: Biomarker| {
        let trace = if biomarker.is_of_volume() {
            &step0.volume
        } else {
            &step0.pressure
        };
        trace.is_some()
    };
    Biomarker::OF_COST
        .into_iter()
        .filter(|b| step0.biomarkers.get(*b).is_some() || of_trace(*b))
        .map(Biomarker::key)
        .collect()
}

/// A guess that is varied.
struct Guess {
    /// Name of the parameter, with [`STEP2_PREFIX`] for step 2.
    name: String,
    centre: f64,
    bounds: Option<Interval>,
}

/// Guesses of both steps: the updated parameters of step 1 that are not frozen, and the fitted
/// parameters of step 2.
fn varied(patient: &ResolvedPatient) -> Result<Vec<Guess>, DesignError> {
    let (step1, step2) = (&patient.settings.step1, &patient.settings.step2);
    let guess = |table, name: &str, centre: f64, bounds: Option<&[f64; 2]>| {
        let bounds = bounds
            .map(|[lower, upper]| interval(patient, table, name, *lower, *upper))
            .transpose()?;
        let prefix = if table == "step2" { STEP2_PREFIX } else { "" };
        // A default outside narrowed bounds is moved to the bound, as the fit would do.
        let centre = bounds.map_or(centre, |b| b.clamp(centre));
        Ok(Guess {
            name: format!("{prefix}{name}"),
            centre,
            bounds,
        })
    };
    let start = step1.start();
    let of_step1 = step1.moving().map(|parameter| {
        let name = parameter.key();
        guess("step1", name, start.get(parameter), step1.bounds.get(name))
    });
    let of_step2 = step2.fitted().into_iter().map(|name| {
        let value = step2
            .initial
            .get(&name)
            .copied()
            .or_else(|| cell_default(&name));
        let value = value.ok_or_else(|| DesignError::NoGuess {
            patient: patient.id.clone(),
            name: name.clone(),
        })?;
        guess("step2", &name, value, step2.bounds.get(&name))
    });
    of_step1.chain(of_step2).collect()
}

/// Values around which the guesses of a patient's samples lie, by the inputs' names, in the tables'
/// order.
///
/// # Errors
/// The same as for [`members`].
pub fn guess_centres(patient: &ResolvedPatient) -> Result<Vec<(String, f64)>, DesignError> {
    Ok(varied(patient)?
        .into_iter()
        .map(|guess| (guess.name, guess.centre))
        .collect())
}

/// Members with perturbed guesses of both steps, clipped to the bounds.
fn guesses(patient: &ResolvedPatient, spec: &RobustnessSpec) -> Result<Vec<Member>, DesignError> {
    let varied = varied(patient)?;
    let centres: Vec<f64> = varied.iter().map(|guess| guess.centre).collect();
    let bounds: Vec<Option<Interval>> = varied.iter().map(|guess| guess.bounds).collect();
    let samples = perturbed_guesses(
        &centres,
        &bounds,
        spec.range,
        spec.n_samples as usize,
        spec.seed,
    )
    .map_err(|source| DesignError::Samples {
        patient: patient.id.clone(),
        source,
    })?;
    let members = samples.iter().zip(1..).map(|(sample, number)| {
        let inputs: BTreeMap<String, f64> = varied
            .iter()
            .map(|guess| guess.name.clone())
            .zip(sample.iter().copied())
            .collect();
        let suffix = suffix('g', number, spec.n_samples);
        let mut member = member(patient, MemberRole::Sample, suffix, inputs.clone());
        let settings = &mut member.plan.settings;
        let start = Step1Parameters {
            tanh: settings.step1.initial,
            valves: settings.step1.valves,
        };
        let mut values = start.updated();
        for (value, name) in values.iter_mut().zip(Step1Parameter::KEYS) {
            *value = inputs.get(name).copied().unwrap_or(*value);
        }
        let start = start.with_updated(values);
        (settings.step1.initial, settings.step1.valves) = (start.tanh, start.valves);
        let step2 = inputs
            .iter()
            .filter_map(|(name, value)| Some((name.strip_prefix(STEP2_PREFIX)?, value)));
        settings
            .step2
            .initial
            .extend(step2.map(|(name, value)| (name.to_owned(), *value)));
        member
    });
    Ok(members.collect())
}

fn interval(
    patient: &ResolvedPatient,
    table: &'static str,
    name: &str,
    lower: f64,
    upper: f64,
) -> Result<Interval, DesignError> {
    if lower <= upper && lower.is_finite() && upper.is_finite() {
        return Ok(Interval::new(lower, upper));
    }
    Err(DesignError::Bounds {
        table,
        patient: patient.id.clone(),
        name: name.to_owned(),
        lower,
        upper,
    })
}

fn seeds<'a>(
    patient: &'a ResolvedPatient,
    spec: &'a RobustnessSpec,
) -> impl Iterator<Item = Member> + 'a {
    (1..=spec.n_seeds).map(|number| {
        let seed = patient.settings.step2.seed.wrapping_add(u64::from(number));
        let inputs = BTreeMap::from([(SEED.to_owned(), seed as f64)]);
        let mut member = member(
            patient,
            MemberRole::Seed,
            suffix('s', number as usize, spec.n_seeds),
            inputs,
        );
        member.plan.settings.step2.seed = seed;
        member
    })
}
