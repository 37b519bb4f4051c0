//! Partition of a mesh into parts of approximately equal work, for threads or processes.

use crate::tet_mesh::TetMesh;

/// A partitioning method. This module implements recursive coordinate bisection; a graph
/// partitioner (METIS) is another implementation.
pub trait Partitioner {
    /// Part of each element, from 0 to `n_parts` − 1. `work` is the positive cost of each element.
    fn parts(&self, mesh: &TetMesh, work: &[f64], n_parts: usize) -> Vec<u32>;
}

/// Recursive bisection along the longest side, into halves or, for odd numbers of parts, into the
/// nearest shares. It is deterministic and uses only positions.
///
/// Source: Berger, Bokhari 1987, IEEE Trans. Comput. C-36, 570.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CoordinateBisection;

impl Partitioner for CoordinateBisection {
    fn parts(&self, mesh: &TetMesh, work: &[f64], n_parts: usize) -> Vec<u32> {
        let centres: Vec<[f64; 3]> = (0..mesh.n_tets()).map(|e| mesh.centroid_mm(e)).collect();
        let mut parts = vec![0; mesh.n_tets()];
        let mut all: Vec<u32> = (0..mesh.n_tets() as u32).collect();
        bisect(&centres, work, &mut all, 0, n_parts.max(1), &mut parts);
        parts
    }
}

fn bisect(
    centres: &[[f64; 3]],
    work: &[f64],
    items: &mut [u32],
    first: usize,
    n_parts: usize,
    parts: &mut [u32],
) {
    if n_parts == 1 || items.is_empty() {
        for item in items {
            parts[*item as usize] = first as u32;
        }
        return;
    }
    let side = |k: usize| {
        let along = items.iter().map(|item| centres[*item as usize][k]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    let longest = (0..3)
        .max_by(|a, b| side(*a).total_cmp(&side(*b)).then(b.cmp(a)))
        .unwrap_or(0);
    items.sort_unstable_by(|a, b| {
        centres[*a as usize][longest]
            .total_cmp(&centres[*b as usize][longest])
            .then(a.cmp(b))
    });
    let n_low = n_parts / 2;
    let total: f64 = items.iter().map(|item| work[*item as usize]).sum();
    let goal = total * n_low as f64 / n_parts as f64;
    let mut done = 0.0;
    let mut cut = 0;
    while cut < items.len() && done + 0.5 * work[items[cut] as usize] <= goal {
        done += work[items[cut] as usize];
        cut += 1;
    }
    let (low, high) = items.split_at_mut(cut);
    bisect(centres, work, low, first, n_low, parts);
    bisect(centres, work, high, first + n_low, n_parts - n_low, parts);
}

/// Quality of a partition.
#[derive(Debug, Clone, PartialEq)]
pub struct PartitionFigures {
    /// Work of the largest part divided by the mean.
    pub imbalance: f64,
    /// Number of nodes in more than one part, divided by the number of all nodes.
    pub shared_share: f64,
}

/// Computes the quality of a partition.
#[must_use]
pub fn figures(mesh: &TetMesh, work: &[f64], parts: &[u32], n_parts: usize) -> PartitionFigures {
    let mut load = vec![0.0; n_parts];
    for (part, work) in parts.iter().zip(work) {
        load[*part as usize] += work;
    }
    let mean = load.iter().sum::<f64>() / n_parts as f64;
    let mut low = vec![u32::MAX; mesh.n_nodes()];
    let mut shared = vec![false; mesh.n_nodes()];
    for (tet, part) in mesh.tets.iter().zip(parts) {
        for node in tet.iter().map(|node| *node as usize) {
            shared[node] |= low[node] != u32::MAX && low[node] != *part;
            low[node] = low[node].min(*part);
        }
    }
    let n_shared = shared.iter().filter(|shared| **shared).count();
    PartitionFigures {
        imbalance: load.into_iter().fold(0.0, f64::max) / mean,
        shared_share: n_shared as f64 / mesh.n_nodes().max(1) as f64,
    }
}

/// Owner of each node: the lowest part among those of its elements (`u32::MAX` for a node without
/// elements).
#[must_use]
pub fn node_owners(mesh: &TetMesh, parts: &[u32]) -> Vec<u32> {
    let mut owner = vec![u32::MAX; mesh.n_nodes()];
    for (tet, part) in mesh.tets.iter().zip(parts) {
        for node in tet {
            let owner = &mut owner[*node as usize];
            *owner = (*owner).min(*part);
        }
    }
    owner
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::order::Renumbering;
    use crate::test_meshes::block;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        #[test]
        fn parts_carry_equal_work_whatever_their_number(n_parts in 1usize..17, weight in 1.0..9.0f64) {
            let mesh = block([8, 6, 10], [8.0, 6.0, 10.0]);
            let work: Vec<f64> = (0..mesh.n_tets()).map(|e| if e % 3 == 0 { weight } else { 1.0 }).collect();
            let parts = CoordinateBisection.parts(&mesh, &work, n_parts);
            prop_assert!(parts.iter().all(|part| (*part as usize) < n_parts));
            let figures = figures(&mesh, &work, &parts, n_parts);
            prop_assert!(figures.imbalance < 1.1, "{figures:?}");
            prop_assert!(figures.shared_share < 0.75);
            prop_assert!(node_owners(&mesh, &parts).iter().all(|owner| (*owner as usize) < n_parts));
        }
    }

    #[test]
    fn a_partition_follows_its_elements_through_a_renumbering() {
        let mut mesh = block([5, 4, 6], [5.0, 4.0, 6.0]);
        // No two centroids lie in one plane, so that the result does not depend on ties.
        for (i, x) in mesh.nodes_mm.iter_mut().enumerate() {
            *x = std::array::from_fn(|k| x[k] + 0.05 * ((i * (k + 3)) as f64).sin());
        }
        let work = vec![1.0; mesh.n_tets()];
        let parts = CoordinateBisection.parts(&mesh, &work, 6);
        let other = Renumbering::shuffled(&mesh, 5);
        let again = CoordinateBisection.parts(&other.apply(&mesh), &work, 6);
        assert!(
            other
                .tets
                .iter()
                .enumerate()
                .all(|(new, old)| again[new] == parts[*old as usize])
        );
    }
}
