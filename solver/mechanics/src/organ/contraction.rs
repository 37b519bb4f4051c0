//! A contraction model at every integration point of the muscle, implicit in the stretch.
//!
//! For each candidate of a time step the model receives the stretch of every point at the step's end, and returns the stress
//! and its total derivative, in which the model's states follow the stretch. Stress and states thus belong to the step's end,
//! and a model whose stress depends on the stretch rate (Land) keeps its stiffness in residual and tangent. The stabilising
//! term of staggered schemes (Regazzoni and Quarteroni 2021, Comput Methods Appl Mech Eng 373:113506) is the linear part of
//! this derivative.

use std::sync::Arc;

use cardiotwin_linalg::parallel::Communicator;
use cardiotwin_models::calcium::Calcium;
use cardiotwin_models::contraction::{
    ActiveStress, Contraction, ContractionError, EachStep, StretchReference,
};
use cardiotwin_models::effects::FibreViscosity;
use cardiotwin_models::ventricle::GroupContraction;

use super::anatomy::Anatomy;
use super::wall::WallParameters;
use crate::body::{Body, Deformation};
use crate::element::kernel::ActivePoint;
use crate::element::{BATCH, Eight};
use crate::material::ActiveConvention;
use crate::step::PointStress;

/// States of the points at the end of a step.
#[derive(Debug, Clone, Default)]
struct Points {
    /// Contraction states, ordered by point.
    cells: Vec<f64>,
    /// Stretch relative to the contraction model's reference length.
    lambda: Vec<f64>,
    /// Active stress as the model gives it \[kPa\].
    sa_kpa: Vec<f64>,
    /// Calcium concentration \[µM\]; empty for a model without calcium.
    ca_um: Vec<f64>,
}

/// A contraction model shared by the points of all ranks.
#[derive(Debug, Clone)]
pub(super) struct SharedModel {
    model: Arc<dyn Contraction>,
    calcium: Option<Arc<dyn Calcium>>,
    start: Vec<f64>,
    stretch: StretchReference,
}

impl SharedModel {
    pub fn new(contraction: GroupContraction) -> Self {
        let (model, calcium, start, stretch) = contraction.into_parts();
        Self {
            model: Arc::from(model),
            calcium,
            start,
            stretch,
        }
    }
}

/// A contraction model and its integration points.
#[derive(Debug)]
pub struct PointContraction {
    model: Arc<dyn Contraction>,
    calcium: Option<Arc<dyn Calcium>>,
    cycle_length_ms: f64,
    convention: ActiveConvention,
    viscosity: Option<FibreViscosity>,
    /// Position of each point: index of its batch of eight and lane in it.
    places: Vec<(u32, u8)>,
    n_batches: usize,
    activation_ms: Vec<f64>,
    /// Duration of contraction at each point, relative to mid-wall.
    duration: Vec<f64>,
    /// Fibre stretch at end-diastole from the unloaded state.
    lambda_ed: Vec<f64>,
    /// Stretch relative to the model's reference length, over that from the unloaded state.
    per_stretch: Vec<f64>,
    stretch: StretchReference,
    since_ms: Vec<f64>,
    stress: Vec<ActiveStress>,
    now: Points,
    trial: Points,
}

/// Marks a node that another rank owns.
const GHOST: u32 = u32::MAX;

/// Weights by which values at contracting points are averaged to nodes; they depend on the anatomy alone.
#[derive(Debug, Clone)]
pub(super) struct NodeAverage {
    /// Muscle nodes (vertices) that this rank owns.
    pub nodes: Vec<u32>,
    /// Share of the whole muscle's volume of each node.
    pub weights: Vec<f64>,
    /// For each point its four nodes (positions in `nodes`, or [`GHOST`]) and its volume times their shape function over the
    /// node's volume.
    shares: Vec<[(u32, f64); 4]>,
}

impl PointContraction {
    /// The model at all points of the muscle of `body`.
    ///
    /// - `wall`: convention of the active stress, and the ratio of contraction durations across the wall
    /// - `activation_ms`: activation time of each vertex of the mesh
    /// - `end_diastole`: deformation at end-diastole
    pub(super) fn new(
        contraction: &SharedModel,
        cycle_length_ms: f64,
        wall: &WallParameters,
        anatomy: &Anatomy,
        body: &Body,
        activation_ms: &[f64],
        end_diastole: &Deformation,
    ) -> Self {
        let SharedModel {
            model,
            calcium,
            start,
            stretch,
        } = contraction.clone();
        let (mut places, mut times, mut duration, mut lambda_ed) = (vec![], vec![], vec![], vec![]);
        let longer = 2.0 * (wall.epicardial_duration - 1.0) / (wall.epicardial_duration + 1.0);
        let n_batches = body.n_point_batches();
        for idx in 0..n_batches {
            let (n_lanes, elements) = body.point_lanes(idx);
            let shape = body.vertex_shape(idx);
            for lane in 0..n_lanes {
                let e = elements[lane] as usize;
                if anatomy.contracts[e] {
                    places.push((idx as u32, lane as u8));
                    let corners = anatomy.corners[e];
                    times.push(
                        (0..4)
                            .map(|k| shape[k] * activation_ms[corners[k] as usize])
                            .sum(),
                    );
                    let depth: f64 = (0..4)
                        .map(|k| shape[k] * anatomy.depth[corners[k] as usize])
                        .sum();
                    duration.push(1.0 + longer * (depth - 0.5));
                    lambda_ed.push(end_diastole.squared_stretch[idx][lane].sqrt());
                }
            }
        }
        let n = places.len();
        let now = Points {
            cells: start.repeat(n),
            lambda: lambda_ed
                .iter()
                .map(|ed| stretch.at_end_diastole(*ed))
                .collect(),
            sa_kpa: vec![0.0; n],
            ca_um: vec![0.0; if calcium.is_some() { n } else { 0 }],
        };
        let mut points = Self {
            model,
            calcium,
            cycle_length_ms,
            convention: wall.active.convention,
            viscosity: None,
            places,
            n_batches,
            activation_ms: times,
            duration,
            per_stretch: lambda_ed
                .iter()
                .map(|ed| stretch.at_end_diastole(*ed) / ed)
                .collect(),
            lambda_ed,
            stretch,
            since_ms: vec![0.0; n],
            stress: vec![ActiveStress::default(); n],
            trial: now.clone(),
            now,
        };
        points.begin(0.0);
        points
    }

    /// The earliest activation of these points \[ms\], zero if none precedes the beat.
    pub(super) fn earliest_activation_ms(&self) -> f64 {
        self.activation_ms
            .iter()
            .fold(0.0, |earliest, t| earliest.min(*t))
    }

    /// Sets the start time of the first step \[ms\].
    pub(super) fn begin(&mut self, time_ms: f64) {
        self.begin_step(time_ms);
        self.now.ca_um.clone_from(&self.trial.ca_um);
    }

    /// Adds a viscous stress along the fibre, which the nodal traces of active stress exclude.
    #[must_use]
    pub fn with_viscosity(mut self, viscosity: Option<FibreViscosity>) -> Self {
        self.viscosity = viscosity;
        self
    }

    /// Sets the end time of the next step to try \[ms\].
    pub fn begin_step(&mut self, end_ms: f64) {
        let length = self.cycle_length_ms;
        for ((since, t_a), duration) in self
            .since_ms
            .iter_mut()
            .zip(&self.activation_ms)
            .zip(&self.duration)
        {
            let time = end_ms - t_a;
            let time = if time >= length {
                time - (time / length).floor() * length
            } else {
                time
            };
            // The model's own time runs more slowly where contraction lasts longer.
            *since = if time > 0.0 { time / duration } else { time };
        }
        if let Some(calcium) = &self.calcium {
            // Before its first activation a point sees the tail of the previous transient.
            for ((ca, since), duration) in self
                .trial
                .ca_um
                .iter_mut()
                .zip(&self.since_ms)
                .zip(&self.duration)
            {
                *ca = if *since < 0.0 {
                    (since + length) / duration
                } else {
                    *since
                };
            }
            calcium.of_times(&mut self.trial.ca_um);
        }
    }

    /// Accepts the last evaluation.
    pub fn commit(&mut self) {
        std::mem::swap(&mut self.now.cells, &mut self.trial.cells);
        std::mem::swap(&mut self.now.lambda, &mut self.trial.lambda);
        std::mem::swap(&mut self.now.sa_kpa, &mut self.trial.sa_kpa);
        self.now.ca_um.clone_from(&self.trial.ca_um);
    }

    /// Number of integration points in the muscle.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.places.len()
    }

    /// Committed stretch, stress and calcium of each point; calcium is empty for a model without it.
    pub(super) fn committed(&self) -> [&[f64]; 3] {
        [&self.now.lambda, &self.now.sa_kpa, &self.now.ca_um]
    }

    /// Number of each point's element on this rank.
    pub(super) fn elements<'a>(&'a self, body: &'a Body) -> impl Iterator<Item = u32> + 'a {
        self.places
            .iter()
            .map(|(idx, lane)| body.point_lanes(*idx as usize).1[*lane as usize])
    }

    /// All committed state vectors, each with its numbers per point.
    pub(super) fn states(&self) -> [(usize, &Vec<f64>); 4] {
        let Points {
            cells,
            lambda,
            sa_kpa,
            ca_um,
        } = &self.now;
        [
            (self.model.n_states(), cells),
            (1, lambda),
            (1, sa_kpa),
            (usize::from(!ca_um.is_empty()), ca_um),
        ]
    }

    /// The same state vectors, to be overwritten in place.
    pub(super) fn states_mut(&mut self) -> [&mut Vec<f64>; 4] {
        [
            &mut self.now.cells,
            &mut self.now.lambda,
            &mut self.now.sa_kpa,
            &mut self.now.ca_um,
        ]
    }

    /// Weights of nodal averages over these points. Collective.
    pub(super) fn node_average(
        &self,
        anatomy: &Anatomy,
        body: &Body,
        comm: &dyn Communicator,
    ) -> NodeAverage {
        // A rank holds every element around its owned nodes.
        let n_owned = body.layout().n_owned.min(anatomy.n_vertices);
        let mut volume = vec![0.0; n_owned];
        let mut parts = Vec::with_capacity(self.places.len());
        for &(idx, lane) in &self.places {
            let (idx, lane) = (idx as usize, lane as usize);
            let e = body.point_lanes(idx).1[lane] as usize;
            let (shape, weight) = (body.vertex_shape(idx), body.point_volume(idx)[lane]);
            let part: [(u32, f64); 4] =
                std::array::from_fn(|k| (anatomy.corners[e][k], shape[k] * weight));
            for (node, share) in part {
                if let Some(volume) = volume.get_mut(node as usize) {
                    *volume += share;
                }
            }
            parts.push(part);
        }
        let nodes: Vec<u32> = (0..n_owned as u32)
            .filter(|n| volume[*n as usize] > 0.0)
            .collect();
        let mut total = [volume.iter().sum::<f64>()];
        comm.sum(&mut total);
        let mut place = vec![GHOST; anatomy.n_vertices];
        for (k, node) in nodes.iter().enumerate() {
            place[*node as usize] = k as u32;
        }
        let share = |(node, share): (u32, f64)| match volume.get(node as usize) {
            Some(volume) => (place[node as usize], share / volume),
            None => (GHOST, 0.0),
        };
        let shares = parts.into_iter().map(|part| part.map(share)).collect();
        let weights = nodes
            .iter()
            .map(|n| volume[*n as usize] / total[0])
            .collect();
        NodeAverage {
            nodes,
            weights,
            shares,
        }
    }
}

impl NodeAverage {
    /// Volume-weighted means of point values at each node of the muscle.
    pub fn apply(&self, values: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (value, shares) in values.iter().zip(&self.shares) {
            for (node, share) in shares.iter().filter(|(node, _)| *node != GHOST) {
                out[*node as usize] += share * value;
            }
        }
    }
}

impl PointStress for PointContraction {
    fn evaluate(
        &mut self,
        dt_ms: f64,
        deformation: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError> {
        out.clear();
        out.resize(
            self.n_batches,
            ActivePoint {
                sa_kpa: [0.0; BATCH] as Eight,
                slope_kpa: [0.0; BATCH],
            },
        );
        for ((lambda, per_stretch), &(idx, lane)) in (self.trial.lambda.iter_mut())
            .zip(&self.per_stretch)
            .zip(&self.places)
        {
            // Deformation is measured from the unloaded state.
            let squared = deformation.squared_stretch[idx as usize][usize::from(lane)];
            *lambda = squared.sqrt() * per_stretch;
        }
        let step = EachStep {
            dt_ms,
            lambda_prev: &self.now.lambda,
            lambda: &self.trial.lambda,
            since_activation_ms: &self.since_ms,
            ca_start_um: &self.now.ca_um,
            ca_end_um: &self.trial.ca_um,
        };
        self.model.try_step_each(
            &step,
            &self.now.cells,
            &mut self.trial.cells,
            &mut self.stress,
        )?;
        for (k, &(idx, lane)) in self.places.iter().enumerate() {
            let (idx, lane) = (idx as usize, usize::from(lane));
            let (ed, per_stretch) = (self.lambda_ed[k], self.per_stretch[k]);
            let (stress, lambda) = (self.stress[k], self.trial.lambda[k]);
            self.trial.sa_kpa[k] = stress.sa_kpa;
            let configuration = self.stretch.stress_configuration(ed);
            let factor = match self.convention {
                ActiveConvention::PerSquaredStretch => 1.0,
                ActiveConvention::FirstPiola => 1.0 / configuration,
                ActiveConvention::SecondPiola => 1.0 / (configuration * configuration),
            };
            let (viscous, slope) = self.viscosity.map_or((0.0, 0.0), |viscosity| {
                let change = (lambda - self.now.lambda[k]) / (per_stretch * ed);
                let eta = if change < 0.0 {
                    viscosity.shortening_kpa_ms
                } else {
                    viscosity.lengthening_kpa_ms
                };
                (eta * change / dt_ms, eta / dt_ms / ed)
            });
            out[idx].sa_kpa[lane] = factor * (stress.sa_kpa + viscous);
            out[idx].slope_kpa[lane] = factor * (stress.dsa_dlambda_kpa * per_stretch + slope);
        }
        Ok(())
    }
}
