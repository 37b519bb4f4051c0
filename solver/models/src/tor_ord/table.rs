//! Tabulated terms that depend on the potential alone.

use super::CellType;
use super::gates::{self, Herg, Relaxation, gate};

/// Grid \[mV\]. It contains −40 mV, where two gates change their equations.
const LOWEST_MV: f64 = -130.0;
const HIGHEST_MV: f64 = 90.0;
const PER_MV: f64 = 20.0;
/// Gates that calcium does not move come first.
const N_GATES: usize = gate::J_CA + 1;
/// Targets and rates of these gates, and the rates of hERG that are not constant.
type Row = [f64; 2 * N_GATES + 8];

/// Targets and rates at each potential, of one cell type.
#[derive(Debug, Clone)]
pub(super) struct Table {
    rows: Vec<Row>,
    cell_type: CellType,
}

impl Table {
    pub fn new(cell_type: CellType) -> Self {
        let last = ((HIGHEST_MV - LOWEST_MV) * PER_MV).round() as usize;
        let rows = (0..=last)
            .map(|idx| exact(LOWEST_MV + idx as f64 / PER_MV, cell_type))
            .collect();
        Self { rows, cell_type }
    }

    /// Gates and hERG by linear interpolation, or computed directly outside of the grid.
    pub fn at(&self, v: f64) -> (Relaxation, Herg) {
        let place = (v - LOWEST_MV) * PER_MV;
        if !(place >= 0.0 && place < (self.rows.len() - 1) as f64) {
            return split(&exact(v, self.cell_type));
        }
        let idx = place as usize;
        let part = place - idx as f64;
        let mut row = self.rows[idx];
        for (low, high) in row.iter_mut().zip(&self.rows[idx + 1]) {
            *low += part * (high - *low);
        }
        split(&row)
    }
}

/// The parts of a row; zeros for the gates that calcium moves.
fn split(row: &Row) -> (Relaxation, Herg) {
    let mut relaxation = Relaxation {
        target: [0.0; gate::N],
        per_ms: [0.0; gate::N],
    };
    relaxation.target[..N_GATES].copy_from_slice(&row[..N_GATES]);
    relaxation.per_ms[..N_GATES].copy_from_slice(&row[N_GATES..2 * N_GATES]);
    let herg = Herg::from_varying(std::array::from_fn(|k| row[2 * N_GATES + k]));
    (relaxation, herg)
}

fn exact(v: f64, cell_type: CellType) -> Row {
    let relaxation = gates::of_voltage(v, cell_type);
    let mut row = [0.0; 2 * N_GATES + 8];
    row[..N_GATES].copy_from_slice(&relaxation.target[..N_GATES]);
    row[N_GATES..2 * N_GATES].copy_from_slice(&relaxation.per_ms[..N_GATES]);
    row[2 * N_GATES..].copy_from_slice(&Herg::of(v).varying());
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_equations() {
        for cell_type in [CellType::Endocardial, CellType::Epicardial] {
            let table = Table::new(cell_type);
            for k in 0..2600 {
                let v = -135.0 + 0.0937 * f64::from(k);
                if (-40.05..-40.0).contains(&v) {
                    continue;
                }
                let (found, herg) = table.at(v);
                let expected = exact(v, cell_type);
                for idx in 0..N_GATES {
                    let (target, per_ms) = (expected[idx], expected[N_GATES + idx]);
                    assert!((found.target[idx] - target).abs() < 1e-4, "{idx} {v}");
                    let relative = found.per_ms[idx] / per_ms - 1.0;
                    assert!(relative.abs() < 2e-3, "{idx} {v}: {relative}");
                }
                let of = herg.varying();
                for (found, expected) in of.iter().zip(&expected[2 * N_GATES..]) {
                    assert!((found / expected - 1.0).abs() < 1e-5, "{v}");
                }
            }
        }
    }
}
