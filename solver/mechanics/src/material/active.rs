//! Active stress along the fibre, and a share of it across.

use super::tensor::{Sym, at};
use super::{Load, MaterialError, Response};
use crate::number::Real;

/// Which tensor the scalar active stress multiplies. They differ by powers of the stretch: 1.38 and 1.18 at λ = 0.85.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActiveConvention {
    /// `S = Ta f⊗f`, a second Piola–Kirchhoff stress: both mechanics benchmarks.
    SecondPiola,
    /// `S = Ta/λ f⊗f`, force per reference area.
    FirstPiola,
    /// `S = Ta/λ² f⊗f`, the paper's.
    PerSquaredStretch,
}

/// How active stress acts in a tissue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveLaw {
    /// Convention.
    pub convention: ActiveConvention,
    /// Share of the stress that acts along the sheet axis, by the same convention with the stretch along that axis.
    pub cross_fibre: f64,
    /// The same along the normal of the sheet, which lies in the plane of the wall where sheets are transmural.
    pub sheet_normal: f64,
}

impl ActiveLaw {
    /// The paper's: `S = Ta/λ² f⊗f`, nothing across.
    pub const PAPER: Self = Self {
        convention: ActiveConvention::PerSquaredStretch,
        cross_fibre: 0.0,
        sheet_normal: 0.0,
    };
    /// The benchmarks': `S = Ta f⊗f`, nothing across.
    pub const BENCHMARK: Self = Self {
        convention: ActiveConvention::SecondPiola,
        cross_fibre: 0.0,
        sheet_normal: 0.0,
    };

    pub(super) fn check(&self) -> Result<(), MaterialError> {
        MaterialError::unless(
            (0.0..=1.0).contains(&self.cross_fibre),
            "cross_fibre",
            self.cross_fibre,
            "0 to 1",
        )?;
        MaterialError::unless(
            (0.0..=1.0).contains(&self.sheet_normal),
            "sheet_normal",
            self.sheet_normal,
            "0 to 1",
        )
    }

    #[inline(always)]
    pub(super) fn add<R: Real, const TANGENT: bool>(
        &self,
        c: &Sym<R>,
        load: &Load<R>,
        out: &mut Response<R>,
    ) {
        let (ta, slope) = (load.active, load.active_slope);
        let lambda = c[0].sqrt();
        // dλ/dE₁₁ = 1/λ: `slope` reaches every component that carries active stress through the fibre's own stretch.
        let slope_e = slope / lambda;
        let (factor, factor_slope) = self.factor(c[0]);
        out.s[0] = ta.mul_add(factor, out.s[0]);
        if TANGENT {
            out.d[at(0, 0)] = out.d[at(0, 0)] + slope_e * factor + ta * factor_slope;
        }
        for (axis, cross) in [(1, self.cross_fibre), (2, self.sheet_normal)] {
            if cross > 0.0 {
                let (factor, factor_slope) = self.factor(c[axis]);
                let share = ta.times(cross);
                out.s[axis] = share.mul_add(factor, out.s[axis]);
                if TANGENT {
                    out.d[at(axis, axis)] = share.mul_add(factor_slope, out.d[at(axis, axis)]);
                    // The stress across also depends on the stretch along, not the other way round. Newton goes
                    // without this coupling: triangular, it only delays the convergence, while its symmetric half makes
                    // the tangent indefinite where a cell resists shortening (Land's slope is 40 times its stress).
                }
            }
        }
    }

    /// The convention's factor at squared stretch `c`, and its derivative with respect to the Green strain along.
    #[inline(always)]
    fn factor<R: Real>(&self, c: R) -> (R, R) {
        let one = c.like(1.0);
        match self.convention {
            ActiveConvention::SecondPiola => (one, c.like(0.0)),
            ActiveConvention::FirstPiola => {
                let f = one / c.sqrt();
                (f, -(f / c))
            }
            ActiveConvention::PerSquaredStretch => {
                let f = one / c;
                (f, -(f * f).times(2.0))
            }
        }
    }
}
