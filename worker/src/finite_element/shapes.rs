//! Shapes of the ventricle at two instants of the simulated beat: its beginning and the end of
//! ejection.

use cardiotwin_mechanics::organ::FiniteElementVentricle;
use cardiotwin_models::ventricle::Ventricle as _;
use serde::{Deserialize, Serialize};

/// Share of the stroke so far by which the volume must fall to count as smaller. It excludes the
/// leakage through closed valves after ejection.
const SMALLER: f64 = 0.005;

/// Shape of the ventricle at an instant.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Index of the sample in the beat's traces.
    pub sample: usize,
    /// Volume of the left ventricle's cavity \[mL\].
    pub volume_ml: f64,
    /// Displacement of the mesh's nodes from the unloaded geometry \[mm\]. Files store it
    /// separately.
    #[serde(skip)]
    pub u: Vec<f64>,
}

/// Shapes in the current beat.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Shapes {
    /// Number of the beat, from one.
    pub beat: usize,
    /// Shape at the beginning of the beat.
    pub begin: Shape,
    /// Shape at the smallest volume so far, to within half a percent of the stroke.
    pub smallest: Shape,
    /// Current shape, with which the next beat begins.
    #[serde(skip)]
    latest: Shape,
}

fn shape(ventricle: &FiniteElementVentricle, n_nodes: usize, sample: usize) -> Shape {
    let mut u = ventricle.displacement_mm();
    u.truncate(3 * n_nodes);
    Shape {
        sample,
        volume_ml: ventricle.volume().0,
        u,
    }
}

impl Shapes {
    /// Starts with a ventricle at the beginning of its first beat, on a mesh with `n_nodes` nodes.
    #[must_use]
    pub fn of(ventricle: &FiniteElementVentricle, n_nodes: usize) -> Self {
        let begin = shape(ventricle, n_nodes, 0);
        Self {
            beat: 1,
            smallest: begin.clone(),
            latest: begin.clone(),
            begin,
        }
    }

    /// Continues from a checkpoint's shapes; the ventricle must have the checkpoint's state.
    #[must_use]
    pub fn resumed(self, ventricle: &FiniteElementVentricle, n_nodes: usize) -> Self {
        Self {
            latest: shape(ventricle, n_nodes, 0),
            ..self
        }
    }

    /// Shape after the last observed sample.
    #[must_use]
    pub fn latest(&self) -> &Shape {
        &self.latest
    }

    /// Adds the state after a sample of a beat's traces.
    pub fn observe(&mut self, beat: usize, sample: usize, ventricle: &FiniteElementVentricle) {
        let n_nodes = self.latest.u.len() / 3;
        if beat != self.beat {
            self.beat = beat;
            self.begin = Shape {
                sample: 0,
                ..std::mem::take(&mut self.latest)
            };
            self.smallest.clone_from(&self.begin);
        }
        self.latest = shape(ventricle, n_nodes, sample);
        let stroke = self.begin.volume_ml - self.latest.volume_ml;
        if self.latest.volume_ml < self.smallest.volume_ml - SMALLER * stroke.max(0.0) {
            self.smallest.clone_from(&self.latest);
        }
    }
}
