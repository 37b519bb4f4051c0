//! Least squares problem of a load with any effects, over a record or a part of it.

use super::AfterloadError;
use super::effects::Effect;
use super::parameters::{Values, at};
use super::record::{Record, range};
use super::simulate::{Start, pressure};
use crate::Interval;
use crate::least_squares::{self, Fit, Settings};

/// Number of coordinates of the three elements with a free start; a periodic start has one less.
pub(super) const N_BASE: usize = 4;
/// Decades by which R2 and C may differ from the guess by the means of the record.
const DECADES: f64 = 2.5;
/// Starting values of the time constant R2 C \[s\].
const TIME_CONSTANTS_S: [f64; 3] = [0.6, 1.5, 4.0];
/// Tolerances that suffice here; the default ones take twice the time.
pub(super) const TOLERANCE: Settings = Settings {
    cost_tolerance: 1e-9,
    step_tolerance: 1e-8,
    max_steps: 60,
    difference_step: 1e-5,
};

/// Coordinates are R1, ln R2, ln C, the start (unless periodic), then the parameters of the
/// effects.
pub(super) struct Problem<'a> {
    pub(super) record: &'a Record,
    pub(super) start: Start,
    pub(super) effects: Vec<&'static Effect>,
    /// Whether each sample counts.
    pub(super) counts: Vec<bool>,
}

impl<'a> Problem<'a> {
    pub(super) fn new(record: &'a Record, start: Start, effects: &[&'static Effect]) -> Self {
        Self {
            record,
            start,
            effects: effects.to_vec(),
            counts: vec![true; record.n_samples()],
        }
    }

    pub(super) fn n_base(&self) -> usize {
        if self.start == Start::Free {
            N_BASE
        } else {
            N_BASE - 1
        }
    }

    pub(super) fn n_coordinates(&self) -> usize {
        self.n_base()
            + self
                .effects
                .iter()
                .map(|e| e.parameters.len())
                .sum::<usize>()
    }

    pub(super) fn values(&self, x: &[f64]) -> Values {
        let mut values = [0.0; at::N];
        values[at::R1] = x[0];
        values[at::R2] = x[1].exp();
        values[at::COMPLIANCE] = x[2].exp();
        values[at::START] = if self.start == Start::Free {
            x[3]
        } else {
            self.record.pressure[0]
        };
        let terms = self.effects.iter().flat_map(|e| e.parameters);
        terms
            .zip(&x[self.n_base()..])
            .for_each(|(parameter, value)| values[parameter.position] = *value);
        values
    }

    /// Model minus measured pressure at every sample.
    pub(super) fn all_residuals(&self, x: &[f64]) -> Vec<f64> {
        let model = pressure(self.record, &self.values(x), self.start);
        model
            .iter()
            .zip(&self.record.pressure)
            .map(|(m, p)| m - p)
            .collect()
    }

    /// Model minus measured pressure at the samples that count.
    pub(super) fn residuals(&self, x: &[f64]) -> Vec<f64> {
        self.all_residuals(x)
            .into_iter()
            .zip(&self.counts)
            .filter(|(_, counts)| **counts)
            .map(|(r, _)| r)
            .collect()
    }

    pub(super) fn bounds(&self) -> Vec<Interval> {
        let record = self.record;
        let (low, high) = range(&record.flow);
        let (lowest, highest) = range(&record.pressure);
        let (swing, pulse) = (high - low, highest - lowest);
        let resistance = self.resistance_guess();
        let reach = DECADES * std::f64::consts::LN_10;
        let compliance = 1.5 / resistance;
        let mut bounds = vec![
            Interval::new(0.0, 4.0 * pulse / swing),
            Interval::new(resistance.ln() - reach, resistance.ln() + reach),
            Interval::new(compliance.ln() - reach, compliance.ln() + reach),
        ];
        if self.start == Start::Free {
            bounds.push(Interval::new(lowest - 3.0 * pulse, highest + 3.0 * pulse));
        }
        let terms = self.effects.iter().flat_map(|e| e.parameters);
        bounds.extend(terms.map(|p| Interval::new(p.range.0, p.range.1)));
        bounds
    }

    /// Mean pressure over mean flow, where a mean flow below 2 % of the largest flow counts as 2 %.
    fn resistance_guess(&self) -> f64 {
        let record = self.record;
        let mean_pressure = record.pressure.iter().sum::<f64>() / record.n_samples() as f64;
        mean_pressure.abs().max(1.0)
            / record
                .mean_flow_ml_per_s()
                .max(0.02 * range(&record.flow).1)
    }

    fn base_starts(&self) -> Vec<Vec<f64>> {
        let bounds = Self {
            effects: Vec::new(),
            counts: Vec::new(),
            ..*self
        }
        .bounds();
        let resistance = self.resistance_guess();
        let of = |tau: &f64| {
            let mut x = vec![
                0.1 * bounds[0].upper,
                resistance.ln(),
                (tau / resistance).ln(),
            ];
            if self.start == Start::Free {
                x.push(self.record.pressure[0]);
            }
            x
        };
        TIME_CONSTANTS_S.iter().map(of).collect()
    }

    /// Best of the fits from these starts.
    pub(super) fn fit_from(
        &self,
        starts: &[Vec<f64>],
        settings: Settings,
    ) -> Result<Fit, AfterloadError> {
        let bounds = self.bounds();
        let mut best: Option<Fit> = None;
        let mut refused = None;
        for start in starts {
            match least_squares::fit(&|x| self.residuals(x), start, &bounds, settings) {
                Ok(fit)
                    if best
                        .as_ref()
                        .is_none_or(|b| fit.sum_of_squares < b.sum_of_squares) =>
                {
                    best = Some(fit)
                }
                Ok(_) => {}
                Err(error) => refused = Some(error),
            }
        }
        match (best, refused) {
            (Some(fit), _) => Ok(fit),
            (None, Some(error)) => Err(error.into()),
            (None, None) => unreachable!("there is at least one start"),
        }
    }

    /// Fit of the three elements alone, from several time constants.
    pub(super) fn fit_base(&self, settings: Settings) -> Result<Fit, AfterloadError> {
        self.fit_from(&self.base_starts(), settings)
    }
}
