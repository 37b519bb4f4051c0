//! Construction of the next coarser level: the smoothed prolongation and the Galerkin matrix.
//!
//! Columns are numbers of groups over all ranks. Each rank computes the rows of its own nodes. From
//! other ranks it needs the prolongation of its ghosts, and the contributions of their nodes to its
//! groups.

use std::collections::BTreeMap;

use super::blocks::{Block, Blocks, Row, add_times, add_transposed_times};
use super::halo::{Halo, owner_of};
use crate::parallel::Communicator;

/// `(I − ω D⁻¹ A) T`, where `T` holds the rigid motions of the groups: rows of own nodes.
///
/// - `group`, `tentative`: for all nodes held
pub(super) fn smoothed<const W: usize, const B: usize>(
    matrix: &Blocks<W, B>,
    inverses: &[Block<W, B>],
    omega: f32,
    group: &[u32],
    tentative: &[Block<W, 6>],
) -> Blocks<W, 6> {
    let mut out = Blocks::empty();
    let mut row = Row::<W, 6>::new();
    for k in 0..inverses.len() {
        row.clear();
        for slot in matrix.pattern.row(k) {
            let other = matrix.pattern.column[slot] as usize;
            add_times(
                &matrix.blocks[slot],
                &tentative[other],
                row.at(group[other]),
            );
        }
        for block in row.blocks_mut() {
            let mut scaled = [[0.0; W]; 6];
            add_times(&inverses[k], block, &mut scaled);
            *block = scaled.map(|column| column.map(|x| -omega * x));
        }
        let own = row.at(group[k]);
        for j in 0..6 {
            for i in 0..W {
                own[j][i] += tentative[k][j][i];
            }
        }
        row.append_to(&mut out);
    }
    out.shrink();
    out
}

/// Appends a block's column and values to a message.
fn pack<const W: usize>(column: u32, block: &Block<W, 6>, to: &mut Vec<f64>) {
    to.push(f64::from(column));
    to.extend(block.as_flattened().iter().map(|x| f64::from(*x)));
}

/// Block at the beginning of a message, and the rest of the message.
fn unpack<const W: usize>(from: &[f64]) -> (u32, Block<W, 6>, &[f64]) {
    let (own, rest) = from.split_at(1 + 6 * W);
    let mut block = [[0.0; W]; 6];
    block
        .as_flattened_mut()
        .iter_mut()
        .zip(&own[1..])
        .for_each(|(to, from)| *to = *from as f32);
    (own[0] as u32, block, rest)
}

/// Rows of the ghosts, in the order of the ghosts. Collective.
fn of_ghosts<const W: usize>(
    comm: &dyn Communicator,
    halo: &Halo,
    p: &Blocks<W, 6>,
) -> Blocks<W, 6> {
    let lists: Vec<Vec<f64>> = halo
        .sent()
        .map(|nodes| {
            let mut list = vec![];
            for node in nodes {
                let row = p.pattern.row(*node as usize);
                list.push(row.len() as f64);
                row.for_each(|k| pack(p.pattern.column[k], &p.blocks[k], &mut list));
            }
            list
        })
        .collect();
    let mut out = Blocks::empty();
    // Ghosts follow the own nodes, in the order of their owners.
    for list in halo.exchange(comm, &lists) {
        let mut rest = &list[..];
        while let Some((n, blocks)) = rest.split_first() {
            rest = blocks;
            for _ in 0..*n as usize {
                let (column, block, others) = unpack(rest);
                out.pattern.column.push(column);
                out.blocks.push(block);
                rest = others;
            }
            out.pattern.row_start.push(out.pattern.column.len() as u32);
        }
    }
    out
}

/// `Pᵀ A P`: rows of own groups. Collective.
///
/// A row of `A P` is discarded as soon as it has been added to the groups that its node reaches,
/// because the whole product is several times as large as the result.
///
/// - `first`: number of the first group of each rank
pub(super) fn galerkin<const W: usize, const B: usize>(
    comm: &dyn Communicator,
    halo: &Halo,
    matrix: &Blocks<W, B>,
    p: &Blocks<W, 6>,
    first: &[u32],
) -> Blocks<8, 6> {
    let n = p.pattern.n_rows();
    let ghosts = of_ghosts(comm, halo, p);
    let (begin, end) = (first[comm.rank()], first[comm.rank() + 1]);
    let mut own: Vec<Row<8, 6>> = (begin..end).map(|_| Row::new()).collect();
    let mut of_others = BTreeMap::<u32, Row<8, 6>>::new();
    let mut product = Row::<W, 6>::new();
    for k in 0..n {
        product.clear();
        for slot in matrix.pattern.row(k) {
            let column = matrix.pattern.column[slot] as usize;
            let (p, row) = if column < n {
                (p, column)
            } else {
                (&ghosts, column - n)
            };
            for q in p.pattern.row(row) {
                add_times(
                    &matrix.blocks[slot],
                    &p.blocks[q],
                    product.at(p.pattern.column[q]),
                );
            }
        }
        for slot in p.pattern.row(k) {
            let c = p.pattern.column[slot];
            let row = if (begin..end).contains(&c) {
                &mut own[(c - begin) as usize]
            } else {
                of_others.entry(c).or_insert_with(Row::new)
            };
            for (column, block) in product.iter() {
                add_transposed_times(&p.blocks[slot], block, row.at(column));
            }
        }
    }
    drop(ghosts);
    let mut lists: Vec<Vec<f64>> = vec![vec![]; halo.neighbours().len()];
    for (c, row) in of_others {
        let owner = owner_of(first, c);
        let to = halo
            .neighbours()
            .binary_search(&owner)
            .expect("own nodes reach groups of neighbours alone");
        lists[to].extend([f64::from(c), row.len() as f64]);
        row.iter()
            .for_each(|(column, block)| pack(column, block, &mut lists[to]));
    }
    for list in halo.exchange(comm, &lists) {
        let mut rest = &list[..];
        while let [c, n, blocks @ ..] = rest {
            let row = &mut own[(*c as u32 - begin) as usize];
            rest = blocks;
            for _ in 0..*n as usize {
                let (column, block, others) = unpack::<8>(rest);
                let to = row.at(column).as_flattened_mut();
                to.iter_mut()
                    .zip(block.as_flattened())
                    .for_each(|(to, x)| *to += x);
                rest = others;
            }
        }
    }
    let mut out = Blocks::with_capacity(own.len(), own.iter().map(Row::len).sum());
    own.into_iter().for_each(|row| row.append_to(&mut out));
    out
}
