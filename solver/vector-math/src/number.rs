//! Number types over which the equations of a model are written once: `f64`, `f32`, a lane of a
//! SIMD vector, and dual numbers.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::{exp, fma, ln_ratio, ln_ratios};

/// Operations that the equations of a model need.
pub trait Number:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The constant `x`, with a zero derivative for dual numbers.
    fn of(x: f64) -> Self;

    /// `self · a + b`, fused in lanes with `FMA`.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// Exponential eˣ.
    fn exp(self) -> Self;

    /// Exponential minus one, eˣ − 1, accurate for small numbers.
    fn exp_m1(self) -> Self;

    /// ln(self/other) of two positive numbers.
    fn ln_ratio(self, other: Self) -> Self;

    /// ln(self/other) and ln(c/d) of positive numbers, which lanes compute with one division for both.
    #[inline(always)]
    fn ln_ratios(self, other: Self, [c, d]: [Self; 2]) -> (Self, Self) {
        (self.ln_ratio(other), c.ln_ratio(d))
    }

    /// Absolute value, with the slope of its side for dual numbers.
    fn abs(self) -> Self;

    /// Whether `self < other`; `false` if either is not a number.
    fn is_below(self, other: Self) -> bool;

    /// The smaller of two numbers; the second one if either is not a number.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.is_below(other) { self } else { other }
    }

    /// The larger of two numbers; the second one if either is not a number.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other.is_below(self) { self } else { other }
    }
}

macro_rules! scalar {
    ($number:ident) => {
        impl Number for $number {
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $number
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $number::exp(self)
            }
            #[inline(always)]
            fn exp_m1(self) -> Self {
                $number::exp_m1(self)
            }
            #[inline(always)]
            fn ln_ratio(self, other: Self) -> Self {
                (self / other).ln()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $number::abs(self)
            }
            #[inline(always)]
            fn is_below(self, other: Self) -> bool {
                self < other
            }
        }
    };
}
scalar!(f64);
scalar!(f32);

/// A number whose functions have no calls and no branches, so that a loop over such numbers
/// compiles to vector code. `FMA` is as in [`exp`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(transparent)]
pub struct Lane<const FMA: bool>(pub f64);

/// A value and its derivative along one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<T = f64> {
    /// Value of the number.
    pub v: T,
    /// Derivative of the value along the direction.
    pub d: T,
}

macro_rules! lane_operator {
    ($trait:ident, $method:ident) => {
        impl<const FMA: bool> $trait for Lane<FMA> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    };
}
lane_operator!(Add, add);
lane_operator!(Sub, sub);
lane_operator!(Mul, mul);
lane_operator!(Div, div);

impl<const FMA: bool> Neg for Lane<FMA> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<const FMA: bool> Number for Lane<FMA> {
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self(x)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(fma::<FMA>(self.0, a.0, b.0))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Self(exp::<FMA>(self.0))
    }
    /// Accurate to the round-off of 1.
    #[inline(always)]
    fn exp_m1(self) -> Self {
        Self(exp::<FMA>(self.0) - 1.0)
    }
    #[inline(always)]
    fn ln_ratio(self, other: Self) -> Self {
        Self(ln_ratio::<FMA>(self.0, other.0))
    }
    #[inline(always)]
    fn ln_ratios(self, other: Self, [c, d]: [Self; 2]) -> (Self, Self) {
        let (first, second) = ln_ratios::<FMA>(self.0, other.0, c.0, d.0);
        (Self(first), Self(second))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(always)]
    fn is_below(self, other: Self) -> bool {
        self.0 < other.0
    }
}

impl<T: Number> Add for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self {
            v: self.v + o.v,
            d: self.d + o.d,
        }
    }
}

impl<T: Number> Sub for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self {
            v: self.v - o.v,
            d: self.d - o.d,
        }
    }
}

impl<T: Number> Mul for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self {
            v: self.v * o.v,
            d: self.d * o.v + self.v * o.d,
        }
    }
}

impl<T: Number> Div for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let v = self.v / o.v;
        Self {
            v,
            d: (self.d - v * o.d) / o.v,
        }
    }
}

impl<T: Number> Neg for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            v: -self.v,
            d: -self.d,
        }
    }
}

/// Comparisons compare the values. At a kink, the derivative is that of the branch that the
/// comparison selects.
impl<T: Number> Number for Dual<T> {
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self {
            v: T::of(x),
            d: T::of(0.0),
        }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let v = self.v.exp();
        Self { v, d: v * self.d }
    }
    #[inline(always)]
    fn exp_m1(self) -> Self {
        Self {
            v: self.v.exp_m1(),
            d: self.v.exp() * self.d,
        }
    }
    #[inline(always)]
    fn ln_ratio(self, other: Self) -> Self {
        Self {
            v: self.v.ln_ratio(other.v),
            d: self.d / self.v - other.d / other.v,
        }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        if self.v.is_below(T::of(0.0)) {
            -self
        } else {
            self
        }
    }
    #[inline(always)]
    fn is_below(self, other: Self) -> bool {
        self.v.is_below(other.v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Uses every operation of the trait once, without a kink between 0.5 and 3.
    fn expression<T: Number>(x: T) -> T {
        let two = T::of(2.0);
        let power = (x.ln_ratio(two) * T::of(1.7)).exp();
        let bent = (-x).abs().max(T::of(0.1)).min(T::of(9.0));
        let (log, inverse_log) = x.ln_ratios(two, [two, x]);
        (power - x / two).mul_add(bent, two + x.exp_m1() * x) + log - two * inverse_log
    }

    /// Scale of the round-off in [`expression`], whose terms are of the order of one and may cancel.
    /// Two of them are exponentials, each of which is accurate to 1e-14 in a lane.
    fn scale(exact: f64) -> f64 {
        exact.abs().max(1.0)
    }

    proptest! {
        #[test]
        fn all_numbers_compute_alike(x in 0.5..3.0f64) {
            let exact = expression(x);
            for lane in [expression(Lane::<true>(x)).0, expression(Lane::<false>(x)).0] {
                prop_assert!((lane - exact).abs() < 4e-14 * scale(exact), "{} {}", lane, exact);
            }
            let single = f64::from(expression(x as f32));
            prop_assert!((single - exact).abs() < 1e-6 * scale(exact), "{} {}", single, exact);
            prop_assert_eq!(expression(Dual { v: x, d: 1.0 }).v, exact);
        }

        #[test]
        fn the_dual_part_is_the_slope(x in 0.5..3.0f64) {
            let h = 1e-6;
            let slope = (expression(x + h) - expression(x - h)) / (2.0 * h);
            let dual = expression(Dual { v: x, d: 1.0 }).d;
            prop_assert!((dual - slope).abs() < 1e-8 * (1.0 + slope.abs()), "{} {}", dual, slope);
        }
    }

    #[test]
    fn a_number_that_is_none_loses_every_comparison() {
        let nan = f64::NAN;
        assert!(!Number::is_below(nan, 1.0) && !Number::is_below(1.0, nan));
        assert_eq!((Number::min(nan, 2.0), Number::max(nan, 2.0)), (2.0, 2.0));
    }
}
