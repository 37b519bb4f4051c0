//! Times of valve motion, from the pressure of the mean beat.
//!
//! When the aortic valve opens, the pressure stops rising freely; when it closes, the pressure
//! begins to fall freely. The slope has a corner at both times. They are the points with the most
//! negative second derivative after the steepest rise and before the steepest fall.

use crate::filter::{periodic_slope, periodic_smooth};

/// Half width of the smoothing before slopes are computed \[ms\].
const SMOOTH_MS: f64 = 3.0;
/// Largest time from the steepest rise to the opening of the aortic valve \[ms\].
const OPENING_MS: f64 = 60.0;
/// Largest time from the closure of the aortic valve to the steepest fall \[ms\].
const CLOSURE_MS: f64 = 70.0;
/// Largest duration of isovolumic relaxation \[ms\].
const RELAXATION_MS: f64 = 220.0;

/// Times in the mean beat, from its beginning \[ms\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValveEvents {
    /// Opening of the aortic valve.
    pub aortic_opening_ms: f64,
    /// Closure of the aortic valve.
    pub aortic_closure_ms: f64,
    /// Opening of the mitral valve: the pressure has fallen to its value at the beginning of the
    /// beat.
    pub mitral_opening_ms: f64,
    /// Steepest rise of the pressure.
    pub rise_ms: f64,
    /// Steepest fall of the pressure.
    pub fall_ms: f64,
}

/// Events of a beat that begins in diastole.
/// - `pressure_mmhg`: pressure of the ventricle over one periodic cycle, with samples every
///   `step_ms`
///
/// `None` if the pressure does not rise and fall. Verified by
/// `valves_move_when_the_pressure_says_so`.
#[must_use]
pub fn of_ventricle(pressure_mmhg: &[f64], step_ms: f64) -> Option<ValveEvents> {
    let n = pressure_mmhg.len();
    let half = (SMOOTH_MS / step_ms) as usize;
    let smooth = periodic_smooth(pressure_mmhg, half);
    let slope = periodic_slope(&smooth, step_ms);
    let bend = periodic_slope(&slope, step_ms);
    let peak = (0..n).max_by(|a, b| smooth[*a].total_cmp(&smooth[*b]))?;
    let rise = (0..peak).max_by(|a, b| slope[*a].total_cmp(&slope[*b]))?;
    let fall = (peak..n).min_by(|a, b| slope[*a].total_cmp(&slope[*b]))?;
    if slope[rise] <= 0.0 || slope[fall] >= 0.0 {
        return None;
    }
    let steps = |ms: f64| (ms / step_ms).round().max(1.0) as usize;
    let sharpest =
        |range: std::ops::Range<usize>| range.min_by(|a, b| bend[*a].total_cmp(&bend[*b]));
    let opening = sharpest(rise..(rise + steps(OPENING_MS)).min(peak.max(rise + 1)))?;
    let closure = sharpest(fall.saturating_sub(steps(CLOSURE_MS)).max(opening + 1)..fall)?;
    let level = smooth[0];
    let mitral = (fall..(fall + steps(RELAXATION_MS)).min(n)).find(|i| smooth[*i] <= level);
    let mitral = mitral.unwrap_or((fall + steps(0.5 * RELAXATION_MS)).min(n - 1));
    let ms = |i: usize| i as f64 * step_ms;
    Some(ValveEvents {
        aortic_opening_ms: ms(opening),
        aortic_closure_ms: ms(closure),
        mitral_opening_ms: ms(mitral),
        rise_ms: ms(rise),
        fall_ms: ms(fall),
    })
}
