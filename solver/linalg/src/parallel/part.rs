//! What one rank holds of a mesh.

use super::{Layout, MessageReader, MessageWriter, Neighbour};

/// Not among the nodes of a rank.
const ELSEWHERE: u32 = u32::MAX;

/// Nodes and elements of a rank, in an order that follows that of the whole mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Number in the whole mesh of each node held: owned ones ascending, then ghosts by owner, ascending.
    pub nodes: Vec<u32>,
    /// Number in the whole mesh of each element computed, ascending: those with a node that this rank owns.
    pub elements: Vec<u32>,
    /// Whether this rank speaks for the element: it owns the lowest of its nodes.
    pub speaks_for: Vec<bool>,
    /// Owned nodes, ghosts, exchanges.
    pub layout: Layout,
    /// Ghosts by number in the whole mesh, ascending, with their places here.
    ghosts: Vec<(u32, u32)>,
}

impl Part {
    /// All of a mesh.
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

    /// The part of `rank`, where `owners` names the rank of each node.
    #[must_use]
    pub fn of(rank: usize, owners: &[u32], tets: &[[u32; 4]]) -> Self {
        let own = |node: u32| owners[node as usize] as usize == rank;
        let (mut elements, mut speaks_for, mut ghosts) = (vec![], vec![], vec![]);
        // Owned nodes that other ranks hold: those that share an element with one of theirs.
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

    /// Where this rank holds a node of the whole mesh.
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

    /// Where this rank holds a node of the whole mesh that it owns.
    #[must_use]
    pub fn owned(&self, node: u32) -> Option<u32> {
        self.owned_nodes()
            .binary_search(&node)
            .ok()
            .map(|place| place as u32)
    }

    /// Numbers in the whole mesh of the owned nodes.
    #[must_use]
    pub fn owned_nodes(&self) -> &[u32] {
        &self.nodes[..self.layout.n_owned]
    }

    /// Writes the part for a rank that has no mesh; [`Self::unpack`] reads it.
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

    /// Reads what [`Self::pack`] wrote.
    ///
    /// # Panics
    /// Where it is something else.
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

    /// Values of the nodes held, from those of the whole mesh, `width` a node.
    #[must_use]
    pub fn take<T: Copy>(&self, width: usize, values: &[T]) -> Vec<T> {
        self.nodes
            .iter()
            .flat_map(|n| &values[*n as usize * width..(*n as usize + 1) * width])
            .copied()
            .collect()
    }
}
