//! Estimate of the afterload for a patient file without one. It describes its derivation.

use crate::roots::{RootError, increasing_root};
use cardiotwin_units::{Mmhg, Ms};
use cardiotwin_vocabulary::circulation::WindkesselParameters;
use serde::{Deserialize, Serialize};

/// Characteristic over peripheral resistance if no measurement separates them, our value. In 18 people
/// without heart disease it is 4.1 % (Murgo et al. 1980, Circulation 62:105, abstract).
pub const CHARACTERISTIC_SHARE: f64 = 0.06;
/// Range of time constants in the search \[ms\].
const TAU_RANGE_MS: (f64, f64) = (50.0, 50_000.0);
/// A time constant above those of adults (1 to 2.5 s, our bounds) \[ms\]. Beyond it, a smaller share of R1
/// explains a small pulse.
const LONG_TAU_MS: f64 = 5000.0;

/// An estimate in place of a measured value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimated<T> {
    /// Value that takes the place of a measured one.
    pub value: T,
    /// Derivation, as a sentence for tables and reports.
    pub how: String,
}

/// Reasons why an estimate was not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EstimateError {
    /// The volume trace does not eject.
    #[error(
        "the volume trace of {n_samples} samples has no ejection (largest minus smallest volume {stroke_volume_ml} mL)"
    )]
    NoEjection {
        /// Number of samples in the trace.
        n_samples: usize,
        /// Largest minus smallest volume \[mL\].
        stroke_volume_ml: f64,
    },
    /// The cuff pressures are not in order.
    #[error(
        "cuff pressures are {systolic_mmhg}/{diastolic_mmhg} mmHg, expected a positive diastolic pressure below the \
         systolic one"
    )]
    Cuff {
        /// Systolic pressure of the cuff \[mmHg\].
        systolic_mmhg: f64,
        /// Diastolic pressure of the cuff \[mmHg\].
        diastolic_mmhg: f64,
    },
    /// No load gives these pressures with this flow.
    #[error("no Windkessel gives {systolic_mmhg}/{diastolic_mmhg} mmHg with this flow")]
    NoLoad {
        /// Systolic pressure of the cuff \[mmHg\].
        systolic_mmhg: f64,
        /// Diastolic pressure of the cuff \[mmHg\].
        diastolic_mmhg: f64,
        /// Failure of the root search.
        source: RootError,
    },
    /// Nothing fills the ventricle.
    #[error(
        "no filling pressure closes a beat of {n_samples} pressure samples and {filled_ml} mL of filling"
    )]
    Filling {
        /// Number of samples of the pressure.
        n_samples: usize,
        /// Volume that fills the ventricle in a cycle \[mL\].
        filled_ml: f64,
    },
    /// The end-diastolic pressure is not positive.
    #[error("end-diastolic pressure {edp_mmhg} mmHg is not positive")]
    EndDiastolicPressure {
        /// End-diastolic pressure that was given \[mmHg\].
        edp_mmhg: f64,
    },
}

/// Ejection flow \[mL/s\] of one cycle. It is −dV/dt from the largest volume to the smallest after
/// it, zero elsewhere and never negative, and it is scaled to the stroke volume.
///
/// - `volume_ml`: samples of a periodic trace at a constant `interval`
///
/// # Errors
/// [`EstimateError::NoEjection`] if there are fewer than eight samples or the volume does not vary.
pub fn ejection_flow(volume_ml: &[f64], interval: Ms) -> Result<Vec<f64>, EstimateError> {
    let n = volume_ml.len();
    let (mut peak, mut trough) = (0, 0);
    for (i, &v) in volume_ml.iter().enumerate() {
        if v > volume_ml[peak] {
            peak = i;
        }
        if v < volume_ml[trough] {
            trough = i;
        }
    }
    let stroke_volume_ml = if n == 0 {
        0.0
    } else {
        volume_ml[peak] - volume_ml[trough]
    };
    if n < 8 || !(stroke_volume_ml > 0.0 && stroke_volume_ml.is_finite()) {
        return Err(EstimateError::NoEjection {
            n_samples: n,
            stroke_volume_ml,
        });
    }
    let mut flow = vec![0.0; n];
    let mut i = peak;
    while i != trough {
        let (before, after) = (volume_ml[(i + n - 1) % n], volume_ml[(i + 1) % n]);
        flow[i] = ((before - after) / (2.0 * interval.0) * 1e3).max(0.0);
        i = (i + 1) % n;
    }
    let ejected: f64 = flow.iter().sum::<f64>() * interval.0 * 1e-3;
    let scale = stroke_volume_ml / ejected;
    flow.iter_mut().for_each(|q| *q *= scale);
    Ok(flow)
}

/// Periodic solution of `τ dy/dt = Q − y` at the ends of the intervals, for a flow that is constant
/// over each interval.
fn periodic_response(flow: &[f64], interval_ms: f64, tau_ms: f64) -> Vec<f64> {
    let decay = (-interval_ms / tau_ms).exp();
    let run = |start: f64| {
        let mut y = start;
        flow.iter()
            .map(|q| {
                y = decay * y + (1.0 - decay) * q;
                y
            })
            .collect::<Vec<f64>>()
    };
    let from_zero = run(0.0).last().copied().unwrap_or(0.0);
    run(from_zero / (1.0 - decay.powi(flow.len() as i32)))
}

/// Three-element Windkessel that reproduces the systolic and diastolic cuff pressure with the
/// measured ejection flow.
///
/// With R1/R2 held at [`CHARACTERISTIC_SHARE`], the pressure is R2 times a response that depends
/// only on R2 C. The ratio of its largest to its smallest value falls with R2 C, so that a
/// bracketed search finds R2 C. If the cuff's pulse is too small for any R2 C up to 5 s, R1/R2 is
/// reduced.
///
/// - `volume_ml`: samples of the periodic volume trace at a constant `interval`
///
/// # Errors
/// [`EstimateError`] if the trace does not eject, the cuff pressures are out of order, or no load
/// fits. Verified by `recovers_a_known_load`.
pub fn windkessel(
    volume_ml: &[f64],
    interval: Ms,
    systolic: Mmhg,
    diastolic: Mmhg,
) -> Result<Estimated<WindkesselParameters>, EstimateError> {
    let (systolic_mmhg, diastolic_mmhg) = (systolic.0, diastolic.0);
    if !(diastolic_mmhg > 0.0 && systolic_mmhg > diastolic_mmhg && systolic_mmhg.is_finite()) {
        return Err(EstimateError::Cuff {
            systolic_mmhg,
            diastolic_mmhg,
        });
    }
    let flow = ejection_flow(volume_ml, interval)?;
    let extremes = |share: f64, tau_ms: f64| {
        let response = periodic_response(&flow, interval.0, tau_ms);
        flow.iter()
            .zip(&response)
            .fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), (q, y)| {
                let p = share * q + y;
                (low.min(p), high.max(p))
            })
    };
    // Logarithm of the pulse that remains to be explained; it limits the ratio at short time
    // constants.
    let left = |share: f64, tau_ms: f64| {
        let (low, high) = extremes(share, tau_ms);
        (systolic_mmhg / diastolic_mmhg).ln() - (high / low).ln().min(1e3)
    };
    let root = |low: f64, high: f64, start: f64, left: &dyn Fn(f64) -> f64| {
        increasing_root(low, high, start, 1e-9, |x| {
            (left(x), (left(x + 1e-4) - left(x - 1e-4)) / 2e-4)
        })
    };
    let time_constant = |share: f64, range: (f64, f64)| {
        let (low, high) = (range.0.ln(), range.1.ln());
        root(low, high, 1500f64.ln().max(low), &|log_tau| {
            left(share, log_tau.exp())
        })
        .map(f64::exp)
    };
    let usual = time_constant(CHARACTERISTIC_SHARE, (TAU_RANGE_MS.0, LONG_TAU_MS));
    let (share, tau_ms) = match usual {
        Ok(tau_ms) => (CHARACTERISTIC_SHARE, tau_ms),
        // Coarsely sampled frames give the flow a peak that, with the usual R1 alone, exceeds the
        // cuff's pulse.
        Err(_) => match root(
            -CHARACTERISTIC_SHARE,
            0.0,
            -0.5 * CHARACTERISTIC_SHARE,
            &|x| left(-x, LONG_TAU_MS),
        ) {
            Ok(less) => (-less, LONG_TAU_MS),
            Err(_) => {
                let tau_ms = time_constant(0.0, (LONG_TAU_MS, TAU_RANGE_MS.1));
                (
                    0.0,
                    tau_ms.map_err(|source| EstimateError::NoLoad {
                        systolic_mmhg,
                        diastolic_mmhg,
                        source,
                    })?,
                )
            }
        },
    };
    let r2 = diastolic_mmhg / extremes(share, tau_ms).0;
    let value = WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: share * r2,
        peripheral_resistance_mmhg_s_per_ml: r2,
        compliance_ml_per_mmhg: tau_ms * 1e-3 / r2,
    };
    let how = format!(
        "estimated: Windkessel through the cuff pressures {systolic_mmhg:.0}/{diastolic_mmhg:.0} mmHg with flow = -dV/dt in \
         ejection and R1 = {} R2",
        (1e3 * share).round() / 1e3
    );
    Ok(Estimated { value, how })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A beat of 800 ms that ejects 80 mL as a raised cosine between 60 and 360 ms.
    fn volume() -> Vec<f64> {
        (0..800)
            .map(|t| {
                let t = f64::from(t);
                let ejected = ((t - 60.0) / 300.0).clamp(0.0, 1.0);
                let filled = ((t - 420.0) / 300.0).clamp(0.0, 1.0);
                140.0 - 80.0 * 0.5 * (1.0 - (PI * ejected).cos())
                    + 80.0 * 0.5 * (1.0 - (PI * filled).cos())
            })
            .collect()
    }

    #[test]
    fn flow_is_the_fall_of_the_volume() {
        let flow = ejection_flow(&volume(), Ms(1.0)).unwrap();
        assert!((flow.iter().sum::<f64>() * 1e-3 - 80.0).abs() < 1e-9);
        assert!((flow[210] - 80.0 * 0.5 * PI / 0.3).abs() < 0.1);
        assert!(flow[500] == 0.0 && flow[10] == 0.0);
    }

    #[test]
    fn recovers_a_known_load() {
        let flow = ejection_flow(&volume(), Ms(1.0)).unwrap();
        let (r2, c) = (0.9, 1.7);
        let pc = periodic_response(&flow, 1.0, r2 * c * 1e3);
        let p: Vec<f64> = flow
            .iter()
            .zip(&pc)
            .map(|(q, y)| r2 * (CHARACTERISTIC_SHARE * q + y))
            .collect();
        let (low, high) = p.iter().fold((f64::MAX, 0.0), |(l, h): (f64, f64), x| {
            (l.min(*x), h.max(*x))
        });
        let found = windkessel(&volume(), Ms(1.0), Mmhg(high), Mmhg(low)).unwrap();
        assert!((found.value.peripheral_resistance_mmhg_s_per_ml - r2).abs() < 1e-6);
        assert!((found.value.compliance_ml_per_mmhg - c).abs() < 1e-5);
        assert!(found.how.starts_with("estimated"));
    }

    #[test]
    fn a_wider_pulse_means_less_compliance() {
        let at = |systolic| {
            windkessel(&volume(), Ms(1.0), Mmhg(systolic), Mmhg(70.0))
                .unwrap()
                .value
                .compliance_ml_per_mmhg
        };
        assert!(at(140.0) < at(120.0) && at(120.0) < at(105.0));
    }

    #[test]
    fn a_pulse_too_small_for_the_usual_impedance_lowers_it() {
        let (systolic, diastolic) = (110.0, 95.0);
        let found = windkessel(&volume(), Ms(1.0), Mmhg(systolic), Mmhg(diastolic)).unwrap();
        let (r1, r2) = (
            found.value.characteristic_resistance_mmhg_s_per_ml,
            found.value.peripheral_resistance_mmhg_s_per_ml,
        );
        assert!(
            r1 / r2 < 0.99 * CHARACTERISTIC_SHARE && r1 >= 0.0,
            "{}",
            r1 / r2
        );
        let flow = ejection_flow(&volume(), Ms(1.0)).unwrap();
        let response = periodic_response(&flow, 1.0, found.value.compliance_ml_per_mmhg * r2 * 1e3);
        let pressures = flow.iter().zip(&response).map(|(q, y)| r1 * q + r2 * y);
        let (low, high) = pressures.fold((f64::MAX, 0.0), |(l, h): (f64, f64), p| {
            (l.min(p), h.max(p))
        });
        assert!(
            (low - diastolic).abs() < 1e-3 && (high - systolic).abs() < 1e-3,
            "{low} to {high} mmHg"
        );
    }

    #[test]
    fn refuses_nonsense() {
        assert!(matches!(
            windkessel(&[100.0; 50], Ms(1.0), Mmhg(120.0), Mmhg(70.0)),
            Err(EstimateError::NoEjection { .. })
        ));
        assert!(matches!(
            windkessel(&volume(), Ms(1.0), Mmhg(60.0), Mmhg(70.0)),
            Err(EstimateError::Cuff { .. })
        ));
        assert!(matches!(
            windkessel(&volume(), Ms(1.0), Mmhg(70.2), Mmhg(70.0)),
            Err(EstimateError::NoLoad { .. })
        ));
    }
}
