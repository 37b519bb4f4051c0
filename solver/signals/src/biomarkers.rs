//! Biomarkers of pressure and volume traces, measured or simulated.
//!
//! Source: Jung et al. 2022, Mathematics 10(5):823, Appendix C, with the readings of docs/models.md, `biomarkers`:
//! levels are crossed by linear interpolation, derivatives are central differences, and the two regressions run from
//! argument 0.9 to 0.1 of their logarithm. A level that a beat does not reach before its end is taken at its end and
//! flagged, so that a fixed point can continue from it.
//!
//! No biomarker jumps when a trace changes a little: crossings are searched outwards from the half-way point of the limb
//! that crosses (upstroke, downstroke, ejection, filling), which is taken to be at least as steep as
//! [`PRESSURE_STEEPNESS_PER_MS`] or [`VOLUME_STEEPNESS_PER_MS`] (see `Cycle::leaves`), and regressions are integrals
//! over the time between two crossings. `tests/continuity.rs` bounds the change.

use crate::cycle::{Continuation, Crossing, Cycle, Side, Way};
use crate::noise_windows;
use crate::resample::{ResampleError, STEP, resample};
use crate::{Quantity, Trace};
use cardiotwin_units::{Ml, Ms};
use cardiotwin_vocabulary::biomarkers::{Biomarkers, NoiseWindows, TimePoints};

/// Fraction of the pressure's amplitude whose crossings bound PTD90, dimensionless.
pub const PRESSURE_LEVEL: f64 = 0.1;
/// Fraction of the stroke volume that is recovered at the end of early filling (t7), dimensionless.
pub const RECOVERY_LEVEL: f64 = 0.8;
/// Arguments of the logarithm between which ejection and filling are fitted, dimensionless.
pub const FIT_WINDOW: [f64; 2] = [0.9, 0.1];
/// Fraction of the pressure's amplitude per ms that its up- and downstroke have at least around the 10 % level: a tenth
/// in 50 ms. The cohort `coa-seven` has a tenth in 10 to 24 ms there. Where end-diastolic pressure lies near the level, t1
/// is the foot of the upstroke extended downwards so steeply, which moves it by 4 ms for a hundredth of the amplitude.
pub const PRESSURE_STEEPNESS_PER_MS: f64 = 1.0 / 500.0;
/// Fraction of the stroke volume per ms that ejection and early filling have at least, as above: a tenth in 200 ms, since
/// both end slowly.
pub const VOLUME_STEEPNESS_PER_MS: f64 = 1.0 / 2000.0;
/// Fraction of the stroke volume within which volume counts as being at the maximum or minimum, dimensionless: closed
/// valves leak hundredths of a millilitre, which would otherwise move t4 to the start of isovolumic contraction.
const PLATEAU: f64 = 1e-3;

/// Something about a set of biomarkers that its reader must know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flag {
    /// Pressure is above its 10 % level when its upstroke begins: t1 lies where the foot of the upstroke, extended
    /// downwards, meets the level.
    PressureRiseNotReached,
    /// The 10 % level lies below the pressure at time zero, so that t1 and the beginning of PTD90 lie before it.
    PressureRiseBeforeBeat,
    /// Pressure did not fall to its 10 % level: t3 is the end of the beat.
    PressureFallNotReached,
    /// Pressure does not vary, or its peak lies at an end of the beat, so that no derivative exists before or after it.
    NoPressurePulse,
    /// Volume does not vary.
    NoEjection,
    /// Less than a sample's step lies between 90 and 10 % of the ejected volume: no `tau_VD`.
    EjectionTooShort,
    /// Volume did not recover to 80 % of the stroke volume: t7 lies where filling, extended, would, but at the end of the
    /// beat at the latest, and `tau_VR` is fitted to the volume that was recovered.
    FillingNotRecovered,
    /// Less than a sample's step lies in the filling window: no `tau_VR`.
    FillingTooShort,
}

impl Flag {
    /// The flag in words.
    #[must_use]
    pub fn remark(self) -> &'static str {
        match self {
            Self::PressureRiseNotReached => {
                "pressure is above its 10 % level when its upstroke begins: t1 is the upstroke's foot, extended downwards"
            }
            Self::PressureRiseBeforeBeat => {
                "the 10 % level lies below the pressure at time zero: t1 lies before the beat"
            }
            Self::PressureFallNotReached => {
                "pressure does not fall to its 10 % level: t3 is the end of the beat"
            }
            Self::NoPressurePulse => "pressure has no pulse: no rates before and after a peak",
            Self::NoEjection => "volume does not vary",
            Self::EjectionTooShort => "ejection has too few samples for tau_VD",
            Self::FillingNotRecovered => {
                "volume does not recover to 80 % of the stroke volume: tau_VR is fitted to the volume recovered"
            }
            Self::FillingTooShort => "filling has too few samples for tau_VR",
        }
    }
}

/// Biomarkers of one beat, with the times that define them; what a missing trace or a degenerate one cannot give is absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BeatBiomarkers {
    /// Values of the biomarkers; each is absent where its trace is.
    pub values: Biomarkers,
    /// Times from the trace's time zero; a periodic trace's may lie in the cycle before or after, and a single beat's t1
    /// before its first sample. Times of extremes (t2, steepest pressures) are for drawings: a flat top moves them far. t4 to
    /// t6 are times at the largest and the smallest volume to 0.1 % of the stroke volume.
    pub time_points: TimePoints,
    /// Time of the largest pressure derivative.
    pub t_dpdt_max_ms: Option<f64>,
    /// Time of the smallest pressure derivative.
    pub t_dpdt_min_ms: Option<f64>,
    /// Volume at the beat's last sample.
    pub v_end_ml: Option<f64>,
    /// Reservations about these values.
    pub flags: Vec<Flag>,
}

/// Reasons why biomarkers cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BiomarkerError {
    /// A trace of another quantity.
    #[error("found a {found} trace, expected a {expected} trace")]
    Quantity {
        /// Quantity of the trace that is needed.
        expected: Quantity,
        /// Quantity of the trace that was given.
        found: Quantity,
    },
    /// The trace cannot be brought to the common step.
    #[error(transparent)]
    Resample(#[from] ResampleError),
}

impl BeatBiomarkers {
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
        let at_step =
            |trace: Option<&Trace>| trace.map(|t| resample(t, continuation, STEP)).transpose();
        Self::of_samples(
            at_step(pressure)?.as_ref(),
            at_step(volume)?.as_ref(),
            continuation,
        )
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
                return Err(BiomarkerError::Quantity {
                    expected,
                    found: trace.quantity(),
                });
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
        self.values.end_of_beat_gap_ml = self.v_end_ml.map(|v| measured_edv.0 - v);
        self
    }

    /// Biomarkers read over windows, as noisy measurements ask for; those of [`Self::of`] where there are none.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn over(
        pressure: Option<&Trace>,
        volume: Option<&Trace>,
        continuation: Continuation,
        windows: NoiseWindows,
    ) -> Result<Self, BiomarkerError> {
        let at_step =
            |trace: Option<&Trace>| trace.map(|t| resample(t, continuation, STEP)).transpose();
        let (pressure, mut volume) = (at_step(pressure)?, at_step(volume)?);
        if let (Some(trace), Some(window)) = (&mut volume, windows.volume_ms) {
            let values = noise_windows::smoothed(trace, continuation, Ms(window));
            *trace = Trace::new(trace.quantity(), trace.time_ms().to_vec(), values)
                .map_err(ResampleError::from)?;
        }
        let mut set = Self::of_samples(pressure.as_ref(), volume.as_ref(), continuation)?;
        if let (Some(trace), Some(window), false) = (
            &pressure,
            windows.pressure_ms,
            set.has(Flag::NoPressurePulse),
        ) {
            let cycle = Cycle::new(trace.time_ms(), trace.values(), continuation);
            set.add_rates(&cycle, noise_windows::reach_of(Ms(window), &cycle));
            set.values.p_max_mmhg = noise_windows::smoothed(trace, continuation, Ms(window))
                .into_iter()
                .reduce(f64::max);
        }
        Ok(set)
    }

    /// The flags in words.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let words = self.flags.iter().map(|flag| flag.remark().to_owned());
        words.collect()
    }

    /// Whether a flag is set.
    #[must_use]
    pub fn has(&self, flag: Flag) -> bool {
        self.flags.contains(&flag)
    }

    fn add_pressure(&mut self, p: &Cycle) {
        let peak = p.argmax();
        let (max, min) = (p.value(peak), p.value(p.argmin()));
        self.values.p_max_mmhg = Some(max);
        self.values.edp_mmhg = Some(p.value(0));
        self.time_points.t2_ms = Some(p.time(peak));
        if max <= min {
            self.flags.push(Flag::NoPressurePulse);
            return;
        }
        let [steepest, fastest_fall] = self.add_rates(p, 1);
        if steepest.is_none() || fastest_fall.is_none() {
            self.flags.push(Flag::NoPressurePulse);
        }

        let level = |fraction: f64| min + fraction * (max - min);
        let rate = PRESSURE_STEEPNESS_PER_MS * (max - min);
        let half = level(0.5);
        let upstroke = p.last_on_limb(peak, Way::Back, Side::Above, half);
        let downstroke = p.last_on_limb(peak, Way::On, Side::Above, half);
        let crossing =
            |anchor, way| p.leaves(anchor, way, Side::Above, level(PRESSURE_LEVEL), rate);
        let (Some(rise), Some(fall)) =
            (crossing(upstroke, Way::Back), crossing(downstroke, Way::On))
        else {
            return;
        };
        if !rise.on_trace {
            self.flags.push(Flag::PressureRiseNotReached);
        }
        if rise.time_ms < p.time(0) {
            self.flags.push(Flag::PressureRiseBeforeBeat);
        }
        let t3 = fall.time_ms.min(p.time(p.highest(peak)));
        if t3 < fall.time_ms {
            self.flags.push(Flag::PressureFallNotReached);
        }
        self.time_points.t1_ms = Some(rise.time_ms);
        self.time_points.t3_ms = Some(t3);
        self.values.ptd90_ms = Some(t3 - rise.time_ms);
    }

    /// Largest and smallest rate with their indices, of lines through the samples up to `reach` away.
    fn add_rates(&mut self, p: &Cycle, reach: isize) -> [Option<(isize, f64)>; 2] {
        let peak = p.argmax();
        // Half a cycle to either side of a periodic trace's peak holds up- and downstroke wherever its time zero lies, and
        // leaves out the diastole in which an end and a beginning that do not fit may be joined.
        let last = p.len() as isize - 1;
        let half = p.len() as isize / 2;
        let [first, end] = if p.is_periodic() {
            [peak - half, peak + half]
        } else {
            [0, last]
        };
        let slopes = |range: std::ops::Range<isize>| {
            range.filter_map(|i| p.slope_over(i, reach).map(|s| (i, s)))
        };
        let steepest = slopes(first..peak).max_by(|a, b| a.1.total_cmp(&b.1));
        let fastest_fall = slopes(peak + 1..end + 1).min_by(|a, b| a.1.total_cmp(&b.1));
        self.values.dpdt_max_mmhg_per_ms = steepest.map(|x| x.1);
        self.values.dpdt_min_mmhg_per_ms = fastest_fall.map(|x| x.1);
        self.t_dpdt_max_ms = steepest.map(|x| p.time(x.0));
        self.t_dpdt_min_ms = fastest_fall.map(|x| p.time(x.0));
        [steepest, fastest_fall]
    }

    fn add_volume(&mut self, v: &Cycle) {
        let lowest = v.argmin();
        let (max, min) = (v.value(v.argmax()), v.value(lowest));
        let sv = max - min;
        self.values.sv_ml = Some(sv);
        self.values.edv_ml = Some(v.value(0));
        self.values.esv_ml = Some(min);
        self.v_end_ml = Some(v.values()[v.len() - 1]);
        if sv <= 0.0 {
            self.flags.push(Flag::NoEjection);
            return;
        }
        self.add_ejection(v, lowest, min, sv);
        self.add_filling(v, lowest, min, sv);
    }

    /// Regression of ln((V − min V)/SV) on t in ejection, the last fall before the smallest volume.
    fn add_ejection(&mut self, v: &Cycle, lowest: isize, min: f64, sv: f64) {
        let high = (v.lowest(lowest)..=lowest)
            .map(|i| v.value(i))
            .fold(min, f64::max)
            - min;
        // A simulated beat may end fuller than it began: its ejection then starts inside the window.
        let [upper, lower] = [FIT_WINDOW[0].min(high / sv), FIT_WINDOW[1]];
        if upper <= lower {
            self.flags.push(Flag::EjectionTooShort);
            return;
        }
        let after = v.last_on_limb(
            lowest,
            Way::Back,
            Side::Below,
            min + 0.5 * (upper + lower) * sv,
        );
        let rate = VOLUME_STEEPNESS_PER_MS * sv;
        let at = |c: Option<Crossing>| c.map(|c| v.within(c.time_ms));
        let fullest =
            |share: f64| at(v.leaves(after, Way::Back, Side::Below, min + share * sv, rate));
        let emptiest =
            |share: f64| at(v.leaves(after - 1, Way::On, Side::Above, min + share * sv, rate));
        self.time_points.t4_ms = fullest(high / sv - PLATEAU);
        self.time_points.t5_ms = emptiest(PLATEAU);
        let window = fullest(upper).zip(emptiest(lower));
        self.values.tau_vd_ms = window.and_then(|w| time_constant(v, w, |x| (x - min) / sv));
        if self.values.tau_vd_ms.is_none() {
            self.flags.push(Flag::EjectionTooShort);
        }
    }

    /// Regression of ln(1 − (V − min V)/(V(t7) − min V)) on t in early filling, the first rise after the smallest volume.
    fn add_filling(&mut self, v: &Cycle, lowest: isize, min: f64, sv: f64) {
        let most = (lowest..=v.highest(lowest))
            .map(|i| v.value(i))
            .fold(min, f64::max)
            - min;
        if most < RECOVERY_LEVEL * sv {
            self.flags.push(Flag::FillingNotRecovered);
        }
        let recovered = most.min(RECOVERY_LEVEL * sv);
        if recovered <= PLATEAU * sv {
            self.flags.push(Flag::FillingTooShort);
            return;
        }
        let before = v.last_on_limb(lowest, Way::On, Side::Below, min + 0.5 * recovered);
        let rate = VOLUME_STEEPNESS_PER_MS * sv;
        let at = |c: Option<Crossing>| c.map(|c| v.within(c.time_ms));
        let emptiest =
            |height: f64| at(v.leaves(before + 1, Way::Back, Side::Above, min + height, rate));
        let fullest = |height: f64| at(v.leaves(before, Way::On, Side::Below, min + height, rate));
        self.time_points.t6_ms = emptiest(PLATEAU * sv);
        self.time_points.t7_ms = fullest(RECOVERY_LEVEL * sv);
        // 1 − x falls from 0.9 to 0.1 while the recovered fraction x rises from 0.1 to 0.9.
        let [early, late] = FIT_WINDOW.map(|argument| (1.0 - argument) * recovered);
        self.values.tau_vr_ms = emptiest(early)
            .zip(fullest(late))
            .and_then(|w| time_constant(v, w, |x| 1.0 - (x - min) / recovered));
        if self.values.tau_vr_ms.is_none() {
            self.flags.push(Flag::FillingTooShort);
        }
    }
}

/// −1/slope of the least-squares line of ln(argument) on time over a window between two times, the logarithm taken as
/// linear between samples; none where the window is not longer than a sample's step or no decay is found.
///
/// An integral, not a sum over the samples inside: a sum jumps when a sample enters the window.
fn time_constant(
    v: &Cycle,
    (begin, end): (f64, f64),
    argument: impl Fn(f64) -> f64,
) -> Option<f64> {
    if end - begin <= v.usual_step() {
        return None;
    }
    let inside = v.inside(begin, end).map(|i| (v.time(i), v.value(i)));
    let knots = std::iter::once((begin, v.at(begin)))
        .chain(inside)
        .chain(std::iter::once((end, v.at(end))));
    // Times from the window's middle, where the mean time is: the two sums below are then all that is needed.
    let middle = 0.5 * (begin + end);
    let mut before: Option<(f64, f64)> = None;
    let mut covariance = 0.0;
    for (t, value) in knots {
        let x = argument(value);
        if x <= 0.0 {
            return None;
        }
        let (t, y) = (t - middle, x.ln());
        if let Some((t0, y0)) = before {
            // ∫ t y dt over a piece on which y is linear.
            covariance += (t - t0) / 6.0 * (t0 * (2.0 * y0 + y) + t * (y0 + 2.0 * y));
        }
        before = Some((t, y));
    }
    let variance = (end - begin).powi(3) / 12.0;
    let tau = -variance / covariance;
    (tau.is_finite() && tau > 0.0).then_some(tau)
}

#[cfg(test)]
#[path = "biomarkers_tests.rs"]
mod tests;
