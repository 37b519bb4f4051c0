//! Strain energies, their stress and consistent tangent, in the fibre frame.
//!
//! Tensors have the axes fibre, sheet and sheet-normal of the reference configuration, so that a material needs no direction
//! vectors. A [`Law`] has an isochoric part in the Green strain `Ē = (J^{-2/3} C − I)/2`, and may have a part in the full `C`
//! (Holzapfel and Ogden's fibre terms). [`respond`] projects the isochoric part and adds pressure and active stress.

mod active;
mod guccione;
mod holzapfel_ogden;
mod law;
mod neo_hookean;
pub mod tensor;
mod volumetric;

pub use active::ActiveLaw;
pub use cardiotwin_vocabulary::passive_law::{
    ActiveConvention, Guccione, HolzapfelOgden, NeoHookean,
};
pub use law::{Law, PassiveLaw};
pub use volumetric::{Volumetric, VolumetricLaw};

use crate::number::Real;
use tensor::{Sym, Tangent, add_pair, add_square, add_symmetric_product, apply, contract, inverse};

/// A tissue: passive law, resistance to a change of volume, active stress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    /// Law of the passive stress.
    pub law: Law,
    /// Resistance to a change of volume.
    pub volumetric: Volumetric,
    /// Law of the active stress; `None` for passive tissue.
    pub active: Option<ActiveLaw>,
    /// Density in the reference configuration \[mg/mm³\].
    pub density: f64,
}

/// A material parameter is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("material parameter {name} = {value} must be {expected}")]
pub struct MaterialError {
    /// Name of the parameter.
    pub name: &'static str,
    /// Value of the parameter.
    pub value: f64,
    /// Range of admissible values, in words.
    pub expected: &'static str,
}

impl MaterialError {
    fn unless(
        ok: bool,
        name: &'static str,
        value: f64,
        expected: &'static str,
    ) -> Result<(), Self> {
        if ok {
            Ok(())
        } else {
            Err(Self {
                name,
                value,
                expected,
            })
        }
    }
}

impl Tissue {
    /// Checks every parameter.
    ///
    /// # Errors
    /// [`MaterialError`] for the first parameter that is not finite or outside its range.
    pub fn check(&self) -> Result<(), MaterialError> {
        MaterialError::unless(self.density > 0.0, "density", self.density, "positive")?;
        self.volumetric.check()?;
        if let Some(active) = &self.active {
            active.check()?;
        }
        self.law.check()
    }
}

/// Second Piola–Kirchhoff stress \[kPa\] and its tangent `2 ∂S/∂C` \[kPa\].
#[derive(Debug, Clone, Copy)]
pub struct Response<R> {
    /// Second Piola–Kirchhoff stress \[kPa\].
    pub s: Sym<R>,
    /// Tangent \[kPa\]; zero if it was not requested.
    pub d: Tangent<R>,
}

/// Pressure and active stress at a point.
#[derive(Debug, Clone, Copy)]
pub struct Load<R> {
    /// `U'(J)` of the pointwise share of the volumetric energy, plus the pressure from nodal averages \[kPa\].
    pub pressure: R,
    /// `U''(J)` of the pointwise share \[kPa\].
    pub bulk: R,
    /// Active stress along the fibre \[kPa\], before the convention's factor.
    pub active: R,
    /// Derivative of the active stress with respect to the fibre stretch `λ = √C₁₁` \[kPa\].
    pub active_slope: R,
}

impl Law {
    /// Strain energy density without the volumetric part \[kPa\], from `C` and `J = √det C`.
    pub fn energy<R: Real>(&self, c: &Sym<R>, j: R) -> R {
        let cbar = scaled(c, (j.ln().times(-2.0 / 3.0)).exp());
        let isochoric = self.isochoric_energy(&cbar);
        match self.fibre_energy(c) {
            Some(fibres) => isochoric + fibres,
            None => isochoric,
        }
    }
}

#[inline(always)]
fn scaled<R: Real>(c: &Sym<R>, k: R) -> Sym<R> {
    let mut out = *c;
    for i in 0..6 {
        out[i] = out[i] * k;
    }
    out
}

// Inlined kernel code below uses no closures (`array::map`, `from_fn`): a closure that is not inlined is compiled without its
// caller's vector instructions, and costs a factor of ten.

/// Stress and, with `TANGENT`, tangent of `tissue` at right Cauchy–Green tensor `c` with `j = det F`.
///
/// Source of the projection: Holzapfel, Nonlinear Solid Mechanics (2000), eqs. 6.88–6.91 and 6.164–6.170.
#[inline(always)]
pub fn respond<R: Real, const TANGENT: bool>(
    tissue: &Tissue,
    c: &Sym<R>,
    j: R,
    load: &Load<R>,
) -> Response<R> {
    let zero = j.like(0.0);
    let a = (j.ln().times(-2.0 / 3.0)).exp();
    let cbar = scaled(c, a);
    // Fictitious stress S̄ = ∂W/∂Ē and its tangent.
    let mut bar = Response {
        s: [zero; 6],
        d: [zero; 21],
    };
    tissue.law.add_isochoric::<R, TANGENT>(&cbar, &mut bar);
    let c_inv = inverse(c, j * j);
    let t = contract(&bar.s, c);
    let third_t = t.times(1.0 / 3.0);
    let p_j = load.pressure * j;
    let mut s_iso = [zero; 6];
    let mut out = Response {
        s: [zero; 6],
        d: [zero; 21],
    };
    for i in 0..6 {
        s_iso[i] = a * (bar.s[i] - third_t * c_inv[i]);
        out.s[i] = p_j.mul_add(c_inv[i], s_iso[i]);
    }
    if TANGENT {
        let a2 = a * a;
        let h = apply(&bar.d, c);
        let chc = contract(&h, c);
        for k in 0..21 {
            out.d[k] = a2 * bar.d[k];
        }
        // All C⁻¹⊗C⁻¹ and C⁻¹⊙C⁻¹ terms at once: projection, 2/3 Tr(S̄) P̃, and pressure.
        let dyad = a2 * chc.times(1.0 / 9.0) - a * t.times(2.0 / 9.0) + p_j + load.bulk * (j * j);
        let product = a * t.times(2.0 / 3.0) - (p_j + p_j);
        add_square(&mut out.d, dyad, &c_inv);
        add_symmetric_product(&mut out.d, product, &c_inv);
        let mut v = [zero; 6];
        for i in 0..6 {
            v[i] = -(a2 * h[i].times(1.0 / 3.0) + s_iso[i].times(2.0 / 3.0));
        }
        add_pair(&mut out.d, &c_inv, &v);
    }
    tissue.law.add_fibres::<R, TANGENT>(c, &mut out);
    if let Some(active) = &tissue.active {
        active.add::<R, TANGENT>(c, load, &mut out);
    }
    out
}

#[cfg(test)]
mod tests;
