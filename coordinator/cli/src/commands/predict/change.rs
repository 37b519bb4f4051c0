//! A change of a twin: a quantity and its new value or relative change.

use std::str::FromStr;

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::{
    CELL_PARAMETERS, ContractionSpec, VALVE_PARAMETERS, cell_default, is_parameter,
};
use cardiotwin_schemas::task::OrganBeatSpec;
use serde::Serialize;

use cardiotwin_input::{load_range, nearest};

/// Loads and pacing. The parameters of cell and valves can be changed, too.
const LOADS: [&str; 5] = [
    "cycle_length_ms",
    "left_atrial_pressure_mmHg",
    "characteristic_resistance_mmHg_s_per_mL",
    "peripheral_resistance_mmHg_s_per_mL",
    "compliance_mL_per_mmHg",
];

/// Quantities that cannot be changed, because the model does not describe such a change or the
/// quantity is not a cause in it, each with the reason.
const UNSAYABLE: [(&str, &str); 6] = [
    (
        "wall_volume_mL",
        "the wall is fixed: the model does not describe growth",
    ),
    (
        "unloaded_volume_mL",
        "the cavity is fixed: the model does not describe remodelling",
    ),
    (
        "a_p_kPa",
        "the passive stress of the 0D cell does not act in the organ",
    ),
    (
        "stiffness_kPa",
        "the passive law is fitted together with the unloaded state, and neither can be changed \
         alone",
    ),
    (
        "end_diastolic_volume_mL",
        "filling follows from `left_atrial_pressure_mmHg`",
    ),
    (
        "initial_windkessel_pressure_mmHg",
        "the periodic state does not depend on it",
    ),
];

/// Words of the clinic, each with the key that says it and how.
const CLINICAL: [(&str, &str); 7] = [
    (
        "contractility",
        "`Smax_ref_kPa`, the reference stress of the cell",
    ),
    (
        "afterload",
        "`peripheral_resistance_mmHg_s_per_mL`, or `compliance_mL_per_mmHg`",
    ),
    (
        "resistance",
        "`peripheral_resistance_mmHg_s_per_mL` of the vessels, or `R_AV_f_mmHg_s_per_mL` of the aortic valve",
    ),
    ("preload", "`left_atrial_pressure_mmHg`"),
    ("filling pressure", "`left_atrial_pressure_mmHg`"),
    (
        "heart rate",
        "`cycle_length_ms`, which is 60000 over the rate in 1/min",
    ),
    (
        "stiffness",
        "`compliance_mL_per_mmHg` for the vessels; the wall's cannot be changed: its law is fitted \
         together with the unloaded state",
    ),
];

/// Factors of a change outside of which a remark says that it is far from any that was tried on other
/// hearts. Those were of 15 to 30 %.
const TRIED: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// New value, or change in percent of the twin's value.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Amount {
    Value(f64),
    Percent(f64),
}

/// A change written as `KEY=VALUE`, `KEY=+10%` or `KEY=-20%`.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    key: String,
    amount: Amount,
}

/// A change that was applied to a beat.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Changed {
    /// Name of the quantity, including its unit.
    pub key: String,
    /// Value of the twin.
    pub before: f64,
    /// Value after the change.
    pub after: f64,
}

impl FromStr for Change {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, amount) = text
            .split_once('=')
            .ok_or_else(|| format!("`{text}`: expected KEY=VALUE or KEY=±N%"))?;
        let (key, amount) = (key.trim(), amount.trim());
        let number = |text: &str| -> Result<f64, String> {
            let value = text
                .trim()
                .parse::<f64>()
                .ok()
                .filter(|value| value.is_finite());
            value.ok_or_else(|| {
                format!("{key}: `{amount}` is neither a number nor a percentage such as -20%")
            })
        };
        let amount = match amount.strip_suffix('%') {
            Some(percent) if amount.starts_with(['+', '-']) => Amount::Percent(number(percent)?),
            Some(_) => {
                return Err(format!(
                    "{key}: `{amount}` has no sign; expected +N% or -N% of the twin's value"
                ));
            }
            None if amount.starts_with('+') => {
                return Err(format!(
                    "{key}: `{amount}` has a sign and no %: write `{key}={}` for the value, \
                     `{key}={amount}%` for the change",
                    amount.trim_start_matches('+')
                ));
            }
            None => Amount::Value(number(amount)?),
        };
        known(key)?;
        Ok(Self {
            key: key.to_owned(),
            amount,
        })
    }
}

fn known(key: &str) -> Result<(), String> {
    if LOADS.contains(&key) || is_parameter(key) {
        return Ok(());
    }
    if let Some((_, reason)) = UNSAYABLE.iter().find(|(name, _)| *name == key) {
        return Err(format!("{key}: {reason}"));
    }
    let word = key.to_lowercase().replace(['_', '-'], " ");
    if let Some((_, said)) = CLINICAL.iter().find(|(name, _)| *name == word) {
        return Err(format!("{key}: say it by {said}"));
    }
    if Biomarker::named(key).is_some() {
        return Err(format!(
            "{key}: is a result of the beat; change one of its causes, such as {}",
            LOADS[3]
        ));
    }
    let all = LOADS
        .into_iter()
        .chain(VALVE_PARAMETERS)
        .chain(CELL_PARAMETERS)
        .filter(|name| *name != "a_p_kPa");
    let meant = nearest(key, all.clone()).map_or_else(
        || ".".to_owned(),
        |meant| format!("; did you mean `{meant}`?"),
    );
    Err(format!(
        "{key}: the model has no such quantity{meant} It has {}.",
        all.collect::<Vec<_>>().join(", ")
    ))
}

impl Change {
    /// Name of the quantity, including its unit.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Applies the change to a beat.
    ///
    /// # Errors
    /// A message that names the invalid value and the reason.
    pub fn make(&self, beat: &mut OrganBeatSpec) -> Result<Changed, String> {
        let key = &self.key;
        let place = self
            .place(beat)
            .ok_or_else(|| format!("{key}: the twin has no cell model"))?;
        let before = *place;
        let after = match self.amount {
            Amount::Value(value) => value,
            Amount::Percent(percent) => before * (1.0 + percent / 100.0),
        };
        if !after.is_finite() || after * before <= 0.0 {
            let sign = if before < 0.0 { "negative" } else { "positive" };
            let hint = match self.amount {
                Amount::Value(value) if (-100.0..0.0).contains(&value) && before > 0.0 => {
                    format!("; did you mean `{key}={value}%`?")
                }
                _ => String::new(),
            };
            return Err(format!(
                "{key}: found {after}, expected a {sign} value like the twin's {before}{hint}"
            ));
        }
        if let Some([low, high]) = load_range(key)
            && !(low..=high).contains(&after)
        {
            return Err(format!(
                "{key}: found {after}, expected {low} to {high}, as in a patient's file; the twin has {before}"
            ));
        }
        *place = after;
        Ok(Changed {
            key: key.clone(),
            before,
            after,
        })
    }

    fn place<'a>(&self, beat: &'a mut OrganBeatSpec) -> Option<&'a mut f64> {
        let load = &mut beat.circulation.afterload;
        match self.key.as_str() {
            "cycle_length_ms" => return Some(&mut beat.cycle_length_ms),
            "left_atrial_pressure_mmHg" => {
                return Some(&mut beat.circulation.left_atrial_pressure_mmhg);
            }
            "characteristic_resistance_mmHg_s_per_mL" => {
                return Some(&mut load.characteristic_resistance_mmhg_s_per_ml);
            }
            "peripheral_resistance_mmHg_s_per_mL" => {
                return Some(&mut load.peripheral_resistance_mmhg_s_per_ml);
            }
            "compliance_mL_per_mmHg" => return Some(&mut load.compliance_ml_per_mmhg),
            _ => {}
        }
        if VALVE_PARAMETERS.contains(&self.key.as_str()) {
            return beat.valves.named_mut(&self.key);
        }
        match &mut beat.contraction {
            ContractionSpec::Tanh { .. } | ContractionSpec::Catalogue { .. } => None,
            ContractionSpec::Land2017Rice { parameters, .. }
            | ContractionSpec::Land2017Trace { parameters, .. } => {
                let default = cell_default(&self.key)?;
                Some(parameters.entry(self.key.clone()).or_insert(default))
            }
        }
    }

    /// Caveat of the model that a reader of this change's prediction should know.
    pub fn remark(&self) -> Option<&'static str> {
        match self.key.as_str() {
            "cycle_length_ms" => Some(
                "the calcium transient and the activation time of the wall remain those of the \
                 measured rate: the model has no force-frequency relation",
            ),
            _ => None,
        }
    }
}

impl Changed {
    /// Remark on a change that is larger than any that was tried.
    pub fn remark(&self) -> Option<String> {
        let factor = self.after / self.before;
        (!TRIED.contains(&factor)).then(|| {
            format!(
                "{} becomes {:.3} times the twin's: predictions were compared with changes of at most 30 %",
                self.key, factor
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reduced ventricle whose cell has a `phi` of 2.
    fn beat() -> OrganBeatSpec {
        let beat = serde_json::json!({
            "cycle_length_ms": 700.0, "time_step_ms": 1.0, "shortest_step_ms": 0.015625, "newton_iterations": 60,
            "organ": {"fidelity": "reduced",
                "passive": {"wall_volume_mL": 90.0, "unloaded_volume_mL": 60.0, "end_diastolic_volume_mL": 120.0,
                            "end_diastolic_pressure_mmHg": 9.0, "stiffness_kPa": 0.5, "exponent": 9.24},
                "activation": {"spread_ms": 40.0, "groups": 16, "onset_ms": 20.0}},
            "circulation": {"afterload": {"characteristic_resistance_mmHg_s_per_mL": 0.03,
                "peripheral_resistance_mmHg_s_per_mL": 0.9, "compliance_mL_per_mmHg": 1.2},
                "initial_windkessel_pressure_mmHg": 70.0, "left_atrial_pressure_mmHg": 7.0},
            "valves": {}, "contraction": {"model": "land2017-rice", "parameters": {"phi": 2.0}, "lambda_0": 1.1},
            "beats": {"mode": "fixed", "n": 1}, "measured_end_diastolic_volume_mL": 120.0
        });
        serde_json::from_value(beat).unwrap()
    }

    fn said(text: &str) -> String {
        text.parse::<Change>().unwrap_err()
    }

    #[test]
    fn values_and_percentages_change_the_twin() {
        let mut beat = beat();
        let mut make = |text: &str| text.parse::<Change>().unwrap().make(&mut beat).unwrap();
        let changed = make("peripheral_resistance_mmHg_s_per_mL=-20%");
        assert_eq!((changed.before, changed.after), (0.9, 0.9 * 0.8));
        assert_eq!(make("Smax_ref_kPa = 150").after, 150.0);
        assert_eq!(
            make("phi=+50%").after,
            3.0,
            "a parameter that the twin has of its own"
        );
        assert_eq!(
            make("beta_1_uM=-10%").after,
            -2.4 * 0.9,
            "negative ones stay negative"
        );
        make("R_AV_f_mmHg_s_per_mL=0.02");
        assert_eq!(
            beat.circulation
                .afterload
                .peripheral_resistance_mmhg_s_per_ml,
            0.9 * 0.8
        );
        assert_eq!(beat.valves.r_av_f_mmhg_s_per_ml, 0.02);
    }

    #[test]
    fn what_the_model_cannot_say_is_refused_with_the_reason() {
        assert!(said("wall_volume_mL=-10%").contains("does not describe growth"));
        assert!(said("P_max_mmHg=120").contains("is a result of the beat"));
        let unknown = said("peripheral_resistance=-20%");
        assert!(
            unknown.contains("did you mean `peripheral_resistance_mmHg_s_per_mL`?"),
            "{unknown}"
        );
        let hint = "Ca_max_uM=-20"
            .parse::<Change>()
            .unwrap()
            .make(&mut beat())
            .unwrap_err();
        assert!(hint.ends_with("did you mean `Ca_max_uM=-20%`?"), "{hint}");
        assert!(said("phi=+20").ends_with("`phi=20` for the value, `phi=+20%` for the change"));
        assert!(said("contractility=-20%").contains("`Smax_ref_kPa`"));
        assert!(said("heart_rate=90").contains("`cycle_length_ms`, which is 60000 over"));
        assert!(said("Preload=-20%").contains("`left_atrial_pressure_mmHg`"));
        let far = "peripheral_resistance_mmHg_s_per_mL=-99%"
            .parse::<Change>()
            .unwrap();
        let refused = far.make(&mut beat()).unwrap_err();
        assert!(refused.contains("expected 0.01 to 100"), "{refused}");
        let far = "peripheral_resistance_mmHg_s_per_mL=-90%"
            .parse::<Change>()
            .unwrap();
        let far = far.make(&mut beat()).unwrap().remark().unwrap();
        assert!(far.contains("becomes 0.100 times the twin's"), "{far}");
        assert!(said("phi=20%").contains("has no sign"));
        assert!(said("phi=much").contains("neither a number nor a percentage"));
        assert!(said("phi").contains("expected KEY=VALUE"));
        let none = "compliance_mL_per_mmHg=-100%"
            .parse::<Change>()
            .unwrap()
            .make(&mut beat())
            .unwrap_err();
        assert!(
            none.contains("expected a positive value like the twin's 1.2"),
            "{none}"
        );
    }
}
