//! Evidence pooled over many patients: an effect that most of them lack is a fault of the model,
//! otherwise it belongs to the patient.

use std::collections::BTreeMap;

use cardiotwin_schemas::discover::{Discovered, PooledEffect};

/// Largest contribution of one patient to the pooled log evidence, for or against an effect: odds of
/// some 20,000 to 1 (Kass and Raftery 1995 call 150 to 1 very strong). Beyond it, the number says how
/// large a residual is, not how sure its name is.
pub const LARGEST_SHARE: f64 = 10.0;
/// Smallest number of patients whose extreme contributions are drawn in.
const DRAWN_IN_FROM: usize = 3;

/// Contributions to the pooled log evidence of an effect, by patient.
type Shares<'a> = Vec<(&'a str, f64)>;

/// Number of patients in whom an effect was accepted, and of those in whom held-out data do not confirm
/// it, in words.
#[must_use]
pub fn accepted_in(effect: &PooledEffect, n_patients: usize) -> String {
    let unconfirmed = match effect.unconfirmed_in {
        0 => String::new(),
        n => format!(", {n} not confirmed"),
    };
    format!("{} of {n_patients}{unconfirmed}", effect.accepted_in)
}

/// All candidates over a cohort, sorted by pooled evidence, the best first.
#[must_use]
pub fn pool<'a>(
    patients: impl IntoIterator<Item = (&'a str, &'a Discovered)>,
) -> Vec<PooledEffect> {
    let mut n_patients = 0;
    let mut by_name: BTreeMap<&str, ([u32; 2], Shares<'_>)> = BTreeMap::new();
    for (patient, found) in patients {
        n_patients += 1;
        for effect in &found.findings.effects {
            let ([accepted_in, unconfirmed_in], shares) = by_name.entry(&effect.name).or_default();
            let share = effect.robust_evidence.clamp(-LARGEST_SHARE, LARGEST_SHARE);
            shares.push((patient, share));
            let is_accepted = found.findings.accepted.contains(&effect.name);
            *accepted_in += u32::from(is_accepted);
            *unconfirmed_in += u32::from(is_accepted && found.findings.confirmed() == Some(false));
        }
    }
    let mut list: Vec<PooledEffect> = by_name
        .into_iter()
        .map(
            |(name, ([accepted_in, unconfirmed_in], shares))| PooledEffect {
                name: name.to_owned(),
                accepted_in,
                unconfirmed_in,
                tried_in: u32::try_from(shares.len()).unwrap_or(u32::MAX),
                log_evidence: winsorised_sum(shares.iter().map(|(_, share)| *share).collect()),
                of_the_model: 2 * accepted_in > n_patients,
                dominated_by: dominating(&shares).map(str::to_owned),
            },
        )
        .collect();
    list.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    list
}

/// Sum in which the largest and the smallest value count as much as their neighbours (Tukey 1962),
/// so that no single value decides its sign; of fewer than three values the plain sum.
fn winsorised_sum(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n >= DRAWN_IN_FROM {
        values[0] = values[1];
        values[n - 1] = values[n - 2];
    }
    values.iter().sum()
}

/// Patient without whom the plain sum would have the other sign.
fn dominating<'a>(shares: &[(&'a str, f64)]) -> Option<&'a str> {
    let sum: f64 = shares.iter().map(|(_, share)| share).sum();
    let (patient, share) = shares
        .iter()
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    let turns = shares.len() > 1 && sum * (sum - share) < 0.0;
    turns.then_some(patient)
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::{effect, finding, kick, nothing};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn one_patient_does_not_speak_for_all_and_a_majority_makes_a_fault_of_the_model() {
        let loud = finding(
            vec![
                effect("viscoelasticity", 500.0, false),
                effect("atrial_kick", 8.0, false),
            ],
            1,
        );
        let (kick, nothing) = (kick(), nothing());
        let pooled = pool([("a", &loud), ("b", &kick), ("c", &kick)]);
        let [first, second] = &pooled[..] else {
            panic!("{pooled:?}")
        };
        assert_eq!(
            (first.name.as_str(), first.accepted_in, first.of_the_model),
            ("atrial_kick", 2, true)
        );
        assert_eq!(first.dominated_by, None);
        // The loud patient counts as much as the next one, which speaks against the effect.
        assert!(second.log_evidence < 0.0, "{second:?}");
        assert_eq!(
            (second.accepted_in, second.tried_in, second.of_the_model),
            (1, 3, false)
        );
        assert_eq!(second.dominated_by.as_deref(), Some("a"));
        assert!(
            !pool([("a", &kick), ("b", &nothing)])[0].of_the_model,
            "half of the patients are no majority"
        );
    }

    proptest! {
        /// Whatever one patient of three or more says, the others' common verdict stands.
        #[test]
        fn no_patient_turns_the_verdict_of_all_others(
            others in proptest::collection::vec(0.1f64..20.0, 2..8),
            one in -1e6f64..1e6,
            favour in any::<bool>(),
        ) {
            let sign = if favour { 1.0 } else { -1.0 };
            let mut values: Vec<f64> = others.iter().map(|v| sign * v).collect();
            values.push(one);
            prop_assert!(sign * winsorised_sum(values) > 0.0);
        }
    }
}
