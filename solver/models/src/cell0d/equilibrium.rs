//! Bracketed searches for the stretch: the resting equilibrium, and the balance for given differential states.
//!
//! Plain Newton and damped fixed points fail for some admissible parameters, so both searches keep a bracket.

use super::cell::to_state;
use super::system::{LAMBDA, System, Vector};
use super::{Cell0d, CellError, CellState};
use crate::roots::increasing_root;
use cardiotwin_units::{MicroMolar, Stretch};

/// Lowest stretch of the search relative to λ0; the overlap factor h is zero there for every sensible β0.
const LOWEST: f64 = 0.2;
/// Highest stretch of the balance search relative to λ0.
const HIGHEST: f64 = 2.0;
const TOLERANCE: f64 = 1e-13;

impl CellState {
    /// The cell at rest at a constant calcium.
    ///
    /// # Errors
    /// [`CellError::Balance`] or [`CellError::Contraction`] when there is no such equilibrium.
    pub fn at_rest(cell: &Cell0d, ca: MicroMolar) -> Result<Self, CellError> {
        Ok(to_state(&cell.land, &resting_state(&cell.system(), ca.0)?))
    }
}

/// The cell at rest: steady at constant calcium `ca_um`, dashpot relaxed.
pub(crate) fn resting_state(system: &System<'_>, ca_um: f64) -> Result<Vector, CellError> {
    let land = system.land;
    let steady = |lambda: f64| land.steady_state(MicroMolar(ca_um), Stretch(lambda));
    let mut failure = None;
    let balance = |lambda: f64| {
        let c = lambda / system.lambda0 - 1.0;
        let passive = system.passive.stress(c, c);
        let (h, dh) = (land.k.overlap(lambda), land.overlap_slope(lambda));
        match steady(lambda) {
            Ok(state) => {
                // The slope leaves out what Ca50 adds: it only costs an iteration or a bisection.
                let pull = land.k.stress_scale * state[3];
                let slope = dh * pull
                    + (passive.dsp_dstrain_kpa - system.passive.a_p_kpa * system.passive.k)
                        / system.lambda0;
                (h * pull + passive.sp_kpa, slope)
            }
            Err(error) => {
                failure = Some(error);
                (f64::NAN, f64::NAN)
            }
        }
    };
    let root = increasing_root(
        LOWEST * system.lambda0,
        system.lambda0,
        system.lambda0 * 0.999,
        TOLERANCE,
        balance,
    );
    let lambda = match (root, failure) {
        (_, Some(error)) => return Err(CellError::Contraction(error)),
        (Err(source), None) => {
            return Err(CellError::Balance {
                what: "resting equilibrium",
                source,
            });
        }
        (Ok(lambda), None) => lambda,
    };
    let [trpn, b, w, s, ..] = steady(lambda)?;
    let z = -land.k.a * lambda;
    Ok([trpn, b, w, s, z, z, lambda / system.lambda0 - 1.0, lambda])
}

/// Sets the stretch of `y` so that the forces balance for its seven differential states.
pub(crate) fn balance_stretch(system: &System<'_>, y: &mut Vector) -> Result<(), CellError> {
    let land = system.land;
    let [_, _, w, s, z_w, z_s, cv, guess] = *y;
    let root = increasing_root(
        LOWEST * system.lambda0,
        HIGHEST * system.lambda0,
        guess,
        TOLERANCE,
        |lambda| {
            let passive = system.passive.stress(lambda / system.lambda0 - 1.0, cv);
            let (h, dh) = (land.k.overlap(lambda), land.overlap_slope(lambda));
            let pull = (z_s + land.k.a * lambda + 1.0) * s + (z_w + land.k.a * lambda) * w;
            (
                land.k.stress_scale * h * pull + passive.sp_kpa,
                land.k.stress_scale * (dh * pull + h * land.k.a * (w + s))
                    + passive.dsp_dstrain_kpa / system.lambda0,
            )
        },
    );
    y[LAMBDA] = root.map_err(|source| CellError::Balance {
        what: "equilibrium stretch",
        source,
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::CellParameters;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Rest is rest: no state moves, and the balance search finds the same stretch again.
        #[test]
        fn resting_state_is_steady(
            a_p in 1.0..100.0f64, lambda0 in 0.95..1.15f64, beta0 in 1.0..5.0f64, beta1 in -3.0..-0.5f64, ca in 0.05..0.9f64
        ) {
            let mut p = CellParameters { lambda0, ..CellParameters::default() };
            p.passive.a_p_kpa = a_p;
            p.land.beta0 = beta0;
            p.land.beta1_um = beta1;
            let cell = p.build().unwrap();
            let system = cell.system();
            let y = resting_state(&system, ca).unwrap();
            let land_only = crate::calcium::SampledCalcium::new(cardiotwin_units::Ms(1.0), vec![ca; 3]).unwrap();
            let held = System { calcium: &land_only, ..system };
            for (i, rate) in held.rhs(0.0, &y).iter().enumerate() {
                prop_assert!(rate.abs() < 1e-9, "{i} {rate}");
            }
            let mut again = y;
            again[LAMBDA] = 0.5;
            balance_stretch(&held, &mut again).unwrap();
            prop_assert!((again[LAMBDA] - y[LAMBDA]).abs() < 1e-11);
        }
    }
}
