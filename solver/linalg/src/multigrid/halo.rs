//! Exchanges between the ranks of a level: values of ghosts, contributions to other ranks' nodes,
//! and lists of any length.

use crate::Pattern;
use crate::parallel::{Communicator, Layout, Neighbour};

/// Distribution of a level's nodes over the ranks. Each rank holds its own nodes first and then
/// ghosts, in ascending order of their global numbers. Global numbers run through the nodes of rank
/// 0, then those of rank 1, and so on.
#[derive(Debug)]
pub(super) struct Halo {
    pub(super) n_owned: usize,
    pub(super) n_local: usize,
    /// Numbers of the neighbouring ranks, ascending.
    ranks: Vec<usize>,
    /// Own nodes that neighbours hold, grouped by neighbour, and ghosts in the same grouping.
    send: Vec<u32>,
    receive: Vec<u32>,
    /// Exchanges within a buffer that holds `send` first and then `receive`, and in the opposite
    /// direction.
    forth: Layout,
    back: Layout,
}

impl Halo {
    pub(super) fn new(layout: &Layout) -> Self {
        let ranks: Vec<usize> = layout.neighbours.iter().map(|n| n.rank).collect();
        let send: Vec<u32> = layout
            .neighbours
            .iter()
            .flat_map(|n| &n.send)
            .copied()
            .collect();
        let receive: Vec<u32> = layout
            .neighbours
            .iter()
            .flat_map(|n| &n.receive)
            .copied()
            .collect();
        let sizes: Vec<[usize; 2]> = layout
            .neighbours
            .iter()
            .map(|n| [n.send.len(), n.receive.len()])
            .collect();
        let forth = within_buffer(&ranks, &sizes);
        let turned = |n: &Neighbour| Neighbour {
            rank: n.rank,
            send: n.receive.clone(),
            receive: n.send.clone(),
        };
        let back = Layout {
            neighbours: forth.neighbours.iter().map(turned).collect(),
            ..forth.clone()
        };
        Self {
            n_owned: layout.n_owned,
            n_local: layout.n_local,
            ranks,
            send,
            receive,
            forth,
            back,
        }
    }

    fn is_alone(&self) -> bool {
        self.ranks.is_empty()
    }

    /// Numbers of the neighbouring ranks.
    pub(super) fn neighbours(&self) -> &[usize] {
        &self.ranks
    }

    /// Own nodes that each neighbour holds, in the order of its ghosts.
    pub(super) fn sent(&self) -> impl Iterator<Item = &[u32]> {
        let mut rest = &self.send[..];
        self.forth.neighbours.iter().map(move |n| {
            let (own, others) = rest.split_at(n.send.len());
            rest = others;
            own
        })
    }

    /// Copies the first `width` numbers of each node from the owners to the ghosts. Collective.
    pub(super) fn update<const W: usize>(
        &self,
        comm: &dyn Communicator,
        width: usize,
        values: &mut [[f32; W]],
    ) {
        if self.is_alone() {
            return;
        }
        let mut buffer = self.packed(width, |node, k| f64::from(values[node][k]), &self.send, 0);
        comm.update_ghosts(&self.forth, width, &mut buffer);
        let arrived = &buffer[width * self.send.len()..];
        for (node, from) in self.receive.iter().zip(arrived.chunks_exact(width)) {
            values[*node as usize]
                .iter_mut()
                .zip(from)
                .for_each(|(to, from)| *to = *from as f32);
        }
    }

    /// The same for numbers in double precision, `width` per node. Collective.
    pub(super) fn update_double(&self, comm: &dyn Communicator, width: usize, values: &mut [f64]) {
        if self.is_alone() {
            return;
        }
        let mut buffer = self.packed(width, |node, k| values[node * width + k], &self.send, 0);
        comm.update_ghosts(&self.forth, width, &mut buffer);
        let arrived = &buffer[width * self.send.len()..];
        for (node, from) in self.receive.iter().zip(arrived.chunks_exact(width)) {
            values[*node as usize * width..][..width].copy_from_slice(from);
        }
    }

    /// Adds the ghosts' values to those of their owners, one neighbour after the other. Collective.
    pub(super) fn add_back<const W: usize>(
        &self,
        comm: &dyn Communicator,
        width: usize,
        values: &mut [[f32; W]],
    ) {
        if self.is_alone() {
            return;
        }
        let mut buffer = self.packed(
            width,
            |node, k| f64::from(values[node][k]),
            &self.receive,
            self.send.len(),
        );
        comm.update_ghosts(&self.back, width, &mut buffer);
        for (node, from) in self.send.iter().zip(buffer.chunks_exact(width)) {
            values[*node as usize]
                .iter_mut()
                .zip(from)
                .for_each(|(to, from)| *to += *from as f32);
        }
    }

    /// Buffer with the values of `nodes` from position `first` on.
    fn packed(
        &self,
        width: usize,
        value: impl Fn(usize, usize) -> f64,
        nodes: &[u32],
        first: usize,
    ) -> Vec<f64> {
        let mut buffer = vec![0.0; width * (self.send.len() + self.receive.len())];
        for (node, to) in nodes
            .iter()
            .zip(buffer[width * first..].chunks_exact_mut(width))
        {
            to.iter_mut()
                .enumerate()
                .for_each(|(k, to)| *to = value(*node as usize, k));
        }
        buffer
    }

    /// Sends a list to each neighbour and returns the lists received from them. Collective.
    pub(super) fn exchange(&self, comm: &dyn Communicator, lists: &[Vec<f64>]) -> Vec<Vec<f64>> {
        if self.is_alone() {
            return vec![];
        }
        let n = self.ranks.len();
        let mut lengths: Vec<f64> = lists.iter().map(|list| list.len() as f64).collect();
        lengths.resize(2 * n, 0.0);
        comm.update_ghosts(
            &within_buffer(&self.ranks, &vec![[1, 1]; n]),
            1,
            &mut lengths,
        );
        let sizes: Vec<[usize; 2]> = (0..n)
            .map(|k| [lists[k].len(), lengths[n + k] as usize])
            .collect();
        let mut buffer = lists.concat();
        let sent = buffer.len();
        buffer.resize(
            sent + sizes.iter().map(|[_, arriving]| arriving).sum::<usize>(),
            0.0,
        );
        comm.update_ghosts(&within_buffer(&self.ranks, &sizes), 1, &mut buffer);
        let mut rest = &buffer[sent..];
        let mut next = |[_, arriving]: &[usize; 2]| {
            let (own, others) = rest.split_at(*arriving);
            rest = others;
            own.to_vec()
        };
        sizes.iter().map(&mut next).collect()
    }
}

/// Layout of exchanges within a buffer that holds everything sent first and then everything
/// received, for the sizes of both with each rank.
fn within_buffer(ranks: &[usize], sizes: &[[usize; 2]]) -> Layout {
    let sent: usize = sizes.iter().map(|[send, _]| send).sum();
    let all = sent + sizes.iter().map(|[_, receive]| receive).sum::<usize>();
    let (mut from, mut to) = (0, sent);
    let mut range = |[send, receive]: &[usize; 2]| {
        let ranges = (
            (from as u32..(from + send) as u32).collect(),
            (to as u32..(to + receive) as u32).collect(),
        );
        (from, to) = (from + send, to + receive);
        ranges
    };
    let neighbour = |(rank, sizes): (&usize, &[usize; 2])| {
        let (send, receive) = range(sizes);
        Neighbour {
            rank: *rank,
            send,
            receive,
        }
    };
    Layout {
        n_owned: sent,
        n_local: all,
        neighbours: ranks.iter().zip(sizes).map(neighbour).collect(),
    }
}

/// Number of the first node of each rank, followed by the number of all nodes. Collective.
pub(super) fn first_numbers(comm: &dyn Communicator, n_owned: usize) -> Vec<u32> {
    let mut counts = vec![0.0; comm.n_ranks()];
    counts[comm.rank()] = n_owned as f64;
    comm.sum(&mut counts);
    let mut first = vec![0];
    counts
        .iter()
        .for_each(|n| first.push(first[first.len() - 1] + *n as u32));
    first
}

/// Owner of a node, by its global number.
pub(super) fn owner_of(first: &[u32], node: u32) -> usize {
    first.partition_point(|f| *f <= node) - 1
}

/// Replaces the global column numbers of a matrix with own rows by local positions. Returns the
/// layout and the global numbers of the ghosts. The pattern must be symmetric over all ranks,
/// because the nodes to send to other ranks follow from the symmetry.
pub(super) fn localised(pattern: &mut Pattern, first: &[u32], rank: usize) -> (Layout, Vec<u32>) {
    let (begin, end) = (first[rank], first[rank + 1]);
    let is_own = |c: u32| (begin..end).contains(&c);
    let mut ghosts: Vec<u32> = pattern
        .column
        .iter()
        .copied()
        .filter(|c| !is_own(*c))
        .collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let mut sent: Vec<(usize, u32)> = vec![];
    for row in 0..pattern.n_rows() {
        let others = pattern
            .row(row)
            .map(|k| pattern.column[k])
            .filter(|c| !is_own(*c));
        sent.extend(others.map(|c| (owner_of(first, c), row as u32)));
    }
    sent.sort_unstable();
    sent.dedup();
    let n_owned = (end - begin) as usize;
    let local = |c: u32| place_of(begin, n_owned, &ghosts, c);
    let neighbour = |(ghosts, sent): (&[u32], &[(usize, u32)])| Neighbour {
        rank: sent[0].0,
        send: sent.iter().map(|(_, row)| *row).collect(),
        receive: ghosts.iter().map(|c| local(*c)).collect(),
    };
    let of_ranks = ghosts.chunk_by(|a, b| owner_of(first, *a) == owner_of(first, *b));
    let neighbours = of_ranks
        .zip(sent.chunk_by(|a, b| a.0 == b.0))
        .map(neighbour)
        .collect();
    let layout = Layout {
        n_owned,
        n_local: n_owned + ghosts.len(),
        neighbours,
    };
    pattern.column.iter_mut().for_each(|c| *c = local(*c));
    (layout, ghosts)
}

/// Local position of a global number, on a rank whose own nodes begin at number `begin`.
pub(super) fn place_of(begin: u32, n_owned: usize, ghosts: &[u32], number: u32) -> u32 {
    match number.checked_sub(begin) {
        Some(own) if (own as usize) < n_owned => own,
        _ => (n_owned + ghosts.binary_search(&number).expect("a ghost of this rank")) as u32,
    }
}
