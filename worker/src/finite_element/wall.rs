//! Settings of wall, elements and linear solver as solver types.

use cardiotwin_mechanics::dynamics::Rayleigh;
use cardiotwin_mechanics::material::{ActiveLaw, Guccione};
use cardiotwin_mechanics::newton;
use cardiotwin_mechanics::organ::{self, Spring, WallParameters};
use cardiotwin_schemas::finite_element::{ElementKind, LinearSolver, WallSettings};

/// The wall with all exponents times a factor and a share of the active stress across the fibre.
#[must_use]
pub fn parameters(wall: &WallSettings, exponent_factor: f64, cross_fibre: f64) -> WallParameters {
    WallParameters {
        muscle: Guccione {
            c_kpa: wall.guccione_c_kpa,
            b_f: exponent_factor * wall.b_f,
            b_t: exponent_factor * wall.b_t,
            b_fs: exponent_factor * wall.b_fs,
        },
        muscle_kappa_kpa: wall.kappa_kpa,
        active: ActiveLaw { cross_fibre, ..ActiveLaw::PAPER },
        passive_mu_kpa: wall.aorta_mu_kpa,
        passive_kappa_kpa: wall.aorta_kappa_kpa,
        // g/mm³ to mg/mm³.
        density: 1e3 * wall.density_g_per_mm3,
        pericardium: Spring {
            stiffness: wall.epicardial_spring_kpa_per_mm,
            damping: wall.epicardial_dashpot_kpa_ms_per_mm,
        },
        pericardial_base_share: wall.epicardial_base_share,
        rim: Spring { stiffness: wall.rim_spring_kpa_per_mm, damping: wall.rim_dashpot_kpa_ms_per_mm },
        damping: Rayleigh { mass_per_ms: wall.mass_damping_per_ms, stiffness_ms: wall.stiffness_damping_ms },
        spectral_radius: wall.spectral_radius,
        ..WallParameters::default()
    }
}

/// Elements of the solver.
#[must_use]
pub fn element(kind: ElementKind) -> organ::ElementKind {
    match kind {
        ElementKind::LinearNodal => organ::ElementKind::LINEAR_NODAL,
        ElementKind::LinearPointwise => organ::ElementKind::LINEAR_POINTWISE,
        ElementKind::QuadraticNodal => organ::ElementKind::QUADRATIC_NODAL,
    }
}

/// Linear solver of the time steps.
#[must_use]
pub fn linear_solver(kind: LinearSolver) -> newton::LinearSolver {
    match kind {
        LinearSolver::BlockJacobi => newton::LinearSolver::BlockJacobi,
        LinearSolver::SymmetricSweep => newton::LinearSolver::SymmetricSweep,
        LinearSolver::Direct => newton::LinearSolver::Direct,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_settings_are_the_solvers_defaults() {
        let settings = WallSettings { guccione_c_kpa: 1.0, ..WallSettings::default() };
        assert_eq!(parameters(&settings, 1.0, 0.0), WallParameters::default());
    }
}
