//! The ventricle's shape at two instants of the beat that is simulated: where it begins, and at the end of ejection.

use cardiotwin_mechanics::organ::FiniteElementVentricle;
use cardiotwin_models::ventricle::Ventricle as _;
use serde::{Deserialize, Serialize};

/// The volume has to fall by this share of the stroke so far to count as smaller: what trickles through shut valves after
/// ejection is none of it.
const SMALLER: f64 = 0.005;

/// A shape.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Which sample of the beat's traces.
    pub sample: usize,
    /// Cavity volume.
    pub volume_ml: f64,
    /// Displacement of the mesh's nodes from the unloaded geometry \[mm\]; kept beside this in files.
    #[serde(skip)]
    pub u: Vec<f64>,
}

/// Shapes of the beat in hand.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Shapes {
    /// Number of the beat, from one.
    pub beat: usize,
    /// At its beginning.
    pub begin: Shape,
    /// At the smallest volume so far, to half a percent of the stroke.
    pub smallest: Shape,
    /// Now: a later beat begins where this one ends.
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
    /// Of a ventricle at the beginning of its first beat, on a mesh of so many nodes.
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

    /// Goes on from those of a checkpoint, whose state the ventricle has.
    #[must_use]
    pub fn resumed(self, ventricle: &FiniteElementVentricle, n_nodes: usize) -> Self {
        Self {
            latest: shape(ventricle, n_nodes, 0),
            ..self
        }
    }

    /// The shape after the last sample that was observed.
    #[must_use]
    pub fn latest(&self) -> &Shape {
        &self.latest
    }

    /// Takes note of the state after a sample of a beat's traces.
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
