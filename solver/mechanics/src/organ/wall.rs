//! The wall: material, supports and damping, and their assembly into a body.

use cardiotwin_linalg::Pattern;
use cardiotwin_linalg::parallel::{Communicator, Part};
use cardiotwin_mesh::tet_mesh::surface_names;
use serde::{Deserialize, Serialize};

use super::anatomy::{Anatomy, Tets, Triangles};
use super::right_ventricle::RightPressure;
use crate::body::{Body, BodyError, BodyInput};
use crate::boundary::{Cavity, Robin, RobinDirection, SurfaceError, ValvePlane};
use crate::dynamics::{Dynamics, GivenCavity, Rayleigh, Support};
use crate::material::{ActiveLaw, Guccione, Law, NeoHookean, Tissue, Volumetric, VolumetricLaw};
use crate::time_integration::GeneralisedAlpha;

/// Material, supports and damping of a left ventricle. [`WallParameters::default`] gives values for use without better
/// knowledge; values without a source are our assumptions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WallParameters {
    /// Passive law of the muscle.
    pub muscle: Law,
    /// Bulk modulus of muscle \[kPa\].
    pub muscle_kappa_kpa: f64,
    /// Law of the muscle's active stress.
    pub active: ActiveLaw,
    /// Duration of contraction at the epicardium relative to the endocardium; linear in the depth between.
    pub epicardial_duration: f64,
    /// Shear modulus of passive tissue \[kPa\].
    pub passive_mu_kpa: f64,
    /// Bulk modulus of passive tissue \[kPa\].
    pub passive_kappa_kpa: f64,
    /// Passive tissues of particular mesh tags.
    pub passive_of_tags: Vec<PassiveTissue>,
    /// Mass density of muscle and passive tissue \[mg/mm³\].
    pub density: f64,
    /// Pericardial springs along the normals of epicardium and septum, with their values at the apex; at rest at end-diastole.
    pub pericardium: Spring,
    /// Ratio of basal to apical pericardial stiffness and damping; linear in the height between.
    pub pericardial_base_share: f64,
    /// Springs in all directions on the rim, at rest at end-diastole.
    pub rim: Spring,
    /// Stiffness of the rim's springs that keep the wall in place while step 0 inflates it \[kPa/mm\], at rest in the image.
    pub static_spring: f64,
    /// Rayleigh damping of the wall.
    pub damping: Rayleigh,
    /// Spectral radius of the time integration at infinite frequency: 0 removes the highest frequencies at once, 1 never.
    pub spectral_radius: f64,
    /// Support of the pressure on the valves.
    pub valve_plane: ValvePlane,
    /// Pressure in the right ventricle, if the mesh has one; `None` for no pressure.
    pub right_pressure: Option<RightPressure>,
    /// Further surfaces on springs and dashpots, next to pericardium and rim.
    pub surfaces: Vec<SprungSurface>,
}

/// A surface of the mesh on springs along its normal, at rest at end-diastole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SprungSurface {
    /// Name of the surface in the mesh.
    pub name: String,
    /// Springs and dashpots along the normal.
    pub spring: Spring,
}

/// Non-contracting neo-Hookean tissue of one mesh tag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PassiveTissue {
    /// Tag of its elements.
    pub tag: i32,
    /// Shear modulus of the tissue \[kPa\].
    pub mu_kpa: f64,
    /// Bulk modulus of the tissue \[kPa\].
    pub kappa_kpa: f64,
}

impl Default for WallParameters {
    fn default() -> Self {
        Self {
            muscle: Law::Guccione(Guccione::guccione1995(1.0)),
            muscle_kappa_kpa: 1000.0,
            active: ActiveLaw {
                sheet_normal: 0.2,
                ..ActiveLaw::PAPER
            },
            epicardial_duration: 0.9,
            passive_mu_kpa: 26.66,
            passive_kappa_kpa: 1000.0,
            passive_of_tags: vec![],
            density: 1.06,
            pericardium: Spring {
                stiffness: 0.2,
                damping: 5.0,
            },
            pericardial_base_share: 0.2,
            rim: Spring {
                stiffness: 0.05,
                damping: 0.0,
            },
            static_spring: 0.3,
            damping: Rayleigh {
                mass_per_ms: 0.1,
                stiffness_ms: 0.1,
            },
            spectral_radius: 0.0,
            valve_plane: ValvePlane::HangsOnRim,
            right_pressure: None,
            surfaces: vec![],
        }
    }
}

/// Springs and dashpots on a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spring {
    /// Stiffness of the springs per area \[kPa/mm\].
    pub stiffness: f64,
    /// Damping of the dashpots per area \[kPa·ms/mm\].
    pub damping: f64,
}

/// Reasons why the wall could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WallError {
    /// A material or an element is unusable.
    #[error("invalid body")]
    Body(#[from] BodyError),
    /// A surface is unusable.
    #[error("invalid surface {name}")]
    Surface {
        /// Name of the surface.
        name: &'static str,
        /// Defect of the surface.
        source: SurfaceError,
    },
    /// A surface on springs of its own is unusable.
    #[error("invalid surface {name}")]
    Sprung {
        /// Name of the surface.
        name: String,
        /// Defect of the surface.
        source: SurfaceError,
    },
    /// The mesh lacks a surface.
    #[error("the mesh has no surface {name:?}, expected one for {purpose}")]
    NoSurface {
        /// Name of the surface.
        name: String,
        /// Use of the surface.
        purpose: &'static str,
    },
    /// A parameter is out of range.
    #[error("{name} = {value} must be {expected}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Value of the parameter.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
}

impl WallParameters {
    fn check(&self) -> Result<(), WallError> {
        let rules = [
            (
                "pericardial spring",
                self.pericardium.stiffness,
                self.pericardium.stiffness >= 0.0,
                "zero or more",
            ),
            (
                "pericardial dashpot",
                self.pericardium.damping,
                self.pericardium.damping >= 0.0,
                "zero or more",
            ),
            (
                "base share",
                self.pericardial_base_share,
                self.pericardial_base_share >= 0.0,
                "zero or more",
            ),
            (
                "rim spring",
                self.rim.stiffness,
                self.rim.stiffness > 0.0,
                "positive",
            ),
            (
                "rim dashpot",
                self.rim.damping,
                self.rim.damping >= 0.0,
                "zero or more",
            ),
            (
                "epicardial duration",
                self.epicardial_duration,
                self.epicardial_duration > 0.1,
                "above 0.1",
            ),
            (
                "static spring",
                self.static_spring,
                self.static_spring > 0.0,
                "positive",
            ),
            (
                "mass damping",
                self.damping.mass_per_ms,
                self.damping.mass_per_ms >= 0.0,
                "zero or more",
            ),
            (
                "stiffness damping",
                self.damping.stiffness_ms,
                self.damping.stiffness_ms >= 0.0,
                "zero or more",
            ),
        ];
        let of_surfaces = self
            .surfaces
            .iter()
            .flat_map(|SprungSurface { spring, .. }| {
                let Spring { stiffness, damping } = *spring;
                [
                    (
                        "spring of a surface",
                        stiffness,
                        stiffness >= 0.0,
                        "zero or more",
                    ),
                    (
                        "dashpot of a surface",
                        damping,
                        damping >= 0.0,
                        "zero or more",
                    ),
                ]
            });
        match rules
            .into_iter()
            .chain(of_surfaces)
            .find(|(_, value, ok, _)| !(*ok && value.is_finite()))
        {
            Some((name, value, _, expected)) => Err(WallError::Parameter {
                name,
                value,
                expected,
            }),
            None => Ok(()),
        }
    }

    /// Time integration of the wall's motion.
    #[must_use]
    pub fn scheme(&self) -> GeneralisedAlpha {
        GeneralisedAlpha::with_spectral_radius(self.spectral_radius)
    }

    /// Assembles a rank's part of the wall for step 0, with unloaded nodes at `unloaded`, undamped and held by springs on the
    /// rim alone. Collective.
    ///
    /// - `anatomy`, `unloaded`: restricted to `part`, see [`Anatomy::part`]
    /// - `anchor`: rest position of the supports relative to the image \[mm\], three numbers a node
    ///
    /// # Errors
    /// [`WallError`] for bad parameters, elements or surfaces; element errors are returned on all ranks.
    pub fn assemble_static(
        &self,
        anatomy: &Anatomy,
        unloaded: &[[f64; 3]],
        anchor: &[f64],
        part: &Part,
        comm: Box<dyn Communicator>,
    ) -> Result<Dynamics, WallError> {
        self.check()?;
        let tissue = |law, kappa_kpa, volumetric, active| Tissue {
            law,
            volumetric: Volumetric {
                law: volumetric,
                kappa_kpa,
            },
            active,
            density: self.density,
        };
        let passive = |mu_kpa, kappa_kpa| {
            tissue(
                Law::NeoHookean(NeoHookean { mu_kpa }),
                kappa_kpa,
                VolumetricLaw::Quadratic,
                None,
            )
        };
        let muscle = tissue(
            self.muscle,
            self.muscle_kappa_kpa,
            VolumetricLaw::LnSquared,
            Some(self.active),
        );
        let mut tissues = vec![muscle, passive(self.passive_mu_kpa, self.passive_kappa_kpa)];
        tissues.extend(
            self.passive_of_tags
                .iter()
                .map(|of| passive(of.mu_kpa, of.kappa_kpa)),
        );
        let tissue_of: Vec<usize> = (anatomy.contracts.iter().zip(&anatomy.tags))
            .map(|(contracts, tag)| {
                match self.passive_of_tags.iter().position(|of| of.tag == *tag) {
                    _ if *contracts => 0,
                    Some(own) => 2 + own,
                    None => 1,
                }
            })
            .collect();
        let frame = |e: usize, x: [f64; 3]| anatomy.frame_at(unloaded, e, x);
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
        let of_body = (body.reference(), body.pattern().as_ref());
        let ring = anatomy
            .right
            .as_ref()
            .map_or(&anatomy.rim, |right| &right.left_ring);
        let left = (&anatomy.endocardium, &anatomy.openings[..], ring);
        let cavity = chamber(
            "endocardium",
            left,
            self.valve_plane,
            of_body,
            comm.as_ref(),
        )?;
        let right = match (&self.right_pressure, &anatomy.right) {
            (None, _) => None,
            (Some(_), Some(right)) => {
                let surfaces = (&right.endocardium, &right.openings[..], &right.ring);
                Some(chamber(
                    "right ventricle",
                    surfaces,
                    self.valve_plane,
                    of_body,
                    comm.as_ref(),
                )?)
            }
            (Some(_), None) => {
                let (name, purpose) = (
                    surface_names::RIGHT_VENTRICLE.to_owned(),
                    "the right ventricle's pressure",
                );
                return Err(WallError::NoSurface { name, purpose });
            }
        };
        let mut dynamics = Dynamics::new(body, comm, self.scheme());
        dynamics.cavity = Some(cavity);
        dynamics
            .given_cavities
            .extend(right.map(|cavity| GivenCavity {
                cavity,
                pressure_kpa: 0.0,
            }));
        dynamics.elements.clone_from(&part.elements);
        let mut rest = displacement(&anatomy.nodes, unloaded);
        rest.iter_mut()
            .zip(anchor)
            .for_each(|(rest, anchor)| *rest += anchor);
        let none = Spring {
            stiffness: 0.0,
            damping: 0.0,
        };
        let hold = Spring {
            stiffness: self.static_spring,
            damping: 0.0,
        };
        let held = Self {
            pericardium: none,
            rim: hold,
            surfaces: vec![],
            ..self.clone()
        };
        dynamics.supports =
            held.supports(anatomy, &anatomy.nodes, &rest, dynamics.body.pattern())?;
        Ok(dynamics)
    }

    /// Replaces static supports by the beat's supports and damping at an equilibrium `u`: all springs are at rest there, and
    /// the rim's springs keep the load of the static ones.
    ///
    /// # Errors
    /// [`WallError`] for an unusable or missing surface.
    pub fn support(
        &self,
        anatomy: &Anatomy,
        dynamics: &mut Dynamics,
        u: &[f64],
    ) -> Result<(), WallError> {
        let reference = dynamics.body.reference().iter().zip(u);
        let loaded: Vec<[f64; 3]> = reference
            .map(|(x, u)| x + u)
            .collect::<Vec<_>>()
            .as_chunks()
            .0
            .to_vec();
        let mut supports = self.supports(anatomy, &loaded, u, dynamics.body.pattern())?;
        let (held, share) = (
            &dynamics.supports[0].rest,
            self.static_spring / self.rim.stiffness,
        );
        supports[0].rest = u
            .iter()
            .zip(held)
            .map(|(u, held)| u - share * (u - held))
            .collect();
        dynamics.supports = supports;
        dynamics.damping = self.damping;
        Ok(())
    }

    /// Supports by pericardium, rim and surfaces with springs of their own: nodes are at `positions`, springs at rest at
    /// displacement `rest`.
    fn supports(
        &self,
        anatomy: &Anatomy,
        positions: &[[f64; 3]],
        rest: &[f64],
        pattern: &Pattern,
    ) -> Result<Vec<Support>, WallError> {
        let scaled =
            |x: [f64; 3]| 1.0 + (self.pericardial_base_share - 1.0) * anatomy.axis.height(x);
        let even = |_: [f64; 3]| 1.0;
        let surfaces: [Supported<'_>; 3] = [
            (
                "rim",
                Some(&anatomy.rim),
                RobinDirection::All,
                self.rim,
                &even,
            ),
            (
                "epicardium",
                Some(&anatomy.epicardium),
                RobinDirection::Normal,
                self.pericardium,
                &scaled,
            ),
            (
                "septum",
                anatomy.septum.as_ref(),
                RobinDirection::Normal,
                self.pericardium,
                &scaled,
            ),
        ];
        let mut supports = vec![];
        for (name, triangles, direction, Spring { stiffness, damping }, share) in surfaces {
            if let (Some(triangles), true) = (triangles, stiffness > 0.0 || damping > 0.0) {
                let robin = robin(
                    triangles,
                    direction,
                    positions.as_flattened(),
                    pattern,
                    share,
                )
                .map_err(|source| WallError::Surface { name, source })?;
                supports.push(Support {
                    robin,
                    spring: stiffness,
                    dashpot: damping,
                    rest: rest.to_vec(),
                });
            }
        }
        let acts = |of: &&SprungSurface| of.spring.stiffness > 0.0 || of.spring.damping > 0.0;
        for SprungSurface {
            name,
            spring: Spring { stiffness, damping },
        } in self.surfaces.iter().filter(acts)
        {
            let Some(triangles) = anatomy.surface(name) else {
                return Err(WallError::NoSurface {
                    name: name.clone(),
                    purpose: "its springs",
                });
            };
            let robin = robin(
                triangles,
                RobinDirection::Normal,
                positions.as_flattened(),
                pattern,
                &even,
            )
            .map_err(|source| WallError::Sprung {
                name: name.clone(),
                source,
            })?;
            supports.push(Support {
                robin,
                spring: *stiffness,
                dashpot: *damping,
                rest: rest.to_vec(),
            });
        }
        Ok(supports)
    }
}

/// Displacement from `from` to `to` \[mm\], three numbers a node.
pub(super) fn displacement(to: &[[f64; 3]], from: &[[f64; 3]]) -> Vec<f64> {
    to.as_flattened()
        .iter()
        .zip(from.as_flattened())
        .map(|(a, b)| a - b)
        .collect()
}

/// A supported surface: name, triangles, direction, spring, and the spring's share at a point.
type Supported<'a> = (
    &'static str,
    Option<&'a Triangles>,
    RobinDirection,
    Spring,
    &'a dyn Fn([f64; 3]) -> f64,
);

fn robin(
    triangles: &Triangles,
    direction: RobinDirection,
    reference: &[f64],
    pattern: &Pattern,
    share: &dyn Fn([f64; 3]) -> f64,
) -> Result<Robin, SurfaceError> {
    match triangles {
        Triangles::Linear(t) => Robin::weighted(t, direction, reference, pattern, share),
        Triangles::Quadratic(t) => Robin::weighted(t, direction, reference, pattern, share),
    }
}

/// A cavity inside an endocardium, with its valves on a ring. Collective.
fn chamber(
    name: &'static str,
    (endocardium, openings, ring): (&Triangles, &[Vec<u32>], &Triangles),
    valve_plane: ValvePlane,
    (reference, pattern): (&[f64], &Pattern),
    comm: &dyn Communicator,
) -> Result<Cavity, WallError> {
    let openings = openings.to_vec();
    let hangs = valve_plane == ValvePlane::HangsOnRim;
    match (endocardium, ring) {
        (Triangles::Linear(wall), Triangles::Linear(ring)) => Cavity::new(
            wall,
            openings,
            if hangs { ring } else { &[] },
            reference,
            pattern,
            comm,
        ),
        (Triangles::Quadratic(wall), Triangles::Quadratic(ring)) => Cavity::new(
            wall,
            openings,
            if hangs { ring } else { &[] },
            reference,
            pattern,
            comm,
        ),
        _ => Err(SurfaceError::Nodes { found: 0 }),
    }
    .map_err(|source| WallError::Surface { name, source })
}
