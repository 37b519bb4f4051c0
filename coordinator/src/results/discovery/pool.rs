//! Evidence pooled over many patients: an effect that most of them lack is a fault of the model,
//! otherwise it belongs to the patient.

use std::collections::BTreeMap;

use cardiotwin_schemas::discover::{Discovered, PooledEffect};

/// Largest contribution of one patient to the pooled log evidence, so that a single patient does
/// not decide for all.
pub const LARGEST_SHARE: f64 = 30.0;

/// All candidates over a cohort, sorted by pooled evidence, the best first.
#[must_use]
pub fn pool<'a>(patients: impl IntoIterator<Item = &'a Discovered>) -> Vec<PooledEffect> {
    let mut n_patients = 0;
    let mut by_name: BTreeMap<&str, PooledEffect> = BTreeMap::new();
    for found in patients {
        n_patients += 1;
        for effect in &found.findings.effects {
            let pooled = by_name.entry(&effect.name).or_insert_with(|| PooledEffect {
                name: effect.name.clone(),
                accepted_in: 0,
                tried_in: 0,
                log_evidence: 0.0,
                of_the_model: false,
            });
            pooled.tried_in += 1;
            pooled.log_evidence += effect.robust_evidence.min(LARGEST_SHARE);
            pooled.accepted_in += u32::from(found.findings.accepted.contains(&effect.name));
        }
    }
    let mut list: Vec<PooledEffect> = by_name.into_values().collect();
    list.iter_mut()
        .for_each(|p| p.of_the_model = 2 * p.accepted_in > n_patients);
    list.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    list
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::discovery::fixture::{effect, finding, kick, nothing};

    #[test]
    fn one_patient_does_not_speak_for_all_and_a_majority_makes_a_fault_of_the_model() {
        let loud = finding(
            vec![
                effect("viscoelasticity", 500.0, false),
                effect("atrial_kick", 8.0, false),
            ],
            1,
        );
        let pooled = pool([&loud, &kick(), &kick()]);
        let [first, second] = &pooled[..] else {
            panic!("{pooled:?}")
        };
        assert_eq!(
            (first.name.as_str(), first.accepted_in, first.of_the_model),
            ("atrial_kick", 2, true)
        );
        assert_eq!(
            (first.log_evidence, second.log_evidence),
            (48.0, LARGEST_SHARE - 4.0)
        );
        assert_eq!(
            (second.accepted_in, second.tried_in, second.of_the_model),
            (1, 3, false)
        );
        assert!(
            !pool([&kick(), &nothing()])[0].of_the_model,
            "half of the patients are no majority"
        );
    }
}
