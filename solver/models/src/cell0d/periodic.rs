//! Adaptive beats until the state returns.

use super::cell::to_state;
use super::equilibrium::{balance_stretch, resting_state};
use super::rodas::{Linearised, Step, linearise, try_step};
use super::system::{LAMBDA, N, System, Vector};
use super::{Cell0d, CellBeat, CellError, CellSolverSettings, CellState};

/// Absolute scale of each unknown's error, in the order of the unknowns: what the stress notices.
const ERROR_SCALE: Vector = [0.3, 1.0, 0.03, 0.03, 0.1, 0.1, 0.03, 0.02];
/// First step of a beat \[ms\]: calcium starts to rise there, whatever the last beat's end allowed.
const FIRST_STEP_MS: f64 = 1.0;
const LONGEST_STEP_MS: f64 = 100.0;
const SHORTEST_STEP_MS: f64 = 1e-8;

impl Cell0d {
    /// Runs beats until the state returns, and gives the last one. Verified by `every_reference_trajectory`.
    ///
    /// # Errors
    /// [`CellError`], with a finite story for every failure; never a panic or a NaN in the result.
    pub fn solve_periodic(&self, settings: &CellSolverSettings) -> Result<CellBeat, CellError> {
        let mut beat = CellBeat::default();
        self.solve_periodic_into(settings, &mut beat)?;
        Ok(beat)
    }

    /// As [`Self::solve_periodic`], into a beat whose buffers are used again: no allocation once they are large enough.
    ///
    /// # Errors
    /// As [`Self::solve_periodic`]; `beat` then holds nothing of use.
    pub fn solve_periodic_into(
        &self,
        settings: &CellSolverSettings,
        beat: &mut CellBeat,
    ) -> Result<(), CellError> {
        prepare_grid(self, beat);
        solve(self, settings, beat)
    }

    /// State at the start of the periodic beat, without its samples, for callers that need nothing
    /// else.
    ///
    /// # Errors
    /// As [`Self::solve_periodic`].
    pub fn periodic_start(&self, settings: &CellSolverSettings) -> Result<CellState, CellError> {
        let mut beat = CellBeat {
            time_ms: vec![0.0, self.cycle_length_ms],
            ..CellBeat::default()
        };
        solve(self, settings, &mut beat)?;
        Ok(beat.start_state)
    }
}

/// Runs beats as [`Cell0d::solve_periodic_into`] describes, with samples at the times of `beat`.
fn solve(
    cell: &Cell0d,
    settings: &CellSolverSettings,
    beat: &mut CellBeat,
) -> Result<(), CellError> {
    let system = cell.system();
    let mut start = resting_state(
        &system,
        cell.calcium().concentration_um(cell.cycle_length_ms),
    )?;
    let mut last_change: Option<Vector> = None;
    let mut largest = f64::INFINITY;
    let (mut may_extrapolate, mut promised) = (true, f64::INFINITY);
    for n_beats in 1..=settings.max_beats {
        // The first beats choose their steps; later ones repeat the last choice while it holds, so that the map from
        // beat to beat is smooth and its fixed point is not hidden by the noise of other steps.
        let repeated = if n_beats > 2 {
            run_beat(&system, settings, n_beats, &start, beat, true).ok()
        } else {
            None
        };
        let end = match repeated {
            Some(end) => end,
            None => run_beat(&system, settings, n_beats, &start, beat, false)?,
        };
        let change = difference(cell, &start, &end);
        largest = norm(&change);
        let ratio = last_change
            .map_or(0.0, |last| {
                norm(&change) / norm(&last).max(f64::MIN_POSITIVE)
            })
            .min(0.999);
        let remaining = largest / (1.0 - ratio);
        // One beat alone says nothing about how fast changes die out, unless there is no change at all.
        let proven = if last_change.is_some() {
            remaining
        } else {
            largest * 10.0
        };
        if proven <= settings.periodic_tolerance {
            beat.start_state = to_state(&cell.land, &start);
            beat.end_state = to_state(&cell.land, &end);
            beat.beats_to_periodic = n_beats;
            beat.remaining_change = proven;
            beat.n_steps = beat.steps_ms.len();
            return Ok(());
        }
        // An extrapolation must have paid for itself, or there are no more: it could lead round in a circle.
        may_extrapolate &= largest <= promised;
        let better = if may_extrapolate {
            extrapolate(&system, &end, &change, last_change.as_ref())
        } else {
            None
        };
        promised = if better.is_some() {
            0.5 * largest
        } else {
            f64::INFINITY
        };
        last_change = if better.is_some() { None } else { Some(change) };
        start = better.unwrap_or(end);
    }
    Err(CellError::NotPeriodic {
        beats: settings.max_beats,
        change: largest,
    })
}

/// Times and calcium of the samples; both are the same for every beat.
fn prepare_grid(cell: &Cell0d, beat: &mut CellBeat) {
    let length = cell.cycle_length_ms;
    let whole = length.floor() as usize;
    beat.time_ms.clear();
    beat.time_ms.extend((0..=whole).map(|t| t as f64));
    if length > whole as f64 {
        beat.time_ms.push(length);
    }
    beat.ca_um.clone_from(&beat.time_ms);
    cell.calcium().of_times(&mut beat.ca_um);
}

/// Change of the states over a beat, the distortions as ζ rather than z.
fn difference(cell: &Cell0d, start: &Vector, end: &Vector) -> Vector {
    let mut change: Vector = std::array::from_fn(|i| end[i] - start[i]);
    change[4] += cell.land.k.a * change[LAMBDA];
    change[5] += cell.land.k.a * change[LAMBDA];
    change
}

fn norm(change: &Vector) -> f64 {
    change.iter().fold(0.0, |largest, x| largest.max(x.abs()))
}

/// Limit of the geometric series of changes that shrink slowly and alike; `None` where waiting is
/// as good.
fn extrapolate(
    system: &System<'_>,
    end: &Vector,
    change: &Vector,
    last: Option<&Vector>,
) -> Option<Vector> {
    let last = last?;
    let product: f64 = change.iter().zip(last).map(|(a, b)| a * b).sum();
    let square: f64 = last.iter().map(|b| b * b).sum();
    let ratio = product / square;
    if !(0.15..0.98).contains(&ratio) {
        return None;
    }
    // Only a series that is geometric in every state may be summed.
    let spread: f64 = change
        .iter()
        .zip(last)
        .map(|(a, b)| (a - ratio * b).powi(2))
        .sum();
    if spread > 0.01 * ratio * ratio * square {
        return None;
    }
    let factor = ratio / (1.0 - ratio);
    let a = system.land.k.a;
    let mut better: Vector = std::array::from_fn(|i| {
        let own = change[i]
            - if i == 4 || i == 5 {
                a * change[LAMBDA]
            } else {
                0.0
            };
        end[i] + factor * own
    });
    let [trpn, b, w, s, ..] = better;
    let possible = [trpn, b, w, s, 1.0 - b - w - s]
        .iter()
        .all(|x| (0.0..=1.0).contains(x));
    (possible && balance_stretch(system, &mut better).is_ok()).then_some(better)
}

/// Error up to which a repeated step is accepted; the step control aims at 0.9⁴.
const REPEAT_ERROR: f64 = 2.0;

/// Runs one beat from `start`, records its samples and step lengths, and returns its end. With `repeat` the lengths are
/// those of the last beat, and the first that does not hold is an error.
fn run_beat(
    system: &System<'_>,
    settings: &CellSolverSettings,
    beat_number: usize,
    start: &Vector,
    beat: &mut CellBeat,
    repeat: bool,
) -> Result<Vector, CellError> {
    let n_samples = beat.time_ms.len();
    let length = beat.time_ms[n_samples - 1];
    beat.sa_kpa.clear();
    beat.lambda.clear();
    beat.sa_kpa.push(system.active_stress_kpa(start));
    beat.lambda.push(start[LAMBDA]);
    if !repeat {
        beat.steps_ms.clear();
    }
    let (mut t, mut y, mut h) = (0.0, *start, FIRST_STEP_MS.min(length));
    let (mut n_tried, mut n_accepted) = (0, 0);
    while t < length {
        let at = linearise(system, t, &y);
        let step = if repeat {
            h = beat.steps_ms[n_accepted];
            try_step(system, &at, t, &y, h)
                .filter(|step| scaled_error(step, settings.tolerance) <= REPEAT_ERROR)
                .ok_or(CellError::Stuck {
                    t_ms: t,
                    beat: beat_number,
                    n_steps: n_accepted,
                    step_ms: h,
                })?
        } else {
            let (step, next) =
                controlled_step(system, settings, &at, (t, length), &y, h, &mut n_tried).ok_or(
                    CellError::Stuck {
                        t_ms: t,
                        beat: beat_number,
                        n_steps: n_tried,
                        step_ms: h,
                    },
                )?;
            beat.steps_ms.push(step.h_ms);
            h = next;
            step
        };
        n_accepted += 1;
        let is_last = if repeat {
            n_accepted == beat.steps_ms.len()
        } else {
            step.t_ms + step.h_ms >= length
        };
        t = if is_last {
            length
        } else {
            step.t_ms + step.h_ms
        };
        y = step.end;
        record(system, &step, if is_last { f64::INFINITY } else { t }, beat);
    }
    Ok(y)
}

/// Shortens `h` until a step from `at` meets the tolerance; the step and the length to try next, or `None` where the
/// length falls to nothing or the steps run out.
fn controlled_step(
    system: &System<'_>,
    settings: &CellSolverSettings,
    at: &Linearised,
    (t, length): (f64, f64),
    y: &Vector,
    mut h: f64,
    n_tried: &mut usize,
) -> Option<(Step, f64)> {
    let mut rejected = false;
    loop {
        *n_tried += 1;
        // A sliver at the end of the beat would be a step of its own.
        if t + 1.01 * h >= length {
            h = length - t;
        }
        if *n_tried > settings.max_steps_per_beat || h < SHORTEST_STEP_MS {
            return None;
        }
        let step = try_step(system, at, t, y, h);
        let error = step
            .as_ref()
            .map_or(f64::INFINITY, |step| scaled_error(step, settings.tolerance));
        if error <= 1.0 {
            let growth = (0.9 * error.max(1e-8).powf(-0.25)).clamp(0.2, 4.0);
            let next = (h * if rejected { growth.min(1.0) } else { growth }).min(LONGEST_STEP_MS);
            return step.map(|step| (step, next));
        }
        rejected = true;
        h *= if error.is_finite() {
            (0.9 * error.powf(-0.25)).clamp(0.1, 0.8)
        } else {
            0.2
        };
    }
}

/// Largest error over the tolerance; infinite where the step is not finite.
fn scaled_error(step: &Step, tolerance: f64) -> f64 {
    let sum: f64 = step
        .error
        .iter()
        .zip(&ERROR_SCALE)
        .map(|(error, scale)| (error / (tolerance * scale)).powi(2))
        .sum();
    let error = (sum / N as f64).sqrt();
    if error.is_finite() && step.end.iter().all(|x| x.is_finite()) {
        error
    } else {
        f64::INFINITY
    }
}

/// Appends the samples up to `until`.
fn record(system: &System<'_>, step: &Step, until: f64, beat: &mut CellBeat) {
    while let Some(&time) = beat.time_ms.get(beat.sa_kpa.len())
        && time <= until
    {
        let y = step.at(time);
        beat.sa_kpa.push(system.active_stress_kpa(&y));
        beat.lambda.push(y[LAMBDA]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell0d::CellParameters;

    #[test]
    fn the_start_alone_is_that_of_the_whole_beat() {
        let cell = CellParameters {
            cycle_length_ms: 659.3,
            ..CellParameters::default()
        }
        .build()
        .unwrap();
        let settings = CellSolverSettings::default();
        let beat = cell.solve_periodic(&settings).unwrap();
        assert_eq!(cell.periodic_start(&settings).unwrap(), beat.start_state);
    }
}
