//! What a band covers, and what a prediction knows of a change.

use std::sync::LazyLock;

use cardiotwin_calibrate::formulations::{ChangeOf, Discrepancies, Table};

use super::bands::Interval;
use super::change::Changed;
use super::predicted::{Known, Predicted};

/// Share of hearts whose change must have had the predicted direction for a direction to be known: that of the bands.
const RIGHT_DIRECTION: f64 = cardiotwin_calibrate::formulations::LEVEL;

/// The discrepancies that the program knows, read once for all predictions of a file of scenarios.
pub static LEARNT: LazyLock<Discrepancies> = LazyLock::new(Discrepancies::learnt);

/// What is known of the discrepancy between formulations for some changes.
pub enum Formulations<'a> {
    /// Learnt on hearts of other formulations.
    Learnt {
        table: &'a Table,
        made: Vec<ChangeOf<'a>>,
    },
    /// Nothing, with the reason.
    Unknown(String),
}

impl<'a> Formulations<'a> {
    /// - `ventricle` and `circulation`, by their names in the answer; `periodic`: not after a fixed number of beats
    pub fn of(
        learnt: &'a Discrepancies,
        (ventricle, circulation): (&str, &str),
        made: &'a [Changed],
        periodic: bool,
    ) -> Self {
        if !periodic {
            return Self::Unknown("only steady beats were compared with other hearts".to_owned());
        }
        let Some(table) = learnt.of(ventricle, circulation) else {
            return Self::Unknown(format!(
                "the {ventricle} ventricle in this circuit was not compared with other hearts"
            ));
        };
        let made: Vec<ChangeOf<'a>> = (made.iter())
            .map(|one| ChangeOf {
                quantity: &one.key,
                factor: one.after / one.before,
            })
            .collect();
        match table.untried(&made) {
            Some(quantity) => Self::Unknown(format!(
                "a change of {quantity} was not compared with other hearts"
            )),
            None => Self::Learnt { table, made },
        }
    }

    /// What a band covers, in one sentence.
    ///
    /// - `in_law`: whether its beats are those of the organ's law
    pub fn sentence(&self, in_law: bool) -> String {
        let within = match in_law {
            true => "cell, valves and law",
            false => "cell and valves",
        };
        match self {
            Self::Learnt { table, .. } => format!(
                "uncertainty of {within}, and the errors on {} hearts of other formulations",
                table.n_twins
            ),
            Self::Unknown(reason) => {
                format!("uncertainty of {within} in this model alone: {reason}")
            }
        }
    }

    /// Whether bands cover the discrepancy.
    pub fn is_learnt(&self) -> bool {
        matches!(self, Self::Learnt { .. })
    }

    /// Enters the bands of an index, and what is known of its change.
    ///
    /// - `within`: uncertainty of the change within the model
    pub fn enter(&self, index: &mut Predicted, within: &Interval) {
        let (Some(twin), Some(change)) = (index.twin, index.relative_change) else {
            return;
        };
        let of_values = |changes: [f64; 2]| {
            let [a, b] = changes.map(|c| twin * (1.0 + c));
            // The order turns where the index is negative.
            [a.min(b), a.max(b)]
        };
        index.band_within_model = Some(of_values(within.around(change)));
        index.band = index.band_within_model;
        if let Self::Learnt { table, made } = self
            && let Some(discrepancy) = table.discrepancy(made, index.name)
        {
            let band = within.widened(change, discrepancy.half_width);
            index.band = Some(of_values(band));
            let right = discrepancy.right_direction;
            index.known = Some(match band[0] > 0.0 || band[1] < 0.0 {
                true => Known::Size,
                false if right.is_some_and(|share| share >= RIGHT_DIRECTION) => Known::Direction,
                false => Known::Neither,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_calibrate::formulations::{Errors, Kind};

    fn learnt(right_direction: f64) -> Discrepancies {
        let errors = Errors {
            half_width: 0.04,
            right_direction,
        };
        let kind = Kind {
            quantity: "compliance_mL_per_mmHg".to_owned(),
            factor: 0.75,
            indices: [("SV_mL".to_owned(), errors)].into(),
        };
        let table = Table {
            ventricle: "one-fibre".to_owned(),
            circulation: "open".to_owned(),
            n_twins: 20,
            changes: vec![kind],
        };
        Discrepancies {
            tables: vec![table],
            ..Discrepancies::default()
        }
    }

    fn made(key: &str, factor: f64) -> Vec<Changed> {
        vec![Changed {
            key: key.to_owned(),
            before: 2.0,
            after: 2.0 * factor,
        }]
    }

    fn index(change: f64) -> Predicted {
        Predicted {
            name: "SV_mL",
            twin: Some(100.0),
            relative_change: Some(change),
            predicted: Some(100.0 * (1.0 + change)),
            band: None,
            band_within_model: None,
            known: None,
            simulated_before: None,
            simulated_after: None,
        }
    }

    /// Bands of an index that changes by `change`, uncertain by 3 % within the model.
    fn entered(formulations: &Formulations<'_>, change: f64) -> Predicted {
        let mut index = index(change);
        let within = Interval {
            low: change - 0.03,
            median: change,
            high: change + 0.03,
        };
        formulations.enter(&mut index, &within);
        index
    }

    const HERE: (&str, &str) = ("one-fibre", "open");

    #[test]
    fn a_band_contains_that_within_the_model_and_the_discrepancy() {
        let compliance = made("compliance_mL_per_mmHg", 0.75);
        let learnt = learnt(0.95);
        let found = Formulations::of(&learnt, HERE, &compliance, true);
        let index = entered(&found, 0.08);
        let near = |found: Option<[f64; 2]>, low: f64, high: f64| {
            let [a, b] = found.unwrap();
            assert!((a - low).abs() < 1e-9 && (b - high).abs() < 1e-9, "{a} {b}");
        };
        near(index.band_within_model, 105.0, 111.0);
        near(index.band, 103.0, 113.0);
        assert_eq!(index.known, Some(Known::Size));
        let squared = made("compliance_mL_per_mmHg", 0.75f64.powi(2));
        let twice = Formulations::of(&learnt, HERE, &squared, true);
        let wide = 100.0 * 0.08f64.hypot(0.03);
        near(entered(&twice, 0.08).band, 108.0 - wide, 108.0 + wide);
        assert!(
            found.sentence(false).contains("20 hearts"),
            "{}",
            found.sentence(false)
        );
    }

    #[test]
    fn a_band_with_both_directions_knows_one_where_it_was_right() {
        let compliance = made("compliance_mL_per_mmHg", 0.75);
        for (right, known) in [(0.9, Known::Direction), (0.85, Known::Neither)] {
            let learnt = learnt(right);
            let found = Formulations::of(&learnt, HERE, &compliance, true);
            assert_eq!(entered(&found, -0.02).known, Some(known));
            assert_eq!(entered(&found, -0.06).known, Some(Known::Size));
        }
    }

    #[test]
    fn what_was_not_compared_has_the_band_within_the_model_alone() {
        let learnt = learnt(0.95);
        let [known, other] = ["compliance_mL_per_mmHg", "Ca_max_uM"].map(|key| made(key, 1.1));
        let of = |place, made, periodic| Formulations::of(&learnt, place, made, periodic);
        for (found, reason) in [
            (of(HERE, &other, true), "change of Ca_max_uM"),
            (
                of(("finite-element", "open"), &known, true),
                "finite-element",
            ),
            (of(("one-fibre", "closed"), &known, true), "this circuit"),
            (of(HERE, &known, false), "steady"),
        ] {
            let said = found.sentence(true);
            assert!(
                said.contains("in this model alone") && said.contains(reason),
                "{said}"
            );
            let index = entered(&found, 0.08);
            assert!(index.band.is_some() && index.band == index.band_within_model);
            assert_eq!(index.known, None);
        }
    }
}
