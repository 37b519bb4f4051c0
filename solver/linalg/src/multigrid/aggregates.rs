//! Aggregation of nodes. Each aggregate becomes a node of the next coarser level.

use crate::Pattern;

/// Group of each row of `pattern`, and the number of groups. A node without grouped neighbours
/// becomes a root and forms a group with all its neighbours; remaining nodes join the group that
/// contains most of their neighbours. Columns without a row (ghosts) are left out, so
/// that groups end at the border of a rank.
///
/// Source: Vaněk, Mandel and Brezina 1996, Computing 56:179, algorithm 5.1.
pub(super) fn aggregates(pattern: &Pattern) -> (Vec<u32>, usize) {
    const FREE: u32 = u32::MAX;
    let n = pattern.n_rows();
    let around = |row: usize| {
        pattern
            .row(row)
            .map(|k| pattern.column[k] as usize)
            .filter(|other| *other < n)
    };
    let mut group = vec![FREE; n];
    let mut n_groups = 0;
    for root in 0..n {
        if around(root).all(|other| group[other] == FREE) {
            around(root).for_each(|other| group[other] = n_groups);
            group[root] = n_groups;
            n_groups += 1;
        }
    }
    let of_roots = group.clone();
    for node in (0..n).filter(|node| of_roots[*node] == FREE) {
        // Neighbouring groups with their numbers of neighbours; the first of the largest is taken.
        let mut counts: Vec<(u32, u32)> = vec![];
        for other in around(node) {
            let of = of_roots[other];
            match counts.iter_mut().find(|(g, _)| *g == of) {
                _ if of == FREE => {}
                Some((_, count)) => *count += 1,
                None => counts.push((of, 1)),
            }
        }
        let most = counts
            .iter()
            .fold(None, |best: Option<(u32, u32)>, c| match best {
                Some(b) if b.1 >= c.1 => Some(b),
                _ => Some(*c),
            });
        group[node] = match most {
            Some((g, _)) => g,
            // No neighbour is in a group: a disconnected part of the mesh.
            None => {
                n_groups += 1;
                n_groups - 1
            }
        };
    }
    (group, n_groups as usize)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_node_has_a_group_and_groups_are_connected(
            n in 1_usize..60,
            edges in prop::collection::vec((0_usize..60, 0_usize..60), 0..200),
        ) {
            let pairs: Vec<[u32; 2]> = edges
                .iter()
                .map(|(a, b)| [(a % n) as u32, (b % n) as u32])
                .chain((0..n as u32).map(|k| [k, k]))
                .collect();
            let pattern = Pattern::of_elements(n, pairs.iter().map(|e| (&e[..], &e[..])));
            let (group, n_groups) = aggregates(&pattern);
            prop_assert!(group.iter().all(|g| (*g as usize) < n_groups));
            for g in 0..n_groups as u32 {
                let members: Vec<usize> = (0..n).filter(|k| group[*k] == g).collect();
                prop_assert!(!members.is_empty());
                let mut reached = vec![members[0]];
                let mut at = 0;
                while at < reached.len() {
                    for k in pattern.row(reached[at]) {
                        let next = pattern.column[k] as usize;
                        if group[next] == g && !reached.contains(&next) {
                            reached.push(next);
                        }
                    }
                    at += 1;
                }
                prop_assert_eq!(reached.len(), members.len());
            }
        }
    }
}
