//! Aortic flow from the volume that the ventricle loses while its aortic valve is open and its
//! mitral valve closed.

use super::AfterloadError;

/// Share of the stroke volume by which the volume falls before ejection starts, and which is left
/// when it ends. Leaks of the valves and noise on the plateaus are therefore not taken for flow.
const PLATEAU: f64 = 0.002;

/// Flow out of the heart over one cycle, mL/s.
///
/// It is −dV/dt from the largest volume to the smallest after it, never negative, and zero
/// elsewhere. Its integral equals the fall of the volume.
///
/// - `volume_ml`: one periodic cycle, samples `step_ms` apart
///
/// # Errors
/// [`AfterloadError`] if there are fewer than 20 samples, one is not finite, or the volume does not
/// fall. Verified by `flow_is_what_the_volume_loses`.
pub fn ejected(volume_ml: &[f64], step_ms: f64) -> Result<Vec<f64>, AfterloadError> {
    let n = volume_ml.len();
    if n < 20 {
        return Err(AfterloadError::Samples {
            trace: "volume",
            n_times: n,
            n_values: n,
        });
    }
    if let Some(idx) = volume_ml.iter().position(|v| !v.is_finite()) {
        let time_ms = idx as f64 * step_ms;
        return Err(AfterloadError::Sample {
            trace: "volume",
            idx,
            time_ms,
            value: volume_ml[idx],
        });
    }
    let lowest = (0..n)
        .min_by(|a, b| volume_ml[*a].total_cmp(&volume_ml[*b]))
        .unwrap_or(0);
    let highest = (0..n)
        .max_by(|a, b| volume_ml[*a].total_cmp(&volume_ml[*b]))
        .unwrap_or(0);
    let (least, most) = (volume_ml[lowest], volume_ml[highest]);
    let stroke = most - least;
    if stroke <= 0.0 {
        return Err(AfterloadError::NoEjection {
            lowest_ml_per_s: 0.0,
            highest_ml_per_s: 0.0,
        });
    }
    // Walk back from the end of ejection to the last time that the volume is at its plateau.
    let length = (highest..highest + n)
        .position(|i| i % n == lowest)
        .unwrap_or(0);
    let at = |k: usize| volume_ml[(highest + k) % n];
    let begin = (0..length)
        .rev()
        .find(|k| at(*k) >= most - PLATEAU * stroke)
        .unwrap_or(0);
    let end = (begin..=length)
        .find(|k| at(*k) <= least + PLATEAU * stroke)
        .unwrap_or(length);
    let mut flow = vec![0.0; n];
    for k in begin..=end {
        let i = highest + k;
        flow[i % n] =
            ((volume_ml[(i + n - 1) % n] - volume_ml[(i + 1) % n]) / (2e-3 * step_ms)).max(0.0);
    }
    let out: f64 = flow.iter().sum::<f64>() * step_ms * 1e-3;
    flow.iter_mut().for_each(|q| *q *= stroke / out);
    Ok(flow)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn flow_is_what_the_volume_loses() {
        let volume: Vec<f64> = (0..800)
            .map(|t| {
                let t = f64::from(t);
                let out = ((t - 60.0) / 300.0).clamp(0.0, 1.0);
                let filled = ((t - 420.0) / 300.0).clamp(0.0, 1.0);
                140.0 - 80.0 * 0.5 * (1.0 - (PI * out).cos())
                    + 80.0 * 0.5 * (1.0 - (PI * filled).cos())
            })
            .collect();
        let flow = ejected(&volume, 1.0).unwrap();
        assert!((flow.iter().sum::<f64>() * 1e-3 - 80.0).abs() < 1e-9);
        assert!((flow[210] / (80.0 * 0.5 * PI / 0.3) - 1.0).abs() < 0.01);
        assert!(flow[500] == 0.0 && flow[10] == 0.0);
        // A cycle cut at another time has the same flow.
        let turned: Vec<f64> = (0..800).map(|i| volume[(i + 200) % 800]).collect();
        let turned = ejected(&turned, 1.0).unwrap();
        assert!((0..800).all(|i| (turned[i] - flow[(i + 200) % 800]).abs() < 1e-9));
        assert!(matches!(
            ejected(&[100.0; 50], 1.0),
            Err(AfterloadError::NoEjection { .. })
        ));
        assert!(matches!(
            ejected(&[100.0; 5], 1.0),
            Err(AfterloadError::Samples { .. })
        ));
    }
}
