//! Measured traces of the bundled cohort, and time points read off them.

use std::path::Path;

use cardiotwin_schemas::biomarkers::TimePoints;

/// Columns `time_ms` and value of a measured trace.
pub fn measured(file: &Path) -> Vec<(f64, f64)> {
    let text = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let number = |t: &str| {
        t.trim()
            .parse::<f64>()
            .expect("measured traces are numbers")
    };
    text.lines()
        .skip(1)
        .filter_map(|l| l.split_once(','))
        .map(|(t, v)| (number(t), number(v)))
        .collect()
}

/// Value at a time, interpolated linearly between samples.
pub fn at(points: &[(f64, f64)], t: f64) -> f64 {
    let i = points
        .partition_point(|p| p.0 < t)
        .clamp(1, points.len() - 1);
    let (a, b) = (points[i - 1], points[i]);
    (a.1 + (b.1 - a.1) * (t - a.0) / (b.0 - a.0)).clamp(a.1.min(b.1), a.1.max(b.1))
}

fn first_crossing(points: &[(f64, f64)], from: usize, test: impl Fn(f64) -> bool) -> Option<f64> {
    points[from..].iter().find(|p| test(p.1)).map(|p| p.0)
}

/// Index of the largest value, or of the smallest for a negative `sign`.
pub fn extreme(points: &[(f64, f64)], sign: f64) -> usize {
    (0..points.len())
        .max_by(|a, b| (sign * points[*a].1).total_cmp(&(sign * points[*b].1)))
        .expect("a trace has samples")
}

/// Time points of a measured beat.
pub fn time_points(p: &[(f64, f64)], v: &[(f64, f64)]) -> TimePoints {
    let (top, bottom) = (extreme(p, 1.0), extreme(p, -1.0));
    let level = p[bottom].1 + 0.1 * (p[top].1 - p[bottom].1);
    let low = extreme(v, -1.0);
    let (full, empty) = (v[..low].iter().map(|x| x.1).fold(0.0, f64::max), v[low].1);
    TimePoints {
        t1_ms: first_crossing(p, 0, |x| x > level),
        t2_ms: Some(p[top].0),
        t3_ms: first_crossing(p, top, |x| x < level),
        t4_ms: v[..low]
            .iter()
            .rev()
            .find(|x| x.1 >= full - 1e-9)
            .map(|x| x.0),
        t5_ms: Some(v[low].0),
        t6_ms: Some(v[low].0 + 20.0),
        t7_ms: first_crossing(v, low, |x| x > empty + 0.8 * (full - empty)),
    }
}
