//! Biomarkers of a cellular active stress trace, of fibre stretch, and of the calcium transient.
//!
//! Source: Jung et al. 2022, Mathematics 10(5):823, Appendix C. Nothing here allocates: step 2 calls it in its loop.

use crate::cycle::{Continuation, Cycle};
use cardiotwin_units::{MicroMolar, Ms};
use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use serde::{Deserialize, Serialize};

/// Reasons why biomarkers of a cell's traces cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CellTraceError {
    /// The slices differ in length or are too short for a central difference.
    #[error(
        "a cell trace needs at least 3 samples and one time per value, but there are {n_times} times and {n_values} values"
    )]
    Length {
        /// Number of times of the trace.
        n_times: usize,
        /// Number of values of the trace.
        n_values: usize,
    },
    /// A value that is not finite.
    #[error("value {value} at sample {idx} of the {quantity} trace is not finite")]
    NotFinite {
        /// Name of the trace.
        quantity: &'static str,
        /// Position in the slice.
        idx: usize,
        /// Value that is not finite.
        value: f64,
    },
}

/// Levels of an active stress trace that were not crossed within the beat, in the order STD30,
/// STD50, STD90.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Unreached {
    /// Whether each level was not crossed upwards before the maximum; it is then taken at the first
    /// sample.
    pub upstroke: [bool; 3],
    /// Whether each level was not crossed downwards after the maximum; it is then taken at the end
    /// of the beat.
    pub downstroke: [bool; 3],
}

impl Unreached {
    /// Whether STD30, STD50 and STD90 each lack a crossing.
    #[must_use]
    pub fn durations(&self) -> [bool; 3] {
        std::array::from_fn(|k| self.upstroke[k] || self.downstroke[k])
    }

    /// Whether any level was not crossed.
    #[must_use]
    pub fn any(&self) -> bool {
        self.durations().contains(&true)
    }
}

/// Biomarkers of one beat of active stress and stretch, and what else its traces show.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StressReading {
    /// Biomarkers of the beat.
    pub biomarkers: CellBiomarkers,
    /// Time of the largest active stress \[ms\].
    pub t_sa_max_ms: f64,
    /// Active stress at the beat's start \[kPa\].
    pub sa_res_kpa: f64,
    /// Levels that the beat did not cross.
    pub unreached: Unreached,
}

impl StressReading {
    /// Fractions of the maximum between whose crossings STD30, STD50 and STD90 are measured, dimensionless.
    pub const LEVELS: [f64; 3] = [0.7, 0.5, 0.1];

    /// Reading of the traces of one beat (Jung 2022, Appendix C; baseline zero; misprint resolved: the largest rate is that
    /// before the maximum).
    ///
    /// A duration is the time between the last upstroke crossing before and the first downstroke crossing after the
    /// maximum. A level not crossed is taken at the beat's first or last sample and noted in [`Self::unreached`]; a beat
    /// without positive stress crosses none.
    /// - `time_ms`, `sa_kpa`, `lambda`: equally long, strictly increasing times, one beat, not wrapped around
    ///
    /// # Errors
    /// [`CellTraceError`] when the slices do not fit or hold values that are not finite.
    pub fn of(time_ms: &[f64], sa_kpa: &[f64], lambda: &[f64]) -> Result<Self, CellTraceError> {
        check(time_ms, lambda, "stretch")?;
        check(time_ms, sa_kpa, "active stress")?;
        let cycle = Cycle::new(time_ms, sa_kpa, Continuation::Single);
        let peak = cycle.argmax();
        let sa_max_kpa = cycle.value(peak);
        let (begin, end) = (time_ms[0], time_ms[time_ms.len() - 1]);
        // A cell that develops nothing is a poor fit, not a failed one.
        let mut dsadt_max_kpa_per_ms = 0.0;
        let mut unreached = Unreached {
            upstroke: [true; 3],
            downstroke: [true; 3],
        };
        let mut durations = [end - begin; 3];
        if sa_max_kpa > 0.0 {
            // Central differences strictly before the peak; a peak at the second sample leaves none, and zero says so.
            dsadt_max_kpa_per_ms = (1..peak).filter_map(|i| cycle.slope(i)).fold(0.0, f64::max);
            for (k, fraction) in Self::LEVELS.into_iter().enumerate() {
                let rise = cycle.last_rise(fraction * sa_max_kpa, peak);
                let fall = cycle.first_fall(fraction * sa_max_kpa, peak);
                unreached.upstroke[k] = rise.is_none();
                unreached.downstroke[k] = fall.is_none();
                durations[k] = fall.unwrap_or(end) - rise.unwrap_or(begin);
            }
        }
        let [std30_ms, std50_ms, std90_ms] = durations;
        Ok(Self {
            biomarkers: CellBiomarkers {
                sa_max_kpa,
                dsadt_max_kpa_per_ms,
                std30_ms,
                std50_ms,
                std90_ms,
                lambda_min: lambda.iter().copied().fold(f64::INFINITY, f64::min),
            },
            t_sa_max_ms: cycle.time(peak),
            sa_res_kpa: sa_kpa[0],
            unreached,
        })
    }
}

/// Durations of a calcium transient from the activation time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CalciumDurations {
    /// Time from activation to half the decay from the maximum.
    #[serde(rename = "CTD50_ms")]
    pub ctd50: Ms,
    /// Time from activation to nine tenths of the decay from the maximum.
    #[serde(rename = "CTD90_ms")]
    pub ctd90: Ms,
    /// Whether 50 % and 90 % decay were not reached before the trace's end, where the time is then taken.
    pub unreached: [bool; 2],
}

impl CalciumDurations {
    /// Durations of a sampled calcium transient (Jung 2022, Appendix C).
    ///
    /// - `time_ms`, `ca_um`: equally long, strictly increasing times, one beat
    /// - `resting`: concentration that the transient decays to
    /// - `activation`: time from which durations count
    ///
    /// # Errors
    /// [`CellTraceError`] when the slices do not fit or hold values that are not finite.
    pub fn of(
        time_ms: &[f64],
        ca_um: &[f64],
        resting: MicroMolar,
        activation: Ms,
    ) -> Result<Self, CellTraceError> {
        check(time_ms, ca_um, "calcium")?;
        let cycle = Cycle::new(time_ms, ca_um, Continuation::Single);
        let peak = cycle.argmax();
        let end = time_ms[time_ms.len() - 1];
        let amplitude = cycle.value(peak) - resting.0;
        let decay =
            |fraction: f64| cycle.first_fall(cycle.value(peak) - fraction * amplitude, peak);
        let (half, most) = (decay(0.5), decay(0.9));
        Ok(Self {
            ctd50: Ms(half.unwrap_or(end)) - activation,
            ctd90: Ms(most.unwrap_or(end)) - activation,
            unreached: [half.is_none(), most.is_none()],
        })
    }
}

fn check(time_ms: &[f64], values: &[f64], quantity: &'static str) -> Result<(), CellTraceError> {
    if values.len() < 3 || time_ms.len() != values.len() {
        return Err(CellTraceError::Length {
            n_times: time_ms.len(),
            n_values: values.len(),
        });
    }
    for (what, slice) in [("time", time_ms), (quantity, values)] {
        if let Some(idx) = slice.iter().position(|v| !v.is_finite()) {
            return Err(CellTraceError::NotFinite {
                quantity: what,
                idx,
                value: slice[idx],
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle: rises from 0 at 10 ms to 100 kPa at 110 ms, falls to 0 at 310 ms.
    fn triangle(end_ms: usize) -> (Vec<f64>, Vec<f64>) {
        let time: Vec<f64> = (0..=end_ms).map(|t| t as f64).collect();
        let value = |t: &f64| ((t - 10.0).min((310.0 - t) / 2.0)).max(0.0);
        (time.clone(), time.iter().map(value).collect())
    }

    /// The reading of a stress whose stretch has its smallest value in the middle.
    fn read(time_ms: &[f64], sa_kpa: &[f64]) -> Result<StressReading, CellTraceError> {
        let mut lambda = vec![1.0; time_ms.len()];
        lambda[time_ms.len() / 2] = 0.85;
        StressReading::of(time_ms, sa_kpa, &lambda)
    }

    #[test]
    fn triangle_has_the_durations_of_its_geometry() {
        let (t, sa) = triangle(400);
        let reading = read(&t, &sa).unwrap();
        let b = reading.biomarkers;
        assert_eq!(b.sa_max_kpa, 100.0);
        assert_eq!(reading.t_sa_max_ms, 110.0);
        assert!((b.dsadt_max_kpa_per_ms - 1.0).abs() < 1e-12);
        for (duration, fraction) in [(b.std30_ms, 0.3), (b.std50_ms, 0.5), (b.std90_ms, 0.9)] {
            assert!((duration - 300.0 * fraction).abs() < 1e-9, "{duration}");
        }
        assert_eq!(b.lambda_min, 0.85);
        assert!(!reading.unreached.any());
    }

    #[test]
    fn a_level_not_reached_is_taken_at_the_end_and_noted() {
        let (t, sa) = triangle(250); // 30 kPa are left at the end
        let reading = read(&t, &sa).unwrap();
        assert_eq!(
            reading.unreached,
            Unreached {
                upstroke: [false; 3],
                downstroke: [false, false, true]
            }
        );
        assert_eq!(reading.unreached.durations(), [false, false, true]);
        assert!((reading.biomarkers.std90_ms - 230.0).abs() < 1e-9);
    }

    #[test]
    fn a_resting_stress_above_the_level_is_noted() {
        let (t, mut sa) = triangle(400);
        sa.iter_mut().for_each(|s| *s = s.max(20.0));
        let reading = read(&t, &sa).unwrap();
        assert_eq!(reading.sa_res_kpa, 20.0);
        assert_eq!(
            reading.unreached,
            Unreached {
                upstroke: [false, false, true],
                downstroke: [false, false, true]
            }
        );
    }

    #[test]
    fn no_stress_is_a_beat_that_crosses_no_level() {
        for (sa, at) in [([0.0; 3], 0.0), ([-2.0, -1.0, -1.0], 1.0)] {
            let reading = read(&[0.0, 1.0, 2.0], &sa).unwrap();
            let b = reading.biomarkers;
            assert_eq!((b.sa_max_kpa, reading.t_sa_max_ms), (sa[1], at));
            assert_eq!((b.dsadt_max_kpa_per_ms, b.std50_ms), (0.0, 2.0));
            assert_eq!(reading.unreached.durations(), [true; 3]);
        }
    }

    #[test]
    fn traces_without_meaning_are_refused() {
        let t = [0.0, 1.0, 2.0];
        assert!(matches!(
            read(&t, &[0.0, f64::NAN, 0.0]),
            Err(CellTraceError::NotFinite { idx: 1, .. })
        ));
        assert!(matches!(
            read(&t[..2], &[0.0; 3]),
            Err(CellTraceError::Length {
                n_times: 2,
                n_values: 2
            })
        ));
        assert!(StressReading::of(&t, &[0.0, 1.0], &[1.0; 3]).is_err());
        assert!(StressReading::of(&t, &[0.0, 1.0, 0.0], &[1.0; 2]).is_err());
        assert!(StressReading::of(&t, &[0.0, 1.0, 0.0], &[1.0, f64::INFINITY, 1.0]).is_err());
    }

    #[test]
    fn calcium_durations_of_an_exponential_decay() {
        let time: Vec<f64> = (0..=1000).map(f64::from).collect();
        let tau = 150.0;
        let ca: Vec<f64> = time
            .iter()
            .map(|t| {
                if *t < 20.0 {
                    0.15
                } else {
                    0.15 + 0.45 * (-(t - 20.0) / tau).exp()
                }
            })
            .collect();
        let d = CalciumDurations::of(&time, &ca, MicroMolar(0.15), Ms(5.0)).unwrap();
        assert!((d.ctd50.0 - (15.0 + tau * 2.0f64.ln())).abs() < 0.01);
        assert!((d.ctd90.0 - (15.0 + tau * 10.0f64.ln())).abs() < 0.01);
        assert_eq!(d.unreached, [false, false]);
        let cut =
            CalciumDurations::of(&time[..200], &ca[..200], MicroMolar(0.15), Ms(5.0)).unwrap();
        assert_eq!(cut.unreached, [false, true]);
        assert_eq!(cut.ctd90, Ms(194.0));
    }
}
