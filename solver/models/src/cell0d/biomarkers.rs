//! Biomarkers of active stress and calcium (Jung 2022, Appendix C), on the beat's own samples.

use super::{Cell0d, CellBeat, CellError};
use crate::calcium::Rice2008;
use cardiotwin_signals::{CalciumDurations, StressReading};
use cardiotwin_units::{MicroMolar, Ms};
use serde::{Deserialize, Serialize};

/// Calcium biomarkers, from activation time, of the analytic transient (not cut at the cycle length).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CalciumBiomarkers {
    /// Time to 50 % decay \[ms\].
    pub ctd50_ms: f64,
    /// Time to 90 % decay \[ms\].
    pub ctd90_ms: f64,
}

impl CellBeat {
    /// Biomarkers of this beat on its own samples; `None` only for a beat that was never filled.
    #[must_use]
    pub fn read(&self) -> Option<StressReading> {
        StressReading::of(&self.time_ms, &self.sa_kpa, &self.lambda).ok()
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
