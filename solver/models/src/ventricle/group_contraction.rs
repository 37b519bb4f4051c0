//! Contraction of a ventricle's groups: the model, its calcium and the state from which it starts.

use super::VentricleError;
use crate::calcium::Calcium;
use crate::cell0d::{Cell0d, CellBeat, CellState};
use crate::contraction::{Contraction, Land2017, StretchReference, Tanh};
use std::sync::Arc;

/// Contraction model of all groups, with its calcium and initial state.
#[derive(Debug)]
pub struct GroupContraction {
    pub(super) model: Box<dyn Contraction>,
    pub(super) calcium: Option<Arc<dyn Calcium>>,
    pub(super) start_state: Vec<f64>,
    pub(super) stretch: StretchReference,
}

impl GroupContraction {
    /// Tanh model in every group.
    #[must_use]
    pub fn tanh(tanh: Tanh) -> Self {
        Self {
            model: Box::new(tanh),
            calcium: None,
            start_state: Vec::new(),
            stretch: StretchReference::EndDiastole,
        }
    }

    /// Land model with the calcium of a 0D cell, started from the cell's periodic state.
    #[must_use]
    pub fn land(cell: &Cell0d, beat: &CellBeat) -> Self {
        Self::land_from(cell, &beat.start_state)
    }

    /// Land model with the calcium of a 0D cell, started from a state of the cell.
    #[must_use]
    pub fn land_from(cell: &Cell0d, start: &CellState) -> Self {
        let land: Land2017 = *cell.land();
        Self {
            model: Box::new(land),
            calcium: Some(cell.shared_calcium()),
            start_state: start.land.to_vec(),
            stretch: StretchReference::EndDiastole,
        }
    }

    /// Any other model, with `calcium` if it needs one and a `start_state` of matching length.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] if the length of the state does not match the model, or
    /// calcium is missing.
    pub fn new(
        model: Box<dyn Contraction>,
        calcium: Option<Arc<dyn Calcium>>,
        start_state: Vec<f64>,
    ) -> Result<Self, VentricleError> {
        if start_state.len() != model.n_states() {
            let (value, expected) = (
                start_state.len() as f64,
                "as many as the contraction model has states",
            );
            return Err(VentricleError::Parameter {
                name: "start states",
                value,
                expected,
            });
        }
        if model.needs_calcium() && calcium.is_none() {
            return Err(VentricleError::Parameter {
                name: "calcium",
                value: f64::NAN,
                expected: "given for this contraction model",
            });
        }
        Ok(Self {
            model,
            calcium,
            start_state,
            stretch: StretchReference::EndDiastole,
        })
    }
}

/// Model, calcium and initial state of one node, and the reference length of its stretch.
pub type NodeContraction = (
    Box<dyn Contraction>,
    Option<Arc<dyn Calcium>>,
    Vec<f64>,
    StretchReference,
);

impl GroupContraction {
    /// Returns the contraction with another reference length of the stretch than that at
    /// end-diastole.
    #[must_use]
    pub fn with_stretch(self, stretch: StretchReference) -> Self {
        Self { stretch, ..self }
    }

    /// Splits into the parts of one node, for a ventricle with its own nodes.
    #[must_use]
    pub fn into_parts(self) -> NodeContraction {
        (self.model, self.calcium, self.start_state, self.stretch)
    }

    /// Wraps the model into another one that keeps `own_start` as additional states after those of
    /// each node.
    #[must_use]
    pub fn wrapped(
        mut self,
        own_start: &[f64],
        wrap: impl FnOnce(Box<dyn Contraction>) -> Box<dyn Contraction>,
    ) -> Self {
        self.start_state.extend_from_slice(own_start);
        Self {
            model: wrap(self.model),
            ..self
        }
    }
}
