//! Step 0: fits the passive law such that image, end-diastole and unloaded volume match the measurements.

use serde::{Deserialize, Serialize};

use super::passive_state::PassiveState;
use super::passive_state_error::PassiveStateError;
use super::piece::Piece;
use super::search::Search;
use super::wall::WallParameters;

/// Targets of the fit of the passive law.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum PassiveFit {
    /// The image is taken as unloaded and the stiffness is given, so that only end-diastole is sought.
    ImageUnloaded {
        /// Pressure to which the image is inflated \[kPa\].
        end_diastolic_pressure_kpa: f64,
    },
    /// The stiffness is given, and the image is unloaded and inflated to end-diastole.
    Given {
        /// Pressure at which the image was taken \[kPa\].
        image_pressure_kpa: f64,
        /// Pressure to which the unloaded geometry is inflated \[kPa\].
        end_diastolic_pressure_kpa: f64,
    },
    /// The image shows diastasis, and volumes are prescribed at zero load and at end-diastole. Stiffness and a factor of the
    /// exponents are fitted: with fixed exponents most pairs of volumes have no solution, because exponents limit how much a
    /// ventricle grows between two pressures, however soft it is.
    ThreePoints {
        /// Pressure at diastasis \[kPa\].
        image_pressure_kpa: f64,
        /// Pressure at end-diastole \[kPa\].
        end_diastolic_pressure_kpa: f64,
        /// Cavity volume wanted at end-diastole \[mm³\].
        end_diastolic_volume_mm3: f64,
        /// Cavity volume wanted without load \[mm³\].
        unloaded_volume_mm3: f64,
    },
    /// The image is taken at end-diastolic pressure with a prescribed unloaded volume (Klotz 2006); the stiffness is fitted.
    Unloaded {
        /// End-diastolic pressure, at which the image was taken \[kPa\].
        end_diastolic_pressure_kpa: f64,
        /// Cavity volume wanted without load \[mm³\].
        unloaded_volume_mm3: f64,
    },
}

/// Derivatives of the logarithms of end-diastolic and unloaded volume (rows) with respect to the logarithms of stiffness and
/// exponent factor (columns).
pub type Slope = [[f64; 2]; 2];

/// A passive state with its fitted law.
#[derive(Debug)]
pub struct Fitted {
    /// The state in equilibrium at end-diastole.
    pub state: PassiveState,
    /// The wall with the fitted passive law.
    pub wall: WallParameters,
    /// Slope at the solution, from which a fit on another mesh of the same heart can start.
    pub slope: Option<Slope>,
}

/// Relative tolerance of the unloaded volume in the three-point fit; the target is itself a rule of thumb, not a measurement.
const UNLOADED_TOLERANCE: f64 = 0.01;
/// Maximum number of unloadings in a fit.
const MOST_TRIALS: usize = 40;

/// Fits the passive law and the unloaded geometry; the state ends at end-diastole. The search starts at `wall.muscle`, with the
/// `slope` of a fit on another mesh if there is one. Collective.
///
/// # Errors
/// [`PassiveStateError`] when an inflation or unloading fails, no stiffness between 1/30 and 30 times the start fits, no law
/// meets the three points, or the watcher stops the search.
pub fn fit(
    piece: &Piece<'_>,
    wall: &WallParameters,
    target: &PassiveFit,
    slope: Option<Slope>,
    search: &mut Search<'_>,
) -> Result<Fitted, PassiveStateError> {
    let mut state = PassiveState::unloaded_image(piece, wall)?;
    let tolerance = search.settings.volume_tolerance;
    match *target {
        PassiveFit::ImageUnloaded {
            end_diastolic_pressure_kpa,
        } => {
            state.inflate(end_diastolic_pressure_kpa, search)?;
            Ok(Fitted {
                state,
                wall: wall.clone(),
                slope: None,
            })
        }
        PassiveFit::Given {
            image_pressure_kpa,
            end_diastolic_pressure_kpa,
        } => {
            state.unload(piece, wall, image_pressure_kpa, search)?;
            state.inflate(end_diastolic_pressure_kpa, search)?;
            Ok(Fitted {
                state,
                wall: wall.clone(),
                slope: None,
            })
        }
        PassiveFit::Unloaded {
            end_diastolic_pressure_kpa,
            unloaded_volume_mm3,
        } => {
            let wall = fit_stiffness(wall, unloaded_volume_mm3, true, tolerance, |wall| {
                search.begin_law();
                state.unload(piece, wall, end_diastolic_pressure_kpa, search)?;
                Ok(state.unloaded_volume_mm3())
            })?;
            Ok(Fitted {
                state,
                wall,
                slope: None,
            })
        }
        PassiveFit::ThreePoints {
            image_pressure_kpa,
            end_diastolic_pressure_kpa,
            end_diastolic_volume_mm3,
            unloaded_volume_mm3,
        } => {
            if wall.muscle.exponent().is_none() {
                return Err(PassiveStateError::NoExponents {
                    law: wall.muscle.name(),
                });
            }
            let wanted = [end_diastolic_volume_mm3, unloaded_volume_mm3];
            let mut expected: Option<Vec<f64>> = None;
            let (wall, slope) = fit_law(wall, wanted, tolerance, slope, |wall| {
                search.begin_law();
                // Starts from the last geometry found; a law for which none is found leaves it unchanged.
                let mut next =
                    PassiveState::at(piece, wall, state.unloaded(), state.anchor().to_vec())?
                        .after(&mut state);
                next.unload(piece, wall, image_pressure_kpa, search)?;
                next.inflate_towards(end_diastolic_pressure_kpa, expected.as_deref(), search)?;
                expected = Some(next.positions());
                let found = [next.volume_mm3(), next.unloaded_volume_mm3()];
                state = next;
                Ok(found)
            })?;
            Ok(Fitted { state, wall, slope })
        }
    }
}

/// Multiplies the exponents by `factor` and refits the stiffness to the end-diastolic volume, at a fixed unloaded geometry.
/// Collective.
///
/// # Errors
/// [`PassiveStateError`] when an inflation fails, no stiffness fits or the law has no exponents.
pub fn stiffened(
    piece: &Piece<'_>,
    before: &Fitted,
    factor: f64,
    search: &mut Search<'_>,
) -> Result<Fitted, PassiveStateError> {
    let Fitted {
        state: before,
        wall,
        ..
    } = before;
    let (wanted, pressure_kpa) = (before.volume_mm3(), before.pressure_kpa);
    if wall.muscle.exponent().is_none() {
        return Err(PassiveStateError::NoExponents {
            law: wall.muscle.name(),
        });
    }
    let mut start = wall.clone();
    // At the fibre strain of the original fit, a change of exponents is nearly compensated by this change of scale.
    start.muscle = wall
        .muscle
        .with_stiffness(wall.muscle.stiffness_kpa() / (factor * factor))
        .scaled(1.0, factor);
    let from_unloaded = |wall: &WallParameters| {
        PassiveState::at(piece, wall, before.unloaded(), before.anchor().to_vec())
    };
    let mut state = from_unloaded(&start)?;
    (state.newton_iterations, state.passes) = (before.newton_iterations, before.passes);
    let expected = before.positions();
    let wall = fit_stiffness(
        &start,
        wanted,
        false,
        search.settings.volume_tolerance,
        |wall| {
            search.begin_law();
            let mut next = from_unloaded(wall)?.after(&mut state);
            next.inflate_towards(pressure_kpa, Some(&expected), search)?;
            state = next;
            Ok(state.volume_mm3())
        },
    )?;
    Ok(Fitted {
        state,
        wall,
        slope: None,
    })
}

/// Stiffness and factor of the exponents that give the `wanted` end-diastolic and unloaded volumes. Broyden's method in
/// logarithms starts from `slope` or finite differences; steps that fail or increase the error are halved.
fn fit_law(
    start: &WallParameters,
    wanted: [f64; 2],
    tolerance: f64,
    mut slope: Option<Slope>,
    mut volumes_mm3: impl FnMut(&WallParameters) -> Result<[f64; 2], PassiveStateError>,
) -> Result<(WallParameters, Option<Slope>), PassiveStateError> {
    const PROBE: f64 = 0.15;
    const FARTHEST: [f64; 2] = [4.0, 2.5];
    const LONGEST: f64 = 0.7;
    let law = |x: [f64; 2]| {
        let muscle = start.muscle.scaled(x[0].exp(), x[1].exp());
        WallParameters {
            muscle,
            ..start.clone()
        }
    };
    let mut misses = |x: [f64; 2]| -> Result<[f64; 2], PassiveStateError> {
        let found = volumes_mm3(&law(x))?;
        Ok([(found[0] / wanted[0]).ln(), (found[1] / wanted[1]).ln()])
    };
    let met = |f: [f64; 2]| f[0].abs() <= tolerance && f[1].abs() <= UNLOADED_TOLERANCE;
    let size = |f: [f64; 2]| f[0].hypot(f[1]);
    let mut x = [0.0; 2];
    let mut trials = 0;
    // A stiffer law may bear the load where the first one does not.
    let mut f = loop {
        trials += 1;
        match misses(x) {
            Ok(f) => break f,
            Err(error) if error.ends_the_search() => return Err(error),
            Err(_) if x[0] + 0.7 < FARTHEST[0] => x[0] += 0.7,
            Err(error) => return Err(error),
        }
    };
    let mut shorter = 1.0;
    // Whether the slope comes from finite differences at the current point rather than from another mesh or earlier steps.
    let mut fresh = false;
    while trials < MOST_TRIALS {
        if met(f) {
            return Ok((law(x), slope));
        }
        let j = match slope {
            Some(j) => j,
            None => {
                let mut j = [[0.0; 2]; 2];
                for k in 0..2 {
                    let mut probe = x;
                    probe[k] += PROBE;
                    trials += 1;
                    let (step, g) = match misses(probe) {
                        Ok(g) => (PROBE, g),
                        Err(error) if error.ends_the_search() => return Err(error),
                        Err(_) => {
                            probe[k] = x[k] - PROBE;
                            trials += 1;
                            (-PROBE, misses(probe)?)
                        }
                    };
                    (0..2).for_each(|i| j[i][k] = (g[i] - f[i]) / step);
                }
                fresh = true;
                *slope.insert(j)
            }
        };
        let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        let mut step = [
            (-f[0] * j[1][1] + f[1] * j[0][1]) / det,
            (-f[1] * j[0][0] + f[0] * j[1][0]) / det,
        ];
        let longest = step[0].abs().max(step[1].abs());
        if !longest.is_finite() || longest < 1e-9 {
            break;
        }
        let scale = shorter * (LONGEST / longest).min(1.0);
        for k in 0..2 {
            step[k] = (x[k] + scale * step[k]).clamp(-FARTHEST[k], FARTHEST[k]) - x[k];
        }
        let trial = [x[0] + step[0], x[1] + step[1]];
        trials += 1;
        match misses(trial) {
            Ok(g) => {
                let length = step[0] * step[0] + step[1] * step[1];
                let mut better = j;
                for i in 0..2 {
                    let missed = g[i] - f[i] - j[i][0] * step[0] - j[i][1] * step[1];
                    (0..2).for_each(|k| better[i][k] += missed * step[k] / length.max(1e-12));
                }
                slope = Some(better);
                if size(g) < size(f) {
                    (x, f, shorter, fresh) = (trial, g, 1.0, false);
                } else {
                    shorter *= 0.5;
                }
            }
            Err(error) if error.ends_the_search() => return Err(error),
            Err(_) => shorter *= 0.5,
        }
        if shorter < 0.05 {
            if fresh {
                break;
            }
            (slope, shorter) = (None, 1.0);
        }
    }
    let ml = |i: usize| 1e-3 * wanted[i] * f[i].exp();
    Err(PassiveStateError::NoLaw {
        wanted_ml: 1e-3 * wanted[0],
        wanted_unloaded_ml: 1e-3 * wanted[1],
        found_ml: ml(0),
        found_unloaded_ml: ml(1),
    })
}

/// The stiffness that gives the `wanted` volume, which depends on it monotonically: a bracketed secant method in ln C.
fn fit_stiffness(
    wall: &WallParameters,
    wanted: f64,
    grows: bool,
    tolerance: f64,
    mut volume_mm3: impl FnMut(&WallParameters) -> Result<f64, PassiveStateError>,
) -> Result<WallParameters, PassiveStateError> {
    let start = wall.muscle.stiffness_kpa();
    let (lowest, highest) = ((start / 30.0).ln(), (start * 30.0).ln());
    let mut ends: [Option<(f64, f64)>; 2] = [None, None];
    let mut ln_c = start.ln();
    let mut last: Option<f64> = None;
    for _ in 0..30 {
        let mut fitted = wall.clone();
        fitted.muscle = wall.muscle.with_stiffness(ln_c.exp());
        let volume = match (volume_mm3(&fitted), last) {
            (Ok(found), _) => found,
            (Err(error), _) if error.ends_the_search() => return Err(error),
            // The step was too long, or the law too soft to bear the load: it is halved while it is not negligible.
            (Err(_), Some(last)) if (ln_c - last).abs() > 0.02 => {
                ln_c = 0.5 * (ln_c + last);
                continue;
            }
            // The law is too soft at the start to bear the load.
            (Err(_), None) if ln_c + 0.7 <= highest => {
                ln_c += 0.7;
                continue;
            }
            (Err(error), None) => return Err(error),
            (Err(_), Some(_)) => break,
        };
        last = Some(ln_c);
        let miss = (volume - wanted) / wanted;
        if miss.abs() <= tolerance {
            return Ok(fitted);
        }
        let too_stiff = (miss > 0.0) == grows;
        ends[usize::from(too_stiff)] = Some((ln_c, miss));
        let next = match ends {
            [Some((a, f)), Some((b, g))] => {
                (a - f * (b - a) / (g - f)).clamp(a + 0.05 * (b - a), b - 0.05 * (b - a))
            }
            [None, _] => (ln_c - 0.5).max(lowest),
            [_, None] => (ln_c + 0.5).min(highest),
        };
        if next == ln_c {
            break;
        }
        ln_c = next;
    }
    let ml =
        |end: Option<(f64, f64)>| end.map_or(f64::NAN, |(_, miss)| 1e-3 * wanted * (1.0 + miss));
    Err(PassiveStateError::NoStiffness {
        low_kpa: ends[0].map_or(ln_c, |(x, _)| x).exp(),
        high_kpa: ends[1].map_or(ln_c, |(x, _)| x).exp(),
        wanted_ml: 1e-3 * wanted,
        at_low_ml: ml(ends[0]),
        at_high_ml: ml(ends[1]),
    })
}
