//! Settings of step 3, "in the organ": parameters that may move, their bounds, and the precision
//! required of the biomarkers.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarker, Biomarkers};
use crate::cell::cell_intervals;
use crate::organ::{VALVE_PARAMETERS, ValveParameters, cell_default};
use crate::samples::{MeasuredTraces, TraceDeviations};
use crate::step0::PassiveStateResult;

/// Step 3: adjusts parameters of the cell model and of the valves until the organ with that cell
/// agrees with the measured biomarkers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Step3Settings {
    /// Largest number of simulations in addition to the verification beat.
    #[schemars(range(min = 0, max = 100))]
    pub max_iterations: u32,
    /// Names of the parameters that may vary: of the cell and of the valves
    /// (`R_AV_f_mmHg_s_per_mL`, `R_MV_f_mmHg_s_per_mL`). Each needs bounds.
    pub parameters: Vec<String>,
    /// Bounds: lower, upper. The prior of the logarithm is centred at the model's default; its
    /// standard deviation is three quarters of the interval between the logarithms of the bounds.
    pub bounds: BTreeMap<String, [f64; 2]>,
    /// Standard deviation of each measured biomarker, percent of its value. A biomarker without an
    /// entry does not count.
    #[schemars(extend("additionalProperties" = { "type": "number", "exclusiveMinimum": 0.0, "maximum": 1e3 }))]
    pub uncertainty_percent: BTreeMap<String, f64>,
    /// Standard deviations of the difference between simulated and measured traces.
    pub trace_deviations: TraceDeviations,
}

/// A parameter of step 3. The logarithm of its magnitude varies within bounds and has a normal
/// prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct MovedParameter {
    /// Smallest value, in the unit of the name.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Value at the centre of the prior.
    pub centre: f64,
    /// Standard deviation of the logarithm in the prior.
    pub log_sd: f64,
}

/// Standard deviation of the prior over the interval of the logarithms. Within the bounds the prior
/// selects among cells with equal misfit, and has hardly any other effect.
const PRIOR_SHARE: f64 = 0.75;

impl Default for Step3Settings {
    fn default() -> Self {
        // Table A5, wider where an organ needs it: Smax_ref, TRPN50 and gamma_S. beta_0 is
        // excluded, because its effect in the one-fibre ventricle differs from that in 3D
        // (docs/step3.md). The bounds of the valves enclose those of Table A6.
        let wider = |key, interval| match key {
            "Smax_ref_kPa" => [40.0, 400.0],
            "TRPN50" => [0.2, 0.5],
            "gamma_S_per_ms" => [0.003, 0.03],
            _ => interval,
        };
        let of_cell = cell_intervals()
            .filter(|(key, _)| *key != "beta_0")
            .map(|(key, interval)| (key, wider(key, interval)));
        let of_valves = VALVE_PARAMETERS.map(|key| (key, [1e-3, 0.1]));
        let bounds: Vec<(&str, [f64; 2])> = of_cell.chain(of_valves).collect();
        Self {
            max_iterations: 4,
            parameters: bounds.iter().map(|(name, _)| (*name).to_owned()).collect(),
            bounds: bounds
                .into_iter()
                .map(|(name, range)| (name.to_owned(), range))
                .collect(),
            uncertainty_percent: [
                (Biomarker::PMax, 1.0),
                (Biomarker::DpdtMax, 3.0),
                (Biomarker::DpdtMin, 3.0),
                (Biomarker::Ptd90, 0.6),
                (Biomarker::TauVd, 10.0),
                (Biomarker::TauVr, 10.0),
                (Biomarker::Sv, 1.0),
            ]
            .map(|(biomarker, percent)| (biomarker.key().to_owned(), percent))
            .into(),
            trace_deviations: TraceDeviations::default(),
        }
    }
}

impl Step3Settings {
    /// Parameters that move, centred on the model's defaults; valves are centred on those of the
    /// verification beat.
    #[must_use]
    pub fn moved(&self, valves: &ValveParameters) -> BTreeMap<String, MovedParameter> {
        let mut valves = *valves;
        let mut centre = |name: &str| {
            valves
                .named_mut(name)
                .copied()
                .or_else(|| cell_default(name))
        };
        let moved = |name: &String| -> Option<(String, MovedParameter)> {
            let [lower, upper] = *self.bounds.get(name)?;
            let log_sd = PRIOR_SHARE * (upper / lower).ln().abs();
            Some((
                name.clone(),
                MovedParameter {
                    lower,
                    upper,
                    centre: centre(name)?,
                    log_sd,
                },
            ))
        };
        self.parameters.iter().filter_map(moved).collect()
    }

    /// Values that the moving parameters have in a beat.
    ///
    /// - `cell`: parameters that differ from the model's defaults
    #[must_use]
    pub fn values(
        &self,
        cell: Option<&BTreeMap<String, f64>>,
        valves: &ValveParameters,
    ) -> BTreeMap<String, f64> {
        let value = |name: &String| {
            let of_cell = cell.and_then(|cell| cell.get(name).copied());
            let default = self.moved(valves).get(name).map(|moved| moved.centre);
            Some((name.clone(), of_cell.or(default)?))
        };
        self.parameters.iter().filter_map(value).collect()
    }
}

impl Step3Settings {
    /// Measured traces; `None` without any, or if no trace counts.
    #[must_use]
    pub fn traces(
        &self,
        step0: &PassiveStateResult,
        cycle_length_ms: f64,
    ) -> Option<MeasuredTraces> {
        let (samples, deviations) = (step0.samples.clone(), self.trace_deviations);
        let traces = MeasuredTraces {
            samples,
            deviations,
            cycle_length_ms,
        };
        (traces.n_measured() > 0.0).then_some(traces)
    }

    /// Number of independent data: measured biomarkers that count, plus the content of `traces`.
    #[must_use]
    pub fn n_measured(&self, measured: &Biomarkers, traces: Option<&MeasuredTraces>) -> f64 {
        let counts = |(biomarker, value): &(Biomarker, Option<f64>)| {
            value.is_some() && self.uncertainty_percent.contains_key(biomarker.key())
        };
        let biomarkers = measured
            .of_organ()
            .iter()
            .filter(|named| counts(named))
            .count();
        biomarkers as f64 + traces.map_or(0.0, MeasuredTraces::n_measured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_can_move_within_bounds_that_hold_the_models_defaults() {
        let settings = Step3Settings::default();
        let moved = settings.moved(&ValveParameters::default());
        assert_eq!(moved.len(), settings.parameters.len());
        for (name, p) in moved {
            assert!(
                crate::organ::is_parameter(&name) && p.lower < p.upper && p.log_sd > 0.0,
                "{name}"
            );
            assert!(
                p.lower <= p.centre && p.centre <= p.upper && p.lower * p.upper > 0.0,
                "{name}: {p:?}"
            );
        }
    }
}
