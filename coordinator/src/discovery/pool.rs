//! Evidence of many patients together: what most of them lack is a fault of the model, what one lacks is that patient's.

use std::collections::BTreeMap;

use cardiotwin_schemas::discover::{Discovered, PooledEffect};

/// Most that one patient adds to the pooled evidence, so that one does not speak for all.
pub const LARGEST_SHARE: f64 = 30.0;

/// All candidates over a cohort, by pooled evidence, best first.
#[must_use]
pub fn pool<'a>(patients: impl IntoIterator<Item = &'a Discovered>) -> Vec<PooledEffect> {
    let mut n_patients = 0;
    let mut by_name: BTreeMap<&str, PooledEffect> = BTreeMap::new();
    for found in patients {
        n_patients += 1;
        for effect in &found.effects {
            let pooled = by_name.entry(&effect.name).or_insert_with(|| PooledEffect {
                name: effect.name.clone(),
                accepted_in: 0,
                tried_in: 0,
                log_evidence: 0.0,
                of_the_model: false,
            });
            pooled.tried_in += 1;
            pooled.log_evidence += effect.log_evidence.min(LARGEST_SHARE);
            pooled.accepted_in += u32::from(found.accepted.contains(&effect.name));
        }
    }
    let mut list: Vec<PooledEffect> = by_name.into_values().collect();
    list.iter_mut().for_each(|p| p.of_the_model = 2 * p.accepted_in > n_patients);
    list.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    list
}
