//! The equation of motion of a body with inertia, damping, supports and a cavity.
//!
//! `M a + G(u, v) = 0`, `G = α_M M v + f(u + τ v) + Σ (k R (u − u₀) + c R v) + p q(u)`, with `M` lumped, `f` the internal
//! forces, `R` the matrices of springs and dashpots and `q` the load of unit pressure. Evaluating `f` at `u + τ v` is
//! Rayleigh's damping proportional to stiffness, `τ K(u) v` to first order in `τ`, with the tangent of the present state: it
//! does not resist rotation, needs no second matrix, and has the exact tangent `(1 + τ ∂v/∂u) K`.
//!
//! The damping is of the tissue, not of its cells: these see the fibre stretch `λ(u)` of the true displacement, not that of
//! `u + τ v`, and the tension that they answer with is what `f` is given. So `K` above is the stiffness at a given tension.
//! Its share by `∂Ta/∂λ` is per unit of `u`, not of `u + τ v`, so that [`Dynamics::linearise`] divides the slope by
//! `1 + τ ∂v/∂u`. That share pulls along the fibre of `u + τ v` by a stretch along the fibre of `u`; the tangent has the first
//! for both, which keeps it symmetric, and is off by the angle that the fibre turns by in the time `τ`: a thousandth or so.

use cardiotwin_linalg::parallel::{Communicator, VectorLayout};
use serde::{Deserialize, Serialize};

use crate::body::{Body, Deformation};
use crate::boundary::{Cavity, PressureSurface, Robin};
use crate::element::kernel::ActivePoint;
use crate::linear::Assembled;
use crate::newton::Smallest;
use crate::time_integration::{GeneralisedAlpha, Motion};

/// Rayleigh's damping, proportional to mass and to stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rayleigh {
    /// Coefficient α_M of the mass \[1/ms\].
    pub mass_per_ms: f64,
    /// Coefficient τ of the stiffness \[ms\].
    pub stiffness_ms: f64,
}

impl Rayleigh {
    /// No damping.
    pub const NONE: Self = Self {
        mass_per_ms: 0.0,
        stiffness_ms: 0.0,
    };
}

/// Springs and dashpots on a surface.
#[derive(Debug, Clone)]
pub struct Support {
    /// Matrix of the surface and the direction.
    pub robin: Robin,
    /// Stiffness of the springs per area \[kPa/mm\].
    pub spring: f64,
    /// Damping of the dashpots per area \[kPa·ms/mm\].
    pub dashpot: f64,
    /// Displacement at which the springs are at rest \[mm\], three a node; empty for zero.
    pub rest: Vec<f64>,
}

/// A surface under a prescribed pressure.
#[derive(Debug, Clone)]
pub struct SurfaceLoad {
    /// Surface on which the pressure acts.
    pub surface: PressureSurface,
    /// Pressure at the end of the step in hand \[kPa\]; set before each step.
    pub pressure_kpa: f64,
}

/// A cavity at a prescribed pressure, which is not solved for.
#[derive(Debug, Clone)]
pub struct GivenCavity {
    /// Wall and openings of the cavity.
    pub cavity: Cavity,
    /// Pressure at the end of the step in hand \[kPa\]; set before each step, alike on all ranks.
    pub pressure_kpa: f64,
}

/// The moving body with its supports and loads, which stay the same from step to step.
#[derive(Debug)]
pub struct Dynamics {
    /// Body that moves.
    pub body: Body,
    /// Communicator of the ranks, for sums over all of them.
    pub comm: Box<dyn Communicator>,
    /// Scheme of the time integration.
    pub scheme: GeneralisedAlpha,
    /// Damping of the tissue.
    pub damping: Rayleigh,
    /// Springs and dashpots on surfaces.
    pub supports: Vec<Support>,
    /// Cavity whose pressure is unknown, where there is one.
    pub cavity: Option<Cavity>,
    /// Surfaces under prescribed pressures, next to the cavity's. The tangent takes the symmetric part of their load's.
    pub loads: Vec<SurfaceLoad>,
    /// Further cavities at prescribed pressures.
    pub given_cavities: Vec<GivenCavity>,
    /// Components that are held at zero, one entry a node; empty for none.
    pub fixed: Vec<[bool; 3]>,
    /// Number in the whole mesh of each element of this rank; empty where it is the same.
    pub elements: Vec<u32>,
    mass: Vec<f64>,
}

/// A state of motion with its forces, from which the next step starts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct State {
    /// Displacement, velocity and acceleration of all nodes.
    pub motion: Motion,
    /// `G` at this state \[mN\].
    pub force: Vec<f64>,
    /// Pressure in the cavity \[kPa\].
    pub pressure_kpa: f64,
}

/// A candidate for the end of a step.
#[derive(Debug, Clone, Default)]
pub struct Candidate {
    /// Displacement, velocity and acceleration at the end of the step.
    pub motion: Motion,
    /// Displacement at which internal forces are taken, `u + τ v` \[mm\].
    pub shifted: Vec<f64>,
    /// Deformation at that displacement; the fibre stretch alone is that of `u`.
    pub deformation: Deformation,
    /// Active stress for the stretch of `u`, and its slope in that stretch, one a point batch;
    /// empty for none.
    pub active: Vec<ActivePoint>,
    /// Load of the cavity's unit pressure at the displacement \[mN/kPa\]; empty without a cavity.
    pub load: Vec<f64>,
    /// Pressure in the cavity at the end of the step \[kPa\].
    pub pressure_kpa: f64,
}

impl Candidate {
    /// Sets the displacement to `start − share x`.
    pub(crate) fn subtract(&mut self, start: &[f64], share: f64, x: &[f64]) {
        for (u, (start, x)) in self.motion.u.iter_mut().zip(start.iter().zip(x)) {
            *u = start - share * x;
        }
    }
}

/// `to += k from`.
pub(crate) fn add_times(k: f64, from: &[f64], to: &mut [f64]) {
    to.iter_mut()
        .zip(from)
        .for_each(|(to, from)| *to += k * from);
}

impl Dynamics {
    /// A body free of damping, supports and cavity; fill in what there is.
    #[must_use]
    pub fn new(body: Body, comm: Box<dyn Communicator>, scheme: GeneralisedAlpha) -> Self {
        let mut mass = body.masses();
        comm.update_ghosts(body.layout(), 1, &mut mass);
        Self {
            body,
            comm,
            scheme,
            damping: Rayleigh::NONE,
            supports: vec![],
            cavity: None,
            loads: vec![],
            given_cavities: vec![],
            fixed: vec![],
            elements: vec![],
            mass,
        }
    }

    /// Vectors of the body.
    #[must_use]
    pub fn space(&self) -> VectorLayout<'_> {
        VectorLayout {
            comm: self.comm.as_ref(),
            layout: self.body.layout(),
        }
    }

    /// Lumped mass of each node \[mg\].
    #[must_use]
    pub fn masses(&self) -> &[f64] {
        &self.mass
    }

    /// Cavity volume \[mm³\]; zero without a cavity. Collective.
    #[must_use]
    pub fn cavity_volume(&self, u: &[f64]) -> f64 {
        self.cavity.as_ref().map_or(0.0, |c| {
            c.volume(self.comm.as_ref(), self.body.reference(), u)
        })
    }

    /// Completes a candidate from its displacement: velocity, acceleration, deformation. Collective.
    pub fn complete(&self, dt_ms: f64, now: &State, candidate: &mut Candidate) -> Smallest {
        self.space().update(&mut candidate.motion.u);
        self.scheme
            .advance(dt_ms, &now.motion, &mut candidate.motion);
        self.deform(candidate)
    }

    fn deform(&self, candidate: &mut Candidate) -> Smallest {
        let tau = self.damping.stiffness_ms;
        let Motion { u, v, .. } = &candidate.motion;
        candidate.shifted.clear();
        candidate
            .shifted
            .extend(u.iter().zip(v).map(|(u, v)| u + tau * v));
        self.body.deform(
            &candidate.shifted,
            self.comm.as_ref(),
            &mut candidate.deformation,
        );
        if tau != 0.0 {
            self.body
                .stretch(u, &mut candidate.deformation.squared_stretch);
        }
        if let Some(cavity) = &self.cavity {
            candidate.load.clear();
            candidate.load.resize(candidate.motion.u.len(), 0.0);
            let (comm, reference) = (self.comm.as_ref(), self.body.reference());
            cavity.add_forces(
                comm,
                1.0,
                reference,
                &candidate.motion.u,
                &mut candidate.load,
            );
        }
        self.smallest(candidate.deformation.smallest)
    }

    /// The smallest volume ratio over ranks, NaN as minus infinity; where it is worth a word, with its element's number in the
    /// whole mesh. Collective.
    fn smallest(&self, (ratio, element): (f64, usize)) -> Smallest {
        let own = if ratio.is_nan() {
            f64::INFINITY
        } else {
            -ratio
        };
        let mut largest = [own];
        self.comm.max(&mut largest);
        let mut element = self.elements.get(element).map_or(element, |e| *e as usize);
        if largest[0] > -0.5 && self.comm.n_ranks() > 1 {
            let mut lowest = [if own == largest[0] {
                -(element as f64)
            } else {
                f64::NEG_INFINITY
            }];
            self.comm.max(&mut lowest);
            element = -lowest[0] as usize;
        }
        Smallest {
            volume_ratio: -largest[0],
            element,
        }
    }

    /// `G` without internal forces and pressure, added to `force`.
    fn add_linear_forces(&self, motion: &Motion, force: &mut [f64]) {
        let k = self.damping.mass_per_ms;
        if k != 0.0 {
            for (node, mass) in self.mass.iter().enumerate() {
                (3 * node..3 * node + 3).for_each(|i| force[i] += k * mass * motion.v[i]);
            }
        }
        for support in &self.supports {
            if support.rest.is_empty() {
                support.robin.add_forces(support.spring, &motion.u, force);
            } else {
                let u: Vec<f64> = motion
                    .u
                    .iter()
                    .zip(&support.rest)
                    .map(|(u, r)| u - r)
                    .collect();
                support.robin.add_forces(support.spring, &u, force);
            }
            if support.dashpot != 0.0 {
                support.robin.add_forces(support.dashpot, &motion.v, force);
            }
        }
    }

    /// Loads of the further cavities, added to `force`. Collective where one of them has a pressure.
    fn add_given_cavities(&self, u: &[f64], force: &mut [f64]) {
        for GivenCavity {
            cavity,
            pressure_kpa,
        } in self
            .given_cavities
            .iter()
            .filter(|given| given.pressure_kpa != 0.0)
        {
            cavity.add_forces(
                self.comm.as_ref(),
                *pressure_kpa,
                self.body.reference(),
                u,
                force,
            );
        }
    }

    /// `q`, the derivative of `G` with respect to the pressure, overwriting `out` \[mN/kPa\].
    pub fn pressure_column(&self, candidate: &Candidate, out: &mut Vec<f64>) {
        out.clone_from(&candidate.load);
        out.resize(candidate.motion.u.len(), 0.0);
        self.hold(out);
    }

    /// Size of the forces that a residual is compared with \[mN\]: the norms of the loads of cavity and surfaces, at pressures of
    /// at least `least_kpa`; where there are none, that of `force`, but at least that of `least_kpa` on a face of the body's
    /// bounding cube. `column` is the load of the cavity's unit pressure. Collective.
    #[must_use]
    pub fn force_scale(
        &self,
        candidate: &Candidate,
        column: &[f64],
        force: &[f64],
        least_kpa: f64,
    ) -> f64 {
        let unit = self.space().norm(column);
        let mut scale = if unit > 0.0 {
            least_kpa.max(candidate.pressure_kpa.abs()) * unit
        } else {
            0.0
        };
        let mut of_load = vec![0.0; force.len()];
        for load in &self.loads {
            of_load.fill(0.0);
            load.surface.add_forces(
                1.0,
                self.body.reference(),
                &candidate.motion.u,
                &mut of_load,
            );
            scale += least_kpa.max(load.pressure_kpa.abs()) * self.space().norm(&of_load);
        }
        if scale > 0.0 {
            return scale;
        }
        let mut size = [0.0];
        let (first, _) = self
            .body
            .reference()
            .split_at(3.min(self.body.reference().len()));
        for x in self.body.reference().as_chunks::<3>().0 {
            size[0] = (0..3).fold(size[0], |m: f64, i| m.max((x[i] - first[i]).abs()));
        }
        self.comm.max(&mut size);
        let mut count = [self.mass.len() as f64];
        self.comm.sum(&mut count);
        (least_kpa * size[0] * size[0] / count[0].sqrt())
            .max(self.space().norm(force))
            .max(f64::MIN_POSITIVE)
    }

    /// The cavity volume's gradient, overwriting `out` \[mm²\]. Collective.
    pub fn volume_row(&self, candidate: &Candidate, out: &mut Vec<f64>) {
        out.clear();
        out.resize(candidate.motion.u.len(), 0.0);
        if let Some(cavity) = &self.cavity {
            let (comm, reference) = (self.comm.as_ref(), self.body.reference());
            cavity.add_volume_gradient(comm, 1.0, reference, &candidate.motion.u, out);
        }
        self.hold(out);
    }

    /// Zeroes the held components.
    pub(crate) fn hold<T: Default>(&self, r: &mut [T]) {
        for (r, fixed) in r.as_chunks_mut::<3>().0.iter_mut().zip(&self.fixed) {
            for i in 0..3 {
                if fixed[i] {
                    r[i] = T::default();
                }
            }
        }
    }

    /// Turns `G` at the candidate into the residual of the step.
    fn weigh(&self, now: &State, candidate: &Candidate, force: &[f64], r: &mut [f64]) {
        let GeneralisedAlpha {
            alpha_m, alpha_f, ..
        } = self.scheme;
        for (node, mass) in self.mass.iter().enumerate() {
            for i in 3 * node..3 * node + 3 {
                let a = (1.0 - alpha_m) * candidate.motion.a[i] + alpha_m * now.motion.a[i];
                r[i] = mass * a + (1.0 - alpha_f) * force[i] + alpha_f * now.force[i];
            }
        }
        self.hold(r);
    }

    /// `G` at a complete candidate, overwriting `force`. Collective.
    pub fn forces(&self, candidate: &Candidate, force: &mut [f64]) {
        force.fill(0.0);
        let velocity = if self.body.is_viscous() {
            &candidate.motion.v[..]
        } else {
            &[]
        };
        let Candidate {
            shifted,
            active,
            deformation,
            ..
        } = candidate;
        self.body
            .add_forces_in_motion(shifted, velocity, active, deformation, force);
        self.add_linear_forces(&candidate.motion, force);
        for load in &self.loads {
            load.surface.add_forces(
                load.pressure_kpa,
                self.body.reference(),
                &candidate.motion.u,
                force,
            );
        }
        self.add_given_cavities(&candidate.motion.u, force);
        add_times(candidate.pressure_kpa, &candidate.load, force);
    }

    /// The step's residual at a complete candidate \[mN\], complete on owned nodes; `force` becomes `G`.
    pub fn residual(&self, now: &State, candidate: &Candidate, force: &mut [f64], r: &mut [f64]) {
        self.forces(candidate, force);
        self.weigh(now, candidate, force, r);
    }

    /// As [`Self::residual`], with the derivative with respect to the candidate's displacement.
    pub fn linearise(
        &self,
        dt_ms: f64,
        now: &State,
        candidate: &Candidate,
        force: &mut [f64],
        r: &mut [f64],
        tangent: &mut dyn Assembled,
    ) {
        force.fill(0.0);
        let velocity_rate = self.scheme.velocity_rate(dt_ms);
        let alpha_f = self.scheme.alpha_f;
        // Strain is taken at u + τ v: all of the tangent is per unit of that, but for what active stress answers to λ(u).
        let per_shift = 1.0 + self.damping.stiffness_ms * velocity_rate;
        let velocity = if self.body.is_viscous() {
            &candidate.motion.v[..]
        } else {
            &[]
        };
        let Candidate {
            shifted,
            active,
            deformation,
            ..
        } = candidate;
        let moving = (velocity, velocity_rate / per_shift);
        let per_shifted = |at: &ActivePoint| ActivePoint {
            slope_kpa: at.slope_kpa.map(|slope| slope / per_shift),
            ..*at
        };
        let active: Vec<ActivePoint> = active.iter().map(per_shifted).collect();
        let factor = (1.0 - alpha_f) * per_shift;
        self.body.tangent_in_motion(
            shifted,
            moving,
            &active,
            deformation,
            force,
            (factor, &mut *tangent),
        );
        self.add_linear_forces(&candidate.motion, force);
        for support in &self.supports {
            let k = support.spring + support.dashpot * velocity_rate;
            support.robin.add_tangent((1.0 - alpha_f) * k, tangent);
        }
        for load in &self.loads {
            let (p, reference) = (load.pressure_kpa, self.body.reference());
            load.surface
                .add_forces(p, reference, &candidate.motion.u, force);
            load.surface.add_symmetric_tangent(
                (1.0 - alpha_f) * p,
                reference,
                &candidate.motion.u,
                tangent,
            );
        }
        self.add_given_cavities(&candidate.motion.u, force);
        for GivenCavity {
            cavity,
            pressure_kpa,
        } in self
            .given_cavities
            .iter()
            .filter(|given| given.pressure_kpa != 0.0)
        {
            let p = (1.0 - alpha_f) * pressure_kpa;
            cavity.add_tangent(p, self.body.reference(), &candidate.motion.u, tangent);
        }
        if let Some(cavity) = &self.cavity {
            let (p, reference) = (candidate.pressure_kpa, self.body.reference());
            add_times(p, &candidate.load, force);
            cavity.add_tangent((1.0 - alpha_f) * p, reference, &candidate.motion.u, tangent);
        }
        let inertia = (1.0 - self.scheme.alpha_m) * self.scheme.acceleration_rate(dt_ms)
            + (1.0 - alpha_f) * self.damping.mass_per_ms * velocity_rate;
        for row in 0..tangent.pattern().n_rows() {
            tangent.add_to_diagonal(row, inertia * self.mass[row]);
        }
        self.weigh(now, candidate, force, r);
        if !self.fixed.is_empty() {
            let mean = tangent.mean_diagonal(self.space());
            tangent.constrain(&self.fixed, mean);
        }
    }

    /// A state at rest at displacement `u` under a pressure, whose acceleration balances what is not in equilibrium.
    ///
    /// # Errors
    /// The smallest volume ratio, where an element is inverted.
    pub fn start(
        &self,
        u: Vec<f64>,
        active: Vec<ActivePoint>,
        pressure_kpa: f64,
    ) -> Result<State, Smallest> {
        let mut candidate = Candidate {
            motion: Motion::at_rest(u),
            active,
            pressure_kpa,
            ..Candidate::default()
        };
        let smallest = self.deform(&mut candidate);
        if !(smallest.volume_ratio > 0.0) {
            return Err(smallest);
        }
        let mut force = vec![0.0; candidate.motion.u.len()];
        self.forces(&candidate, &mut force);
        let mut motion = candidate.motion;
        for (node, mass) in self.mass.iter().enumerate() {
            (3 * node..3 * node + 3).for_each(|i| motion.a[i] = -force[i] / mass);
        }
        self.hold(&mut motion.a);
        self.space().update(&mut motion.a);
        Ok(State {
            motion,
            force,
            pressure_kpa,
        })
    }
}
