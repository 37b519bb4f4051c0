//! Line search of Moré and Thuente 1994 (ACM Trans. Math. Softw. 20:286), as in MINPACK-2's
//! `dcsrch` and `dcstep`.

use serde::{Deserialize, Serialize};

/// Sufficient decrease, curvature and interval tolerances of L-BFGS-B, dimensionless.
const F_TOLERANCE: f64 = 1e-3;
const G_TOLERANCE: f64 = 0.9;
const X_TOLERANCE: f64 = 0.1;

/// A point on the line: step, value and slope.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Point {
    step: f64,
    value: f64,
    slope: f64,
}

/// Consequence of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// The step is good, or no better one can be found.
    Accept,
    /// The value and slope at [`LineSearch::step`] are needed next.
    Evaluate,
}

/// State of a search along a direction of descent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct LineSearch {
    step: f64,
    max_step: f64,
    initial: Point,
    best: Point,
    other: Point,
    bracketed: bool,
    second_stage: bool,
    width: f64,
    width_before: f64,
    interval: [f64; 2],
}

impl LineSearch {
    /// Starts from a value with a negative slope, with a first step within (0, `max_step`].
    pub(super) fn new(value: f64, slope: f64, step: f64, max_step: f64) -> Self {
        let initial = Point {
            step: 0.0,
            value,
            slope,
        };
        Self {
            step,
            max_step,
            initial,
            best: initial,
            other: initial,
            bracketed: false,
            second_stage: false,
            width: max_step,
            width_before: 2.0 * max_step,
            interval: [0.0, 5.0 * step],
        }
    }

    /// Length of the step whose value and slope are needed next.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Halves the step after a value that was not finite, and never goes that far again.
    pub(super) fn shrink(&mut self) {
        *self = Self::new(
            self.initial.value,
            self.initial.slope,
            0.5 * self.step,
            0.5 * self.step,
        );
    }

    /// Judges value and slope at [`Self::step`] and chooses the next step.
    pub(super) fn advance(&mut self, value: f64, slope: f64) -> Verdict {
        let (step, test_slope) = (self.step, F_TOLERANCE * self.initial.slope);
        let [low, high] = self.interval;
        let enough = self.initial.value + step * test_slope;
        if !self.second_stage && value <= enough && slope >= 0.0 {
            self.second_stage = true;
        }
        let rounding =
            self.bracketed && (step <= low || step >= high || high - low <= X_TOLERANCE * high);
        let at_limit = step == self.max_step && value <= enough && slope <= test_slope
            || step == 0.0 && (value > enough || slope >= test_slope);
        let converged = value <= enough && slope.abs() <= G_TOLERANCE * -self.initial.slope;
        if rounding || at_limit || converged {
            return Verdict::Accept;
        }
        let trial = Point { step, value, slope };
        if !self.second_stage && value <= self.best.value && value > enough {
            // In the first stage the search uses an auxiliary function with a better interval.
            let lower = |p: Point| Point {
                value: p.value - p.step * test_slope,
                slope: p.slope - test_slope,
                ..p
            };
            let raise = |p: Point| Point {
                value: p.value + p.step * test_slope,
                slope: p.slope + test_slope,
                ..p
            };
            (self.best, self.other) = (lower(self.best), lower(self.other));
            self.update(lower(trial));
            (self.best, self.other) = (raise(self.best), raise(self.other));
        } else {
            self.update(trial);
        }
        if self.bracketed {
            let distance = self.other.step - self.best.step;
            if distance.abs() >= 0.66 * self.width_before {
                self.step = self.best.step + 0.5 * distance;
            }
            self.width_before = self.width;
            self.width = distance.abs();
            self.interval = [
                self.best.step.min(self.other.step),
                self.best.step.max(self.other.step),
            ];
        } else {
            let ahead = self.step - self.best.step;
            self.interval = [self.step + 1.1 * ahead, self.step + 4.0 * ahead];
        }
        self.step = self.step.clamp(0.0, self.max_step);
        let [low, high] = self.interval;
        if self.bracketed
            && (self.step <= low || self.step >= high || high - low <= X_TOLERANCE * high)
        {
            self.step = self.best.step;
        }
        Verdict::Evaluate
    }

    /// Safeguarded cubic and quadratic steps (section 4 of the source, the four cases of `dcstep`).
    fn update(&mut self, p: Point) {
        let (x, y) = (self.best, self.other);
        let opposite =
            p.slope.signum() * x.slope.signum() < 0.0 && p.slope != 0.0 && x.slope != 0.0;
        let next = if p.value > x.value {
            self.bracketed = true;
            let cubic = x.step + ratio_above(x, p) * (p.step - x.step);
            let quadratic = x.step
                + x.slope / ((x.value - p.value) / (p.step - x.step) + x.slope) / 2.0
                    * (p.step - x.step);
            if (cubic - x.step).abs() <= (quadratic - x.step).abs() {
                cubic
            } else {
                cubic + (quadratic - cubic) / 2.0
            }
        } else if opposite {
            self.bracketed = true;
            let cubic = p.step + ratio_opposite(x, p) * (x.step - p.step);
            let secant = p.step + p.slope / (p.slope - x.slope) * (x.step - p.step);
            if (cubic - p.step).abs() > (secant - p.step).abs() {
                cubic
            } else {
                secant
            }
        } else if p.slope.abs() < x.slope.abs() {
            self.step_of_smaller_slope(p)
        } else if self.bracketed {
            p.step + ratio_opposite(y, p) * (y.step - p.step)
        } else if p.step > x.step {
            self.interval[1]
        } else {
            self.interval[0]
        };
        if p.value > x.value {
            self.other = p;
        } else {
            if opposite {
                self.other = x;
            }
            self.best = p;
        }
        // A cubic through values that rounding made equal has no extremum. The search then stays at
        // the best point, which ends it.
        self.step = if next.is_finite() {
            next
        } else {
            self.best.step
        };
    }

    /// Third case: the value is lower and the slope has the same sign and is smaller, so that the
    /// cubic may have no minimum ahead.
    fn step_of_smaller_slope(&self, p: Point) -> f64 {
        let x = self.best;
        let (theta, scale) = cubic_terms(x, p);
        let radicand = ((theta / scale).powi(2) - (x.slope / scale) * (p.slope / scale)).max(0.0);
        let gamma = scale * radicand.sqrt() * if p.step > x.step { -1.0 } else { 1.0 };
        let r = ((gamma - p.slope) + theta) / ((gamma + (x.slope - p.slope)) + gamma);
        let cubic = if r < 0.0 && gamma != 0.0 {
            p.step + r * (x.step - p.step)
        } else if p.step > x.step {
            self.interval[1]
        } else {
            self.interval[0]
        };
        let secant = p.step + p.slope / (p.slope - x.slope) * (x.step - p.step);
        let cubic_is_nearer = (cubic - p.step).abs() < (secant - p.step).abs();
        if self.bracketed {
            let nearer = if cubic_is_nearer { cubic } else { secant };
            let limit = p.step + 0.66 * (self.other.step - p.step);
            if p.step > x.step {
                nearer.min(limit)
            } else {
                nearer.max(limit)
            }
        } else {
            let farther = if (cubic - p.step).abs() > (secant - p.step).abs() {
                cubic
            } else {
                secant
            };
            farther.max(self.interval[0]).min(self.interval[1])
        }
    }
}

fn cubic_terms(x: Point, p: Point) -> (f64, f64) {
    let theta = 3.0 * (x.value - p.value) / (p.step - x.step) + x.slope + p.slope;
    (theta, theta.abs().max(x.slope.abs()).max(p.slope.abs()))
}

/// First case: position of the cubic's minimum between `x` and `p`, as a fraction from `x`.
fn ratio_above(x: Point, p: Point) -> f64 {
    let (theta, scale) = cubic_terms(x, p);
    let gamma = scale
        * ((theta / scale).powi(2) - (x.slope / scale) * (p.slope / scale))
            .max(0.0)
            .sqrt();
    let gamma = if p.step < x.step { -gamma } else { gamma };
    ((gamma - x.slope) + theta) / (((gamma - x.slope) + gamma) + p.slope)
}

/// Second and fourth case: position of the cubic's minimum, as a fraction from `p` to `x`.
fn ratio_opposite(x: Point, p: Point) -> f64 {
    let (theta, scale) = cubic_terms(x, p);
    let gamma = scale
        * ((theta / scale).powi(2) - (x.slope / scale) * (p.slope / scale))
            .max(0.0)
            .sqrt();
    let gamma = if p.step > x.step { -gamma } else { gamma };
    ((gamma - p.slope) + theta) / (((gamma - p.slope) + gamma) + x.slope)
}
