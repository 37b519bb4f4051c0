//! Expected end of planned jobs, if the queue granted at once all that its limits allow.

use super::{InUse, room};
use crate::site::Queue;

/// An estimate without the wait for free nodes, which is unpredictable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finish {
    /// Time from the start of the first job to the end of the last, s.
    pub after_s: f64,
    /// Largest number of jobs that run at once.
    pub most_at_once: u32,
}

/// Runs jobs of `(nodes, seconds)` in their order, as soon as the queue's limits on running jobs
/// and on nodes allow. The user's running jobs count as running for ever.
#[must_use]
pub fn finish(jobs: &[(u32, f64)], queue: &Queue, in_use: InUse) -> Finish {
    let room = room(queue, in_use);
    let (at_once, nodes) = (room.running.max(1) as usize, room.nodes.max(1));
    let (mut running, mut now, mut free, mut most) = (Vec::<(f64, u32)>::new(), 0.0_f64, nodes, 0);
    for (n_nodes, seconds) in jobs {
        let n_nodes = (*n_nodes).min(nodes);
        while running.len() >= at_once || free < n_nodes {
            let (first, _) = running
                .iter()
                .enumerate()
                .min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0))
                .expect("nodes or places are taken by running jobs");
            let (end, given_back) = running.swap_remove(first);
            now = now.max(end);
            free += given_back;
        }
        running.push((now + seconds.max(0.0), n_nodes));
        free -= n_nodes;
        most = most.max(running.len());
    }
    let after_s = running.iter().map(|(end, _)| *end).fold(now, f64::max);
    Finish {
        after_s,
        most_at_once: u32::try_from(most).unwrap_or(u32::MAX),
    }
}
