//! The ventricle in which a posterior's draws are sought: residuals and corrected beats as functions
//! of the parameters.

use cardiotwin_calibrate::posterior::{Evaluated, Mode, Target, TruncatedNormal, mode};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::posterior::PosteriorSpec;
use cardiotwin_schemas::task::OrganBeatSpec;

use super::likelihood::Likelihood;
use super::summary::Seen;
use crate::error::TaskError;
use crate::tasks::organ_beat::{ReducedOrgan, reduced, reduced_beat};
use crate::tasks::proposal::axes::{Axis, axes, named, point, tolerated};
use crate::tasks::surrogate::{searched, surrogate};

/// Shortest time step of the one-fibre ventricle, as in step 3's searches.
const TIME_STEP_MS: f64 = 2.0;
/// The same in the organ's law. Its error cancels in the difference from the twin's beat, but for a
/// small rest: the draws' medians move by a twentieth of their intervals (root mean square), as with
/// other random numbers.
const STEP_IN_LAW_MS: f64 = 4.0;

/// Number of points on the way from the twin to the prior's centre at which a beat is sought.
const POINTS_TO_CENTRE: u32 = 8;
/// Largest number of steps in the search for the mode.
const MODE_STEPS: usize = 100;

/// The ventricle with the twin's heart and loads, and the data.
pub(super) struct Model {
    /// Moved parameters.
    pub(super) axes: Vec<Axis>,
    /// Prior of each moved parameter.
    pub(super) prior: Vec<TruncatedNormal>,
    beat: OrganBeatSpec,
    organ: ReducedOrgan,
    pub(super) likelihood: Likelihood,
    /// Point from which the mode is sought, in coordinates of the axes.
    start: Vec<f64>,
}

impl Model {
    /// The ventricle, corrected to the twin's beat. If it has no beat with the twin's parameters, it
    /// stays as it is, and the error of the model is what its best beat leaves of the data.
    ///
    /// # Errors
    /// [`TaskError`] when the specification is outside the range of the models, or when the ventricle
    /// has no beat between the twin and the prior's centre.
    pub(super) fn new(spec: &PosteriorSpec) -> Result<Self, TaskError> {
        let axes = axes(&spec.parameters);
        let prior = axes.iter().map(Axis::truncated).collect();
        let organ = surrogate(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?;
        let shortest_step_ms = if organ.law.is_some() {
            STEP_IN_LAW_MS
        } else {
            TIME_STEP_MS
        };
        let beat = OrganBeatSpec {
            time_step_ms: spec.beat.time_step_ms.max(shortest_step_ms),
            ..searched(&spec.beat)
        };
        // Reports errors that are common to all draws: an invalid effect, a parameter
        // outside the range of the models.
        reduced(&beat, &organ)?;
        let model = Self {
            start: point(&axes, &spec.twin.parameters),
            likelihood: Likelihood::uncorrected(spec, &spec.twin.samples),
            axes,
            prior,
            beat,
            organ,
        };
        match model.simulate(&model.start) {
            Some(cheap) => Ok(Self {
                likelihood: Likelihood::of(spec, &cheap),
                ..model
            }),
            None => model.starting_at_own_mode(spec),
        }
    }

    /// The ventricle without a correction, with its own mode as the start.
    fn starting_at_own_mode(self, spec: &PosteriorSpec) -> Result<Self, TaskError> {
        let between = |k: u32| -> Vec<f64> {
            let share = f64::from(k) / f64::from(POINTS_TO_CENTRE);
            let way = self.start.iter().zip(&self.axes);
            way.map(|(x, axis)| x + share * (axis.prior.centre - x))
                .collect()
        };
        let misfit = |x: &[f64]| -> Option<f64> {
            Some(self.evaluate(x)?.residuals.iter().map(|r| r * r).sum())
        };
        let (_, start) = (1..=POINTS_TO_CENTRE)
            .map(between)
            .filter_map(|x| Some((misfit(&x)?, x)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .ok_or(TaskError::NoPosterior)?;
        let evaluate = |x: &[f64]| self.evaluate(x);
        let target = self.target(&evaluate);
        let first = mode(&target, &target.standard(&start), MODE_STEPS);
        let first = first.ok_or(TaskError::NoPosterior)?;
        let start = target.parameters(&first.u);
        let best = self.evaluate(&start).ok_or(TaskError::NoPosterior)?;
        Ok(Self {
            likelihood: Likelihood::uncorrected(spec, &best.seen.samples),
            start,
            ..self
        })
    }

    /// The mode of the posterior.
    ///
    /// # Errors
    /// [`TaskError::NoPosterior`] if the ventricle has no beat at the start.
    pub(super) fn mode(&self, target: &Target<'_, Seen>) -> Result<Mode, TaskError> {
        mode(target, &target.standard(&self.start), MODE_STEPS).ok_or(TaskError::NoPosterior)
    }

    /// The model and the prior of a posterior.
    pub(super) fn target<'a>(
        &'a self,
        evaluate: &'a (dyn Fn(&[f64]) -> Option<Evaluated<Seen>> + Sync),
    ) -> Target<'a, Seen> {
        Target {
            prior: &self.prior,
            model: evaluate,
        }
    }

    /// Residuals and corrected beat at a point; `None` without a whole beat.
    pub(super) fn evaluate(&self, x: &[f64]) -> Option<Evaluated<Seen>> {
        let seen = self.likelihood.corrected(self.simulate(x)?);
        Some(Evaluated {
            residuals: self.likelihood.residuals(&seen.samples, &seen.biomarkers),
            seen,
        })
    }

    fn simulate(&self, x: &[f64]) -> Option<OrganBeatResult> {
        let trial = self
            .beat
            .with_parameters(&named(&self.axes, &self.tolerated(x)?));
        reduced_beat(&trial, &self.organ)
            .ok()
            .flatten()
            .filter(|beat| beat.failed_check().is_none())
    }

    /// The point that is simulated in place of `x` ([`tolerated`]).
    pub(super) fn tolerated(&self, x: &[f64]) -> Option<Vec<f64>> {
        tolerated(&self.beat, &self.axes, x)
    }
}
