//! Smoothing and differences of uniformly sampled traces. A missing sample (NaN) leaves a gap but
//! never spreads.

/// Mean over the available ones of `2 half + 1` samples around each sample; NaN if none is
/// available.
pub(crate) fn moving_average(values: &[f64], half: usize) -> Vec<f64> {
    let n = values.len();
    let (mut sum, mut count) = (0.0, 0_usize);
    let (mut enter, mut leave) = (0, 0);
    let mut out = Vec::with_capacity(n);
    for i in 0..n {
        while enter < n && enter <= i + half {
            if values[enter].is_finite() {
                sum += values[enter];
                count += 1;
            }
            enter += 1;
        }
        while leave + half < i {
            if values[leave].is_finite() {
                sum -= values[leave];
                count -= 1;
            }
            leave += 1;
        }
        out.push(if count > 0 {
            sum / count as f64
        } else {
            f64::NAN
        });
    }
    out
}

/// Two passes of the moving average, equivalent to a triangular kernel with small side lobes.
pub(crate) fn smooth(values: &[f64], half: usize) -> Vec<f64> {
    if half == 0 {
        return values.to_vec();
    }
    moving_average(&moving_average(values, half), half)
}

/// Central differences per ms; zero if a neighbour is missing.
pub(crate) fn slope(values: &[f64], step_ms: f64) -> Vec<f64> {
    let n = values.len();
    let mut out = vec![0.0; n];
    for i in 1..n.saturating_sub(1) {
        let difference = (values[i + 1] - values[i - 1]) / (2.0 * step_ms);
        out[i] = if difference.is_finite() {
            difference
        } else {
            0.0
        };
    }
    out
}

/// Two passes of the moving average over a periodic trace.
pub(crate) fn periodic_smooth(values: &[f64], half: usize) -> Vec<f64> {
    let n = values.len();
    if half == 0 || n <= 2 * half {
        return values.to_vec();
    }
    let pass = |v: &[f64]| -> Vec<f64> {
        let width = (2 * half + 1) as f64;
        let mut sum: f64 = (0..=2 * half).map(|k| v[(k + n - half) % n]).sum();
        (0..n)
            .map(|i| {
                let mean = sum / width;
                sum += v[(i + half + 1) % n] - v[(i + n - half) % n];
                mean
            })
            .collect()
    };
    pass(&pass(values))
}

/// Central differences per ms of a periodic trace.
pub(crate) fn periodic_slope(values: &[f64], step_ms: f64) -> Vec<f64> {
    let n = values.len();
    (0..n)
        .map(|i| (values[(i + 1) % n] - values[(i + n - 1) % n]) / (2.0 * step_ms))
        .collect()
}

/// Typical height of peaks along a trace: the maximum in each window of `window` samples, followed
/// by a running median over 21 windows, so that neither artefacts nor quiet stretches determine a
/// threshold. Windows in which `measured` mostly lacks samples, or stands still, do not count: a
/// pause of any length leaves the heights on both sides as they are.
pub(crate) fn usual_peaks(values: &[f64], measured: &[f64], window: usize) -> Vec<f64> {
    let window = window.max(1);
    let largest: Vec<f64> = values
        .chunks(window)
        .zip(measured.chunks(window))
        .map(|(chunk, measured)| {
            if !is_measured(measured) {
                return f64::NAN;
            }
            chunk
                .iter()
                .copied()
                .filter(|v| v.is_finite())
                .fold(0.0, f64::max)
        })
        .collect();
    let sound: Vec<(usize, f64)> = largest
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, height)| height.is_finite())
        .collect();
    (0..largest.len())
        .map(|i| {
            let next = sound.partition_point(|(k, _)| *k < i);
            let near = &sound[next.saturating_sub(10)..(next + 11).min(sound.len())];
            let height = median(near.iter().map(|(_, height)| *height));
            if height.is_finite() { height } else { 0.0 }
        })
        .collect()
}

/// Whether at least half of the samples are there and not all of them are the same.
fn is_measured(samples: &[f64]) -> bool {
    let mut finite = samples.iter().copied().filter(|v| v.is_finite());
    let Some(first) = finite.next() else {
        return false;
    };
    let (mut n, mut moves) = (1_usize, false);
    for value in finite {
        n += 1;
        moves |= value != first;
    }
    moves && 2 * n >= samples.len()
}

/// Offset of the extremum of a parabola through three neighbouring samples, in samples, from −0.5
/// to 0.5.
pub(crate) fn vertex(before: f64, here: f64, after: f64) -> f64 {
    let curvature = before - 2.0 * here + after;
    let offset = 0.5 * (before - after) / curvature;
    if offset.is_finite() {
        offset.clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// Median of the finite values; NaN if there are none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    if sorted.is_empty() {
        return f64::NAN;
    }
    let middle = sorted.len() / 2;
    let upper = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
    if sorted.len() % 2 == 1 {
        return upper;
    }
    let lower = sorted[..middle]
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    0.5 * (lower + upper)
}

/// Median, and the standard deviation of a normal distribution with the same median absolute
/// deviation.
pub(crate) fn centre_and_spread(values: &[f64]) -> (f64, f64) {
    let centre = median(values.iter().copied());
    (
        centre,
        1.4826 * median(values.iter().map(|v| (v - centre).abs())),
    )
}

/// Solves a small system by elimination, with the right-hand side in the last column; `None` if it
/// is singular.
pub(crate) fn solve(mut rows: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = rows.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))?;
        rows.swap(k, pivot);
        if rows[k][k].abs() < 1e-12 {
            return None;
        }
        let (done, rest) = rows.split_at_mut(k + 1);
        for row in rest {
            let factor = row[k] / done[k][k];
            for (a, b) in row[k..].iter_mut().zip(&done[k][k..]) {
                *a -= factor * b;
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| rows[k][j] * x[j]).sum();
        x[k] = (rows[k][n] - known) / rows[k][k];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_stays_a_gap() {
        let v = [1.0, 1.0, f64::NAN, f64::NAN, f64::NAN, 4.0, 4.0];
        let m = moving_average(&v, 1);
        assert_eq!((m[0], m[1], m[2], m[4], m[6]), (1.0, 1.0, 1.0, 4.0, 4.0));
        assert!(m[3].is_nan());
        assert_eq!(slope(&v, 1.0)[2], 0.0);
    }

    #[test]
    fn a_line_has_its_slope_and_a_parabola_its_vertex() {
        let line: Vec<f64> = (0..50).map(|i| 3.0 * f64::from(i)).collect();
        assert!((slope(&smooth(&line, 4), 2.0)[25] - 1.5).abs() < 1e-12);
        let parabola = |x: f64| 5.0 - (x - 0.3).powi(2);
        assert!((vertex(parabola(-1.0), parabola(0.0), parabola(1.0)) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn periodic_means_wrap() {
        let v: Vec<f64> = (0..40)
            .map(|i| (f64::from(i) * std::f64::consts::TAU / 40.0).sin())
            .collect();
        let m = periodic_smooth(&v, 2);
        let direct = |i: usize| (0..5).map(|k| v[(i + 40 + k - 2) % 40]).sum::<f64>() / 5.0;
        let twice = (0..5).map(|k| direct((40 + k - 2) % 40)).sum::<f64>() / 5.0;
        assert!((m[0] - twice).abs() < 1e-12);
    }

    #[test]
    fn small_systems_are_solved_and_singular_ones_are_not() {
        let x = solve(vec![vec![0.0, 2.0, 4.0], vec![3.0, 1.0, 5.0]]).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-12 && (x[1] - 2.0).abs() < 1e-12);
        assert_eq!(solve(vec![vec![1.0, 2.0, 4.0], vec![2.0, 4.0, 5.0]]), None);
    }

    #[test]
    fn medians_and_spreads() {
        assert_eq!(median([3.0, f64::NAN, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0].into_iter()), 2.5);
        assert!(median(std::iter::empty()).is_nan());
        let (centre, spread) = centre_and_spread(&[1.0, 2.0, 3.0, 4.0, 100.0]);
        assert!((centre - 3.0).abs() < 1e-12 && (spread - 1.4826).abs() < 1e-12);
    }
}
