//! Times of valve motion, from the pressure of the mean beat.
//!
//! When the aortic valve opens, the pressure stops rising freely; when it closes, the pressure
//! begins to fall freely. The slope has a corner at both times. They are the points with the most
//! negative second derivative after the steepest rise and before the steepest fall.
//!
//! A pressure of the aorta from the same beats shows both times more sharply, because a slow line to
//! the ventricle rounds its corners. The valve opens when the ventricle's pressure rises through
//! the aorta's at its foot, and closes at the notch. The time by which the ventricle's pressure lags
//! behind the aorta's at the opening also applies at the closure.

use crate::filter::{periodic_slope, periodic_smooth};

/// Half width of the smoothing before slopes are computed \[ms\].
const SMOOTH_MS: f64 = 3.0;
/// Largest time from the steepest rise to the opening of the aortic valve \[ms\].
const OPENING_MS: f64 = 60.0;
/// Largest time from the closure of the aortic valve to the steepest fall \[ms\].
const CLOSURE_MS: f64 = 70.0;
/// Largest duration of isovolumic relaxation \[ms\].
const RELAXATION_MS: f64 = 220.0;

/// Largest time between an event from the ventricle alone and the same event with the aorta \[ms\].
const AGREE_MS: f64 = 45.0;
/// Time from the crossing of the pressures to the beginning of the flow, whose inertia the crossing
/// must first overcome, and time from the end of the flow to the notch in a smoothed pressure
/// \[ms\]. Both are means over 120 synthetic hearts (seeds 1000 to 1119 of `tests/made`), which no
/// reported figure uses.
const AFTER_CROSSING_MS: f64 = 2.5;
const NOTCH_AFTER_END_MS: f64 = 5.5;

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
    /// Whether the aorta's pressure determined opening and closure.
    pub with_aorta: bool,
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
        with_aorta: false,
    })
}

/// Events of a beat with the pressures of the ventricle and the aorta, on the ventricle's clock. If
/// the aorta's pressure has no foot or notch near the ventricle's events, these stay.
/// - `lv_mmhg`, `aorta_mmhg`: pressures of the same periodic cycle, with samples every `step_ms`
#[must_use]
pub fn with_aorta(
    events: ValveEvents,
    lv_mmhg: &[f64],
    aorta_mmhg: &[f64],
    step_ms: f64,
) -> ValveEvents {
    refined(events, lv_mmhg, aorta_mmhg, step_ms).unwrap_or(events)
}

fn refined(
    events: ValveEvents,
    lv_mmhg: &[f64],
    aorta_mmhg: &[f64],
    step_ms: f64,
) -> Option<ValveEvents> {
    let n = aorta_mmhg.len().min(lv_mmhg.len());
    let index = |ms: f64| ((ms / step_ms).round().max(0.0) as usize).min(n.saturating_sub(1));
    let aorta = periodic_smooth(aorta_mmhg, (SMOOTH_MS / step_ms) as usize);
    let slope = periodic_smooth(&periodic_slope(&aorta, step_ms), (2.0 / step_ms) as usize);
    let bend = periodic_smooth(&periodic_slope(&slope, step_ms), (2.0 / step_ms) as usize);
    let most = |values: &[f64], range: std::ops::Range<usize>| {
        range.max_by(|a, b| values[*a].total_cmp(&values[*b]))
    };
    let (open, close) = (events.aortic_opening_ms, events.aortic_closure_ms);
    let upstroke = most(&slope, index(open - 40.0)..index(open + 90.0))?;
    let foot = most(&bend, upstroke.saturating_sub(index(60.0))..upstroke)?;
    let notch = most(&bend, index(close - 50.0)..index(close + 60.0))?;
    let level = aorta[foot];
    let from = foot.saturating_sub(index(60.0));
    let above = (from.max(1)..n).find(|i| lv_mmhg[*i] >= level)?;
    let (a, b) = (lv_mmhg[above - 1], lv_mmhg[above]);
    let share = if b > a {
        ((level - a) / (b - a)).clamp(0.0, 1.0)
    } else {
        1.0
    };
    let opening = ((above - 1) as f64 + share) * step_ms + AFTER_CROSSING_MS;
    let behind = opening - foot as f64 * step_ms;
    let closure = notch as f64 * step_ms + behind - NOTCH_AFTER_END_MS;
    let near = (opening - open).abs() <= AGREE_MS && (closure - close).abs() <= AGREE_MS;
    (near && closure > opening + 60.0).then_some(ValveEvents {
        aortic_opening_ms: opening,
        aortic_closure_ms: closure,
        mitral_opening_ms: events.mitral_opening_ms.max(closure),
        with_aorta: true,
        ..events
    })
}
