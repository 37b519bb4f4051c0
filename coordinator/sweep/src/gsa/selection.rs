//! The ranking as a list of parameters for `cohort.toml`: for step 2 from the cell's sweep, for
//! step 3 from the organ's.

use std::fmt::Write as _;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::sensitivity::SensitivityRecord;

use crate::SweepError;

/// Scale of the cell's passive stress. The paper fits it together with the selected parameters.
const PASSIVE: (&str, [f64; 2]) = ("a_p_kPa", [1.0, 100.0]);

/// Name of the file for [`toml()`].
#[must_use]
pub fn file(record: &SensitivityRecord) -> &'static str {
    if record.spec.design.organ.is_some() {
        "step3.toml"
    } else {
        "step2.toml"
    }
}

/// The `n` most influential parameters and the passive scale as a `[step2]` table, with the bounds
/// of the sweep. A parameter that the sweep held at a value of its own, and that is not fitted,
/// stays frozen at that value. For an organ's sweep, the parameters become a `[step3]` table.
///
/// # Errors
/// [`SweepError::Setting`] if `n` is 0 or larger than the number of swept parameters.
pub fn toml(record: &SensitivityRecord, n: usize) -> Result<String, SweepError> {
    let swept = record.ranking.len();
    if !(1..=swept).contains(&n) {
        let expected = format!("1 to {swept}, the number of swept parameters");
        return Err(SweepError::Setting {
            name: "--select".into(),
            found: n.to_string(),
            expected,
        });
    }
    let design = &record.spec.design;
    let mut selected: Vec<(&str, [f64; 2])> = record.ranking[..n]
        .iter()
        .filter_map(|ranked| design.parameters.iter().find(|p| p.name == ranked.name))
        .map(|p| (p.name.as_str(), [p.lower, p.upper]))
        .collect();
    if let Some(organ) = &design.organ {
        return Ok(step3(record, &organ.patient, &selected));
    }
    if !selected.iter().any(|(name, _)| *name == PASSIVE.0) {
        selected.push(PASSIVE);
    }
    let mut text = format!(
        "# The {n} parameters that the active stress is most sensitive to, by the sum of total \
         Sobol indices over\n\
         # {} biomarkers, on {} blocks of samples; a_p_kPa is fitted, too, as in Jung et al. \
         2022.\n\
         [step2]\n\
         parameters = [\n",
        record.outputs.len(),
        record.n_blocks
    );
    // Writing to a string cannot fail.
    for (name, _) in &selected {
        let _ = writeln!(text, "    \"{name}\",");
    }
    text += "]\n";
    let fitted = |name: &str| selected.iter().any(|(selected, _)| *selected == name);
    let frozen: Vec<_> = design
        .fixed
        .iter()
        .filter(|(name, _)| !fitted(name))
        .collect();
    text += "\n[step2.bounds]\n";
    for (name, [lower, upper]) in &selected {
        let _ = writeln!(text, "{name} = [{lower:?}, {upper:?}]");
    }
    if !frozen.is_empty() {
        text += "\n[step2.frozen]\n";
        for (name, value) in frozen {
            let _ = writeln!(text, "{name} = {value:?}");
        }
    }
    Ok(text)
}

fn step3(record: &SensitivityRecord, patient: &PatientId, selected: &[(&str, [f64; 2])]) -> String {
    let mut text = format!(
        "# The {} parameters that the organ of {patient} is most sensitive to, by the sum of total Sobol indices over\n\
         # {} biomarkers, on {} blocks of samples.\n\
         [step3]\nparameters = [\n",
        selected.len(),
        record.outputs.len(),
        record.n_blocks
    );
    // Writing to a string cannot fail.
    for (name, _) in selected {
        let _ = writeln!(text, "    \"{name}\",");
    }
    text += "]\n\n[step3.bounds]\n";
    for (name, [lower, upper]) in selected {
        let _ = writeln!(text, "{name} = [{lower:?}, {upper:?}]");
    }
    text
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::cohort::SettingsLayer;
    use cardiotwin_schemas::sensitivity::RankedParameter;

    use super::super::reference;
    use super::super::spec::tests::organ;
    use super::super::spec::{DesignOptions, of_organ, published, valves};
    use super::*;

    fn record(order: &[&str]) -> SensitivityRecord {
        let ranked = |(rank, name): (u32, &&str)| RankedParameter {
            rank,
            name: (*name).to_owned(),
            sum_of_totals: 1.0,
            half_width: None,
            rank_interval: None,
            share_among_first_nine: None,
            reference: reference::rank(name),
            paper: reference::paper(name),
        };
        SensitivityRecord {
            schema_version: cardiotwin_schemas::formats::SENSITIVITY.version,
            version: String::new(),
            spec: published(),
            n_blocks: 1024,
            samples: Default::default(),
            arithmetic: vec![],
            outputs: vec![],
            ranking: (1..).zip(order).map(ranked).collect(),
        }
    }

    #[test]
    fn the_selection_is_a_layer_of_settings_with_bounds_for_each_parameter() {
        let mut of = record(&["Ca50_ref_uM", "k_WS_per_ms", "n_Tm"]);
        of.spec.design.fixed.insert("phi".into(), 2.0);
        let text = toml(&of, 2).unwrap();
        let layer: SettingsLayer =
            toml::from_str(&text).unwrap_or_else(|error| panic!("{error} in\n{text}"));
        let step2 = serde_json::to_value(layer.step2.unwrap()).unwrap();
        assert_eq!(
            step2["parameters"],
            serde_json::json!(["Ca50_ref_uM", "k_WS_per_ms", "a_p_kPa"])
        );
        assert_eq!(
            step2["bounds"]["k_WS_per_ms"],
            serde_json::json!([0.004, 0.048])
        );
        assert_eq!(
            step2["frozen"],
            serde_json::json!({"phi": 2.0}),
            "what is fitted is not frozen"
        );
    }

    #[test]
    fn of_an_organ_it_is_step_3_s_layer() {
        let mut of = record(&["Ca50_ref_uM", "R_AV_f_mmHg_s_per_mL"]);
        of.spec = of_organ(organ("p1", 2.0), 1.1);
        of.spec = DesignOptions {
            bounds: valves(),
            ..DesignOptions::default()
        }
        .on(of.spec)
        .unwrap();
        let layer: SettingsLayer = toml::from_str(&toml(&of, 2).unwrap()).unwrap();
        let step3 = serde_json::to_value(layer.step3.unwrap()).unwrap();
        assert_eq!(
            step3["parameters"],
            serde_json::json!(["Ca50_ref_uM", "R_AV_f_mmHg_s_per_mL"])
        );
        assert_eq!(
            step3["bounds"]["R_AV_f_mmHg_s_per_mL"],
            serde_json::json!([0.001, 0.1])
        );
        assert_eq!((file(&of), layer.step2.is_some()), ("step3.toml", false));
    }

    #[test]
    fn more_than_were_swept_cannot_be_selected() {
        for n in [0, 4] {
            let said = toml(&record(&["Ca50_ref_uM", "k_WS_per_ms", "n_Tm"]), n)
                .unwrap_err()
                .to_string();
            assert_eq!(
                said,
                format!("--select is {n}, expected 1 to 3, the number of swept parameters")
            );
        }
    }
}
