//! The one interface of global operations, and its single-process implementation.

use std::sync::Arc;

use super::Layout;

/// Global operations of a group of ranks. Each is collective: all ranks call it in the same order. Reductions give every
/// rank the same bits. No operation returns on a rank of a group that another rank has left by a failure: it unwinds.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// This rank.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn n_ranks(&self) -> usize;

    /// Replaces each value by its sum over ranks, in the order of ranks.
    fn sum(&self, values: &mut [f64]);

    /// Replaces each value by its largest over ranks; NaN on any rank gives NaN.
    fn max(&self, values: &mut [f64]);

    /// Replaces each value by that of rank 0.
    fn broadcast(&self, values: &mut [f64]);

    /// As [`Self::broadcast`], of what rank 0 wants next: it may have work of its own before, such as writing files.
    fn command(&self, values: &mut [f64]) {
        self.broadcast(values);
    }

    /// As [`Self::command`], between tasks: the other ranks wait for it as long as it takes.
    fn order(&self, values: &mut [f64]) {
        self.command(values);
    }

    /// Copies owned values, `width` a node, to the ranks that hold them as ghosts.
    fn update_ghosts(&self, layout: &Layout, width: usize, values: &mut [f64]);

    /// Values of all ranks, one rank after another, on rank 0; `None` elsewhere.
    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>>;

    /// What rank 0 has for this rank; `parts` holds, on rank 0, an entry for each rank, and is not looked at elsewhere.
    fn scatter(&self, parts: Vec<Vec<f64>>) -> Vec<f64>;
}

/// A communicator that several have.
impl<C: Communicator + ?Sized> Communicator for Arc<C> {
    fn rank(&self) -> usize {
        (**self).rank()
    }

    fn n_ranks(&self) -> usize {
        (**self).n_ranks()
    }

    fn sum(&self, values: &mut [f64]) {
        (**self).sum(values);
    }

    fn max(&self, values: &mut [f64]) {
        (**self).max(values);
    }

    fn broadcast(&self, values: &mut [f64]) {
        (**self).broadcast(values);
    }

    fn command(&self, values: &mut [f64]) {
        (**self).command(values);
    }

    fn order(&self, values: &mut [f64]) {
        (**self).order(values);
    }

    fn update_ghosts(&self, layout: &Layout, width: usize, values: &mut [f64]) {
        (**self).update_ghosts(layout, width, values);
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        (**self).gather(values)
    }

    fn scatter(&self, parts: Vec<Vec<f64>>) -> Vec<f64> {
        (**self).scatter(parts)
    }
}

/// One process that holds everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SingleProcess;

impl Communicator for SingleProcess {
    fn rank(&self) -> usize {
        0
    }

    fn n_ranks(&self) -> usize {
        1
    }

    fn sum(&self, _values: &mut [f64]) {}

    fn max(&self, _values: &mut [f64]) {}

    fn broadcast(&self, _values: &mut [f64]) {}

    fn update_ghosts(&self, layout: &Layout, _width: usize, _values: &mut [f64]) {
        debug_assert!(
            layout.neighbours.is_empty(),
            "a single process has no neighbours"
        );
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        Some(vec![values.to_vec()])
    }

    fn scatter(&self, mut parts: Vec<Vec<f64>>) -> Vec<f64> {
        parts.swap_remove(0)
    }
}
