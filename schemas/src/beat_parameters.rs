//! Parameters of a reduced beat by name, as optimisers and sweeps of a caller move them.

use crate::organ::{CELL_PARAMETERS, ContractionSpec, OrganSpec, cell_default};
use crate::organ_beat::OrganBeatSpec;

macro_rules! places {
    ($spec:ident: $($key:literal => $place:expr;)*) => {
        /// Names of the parameters that a beat of any contraction model has, with their units.
        pub const BEAT_PARAMETERS: [&str; [$($key),*].len()] = [$($key),*];

        /// Place of a parameter outside of a map; `None` for another name, or in another model.
        fn place<'a>($spec: &'a mut OrganBeatSpec, name: &str) -> Option<&'a mut f64> {
            match name {
                $($key => Some($place),)*
                _ => in_model($spec, name),
            }
        }
    };
}

places! { spec:
    "cycle_length_ms" => &mut spec.cycle_length_ms;
    "left_atrial_pressure_mmHg" => &mut spec.circulation.left_atrial_pressure_mmhg;
    "initial_windkessel_pressure_mmHg" => &mut spec.circulation.initial_windkessel_pressure_mmhg;
    "characteristic_resistance_mmHg_s_per_mL" => &mut spec.circulation.afterload.characteristic_resistance_mmhg_s_per_ml;
    "peripheral_resistance_mmHg_s_per_mL" => &mut spec.circulation.afterload.peripheral_resistance_mmhg_s_per_ml;
    "compliance_mL_per_mmHg" => &mut spec.circulation.afterload.compliance_ml_per_mmhg;
    "R_AV_f_mmHg_s_per_mL" => &mut spec.valves.r_av_f_mmhg_s_per_ml;
    "R_MV_f_mmHg_s_per_mL" => &mut spec.valves.r_mv_f_mmhg_s_per_ml;
    "R_b_mmHg_s_per_mL" => &mut spec.valves.r_b_mmhg_s_per_ml;
}

/// Names of the parameters of a one-fibre ventricle.
const ONE_FIBRE: [&str; 8] = [
    "wall_volume_mL",
    "unloaded_volume_mL",
    "end_diastolic_volume_mL",
    "end_diastolic_pressure_mmHg",
    "stiffness_kPa",
    "exponent",
    "spread_ms",
    "onset_ms",
];
/// Names of the parameters of Tanh.
const TANH: [&str; 8] = [
    "Smax_ref_kPa",
    "tau_SR_ref_ms",
    "tau_SD_ms",
    "t_CR_ms",
    "a4_ms",
    "t_emd_ms",
    "a6",
    "a7",
];

fn in_model<'a>(spec: &'a mut OrganBeatSpec, name: &str) -> Option<&'a mut f64> {
    if let (
        OrganSpec::Reduced {
            passive,
            activation,
        },
        true,
    ) = (&mut spec.organ, ONE_FIBRE.contains(&name))
    {
        return match name {
            "wall_volume_mL" => Some(&mut passive.wall_volume_ml),
            "unloaded_volume_mL" => Some(&mut passive.unloaded_volume_ml),
            "end_diastolic_volume_mL" => Some(&mut passive.end_diastolic_volume_ml),
            "end_diastolic_pressure_mmHg" => Some(&mut passive.end_diastolic_pressure_mmhg),
            "stiffness_kPa" => Some(&mut passive.stiffness_kpa),
            "exponent" => Some(&mut passive.exponent),
            "spread_ms" => Some(&mut activation.spread_ms),
            "onset_ms" => Some(&mut activation.onset_ms),
            _ => None,
        };
    }
    match &mut spec.contraction {
        ContractionSpec::Tanh { parameters } => match name {
            "Smax_ref_kPa" => Some(&mut parameters.smax_ref_kpa),
            "tau_SR_ref_ms" => Some(&mut parameters.tau_sr_ref_ms),
            "tau_SD_ms" => Some(&mut parameters.tau_sd_ms),
            "t_CR_ms" => Some(&mut parameters.t_cr_ms),
            "a4_ms" => Some(&mut parameters.a4_ms),
            "t_emd_ms" => Some(&mut parameters.t_emd_ms),
            "a6" => Some(&mut parameters.a6),
            "a7" => Some(&mut parameters.a7),
            _ => None,
        },
        ContractionSpec::Land2017Rice { lambda_0, .. }
        | ContractionSpec::Land2017Trace { lambda_0, .. } => {
            (name == "lambda_0").then_some(lambda_0)
        }
        ContractionSpec::Catalogue { .. } => None,
    }
}

impl OrganBeatSpec {
    /// Names of the parameters that [`Self::set_parameter`] takes, with their units: loads and
    /// valves, the one-fibre ventricle's, then those of the contraction model. Of a model of the
    /// catalogue only parameters are known that the specification states.
    #[must_use]
    pub fn parameter_names(&self) -> Vec<&str> {
        let one_fibre = matches!(self.organ, OrganSpec::Reduced { .. });
        let ventricle: &[&str] = if one_fibre { &ONE_FIBRE } else { &[] };
        let mut names: Vec<&str> = BEAT_PARAMETERS.iter().chain(ventricle).copied().collect();
        match &self.contraction {
            ContractionSpec::Tanh { .. } => names.extend(TANH),
            ContractionSpec::Land2017Rice { .. } | ContractionSpec::Land2017Trace { .. } => {
                for name in of_cell() {
                    names.push(name);
                }
                names.push("lambda_0");
            }
            ContractionSpec::Catalogue { parameters, .. } => {
                names.extend(parameters.keys().map(String::as_str));
            }
        }
        names
    }

    /// Value of a parameter in the unit of its name; `None` for an unknown name.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<f64> {
        let stated = match &self.contraction {
            ContractionSpec::Tanh { .. } => None,
            ContractionSpec::Catalogue { parameters, .. } => parameters.get(name).copied(),
            ContractionSpec::Land2017Rice { parameters, .. }
            | ContractionSpec::Land2017Trace { parameters, .. } => of_cell()
                .any(|known| known == name)
                .then(|| parameters.get(name).copied().or_else(|| cell_default(name)))
                .flatten(),
        };
        stated.or_else(|| place(&mut self.clone(), name).map(|value| *value))
    }

    /// Sets a parameter, in the unit of its name. Returns `false` for an unknown name.
    #[must_use]
    pub fn set_parameter(&mut self, name: &str, value: f64) -> bool {
        if let Some(place) = place(self, name) {
            *place = value;
            return true;
        }
        match &mut self.contraction {
            ContractionSpec::Tanh { .. } => false,
            ContractionSpec::Land2017Rice { parameters, .. }
            | ContractionSpec::Land2017Trace { parameters, .. } => {
                let known = of_cell().any(|known| known == name);
                if known {
                    parameters.insert(name.to_owned(), value);
                }
                known
            }
            ContractionSpec::Catalogue { parameters, .. } => parameters
                .get_mut(name)
                .map(|place| *place = value)
                .is_some(),
        }
    }
}

/// Parameters of the cell in an organ, which has a passive stress of its own.
fn of_cell() -> impl Iterator<Item = &'static str> {
    CELL_PARAMETERS
        .into_iter()
        .filter(|name| *name != "a_p_kPa")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn beat(contraction: serde_json::Value) -> OrganBeatSpec {
        serde_json::from_value(serde_json::json!({
            "cycle_length_ms": 700.0, "time_step_ms": 1.0, "shortest_step_ms": 0.015625, "newton_iterations": 60,
            "organ": {"fidelity": "reduced",
                "passive": {"wall_volume_mL": 90.0, "unloaded_volume_mL": 60.0, "end_diastolic_volume_mL": 120.0,
                            "end_diastolic_pressure_mmHg": 9.0, "stiffness_kPa": 0.5, "exponent": 9.24},
                "activation": {"spread_ms": 40.0, "groups": 16, "onset_ms": 20.0}},
            "circulation": {"afterload": {"characteristic_resistance_mmHg_s_per_mL": 0.03,
                "peripheral_resistance_mmHg_s_per_mL": 0.9, "compliance_mL_per_mmHg": 1.2},
                "initial_windkessel_pressure_mmHg": 70.0, "left_atrial_pressure_mmHg": 7.0},
            "valves": {}, "contraction": contraction,
            "beats": {"mode": "fixed", "n": 1}, "measured_end_diastolic_volume_mL": 120.0
        }))
        .unwrap()
    }

    fn beats() -> [OrganBeatSpec; 3] {
        [
            beat(serde_json::json!({"model": "tanh", "parameters": {}})),
            beat(
                serde_json::json!({"model": "land2017-rice", "parameters": {"phi": 2.0}, "lambda_0": 1.1}),
            ),
            beat(
                serde_json::json!({"model": "catalogue", "name": "x", "parameters": {"S_kPa": 2.0}}),
            ),
        ]
    }

    #[test]
    fn every_name_has_a_place_of_its_own() {
        for spec in beats() {
            let names: Vec<String> = spec
                .parameter_names()
                .into_iter()
                .map(str::to_owned)
                .collect();
            let mut moved = spec.clone();
            for (idx, name) in names.iter().enumerate() {
                assert!(spec.parameter(name).is_some(), "{name}");
                assert!(moved.set_parameter(name, 1000.0 + idx as f64), "{name}");
            }
            for (idx, name) in names.iter().enumerate() {
                assert_eq!(moved.parameter(name), Some(1000.0 + idx as f64), "{name}");
            }
        }
    }

    #[test]
    fn every_number_of_a_beat_but_those_of_its_solution_has_a_name() {
        fn numbers(value: &serde_json::Value, into: &mut BTreeSet<String>) {
            for (key, inner) in value.as_object().into_iter().flatten() {
                if inner.is_f64() {
                    into.insert(key.clone());
                }
                numbers(inner, into);
            }
        }
        for spec in beats() {
            let mut found = BTreeSet::new();
            numbers(&serde_json::to_value(&spec).unwrap(), &mut found);
            for of_solution in [
                "time_step_ms",
                "shortest_step_ms",
                "measured_end_diastolic_volume_mL",
                "slack_stretch",
            ] {
                assert!(found.remove(of_solution), "{of_solution}");
            }
            let named: BTreeSet<String> = spec
                .parameter_names()
                .into_iter()
                .map(str::to_owned)
                .collect();
            assert!(found.is_subset(&named), "{:?}", found.difference(&named));
        }
    }

    #[test]
    fn an_unknown_name_changes_nothing() {
        for spec in beats() {
            for name in ["Smax_ref", "a_p_kPa", "groups"] {
                let mut same = spec.clone();
                assert!(!same.set_parameter(name, 1.0) && same == spec, "{name}");
                assert_eq!(spec.parameter(name), None, "{name}");
            }
        }
    }
}
