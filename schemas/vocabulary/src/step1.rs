//! Parameters of step 1: the Tanh active stress and the valves; step 1 updates six of them.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::label::Label;

/// Tanh active stress (Jung et al. 2022, eqs. A1-A3).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct TanhParameters {
    /// Peak isometric stress.
    #[serde(rename = "Smax_ref_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub smax_ref_kpa: f64,
    /// Time constant of the stress rise.
    #[serde(rename = "tau_SR_ref_ms")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e4))]
    pub tau_sr_ref_ms: f64,
    /// Time constant of the stress decay.
    #[serde(rename = "tau_SD_ms")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e4))]
    pub tau_sd_ms: f64,
    /// Duration of the stress transient.
    #[serde(rename = "t_CR_ms")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e4))]
    pub t_cr_ms: f64,
    /// Stretch dependence of the time constant of the rise.
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e5))]
    pub a4_ms: f64,
    /// Electromechanical delay.
    #[schemars(extend("minimum" = 0.0, "maximum" = 300.0))]
    pub t_emd_ms: f64,
    /// Slope of the stretch dependence.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub a6: f64,
    /// Stretch at which the stress is zero.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1.5))]
    pub a7: f64,
}

impl Default for TanhParameters {
    /// Values of Table A1 of Jung et al. 2022.
    fn default() -> Self {
        Self {
            smax_ref_kpa: 100.0,
            tau_sr_ref_ms: 40.0,
            tau_sd_ms: 110.0,
            t_cr_ms: 550.0,
            a4_ms: 500.0,
            t_emd_ms: 15.0,
            a6: 5.0,
            a7: 0.7,
        }
    }
}

/// Forward and backward resistances of the diode valves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct ValveParameters {
    /// Forward resistance of the aortic valve.
    #[serde(rename = "R_AV_f_mmHg_s_per_mL")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub r_av_f_mmhg_s_per_ml: f64,
    /// Forward resistance of the mitral valve.
    #[serde(rename = "R_MV_f_mmHg_s_per_mL")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub r_mv_f_mmhg_s_per_ml: f64,
    /// Backward resistance of both valves.
    #[serde(rename = "R_b_mmHg_s_per_mL")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e9))]
    pub r_b_mmhg_s_per_ml: f64,
}

/// Names of the valves' forward resistances.
pub const VALVE_PARAMETERS: [&str; 2] = ["R_AV_f_mmHg_s_per_mL", "R_MV_f_mmHg_s_per_mL"];

impl ValveParameters {
    /// Mutable value of one of [`VALVE_PARAMETERS`]; `None` for another name.
    pub fn named_mut(&mut self, name: &str) -> Option<&mut f64> {
        match name {
            "R_AV_f_mmHg_s_per_mL" => Some(&mut self.r_av_f_mmhg_s_per_ml),
            "R_MV_f_mmHg_s_per_mL" => Some(&mut self.r_mv_f_mmhg_s_per_ml),
            _ => None,
        }
    }

    /// The same valves with other values for the names in `parameters`.
    #[must_use]
    pub fn with(mut self, parameters: &BTreeMap<String, f64>) -> Self {
        for (name, value) in parameters {
            if let Some(place) = self.named_mut(name) {
                *place = *value;
            }
        }
        self
    }
}

impl Default for ValveParameters {
    fn default() -> Self {
        Self {
            r_av_f_mmhg_s_per_ml: 0.01,
            r_mv_f_mmhg_s_per_ml: 0.01,
            r_b_mmhg_s_per_ml: 1000.0,
        }
    }
}

/// Parameters that step 1 personalises: the Tanh model and the valves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Step1Parameters {
    /// Parameters of the active stress.
    pub tanh: TanhParameters,
    /// Resistances of the valves.
    pub valves: ValveParameters,
}

macro_rules! updated {
    ($($(#[doc = $doc:literal])* $variant:ident, $($field:ident).+, $key:literal, $default_bounds:expr,
       $symbol:literal, $subscript:literal, $unit:literal, $meaning:literal;)*) => {
        /// Name of one parameter that step 1 updates.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum Step1Parameter {
            $($(#[doc = $doc])* #[serde(rename = $key)] $variant,)*
        }

        impl Step1Parameter {
            /// All updated parameters, in the order of eqs. 13 and 15 and of Table A6 of Jung et al. 2022.
            pub const ALL: [Self; [$($key),*].len()] = [$(Self::$variant),*];
            /// Keys of the updated parameters, in the same order.
            pub const KEYS: [&'static str; Self::ALL.len()] = [$($key),*];

            /// Key with its unit, as in files.
            #[must_use]
            pub const fn key(self) -> &'static str {
                match self { $(Self::$variant => $key,)* }
            }

            /// Symbol, unit and meaning.
            #[must_use]
            pub const fn label(self) -> Label {
                match self { $(Self::$variant => Label {
                    key: $key, symbol: $symbol, subscript: $subscript, unit: $unit, meaning: $meaning,
                },)* }
            }

            /// Default bounds, lower and upper, in the unit of the key: too wide to bind in a sane fit. The floors of the
            /// resistances come from Table A6.
            #[must_use]
            pub const fn default_bounds(self) -> [f64; 2] {
                match self { $(Self::$variant => $default_bounds,)* }
            }
        }

        impl Step1Parameters {
            /// Value of one updated parameter, in the unit of its key.
            #[must_use]
            pub const fn get(&self, parameter: Step1Parameter) -> f64 {
                match parameter { $(Step1Parameter::$variant => self.$($field).+,)* }
            }

            /// Sets one updated parameter, in the unit of its key.
            pub const fn set(&mut self, parameter: Step1Parameter, value: f64) {
                match parameter { $(Step1Parameter::$variant => self.$($field).+ = value,)* }
            }
        }
    };
}

updated! {
    // variant, field, key in files, default bounds, symbol, subscript, unit, meaning;
    /// Largest active stress of Tanh, kPa.
    SmaxRef, tanh.smax_ref_kpa, "Smax_ref_kPa", [1.0, 2000.0], "S", "max,ref", "kPa", "peak isometric stress";
    /// Rise time constant of Tanh, ms.
    TauSrRef, tanh.tau_sr_ref_ms, "tau_SR_ref_ms", [0.05, 1000.0], "τ", "SR,ref", "ms", "time constant of the stress rise";
    /// Decay time constant of Tanh, ms.
    TauSd, tanh.tau_sd_ms, "tau_SD_ms", [0.5, 2000.0], "τ", "SD", "ms", "time constant of the stress decay";
    /// Duration of Tanh's contraction, ms.
    TCr, tanh.t_cr_ms, "t_CR_ms", [20.0, 3000.0], "t", "CR", "ms", "duration of the stress transient";
    /// Forward resistance of the aortic valve, mmHg·s/mL.
    RAvF, valves.r_av_f_mmhg_s_per_ml, "R_AV_f_mmHg_s_per_mL", [1e-4, 1.0], "R", "AV,f", "mmHg·s/mL", "forward resistance of the aortic valve";
    /// Forward resistance of the mitral valve, mmHg·s/mL.
    RMvF, valves.r_mv_f_mmhg_s_per_ml, "R_MV_f_mmHg_s_per_mL", [1e-4, 1.0], "R", "MV,f", "mmHg·s/mL", "forward resistance of the mitral valve";
}

impl Step1Parameter {
    /// The parameter with this key.
    #[must_use]
    pub fn named(key: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|parameter| parameter.key() == key)
    }
}

impl std::fmt::Display for Step1Parameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.key())
    }
}

impl Step1Parameters {
    /// Values of the updated six, in the order of [`Step1Parameter::ALL`].
    #[must_use]
    pub fn updated(&self) -> [f64; Step1Parameter::ALL.len()] {
        Step1Parameter::ALL.map(|parameter| self.get(parameter))
    }

    /// The same parameters with other values of the updated six, in the order of [`Step1Parameter::ALL`].
    #[must_use]
    pub fn with_updated(mut self, values: [f64; Step1Parameter::ALL.len()]) -> Self {
        for (parameter, value) in Step1Parameter::ALL.into_iter().zip(values) {
            self.set(parameter, value);
        }
        self
    }

    /// The same parameters with another value of one updated parameter, in the unit of its key.
    #[must_use]
    pub const fn with(mut self, parameter: Step1Parameter, value: f64) -> Self {
        self.set(parameter, value);
        self
    }

    /// Whether both describe the same simulation: every updated value is equal to nine digits.
    #[must_use]
    pub fn same_as(&self, other: &Self) -> bool {
        self.close_to(other, 1e-9)
    }

    /// Whether every updated value is equal up to this relative difference.
    #[must_use]
    pub fn close_to(&self, other: &Self, share: f64) -> bool {
        Step1Parameter::ALL
            .into_iter()
            .all(|p| (self.get(p) - other.get(p)).abs() <= share * self.get(p).abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_updated_parameter_has_a_place_of_its_own() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let moved = Step1Parameters::default().with_updated(values);
        assert_eq!(moved.updated(), values);
        let written = serde_json::to_value(moved).unwrap();
        for (parameter, value) in Step1Parameter::ALL.into_iter().zip(values) {
            let found = [&written["tanh"], &written["valves"]]
                .into_iter()
                .find_map(|part| part.get(parameter.key()));
            assert_eq!(found, Some(&value.into()), "{parameter}");
            assert_eq!(Step1Parameter::named(parameter.key()), Some(parameter));
        }
    }
}
