//! Counters of a rank's communication.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Communicator, Layout, NodalValues};

/// Number and size of the messages of a rank.
#[derive(Debug, Default)]
pub struct Traffic {
    halo_messages: AtomicU64,
    halo_bytes: AtomicU64,
    reductions: AtomicU64,
}

impl Traffic {
    /// Number of halo messages, their total size in bytes, and the number of reductions and
    /// broadcasts.
    #[must_use]
    pub fn counts(&self) -> [f64; 3] {
        [&self.halo_messages, &self.halo_bytes, &self.reductions]
            .map(|n| n.load(Ordering::Relaxed) as f64)
    }

    fn reduction(&self) {
        self.reductions.fetch_add(1, Ordering::Relaxed);
    }
}

/// A communicator with counters.
#[derive(Debug)]
pub struct Counted<C: ?Sized> {
    traffic: Arc<Traffic>,
    inner: Box<C>,
}

impl<C: Communicator + ?Sized> Counted<C> {
    /// Counts the communication through `inner`.
    #[must_use]
    pub fn new(inner: Box<C>, traffic: Arc<Traffic>) -> Self {
        Self { traffic, inner }
    }
}

impl<C: Communicator + ?Sized> Communicator for Counted<C> {
    fn rank(&self) -> usize {
        self.inner.rank()
    }

    fn n_ranks(&self) -> usize {
        self.inner.n_ranks()
    }

    fn sum(&self, values: &mut [f64]) {
        self.traffic.reduction();
        self.inner.sum(values);
    }

    fn max(&self, values: &mut [f64]) {
        self.traffic.reduction();
        self.inner.max(values);
    }

    fn broadcast(&self, values: &mut [f64]) {
        self.traffic.reduction();
        self.inner.broadcast(values);
    }

    fn command(&self, values: &mut [f64]) {
        self.traffic.reduction();
        self.inner.command(values);
    }

    fn order(&self, values: &mut [f64]) {
        self.inner.order(values);
    }

    fn exchange(&self, layout: &Layout, width: usize, values: NodalValues<'_>) {
        let sent: usize = layout
            .neighbours
            .iter()
            .map(|neighbour| neighbour.send.len())
            .sum();
        self.traffic
            .halo_messages
            .fetch_add(layout.neighbours.len() as u64, Ordering::Relaxed);
        self.traffic
            .halo_bytes
            .fetch_add((8 * width * sent) as u64, Ordering::Relaxed);
        self.inner.exchange(layout, width, values);
    }

    fn gather(&self, values: &[f64]) -> Option<Vec<Vec<f64>>> {
        self.inner.gather(values)
    }

    fn scatter(&self, parts: Vec<Vec<f64>>) -> Vec<f64> {
        self.inner.scatter(parts)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Neighbour, ThreadSettings, on_threads};
    use super::*;

    #[test]
    fn halos_and_reductions_are_counted_where_they_are_sent() {
        let counts = on_threads(2, ThreadSettings::default(), |comm| {
            let traffic = Arc::new(Traffic::default());
            let (rank, comm) = (
                comm.rank(),
                Counted::new(Box::new(comm), Arc::clone(&traffic)),
            );
            let neighbours = vec![Neighbour {
                rank: 1 - rank,
                send: vec![0, 1],
                receive: vec![2, 3],
            }];
            let layout = Layout {
                n_owned: 2,
                n_local: 4,
                neighbours,
            };
            let mut values = vec![rank as f64; 12];
            comm.update_ghosts(&layout, 3, &mut values);
            comm.update_ghosts(&layout, 1, &mut values[..4]);
            comm.sum(&mut [1.0]);
            assert_eq!(values[6..], [(1 - rank) as f64; 6]);
            traffic.counts()
        });
        assert_eq!(counts.expect("no rank fails"), [[2.0, 64.0, 1.0]; 2]);
    }
}
