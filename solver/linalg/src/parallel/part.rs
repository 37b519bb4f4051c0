//! The part of a mesh on one rank.

use super::{Layout, MessageReader, MessageWriter, Neighbour};

/// Marks a node that this rank does not hold.
const ELSEWHERE: u32 = u32::MAX;

/// Nodes and elements of a rank, in the order of the whole mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Global number of each node held: owned nodes in ascending order, then ghosts by owner, in
    /// ascending order.
    pub nodes: Vec<u32>,
    /// Global numbers of the elements to compute, ascending: those with an owned node.
    pub elements: Vec<u32>,
    /// Whether this rank counts the element, because it owns the lowest of its nodes.
    pub speaks_for: Vec<bool>,
    /// Owned nodes, ghosts and exchanges.
    pub layout: Layout,
    /// Global numbers of the ghosts, ascending, with their local positions.
    ghosts: Vec<(u32, u32)>,
}

impl Part {
    /// The whole mesh on one rank.
    #[must_use]
    pub fn whole(n_nodes: usize, n_elements: usize) -> Self {
        Self {
            nodes: (0..n_nodes as u32).collect(),
            elements: (0..n_elements as u32).collect(),
            speaks_for: vec![true; n_elements],
            layout: Layout::whole(n_nodes),
            ghosts: vec![],
        }
    }

    /// The part of `rank`, where `owners` gives the rank of each node.
    #[must_use]
    pub fn of(rank: usize, owners: &[u32], tets: &[[u32; 4]]) -> Self {
        let own = |node: u32| owners[node as usize] as usize == rank;
        let (mut elements, mut speaks_for, mut ghosts) = (vec![], vec![], vec![]);
        // Owned nodes that other ranks hold, because they share an element with one of their nodes.
        let mut sent: Vec<(u32, u32)> = vec![];
        for (e, tet) in tets
            .iter()
            .enumerate()
            .filter(|(_, tet)| tet.iter().any(|n| own(*n)))
        {
            elements.push(e as u32);
            speaks_for.push(tet.iter().min().is_some_and(|lowest| own(*lowest)));
            for &other in tet.iter().filter(|n| !own(**n)) {
                let to = owners[other as usize];
                ghosts.push((to, other));
                sent.extend(tet.iter().filter(|n| own(**n)).map(|n| (to, *n)));
            }
        }
        for pairs in [&mut ghosts, &mut sent] {
            pairs.sort_unstable();
            pairs.dedup();
        }
        let mut nodes: Vec<u32> = (0..owners.len() as u32).filter(|n| own(*n)).collect();
        let n_owned = nodes.len();
        nodes.extend(ghosts.iter().map(|(_, node)| *node));
        let mut place = vec![ELSEWHERE; owners.len()];
        for (k, node) in nodes.iter().enumerate() {
            place[*node as usize] = k as u32;
        }
        let here = |(_, node): &(u32, u32)| place[*node as usize];
        let neighbours = ghosts
            .chunk_by(|a, b| a.0 == b.0)
            .zip(sent.chunk_by(|a, b| a.0 == b.0))
            .map(|(ghosts, sent)| Neighbour {
                rank: ghosts[0].0 as usize,
                send: sent.iter().map(here).collect(),
                receive: ghosts.iter().map(here).collect(),
            })
            .collect();
        let layout = Layout {
            n_owned,
            n_local: nodes.len(),
            neighbours,
        };
        Self::with(nodes, elements, speaks_for, layout)
    }

    fn with(nodes: Vec<u32>, elements: Vec<u32>, speaks_for: Vec<bool>, layout: Layout) -> Self {
        let mut ghosts: Vec<(u32, u32)> = (layout.n_owned..nodes.len())
            .map(|place| (nodes[place], place as u32))
            .collect();
        ghosts.sort_unstable();
        Self {
            nodes,
            elements,
            speaks_for,
            layout,
            ghosts,
        }
    }

    /// Local position of a node by its global number; `None` if this rank does not hold it.
    #[must_use]
    pub fn local(&self, node: u32) -> Option<u32> {
        let ghost = |at: usize| self.ghosts[at].1;
        self.owned(node).or_else(|| {
            self.ghosts
                .binary_search_by_key(&node, |(number, _)| *number)
                .ok()
                .map(ghost)
        })
    }

    /// Local position of an owned node by its global number; `None` if this rank does not own it.
    #[must_use]
    pub fn owned(&self, node: u32) -> Option<u32> {
        self.owned_nodes()
            .binary_search(&node)
            .ok()
            .map(|place| place as u32)
    }

    /// Global numbers of the owned nodes.
    #[must_use]
    pub fn owned_nodes(&self) -> &[u32] {
        &self.nodes[..self.layout.n_owned]
    }

    /// Writes the part for a rank without the mesh; [`Self::unpack`] reads it.
    pub fn pack(&self, to: &mut MessageWriter) {
        to.indices(&self.nodes)
            .indices(&self.elements)
            .flags(&self.speaks_for);
        let neighbours = &self.layout.neighbours;
        to.indices(&[self.layout.n_owned as u32])
            .indices(&neighbours.iter().map(|n| n.rank as u32).collect::<Vec<_>>());
        for neighbour in neighbours {
            to.indices(&neighbour.send).indices(&neighbour.receive);
        }
    }

    /// Reads a part that [`Self::pack`] wrote.
    ///
    /// # Panics
    /// If the message holds other content.
    #[must_use]
    pub fn unpack(from: &mut MessageReader<'_>) -> Self {
        let (nodes, elements, speaks_for) = (from.indices(), from.indices(), from.flags());
        let (n_owned, ranks) = (from.indices()[0] as usize, from.indices());
        let mut neighbour = |rank: u32| Neighbour {
            rank: rank as usize,
            send: from.indices(),
            receive: from.indices(),
        };
        let neighbours = ranks.into_iter().map(&mut neighbour).collect();
        let layout = Layout {
            n_owned,
            n_local: nodes.len(),
            neighbours,
        };
        Self::with(nodes, elements, speaks_for, layout)
    }

    /// Values of the nodes held, from those of the whole mesh with `width` values per node.
    #[must_use]
    pub fn take<T: Copy>(&self, width: usize, values: &[T]) -> Vec<T> {
        self.nodes
            .iter()
            .flat_map(|n| &values[*n as usize * width..(*n as usize + 1) * width])
            .copied()
            .collect()
    }
}
