//! Assignment of nodes to ranks, by a partition of the mesh's graph with METIS (Karypis and Kumar
//! 1998, SIAM J Sci Comput 20:359).

use std::sync::Mutex;

use metis::option::{Seed, UFactor};
use metis::{Graph, Idx};

use crate::Pattern;

/// Largest number of parts for which METIS uses recursive bisection; for more, it uses k-way
/// partitioning.
const MOST_BY_BISECTION: usize = 8;
/// Seed of METIS's random numbers.
const SEED: Idx = 1;

/// METIS draws from the process's only random number generator, so that concurrent partitions would
/// disturb each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Reasons why a mesh cannot be partitioned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PartitionError {
    /// Some rank would have no nodes.
    #[error(
        "{n_nodes} nodes cannot be divided among {n_ranks} ranks, because rank {empty} would have none: use fewer ranks"
    )]
    TooManyRanks {
        /// Number of nodes in the mesh.
        n_nodes: usize,
        /// Requested number of ranks.
        n_ranks: usize,
        /// A rank without nodes.
        empty: usize,
    },
    /// METIS returned an error instead of a partition.
    #[error("METIS cannot divide {n_nodes} nodes into {n_ranks} parts: {reason}")]
    Metis {
        /// Number of nodes in the mesh.
        n_nodes: usize,
        /// Requested number of ranks.
        n_ranks: usize,
        /// Error that METIS reported.
        reason: String,
    },
}

/// The nodes that share an element with each node.
fn graph(n_nodes: usize, tets: &[[u32; 4]]) -> Pattern {
    Pattern::of_elements(n_nodes, tets.iter().map(|tet| (&tet[..], &tet[..])))
}

/// Owner of each node. A node has the weight of its elements' cost, so that ranks get equal work
/// rather than equal numbers of nodes. Among such partitions, METIS looks for one that cuts few
/// edges. The same mesh always gives the same partition.
///
/// METIS handles the process's SIGTERM and SIGABRT while it works (a second for a million nodes),
/// in order to leave its own code after an error. A SIGTERM during that time ends the partition
/// with [`PartitionError::Metis`].
///
/// # Errors
/// [`PartitionError`] for more ranks than nodes, or if METIS fails.
pub fn owners(
    n_nodes: usize,
    tets: &[[u32; 4]],
    n_ranks: usize,
) -> Result<Vec<u32>, PartitionError> {
    if n_ranks <= 1 {
        return Ok(vec![0; n_nodes]);
    }
    if n_nodes < n_ranks {
        return Err(PartitionError::TooManyRanks {
            n_nodes,
            n_ranks,
            empty: n_nodes,
        });
    }
    let failed = |reason: String| PartitionError::Metis {
        n_nodes,
        n_ranks,
        reason,
    };
    let nodes = graph(n_nodes, tets);
    let mut starts: Vec<Idx> = Vec::with_capacity(n_nodes + 1);
    let mut neighbours: Vec<Idx> = Vec::with_capacity(nodes.column.len());
    starts.push(0);
    for node in 0..n_nodes {
        // Our pattern includes the node itself; METIS expects only its neighbours.
        neighbours.extend(
            nodes
                .columns(node)
                .iter()
                .filter(|n| **n as usize != node)
                .map(|n| *n as Idx),
        );
        starts.push(
            Idx::try_from(neighbours.len()).map_err(|_| failed("too many edges".to_owned()))?,
        );
    }
    let mut work: Vec<Idx> = vec![0; n_nodes];
    tets.as_flattened()
        .iter()
        .for_each(|node| work[*node as usize] += 1);
    let mut parts: Vec<Idx> = vec![0; n_nodes];
    {
        // A panic during a partition leaves no inconsistent state behind.
        let _alone = ONE_AT_A_TIME
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let graph = Graph::new(1, n_ranks as Idx, &starts, &neighbours)
            .map_err(|e| failed(e.to_string()))?
            .set_vwgt(&work)
            .set_option(Seed(SEED));
        let cut = if n_ranks <= MOST_BY_BISECTION {
            graph.part_recursive(&mut parts)
        } else {
            graph.set_option(UFactor(10)).part_kway(&mut parts)
        };
        cut.map_err(|e| failed(e.to_string()))?;
    }
    let owners: Vec<u32> = parts.into_iter().map(Idx::cast_unsigned).collect();
    let mut has_nodes = vec![false; n_ranks];
    owners
        .iter()
        .for_each(|rank| has_nodes[*rank as usize] = true);
    match has_nodes.iter().position(|has| !has) {
        Some(empty) => Err(PartitionError::TooManyRanks {
            n_nodes,
            n_ranks,
            empty,
        }),
        None => Ok(owners),
    }
}

/// Quality of a partition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutFigures {
    /// Largest number of elements on a rank, relative to an equal share of all elements. It shows
    /// the combined cost of elements at the cut, which several ranks compute, and of unequal parts.
    pub elements: f64,
    /// Largest number of owned nodes on a rank, relative to an equal share.
    pub nodes: f64,
    /// Number of edges between nodes of different ranks, relative to the number of all edges.
    pub cut_edges: f64,
}

/// Computes the quality of a partition.
#[must_use]
pub fn figures(n_nodes: usize, tets: &[[u32; 4]], owners: &[u32], n_ranks: usize) -> CutFigures {
    let (mut elements, mut nodes) = (vec![0_usize; n_ranks], vec![0_usize; n_ranks]);
    owners.iter().for_each(|rank| nodes[*rank as usize] += 1);
    for tet in tets {
        let mut ranks = tet.map(|node| owners[node as usize]);
        ranks.sort_unstable();
        ranks
            .chunk_by(|a, b| a == b)
            .for_each(|same| elements[same[0] as usize] += 1);
    }
    let graph = graph(n_nodes, tets);
    let (mut all, mut cut) = (0_usize, 0_usize);
    for node in 0..n_nodes {
        for other in graph
            .columns(node)
            .iter()
            .filter(|other| **other as usize > node)
        {
            all += 1;
            cut += usize::from(owners[node] != owners[*other as usize]);
        }
    }
    let most = |of: &[usize], all: usize| {
        of.iter().copied().max().unwrap_or(0) as f64 * n_ranks as f64 / all.max(1) as f64
    };
    CutFigures {
        elements: most(&elements, tets.len()),
        nodes: most(&nodes, n_nodes),
        cut_edges: cut as f64 / all.max(1) as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_rank_owns_all_and_too_many_are_refused() {
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        assert_eq!(owners(5, &tets, 1), Ok(vec![0; 5]));
        let refused = owners(5, &tets, 6).expect_err("more ranks than nodes");
        assert_eq!(
            refused.to_string(),
            "5 nodes cannot be divided among 6 ranks, because rank 5 would have none: use fewer ranks"
        );
    }
}
