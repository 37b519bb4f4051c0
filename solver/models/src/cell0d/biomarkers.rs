//! Biomarkers of active stress and calcium (Jung 2022, Appendix C), on the beat's own samples.

use super::{Cell0d, CellBeat, CellError};
use crate::calcium::Rice2008;
use cardiotwin_signals::CalciumDurations;
use cardiotwin_signals::active_stress::{self, CellTraceError};
use cardiotwin_units::{MicroMolar, Ms};
use serde::{Deserialize, Serialize};

/// Active-stress biomarkers of one beat: largest sample, central differences, crossings by linear interpolation.
///
/// A level that the stress does not cross within the beat is taken at the beat's end (or its start, for an upstroke that
/// the beat does not contain) and flagged in `open_levels`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ActiveStressBiomarkers {
    /// Largest active stress of the beat \[kPa\].
    pub sa_max_kpa: f64,
    /// Time t11 of the largest stress \[ms\].
    pub t_sa_max_ms: f64,
    /// Largest rate of the stress before the maximum \[kPa/ms\].
    pub dsadt_max_kpa_per_ms: f64,
    /// Time above 70 % of the maximum around it \[ms\].
    pub std30_ms: f64,
    /// Time above 50 % of the maximum around it \[ms\].
    pub std50_ms: f64,
    /// Time above 10 % of the maximum around it \[ms\].
    pub std90_ms: f64,
    /// Smallest fibre stretch of the beat, dimensionless.
    pub lambda_min: f64,
    /// Stress at the start of the beat \[kPa\].
    pub sa_res_kpa: f64,
    /// Whether STD30, STD50 and STD90 are open: a level was not crossed within the beat.
    pub open_levels: [bool; 3],
}

/// Calcium biomarkers, from activation time, of the analytic transient (not cut at the cycle length).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CalciumBiomarkers {
    /// Time to 50 % decay \[ms\].
    pub ctd50_ms: f64,
    /// Time to 90 % decay \[ms\].
    pub ctd90_ms: f64,
}

/// Active-stress biomarkers of a trace (Jung 2022, Appendix C; misprint resolved: the rate's maximum is sought before t11).
///
/// - `time_ms`, `sa_kpa`, `lambda`: samples of one beat, equally long, at least three
///
/// Returns `None` for shorter or unequal traces, or ones with a value that is not finite.
#[must_use]
pub fn active_stress_biomarkers(
    time_ms: &[f64],
    sa_kpa: &[f64],
    lambda: &[f64],
) -> Option<ActiveStressBiomarkers> {
    if lambda.len() != sa_kpa.len() {
        return None;
    }
    let lambda_min = active_stress::lambda_min(lambda).ok()?.0;
    let sa_res_kpa = *sa_kpa.first()?;
    match active_stress::ActiveStressBiomarkers::of(time_ms, sa_kpa) {
        Ok(b) => Some(ActiveStressBiomarkers {
            sa_max_kpa: b.sa_max.0,
            t_sa_max_ms: b.t_sa_max.0,
            dsadt_max_kpa_per_ms: b.dsadt_max_kpa_per_ms,
            std30_ms: b.std30.0,
            std50_ms: b.std50.0,
            std90_ms: b.std90.0,
            lambda_min,
            sa_res_kpa,
            open_levels: std::array::from_fn(|k| {
                b.unreached.upstroke[k] || b.unreached.downstroke[k]
            }),
        }),
        // A cell that develops nothing is a poor fit, not a failed one.
        Err(CellTraceError::NoStress { max_kpa }) => {
            let whole_beat = time_ms[time_ms.len() - 1] - time_ms[0];
            Some(ActiveStressBiomarkers {
                sa_max_kpa: max_kpa,
                t_sa_max_ms: time_ms[sa_kpa.iter().position(|sa| *sa == max_kpa)?],
                dsadt_max_kpa_per_ms: 0.0,
                std30_ms: whole_beat,
                std50_ms: whole_beat,
                std90_ms: whole_beat,
                lambda_min,
                sa_res_kpa,
                open_levels: [true; 3],
            })
        }
        Err(CellTraceError::Length { .. } | CellTraceError::NotFinite { .. }) => None,
    }
}

impl CellBeat {
    /// Active-stress biomarkers of this beat; `None` only for a beat that was never filled.
    #[must_use]
    pub fn biomarkers(&self) -> Option<ActiveStressBiomarkers> {
        active_stress_biomarkers(&self.time_ms, &self.sa_kpa, &self.lambda)
    }
}

impl CalciumBiomarkers {
    /// Durations of Rice's transient.
    ///
    /// # Errors
    /// [`CellError::Balance`] if a level has no root, which the checked parameters exclude.
    pub fn of_rice(rice: &Rice2008) -> Result<Self, CellError> {
        let at = |fraction| {
            rice.decay_time(fraction)
                .map_err(|source| CellError::Balance {
                    what: "calcium decay time",
                    source,
                })
        };
        Ok(Self {
            ctd50_ms: at(0.5)?.0,
            ctd90_ms: at(0.9)?.0,
        })
    }

    /// Durations of a sampled transient by linear interpolation, taken at its last sample where it does not decay so far.
    #[must_use]
    pub fn of_samples(time_ms: &[f64], ca_um: &[f64]) -> Option<Self> {
        let (activation, resting) = (Ms(*time_ms.first()?), MicroMolar(*ca_um.first()?));
        let durations = CalciumDurations::of(time_ms, ca_um, resting, activation).ok()?;
        Some(Self {
            ctd50_ms: durations.ctd50.0,
            ctd90_ms: durations.ctd90.0,
        })
    }
}

impl Cell0d {
    /// Calcium biomarkers of the cell's input.
    ///
    /// # Errors
    /// As [`CalciumBiomarkers::of_rice`]; a sampled input gives its own durations.
    pub fn calcium_biomarkers(&self) -> Result<CalciumBiomarkers, CellError> {
        if let Some(rice) = self.rice() {
            return CalciumBiomarkers::of_rice(rice);
        }
        let Ms(length) = self.cycle_length();
        let time_ms: Vec<f64> = (0..=length as usize).map(|t| t as f64).collect();
        let ca_um: Vec<f64> = time_ms
            .iter()
            .map(|&t| self.calcium().concentration_um(t))
            .collect();
        CalciumBiomarkers::of_samples(&time_ms, &ca_um).ok_or(CellError::Parameter {
            name: "cycle length",
            value: length,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_has_known_biomarkers() {
        let time: Vec<f64> = (0..=100).map(f64::from).collect();
        let sa: Vec<f64> = time
            .iter()
            .map(|t| {
                if *t <= 40.0 {
                    0.5 * t
                } else {
                    20.0 - (t - 40.0) / 3.0
                }
            })
            .collect();
        let lambda: Vec<f64> = time.iter().map(|t| 1.0 - t / 1000.0).collect();
        let b = active_stress_biomarkers(&time, &sa, &lambda).unwrap();
        assert_eq!(
            (
                b.sa_max_kpa,
                b.t_sa_max_ms,
                b.dsadt_max_kpa_per_ms,
                b.lambda_min
            ),
            (20.0, 40.0, 0.5, 0.9)
        );
        // Above a level x of the maximum: (1 − x)(40 + 60) ms.
        for (value, want) in [(b.std30_ms, 30.0), (b.std50_ms, 50.0), (b.std90_ms, 90.0)] {
            assert!((value - want).abs() < 1e-12, "{value} {want}");
        }
        assert_eq!(b.open_levels, [false; 3]);
    }

    #[test]
    fn a_level_that_is_not_reached_ends_with_the_beat_and_is_flagged() {
        let time: Vec<f64> = (0..=80).map(f64::from).collect();
        let sa: Vec<f64> = time
            .iter()
            .map(|t| {
                if *t <= 40.0 {
                    0.5 * t
                } else {
                    20.0 - (t - 40.0) / 3.0
                }
            })
            .collect();
        let b = active_stress_biomarkers(&time, &sa, &sa).unwrap();
        assert_eq!(b.open_levels, [false, false, true]);
        assert!((b.std90_ms - 76.0).abs() < 1e-12);
    }

    #[test]
    fn not_finite_is_none() {
        assert_eq!(
            active_stress_biomarkers(&[0.0, 1.0, 2.0], &[0.0, f64::NAN, 0.0], &[1.0; 3]),
            None
        );
        assert_eq!(
            active_stress_biomarkers(&[0.0, 1.0, 2.0], &[0.0, 1.0, 0.0], &[1.0; 2]),
            None
        );
    }

    #[test]
    fn no_stress_is_a_beat_with_open_levels() {
        let b = active_stress_biomarkers(&[0.0, 1.0, 2.0], &[0.0; 3], &[1.0; 3]).unwrap();
        assert_eq!(
            (b.sa_max_kpa, b.std50_ms, b.open_levels),
            (0.0, 2.0, [true; 3])
        );
    }

    #[test]
    fn sampled_calcium_has_the_analytic_durations() {
        let rice = Rice2008::new(Default::default()).unwrap();
        let time: Vec<f64> = (0..=1000).map(f64::from).collect();
        let ca: Vec<f64> = time
            .iter()
            .map(|&t| crate::calcium::Calcium::concentration_um(&rice, t))
            .collect();
        let sampled = CalciumBiomarkers::of_samples(&time, &ca).unwrap();
        let exact = CalciumBiomarkers::of_rice(&rice).unwrap();
        assert!((sampled.ctd50_ms - exact.ctd50_ms).abs() < 0.01);
        assert!((sampled.ctd90_ms - exact.ctd90_ms).abs() < 0.01);
    }
}
