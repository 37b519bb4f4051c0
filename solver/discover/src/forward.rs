//! Interface between the search and a model: parameters, candidates and the predicted beat.

use crate::parameter::Parameter;
use cardiotwin_models::periodic::Orbit;
use cardiotwin_vocabulary::findings::InThreeDimensions;
use cardiotwin_vocabulary::measurements::FurtherQuantity;

/// A beat as it would be measured, on a uniform periodic grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Prediction {
    /// Interval of the grid \[ms\]; the first sample is at time zero.
    pub step_ms: f64,
    /// Pressure as the catheter would measure it \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Volume as segmentation would measure it \[mL\].
    pub volume_ml: Vec<f64>,
    /// Volume of the simulated cavity, without artefacts of measurement \[mL\].
    pub true_volume_ml: Vec<f64>,
    /// Pressure of the simulated cavity, without artefacts of measurement \[mmHg\].
    pub true_pressure_mmhg: Vec<f64>,
    /// Flow through the aortic valve \[mL/s\].
    pub aortic_flow_ml_per_s: Vec<f64>,
    /// Flow through the mitral valve \[mL/s\], less what leaks back.
    pub mitral_flow_ml_per_s: Vec<f64>,
    /// Pressure of the aorta \[mmHg\].
    pub aortic_pressure_mmhg: Vec<f64>,
    /// Pressure of the left atrium \[mmHg\], with what it gains and loses by flow.
    pub atrial_pressure_mmhg: Vec<f64>,
    /// Strain of the whole wall since time zero \[%\].
    pub strain_percent: Vec<f64>,
    /// Times at which aortic and mitral valve open and close \[ms\], in the order of
    /// [`crate::further::ValveTimes::NAMES`]; `None` if a valve never opens or closes.
    pub valve_times_ms: Option<[f64; 4]>,
    /// Duration of QRS \[ms\].
    pub qrs_ms: f64,
    /// Beats of the same heart under the loads of the data.
    pub loaded: Vec<LoadedPrediction>,
    /// Largest aortic pressure \[mmHg\].
    pub systolic_mmhg: f64,
    /// Smallest aortic pressure \[mmHg\].
    pub diastolic_mmhg: f64,
    /// Net volume that leaves through the aortic valve in a beat \[mL\].
    pub forward_stroke_volume_ml: f64,
    /// Start of the search for similar periodic beats.
    pub warm: Orbits,
}

/// A beat under changed load as it would be measured, on a uniform periodic grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadedPrediction {
    /// Interval of the grid \[ms\]; the first sample is at time zero.
    pub step_ms: f64,
    /// Pressure as the catheter would measure it \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Volume as segmentation would measure it \[mL\].
    pub volume_ml: Vec<f64>,
}

impl LoadedPrediction {
    /// A trace of this beat at some times \[ms\].
    #[must_use]
    pub fn sampled(&self, trace: &[f64], time_ms: &[f64]) -> Vec<f64> {
        time_ms
            .iter()
            .map(|t| trace_at(trace, self.step_ms, *t))
            .collect()
    }
}

/// Orbits near which the beats of similar parameters are sought.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Orbits {
    /// Orbit of the steady beat.
    pub steady: Orbit,
    /// Orbit of each beat under changed load.
    pub loaded: Vec<Orbit>,
}

/// A periodic trace at any time: linear between samples.
#[must_use]
pub fn trace_at(trace: &[f64], step_ms: f64, time_ms: f64) -> f64 {
    let n = trace.len();
    let x = (time_ms / step_ms).rem_euclid(n as f64);
    let i = (x as usize).min(n - 1);
    let f = x - i as f64;
    trace[i] * (1.0 - f) + trace[if i + 1 == n { 0 } else { i + 1 }] * f
}

impl Prediction {
    /// A trace of this beat at some times \[ms\].
    #[must_use]
    pub fn sampled(&self, trace: &[f64], time_ms: &[f64]) -> Vec<f64> {
        time_ms.iter().map(|t| self.at(trace, *t)).collect()
    }

    /// A trace of this beat at any time: linear between samples, periodic.
    #[must_use]
    pub fn at(&self, trace: &[f64], time_ms: f64) -> f64 {
        trace_at(trace, self.step_ms, time_ms)
    }

    /// Trace of a further quantity.
    #[must_use]
    pub fn further(&self, quantity: FurtherQuantity) -> &[f64] {
        match quantity {
            FurtherQuantity::AorticPressure => &self.aortic_pressure_mmhg,
            FurtherQuantity::AorticFlow => &self.aortic_flow_ml_per_s,
            FurtherQuantity::MitralFlow => &self.mitral_flow_ml_per_s,
            FurtherQuantity::AtrialPressure => &self.atrial_pressure_mmhg,
            FurtherQuantity::Strain => &self.strain_percent,
        }
    }
}

/// A named effect as seen by the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Name in the catalogue.
    pub name: String,
    /// Whether the effect belongs to the measurement rather than to the heart.
    pub artefact: bool,
    /// Fitted parameters, the strength first. The prior mean of the strength is its off-value.
    pub parameters: Vec<Parameter>,
    /// Meaning of the effect, in one sentence.
    pub meaning: String,
    /// Transfer of the effect to the three-dimensional ventricle.
    pub in_3d: InThreeDimensions,
    /// Remedy for an artefact.
    pub remedy: Option<String>,
    /// Strength at which the effect vanishes.
    pub off: f64,
    /// Distance of the strength from its off-value below which it is not named.
    pub smallest: f64,
    /// Values from which fits start.
    pub starts: Vec<Vec<f64>>,
    /// Candidates with similar traces.
    pub confused_with: Vec<String>,
    /// Measurements that would distinguish it from those.
    pub separated_by: Vec<String>,
    /// Twice the logarithm of its prior odds against the others, which decide between candidates
    /// that the data cannot distinguish.
    pub log_prior: f64,
    /// Side data without which the effect cannot be seen.
    pub hidden_because: Option<String>,
}

/// Input of a prediction: base values, candidates with their values, and the nameless bumps of the
/// activation.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// Values of the base parameters.
    pub base: &'a [f64],
    /// Candidates by index, with their values.
    pub terms: &'a [(usize, &'a [f64])],
    /// Logarithms of the activation's factors, at equal distances over the contraction; empty
    /// without bumps.
    pub bumps: &'a [f64],
}

/// A model with a catalogue of effects.
pub trait Forward: Sync {
    /// Base parameters with priors.
    fn base(&self) -> &[Parameter];
    /// Further starts of the base fit besides the prior mean, in z.
    fn base_starts(&self) -> Vec<Vec<f64>>;
    /// Effects that the search may add.
    fn candidates(&self) -> &[Candidate];
    /// The periodic beat; `None` if the model has none for these values.
    fn predict(&self, request: &Request<'_>, warm: Option<&Orbits>) -> Option<Prediction>;
}
