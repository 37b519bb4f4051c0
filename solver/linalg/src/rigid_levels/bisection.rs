//! Nested groups of nearby nodes.

/// Nested groups of nodes, the finest first. The groups of a level follow each other in `order`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Groups {
    /// Nodes, group by group.
    pub order: Vec<u32>,
    /// For each level, the first position in `order` of each group, and the number of nodes.
    pub starts: Vec<Vec<u32>>,
    /// For each level but the last, the group of the next level that contains each group.
    pub parents: Vec<Vec<u32>>,
}

impl Groups {
    /// Halves the nodes at `points` across their longest extent until a group has at most `sizes` nodes, on each level.
    ///
    /// - `sizes`: largest number of nodes in a group, ascending
    pub fn new(points: &[[f64; 3]], sizes: &[usize]) -> Self {
        let mut groups = Self {
            order: (0..points.len() as u32).collect(),
            starts: vec![vec![]; sizes.len()],
            parents: vec![vec![]; sizes.len().saturating_sub(1)],
        };
        groups.split(points, sizes, 0, points.len(), sizes.len());
        for starts in &mut groups.starts {
            starts.push(points.len() as u32);
        }
        groups
    }

    /// Splits the nodes at positions `begin` to `end`, which lie in a group of each level from `open` on.
    fn split(
        &mut self,
        points: &[[f64; 3]],
        sizes: &[usize],
        begin: usize,
        end: usize,
        mut open: usize,
    ) {
        while open > 0 && end - begin <= sizes[open - 1] {
            open -= 1;
            self.starts[open].push(begin as u32);
            if let Some(parents) = self.parents.get_mut(open) {
                parents.push(self.starts[open + 1].len() as u32 - 1);
            }
        }
        if open == 0 || begin == end {
            return;
        }
        let nodes = &mut self.order[begin..end];
        let extent = |axis: usize| {
            let along = nodes.iter().map(|n| points[*n as usize][axis]);
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                (l.min(x), h.max(x))
            });
            high - low
        };
        let axis = (1..3).fold(0, |best, axis| {
            if extent(axis) > extent(best) {
                axis
            } else {
                best
            }
        });
        let middle = nodes.len() / 2;
        nodes.select_nth_unstable_by(middle, |a, b| {
            let place = |n: u32| points[n as usize][axis];
            place(*a).total_cmp(&place(*b)).then(a.cmp(b))
        });
        let middle = begin + middle;
        // The order within a group is that of the nodes' numbers, so that it does not depend on the selection.
        self.order[begin..middle].sort_unstable();
        self.order[middle..end].sort_unstable();
        self.split(points, sizes, begin, middle, open);
        self.split(points, sizes, middle, end, open);
    }

    /// Group of each node on a level.
    pub fn of_nodes(&self, level: usize) -> Vec<u32> {
        let mut group = vec![0; self.order.len()];
        for (k, of_group) in self.starts[level].windows(2).enumerate() {
            for node in &self.order[of_group[0] as usize..of_group[1] as usize] {
                group[*node as usize] = k as u32;
            }
        }
        group
    }

    /// Nodes of a group.
    pub fn nodes(&self, level: usize, group: usize) -> &[u32] {
        let starts = &self.starts[level];
        &self.order[starts[group] as usize..starts[group + 1] as usize]
    }

    /// Number of groups on a level.
    pub fn len(&self, level: usize) -> usize {
        self.starts[level].len() - 1
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn groups_are_nested_small_and_complete(
            points in prop::collection::vec([-1.0..1.0, -1.0..1.0, -3.0..3.0_f64], 0..200),
        ) {
            let sizes = [3, 10, 40];
            let groups = Groups::new(&points, &sizes);
            let mut all = groups.order.clone();
            all.sort_unstable();
            prop_assert_eq!(all, (0..points.len() as u32).collect::<Vec<_>>());
            for (level, size) in sizes.iter().enumerate() {
                let group = groups.of_nodes(level);
                for k in 0..groups.len(level) {
                    let nodes = groups.nodes(level, k);
                    prop_assert!(nodes.len() <= *size);
                    prop_assert!(points.is_empty() || !nodes.is_empty());
                    for node in nodes {
                        prop_assert_eq!(group[*node as usize] as usize, k);
                    }
                    if let (Some(parents), Some(first)) = (groups.parents.get(level), nodes.first()) {
                        let above = groups.of_nodes(level + 1);
                        prop_assert!(nodes.iter().all(|n| above[*n as usize] == parents[k]));
                        prop_assert_eq!(above[*first as usize], parents[k]);
                    }
                }
            }
        }
    }
}
