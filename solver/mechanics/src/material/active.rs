//! Active stress along the fibre, with optional shares across it.

use cardiotwin_vocabulary::passive_law::ActiveConvention;
use serde::{Deserialize, Serialize};

use super::tensor::{Sym, at};
use super::{Load, MaterialError, Response};
use crate::number::Real;

/// How active stress acts in a tissue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ActiveLaw {
    /// Stress tensor that the scalar multiplies.
    pub convention: ActiveConvention,
    /// Share of the stress along the sheet axis, by the same convention with that axis's stretch.
    pub cross_fibre: f64,
    /// Share along the sheet normal, which lies in the plane of the wall if sheets are transmural.
    pub sheet_normal: f64,
}

impl ActiveLaw {
    /// The paper's law, `S = Ta/λ² f⊗f` without cross-fibre stress.
    pub const PAPER: Self = Self {
        convention: ActiveConvention::PerSquaredStretch,
        cross_fibre: 0.0,
        sheet_normal: 0.0,
    };
    /// The benchmarks' law, `S = Ta f⊗f` without cross-fibre stress.
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
        // dλ/dE₁₁ = 1/λ: all active stress depends on the fibre stretch, so `slope` enters every such component.
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
                    // Cross-fibre stress also depends on the fibre stretch, but not the reverse. Newton's method omits this
                    // triangular coupling, which only slows convergence; its symmetric half would make the tangent indefinite
                    // for a cell that resists shortening (Land's slope is 40 times its stress).
                }
            }
        }
    }

    /// The convention's factor at squared stretch `c`, and its derivative with respect to the Green strain along the axis.
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
