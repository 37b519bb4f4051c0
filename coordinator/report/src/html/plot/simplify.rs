//! Simplification of lines (Douglas and Peucker 1973).

/// Keeps the points without which the line would move by more than `tolerance`. The first and the
/// last point are always kept.
#[must_use]
pub fn simplify(points: &[(f64, f64)], tolerance: f64) -> Vec<(f64, f64)> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut keep = vec![false; points.len()];
    keep[0] = true;
    keep[points.len() - 1] = true;
    // An explicit stack, because a noisy trace of 100,000 samples could exhaust the call stack.
    let mut open = vec![(0, points.len() - 1)];
    while let Some((from, to)) = open.pop() {
        let farthest = (from + 1..to)
            .map(|i| (i, distance(points[i], points[from], points[to])))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((middle, d)) = farthest
            && d > tolerance
        {
            keep[middle] = true;
            open.push((from, middle));
            open.push((middle, to));
        }
    }
    std::iter::zip(points, keep)
        .filter(|(_, keep)| *keep)
        .map(|(p, _)| *p)
        .collect()
}

/// Distance of `p` to the segment from `a` to `b`. A line through them would be undefined where a
/// loop's ends coincide.
fn distance(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length2 = dx * dx + dy * dy;
    let t = if length2 > 0.0 {
        (((p.0 - a.0) * dx + (p.1 - a.1) * dy) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p.0 - a.0 - t * dx).hypot(p.1 - a.1 - t * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_needs_two_points_and_a_corner_three() {
        let line: Vec<_> = (0..100)
            .map(|i| (f64::from(i), 2.0 * f64::from(i)))
            .collect();
        assert_eq!(simplify(&line, 0.1).len(), 2);
        let corner: Vec<_> = (0..100)
            .map(|i| (f64::from(i), f64::from((i - 50_i32).abs())))
            .collect();
        assert_eq!(simplify(&corner, 0.1), [corner[0], corner[50], corner[99]]);
    }

    #[test]
    fn no_dropped_point_is_farther_than_the_tolerance() {
        let curve: Vec<_> = (0..500)
            .map(|i| (f64::from(i), 40.0 * (f64::from(i) / 40.0).sin()))
            .collect();
        let kept = simplify(&curve, 0.15);
        assert!(kept.len() < 150, "{}", kept.len());
        for p in &curve {
            let nearest = kept
                .windows(2)
                .map(|w| distance(*p, w[0], w[1]))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest <= 0.15 + 1e-9);
        }
    }

    #[test]
    fn a_closed_loop_does_not_collapse() {
        let circle: Vec<_> = (0..=60)
            .map(|i| (f64::from(i) * std::f64::consts::TAU / 60.0).sin_cos())
            .collect();
        assert!(simplify(&circle, 0.05).len() > 8);
    }
}
