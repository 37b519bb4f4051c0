//! Interface of global operations, and its implementation for a single process.

use std::sync::Arc;

use super::{Layout, NodalValues};

/// Global operations of a group of ranks. Every operation is collective: all ranks call it in the
/// same order. Reductions give the same bits on every rank. If a rank has failed and left the
/// group, operations on the other ranks do not return but unwind.
pub trait Communicator: std::fmt::Debug + Send + Sync {
    /// Number of this rank.
    fn rank(&self) -> usize;

    /// Number of ranks in the group.
    fn n_ranks(&self) -> usize;

    /// Replaces each value by its sum over ranks, computed in the order of ranks.
    fn sum(&self, values: &mut [f64]);

    /// Replaces each value by its maximum over ranks; NaN if it is NaN on any rank.
    fn max(&self, values: &mut [f64]);

    /// Replaces each value by that of rank 0.
    fn broadcast(&self, values: &mut [f64]);

    /// [`Self::broadcast`] of rank 0's next command. Before it, rank 0 may have work of its own,
    /// such as writing files.
    fn command(&self, values: &mut [f64]) {
        self.broadcast(values);
    }

    /// [`Self::command`] between tasks, for which the other ranks wait without a limit.
    fn order(&self, values: &mut [f64]) {
        self.command(values);
    }

    /// Copies owned values, `width` per node, to the ranks that hold the nodes as ghosts.
    fn exchange(&self, layout: &Layout, width: usize, values: NodalValues<'_>);

    /// [`Self::exchange`] in double precision.
    fn update_ghosts(&self, layout: &Layout, width: usize, values: &mut [f64]) {
        self.exchange(layout, width, NodalValues::Double(values));
    }

    /// [`Self::exchange`] in single precision.
    fn update_ghosts_single(&self, layout: &Layout, width: usize, values: &mut [f32]) {
        self.exchange(layout, width, NodalValues::Single(values));
    }

    /// Values of all ranks in the order of ranks, on rank 0; `None` on other ranks.
    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>>;

    /// Values that rank 0 sends to this rank. On rank 0, `parts` has one entry for each rank; on
    /// other ranks it is ignored.
    fn scatter(&self, parts: Vec<Vec<f64>>) -> Vec<f64>;
}

/// A communicator with shared ownership.
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

    fn exchange(&self, layout: &Layout, width: usize, values: NodalValues<'_>) {
        (**self).exchange(layout, width, values);
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        (**self).gather(values)
    }

    fn scatter(&self, parts: Vec<Vec<f64>>) -> Vec<f64> {
        (**self).scatter(parts)
    }
}

/// The communicator of a single process, which is its only rank.
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

    fn exchange(&self, layout: &Layout, _width: usize, _values: NodalValues<'_>) {
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
