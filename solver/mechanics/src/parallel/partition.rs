//! Nodes to ranks: a cut of the mesh's graph by METIS (Karypis and Kumar 1998, SIAM J Sci Comput 20:359).

use std::sync::Mutex;

use cardiotwin_mesh::adjacency::Adjacency;
use metis::option::{Seed, UFactor};
use metis::{Graph, Idx};

/// Parts up to which METIS bisects again and again; it cuts more parts at once.
const MOST_BY_BISECTION: usize = 8;
/// Seed of METIS's random numbers.
const SEED: Idx = 1;

/// METIS draws from the process's one random number generator: two cuts at a time would disturb each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Why a mesh was not cut.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PartitionError {
    /// Ranks without nodes have nothing to do.
    #[error("{n_nodes} nodes for {n_ranks} ranks, rank {empty} would have none: use fewer ranks")]
    TooManyRanks {
        /// Nodes of the mesh.
        n_nodes: usize,
        /// Ranks asked for.
        n_ranks: usize,
        /// A rank without nodes.
        empty: usize,
    },
    /// METIS gave up.
    #[error("METIS cannot cut {n_nodes} nodes into {n_ranks} parts: {reason}")]
    Metis {
        /// Nodes of the mesh.
        n_nodes: usize,
        /// Ranks asked for.
        n_ranks: usize,
        /// What METIS says.
        reason: String,
    },
}

/// The rank that owns each node. A node weighs what its elements cost, so that ranks get equal work rather than equally many
/// nodes; of cuts that do, one through few edges is taken. The same mesh gives the same cut.
///
/// METIS holds the process's SIGTERM and SIGABRT while it works, a second for a million nodes, to leave on an error of its own:
/// a SIGTERM in that time ends the cut with [`PartitionError::Metis`].
///
/// # Errors
/// [`PartitionError`] for more ranks than there are nodes to give them, or when METIS gives up.
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
    let nodes = Adjacency::node_to_nodes(n_nodes, tets);
    let mut starts: Vec<Idx> = Vec::with_capacity(n_nodes + 1);
    let mut neighbours: Vec<Idx> = Vec::with_capacity(nodes.items.len());
    starts.push(0);
    for node in 0..n_nodes {
        // Ours hold the node itself, METIS wants neighbours alone.
        neighbours.extend(
            nodes
                .row(node)
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
        // A cut that panicked leaves nothing behind that another one could trip over.
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

/// What a cut costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutFigures {
    /// Elements of the rank that computes most over an equal share of all elements: what elements at the cut, which several
    /// ranks compute, and unequal parts cost together.
    pub elements: f64,
    /// The same of nodes, owned ones alone.
    pub nodes: f64,
    /// Edges between nodes of different ranks, over all edges.
    pub cut_edges: f64,
}

/// Measures a cut.
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
    let graph = Adjacency::node_to_nodes(n_nodes, tets);
    let (mut all, mut cut) = (0_usize, 0_usize);
    for node in 0..n_nodes {
        for other in graph
            .row(node)
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
    use cardiotwin_mesh::TetMesh;
    use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
    use cardiotwin_mesh::partition::{CoordinateBisection, Partitioner as _, node_owners};
    use cardiotwin_units::Ml;

    use super::*;

    fn ventricle(n_nodes: usize) -> TetMesh {
        generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), n_nodes))
            .expect("a mesh")
            .mesh
    }

    #[test]
    fn parts_are_balanced_and_cut_few_edges() {
        for (size, most_cut) in [
            (2000, [0.06, 0.08, 0.11, 0.16]),
            (8000, [0.03, 0.05, 0.06, 0.09]),
        ] {
            let mesh = ventricle(size);
            let n = mesh.n_nodes();
            for (n_ranks, most_cut) in [2, 3, 4, 8].into_iter().zip(most_cut) {
                let found = owners(n, &mesh.tets, n_ranks).expect("a cut");
                let cut = figures(n, &mesh.tets, &found, n_ranks);
                // What is computed twice at the cut is about two elements for each edge that is cut.
                assert!(
                    cut.elements < 1.02 + 2.2 * cut.cut_edges,
                    "{size} nodes, {n_ranks} ranks: {cut:?}"
                );
                assert!(
                    cut.nodes < 1.08 && cut.cut_edges < most_cut,
                    "{size} nodes, {n_ranks} ranks: {cut:?}"
                );
                let parts = CoordinateBisection.parts(&mesh, &vec![1.0; mesh.n_tets()], n_ranks);
                let simple = figures(n, &mesh.tets, &node_owners(&mesh, &parts), n_ranks);
                assert!(
                    cut.elements < simple.elements,
                    "{size} nodes, {n_ranks} ranks: {cut:?} {simple:?}"
                );
            }
        }
    }

    #[test]
    fn the_same_mesh_gives_the_same_cut_whoever_else_cuts() {
        let mesh = ventricle(500);
        let cut = || owners(mesh.n_nodes(), &mesh.tets, 4).expect("a cut");
        let want = cut();
        std::thread::scope(|scope| {
            let others: Vec<_> = (0..4)
                .map(|_| scope.spawn(|| (0..5).map(|_| cut()).collect::<Vec<_>>()))
                .collect();
            for other in others {
                assert!(
                    other
                        .join()
                        .expect("no panic")
                        .iter()
                        .all(|got| *got == want)
                );
            }
        });
    }

    #[test]
    fn one_rank_owns_all_and_too_many_are_refused() {
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        assert_eq!(owners(5, &tets, 1), Ok(vec![0; 5]));
        let refused = owners(5, &tets, 6).expect_err("more ranks than nodes");
        assert_eq!(
            refused.to_string(),
            "5 nodes for 6 ranks, rank 5 would have none: use fewer ranks"
        );
    }
}
