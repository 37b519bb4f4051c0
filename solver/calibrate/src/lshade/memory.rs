//! Success history: mutation scales and crossover rates that have lowered costs.

use rand::Rng;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Spread of a candidate's scale and rate around the memory's.
const SPREAD: f64 = 0.1;

/// Memory of scales and rates, whose cells are overwritten in turn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Memory {
    scales: Vec<f64>,
    /// `None` once only a rate of zero has succeeded in the cell: the rate then stays zero.
    rates: Vec<Option<f64>>,
    next: usize,
}

/// A candidate that lowered its parent's cost.
pub(super) struct Success {
    pub(super) scale: f64,
    pub(super) rate: f64,
    /// Fall of the cost; infinite if the parent had failed.
    pub(super) fall: f64,
}

impl Memory {
    pub(super) fn new(n_cells: usize) -> Self {
        Self {
            scales: vec![0.5; n_cells],
            rates: vec![Some(0.5); n_cells],
            next: 0,
        }
    }

    /// Mutation scale and crossover rate of one candidate.
    pub(super) fn draw(&self, random: &mut impl Rng) -> (f64, f64) {
        let cell = random.random_range(0..self.scales.len());
        let deviate = crate::normal::quantile(random.random_range(1e-15..1.0 - 1e-15));
        let rate = self.rates[cell].map_or(0.0, |rate| (rate + SPREAD * deviate).clamp(0.0, 1.0));
        loop {
            // Cauchy distribution.
            let scale = self.scales[cell] + SPREAD * (PI * (random.random::<f64>() - 0.5)).tan();
            if scale > 0.0 {
                return (scale.min(1.0), rate);
            }
        }
    }

    /// Overwrites one cell by the means of the successful scales and rates, weighted by the fall of
    /// the cost.
    pub(super) fn learn(&mut self, successes: &[Success]) {
        if successes.is_empty() {
            return;
        }
        let finite = |s: &Success| if s.fall.is_finite() { s.fall } else { 0.0 };
        let largest = successes.iter().map(finite).fold(0.0, f64::max);
        // A failed parent counts with the largest finite fall.
        let weight = |s: &Success| match s.fall {
            fall if fall.is_finite() => fall,
            _ if largest > 0.0 => largest,
            _ => 1.0,
        };
        // Lehmer's mean favours large values.
        let mean = |value: &dyn Fn(&Success) -> f64| {
            let squares: f64 = successes.iter().map(|s| weight(s) * value(s).powi(2)).sum();
            squares / successes.iter().map(|s| weight(s) * value(s)).sum::<f64>()
        };
        self.scales[self.next] = mean(&|s| s.scale);
        let all_zero = successes.iter().all(|s| s.rate == 0.0);
        self.rates[self.next] = self.rates[self.next]
            .filter(|_| !all_zero)
            .map(|_| mean(&|s| s.rate));
        self.next = (self.next + 1) % self.scales.len();
    }
}
