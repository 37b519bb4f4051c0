//! End of systole: the time at which the ventricle is stiffest.

use super::beat::Beat;

/// Steps of an iteration for the intercept at most. It ends sooner, when end-systolic samples no longer change.
const MOST_STEPS: usize = 100;
/// Change of the intercept over the stroke volume that counts as none where samples alternate.
const SETTLED: f64 = 1e-3;

/// End-systolic point of a beat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndSystole {
    /// Time \[ms\].
    pub time_ms: f64,
    /// Ventricular pressure Pes \[mmHg\].
    pub pressure_mmhg: f64,
    /// Volume Ves \[mL\].
    pub volume_ml: f64,
}

/// Reasons why a volume intercept cannot be used or found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum InterceptError {
    /// The intercept is not below all volumes of the beat.
    #[error(
        "the volume intercept of {intercept_ml} mL is not below the smallest volume of {smallest_ml} mL"
    )]
    NotBelowVolume {
        /// Intercept V0 \[mL\].
        intercept_ml: f64,
        /// Smallest volume of the beat \[mL\].
        smallest_ml: f64,
    },
    /// The intercept still changes after all steps.
    #[error("the volume intercept still changes by {change_ml} mL after {n_steps} steps")]
    NotSettled {
        /// Last change \[mL\].
        change_ml: f64,
        /// Steps taken.
        n_steps: usize,
    },
}

/// End-systolic point of a beat: the sample with the largest P/(V − V0).
///
/// - `intercept_ml`: volume V0 at which end-systolic pressure is zero \[mL\]
///
/// Source: Suga and Sagawa 1974, Circ Res 35:117, E(t) = P(t)/(V(t) − V0), not read; end systole is at its maximum.
///
/// # Errors
/// [`InterceptError::NotBelowVolume`] when a volume of the beat does not exceed V0.
pub fn end_systole(beat: &Beat, intercept_ml: f64) -> Result<EndSystole, InterceptError> {
    if intercept_ml >= beat.smallest_volume_ml() || !intercept_ml.is_finite() {
        return Err(InterceptError::NotBelowVolume {
            intercept_ml,
            smallest_ml: beat.smallest_volume_ml(),
        });
    }
    let (p, v) = (beat.pressure(), beat.volume());
    let elastance = |i: isize| p.value(i) / (v.value(i) - intercept_ml);
    let stiffest = (1..p.len() as isize).fold(0, |best, i| {
        if elastance(i) > elastance(best) {
            i
        } else {
            best
        }
    });
    Ok(EndSystole {
        time_ms: p.time(stiffest),
        pressure_mmhg: p.value(stiffest),
        volume_ml: v.value(stiffest),
    })
}

/// End-systolic points of beats and the intercept that goes with them.
///
/// `intercept_of` gives V0 for end-systolic points, by a line through them or by another relation. The points
/// follow from V0 again, until neither changes. The first V0 lies half a stroke volume below the smallest volume, so
/// that a shift of all volumes shifts each step alike.
///
/// The iteration is the usual one for beats of a conductance catheter, which has the names of Kono and Sagawa; no
/// publication of it was read.
pub(super) fn settle<T, E: From<InterceptError>>(
    beats: &[&Beat],
    mut intercept_of: impl FnMut(&[EndSystole]) -> Result<(f64, T), E>,
) -> Result<(Vec<EndSystole>, f64, T), E> {
    let n = beats.len() as f64;
    let smallest = beats
        .iter()
        .map(|beat| beat.smallest_volume_ml())
        .fold(f64::INFINITY, f64::min);
    let stroke_ml = beats
        .iter()
        .map(|beat| beat.stroke_volume_ml())
        .sum::<f64>()
        / n;
    let points_at = |intercept_ml: f64| {
        let points = beats.iter().map(|beat| end_systole(beat, intercept_ml));
        points.collect::<Result<Vec<_>, _>>()
    };
    let mut points = points_at(smallest - 0.5 * stroke_ml)?;
    let (mut intercept_ml, mut value) = intercept_of(&points)?;
    let mut change_ml = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let next = points_at(intercept_ml)?;
        if next == points {
            return Ok((points, intercept_ml, value));
        }
        points = next;
        let (next_ml, next_value) = intercept_of(&points)?;
        change_ml = (next_ml - intercept_ml).abs();
        (intercept_ml, value) = (next_ml, next_value);
    }
    if change_ml <= SETTLED * stroke_ml {
        return Ok((points, intercept_ml, value));
    }
    Err(InterceptError::NotSettled {
        change_ml,
        n_steps: MOST_STEPS,
    }
    .into())
}

#[cfg(test)]
mod tests {
    use super::super::model_heart::Heart;
    use super::*;

    #[test]
    fn the_stiffest_time_of_a_model_heart_is_its_own() {
        let heart = Heart::default();
        let point = end_systole(&heart.beat(), heart.intercept_ml).unwrap();
        let found = point.pressure_mmhg / (point.volume_ml - heart.intercept_ml);
        assert!(
            (found / heart.elastance_mmhg_per_ml - 1.0).abs() < 1e-3,
            "{found}"
        );
        assert!(
            (point.time_ms - heart.stiffest_ms()).abs() < 2.0,
            "{point:?}"
        );
    }

    #[test]
    fn an_intercept_inside_the_loop_is_refused() {
        let beat = Heart::default().beat();
        let smallest = beat.smallest_volume_ml();
        assert_eq!(
            end_systole(&beat, smallest),
            Err(InterceptError::NotBelowVolume {
                intercept_ml: smallest,
                smallest_ml: smallest
            })
        );
    }
}
