//! Discrepancy between formulations of the heart: how far predicted changes of a beat miss those of hearts that are
//! built of other equations (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425).
//!
//! The half widths are learnt on made hearts whose true answers are known (`make learn-bands`), one for each kind of
//! change and index. Each is the value that the error of one more heart like them stays below with a probability of
//! 90 %, whatever the distribution of the errors (split conformal prediction; Lei et al. 2018, J Am Stat Assoc
//! 113:1094): the biases of the model count, too.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::statistics::quantile_of;

/// Probability with which a band holds the true change.
pub const LEVEL: f64 = 0.9;

/// Learnt discrepancies with their origin.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Discrepancies {
    /// Command that wrote them.
    pub command: String,
    /// Hearts on which they were learnt: seed of the generator, and number of hearts that it made.
    pub hearts: Vec<Cohort>,
    /// One table for each ventricle and circulation that was tried.
    pub tables: Vec<Table>,
}

/// Made hearts of one seed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cohort {
    /// Ventricle of the twins.
    pub ventricle: String,
    /// Seed of the generator.
    pub seed: u64,
    /// Hearts that were made.
    pub made: usize,
}

/// Discrepancies of the twins of one ventricle in one circulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Ventricle in which changes are predicted, by the name of `cardiotwin predict`.
    pub ventricle: String,
    /// Circulation around it, by the name of `cardiotwin predict`.
    pub circulation: String,
    /// Number of personalised twins.
    pub n_twins: usize,
    /// Kinds of change that were tried.
    pub changes: Vec<Kind>,
}

/// A kind of change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kind {
    /// The quantity that changes.
    pub quantity: String,
    /// Its value after the change over the one before, dimensionless.
    pub factor: f64,
    /// Errors by index.
    pub indices: BTreeMap<String, Errors>,
}

/// Errors of the predicted change of an index.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Half width of the 90 % band of the relative change, beyond the uncertainty within the model.
    pub half_width: f64,
    /// Share of true changes that had the predicted direction.
    pub right_direction: f64,
}

/// What is known of the discrepancy of one prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Discrepancy {
    /// Half width of the 90 % band of the relative change.
    pub half_width: f64,
    /// Share of hearts whose change had the predicted direction; `None` for several changes at once.
    pub right_direction: Option<f64>,
}

/// A change of a quantity from one value to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeOf<'a> {
    /// Name of the quantity.
    pub quantity: &'a str,
    /// Value after the change over the one before.
    pub factor: f64,
}

impl Discrepancies {
    /// The discrepancies that the program knows (`make learn-bands`).
    ///
    /// # Panics
    /// Never: a test reads the file.
    #[must_use]
    pub fn learnt() -> Self {
        serde_json::from_str(include_str!("formulations.json"))
            .expect("the built-in discrepancies are valid")
    }

    /// The table of a ventricle in a circulation; `None` where none was learnt.
    #[must_use]
    pub fn of(&self, ventricle: &str, circulation: &str) -> Option<&Table> {
        self.tables
            .iter()
            .find(|table| table.ventricle == ventricle && table.circulation == circulation)
    }
}

impl Table {
    /// The first of the changes that was never tried.
    #[must_use]
    pub fn untried<'a>(&self, made: &[ChangeOf<'a>]) -> Option<&'a str> {
        let untried = made.iter().find(|one| self.kind(one.quantity).is_none());
        untried.map(|one| one.quantity)
    }

    fn kind(&self, quantity: &str) -> Option<&Kind> {
        self.changes.iter().find(|kind| kind.quantity == quantity)
    }

    /// Discrepancy of an index after changes that are made together. It grows with the logarithm of the factor, so
    /// that no change has none; those of several quantities add in quadrature. `None` where one of the quantities or the
    /// index was never tried.
    #[must_use]
    pub fn discrepancy(&self, made: &[ChangeOf<'_>], index: &str) -> Option<Discrepancy> {
        let errors = (made.iter())
            .map(|one| {
                let kind = self.kind(one.quantity)?;
                let errors = kind.indices.get(index)?;
                let size = (one.factor.ln() / kind.factor.ln()).abs();
                Some((size * errors.half_width, errors.right_direction))
            })
            .collect::<Option<Vec<_>>>()?;
        let half_width = errors.iter().map(|(width, _)| width.powi(2)).sum::<f64>();
        Some(Discrepancy {
            half_width: half_width.sqrt(),
            right_direction: match errors[..] {
                [(_, right)] => Some(right),
                _ => None,
            },
        })
    }
}

/// Error of a predicted change beyond its uncertainty within the model: the half width with which a band of both,
/// added in quadrature, ends at the truth.
///
/// - `within`: half width of the band within the model, on the side of the truth
#[must_use]
pub fn beyond(error: f64, within: f64) -> f64 {
    (error * error - within * within).max(0.0).sqrt()
}

/// Half width that the error of one more heart stays below with probability [`LEVEL`]; NaN without errors. Of fewer than
/// nine hearts it is the largest error, and the probability is lower.
///
/// - `errors`: of the hearts, each as of [`beyond`]
#[must_use]
pub fn half_width(mut errors: Vec<f64>) -> f64 {
    errors.sort_by(f64::total_cmp);
    quantile_of(&errors, LEVEL)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let kind = |quantity: &str, factor: f64, half_width: f64| Kind {
            quantity: quantity.to_owned(),
            factor,
            indices: BTreeMap::from([(
                "SV_mL".to_owned(),
                Errors {
                    half_width,
                    right_direction: 0.95,
                },
            )]),
        };
        Table {
            ventricle: "one-fibre".to_owned(),
            circulation: "open".to_owned(),
            n_twins: 20,
            changes: vec![kind("resistance", 0.75, 0.03), kind("filling", 1.2, 0.04)],
        }
    }

    fn change(quantity: &str, factor: f64) -> ChangeOf<'_> {
        ChangeOf { quantity, factor }
    }

    #[test]
    fn a_discrepancy_grows_with_the_size_of_the_change() {
        let of = |made: &[ChangeOf<'_>]| table().discrepancy(made, "SV_mL");
        let width = |factor: f64| of(&[change("resistance", factor)]).unwrap().half_width;
        assert!((width(0.75) - 0.03).abs() < 1e-15);
        assert!(
            (width(1.0 / 0.75) - 0.03).abs() < 1e-15,
            "the other way as much"
        );
        assert!(
            (width(0.75 * 0.75) - 0.06).abs() < 1e-15,
            "twice the change"
        );
        assert_eq!(width(1.0), 0.0, "no change");
        let both = of(&[change("resistance", 0.75), change("filling", 1.2)]).unwrap();
        assert!((both.half_width - 0.05).abs() < 1e-15, "{both:?}");
        assert_eq!(both.right_direction, None);
    }

    #[test]
    fn what_was_never_tried_has_no_discrepancy() {
        let made = [change("resistance", 0.75), change("Ca_max_uM", 1.1)];
        assert_eq!(table().discrepancy(&made, "SV_mL"), None);
        assert_eq!(table().untried(&made), Some("Ca_max_uM"));
        assert_eq!(table().discrepancy(&made[..1], "PTD90_ms"), None);
        assert_eq!(table().untried(&made[..1]), None);
    }

    #[test]
    fn a_half_width_holds_the_next_error_in_nine_of_ten() {
        // Errors with a bias, drawn 4,000 times: 18 to learn from and one to judge.
        let mut state = 1u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut error = || (0.3 + uniform() - uniform()).abs();
        let n = 4000;
        let held = (0..n).filter(|_| {
            let learnt = (0..18).map(|_| error()).collect();
            error() <= half_width(learnt)
        });
        let share = held.count() as f64 / f64::from(n);
        assert!((share - LEVEL).abs() < 0.015, "{share}");
        assert!(half_width(Vec::new()).is_nan());
    }

    #[test]
    fn a_band_of_both_ends_at_the_truth() {
        let (error, within) = (0.05_f64, 0.03_f64);
        assert!((within.hypot(beyond(error, within)) - error).abs() < 1e-15);
        assert_eq!(
            beyond(0.02, within),
            0.0,
            "the truth is inside of the band already"
        );
    }

    #[test]
    fn built_in_discrepancies_are_those_of_many_twins() {
        let learnt = Discrepancies::learnt();
        assert!(learnt.command.contains("learn") && !learnt.hearts.is_empty());
        for circulation in ["open", "closed"] {
            assert!(
                learnt.of("one-fibre", circulation).is_some(),
                "{circulation}"
            );
        }
        for table in &learnt.tables {
            assert!(table.n_twins >= 9, "{}", table.n_twins);
            let errors = (table.changes.iter()).flat_map(|kind| kind.indices.values());
            assert!(errors.clone().count() > 50);
            for one in errors {
                let right = (0.0..=1.0).contains(&one.right_direction);
                assert!(
                    right && one.half_width > 0.0 && one.half_width < 1.5,
                    "{one:?}"
                );
            }
        }
        assert_eq!(learnt.of("finite-element", "open"), None);
    }
}
