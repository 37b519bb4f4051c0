//! Numbers that a kernel can be written over once: `f64`, a dual number for exact derivatives in tests, and a SIMD vector
//! whose instruction set is chosen at run time.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// Operations of a number that a material or element kernel needs.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The constant `x`, as the same kind of number as `self`.
    fn like(self, x: f64) -> Self;
    /// `self · a + b`, fused where the instruction set has it.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root of each entry.
    fn sqrt(self) -> Self;
    /// Exponential; arguments above [`LARGEST_EXPONENT`] give its value there, so that no infinity arises.
    fn exp(self) -> Self;
    /// Natural logarithm of each entry.
    fn ln(self) -> Self;
    /// The larger of each pair.
    fn max(self, other: Self) -> Self;

    /// Product with a constant.
    #[inline(always)]
    fn times(self, x: f64) -> Self {
        self * self.like(x)
    }
}

/// Exponents are cut here: e^500 is far outside every material and still squares to a finite number.
pub const LARGEST_EXPONENT: f64 = 350.0;

impl Real for f64 {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        f64::exp(self.min(LARGEST_EXPONENT))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        f64::ln(self)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        f64::max(self, other)
    }
}

/// Exponential and logarithm without calls or branches, so that loops over lanes become vector instructions.
mod elementary {
    use super::LARGEST_EXPONENT;

    /// 1.5 · 2⁵²: a sum with it is rounded to an integer, which its lowest bits hold.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// ln 2 in two parts; products of the first with integers of eleven bits are exact.
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;

    /// `eˣ` to 2 units in the last place, arguments cut to −700 and [`LARGEST_EXPONENT`].
    #[inline(always)]
    pub fn exp(x: f64) -> f64 {
        let x = if x < LARGEST_EXPONENT {
            x
        } else {
            LARGEST_EXPONENT
        };
        let x = if x > -700.0 { x } else { -700.0 };
        let rounded = x * std::f64::consts::LOG2_E + ROUND;
        let k = rounded - ROUND;
        let r = (x - k * LN2_HIGH) - k * LN2_LOW;
        // Taylor's series: |r| ≤ ln 2 / 2, the first term left out is below 5e-18.
        let mut p = 1.0 / 6_227_020_800.0;
        p = p * r + 1.0 / 479_001_600.0;
        p = p * r + 1.0 / 39_916_800.0;
        p = p * r + 1.0 / 3_628_800.0;
        p = p * r + 1.0 / 362_880.0;
        p = p * r + 1.0 / 40_320.0;
        p = p * r + 1.0 / 5_040.0;
        p = p * r + 1.0 / 720.0;
        p = p * r + 1.0 / 120.0;
        p = p * r + 1.0 / 24.0;
        p = p * r + 1.0 / 6.0;
        p = p * r + 0.5;
        let power = f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
        power * (1.0 + (r + r * r * p))
    }

    /// `ln x` to 1 unit in the last place; NaN for what is not positive.
    ///
    /// Source of the polynomial: FreeBSD's `e_log.c` (fdlibm, Sun Microsystems 1993).
    #[inline(always)]
    pub fn ln(x: f64) -> f64 {
        const ROOT_HALF: u64 = 0x3FE6_A09E_667F_3BCD;
        const ONE: u64 = 0x3FF0_0000_0000_0000;
        let bits = x.to_bits();
        // Exponent with bias, of x = 2ᵏ m with m from √½ to √2.
        let biased = bits.wrapping_add(ONE - ROOT_HALF) >> 52;
        let m = f64::from_bits(bits.wrapping_sub(biased.wrapping_sub(1023) << 52));
        let k = f64::from_bits(biased | 0x4330_0000_0000_0000) - 4_503_599_627_370_496.0 - 1023.0;
        let f = m - 1.0;
        let s = f / (2.0 + f);
        let z = s * s;
        let mut r = 1.479_819_860_511_658_6e-1;
        r = r * z + 1.531_383_769_920_937_3e-1;
        r = r * z + 1.818_357_216_161_805e-1;
        r = r * z + 2.222_219_843_214_978_4e-1;
        r = r * z + 2.857_142_874_366_239e-1;
        r = r * z + 3.999_999_999_940_942e-1;
        r = r * z + 6.666_666_666_666_735e-1;
        let r = r * z;
        let half = 0.5 * f * f;
        let ln = k * LN2_HIGH - ((half - (s * (half + r) + k * LN2_LOW)) - f);
        if x > 0.0 && x < f64::MAX {
            ln
        } else {
            f64::NAN
        }
    }

    #[cfg(test)]
    mod tests {
        use proptest::prelude::*;

        proptest! {
            #[test]
            fn exponential_is_that_of_the_standard_library(x in -690.0..349.0_f64) {
                prop_assert!((super::exp(x) / x.exp() - 1.0).abs() < 1e-15);
            }

            #[test]
            fn logarithm_is_that_of_the_standard_library(x in 1e-8..1e3_f64) {
                prop_assert!((super::ln(x) - x.ln()).abs() < 3e-16 * x.ln().abs().max(1e-3));
            }
        }

        #[test]
        fn ends_of_the_range() {
            assert_eq!(super::exp(1e6), super::exp(super::LARGEST_EXPONENT));
            assert!(super::exp(-1e6) > 0.0 && super::exp(-1e6) < 1e-300);
            assert!(
                [0.0, -1.0, f64::NAN, f64::INFINITY]
                    .iter()
                    .all(|x| super::ln(*x).is_nan())
            );
            assert_eq!((super::exp(0.0), super::ln(1.0)), (1.0, 0.0));
        }
    }
}

/// A vector of doubles with the instruction set that runs it.
#[derive(Debug, Clone, Copy)]
pub struct Lanes<S: Simd> {
    simd: S,
    v: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// The first `S::F64_LANES` numbers of `from`.
    #[inline(always)]
    pub fn load(simd: S, from: &[f64]) -> Self {
        // Whole vectors, not pulp's partial loads: those are calls that spill every register.
        Self {
            simd,
            v: S::as_simd_f64s(&from[..S::F64_LANES]).0[0],
        }
    }

    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, x: f64) -> Self {
        Self {
            simd,
            v: simd.splat_f64s(x),
        }
    }

    /// Writes the lanes to the front of `to`.
    #[inline(always)]
    pub fn store(self, to: &mut [f64]) {
        S::as_mut_simd_f64s(&mut to[..S::F64_LANES]).0[0] = self.v;
    }
}

macro_rules! lane_operator {
    ($trait:ident, $method:ident, $simd:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self {
                    simd: self.simd,
                    v: self.simd.$simd(self.v, other.v),
                }
            }
        }
    };
}
lane_operator!(Add, add, add_f64s);
lane_operator!(Sub, sub, sub_f64s);
lane_operator!(Mul, mul, mul_f64s);
lane_operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            simd: self.simd,
            v: self.simd.neg_f64s(self.v),
        }
    }
}

impl<S: Simd> Real for Lanes<S> {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self::splat(self.simd, x)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self {
            simd: self.simd,
            v: self.simd.mul_add_e_f64s(self.v, a.v, b.v),
        }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self {
            simd: self.simd,
            v: self.simd.sqrt_f64s(self.v),
        }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let mut lanes = [0.0; 8];
        self.store(&mut lanes);
        for x in &mut lanes[..S::F64_LANES] {
            *x = elementary::exp(*x);
        }
        Self::load(self.simd, &lanes)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        let mut lanes = [0.0; 8];
        self.store(&mut lanes);
        for x in &mut lanes[..S::F64_LANES] {
            *x = elementary::ln(*x);
        }
        Self::load(self.simd, &lanes)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self {
            simd: self.simd,
            v: self.simd.max_f64s(self.v, other.v),
        }
    }
}

/// A value with its derivative along one direction, for exact derivatives in tests.
#[cfg(test)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dual {
    pub value: f64,
    pub slope: f64,
}

#[cfg(test)]
mod dual {
    use super::{Add, Div, Dual, LARGEST_EXPONENT, Mul, Neg, Real, Sub};

    fn dual(value: f64, slope: f64) -> Dual {
        Dual { value, slope }
    }

    impl Add for Dual {
        type Output = Self;
        fn add(self, o: Self) -> Self {
            dual(self.value + o.value, self.slope + o.slope)
        }
    }
    impl Sub for Dual {
        type Output = Self;
        fn sub(self, o: Self) -> Self {
            dual(self.value - o.value, self.slope - o.slope)
        }
    }
    impl Mul for Dual {
        type Output = Self;
        fn mul(self, o: Self) -> Self {
            dual(
                self.value * o.value,
                self.slope * o.value + self.value * o.slope,
            )
        }
    }
    impl Div for Dual {
        type Output = Self;
        fn div(self, o: Self) -> Self {
            dual(
                self.value / o.value,
                (self.slope - self.value / o.value * o.slope) / o.value,
            )
        }
    }
    impl Neg for Dual {
        type Output = Self;
        fn neg(self) -> Self {
            dual(-self.value, -self.slope)
        }
    }
    impl Real for Dual {
        fn like(self, x: f64) -> Self {
            dual(x, 0.0)
        }
        fn mul_add(self, a: Self, b: Self) -> Self {
            self * a + b
        }
        fn sqrt(self) -> Self {
            let root = self.value.sqrt();
            dual(root, self.slope / (2.0 * root))
        }
        fn exp(self) -> Self {
            assert!(
                self.value < LARGEST_EXPONENT,
                "tests stay inside the range of the exponential"
            );
            let e = self.value.exp();
            dual(e, self.slope * e)
        }
        fn ln(self) -> Self {
            dual(self.value.ln(), self.slope / self.value)
        }
        fn max(self, other: Self) -> Self {
            if self.value >= other.value {
                self
            } else {
                other
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct AllOperations([f64; 8]);

    impl pulp::WithSimd for AllOperations {
        type Output = Vec<f64>;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
            let mut out = vec![0.0; 8];
            for first in (0..8).step_by(S::F64_LANES) {
                let x = Lanes::load(simd, &self.0[first..]);
                let y = (x.exp() + x.sqrt().ln()) * x.times(0.5) - x / x.like(3.0).max(x)
                    + (-x).mul_add(x, x);
                y.store(&mut out[first..]);
            }
            out
        }
    }

    #[test]
    fn lanes_compute_what_scalars_compute_on_this_processor_and_without_vectors() {
        let x = [0.1, 0.7, 1.0, 1.3, 2.0, 2.9, 3.1, 4.0];
        for got in [
            pulp::Arch::new().dispatch(AllOperations(x)),
            pulp::Arch::Scalar.dispatch(AllOperations(x)),
        ] {
            for (x, got) in x.into_iter().zip(got) {
                let want =
                    (x.exp() + x.sqrt().ln()) * 0.5 * x - x / f64::max(3.0, x) + (-x).mul_add(x, x);
                assert!(
                    (got - want).abs() < 1e-13 * want.abs().max(1.0),
                    "{got} for {want} at {x}"
                );
            }
        }
    }

    #[test]
    fn exponential_never_overflows() {
        assert!(Real::exp(1e6_f64).powi(2).is_finite());
    }
}
