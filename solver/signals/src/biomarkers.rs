//! Biomarkers of pressure and volume traces, measured or simulated.
//!
//! Source: Jung et al. 2022, Mathematics 10(5):823, Appendix C, with the readings of docs/models.md, `biomarkers`:
//! levels are crossed by linear interpolation, derivatives are central differences, and the two regressions run from
//! argument 0.9 to 0.1 of their logarithm. A level that a beat does not reach before its end is taken at its end and
//! flagged, so that a fixed point can go on from it.

use crate::cycle::{Continuation, Cycle};
use crate::resample::{ResampleError, STEP, resample};
use crate::{Quantity, Trace};
use cardiotwin_units::{Ml, Mmhg, Ms};
use serde::{Deserialize, Serialize};

/// Fraction of the pressure's amplitude whose crossings bound PTD90, dimensionless.
pub const PRESSURE_LEVEL: f64 = 0.1;
/// Fraction of the stroke volume that is recovered at the end of early filling (t7), dimensionless.
pub const RECOVERY_LEVEL: f64 = 0.8;
/// Arguments of the logarithm between which ejection and filling are fitted, dimensionless.
pub const FIT_WINDOW: [f64; 2] = [0.9, 0.1];
/// Fraction of the stroke volume within which a sample counts as being at the maximum or minimum, dimensionless: closed
/// valves leak hundredths of a millilitre, which would otherwise move t4 to the start of isovolumic contraction.
const PLATEAU: f64 = 1e-3;

/// Something about a set of biomarkers that its reader must know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// Pressure was above its 10 % level from the start: t1 is the first sample.
    PressureRiseNotReached,
    /// The 10 % level lies below the pressure at time zero of a periodic trace, so that t1 and the beginning of PTD90 lie
    /// in the diastole before.
    PressureRiseBeforeBeat,
    /// Pressure did not fall to its 10 % level: t3 is the end of the beat.
    PressureFallNotReached,
    /// Pressure does not vary, or its peak lies at an end of the beat, so that no derivative exists before or after it.
    NoPressurePulse,
    /// Volume does not vary.
    NoEjection,
    /// Fewer than two samples lie between 90 and 10 % of the ejected volume: no `tau_VD`.
    EjectionTooShort,
    /// Volume did not recover to 80 % of the stroke volume: t7 is the end of the beat.
    FillingNotRecovered,
    /// Fewer than two samples lie in the filling window: no `tau_VR`.
    FillingTooShort,
}

/// The times of Figure A1, ms from the trace's time zero; a periodic trace's may lie in the cycle before or after.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct TimePoints {
    /// Upstroke crossing of 10 % of the pressure's amplitude.
    #[serde(rename = "t1_ms", skip_serializing_if = "Option::is_none")]
    pub t1: Option<Ms>,
    /// Time of the largest pressure.
    #[serde(rename = "t2_ms", skip_serializing_if = "Option::is_none")]
    pub t2: Option<Ms>,
    /// Downstroke crossing of 10 % of the pressure's amplitude.
    #[serde(rename = "t3_ms", skip_serializing_if = "Option::is_none")]
    pub t3: Option<Ms>,
    /// Last time at the largest volume before ejection.
    #[serde(rename = "t4_ms", skip_serializing_if = "Option::is_none")]
    pub t4: Option<Ms>,
    /// First time at the smallest volume.
    #[serde(rename = "t5_ms", skip_serializing_if = "Option::is_none")]
    pub t5: Option<Ms>,
    /// Last time at the smallest volume.
    #[serde(rename = "t6_ms", skip_serializing_if = "Option::is_none")]
    pub t6: Option<Ms>,
    /// Time at which 80 % of the stroke volume is recovered.
    #[serde(rename = "t7_ms", skip_serializing_if = "Option::is_none")]
    pub t7: Option<Ms>,
    /// Time of the largest pressure derivative.
    #[serde(rename = "t_dPdt_max_ms", skip_serializing_if = "Option::is_none")]
    pub t_dpdt_max: Option<Ms>,
    /// Time of the smallest pressure derivative.
    #[serde(rename = "t_dPdt_min_ms", skip_serializing_if = "Option::is_none")]
    pub t_dpdt_min: Option<Ms>,
}

/// Biomarkers of one beat; what a missing trace or a degenerate one cannot give is absent.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct BiomarkerSet {
    /// Largest pressure.
    #[serde(rename = "P_max_mmHg", skip_serializing_if = "Option::is_none")]
    pub p_max: Option<Mmhg>,
    /// Largest rate of pressure before its peak, mmHg/ms.
    #[serde(rename = "dPdt_max_mmHg_per_ms", skip_serializing_if = "Option::is_none")]
    pub dpdt_max_mmhg_per_ms: Option<f64>,
    /// Smallest rate of pressure after its peak, mmHg/ms, negative.
    #[serde(rename = "dPdt_min_mmHg_per_ms", skip_serializing_if = "Option::is_none")]
    pub dpdt_min_mmhg_per_ms: Option<f64>,
    /// Pressure transient duration between the 10 % crossings.
    #[serde(rename = "PTD90_ms", skip_serializing_if = "Option::is_none")]
    pub ptd90: Option<Ms>,
    /// Pressure at the beat's start.
    #[serde(rename = "EDP_mmHg", skip_serializing_if = "Option::is_none")]
    pub edp: Option<Mmhg>,
    /// Stroke volume: largest less smallest volume.
    #[serde(rename = "SV_mL", skip_serializing_if = "Option::is_none")]
    pub sv: Option<Ml>,
    /// Decay time constant of ejection.
    #[serde(rename = "tau_VD_ms", skip_serializing_if = "Option::is_none")]
    pub tau_vd: Option<Ms>,
    /// Rise time constant of early filling.
    #[serde(rename = "tau_VR_ms", skip_serializing_if = "Option::is_none")]
    pub tau_vr: Option<Ms>,
    /// Volume at the beat's start.
    #[serde(rename = "EDV_mL", skip_serializing_if = "Option::is_none")]
    pub edv: Option<Ml>,
    /// Smallest volume.
    #[serde(rename = "ESV_mL", skip_serializing_if = "Option::is_none")]
    pub esv: Option<Ml>,
    /// Volume at the beat's last sample.
    #[serde(rename = "V_end_mL", skip_serializing_if = "Option::is_none")]
    pub v_end: Option<Ml>,
    /// Measured EDV less the volume at a simulated beat's end; set by [`BiomarkerSet::with_gap_to`].
    #[serde(rename = "end_of_beat_gap_mL", skip_serializing_if = "Option::is_none")]
    pub end_of_beat_gap: Option<Ml>,
    /// Time points that the report draws.
    pub time_points: TimePoints,
    /// What the reader must know about these values.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flags: Vec<Flag>,
}

/// Why biomarkers cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BiomarkerError {
    /// A trace of another quantity.
    #[error("a {expected} trace is expected, but a {found} trace was given")]
    Quantity {
        /// What should have been given.
        expected: Quantity,
        /// What was given.
        found: Quantity,
    },
    /// The trace cannot be brought to the common step.
    #[error(transparent)]
    Resample(#[from] ResampleError),
}

impl BiomarkerSet {
    /// Biomarkers of a beat's traces after resampling both to 1 ms ([`STEP`]): the one way for every comparison.
    ///
    /// - `pressure` in mmHg, `volume` in mL; either may be missing, and so are its biomarkers then
    ///
    /// # Errors
    /// [`BiomarkerError`] when a trace holds another quantity or cannot be resampled. Verified by
    /// `tests/coa_seven.rs` against the clinical rows of Table 2.
    pub fn of(
        pressure: Option<&Trace>,
        volume: Option<&Trace>,
        continuation: Continuation,
    ) -> Result<Self, BiomarkerError> {
        let at_step = |trace: Option<&Trace>| trace.map(|t| resample(t, continuation, STEP)).transpose();
        Self::of_samples(at_step(pressure)?.as_ref(), at_step(volume)?.as_ref(), continuation)
    }

    /// Biomarkers of the samples as they are, without resampling.
    ///
    /// # Errors
    /// [`BiomarkerError::Quantity`] when a trace holds another quantity.
    pub fn of_samples(
        pressure: Option<&Trace>,
        volume: Option<&Trace>,
        continuation: Continuation,
    ) -> Result<Self, BiomarkerError> {
        let mut set = Self::default();
        for (trace, expected) in [(pressure, Quantity::Pressure), (volume, Quantity::Volume)] {
            let Some(trace) = trace else { continue };
            if trace.quantity() != expected {
                return Err(BiomarkerError::Quantity { expected, found: trace.quantity() });
            }
            let cycle = Cycle::new(trace.time_ms(), trace.values(), continuation);
            match expected {
                Quantity::Pressure => set.add_pressure(&cycle),
                _ => set.add_volume(&cycle),
            }
        }
        Ok(set)
    }

    /// With the volume that a simulated beat leaves open at its end against the measured end-diastolic volume.
    #[must_use]
    pub fn with_gap_to(mut self, measured_edv: Ml) -> Self {
        self.end_of_beat_gap = self.v_end.map(|v| measured_edv - v);
        self
    }

    /// Whether a flag is set.
    #[must_use]
    pub fn has(&self, flag: Flag) -> bool {
        self.flags.contains(&flag)
    }

    fn add_pressure(&mut self, p: &Cycle) {
        let peak = p.argmax();
        let (max, min) = (p.value(peak), p.value(p.argmin()));
        self.p_max = Some(Mmhg(max));
        self.edp = Some(Mmhg(p.value(0)));
        self.time_points.t2 = Some(Ms(p.time(peak)));
        if max <= min {
            self.flags.push(Flag::NoPressurePulse);
            return;
        }
        // The beat's time zero lies in diastole, so before and after the peak mean within the beat, wrapped or not.
        let last = p.len() as isize - 1;
        let slopes = |range: std::ops::RangeInclusive<isize>| range.filter_map(|i| p.slope(i).map(|s| (i, s)));
        let steepest = slopes(0..=peak - 1).max_by(|a, b| a.1.total_cmp(&b.1));
        let fastest_fall = slopes(peak + 1..=last).min_by(|a, b| a.1.total_cmp(&b.1));
        self.dpdt_max_mmhg_per_ms = steepest.map(|x| x.1);
        self.dpdt_min_mmhg_per_ms = fastest_fall.map(|x| x.1);
        self.time_points.t_dpdt_max = steepest.map(|x| Ms(p.time(x.0)));
        self.time_points.t_dpdt_min = fastest_fall.map(|x| Ms(p.time(x.0)));
        if steepest.is_none() || fastest_fall.is_none() {
            self.flags.push(Flag::NoPressurePulse);
        }

        let level = min + PRESSURE_LEVEL * (max - min);
        let t1 = p.last_rise(level, peak).unwrap_or_else(|| {
            self.flags.push(Flag::PressureRiseNotReached);
            p.time(0)
        });
        let t3 = p.first_fall(level, peak).map(|x| x.0).unwrap_or_else(|| {
            self.flags.push(Flag::PressureFallNotReached);
            p.time(last)
        });
        if t1 < p.time(0) {
            self.flags.push(Flag::PressureRiseBeforeBeat);
        }
        self.time_points.t1 = Some(Ms(t1));
        self.time_points.t3 = Some(Ms(t3));
        self.ptd90 = Some(Ms(t3 - t1));
    }

    fn add_volume(&mut self, v: &Cycle) {
        let lowest = v.argmin();
        let (max, min) = (v.value(v.argmax()), v.value(lowest));
        let sv = max - min;
        self.sv = Some(Ml(sv));
        self.edv = Some(Ml(v.value(0)));
        self.esv = Some(Ml(min));
        self.v_end = Some(Ml(v.values()[v.len() - 1]));
        if sv <= 0.0 {
            self.flags.push(Flag::NoEjection);
            return;
        }
        let t5 = self.add_ejection(v, lowest, min, sv);
        self.add_filling(v, t5, min, sv);
    }

    /// Regression of ln((V − min V)/SV) on t in ejection; returns the sample of t5.
    fn add_ejection(&mut self, v: &Cycle, lowest: isize, min: f64, sv: f64) -> isize {
        let first = v.lowest(lowest);
        let high = (first..=lowest).map(|i| v.value(i)).fold(min, f64::max);
        let t4 = (first..=lowest).rev().find(|i| v.value(*i) >= high - PLATEAU * sv).unwrap_or(first);
        let t5 = (t4..=lowest).find(|i| v.value(*i) <= min + PLATEAU * sv).unwrap_or(lowest);
        self.time_points.t4 = Some(Ms(v.time(t4)));
        self.time_points.t5 = Some(Ms(v.time(t5)));
        let level = |fraction: f64| min + fraction * sv;
        // A simulated beat may end fuller than it began: its ejection then starts inside the window.
        let begin = (t4..=t5).find(|i| v.value(*i) <= level(FIT_WINDOW[0]));
        let window = begin.and_then(|begin| {
            let (_, after) = v.first_fall(level(FIT_WINDOW[1]), begin)?;
            Some(begin..after)
        });
        self.tau_vd = window.and_then(|w| time_constant(v, w, |x| (x - min) / sv));
        if self.tau_vd.is_none() {
            self.flags.push(Flag::EjectionTooShort);
        }
        t5
    }

    /// Regression of ln(1 − (V − min V)/(V(t7) − min V)) on t in early filling.
    fn add_filling(&mut self, v: &Cycle, t5: isize, min: f64, sv: f64) {
        let recovery = v.first_rise(min + RECOVERY_LEVEL * sv, t5);
        let search_end = recovery.map_or(v.highest(t5), |r| r.1);
        let t6 = (t5..=search_end).rev().find(|i| v.value(*i) <= min + PLATEAU * sv).unwrap_or(t5);
        let (t7, recovered) = match recovery {
            Some((t, _)) => (t, RECOVERY_LEVEL * sv),
            None => {
                self.flags.push(Flag::FillingNotRecovered);
                let end = v.len() as isize - 1;
                (v.time(end), v.value(end) - min)
            }
        };
        self.time_points.t6 = Some(Ms(v.time(t6)));
        self.time_points.t7 = Some(Ms(t7));
        // 1 − x falls from 0.9 to 0.1 while the recovered fraction x rises from 0.1 to 0.9.
        let level = |argument: f64| min + (1.0 - argument) * recovered;
        let window = v.first_rise(level(FIT_WINDOW[0]), t6).and_then(|(_, begin)| {
            let (_, after) = v.first_rise(level(FIT_WINDOW[1]), begin)?;
            Some(begin..after)
        });
        self.tau_vr = window.and_then(|w| time_constant(v, w, |x| 1.0 - (x - min) / recovered));
        if self.tau_vr.is_none() {
            self.flags.push(Flag::FillingTooShort);
        }
    }
}

/// −1/slope of the least-squares line of ln(argument) on time over a window of samples; none where fewer than two
/// samples or no decay are found.
fn time_constant(v: &Cycle, window: std::ops::Range<isize>, argument: impl Fn(f64) -> f64) -> Option<Ms> {
    let points: Vec<(f64, f64)> = window
        .filter_map(|i| {
            let x = argument(v.value(i));
            (x > 0.0).then(|| (v.time(i), x.ln()))
        })
        .collect();
    if points.len() < 2 {
        return None;
    }
    let n = points.len() as f64;
    let (mean_t, mean_y) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let covariance: f64 = points.iter().map(|p| (p.0 - mean_t) * (p.1 - mean_y)).sum();
    let variance: f64 = points.iter().map(|p| (p.0 - mean_t).powi(2)).sum();
    let tau = -variance / covariance;
    (tau.is_finite() && tau > 0.0).then_some(Ms(tau))
}

#[cfg(test)]
#[path = "biomarkers_tests.rs"]
mod tests;
