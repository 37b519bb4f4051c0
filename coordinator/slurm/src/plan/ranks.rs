//! Number of MPI ranks that a mesh can use, by the model of `deploy/scaling-model.py`.
//!
//! Times are of one Krylov iteration, which takes most of a beat: the work of a rank's nodes, halos
//! to its neighbours, and reductions in ⌈log₂ R⌉ rounds. docs/scaling.md explains the model and
//! docs/measurements/scaling.md has the counts and rates that its constants were taken from.

/// Time of an iteration for each node of the mesh on one core, s: matrix (7.4 ms for 64,000 nodes)
/// and the elements' work of the beat spread over its iterations (49.4 s over 45,504).
const S_PER_NODE: f64 = (7.4e-3 + 49.4 / 45_504.0) / 64_000.0;
/// Halo exchanges of an iteration.
const HALOS: f64 = 2.2;
/// Reductions of an iteration.
const REDUCTIONS: f64 = 2.7;
/// Latency of a message within a node, s.
const NEAR_S: f64 = 0.8e-6;
/// Latency of a message between nodes, s.
const FAR_S: f64 = 2.0e-6;
/// Cost of a message to its sender, s.
const OVERHEAD_S: f64 = 0.4e-6;
/// Time for each byte of a rank's messages, s.
const S_PER_BYTE: f64 = 1.0 / 2.0e9;
/// Bytes of a halo for each ghost node.
const BYTES_PER_GHOST: f64 = 35.0;
/// Smallest parallel efficiency that a simulation is given ranks for. With more ranks, most of
/// their time would be waiting, and another simulation makes better use of the cores.
const LEAST_EFFICIENCY: f64 = 0.5;

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
    mesh_nodes * S_PER_NODE * overlap / n
        + HALOS * halo_s
        + REDUCTIONS * rounds * (latency_s + OVERHEAD_S)
}

/// Parallel efficiency that is expected of `ranks` ranks.
fn efficiency(mesh_nodes: f64, ranks: u32, cores_per_node: u32) -> f64 {
    iteration_s(mesh_nodes, 1, cores_per_node)
        / (f64::from(ranks) * iteration_s(mesh_nodes, ranks, cores_per_node))
}

/// Largest number of ranks that a mesh of `mesh_nodes` nodes uses with an efficiency of one half,
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
        for (ranks, beat_s) in [(2, 206.79), (16, 28.57), (128, 5.32), (512, 4.28)] {
            let of_beat = iteration_s(64_000.0, ranks, 128) * 45_504.0;
            assert!((of_beat / beat_s - 1.0).abs() < 0.03, "{ranks}: {of_beat}");
        }
    }

    #[test]
    fn small_meshes_share_a_node_and_large_ones_take_several() {
        let ranks = |mesh_nodes| ranks_for(mesh_nodes, 128, 16);
        assert_eq!(ranks(1), 1);
        assert!((8..64).contains(&ranks(8_000)), "{}", ranks(8_000));
        assert_eq!(ranks(64_000), 128);
        assert_eq!(ranks(160_000), 128);
        assert_eq!(ranks(1_000_000), 9 * 128);
        assert_eq!(ranks_for(10_000_000, 128, 4), 512);
        for (few, many) in [(500, 1000), (4000, 8000), (64_000, 128_000)] {
            assert!(ranks(few) <= ranks(many));
        }
    }
}
