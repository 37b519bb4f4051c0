//! A deformable body of elements and tissues; forces and stiffness are assembled in one fixed order.

mod deformation;
mod passes;
mod transpose;

use std::sync::Arc;

use pulp::Arch;

use crate::element::batch::{ElementError, Frame, batches};
use crate::element::kernel::{ActivePoint, VolumeChange};
use crate::element::{BATCH, Eight};
use crate::linear::{Assembled, PackedTangent};
use crate::material::{MaterialError, Tissue, VolumetricLaw};
use cardiotwin_linalg::parallel::{Communicator, Disagreement, Layout, agree};
use cardiotwin_linalg::{BlockCsr, CondensedMatrix, Coupling, Pattern};
use passes::{Elements, Field, Moving, Pass};

pub use deformation::Deformation;

/// Reasons why a body could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BodyError {
    /// A tissue's parameter is out of range.
    #[error("invalid material of tissue {tissue}")]
    Material {
        /// Position in the list of tissues.
        tissue: usize,
        /// Invalid parameter of the tissue.
        source: MaterialError,
    },
    /// An element is unusable.
    #[error("invalid mesh")]
    Element(#[from] ElementError),
    /// A list has the wrong length or refers to a missing tissue.
    #[error("{what}: found {found}, expected {expected}")]
    Size {
        /// Name of the list.
        what: &'static str,
        /// Number or length found.
        found: usize,
        /// Number or length expected.
        expected: usize,
    },
    /// The body could not be built on another rank.
    #[error("{reason}")]
    Elsewhere {
        /// Description of the rank and its failure.
        reason: String,
    },
    /// Quadratic elements were requested on several ranks.
    #[error("quadratic elements run on one rank only; use linear elements or one rank")]
    QuadraticOnRanks,
}

/// Mesh, tissues and fibres of a body.
pub struct BodyInput<'a, const N: usize> {
    /// Node coordinates \[mm\]; vertices first where elements are quadratic.
    pub nodes: &'a [[f64; 3]],
    /// Number of vertices among the nodes, all of them for linear elements.
    pub n_vertices: usize,
    /// Nodes of each element.
    pub tets: &'a [[u32; N]],
    /// Tissues that elements refer to.
    pub tissues: Vec<Tissue>,
    /// Tissue of each element.
    pub tissue_of: &'a [usize],
    /// Fibre frame at a point of an element (element, coordinates \[mm\]).
    pub frame: &'a dyn Fn(usize, [f64; 3]) -> Frame,
    /// Resistance of the elements to a change of volume.
    pub volume: VolumeChange,
    /// Nodes that this rank owns, and its neighbours.
    pub layout: Layout,
    /// Mesh number of each element, for error messages; empty if the numbers agree.
    pub elements: &'a [u32],
}

/// Elements and tissues, assembled on this rank's nodes.
pub struct Body {
    elements: Box<dyn Elements>,
    tissues: Vec<Tissue>,
    volume: VolumeChange,
    reference: Vec<f64>,
    layout: Layout,
    pattern: Arc<Pattern>,
    coupling_pattern: Option<Arc<Pattern>>,
    /// Reference volume, bulk modulus and volumetric law of each vertex.
    vertices: Vec<(f64, f64, VolumetricLaw)>,
    /// Viscosity of each tissue \[kPa·ms\]; empty without viscosity.
    viscosity_kpa_ms: Vec<f64>,
    arch: Arch,
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Body")
            .field("n_nodes", &self.n_nodes())
            .field("volume", &self.volume)
            .finish_non_exhaustive()
    }
}

impl Body {
    /// Builds a body of linear tetrahedra with one integration point each. Collective.
    ///
    /// # Errors
    /// [`BodyError`] for a bad tissue, element or list length.
    pub fn linear(input: &BodyInput<'_, 4>, comm: &dyn Communicator) -> Result<Self, BodyError> {
        Self::new::<4, 1>(input, comm)
    }

    /// Builds a body of quadratic tetrahedra with four integration points each.
    ///
    /// # Errors
    /// [`BodyError`] for a bad tissue, element or list length.
    pub fn quadratic(
        input: &BodyInput<'_, 10>,
        comm: &dyn Communicator,
    ) -> Result<Self, BodyError> {
        Self::new::<10, 4>(input, comm)
    }

    fn new<const N: usize, const Q: usize>(
        input: &BodyInput<'_, N>,
        comm: &dyn Communicator,
    ) -> Result<Self, BodyError> {
        let size = |what, found, expected| {
            Err(BodyError::Size {
                what,
                found,
                expected,
            })
        };
        for (tissue, t) in input.tissues.iter().enumerate() {
            t.check()
                .map_err(|source| BodyError::Material { tissue, source })?;
        }
        if input.tissue_of.len() != input.tets.len() {
            return size(
                "tissues of elements",
                input.tissue_of.len(),
                input.tets.len(),
            );
        }
        if let Some(&tissue) = input.tissue_of.iter().find(|t| **t >= input.tissues.len()) {
            return size(
                "highest tissue that an element names",
                tissue,
                input.tissues.len().saturating_sub(1),
            );
        }
        if input.layout.n_local != input.nodes.len() {
            return size(
                "nodes of the layout",
                input.layout.n_local,
                input.nodes.len(),
            );
        }
        // Ranks exchange averages at vertices only, and mid-edge nodes are none.
        if N != 4 && !input.layout.neighbours.is_empty() {
            return Err(BodyError::QuadraticOnRanks);
        }
        let batches = batches::<N, Q>(input.nodes, input.tets, input.tissue_of, input.frame)
            .map_err(|error| error.renumbered(input.elements));
        let batches = agree(comm, batches).map_err(|error| match error {
            Disagreement::Here(error) => BodyError::Element(error),
            Disagreement::Elsewhere(reason) => BodyError::Elsewhere { reason },
        })?;
        let n_rows = input.layout.n_owned;
        let pattern = Arc::new(Pattern::of_elements(
            n_rows,
            input.tets.iter().map(|t| (&t[..], &t[..])),
        ));
        let coupling_pattern = (input.volume != VolumeChange::Pointwise).then(|| match N {
            4 => pattern.clone(),
            _ => Arc::new(Pattern::of_elements(
                n_rows,
                input.tets.iter().map(|t| (&t[..], &t[..4])),
            )),
        });
        let field = Field::new(batches, &pattern, coupling_pattern.as_deref());
        let mut body = Self {
            elements: Box::new(field),
            tissues: input.tissues.clone(),
            volume: input.volume,
            reference: input.nodes.as_flattened().to_vec(),
            layout: input.layout.clone(),
            pattern,
            coupling_pattern,
            vertices: vec![],
            viscosity_kpa_ms: vec![],
            arch: Arch::new(),
        };
        if input.volume != VolumeChange::Pointwise {
            body.vertices = body.vertex_averages(input, comm);
        }
        Ok(body)
    }

    /// Volume, volume-weighted κ and volumetric law of the largest share of the elements around each vertex.
    fn vertex_averages<const N: usize>(
        &self,
        input: &BodyInput<'_, N>,
        comm: &dyn Communicator,
    ) -> Vec<(f64, f64, VolumetricLaw)> {
        let n = input.n_vertices;
        let mut volume = vec![vec![0.0; n]; self.tissues.len()];
        let shape = crate::element::shape::tetrahedron_rule(self.elements.n_points());
        for batch in 0..self.elements.n_batches() {
            let (n_lanes, elements) = self.elements.lanes(batch);
            for (q, (l, _)) in shape.iter().enumerate() {
                let weight = self.elements.point_weight(batch, q);
                for lane in 0..n_lanes {
                    let e = elements[lane] as usize;
                    for v in 0..4 {
                        volume[input.tissue_of[e]][input.tets[e][v] as usize] +=
                            l[v] * weight[lane];
                    }
                }
            }
        }
        let mut numbers = Vec::with_capacity(3 * n);
        for v in 0..n {
            let total: f64 = volume.iter().map(|of| of[v]).sum();
            let kappa = volume
                .iter()
                .zip(&self.tissues)
                .map(|(of, t)| of[v] * t.volumetric.kappa_kpa)
                .sum::<f64>();
            let most = (0..self.tissues.len())
                .fold(0, |m, t| if volume[t][v] > volume[m][v] { t } else { m });
            numbers.extend([total, kappa / total.max(f64::MIN_POSITIVE), most as f64]);
        }
        if !self.layout.neighbours.is_empty() {
            comm.update_ghosts(&self.layout, 3, &mut numbers);
        }
        let vertex = |[total, kappa, most]: &[f64; 3]| {
            (*total, *kappa, self.tissues[*most as usize].volumetric.law)
        };
        numbers.as_chunks::<3>().0.iter().map(vertex).collect()
    }

    /// Number of nodes held by this rank.
    #[must_use]
    pub fn n_nodes(&self) -> usize {
        self.reference.len() / 3
    }

    /// Nodes that this rank owns, and its neighbours.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Reference coordinates \[mm\], three numbers a node.
    #[must_use]
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// Sparsity pattern of the stiffness.
    #[must_use]
    pub fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    /// Batches times integration points, the length of every list over point batches.
    #[must_use]
    pub fn n_point_batches(&self) -> usize {
        self.elements.n_batches() * self.elements.n_points()
    }

    /// Number of lanes in use, and their elements, in point batch `idx`.
    #[must_use]
    pub fn point_lanes(&self, idx: usize) -> (usize, &[u32; BATCH]) {
        self.elements.lanes(idx / self.elements.n_points())
    }

    /// Reference volume \[mm³\] of each lane of point batch `idx`.
    #[must_use]
    pub fn point_volume(&self, idx: usize) -> &Eight {
        self.elements.point_weight(
            idx / self.elements.n_points(),
            idx % self.elements.n_points(),
        )
    }

    /// Linear shape functions of the vertices at the integration point of point batch `idx`.
    #[must_use]
    pub fn vertex_shape(&self, idx: usize) -> [f64; 4] {
        self.elements.vertex_shape(idx % self.elements.n_points())
    }

    /// A zero tangent with the body's sparsity pattern.
    #[must_use]
    pub fn new_tangent(&self) -> CondensedMatrix {
        CondensedMatrix {
            stiffness: BlockCsr::zeros(self.pattern.clone()),
            coupling: self.coupling_pattern.clone().map(Coupling::zeros),
            bulk: vec![0.0; self.vertices.len()],
        }
    }

    /// A zero tangent in single precision; `None` for quadratic elements.
    #[must_use]
    pub fn new_packed_tangent(&self) -> Option<PackedTangent> {
        let every_node_is_a_vertex =
            self.vertices.is_empty() || self.vertices.len() == self.n_nodes();
        (every_node_is_a_vertex && self.elements.n_points() == 1)
            .then(|| PackedTangent::zeros(self.pattern.clone()))
    }

    fn pass<'a>(
        &'a self,
        displacement: &'a [f64],
        active: &'a [ActivePoint],
        deformation: &'a [f64],
    ) -> Pass<'a> {
        Pass {
            arch: self.arch,
            tissues: &self.tissues,
            volume: self.volume,
            reference: &self.reference,
            displacement,
            nodal_pressure: deformation,
            active,
            motion: Moving::default(),
            stiffness_factor: 1.0,
        }
    }

    /// Computes volume ratios, stretches and nodal pressures at `displacement` \[mm\], three numbers a node with current
    /// ghosts. Collective.
    pub fn deform(&self, displacement: &[f64], comm: &dyn Communicator, out: &mut Deformation) {
        out.volume_ratio
            .resize(self.n_point_batches(), [1.0; BATCH]);
        out.squared_stretch
            .resize(self.n_point_batches(), [1.0; BATCH]);
        let mut volume = vec![0.0; self.vertices.len()];
        self.elements
            .volumes(&self.pass(displacement, &[], &[]), out, &mut volume);
        if !self.layout.neighbours.is_empty() && !volume.is_empty() {
            comm.update_ghosts(&self.layout, 1, &mut volume);
        }
        let nodal_share = 1.0 - self.volume.pointwise();
        out.nodal_pressure.clear();
        out.nodal_slope.clear();
        for ((reference, kappa, law), volume) in self.vertices.iter().zip(volume) {
            let (p, slope) = law.slopes(volume / reference);
            out.nodal_pressure.push(nodal_share * kappa * p);
            out.nodal_slope
                .push(nodal_share * kappa * slope / reference);
        }
    }

    /// Computes the squared fibre stretch `C₁₁` alone, at a `displacement` other than that of the internal forces.
    pub fn stretch(&self, displacement: &[f64], out: &mut Vec<Eight>) {
        out.resize(self.n_point_batches(), [1.0; BATCH]);
        self.elements
            .squared_stretches(&self.pass(displacement, &[], &[]), out);
    }

    /// Lumped mass of each node \[mg\]; complete on owned nodes only.
    #[must_use]
    pub fn masses(&self) -> Vec<f64> {
        let mut mass = vec![0.0; self.n_nodes()];
        self.elements.add_masses(&self.tissues, &mut mass);
        mass
    }

    /// This rank's share of the strain energy \[µJ\] at `displacement`, without active stress. A slow method for energy
    /// balances.
    #[must_use]
    pub fn strain_energy(&self, displacement: &[f64]) -> f64 {
        let pass = self.pass(displacement, &[], &[]);
        let mut volume = vec![0.0; self.vertices.len()];
        self.elements
            .volumes(&pass, &mut self.points(), &mut volume);
        let nodal_share = 1.0 - self.volume.pointwise();
        let n_owned = self.layout.n_owned;
        let nodal: f64 = (self.vertices.iter().zip(volume).take(n_owned))
            .map(|((reference, kappa, law), volume)| {
                nodal_share * kappa * reference * law.energy(volume / reference)
            })
            .sum();
        self.elements.energy(&pass, n_owned) + nodal
    }

    fn points(&self) -> Deformation {
        Deformation {
            volume_ratio: vec![[1.0; BATCH]; self.n_point_batches()],
            squared_stretch: vec![[1.0; BATCH]; self.n_point_batches()],
            ..Deformation::default()
        }
    }

    /// Sets the viscosity `η` \[kPa·ms\] of each tissue, `S = η Ė`, used where velocities are given
    /// ([`Self::add_forces_in_motion`]). An empty list removes it.
    ///
    /// # Errors
    /// [`BodyError`] for a viscosity that is negative or not finite, or a list of the wrong length.
    pub fn set_viscosity(&mut self, of_tissue_kpa_ms: Vec<f64>) -> Result<(), BodyError> {
        if !of_tissue_kpa_ms.is_empty() && of_tissue_kpa_ms.len() != self.tissues.len() {
            let (found, expected) = (of_tissue_kpa_ms.len(), self.tissues.len());
            return Err(BodyError::Size {
                what: "viscosities of tissues",
                found,
                expected,
            });
        }
        for (tissue, value) in of_tissue_kpa_ms.iter().enumerate() {
            if !(*value >= 0.0 && value.is_finite()) {
                let (name, expected) = ("viscosity_kPa_ms", "zero or more, and finite");
                return Err(BodyError::Material {
                    tissue,
                    source: MaterialError {
                        name,
                        value: *value,
                        expected,
                    },
                });
            }
        }
        self.viscosity_kpa_ms = of_tissue_kpa_ms;
        Ok(())
    }

    /// Whether any tissue is viscous.
    #[must_use]
    pub fn is_viscous(&self) -> bool {
        self.viscosity_kpa_ms.iter().any(|eta| *eta > 0.0)
    }

    /// Adds internal forces \[mN\] at `displacement` and its [`Deformation`]; complete on owned nodes only.
    ///
    /// - `active`: active stress of each point batch; empty for none
    pub fn add_forces(
        &self,
        displacement: &[f64],
        active: &[ActivePoint],
        deformation: &Deformation,
        force: &mut [f64],
    ) {
        self.add_forces_in_motion(displacement, &[], active, deformation, force);
    }

    /// As [`Self::add_forces`], with viscous stress at `velocity` \[mm/ms\]; an empty `velocity` stands for a body at rest.
    pub fn add_forces_in_motion(
        &self,
        displacement: &[f64],
        velocity: &[f64],
        active: &[ActivePoint],
        deformation: &Deformation,
        force: &mut [f64],
    ) {
        let mut pass = self.pass(displacement, active, &deformation.nodal_pressure);
        pass.motion = Moving {
            velocity,
            viscosity_kpa_ms: &self.viscosity_kpa_ms,
            velocity_rate_per_ms: 0.0,
        };
        self.elements.forces(&pass, force);
    }

    /// As [`Self::add_forces`]; also overwrites `tangent` with the derivative \[mN/mm\].
    pub fn tangent(
        &self,
        displacement: &[f64],
        active: &[ActivePoint],
        deformation: &Deformation,
        force: &mut [f64],
        tangent: &mut dyn Assembled,
    ) {
        self.tangent_in_motion(
            displacement,
            (&[], 0.0),
            active,
            deformation,
            force,
            (1.0, tangent),
        );
    }

    /// As [`Self::tangent`], with viscous stress and a factor of the tangent; the velocity comes with its derivative `∂v/∂u`
    /// \[1/ms\]. The viscous part of the tangent is exact at zero velocity (see [`crate::element::kernel::element`]).
    pub fn tangent_in_motion(
        &self,
        displacement: &[f64],
        (velocity, velocity_rate_per_ms): (&[f64], f64),
        active: &[ActivePoint],
        deformation: &Deformation,
        force: &mut [f64],
        (factor, tangent): (f64, &mut dyn Assembled),
    ) {
        tangent.clear(&mut deformation.nodal_slope.iter().map(|d| factor * d));
        let mut pass = self.pass(displacement, active, &deformation.nodal_pressure);
        pass.motion = Moving {
            velocity,
            viscosity_kpa_ms: &self.viscosity_kpa_ms,
            velocity_rate_per_ms,
        };
        pass.stiffness_factor = factor;
        self.elements.tangent(&pass, force, tangent.sink());
    }
}

#[cfg(test)]
mod tests;
