//! Profiles of all parameters at once, through an ask-and-tell interface.

use super::{Bound, IdentifiabilityError, Mark, Settings, bound_of, mark};
use crate::Interval;
use crate::lbfgsb::Lbfgsb;
use crate::storage::worst_if_not_finite;
use serde::{Deserialize, Serialize};

/// Longest step of a profile, as a fraction of the interval.
const LONGEST_STEP: f64 = 0.25;

/// End of a profile on one side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProfileEnd {
    /// No near-optimal set was found beyond this value, which is in the parameter's unit.
    Value(f64),
    /// Near-optimal sets exist up to the bound.
    Bound,
}

/// Profile of one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ProfiledParameter {
    /// Index of the parameter.
    pub parameter: usize,
    /// Its best value, in its unit.
    pub best: f64,
    /// Lower end of the near-optimal values.
    pub lower: ProfileEnd,
    /// Upper end of the near-optimal values.
    pub upper: ProfileEnd,
    /// Share of the interval that the near-optimal values fill, dimensionless.
    pub share: f64,
    /// Bound that the best value lies on, if any.
    pub bound: Option<Bound>,
    /// Extent to which the data determine the parameter.
    pub mark: Mark,
}

/// One side of one parameter's profile: a walk from the best value outwards, in unit coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Walk {
    parameter: usize,
    side: Bound,
    /// Outermost value for which a near-optimal set was found; `others` is the rest of that set.
    inside: f64,
    others: Vec<f64>,
    /// Innermost value for which none was found.
    outside: Option<f64>,
    step: f64,
    /// Value under trial; `refit` fits the other parameters there.
    value: f64,
    refit: Option<Lbfgsb>,
    end: Option<f64>,
}

/// Profiles of all parameters whose interval has a width.
///
/// Each profile is a walk to either side of the best value, and a batch holds the points of all
/// walks. The state can be serialised after any [`Profile::tell`] and continues bit for bit.
///
/// A walk's value counts as near-optimal as soon as one near-optimal set is found there, so that
/// refits inside the profile end early. Refits are local: an end is the end of the region connected
/// to the best set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    settings: Settings,
    bounds: Vec<Interval>,
    /// Best set, in unit coordinates.
    best: Vec<f64>,
    best_cost: f64,
    walks: Vec<Walk>,
    /// A set better than the initial one, in the parameters' units, with its cost.
    better: Option<(Vec<f64>, f64)>,
    n_evaluations: usize,
}

impl Profile {
    /// Starts at the best set of a fit, which is given in the parameters' units.
    ///
    /// # Errors
    /// [`IdentifiabilityError`] if the box, set, cost or settings are invalid.
    pub fn new(
        best: &[f64],
        best_cost: f64,
        bounds: &[Interval],
        settings: Settings,
    ) -> Result<Self, IdentifiabilityError> {
        Interval::validate(bounds)?;
        settings.validate()?;
        if best.len() != bounds.len() {
            return Err(IdentifiabilityError::Dimension {
                n_parameters: best.len(),
                n_bounds: bounds.len(),
            });
        }
        if !best_cost.is_finite() {
            return Err(IdentifiabilityError::NoBest);
        }
        let best: Vec<f64> = best
            .iter()
            .zip(bounds)
            .map(|(x, b)| b.to_unit(*x))
            .collect();
        let mut profile = Self {
            settings,
            bounds: bounds.to_vec(),
            best_cost,
            walks: Vec::new(),
            better: None,
            n_evaluations: 0,
            best,
        };
        for parameter in (0..bounds.len()).filter(|p| bounds[*p].width() > 0.0) {
            for side in [Bound::Lower, Bound::Upper] {
                let mut walk = Walk {
                    parameter,
                    side,
                    inside: profile.best[parameter],
                    others: without(&profile.best, parameter),
                    outside: None,
                    step: settings.first_step,
                    value: profile.best[parameter],
                    refit: None,
                    end: None,
                };
                profile.advance(&mut walk)?;
                profile.walks.push(walk);
            }
        }
        Ok(profile)
    }

    /// The points to evaluate next, in the parameters' units and inside the box; empty at the end.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        self.walks
            .iter()
            .flat_map(|walk| self.points(walk))
            .collect()
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`IdentifiabilityError`] if the number of costs differs from the number of points.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), IdentifiabilityError> {
        let n_points = self.ask().len();
        if costs.len() != n_points {
            return Err(IdentifiabilityError::Costs {
                n_costs: costs.len(),
                n_points,
            });
        }
        self.n_evaluations += n_points;
        let costs: Vec<f64> = costs.iter().copied().map(worst_if_not_finite).collect();
        let mut walks = std::mem::take(&mut self.walks);
        let mut told = 0;
        for walk in &mut walks {
            let points = self.points(walk);
            let here = &costs[told..told + points.len()];
            told += points.len();
            for (point, cost) in points.iter().zip(here) {
                if *cost < self.better.as_ref().map_or(self.best_cost, |b| b.1) {
                    self.better = Some((point.clone(), *cost));
                }
            }
            self.tell_walk(walk, here)?;
        }
        self.walks = walks;
        Ok(())
    }

    fn tell_walk(&self, walk: &mut Walk, costs: &[f64]) -> Result<(), IdentifiabilityError> {
        let Some(refit) = &mut walk.refit else {
            return Ok(());
        };
        // Without other parameters there is nothing to refit, and the single cost decides.
        let (near_optimal, ended) = if walk.others.is_empty() {
            (costs[0] <= self.settings.threshold(self.best_cost), true)
        } else {
            refit.tell(costs)?;
            let near_optimal = refit.best().1 <= self.settings.threshold(self.best_cost);
            if near_optimal {
                walk.others = refit.best().0.to_vec();
            }
            (near_optimal, refit.ending().is_some())
        };
        if near_optimal {
            walk.inside = walk.value;
            walk.step = (2.0 * walk.step).min(LONGEST_STEP);
        } else if ended {
            walk.outside = Some(walk.value);
        } else {
            return Ok(());
        }
        self.advance(walk)
    }

    /// Moves a walk to its next value, or records its end.
    fn advance(&self, walk: &mut Walk) -> Result<(), IdentifiabilityError> {
        let (limit, sign) = match walk.side {
            Bound::Lower => (0.0, -1.0),
            Bound::Upper => (1.0, 1.0),
        };
        walk.value = match walk.outside {
            Some(outside) if (outside - walk.inside).abs() <= self.settings.precision => {
                walk.end = Some(0.5 * (outside + walk.inside));
                walk.refit = None;
                return Ok(());
            }
            Some(outside) => 0.5 * (outside + walk.inside),
            None if walk.inside == limit => {
                walk.end = Some(limit);
                walk.refit = None;
                return Ok(());
            }
            None => (walk.inside + sign * walk.step).clamp(0.0, 1.0),
        };
        let start = if walk.others.is_empty() {
            vec![walk.value]
        } else {
            walk.others.clone()
        };
        walk.refit = Some(Lbfgsb::new(
            &start,
            &vec![Interval::new(0.0, 1.0); start.len()],
            self.settings.refit,
        )?);
        Ok(())
    }

    /// Points of a walk's refit, in the parameters' units.
    fn points(&self, walk: &Walk) -> Vec<Vec<f64>> {
        let Some(refit) = &walk.refit else {
            return Vec::new();
        };
        if walk.others.is_empty() {
            return vec![vec![self.bounds[0].from_unit(walk.value)]];
        }
        let whole = |mut point: Vec<f64>| {
            point.insert(walk.parameter, walk.value);
            point
                .iter()
                .zip(&self.bounds)
                .map(|(u, b)| b.from_unit(*u))
                .collect()
        };
        refit.ask().into_iter().map(whole).collect()
    }

    /// Whether all walks have ended.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.walks.iter().all(|w| w.end.is_some())
    }

    /// Number of evaluations so far.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations
    }

    /// A better set than the initial one, in the parameters' units, and its cost. It exists if the
    /// fit had not reached its minimum.
    #[must_use]
    pub fn better(&self) -> Option<(&[f64], f64)> {
        self.better
            .as_ref()
            .map(|(set, cost)| (set.as_slice(), *cost))
    }

    /// Profiles of all parameters with a width, once all walks have ended.
    #[must_use]
    pub fn outcome(&self) -> Option<Vec<ProfiledParameter>> {
        self.walks
            .chunks_exact(2)
            .map(|sides| self.profiled(&sides[0], &sides[1]))
            .collect()
    }

    /// Profiles in their present state: an unfinished walk ends at its outermost near-optimal set.
    #[must_use]
    pub fn so_far(&self) -> Vec<ProfiledParameter> {
        let end = |walk: &Walk| walk.end.unwrap_or(walk.inside);
        let between =
            |sides: &[Walk]| self.between(sides[0].parameter, end(&sides[0]), end(&sides[1]));
        self.walks.chunks_exact(2).map(between).collect()
    }

    fn profiled(&self, lower: &Walk, upper: &Walk) -> Option<ProfiledParameter> {
        Some(self.between(lower.parameter, lower.end?, upper.end?))
    }

    fn between(&self, parameter: usize, low: f64, high: f64) -> ProfiledParameter {
        let interval = self.bounds[parameter];
        let end = |unit: f64, limit: f64| match unit {
            _ if unit == limit => ProfileEnd::Bound,
            _ => ProfileEnd::Value(interval.from_unit(unit)),
        };
        let best = interval.from_unit(self.best[parameter]);
        let near_optimal = Interval::new(interval.from_unit(low), interval.from_unit(high));
        ProfiledParameter {
            parameter,
            best,
            lower: end(low, 0.0),
            upper: end(high, 1.0),
            share: high - low,
            bound: bound_of(best, interval),
            mark: mark(best, near_optimal, interval, &self.settings),
        }
    }
}

fn without(set: &[f64], parameter: usize) -> Vec<f64> {
    let mut others = set.to_vec();
    others.remove(parameter);
    others
}
