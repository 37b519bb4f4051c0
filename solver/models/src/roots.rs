//! Bracketed scalar roots: Newton where it helps, bisection where it does not, so that no caller can run away.

/// Why a bracketed search gave no root.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RootError {
    /// The function has one sign at both ends.
    #[error("no sign change between {low} (value {f_low}) and {high} (value {f_high})")]
    NoBracket {
        /// Lower end of the search.
        low: f64,
        /// Upper end of the search.
        high: f64,
        /// Value at the lower end.
        f_low: f64,
        /// Value at the upper end.
        f_high: f64,
    },
    /// The function returned a value that is not finite.
    #[error("function value at {at} is not finite")]
    NotFinite {
        /// Argument of the bad value.
        at: f64,
    },
    /// The iteration limit was reached.
    #[error("no root within {iterations} iterations, bracket {low} to {high}")]
    Iterations {
        /// Number of iterations made.
        iterations: usize,
        /// Lower end of the last bracket.
        low: f64,
        /// Upper end of the last bracket.
        high: f64,
    },
}

/// Root of an increasing function in `[low, high]` by Newton steps inside a shrinking bracket.
///
/// - `guess`: start, any value (cut to the bracket); `x_tolerance`: absolute width at which the search ends
/// - `f`: returns value and derivative; a derivative of zero or of the wrong sign only costs a bisection
///
/// # Errors
/// [`RootError`] when the ends do not enclose a root, a value is not finite, or 200 iterations do not suffice.
pub fn increasing_root(
    low: f64,
    high: f64,
    guess: f64,
    x_tolerance: f64,
    mut f: impl FnMut(f64) -> (f64, f64),
) -> Result<f64, RootError> {
    const LIMIT: usize = 200;
    let (mut low, mut high) = (low, high);
    let (f_low, f_high) = (f(low).0, f(high).0);
    if f_low == 0.0 {
        return Ok(low);
    }
    if f_high == 0.0 {
        return Ok(high);
    }
    if !f_low.is_finite() {
        return Err(RootError::NotFinite { at: low });
    }
    if !f_high.is_finite() {
        return Err(RootError::NotFinite { at: high });
    }
    if f_low > 0.0 || f_high < 0.0 {
        return Err(RootError::NoBracket {
            low,
            high,
            f_low,
            f_high,
        });
    }
    let mut x = if guess > low && guess < high {
        guess
    } else {
        0.5 * (low + high)
    };
    let mut last_step = high - low;
    for _ in 0..LIMIT {
        let (value, slope) = f(x);
        if !value.is_finite() {
            return Err(RootError::NotFinite { at: x });
        }
        if value == 0.0 {
            return Ok(x);
        }
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        // A Newton step that leaves the bracket, or that does not halve the last one, means curvature or a kink
        // that Newton does not see.
        let newton = x - value / slope;
        let good = newton > low && newton < high && (newton - x).abs() < 0.5 * last_step;
        let next = if good { newton } else { 0.5 * (low + high) };
        last_step = (next - x).abs();
        if last_step <= x_tolerance || high - low <= x_tolerance {
            return Ok(next);
        }
        x = next;
    }
    Err(RootError::Iterations {
        iterations: LIMIT,
        low,
        high,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn finds_the_root_of_a_stiff_exponential() {
        let root = increasing_root(-10.0, 50.0, 49.0, 1e-13, |x| (x.exp() - 2.0, x.exp())).unwrap();
        assert!((root - 2f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn refuses_a_bracket_without_a_sign_change() {
        let error = increasing_root(1.0, 2.0, 1.5, 1e-12, |x| (x, 1.0)).unwrap_err();
        assert!(matches!(error, RootError::NoBracket { f_low, .. } if f_low == 1.0));
    }

    #[test]
    fn not_a_number_is_an_error() {
        let error = increasing_root(0.0, 1.0, 0.5, 1e-12, |x| {
            if x == 0.5 {
                (f64::NAN, 1.0)
            } else {
                (x - 0.3, 1.0)
            }
        });
        assert_eq!(error.unwrap_err(), RootError::NotFinite { at: 0.5 });
    }

    proptest! {
        #[test]
        fn wrong_derivatives_only_cost_time(root in -5.0..5.0f64, slope in prop_oneof![-3.0..0.0f64, 0.3..3.0f64]) {
            let found = increasing_root(-6.0, 6.0, 0.0, 1e-12, |x| (x - root, slope)).unwrap();
            prop_assert!((found - root).abs() < 1e-11);
        }
    }
}
