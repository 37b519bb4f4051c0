//! Filling pressure of a patient whose file states none, from the beat itself.
//!
//! A beat that repeats itself lets in what it let out. With an atrium at a constant pressure and a
//! mitral valve that is a diode, the filled volume is
//! `V = ∮ max(P_LA − P(t), 0) dt / R`
//! over a cycle of the measured ventricular pressure. It increases with P_LA, so that one pressure
//! closes the volume.

use super::estimate::EstimateError;
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};
use serde::{Deserialize, Serialize};

/// Pressure over flow of an open mitral valve, mean over filling. It holds the valve's friction and
/// the kinetic loss of its jet, and stands above the friction alone from which step 1 begins. Chosen
/// on closed-loop hearts of two other formulations (docs/models.md section 4).
pub const MITRAL_RESISTANCE: MmhgSPerMl = MmhgSPerMl(0.016);
/// Standard deviation of the logarithm of that resistance between patients, our value: valves of 4 to
/// 6 cm² differ by a factor of 1.5.
const RESISTANCE_LN_SD: f64 = 0.35;
/// Standard deviation of a catheter's zero \[mmHg\].
const CATHETER_SD_MMHG: f64 = 1.0;
/// Error of a constant in the place of a pressure that swings \[mmHg\], measured on the same hearts.
const CONSTANT_SD_MMHG: f64 = 0.6;
/// Smooth error of a wedge pressure \[mmHg\] (docs/evidence.md).
const WEDGE_SD_MMHG: f64 = 3.0;
/// Mean atrial over end-diastolic pressure where there is no pressure trace; the contraction of the
/// atrium raises the latter above the mean.
pub const SHARE_OF_EDP: f64 = 0.75;
/// Standard deviation of that share, our value.
const SHARE_SD: f64 = 0.25;

/// A filling pressure with its uncertainty and its derivation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FillingPressure {
    /// Constant pressure of the left atrium.
    pub value: Mmhg,
    /// Its standard deviation.
    pub sd: Mmhg,
    /// Derivation, as a sentence for tables and reports.
    pub how: String,
}

/// A filled volume with its standard deviation and its origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilledVolume {
    /// Volume that enters through the mitral valve in a cycle.
    pub volume: Ml,
    /// Its standard deviation.
    pub sd: Ml,
    /// Origin, in words.
    pub origin: &'static str,
}

/// The constant pressure that fills this volume through this resistance, and the time for which the
/// valve is open.
///
/// With samples in ascending order, the open samples are the first `k`, and the balance is linear in
/// the pressure between two samples: no search is needed.
///
/// # Errors
/// [`EstimateError::Filling`] if a sample, the volume or the resistance is not finite, or the latter
/// two are not positive.
pub fn closing_pressure(
    pressure_mmhg: &[f64],
    interval: Ms,
    filled: Ml,
    resistance: MmhgSPerMl,
) -> Result<(Mmhg, Ms), EstimateError> {
    let wanted = filled.0 * resistance.0 * 1e3 / interval.0;
    let finite = pressure_mmhg.iter().all(|p| p.is_finite());
    if pressure_mmhg.is_empty() || !finite || !(wanted > 0.0 && wanted.is_finite()) {
        return Err(EstimateError::Filling {
            n_samples: pressure_mmhg.len(),
            filled_ml: filled.0,
        });
    }
    let mut ascending = pressure_mmhg.to_vec();
    ascending.sort_by(f64::total_cmp);
    let (mut below, mut level) = (0.0, ascending[0]);
    let mut n_open = ascending.len();
    for (i, p) in ascending.iter().enumerate() {
        if i > 0 && (wanted + below) / i as f64 <= *p {
            n_open = i;
            break;
        }
        below += p;
        level = (wanted + below) / (i + 1) as f64;
    }
    Ok((Mmhg(level), Ms(n_open as f64 * interval.0)))
}

/// Filling pressure that closes the volume of the measured beat.
///
/// - `pressure_mmhg`: samples of one cycle of the ventricle's pressure
///
/// # Errors
/// As [`closing_pressure`]. Verified by `finds_the_pressure_that_filled`.
pub fn from_beat(
    pressure_mmhg: &[f64],
    interval: Ms,
    filled: FilledVolume,
) -> Result<FillingPressure, EstimateError> {
    let (value, open) =
        closing_pressure(pressure_mmhg, interval, filled.volume, MITRAL_RESISTANCE)?;
    // Volume and resistance count as a product, whose logarithm moves the pressure by the mean
    // gradient.
    let gradient = MITRAL_RESISTANCE.0 * filled.volume.0 * 1e3 / open.0;
    let of_product = RESISTANCE_LN_SD.hypot(filled.sd.0 / filled.volume.0);
    let sd = (gradient * of_product)
        .hypot(CATHETER_SD_MMHG)
        .hypot(CONSTANT_SD_MMHG);
    let how = format!(
        "estimated: the constant pressure that lets {} of {:.0} mL in through a mitral valve of {} mmHg s/mL, \
         against the measured ventricular pressure",
        filled.origin, filled.volume.0, MITRAL_RESISTANCE.0
    );
    Ok(FillingPressure {
        value,
        sd: Mmhg(sd),
        how,
    })
}

/// Filling pressure from a measured pressure of the atrium: its mean over the cycle, which a delay
/// does not change.
///
/// - `is_wedge`: whether it was measured behind the lungs, as a wedge pressure
///
/// # Errors
/// [`EstimateError::Filling`] if there is no finite sample.
pub fn from_atrium(
    pressure_mmhg: &[f64],
    is_wedge: bool,
) -> Result<FillingPressure, EstimateError> {
    let mean = pressure_mmhg.iter().sum::<f64>() / pressure_mmhg.len() as f64;
    if !mean.is_finite() {
        return Err(EstimateError::Filling {
            n_samples: pressure_mmhg.len(),
            filled_ml: f64::NAN,
        });
    }
    let (sd, name) = match is_wedge {
        true => (WEDGE_SD_MMHG, "wedge pressure"),
        false => (CATHETER_SD_MMHG, "pressure of the left atrium"),
    };
    Ok(FillingPressure {
        value: Mmhg(mean),
        sd: Mmhg(sd),
        how: format!("mean of the measured {name} over the cycle"),
    })
}

/// Filling pressure from the end-diastolic pressure alone.
///
/// # Errors
/// [`EstimateError::EndDiastolicPressure`] if that pressure is not positive.
pub fn from_end_diastole(edp: Mmhg) -> Result<FillingPressure, EstimateError> {
    if !(edp.0 > 0.0 && edp.0.is_finite()) {
        return Err(EstimateError::EndDiastolicPressure { edp_mmhg: edp.0 });
    }
    Ok(FillingPressure {
        value: Mmhg(SHARE_OF_EDP * edp.0),
        sd: Mmhg(SHARE_SD * edp.0),
        how: format!(
            "estimated: {SHARE_OF_EDP} of the end-diastolic pressure, for lack of a pressure trace"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// Ventricular pressure of 800 samples: a systole of 300 ms, then a diastole that swings.
    fn pressure() -> Vec<f64> {
        (0..800)
            .map(|t| {
                let t = f64::from(t);
                if t < 300.0 {
                    100.0
                } else {
                    6.0 + 2.0 * (TAU * t / 500.0).sin()
                }
            })
            .collect()
    }

    fn filled_by(pressure: &[f64], atrium: f64, resistance: f64) -> f64 {
        pressure.iter().map(|p| (atrium - p).max(0.0)).sum::<f64>() * 1e-3 / resistance
    }

    #[test]
    fn finds_the_pressure_that_filled() {
        for (atrium, resistance) in [(4.5, 0.01), (7.0, 0.016), (12.0, 0.03), (150.0, 0.1)] {
            let filled = Ml(filled_by(&pressure(), atrium, resistance));
            let found =
                closing_pressure(&pressure(), Ms(1.0), filled, MmhgSPerMl(resistance)).unwrap();
            assert!((found.0.0 - atrium).abs() < 1e-9, "{atrium} {found:?}");
            let open = pressure().iter().filter(|p| **p < atrium).count();
            assert_eq!(found.1.0, open as f64);
        }
    }

    #[test]
    fn uncertainty_grows_with_the_gradient() {
        let at = |volume: f64| {
            let filled = FilledVolume {
                volume: Ml(volume),
                sd: Ml(0.05 * volume),
                origin: "the stroke volume",
            };
            from_beat(&pressure(), Ms(1.0), filled).unwrap()
        };
        let (small, large) = (at(40.0), at(120.0));
        assert!(large.value.0 > small.value.0 && large.sd.0 > small.sd.0);
        assert!(small.sd.0 > 1.0 && small.how.contains("40 mL"), "{small:?}");
    }

    #[test]
    fn measured_atrium_counts_by_its_mean() {
        let trace: Vec<f64> = (0..500)
            .map(|t| 9.0 + 3.0 * (TAU * f64::from(t) / 500.0).sin())
            .collect();
        let (inside, wedge) = (
            from_atrium(&trace, false).unwrap(),
            from_atrium(&trace, true).unwrap(),
        );
        assert!((inside.value.0 - 9.0).abs() < 1e-9 && inside.value == wedge.value);
        assert!(wedge.sd.0 > inside.sd.0);
    }

    #[test]
    fn refuses_nonsense() {
        let at = |volume| closing_pressure(&pressure(), Ms(1.0), Ml(volume), MITRAL_RESISTANCE);
        assert!(matches!(at(0.0), Err(EstimateError::Filling { .. })));
        assert!(matches!(at(f64::NAN), Err(EstimateError::Filling { .. })));
        assert!(closing_pressure(&[], Ms(1.0), Ml(80.0), MITRAL_RESISTANCE).is_err());
        assert!(from_atrium(&[], false).is_err() && from_end_diastole(Mmhg(-1.0)).is_err());
    }

    proptest! {
        #[test]
        fn fills_what_was_asked(
            pressure in prop::collection::vec(-5.0..120.0f64, 1..60),
            volume in 1.0..200.0f64,
            resistance in 0.002..0.1f64,
        ) {
            let found = closing_pressure(&pressure, Ms(1.0), Ml(volume), MmhgSPerMl(resistance)).unwrap();
            let filled = filled_by(&pressure, found.0.0, resistance);
            prop_assert!((filled / volume - 1.0).abs() < 1e-9, "{filled} {volume}");
        }
    }
}
