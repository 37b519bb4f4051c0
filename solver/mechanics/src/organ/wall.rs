//! The wall: material, supports and damping, and the body that they make of an anatomy.

use std::sync::Arc;

use super::anatomy::{Anatomy, Tets, Triangles};
use crate::body::{Body, BodyError, BodyInput};
use crate::boundary::{Cavity, Robin, RobinDirection, SurfaceError, ValvePlane};
use crate::dynamics::{Dynamics, Rayleigh, Support};
use crate::linear::Pattern;
use crate::material::{ActiveLaw, Guccione, Law, NeoHookean, Tissue, Volumetric, VolumetricLaw};
use crate::parallel::{Communicator, Part};
use crate::time_integration::GeneralisedAlpha;

/// Material, supports and damping of a left ventricle. [`WallParameters::default`] gives the values used where nothing else
/// is known; those without a source are assumptions of ours.
#[derive(Debug, Clone, PartialEq)]
pub struct WallParameters {
    /// Muscle.
    pub muscle: Law,
    /// Bulk modulus of muscle \[kPa\].
    pub muscle_kappa_kpa: f64,
    /// Active stress of muscle.
    pub active: ActiveLaw,
    /// Shear modulus of passive tissue \[kPa\].
    pub passive_mu_kpa: f64,
    /// Bulk modulus of passive tissue \[kPa\].
    pub passive_kappa_kpa: f64,
    /// Passive tissue of its own by the mesh's tags.
    pub passive_of_tags: Vec<PassiveTissue>,
    /// Density \[mg/mm³\].
    pub density: f64,
    /// Springs along the normal of epicardium and septum \[kPa/mm\].
    pub epicardial_spring: f64,
    /// Springs in all directions on the rim \[kPa/mm\].
    pub rim_spring: f64,
    /// Share of the rim's springs that hold the heart in step 0, where nothing else does: 0 to 1, not 0.
    pub static_rim_share: f64,
    /// Damping.
    pub damping: Rayleigh,
    /// Time integration: damping of the highest frequencies, 0 (at once) to 1 (never).
    pub spectral_radius: f64,
    /// What holds the pressure on the valves.
    pub valve_plane: ValvePlane,
}

/// Neo-Hookean tissue of one of the mesh's tags, which does not contract.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassiveTissue {
    /// The tag.
    pub tag: i32,
    /// Shear modulus \[kPa\].
    pub mu_kpa: f64,
    /// Bulk modulus \[kPa\].
    pub kappa_kpa: f64,
}

impl Default for WallParameters {
    fn default() -> Self {
        Self {
            muscle: Law::Guccione(Guccione::guccione1995(1.0)),
            muscle_kappa_kpa: 1000.0,
            active: ActiveLaw::PAPER,
            passive_mu_kpa: 26.66,
            passive_kappa_kpa: 1000.0,
            passive_of_tags: vec![],
            density: 1.06,
            epicardial_spring: 0.1,
            rim_spring: 1.0,
            static_rim_share: 0.3,
            damping: Rayleigh { mass_per_ms: 0.1, stiffness_ms: 0.1 },
            spectral_radius: 0.0,
            valve_plane: ValvePlane::HangsOnRim,
        }
    }
}

/// Why there is no wall.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WallError {
    /// Material or elements.
    #[error("body")]
    Body(#[from] BodyError),
    /// A surface.
    #[error("surface {name}")]
    Surface {
        /// Which.
        name: &'static str,
        /// What is wrong with it.
        source: SurfaceError,
    },
    /// A parameter out of range.
    #[error("{name} = {value} must be {expected}")]
    Parameter {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
}

impl WallParameters {
    fn check(&self) -> Result<(), WallError> {
        let rules = [
            ("epicardial_spring", self.epicardial_spring, self.epicardial_spring >= 0.0, "zero or more"),
            ("rim_spring", self.rim_spring, self.rim_spring > 0.0, "positive"),
            ("static_rim_share", self.static_rim_share, self.static_rim_share > 0.0, "positive"),
            ("mass damping", self.damping.mass_per_ms, self.damping.mass_per_ms >= 0.0, "zero or more"),
            ("stiffness damping", self.damping.stiffness_ms, self.damping.stiffness_ms >= 0.0, "zero or more"),
        ];
        match rules.into_iter().find(|(_, value, ok, _)| !(*ok && value.is_finite())) {
            Some((name, value, _, expected)) => Err(WallError::Parameter { name, value, expected }),
            None => Ok(()),
        }
    }

    /// The time integration of its motion.
    #[must_use]
    pub fn scheme(&self) -> GeneralisedAlpha {
        GeneralisedAlpha::with_spectral_radius(self.spectral_radius)
    }

    /// A rank's part of the wall with its unloaded nodes at `unloaded`, hung on the rim alone: what step 0 works with.
    /// Collective.
    ///
    /// - `anatomy`, `unloaded`: of the `part`, see [`Anatomy::part`]
    ///
    /// # Errors
    /// [`WallError`] for bad parameters, elements or surfaces; of elements on all ranks.
    pub fn hung(
        &self,
        anatomy: &Anatomy,
        unloaded: &[[f64; 3]],
        part: &Part,
        comm: Box<dyn Communicator>,
    ) -> Result<Dynamics, WallError> {
        self.check()?;
        let frames = anatomy.frames_at(unloaded);
        let tissue = |law, kappa_kpa, volumetric, active| Tissue {
            law,
            volumetric: Volumetric { law: volumetric, kappa_kpa },
            active,
            density: self.density,
        };
        let passive = |mu_kpa, kappa_kpa| {
            tissue(Law::NeoHookean(NeoHookean { mu_kpa }), kappa_kpa, VolumetricLaw::Quadratic, None)
        };
        let muscle = tissue(self.muscle, self.muscle_kappa_kpa, VolumetricLaw::LnSquared, Some(self.active));
        let mut tissues = vec![muscle, passive(self.passive_mu_kpa, self.passive_kappa_kpa)];
        tissues.extend(self.passive_of_tags.iter().map(|of| passive(of.mu_kpa, of.kappa_kpa)));
        let tissue_of: Vec<usize> = (anatomy.contracts.iter().zip(&anatomy.tags))
            .map(|(contracts, tag)| match self.passive_of_tags.iter().position(|of| of.tag == *tag) {
                _ if *contracts => 0,
                Some(own) => 2 + own,
                None => 1,
            })
            .collect();
        let frame = |e: usize, _: [f64; 3]| frames[e];
        let (n_vertices, volume) = (anatomy.n_vertices, anatomy.volume);
        macro_rules! input {
            ($tets:expr) => {
                BodyInput {
                    nodes: unloaded,
                    n_vertices,
                    tets: $tets,
                    tissues,
                    tissue_of: &tissue_of,
                    frame: &frame,
                    volume,
                    layout: part.layout.clone(),
                    elements: &part.elements,
                }
            };
        }
        let body = match &anatomy.tets {
            Tets::Linear(tets) => Body::linear(&input!(tets), comm.as_ref())?,
            Tets::Quadratic(tets) => Body::quadratic(&input!(tets), comm.as_ref())?,
        };
        let cavity = self.cavity(anatomy, body.reference(), body.pattern(), comm.as_ref())?;
        let mut dynamics = Dynamics::new(body, comm, self.scheme());
        dynamics.cavity = Some(cavity);
        dynamics.elements.clone_from(&part.elements);
        // At rest in the imaged configuration, which is the one that forces are balanced in.
        let rest = displacement(&anatomy.nodes, unloaded);
        dynamics.supports = vec![self.on_rim(anatomy, &dynamics, self.static_rim_share * self.rim_spring, rest)?];
        Ok(dynamics)
    }

    /// Puts the beat's supports and damping on a wall that hangs in equilibrium at displacement `u`: springs of epicardium
    /// and septum at rest there, those of the rim such that they hold what the weaker ones held.
    ///
    /// # Errors
    /// [`WallError::Surface`] for a bad surface.
    pub fn support(&self, anatomy: &Anatomy, dynamics: &mut Dynamics, u: &[f64]) -> Result<(), WallError> {
        let before = &dynamics.supports[0].rest;
        let share = self.static_rim_share;
        let rest = u.iter().zip(before).map(|(u, before)| u - share * (u - before)).collect();
        let mut supports = vec![self.on_rim(anatomy, dynamics, self.rim_spring, rest)?];
        let loaded: Vec<f64> = dynamics.body.reference().iter().zip(u).map(|(x, u)| x + u).collect();
        let outer = [("epicardium", Some(&anatomy.epicardium)), ("septum", anatomy.septum.as_ref())];
        for (name, triangles) in outer {
            if let (Some(triangles), true) = (triangles, self.epicardial_spring > 0.0) {
                let robin = robin(name, triangles, RobinDirection::Normal, &loaded, dynamics.body.pattern())?;
                supports.push(Support { robin, spring: self.epicardial_spring, dashpot: 0.0, rest: u.to_vec() });
            }
        }
        dynamics.supports = supports;
        dynamics.damping = self.damping;
        Ok(())
    }

    fn on_rim(&self, a: &Anatomy, d: &Dynamics, spring: f64, rest: Vec<f64>) -> Result<Support, WallError> {
        let robin = robin("rim", &a.rim, RobinDirection::All, d.body.reference(), d.body.pattern())?;
        Ok(Support { robin, spring, dashpot: 0.0, rest })
    }

    fn cavity(
        &self,
        a: &Anatomy,
        reference: &[f64],
        pattern: &Arc<Pattern>,
        comm: &dyn Communicator,
    ) -> Result<Cavity, WallError> {
        let openings = a.openings.clone();
        let hangs = self.valve_plane == ValvePlane::HangsOnRim;
        match (&a.endocardium, &a.rim) {
            (Triangles::Linear(wall), Triangles::Linear(rim)) => {
                Cavity::new(wall, openings, if hangs { rim } else { &[] }, reference, pattern, comm)
            }
            (Triangles::Quadratic(wall), Triangles::Quadratic(rim)) => {
                Cavity::new(wall, openings, if hangs { rim } else { &[] }, reference, pattern, comm)
            }
            _ => Err(SurfaceError::Nodes { found: 0 }),
        }
        .map_err(|source| WallError::Surface { name: "endocardium", source })
    }
}

/// Displacement from `from` to `to`, three numbers a node.
pub(super) fn displacement(to: &[[f64; 3]], from: &[[f64; 3]]) -> Vec<f64> {
    to.as_flattened().iter().zip(from.as_flattened()).map(|(a, b)| a - b).collect()
}

fn robin(
    name: &'static str,
    triangles: &Triangles,
    direction: RobinDirection,
    reference: &[f64],
    pattern: &Pattern,
) -> Result<Robin, WallError> {
    match triangles {
        Triangles::Linear(t) => Robin::new(t, direction, reference, pattern),
        Triangles::Quadratic(t) => Robin::new(t, direction, reference, pattern),
    }
    .map_err(|source| WallError::Surface { name, source })
}
