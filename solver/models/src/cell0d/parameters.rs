//! The numbers that fits and sweeps of a cell change: Land active, Rice calcium and the passive scale.

use super::{CalciumInput, CellParameters, LandPassiveParameters};
use crate::calcium::Rice2008Parameters;
use crate::contraction::Land2017Parameters;
use crate::parameter::Parameter;

const N_LAND: usize = Land2017Parameters::TABLE.len();
const N_RICE: usize = Rice2008Parameters::TABLE.len();

/// Number of [`CELL_PARAMETERS`].
pub const N_CELL_PARAMETERS: usize = N_LAND + N_RICE + 1;

/// Land's parameters, then Rice's, then a_p.
pub const CELL_PARAMETERS: [Parameter; N_CELL_PARAMETERS] = {
    let mut all = [LandPassiveParameters::TABLE[0]; N_CELL_PARAMETERS];
    let mut i = 0;
    while i < N_LAND {
        all[i] = Land2017Parameters::TABLE[i];
        i += 1;
    }
    while i < N_LAND + N_RICE {
        all[i] = Rice2008Parameters::TABLE[i - N_LAND];
        i += 1;
    }
    all
};

impl CellParameters {
    /// A cell with Rice's calcium from numbers in the order of [`CELL_PARAMETERS`], the others at their defaults.
    #[must_use]
    pub fn from_values(
        values: &[f64; N_CELL_PARAMETERS],
        cycle_length_ms: f64,
        lambda0: f64,
    ) -> Self {
        let land = std::array::from_fn(|i| values[i]);
        let rice = std::array::from_fn(|i| values[N_LAND + i]);
        Self {
            land: Land2017Parameters::from_values(land),
            passive: LandPassiveParameters {
                a_p_kpa: values[N_LAND + N_RICE],
                ..LandPassiveParameters::default()
            },
            calcium: CalciumInput::Rice(Rice2008Parameters::from_values(rice)),
            cycle_length_ms,
            lambda0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_gives_the_default_cell() {
        let cell = CellParameters::from_values(&CELL_PARAMETERS.map(|p| p.default), 1000.0, 1.0);
        assert_eq!(cell, CellParameters::default());
    }
}
