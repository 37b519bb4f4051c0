//! Steps of a cell: second order, exponential in the gates, with a length that follows an estimate of the error.

use super::gates::gate;
use super::rates::{Cell, Rates};
use super::state::{GATES, HERG, LAND, N_SLOW, State};
use cardiotwin_vector_math::exp;

/// The paper's stimulus \[A/F\], from the beginning of a beat.
const STIMULUS: f64 = -53.0;
/// Length of the stimulus \[ms\].
const STIMULUS_MS: f64 = 1.0;
/// Interval at which a beat has samples \[ms\]; no step goes across one.
pub const SAMPLE_MS: f64 = 1.0;
/// Shortest step \[ms\]: where it does not meet the tolerance, it is accepted.
const SHORTEST_MS: f64 = 1e-4;
/// First step of a beat, at the stimulus \[ms\].
const FIRST_MS: f64 = 0.01;
/// Size of each state with a rate, below which its error is absolute: mV, mM, share.
const SCALE: [f64; N_SLOW] = [100.0, 10.0, 10.0, 100.0, 100.0, 2e-4, 2e-3, 1.0, 1.0, 0.1];

/// Exponential midpoint (Perego and Veneziani 2009): a half step with the rates at its beginning, and the whole step with
/// those of its middle. Gates follow the exponential, hERG its L-stable approximation, all others the midpoint rule.
///
/// Gives the state at the end, and the largest difference to the step of first order, relative to each state's size.
fn try_step(
    cell: &Cell,
    state: &State,
    at_begin: &Rates,
    stimulus: f64,
    h_ms: f64,
) -> (State, f64) {
    let (half, left_at_half) = advanced(state, at_begin, 0.5 * h_ms);
    let at_middle = cell.rates(&half, stimulus);
    let (end, _) = advanced(state, &at_middle, h_ms);
    let mut worst = 0.0_f64;
    let mut compare = |idx: usize, first_order: f64, size: f64| {
        let difference = (end.0[idx] - first_order).abs() / size;
        // A number that is not finite is the worst of all.
        worst = if difference <= worst {
            worst
        } else {
            difference
        };
    };
    for (idx, scale) in SCALE.iter().enumerate() {
        let x = state.0[idx];
        compare(idx, x + h_ms * at_begin.slow[idx], scale.max(x.abs()));
    }
    for (k, left) in left_at_half.iter().enumerate() {
        let (idx, target) = (GATES.start + k, at_begin.gates.target[k]);
        let x = state.0[idx];
        compare(idx, target + (x - target) * left * left, x.abs().max(1.0));
    }
    for k in 0..6 {
        let idx = LAND.start + k;
        compare(idx, state.0[idx] + h_ms * at_begin.land[k], 1.0);
    }
    (end, worst)
}

/// The state after a time with constant rates, targets and transition rates; and what is left of each gate's distance to its
/// target.
fn advanced(state: &State, rates: &Rates, h_ms: f64) -> (State, [f64; gate::N]) {
    let mut out = *state;
    for idx in 0..N_SLOW {
        out.0[idx] += h_ms * rates.slow[idx];
    }
    let mut left = [0.0; gate::N];
    for (left, per_ms) in left.iter_mut().zip(&rates.gates.per_ms) {
        *left = exp::<false>(-h_ms * per_ms);
    }
    let gates = out.0[GATES].iter_mut().zip(&rates.gates.target).zip(&left);
    for ((x, target), left) in gates {
        *x = target + (*x - target) * left;
    }
    out.0[HERG].copy_from_slice(&rates.herg.after(&state.herg(), h_ms));
    for k in 0..6 {
        out.0[LAND.start + k] += h_ms * rates.land[k];
    }
    (out, left)
}

/// One beat from `start`, with the state every [`SAMPLE_MS`] and at its end given to `sample`.
///
/// Returns the end; a state that is not finite ends the beat early, and is returned.
pub(super) fn beat(
    cell: &Cell,
    start: &State,
    cycle_ms: f64,
    tolerance: f64,
    mut sample: impl FnMut(f64, &State),
) -> State {
    let (mut state, mut time_ms, mut h_ms) = (*start, 0.0, FIRST_MS);
    sample(0.0, &state);
    let n_samples = (cycle_ms / SAMPLE_MS).ceil() as usize;
    for sample_idx in 1..=n_samples {
        let goal_ms = (sample_idx as f64 * SAMPLE_MS).min(cycle_ms);
        let stimulus = if goal_ms <= STIMULUS_MS {
            STIMULUS
        } else {
            0.0
        };
        let mut rates = cell.rates(&state, stimulus);
        while time_ms < goal_ms {
            let left_ms = goal_ms - time_ms;
            // Equal parts of what is left, so that no short step remains.
            let n_parts = (left_ms / h_ms).ceil().max(1.0);
            let step_ms = left_ms / n_parts;
            let (end, error) = try_step(cell, &state, &rates, stimulus, step_ms);
            let is_good = error <= tolerance;
            let change = if error.is_finite() {
                (0.9 * (tolerance / error.max(1e-12)).sqrt()).clamp(0.2, 2.0)
            } else {
                0.2
            };
            h_ms = (step_ms * change).max(SHORTEST_MS);
            if !is_good && step_ms > SHORTEST_MS {
                continue;
            }
            if end.0.iter().any(|x| !x.is_finite()) {
                return end;
            }
            state = end;
            time_ms = if n_parts == 1.0 {
                goal_ms
            } else {
                time_ms + step_ms
            };
            if time_ms < goal_ms {
                rates = cell.rates(&state, stimulus);
            }
        }
        sample(goal_ms, &state);
    }
    state
}
