//! Electrical properties of tissue.

use cardiotwin_mesh::eikonal::Speeds;

/// Passive electrical properties of tissue.
///
/// The monodomain equation is β C_m ∂V/∂t = ∇·(σ ∇V) − β I_ion + I_foot; the diffusivity of V is
/// σ/(β C_m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    /// Monodomain conductivity along fibre, sheet and normal \[mS/mm\] (= S/m): half the harmonic
    /// mean of the intra- and extracellular conductivities.
    pub conductivity_ms_mm: [f64; 3],
    /// Membrane area per volume of tissue, β \[1/mm\].
    pub surface_to_volume_per_mm: f64,
    /// Membrane capacitance C_m \[µF/cm²\].
    pub capacitance_uf_cm2: f64,
}

/// Surface-to-volume ratio \[1/mm\] of the benchmark of Niederer et al. 2011, Phil. Trans. R. Soc. A
/// 369, 4331, read in public programs that solve it.
pub const SURFACE_TO_VOLUME_PER_MM: f64 = 140.0;

/// Speed of a plane wave of the Luo-Rudy membrane from rest, divided by the square root of the
/// diffusivity \[1/√ms\]. The speed has this scaling in every direction. Measured on refined bars
/// (test `the_wave_without_eikonal_has_the_stated_speed`).
pub const SPEED_PER_ROOT_DIFFUSIVITY: f64 = 2.12;

impl Tissue {
    /// Tissue in which waves would have these speeds by diffusion alone on a sufficiently fine
    /// mesh. Eikonal equation and diffusion then agree. On a coarse mesh, where diffusion alone is
    /// too slow, the eikonal leads.
    #[must_use]
    pub fn matching(speeds: &Speeds) -> Self {
        let capacity = SURFACE_TO_VOLUME_PER_MM * 0.01;
        let sigma = |speed: f64| capacity * (speed / SPEED_PER_ROOT_DIFFUSIVITY).powi(2);
        Self {
            conductivity_ms_mm: [
                sigma(speeds.fibre),
                sigma(speeds.sheet),
                sigma(speeds.normal),
            ],
            surface_to_volume_per_mm: SURFACE_TO_VOLUME_PER_MM,
            capacitance_uf_cm2: 1.0,
        }
    }

    /// Diffusivities along fibre, sheet and normal \[mm²/ms\].
    #[must_use]
    pub fn diffusivities_mm2_ms(&self) -> [f64; 3] {
        // 1 µF/cm² = 0.01 µF/mm²
        self.conductivity_ms_mm
            .map(|sigma| sigma / (self.surface_to_volume_per_mm * 0.01 * self.capacitance_uf_cm2))
    }
}
