//! Nodes of a rank.

/// Exchanges of a rank with another one.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Neighbour {
    /// Number of the other rank.
    pub rank: usize,
    /// Own nodes that the other rank holds as ghosts, in the order of its `receive`.
    pub send: Vec<u32>,
    /// Ghosts on this rank that the other rank owns.
    pub receive: Vec<u32>,
}

/// Nodes of a rank: owned ones first, then ghosts. A rank computes every element that touches an
/// owned node, so that rows of owned nodes are complete without communication.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Layout {
    /// Number of nodes that this rank owns.
    pub n_owned: usize,
    /// Number of nodes that this rank holds, including ghosts.
    pub n_local: usize,
    /// Exchanges with other ranks, in ascending order of ranks.
    pub neighbours: Vec<Neighbour>,
}

impl Layout {
    /// All nodes on one rank.
    #[must_use]
    pub fn whole(n_nodes: usize) -> Self {
        Self {
            n_owned: n_nodes,
            n_local: n_nodes,
            neighbours: vec![],
        }
    }
}
