//! Local searches at the end of a global one, each from the best point so far.
//!
//! A second search may still improve the result of the first: in the parameters' own units,
//! parameters with small values move first; in shares of their intervals, all move alike. The cost
//! never rises, and every evaluated point lies inside the box.

use crate::Interval;
use crate::lbfgsb::{self, Lbfgsb, LbfgsbError};
use crate::population::{scale, to_unit};
use serde::{Deserialize, Serialize};

/// Coordinates of a local search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// Own units of the parameters, as in `SciPy`.
    #[default]
    OwnUnits,
    /// Share of each interval, from 0 to 1.
    Shares,
}

/// Settings of one local search.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalSearch {
    /// Coordinates in which the search moves.
    pub coordinates: Coordinates,
    /// Tolerances and limits, in these coordinates.
    pub settings: lbfgsb::Settings,
}

/// Local searches in progress. The state can be serialised after any [`Polish::tell`] and continues
/// bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Polish {
    bounds: Vec<Interval>,
    best: Vec<f64>,
    #[serde(with = "crate::storage::cost")]
    cost: f64,
    is_better: bool,
    current: Option<(Coordinates, Lbfgsb)>,
    /// Remaining searches, the next one last.
    waiting: Vec<LocalSearch>,
    n_evaluations: usize,
}

impl Polish {
    /// Starts at a point of known cost; `None` if `searches` is empty or the cost is not finite.
    ///
    /// # Errors
    /// [`LbfgsbError`] if the box is invalid or its dimension differs from the start's.
    pub fn new(
        start: &[f64],
        cost: f64,
        bounds: &[Interval],
        searches: &[LocalSearch],
    ) -> Result<Option<Self>, LbfgsbError> {
        if searches.is_empty() || !cost.is_finite() {
            return Ok(None);
        }
        let mut polish = Self {
            bounds: bounds.to_vec(),
            best: start.to_vec(),
            cost,
            is_better: false,
            current: None,
            waiting: searches.iter().rev().copied().collect(),
            n_evaluations: 0,
        };
        polish.begin_next()?;
        Ok(Some(polish))
    }

    /// The points to evaluate next, in the parameters' units and inside the box; empty at the end.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        match &self.current {
            None => Vec::new(),
            Some((Coordinates::OwnUnits, search)) => search.ask(),
            Some((Coordinates::Shares, search)) => search
                .ask()
                .iter()
                .map(|p| scale(p, &self.bounds))
                .collect(),
        }
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`LbfgsbError`] if the number of costs differs or all searches have ended.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), LbfgsbError> {
        let (coordinates, search) = self.current.as_mut().ok_or(LbfgsbError::Ended)?;
        search.tell(costs)?;
        if search.ending().is_none() {
            return Ok(());
        }
        let (point, cost) = search.best();
        if cost < self.cost {
            self.best = match coordinates {
                Coordinates::OwnUnits => point.to_vec(),
                Coordinates::Shares => scale(point, &self.bounds),
            };
            (self.cost, self.is_better) = (cost, true);
        }
        self.n_evaluations += search.n_evaluations();
        self.begin_next()
    }

    fn begin_next(&mut self) -> Result<(), LbfgsbError> {
        self.current = match self.waiting.pop() {
            None => None,
            Some(LocalSearch {
                coordinates,
                settings,
            }) => {
                let search = match coordinates {
                    Coordinates::OwnUnits => Lbfgsb::new(&self.best, &self.bounds, settings)?,
                    Coordinates::Shares => {
                        let box_of_shares = vec![Interval::new(0.0, 1.0); self.bounds.len()];
                        Lbfgsb::new(&to_unit(&self.best, &self.bounds), &box_of_shares, settings)?
                    }
                };
                Some((coordinates, search))
            }
        };
        Ok(())
    }

    /// Whether all searches have ended.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.current.is_none()
    }

    /// Best point of the finished searches and its cost; `None` if it is not below the cost of the
    /// start.
    #[must_use]
    pub fn gain(&self) -> Option<(&[f64], f64)> {
        self.is_better.then_some((&self.best, self.cost))
    }

    /// Number of evaluations so far, a multiple of D + 1.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations
            + self
                .current
                .as_ref()
                .map_or(0, |(_, search)| search.n_evaluations())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A valley whose coordinates differ by six orders of magnitude, with its minimum on a bound.
    fn valley(p: &[f64]) -> f64 {
        let (x, y) = (1e5 * p[0], 0.1 * p[1]);
        1.0 + (x - 1.0 - 0.5 * y * y).powi(2) + 1e-3 * (y - 12.0).powi(2)
    }

    const BOX: [Interval; 2] = [
        Interval {
            lower: 0.0,
            upper: 1e-3,
        },
        Interval {
            lower: 0.0,
            upper: 100.0,
        },
    ];

    fn searches(of: &[Coordinates]) -> Vec<LocalSearch> {
        let search = |coordinates| LocalSearch {
            coordinates,
            ..LocalSearch::default()
        };
        of.iter().copied().map(search).collect()
    }

    fn finish(mut polish: Polish) -> Polish {
        while !polish.is_ended() {
            let points = polish.ask();
            assert!(
                points
                    .iter()
                    .all(|p| p.iter().zip(BOX).all(|(x, b)| b.contains(*x))),
                "{points:?}"
            );
            let costs: Vec<f64> = points.iter().map(|p| valley(p)).collect();
            polish.tell(&costs).unwrap();
        }
        assert!(polish.ask().is_empty() && polish.tell(&[]) == Err(LbfgsbError::Ended));
        polish
    }

    #[test]
    fn shares_find_what_own_units_leave_and_end_on_the_bound() {
        let start = [5e-4, 30.0];
        let begin = |of: &[Coordinates]| {
            Polish::new(&start, valley(&start), &BOX, &searches(of))
                .unwrap()
                .unwrap()
        };
        let own = finish(begin(&[Coordinates::OwnUnits]));
        let both = finish(begin(&[Coordinates::OwnUnits, Coordinates::Shares]));
        let (own, best) = (
            own.gain().map_or(valley(&start), |g| g.1),
            both.gain().unwrap(),
        );
        assert!(best.1 < own, "{} {own}", best.1);
        assert_eq!(best.0[1], 100.0, "{best:?}");
        assert_eq!(best.1, valley(best.0));
    }

    #[test]
    fn there_is_none_without_a_search_or_a_cost() {
        assert_eq!(Polish::new(&[1e-4, 1.0], 1.0, &BOX, &[]).unwrap(), None);
        assert_eq!(
            Polish::new(
                &[1e-4, 1.0],
                f64::INFINITY,
                &BOX,
                &searches(&[Coordinates::Shares])
            )
            .unwrap(),
            None
        );
        assert!(Polish::new(&[1e-4], 1.0, &BOX, &searches(&[Coordinates::OwnUnits])).is_err());
    }

    proptest! {
        /// The cost never rises, and storage after any batch does not change the rest of the run.
        #[test]
        fn never_rises_and_continues_from_storage(x in 0.0..1e-3f64, y in 0.0..100.0f64, store_every in 1usize..9) {
            let of = [Coordinates::Shares, Coordinates::OwnUnits, Coordinates::Shares];
            let begin = || Polish::new(&[x, y], valley(&[x, y]), &BOX, &searches(&of)).unwrap().unwrap();
            let whole = finish(begin());
            let mut polish = begin();
            let mut n_batches = 0;
            while !polish.is_ended() {
                let costs: Vec<f64> = polish.ask().iter().map(|p| valley(p)).collect();
                polish.tell(&costs).unwrap();
                n_batches += 1;
                if n_batches % store_every == 0 {
                    polish = serde_json::from_str(&serde_json::to_string(&polish).unwrap()).unwrap();
                }
            }
            prop_assert_eq!(&polish, &whole);
            prop_assert!(whole.gain().is_none_or(|(point, cost)| cost < valley(&[x, y]) && cost == valley(point)));
            prop_assert!(whole.n_evaluations().is_multiple_of(3));
        }
    }
}
