//! Ees from the pressure that the ventricle would reach without ejection, after ten Brinke et al. 2010.
//!
//! A polynomial of the fifth degree through pressure before its steepest rise and after its steepest fall bridges
//! ejection; its maximum Pmax is the isovolumic pressure at the end-diastolic volume. The end-systolic line goes through
//! (EDV, Pmax) and the end-systolic point: Ees = (Pmax − Pes)/(EDV − Ves).
//!
//! Source: read in a public program that names ten Brinke et al. 2010; the publication was not read. The program begins
//! with the R wave; here the polynomial begins at the foot of the upstroke, so that it needs no electrocardiogram. The
//! program weighs outliers down; here all samples count alike.

use super::super::beat::Beat;
use super::super::end_systole::{EndSystole, settle};
use super::super::regression::polynomial;
use super::{SingleBeatError, positive};

/// Share of the steepest fall at which isovolumic relaxation ends, as in the program.
const RELAXED: f64 = 0.15;
/// Coefficients of the polynomial.
const N_COEFFICIENTS: usize = 6;
/// Step of the search for the polynomial's maximum \[ms\].
const SEARCH_MS: f64 = 0.1;

/// Estimate of a beat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// End-systolic elastance Ees \[mmHg/mL\].
    pub elastance_mmhg_per_ml: f64,
    /// Volume intercept V0 = EDV − Pmax/Ees \[mL\].
    pub intercept_ml: f64,
    /// Isovolumic pressure Pmax \[mmHg\].
    pub isovolumic_mmhg: f64,
    /// Time of Pmax \[ms\].
    pub isovolumic_peak_ms: f64,
    /// Samples that the polynomial was fitted to.
    pub n_samples: usize,
    /// End-systolic point.
    pub end_systole: EndSystole,
}

impl Estimate {
    /// Estimate of a beat. The end-systolic point depends on V0 and is found with it: the line touches the loop.
    ///
    /// # Errors
    /// [`SingleBeatError`] when the isovolumic phases are too short, Pmax does not exceed end-systolic pressure, or V0 is
    /// not below all volumes.
    pub fn of(beat: &Beat) -> Result<Self, SingleBeatError> {
        let (isovolumic_peak_ms, isovolumic_mmhg, n_samples) = isovolumic_maximum(beat)?;
        let full_ml = beat.end_diastolic_volume_ml();
        let (points, intercept_ml, elastance_mmhg_per_ml) = settle(&[beat], |points| {
            let point = points[0];
            let elastance = positive(
                "the elastance in mmHg/mL",
                (isovolumic_mmhg - point.pressure_mmhg) / (full_ml - point.volume_ml),
            )?;
            Ok::<_, SingleBeatError>((full_ml - isovolumic_mmhg / elastance, elastance))
        })?;
        Ok(Self {
            elastance_mmhg_per_ml,
            intercept_ml,
            isovolumic_mmhg,
            isovolumic_peak_ms,
            n_samples,
            end_systole: points[0],
        })
    }
}

/// Time and value of the polynomial's maximum between the steepest rise and fall, and the samples it was fitted to.
fn isovolumic_maximum(beat: &Beat) -> Result<(f64, f64, usize), SingleBeatError> {
    let times = beat.systolic_times();
    let (rise_ms, fall_ms) = (times.steepest_rise_ms, times.steepest_fall_ms);
    let p = beat.pressure();
    let (rise, fall) = (p.nearest(rise_ms), p.nearest(fall_ms));
    let foot = p.nearest(times.pressure_rises_ms);
    let steepest_fall = p.slope(fall).unwrap_or(0.0);
    let mut relaxed = fall;
    while relaxed < p.highest(fall)
        && p.slope(relaxed + 1)
            .is_some_and(|s| s <= RELAXED * steepest_fall)
    {
        relaxed += 1;
    }
    let (begin_ms, end_ms) = (p.time(foot), p.time(relaxed));
    let (middle, half) = (0.5 * (begin_ms + end_ms), 0.5 * (end_ms - begin_ms));
    let points: Vec<[f64; 2]> = (foot..=rise)
        .chain(fall..=relaxed)
        .map(|i| [(p.time(i) - middle) / half, p.value(i)])
        .collect();
    let n_samples = points.len();
    let coefficients: [f64; N_COEFFICIENTS] =
        polynomial(&points).ok_or(SingleBeatError::TooFewSamples { n_samples })?;
    let n_steps = ((fall_ms - rise_ms) / SEARCH_MS).floor().max(0.0) as usize;
    let (time_ms, value) = (0..=n_steps)
        .map(|k| rise_ms + k as f64 * SEARCH_MS)
        .map(|time_ms| {
            let x = (time_ms - middle) / half;
            (
                time_ms,
                coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c),
            )
        })
        .fold((rise_ms, f64::NEG_INFINITY), |best, next| {
            if next.1 > best.1 { next } else { best }
        });
    Ok((time_ms, value, n_samples))
}
