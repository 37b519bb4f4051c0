//! A sample of uncertain data: measured biomarkers multiplied by factors (Jung et al. 2022, section
//! 2.5).
//!
//! Only the targets of step 1 change. Anatomy, passive state, loads, filling pressure, onset of
//! activation, and the volumes and pressures at end-diastole stay those of the measured data. This
//! follows the paper, whose samples perturb biomarkers and not traces. With a perturbed
//! end-diastolic volume the sample would be another heart, not another target for the same heart.

use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};

use crate::error::TaskError;

/// Multiplies measured biomarkers by their factors. Returns the factors that were applied, which
/// are those of measured biomarkers.
///
/// - `factors`: positive factors by keys of [`Biomarker::OF_COST`]
///
/// # Errors
/// [`TaskError::Factor`] for a key that step 1 does not fit, or a factor that is not positive and
/// finite.
pub fn apply(
    factors: &BTreeMap<String, f64>,
    measured: &mut Biomarkers,
) -> Result<BTreeMap<String, f64>, TaskError> {
    let mut applied = BTreeMap::new();
    for (name, factor) in factors {
        let refused = |why| TaskError::Factor {
            name: name.clone(),
            factor: *factor,
            why,
        };
        let biomarker = Biomarker::named(name)
            .filter(|biomarker| Biomarker::OF_COST.contains(biomarker))
            .ok_or_else(|| refused("step 1 fits no such biomarker"))?;
        if !(*factor > 0.0 && factor.is_finite()) {
            return Err(refused("it is not positive and finite"));
        }
        if let Some(value) = measured.get_mut(biomarker) {
            *value *= factor;
            applied.insert(name.clone(), *factor);
        }
    }
    Ok(applied)
}

/// Remark about the factors, for the reader of the result.
pub fn remark(factors: &BTreeMap<String, f64>) -> Option<String> {
    let listed: Vec<String> = factors
        .iter()
        .map(|(name, factor)| format!("{name} × {factor:.4}"))
        .collect();
    (!listed.is_empty()).then(|| {
        format!(
            "a sample of uncertain data: targets are the measured values with {}",
            listed.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured() -> Biomarkers {
        Biomarkers {
            p_max_mmhg: Some(120.0),
            dpdt_min_mmhg_per_ms: Some(-1.5),
            sv_ml: Some(80.0),
            edv_ml: Some(140.0),
            ..Biomarkers::default()
        }
    }

    fn factors(name: &str, factor: f64) -> BTreeMap<String, f64> {
        BTreeMap::from([(name.to_owned(), factor)])
    }

    #[test]
    fn named_targets_change_and_nothing_else() {
        let mut found = measured();
        let absent = factors("tau_VD_ms", 1.1);
        assert_eq!(
            apply(&absent, &mut found).unwrap(),
            BTreeMap::new(),
            "what was not measured has no factor"
        );
        assert_eq!(found, measured());
        let both = BTreeMap::from([
            ("P_max_mmHg".to_owned(), 1.1),
            ("dPdt_min_mmHg_per_ms".to_owned(), 0.9),
        ]);
        assert_eq!(apply(&both, &mut found).unwrap(), both);
        assert!((found.p_max_mmhg.unwrap() - 132.0).abs() < 1e-12);
        assert!((found.dpdt_min_mmhg_per_ms.unwrap() + 1.35).abs() < 1e-12);
        assert_eq!((found.sv_ml, found.edv_ml), (Some(80.0), Some(140.0)));
        assert_eq!(remark(&BTreeMap::new()), None);
        assert!(remark(&both).unwrap().contains("P_max_mmHg × 1.1000"));
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let refusal = |name: &str, factor: f64| {
            apply(&factors(name, factor), &mut measured())
                .unwrap_err()
                .to_string()
        };
        assert!(refusal("EDV_mL", 1.1).contains("`EDV_mL`"));
        for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(
                refusal("P_max_mmHg", factor).contains("positive"),
                "{factor}"
            );
        }
    }
}
