//! Number of MPI ranks that a mesh can use, by the model of `deploy/scaling-model.py`.
//!
//! Times are of one Krylov iteration, over which a beat is spread: the work of a rank's nodes, halos
//! to its neighbours, reductions in ⌈log₂ R⌉ rounds, and the inverse of the large groups of nodes.
//! docs/scaling.md explains the model and docs/measurements/scaling.md has the counts and rates that
//! its constants were taken from.

/// Time of an iteration for each node of the mesh on one core, s: processor time of a beat of
/// 64,000 nodes (218.8 s) spread over its Krylov iterations (19,036).
const S_PER_NODE: f64 = 218.8 / 19_036.0 / 64_000.0;
/// Halo exchanges of an iteration.
const HALOS: f64 = 2.4;
/// Reductions of an iteration.
const REDUCTIONS: f64 = 4.5;
/// Latency of a message within a node, s.
const NEAR_S: f64 = 0.8e-6;
/// Latency of a message between nodes, s.
const FAR_S: f64 = 2.0e-6;
/// Cost of a message to its sender, s.
const OVERHEAD_S: f64 = 0.4e-6;
/// Time for each byte of a rank's messages, s.
const S_PER_BYTE: f64 = 1.0 / 2.0e9;
/// Bytes of a halo for each ghost node.
const BYTES_PER_GHOST: f64 = 37.0;
/// Krylov iterations between two inverses: 64 iterations of Newton's method of 31.7 each.
const ITERATIONS_PER_INVERSE: f64 = 64.0 * 31.7;
/// Time of an operation of the inverse on one core, s.
const S_PER_OPERATION: f64 = 1.0 / 10.0e9;
/// Smallest parallel efficiency that a simulation is given ranks for. With more ranks, most of
/// their time would be waiting, and another simulation makes better use of the cores.
const LEAST_EFFICIENCY: f64 = 0.45;

/// Unknowns of the large groups of nodes, which are halved until none has more than a 128th of the
/// nodes and a quarter, or 500; each rank has one at least.
fn unknowns(mesh_nodes: f64, ranks: f64) -> f64 {
    let largest = (5.0 * mesh_nodes / (4.0 * 128.0)).max(500.0);
    let halvings = (mesh_nodes / ranks / largest).log2().ceil().max(0.0);
    6.0 * ranks * halvings.exp2()
}

/// Expected time of an iteration on `ranks` ranks, s.
fn iteration_s(mesh_nodes: f64, ranks: u32, cores_per_node: u32) -> f64 {
    if ranks <= 1 {
        return mesh_nodes * S_PER_NODE;
    }
    let n = f64::from(ranks);
    // Elements at a cut are computed by several ranks.
    let overlap = 1.0 + 0.145 * (1000.0 * n / mesh_nodes).cbrt();
    let neighbours = match ranks {
        2 => 1.0,
        4 => 3.0,
        _ => f64::from((ranks - 1).min(8)),
    };
    let latency_s = if ranks <= cores_per_node {
        NEAR_S
    } else {
        FAR_S
    };
    let ghosts = 300.0 * (mesh_nodes / n / 1000.0).powf(2.0 / 3.0);
    let halo_s = latency_s + neighbours * OVERHEAD_S + BYTES_PER_GHOST * ghosts * S_PER_BYTE;
    let rounds = f64::from(ranks.next_power_of_two().trailing_zeros());
    let unknowns_of = |ranks| unknowns(mesh_nodes, ranks);
    let (all, of_one) = (unknowns_of(n), unknowns_of(1.0));
    // One rank's inverse is part of its beat.
    let inverse_s = 2.0 * (all.powi(3) - of_one.powi(3)) * S_PER_OPERATION
        + rounds * 8.0 * all.powi(2) * S_PER_BYTE;
    mesh_nodes * S_PER_NODE * overlap / n
        + HALOS * halo_s
        + rounds * (REDUCTIONS * (latency_s + OVERHEAD_S) + 8.0 * all * S_PER_BYTE)
        + inverse_s / ITERATIONS_PER_INVERSE
}

/// Krylov iterations of a beat of 64,000 nodes, and the power of the number of nodes with which they grow: 6,570, 11,200 and
/// 19,036 at 1,000, 8,000 and 64,000 nodes (docs/measurements/mechanics-solver.md).
const ITERATIONS_OF_BEAT: f64 = 19_036.0;
const ITERATIONS_GROW: f64 = 0.256;

/// Expected time of a beat with Tanh on the processor of the measurements, s.
#[must_use]
pub fn beat_s(mesh_nodes: u32, ranks: u32, cores_per_node: u32) -> f64 {
    let n = f64::from(mesh_nodes.max(1));
    let iterations = ITERATIONS_OF_BEAT * (n / 64_000.0).powf(ITERATIONS_GROW);
    iterations * iteration_s(n, ranks.max(1), cores_per_node.max(1))
}

/// Parallel efficiency that is expected of `ranks` ranks.
fn efficiency(mesh_nodes: f64, ranks: u32, cores_per_node: u32) -> f64 {
    iteration_s(mesh_nodes, 1, cores_per_node)
        / (f64::from(ranks) * iteration_s(mesh_nodes, ranks, cores_per_node))
}

/// Largest number of ranks that a mesh of `mesh_nodes` nodes uses with an efficiency of 45 %,
/// on nodes of `cores_per_node` cores: a part of a node, or whole nodes, at most `most_nodes`.
#[must_use]
pub fn ranks_for(mesh_nodes: u32, cores_per_node: u32, most_nodes: u32) -> u32 {
    let cores_per_node = cores_per_node.max(1);
    let is_worth = |ranks: u32| {
        efficiency(f64::from(mesh_nodes.max(1)), ranks, cores_per_node) >= LEAST_EFFICIENCY
    };
    let whole = |nodes: &u32| is_worth(nodes.saturating_mul(cores_per_node));
    let nodes = (1..=most_nodes.max(1)).take_while(whole).last();
    match nodes {
        Some(nodes) => nodes * cores_per_node,
        None => (1..=cores_per_node)
            .rev()
            .find(|ranks| is_worth(*ranks))
            .unwrap_or(1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of the table in docs/measurements/scaling.md, over its time on one rank.
    #[test]
    fn the_model_is_that_of_the_script() {
        for (ranks, expected_s) in [(2, 117.20), (16, 16.48), (128, 3.65), (512, 61.60)] {
            let of_beat = beat_s(64_000, ranks, 128);
            assert!(
                (of_beat / expected_s - 1.0).abs() < 0.03,
                "{ranks}: {of_beat}"
            );
        }
    }

    /// Beats that were measured on one processor and on two (docs/measurements/performance.md).
    #[test]
    fn beats_of_other_sizes_take_what_was_measured() {
        for (mesh_nodes, ranks, measured_s) in
            [(8_000, 2, 8.76), (64_000, 2, 111.6), (160_000, 2, 330.8)]
        {
            let expected_s = beat_s(mesh_nodes, ranks, 128);
            assert!(
                (0.75..1.35).contains(&(expected_s / measured_s)),
                "{mesh_nodes}: {expected_s}"
            );
        }
    }

    #[test]
    fn small_meshes_share_a_node_and_large_ones_take_several() {
        let ranks = |mesh_nodes| ranks_for(mesh_nodes, 128, 16);
        assert_eq!(ranks(1), 1);
        assert!((8..64).contains(&ranks(8_000)), "{}", ranks(8_000));
        assert_eq!(ranks(64_000), 128);
        assert_eq!(ranks(160_000), 128);
        assert_eq!(ranks(1_000_000), 2 * 128);
        assert_eq!(ranks_for(10_000_000, 128, 4), 512);
        for (few, many) in [(500, 1000), (4000, 8000), (64_000, 128_000)] {
            assert!(ranks(few) <= ranks(many));
        }
    }
}
