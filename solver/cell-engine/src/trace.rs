//! A beat as the nodes that the steps left, and its values on the 1 ms grid.

use crate::model::Slopes;
use cardiotwin_vector_math::{max, min};

/// One end of a step. Where the rate jumps, two nodes stand at the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Time within the beat \[ms\].
    pub t: f64,
    /// Active stress at this time \[kPa\].
    pub sa: f64,
    /// Rate of the active stress \[kPa/ms\].
    pub dsa: f64,
    /// Stretch at this time, relative to the slack length.
    pub l: f64,
    /// Rate of the stretch \[1/ms\].
    pub dl: f64,
}

impl Node {
    /// A node from stress, stretch and their rates.
    pub fn new(t: f64, l: f64, slopes: &Slopes) -> Self {
        Self {
            t,
            sa: slopes.sa,
            dsa: slopes.dsa,
            l,
            dl: slopes.dl,
        }
    }
}

/// Cubic a0 + x (a1 + x (a2 + x a3)), x in ms from the step's start: matches values and rates at both ends.
#[derive(Debug, Clone, Copy)]
pub struct Cubic {
    from: f64,
    a: [f64; 4],
}

impl Cubic {
    #[inline]
    fn new(from: f64, h: f64, y0: f64, d0: f64, y1: f64, d1: f64) -> Self {
        let inv = 1.0 / h;
        let slope = (y1 - y0) * inv;
        Self {
            from,
            a: [
                y0,
                d0,
                (3.0 * slope - 2.0 * d0 - d1) * inv,
                (d0 + d1 - 2.0 * slope) * inv * inv,
            ],
        }
    }

    /// Value at sample `k`.
    #[inline]
    pub fn at(&self, k: usize) -> f64 {
        let (x, a) = (k as f64 - self.from, &self.a);
        a[0] + x * (a[1] + x * (a[2] + x * a[3]))
    }
}

/// A step: its ends, the samples of the 1 ms grid in it, and bounds of its cubic Hermite interpolants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Node at the start of the step.
    pub from: Node,
    /// Node at the end of the step.
    pub to: Node,
    /// Index of the first sample in the step that no earlier segment holds.
    pub first: usize,
    /// Index after the last sample in the step.
    pub end: usize,
    /// Lower bound of the stress \[kPa\].
    pub sa_low: f64,
    /// Upper bound of the stress \[kPa\].
    pub sa_high: f64,
    /// Upper bound of the stress's rate \[kPa/ms\].
    pub rise_high: f64,
    /// Lower bound of the stretch.
    pub lambda_low: f64,
}

impl Segment {
    #[inline]
    fn new(a: &Node, b: &Node, first: usize, end: usize) -> Self {
        let third = (b.t - a.t) * (1.0 / 3.0);
        // Bézier's control points enclose a cubic, and those of its derivative the derivative.
        let (p1, p2) = (a.sa + third * a.dsa, b.sa - third * b.dsa);
        let (q1, q2) = (a.l + third * a.dl, b.l - third * b.dl);
        Self {
            from: *a,
            to: *b,
            first,
            end,
            sa_low: min(min(a.sa, b.sa), min(p1, p2)),
            sa_high: max(max(a.sa, b.sa), max(p1, p2)),
            rise_high: max(max(a.dsa, b.dsa), (p2 - p1) / third),
            lambda_low: min(min(a.l, b.l), min(q1, q2)),
        }
    }

    /// Interpolated stress over the step \[kPa\].
    #[inline]
    pub fn sa(&self) -> Cubic {
        let (a, b) = (&self.from, &self.to);
        Cubic::new(a.t, b.t - a.t, a.sa, a.dsa, b.sa, b.dsa)
    }

    /// Interpolated stretch over the step.
    #[inline]
    pub fn lambda(&self) -> Cubic {
        let (a, b) = (&self.from, &self.to);
        Cubic::new(a.t, b.t - a.t, a.l, a.dl, b.l, b.dl)
    }
}

/// A beat cut into segments that together hold each of its `n` samples once.
pub fn segments(nodes: &[Node], n: usize, segments: &mut Vec<Segment>) {
    segments.clear();
    let mut next = 0;
    for pair in nodes.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        if b.t > a.t {
            let end = (b.t as usize + 1).clamp(next, n);
            segments.push(Segment::new(a, b, next, end));
            next = end;
        }
    }
    // The last node may stand a rounding before the last sample.
    if let Some(last) = segments.last_mut() {
        last.end = n;
    }
}

/// Fills `sa` and `lambda` with the beat on the grid 0, 1, … ms.
pub fn sample(segments: &[Segment], sa: &mut [f64], lambda: &mut [f64]) {
    for segment in segments {
        let (stress, stretch) = (segment.sa(), segment.lambda());
        for k in segment.first..segment.end {
            sa[k] = stress.at(k);
            lambda[k] = stretch.at(k);
        }
    }
}
