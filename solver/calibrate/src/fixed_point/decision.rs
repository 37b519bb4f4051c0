//! Decision after each iteration: the next parameters, or the end with a quality.
//!
//! ```text
//! history ──► last simulation failed ───► Ended FailedAt(k), best earlier iteration
//!         ├─► last beat not whole ──────► as failed after an earlier whole beat; else an ordinary
//!         │                               iteration that is never the best
//!         ├─► a cost within tolerance ──► Ended Converged      (stop = first_converged)
//!         ├─► three without gain ───────► Ended Stalled        (Converged if within tolerance)
//!         ├─► limit reached ────────────► Ended LimitReached   (Converged if within tolerance)
//!         └─► otherwise ────────────────► Next(update of the last iteration)
//! resumed ──► Next(update of the best stored iteration under the new settings, without
//!             repeating stored simulations)
//! ```

use super::settings::{self, Stop};
use super::{Cost, FixedPointError, driver};
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_vocabulary::step1::{Step1Parameter, Step1Parameters};
use cardiotwin_vocabulary::step1_settings::Step1Settings;
use serde::{Deserialize, Serialize};

/// Outcome of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// The simulation succeeded by the rules of docs/models.md.
    Simulated(Biomarkers),
    /// The simulation reached the end of the cycle, but a valve did not open and close. Before the
    /// first whole beat, the available biomarkers still drive the updates, but the iteration is
    /// never the result. After a whole beat, this outcome counts as a failure.
    NoWholeBeat(Biomarkers),
    /// The simulation aborted or ended in an invalid state.
    Failed,
}

impl Outcome {
    /// Outcome of a beat that reached its end. Without a whole beat only biomarkers of pressure
    /// count, because hardly any volume has moved.
    #[must_use]
    pub fn of(biomarkers: &Biomarkers, is_whole_beat: bool) -> Self {
        let of_organ = biomarkers.organ_alone();
        if is_whole_beat {
            Self::Simulated(of_organ)
        } else {
            Self::NoWholeBeat(of_organ.pressure_alone())
        }
    }
}

/// Parameters and the outcome of their simulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Parameters with which the organ was simulated.
    pub parameters: Step1Parameters,
    /// Outcome of the simulation.
    pub outcome: Outcome,
}

/// Relative difference of a parameter below which two simulations are the same.
const HARDLY: f64 = 1e-4;

/// All simulations so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct History {
    /// Parameters with which the loop begins.
    pub initial: Step1Parameters,
    /// All iterations, oldest first, including those under earlier settings.
    pub iterations: Vec<Iteration>,
    /// Number of iterations made under earlier settings. Limit, stagnation and failure count from
    /// here.
    #[serde(default)]
    pub resumed_at: usize,
}

impl History {
    /// A history without iterations.
    #[must_use]
    pub fn new(initial: Step1Parameters) -> Self {
        Self {
            initial,
            iterations: Vec::new(),
            resumed_at: 0,
        }
    }

    /// The same history, to be continued under other settings.
    #[must_use]
    pub fn resumed(mut self) -> Self {
        self.resumed_at = self.iterations.len();
        self
    }

    /// Whether no earlier iteration simulated these parameters or ones that hardly differ.
    #[must_use]
    pub fn lacks(&self, parameters: &Step1Parameters) -> bool {
        !self
            .iterations
            .iter()
            .any(|i| i.parameters.close_to(parameters, HARDLY))
    }

    /// Appends the outcome of a simulation.
    pub fn push(&mut self, parameters: Step1Parameters, outcome: Outcome) {
        self.iterations.push(Iteration {
            parameters,
            outcome,
        });
    }
}

/// Quality of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// The best iteration's cost is within the tolerance.
    Converged,
    /// Iterations no longer lower the misfit, or the update gives no new parameters.
    Stalled,
    /// The largest number of iterations was reached.
    LimitReached,
    /// The simulation of this iteration failed; the best earlier one is the result.
    FailedAt(usize),
}

/// Reason for the end of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// The cost is within the tolerance.
    Tolerance,
    /// Too many iterations in a row brought no improvement.
    Stagnation,
    /// The largest number of iterations was reached.
    Limit,
    /// The last simulation failed.
    Failure,
    /// The next parameters were simulated before.
    NothingNew,
}

/// Decision that follows from a history.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "decision")]
pub enum Decision {
    /// The loop continues with these parameters.
    Next {
        /// Next parameters, inside their bounds.
        parameters: Step1Parameters,
        /// Iteration that was updated; `None` for the initial parameters.
        from: Option<usize>,
    },
    /// The loop is over.
    Ended {
        /// Quality of the result.
        quality: Quality,
        /// Reason for the end.
        because: Ending,
        /// Among the iterations within the bounds, the one with the lowest misfit within the
        /// tolerance, else the one with the lowest cost. `None` if no simulation succeeded there.
        best: Option<usize>,
    },
}

/// Decides what follows from everything simulated so far. It is a pure function, so that a replay
/// makes the same decisions.
///
/// Updates are eqs. 13 and 15 of Jung et al. 2022 with each ratio raised to the damping. A
/// parameter whose ratio does not exist (no measured volume, or a biomarker that the simulation
/// could not give) keeps its value.
///
/// # Errors
/// [`FixedPointError`] if the settings, measured biomarkers or initial parameters are invalid;
/// outcomes of simulations never cause an error.
pub fn decide(
    settings: &Step1Settings,
    measured: &Biomarkers,
    history: &History,
) -> Result<Decision, FixedPointError> {
    Ok(Run::new(settings, measured, history)?.decide())
}

/// The end of a loop in which another rule proposes the next parameters, or `None` while it
/// continues.
///
/// It differs from [`decide`] in that a failed simulation counts as one without improvement,
/// because such a rule can turn back from it.
///
/// # Errors
/// As for [`decide`].
pub fn ended(
    settings: &Step1Settings,
    measured: &Biomarkers,
    history: &History,
) -> Result<Option<Decision>, FixedPointError> {
    Ok(Run::new(settings, measured, history)?.ended(true))
}

/// The end of a loop whose other rule proposes nothing new.
///
/// # Errors
/// As for [`decide`].
pub fn nothing_new(
    settings: &Step1Settings,
    measured: &Biomarkers,
    history: &History,
) -> Result<Decision, FixedPointError> {
    Ok(Run::new(settings, measured, history)?.ending(Quality::Stalled, Ending::NothingNew))
}

/// The end of a loop whose other rule promises too little, or `None` while it continues.
///
/// This applies to space mapping with the automatic stop. The loop ends if the best iteration is
/// within the tolerance and the promised misfit is not lower than its misfit by
/// [`PROMISED_FRACTION`].
///
/// - `promised_misfit`: weighted misfit that the rule expects of its next parameters
///
/// # Errors
/// As for [`decide`].
pub fn content(
    settings: &Step1Settings,
    measured: &Biomarkers,
    history: &History,
    promised_misfit: f64,
) -> Result<Option<Decision>, FixedPointError> {
    let run = Run::new(settings, measured, history)?;
    let best = run
        .best(history.iterations.len())
        .and_then(|best| run.misfits[best]);
    let is_little = best.is_some_and(|best| promised_misfit > best * (1.0 - PROMISED_FRACTION));
    let ends = settings::stop(settings) == Stop::NoPromise && run.converged() && is_little;
    Ok(ends.then(|| run.ending(Quality::Converged, Ending::Tolerance)))
}

/// Fraction of the misfit that another simulation must promise to remove. A fifth is about three
/// times the error of the promise from the second simulation on.
pub const PROMISED_FRACTION: f64 = 0.2;

/// Biomarkers of each iteration; `None` if it failed or lost the whole beat of an earlier
/// iteration.
fn told(history: &History) -> impl Iterator<Item = Option<&Biomarkers>> {
    let mut is_early = true;
    history.iterations.iter().map(move |i| match &i.outcome {
        Outcome::Simulated(b) => {
            is_early = false;
            Some(b)
        }
        Outcome::NoWholeBeat(b) => is_early.then_some(b),
        Outcome::Failed => None,
    })
}

fn validate(measured: &Biomarkers, history: &History) -> Result<(), FixedPointError> {
    for biomarker in Biomarker::OF_COST {
        let value = measured.get(biomarker);
        let negative = biomarker == Biomarker::DpdtMin;
        let expected = if negative {
            "negative and finite"
        } else {
            "positive and finite"
        };
        let optional = biomarker.is_of_volume() && value.is_none();
        if !optional && !value.is_some_and(|v| v.is_finite() && v != 0.0 && (v < 0.0) == negative) {
            return Err(FixedPointError::Measured {
                biomarker,
                value,
                expected,
            });
        }
    }
    for parameter in Step1Parameter::ALL {
        let value = history.initial.get(parameter);
        if !(value > 0.0 && value.is_finite()) {
            return Err(FixedPointError::Initial { parameter, value });
        }
    }
    let (resumed_at, n_iterations) = (history.resumed_at, history.iterations.len());
    if resumed_at > n_iterations {
        return Err(FixedPointError::ResumedAt {
            resumed_at,
            n_iterations,
        });
    }
    Ok(())
}

struct Run<'a> {
    settings: &'a Step1Settings,
    measured: &'a Biomarkers,
    history: &'a History,
    /// Cost of each iteration; `None` if it failed or lost the whole beat of an earlier iteration.
    costs: Vec<Option<f64>>,
    /// Misfit of each iteration with the settings' weights; `None` as for `costs`.
    misfits: Vec<Option<f64>>,
}

impl<'a> Run<'a> {
    fn new(
        settings: &'a Step1Settings,
        measured: &'a Biomarkers,
        history: &'a History,
    ) -> Result<Self, FixedPointError> {
        settings::validate(settings)?;
        validate(measured, history)?;
        let weights = settings::weights(settings)?;
        let costs = told(history)
            .map(|b| Some(Cost::of(measured, b?).total))
            .collect();
        let misfits = told(history)
            .map(|b| Some(weights.misfit(measured, b?)))
            .collect();
        Ok(Self {
            settings,
            measured,
            history,
            costs,
            misfits,
        })
    }

    fn decide(&self) -> Decision {
        if let Some(ended) = self.ended(false) {
            return ended;
        }
        match self.next() {
            Ok((parameters, from)) => Decision::Next { parameters, from },
            Err(quality) => self.ending(quality, Ending::NothingNew),
        }
    }

    fn converged(&self) -> bool {
        let best = self.best(self.history.iterations.len());
        best.and_then(|b| self.costs[b])
            .is_some_and(|c| c <= self.settings.tolerance)
    }

    fn ending(&self, otherwise: Quality, because: Ending) -> Decision {
        let quality = if self.converged() {
            Quality::Converged
        } else {
            otherwise
        };
        Decision::Ended {
            quality,
            because,
            best: self.best(self.history.iterations.len()),
        }
    }

    /// Ends the loop if a stop rule applies. With `forgiving`, a failed simulation counts as one
    /// without improvement.
    fn ended(&self, forgiving: bool) -> Option<Decision> {
        let n = self.history.iterations.len();
        let resumed_at = self.history.resumed_at;
        if !forgiving && n > resumed_at && self.costs[n - 1].is_none() {
            return Some(self.ending(Quality::FailedAt(n - 1), Ending::Failure));
        }
        if self.converged() && settings::stop(self.settings) == Stop::FirstConverged {
            return Some(self.ending(Quality::Converged, Ending::Tolerance));
        }
        if self.without_improvement(forgiving) >= self.settings.stall_iterations as usize {
            return Some(self.ending(Quality::Stalled, Ending::Stagnation));
        }
        (n - resumed_at >= self.settings.max_iterations as usize)
            .then(|| self.ending(Quality::LimitReached, Ending::Limit))
    }

    /// Index of the best of the first `n` iterations: whole beats within the bounds, with the
    /// lowest misfit within the tolerance, else with the lowest cost. The first of equals is taken.
    fn best(&self, n: usize) -> Option<usize> {
        self.lowest(n, |i| {
            self.is_whole(i) && self.settings.admits(&self.history.iterations[i].parameters)
        })
    }

    fn is_whole(&self, i: usize) -> bool {
        matches!(self.history.iterations[i].outcome, Outcome::Simulated(_))
    }

    fn lowest(&self, n: usize, admits: impl Fn(usize) -> bool) -> Option<usize> {
        (0..n)
            .filter(|i| admits(*i))
            .filter_map(|i| {
                let cost = self.costs[i]?;
                let is_beyond = cost > self.settings.tolerance;
                Some((
                    i,
                    is_beyond,
                    if is_beyond { cost } else { self.misfits[i]? },
                ))
            })
            .min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)))
            .map(|x| x.0)
    }

    /// Number of last iterations in a row that did not lower the best misfit by the required
    /// fraction.
    fn without_improvement(&self, forgiving: bool) -> usize {
        let resumed_at = self.history.resumed_at;
        let mut best = self.best(resumed_at).and_then(|b| self.misfits[b]);
        let mut is_whole = best.is_some();
        let mut in_a_row = 0;
        for (i, misfit) in self.misfits.iter().enumerate().skip(resumed_at) {
            let Some(misfit) = *misfit else {
                in_a_row += usize::from(forgiving);
                continue;
            };
            // The first whole beat is a gain at any cost.
            if self.is_whole(i) && !is_whole {
                (is_whole, best) = (true, None);
            }
            let helped = best.is_none_or(|b| misfit <= b * (1.0 - self.settings.stall_improvement));
            in_a_row = if helped { 0 } else { in_a_row + 1 };
            best = Some(best.map_or(misfit, |b| b.min(misfit)));
        }
        in_a_row
    }

    /// The next parameters and the iteration that they update, or the quality of the end if every
    /// proposal is stored already.
    fn next(&self) -> Result<(Step1Parameters, Option<usize>), Quality> {
        let iterations = &self.history.iterations;
        let n = iterations.len();
        let mut from = if n > self.history.resumed_at {
            Some(n - 1)
        } else {
            // A resumed loop starts from the best iteration. If none lies within the new bounds, it
            // starts from the best of all, clamped to the bounds.
            self.best(n).or_else(|| self.lowest(n, |_| true))
        };
        for _ in 0..=n {
            let proposal = match from {
                None => self.settings.clamp(&self.history.initial),
                Some(i) => self.update(&iterations[i]),
            };
            let Some(stored) = iterations
                .iter()
                .position(|i| i.parameters.same_as(&proposal))
            else {
                return Ok((proposal, from));
            };
            // A stored iteration is not simulated again: the loop continues from it as if it were
            // new.
            if self.costs[stored].is_none() {
                return Err(Quality::FailedAt(stored));
            }
            if from == Some(stored) {
                break;
            }
            from = Some(stored);
        }
        Err(Quality::Stalled)
    }

    fn update(&self, iteration: &Iteration) -> Step1Parameters {
        let mut next = iteration.parameters;
        let (Outcome::Simulated(simulated) | Outcome::NoWholeBeat(simulated)) = &iteration.outcome
        else {
            return next;
        };
        for parameter in self.settings.moving() {
            let (biomarker, exponent) = driver(parameter);
            if let Some(ratio) = self.measured.ratio_to(simulated, biomarker) {
                let moved = next.get(parameter) * ratio.powf(exponent * self.settings.damping);
                next.set(parameter, moved);
            }
        }
        self.settings.clamp(&next)
    }
}
