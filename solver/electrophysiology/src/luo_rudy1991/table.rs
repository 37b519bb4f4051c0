//! Tabulated terms that depend only on the potential, for one time step.

use super::{Parameters, gates};

/// Grid of the table \[mV\]. It contains −40 mV, where two gates change their equations.
const LOWEST_MV: f64 = -120.0;
const HIGHEST_MV: f64 = 80.0;
const PER_MV: f64 = 20.0;

/// Steady values of the six gates, remaining fraction of a deviation after a step, exp(−Δt/τ),
/// instantaneous currents, and the potassium current with its gate open \[µA/cm²\].
pub(super) type Row = [f64; 14];

/// Indices of the first remaining fraction and of the two currents.
pub(super) const LEFT: usize = 6;
pub(super) const INSTANTANEOUS: usize = 12;
pub(super) const OPEN_POTASSIUM: usize = 13;

#[derive(Debug, Clone)]
pub(super) struct Table {
    rows: Vec<Row>,
    parameters: Parameters,
    step_ms: f64,
}

impl Table {
    pub(super) fn new(parameters: &Parameters, step_ms: f64) -> Self {
        let last = ((HIGHEST_MV - LOWEST_MV) * PER_MV).round() as usize;
        let rows = (0..=last)
            .map(|i| exact(parameters, step_ms, LOWEST_MV + i as f64 / PER_MV))
            .collect();
        Self {
            rows,
            parameters: parameters.clone(),
            step_ms,
        }
    }

    /// Row by linear interpolation, or computed directly outside the table. Not-a-number gives
    /// not-a-number.
    #[inline]
    pub(super) fn at(&self, v: f64) -> Row {
        let place = (v - LOWEST_MV) * PER_MV;
        if !(place >= 0.0 && place < (self.rows.len() - 1) as f64) {
            return exact(&self.parameters, self.step_ms, v);
        }
        let i = place as usize;
        let part = place - i as f64;
        let (low, high) = (&self.rows[i], &self.rows[i + 1]);
        std::array::from_fn(|k| low[k] + part * (high[k] - low[k]))
    }
}

fn exact(parameters: &Parameters, step_ms: f64, v: f64) -> Row {
    let gates = gates(v);
    let mut row = [0.0; 14];
    for (k, gate) in gates.iter().enumerate() {
        row[k] = gate.steady;
        row[LEFT + k] = (-step_ms / gate.tau_ms).exp();
    }
    row[INSTANTANEOUS] = parameters.instantaneous(v);
    row[OPEN_POTASSIUM] = parameters.open_potassium(v);
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_formulas_away_from_the_switch() {
        let parameters = Parameters::default();
        let table = Table::new(&parameters, 0.025);
        for i in 0..4000 {
            let v = -119.9871 + 0.0497 * f64::from(i);
            if (v + 40.0).abs() < 0.06 || (v + 100.0).abs() < 0.06 {
                continue; // h, j and Xi jump there
            }
            for (k, (found, expected)) in table
                .at(v)
                .iter()
                .zip(exact(&parameters, 0.025, v))
                .enumerate()
            {
                assert!(
                    (found - expected).abs() < 2e-5 * (1.0 + expected.abs()),
                    "{k} at {v}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn beyond_the_table_the_formulas_hold() {
        let parameters = Parameters::default();
        let table = Table::new(&parameters, 0.025);
        for v in [-150.0, 95.0] {
            assert_eq!(table.at(v), exact(&parameters, 0.025, v));
        }
        assert!(table.at(f64::NAN)[INSTANTANEOUS].is_nan());
    }
}
