//! Numbers that a kernel can be written over once: `f64`, a dual number for exact derivatives in tests, and a SIMD vector
//! whose instruction set is chosen at run time.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// What a material or element kernel needs of a number.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The constant `x`, as the same kind of number as `self`.
    fn like(self, x: f64) -> Self;
    /// `self · a + b`, fused where the instruction set has it.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Exponential; arguments above [`LARGEST_EXPONENT`] give its value there, so that no infinity arises.
    fn exp(self) -> Self;
    /// Natural logarithm.
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
        Self { simd, v: S::as_simd_f64s(&from[..S::F64_LANES]).0[0] }
    }

    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, x: f64) -> Self {
        Self { simd, v: simd.splat_f64s(x) }
    }

    /// Writes the lanes to the front of `to`.
    #[inline(always)]
    pub fn store(self, to: &mut [f64]) {
        S::as_mut_simd_f64s(&mut to[..S::F64_LANES]).0[0] = self.v;
    }

    #[inline(always)]
    fn each(self, f: fn(f64) -> f64) -> Self {
        let mut lanes = [0.0; 8];
        self.store(&mut lanes);
        for x in &mut lanes[..S::F64_LANES] {
            *x = f(*x);
        }
        Self::load(self.simd, &lanes)
    }
}

macro_rules! lane_operator {
    ($trait:ident, $method:ident, $simd:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { simd: self.simd, v: self.simd.$simd(self.v, other.v) }
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
        Self { simd: self.simd, v: self.simd.neg_f64s(self.v) }
    }
}

impl<S: Simd> Real for Lanes<S> {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self::splat(self.simd, x)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self { simd: self.simd, v: self.simd.mul_add_e_f64s(self.v, a.v, b.v) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { simd: self.simd, v: self.simd.sqrt_f64s(self.v) }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.each(<f64 as Real>::exp)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.each(f64::ln)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self { simd: self.simd, v: self.simd.max_f64s(self.v, other.v) }
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
            dual(self.value * o.value, self.slope * o.value + self.value * o.slope)
        }
    }
    impl Div for Dual {
        type Output = Self;
        fn div(self, o: Self) -> Self {
            dual(self.value / o.value, (self.slope - self.value / o.value * o.slope) / o.value)
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
            assert!(self.value < LARGEST_EXPONENT, "tests stay inside the range of the exponential");
            let e = self.value.exp();
            dual(e, self.slope * e)
        }
        fn ln(self) -> Self {
            dual(self.value.ln(), self.slope / self.value)
        }
        fn max(self, other: Self) -> Self {
            if self.value >= other.value { self } else { other }
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
                let y = (x.exp() + x.sqrt().ln()) * x.times(0.5) - x / x.like(3.0).max(x) + (-x).mul_add(x, x);
                y.store(&mut out[first..]);
            }
            out
        }
    }

    #[test]
    fn lanes_compute_what_scalars_compute_on_this_processor_and_without_vectors() {
        let x = [0.1, 0.7, 1.0, 1.3, 2.0, 2.9, 3.1, 4.0];
        for got in [pulp::Arch::new().dispatch(AllOperations(x)), pulp::Arch::Scalar.dispatch(AllOperations(x))] {
            for (x, got) in x.into_iter().zip(got) {
                let want = (x.exp() + x.sqrt().ln()) * 0.5 * x - x / f64::max(3.0, x) + (-x).mul_add(x, x);
                assert!((got - want).abs() < 1e-13 * want.abs().max(1.0), "{got} for {want} at {x}");
            }
        }
    }

    #[test]
    fn exponential_never_overflows() {
        assert!(Real::exp(1e6_f64).powi(2).is_finite());
    }
}
