//! Evidence of many patients together: what most of them lack is a fault of the model, what one lacks is that patient's.

use crate::result::Discovery;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A candidate over a cohort.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PooledEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Patients in whom it was accepted.
    pub accepted_in: usize,
    /// Patients in whom it was tried.
    pub tried_in: usize,
    /// Sum over the patients of twice the log Bayes factor against the model without it, the best nameless competitor
    /// allowed on either side, each counted up to [`LARGEST_SHARE`], so that one patient does not speak for all.
    pub log_evidence: f64,
    /// Whether more than half of the patients lack it.
    pub of_the_model: bool,
}

/// Most that one patient adds to the pooled evidence.
pub const LARGEST_SHARE: f64 = 30.0;

/// All candidates over a cohort, by pooled evidence, best first.
#[must_use]
pub fn pool<'a>(patients: impl IntoIterator<Item = &'a Discovery>) -> Vec<PooledEffect> {
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
            pooled.log_evidence += effect.robust_evidence.min(LARGEST_SHARE);
            pooled.accepted_in += usize::from(found.accepted.contains(&effect.name));
        }
    }
    let mut list: Vec<PooledEffect> = by_name.into_values().collect();
    list.iter_mut().for_each(|p| p.of_the_model = 2 * p.accepted_in > n_patients);
    list.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    list
}
