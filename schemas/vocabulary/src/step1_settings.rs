//! Settings of step 1, with their defaults (SPEC section 5).

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarker_noise;
use crate::step1::{Step1Parameter, Step1Parameters, TanhParameters, ValveParameters};

/// Condition that ends step 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StopRule {
    /// With the fixed point like `first-converged`. Space mapping continues though the tolerance is
    /// met while another simulation is predicted to lower the misfit by a fifth or more.
    Auto,
    /// Stop at the first iterate with a cost within the tolerance (the paper's rule).
    FirstConverged,
    /// Stop after `max_iterations`, a stall or a failure, and take the best iterate.
    BestOfLimit,
}

/// Method of step 1 to find the next parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Update {
    /// Space mapping for the finite-element ventricle; the fixed point for the reduced ventricle,
    /// which is the surrogate of space mapping itself.
    #[default]
    Auto,
    /// The paper's method: each parameter is multiplied by the ratio of one biomarker.
    FixedPoint,
    /// The one-fibre ventricle, corrected to the simulations so far, predicts the best parameters.
    SpaceMapping,
}

/// Settings of step 1 (SPEC section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Step1Settings {
    /// Method to find the next parameters.
    pub update: Update,
    /// Cost at or below which step 1 has converged.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub tolerance: f64,
    /// Largest number of simulations.
    #[schemars(range(min = 1, max = 10_000))]
    pub max_iterations: u32,
    /// Exponent of every update ratio of the fixed point. 1 is the paper's value; a smaller value
    /// damps the updates.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1.0))]
    pub damping: f64,
    /// Condition that ends the iterations.
    pub stop: StopRule,
    /// Number of consecutive iterations without improvement after which the loop ends.
    #[schemars(range(min = 1, max = 10_000))]
    pub stall_iterations: u32,
    /// Smallest relative fall of the best cost that counts as an improvement.
    #[schemars(extend("minimum" = 0.0, "exclusiveMaximum" = 1.0))]
    pub stall_improvement: f64,
    /// Parameters that stay at their initial value: keys of `bounds`.
    pub frozen: Vec<String>,
    /// Weights of the biomarkers' squared relative differences in the misfit that space mapping
    /// minimises and by which it chooses the best iteration. Keys: `P_max_mmHg`,
    /// `dPdt_max_mmHg_per_ms`, `dPdt_min_mmHg_per_ms`, `PTD90_ms`, `tau_VD_ms`, `tau_VR_ms`,
    /// `SV_mL`. The defaults are (1 %/σ)², where σ is the error caused by clinical noise
    /// (docs/step1.md). The cost does not use these weights: there the weight of `SV_mL` is 0 and
    /// every other weight is 1.
    #[schemars(extend("additionalProperties" = { "type": "number", "minimum": 0.0, "maximum": 1e6 }))]
    pub weights: BTreeMap<String, f64>,
    /// Initial guess of the Tanh model.
    pub initial: TanhParameters,
    /// Initial guess of the valves.
    pub valves: ValveParameters,
    /// Bounds of the updated parameters: lower, upper. Keys: `Smax_ref_kPa`, `tau_SR_ref_ms`,
    /// `tau_SD_ms`, `t_CR_ms`, `R_AV_f_mmHg_s_per_mL`, `R_MV_f_mmHg_s_per_mL`.
    pub bounds: BTreeMap<String, [f64; 2]>,
}

impl Default for Step1Settings {
    fn default() -> Self {
        Self {
            update: Update::default(),
            tolerance: 0.1,
            max_iterations: 10,
            damping: 1.0,
            stop: StopRule::Auto,
            stall_iterations: 3,
            stall_improvement: 0.05,
            frozen: Vec::new(),
            weights: biomarker_noise::weights(),
            initial: TanhParameters::default(),
            valves: ValveParameters::default(),
            bounds: Step1Parameter::ALL
                .map(|parameter| (parameter.key().to_owned(), parameter.default_bounds()))
                .into(),
        }
    }
}

/// Interval that a parameter may take, both ends included, in the unit of the parameter's key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest value that the parameter may take.
    pub lower: f64,
    /// Largest value that the parameter may take.
    pub upper: f64,
}

impl Bounds {
    /// Whether a value lies inside, ends included up to rounding.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        value >= self.lower * (1.0 - 1e-12) && value <= self.upper * (1.0 + 1e-12)
    }

    /// Whether a value lies on one of the ends, up to rounding.
    #[must_use]
    pub fn at_end(&self, value: f64) -> bool {
        value <= self.lower * (1.0 + 1e-9) || value >= self.upper * (1.0 - 1e-9)
    }
}

impl Step1Settings {
    /// Parameters of Tanh model and valves for the first simulation.
    #[must_use]
    pub fn start(&self) -> Step1Parameters {
        Step1Parameters {
            tanh: self.initial,
            valves: self.valves,
        }
    }

    /// Interval of a parameter; the default one if the settings do not name it.
    #[must_use]
    pub fn bounds_of(&self, parameter: Step1Parameter) -> Bounds {
        let given = self.bounds.get(parameter.key()).copied();
        let [lower, upper] = given.unwrap_or_else(|| parameter.default_bounds());
        Bounds { lower, upper }
    }

    /// Parameters that may move.
    pub fn moving(&self) -> impl Iterator<Item = Step1Parameter> {
        Step1Parameter::ALL
            .into_iter()
            .filter(|parameter| !self.is_frozen(*parameter))
    }

    /// Whether a parameter keeps its value.
    #[must_use]
    pub fn is_frozen(&self, parameter: Step1Parameter) -> bool {
        self.frozen.iter().any(|name| name == parameter.key())
    }

    /// Whether all parameters that may move lie within their bounds.
    #[must_use]
    pub fn admits(&self, parameters: &Step1Parameters) -> bool {
        self.moving()
            .all(|p| self.bounds_of(p).contains(parameters.get(p)))
    }

    /// Clamps parameters to their bounds; frozen ones keep their value.
    #[must_use]
    pub fn clamp(&self, parameters: &Step1Parameters) -> Step1Parameters {
        self.moving().fold(*parameters, |inside, p| {
            let bounds = self.bounds_of(p);
            inside.with(p, parameters.get(p).clamp(bounds.lower, bounds.upper))
        })
    }
}
