//! Elements and nodes around each node, in compressed rows.

/// A list of positions for each row: `items[starts[i]..starts[i + 1]]`, ascending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adjacency {
    /// Starts of the rows in `items`; the length is the number of rows plus 1.
    pub starts: Vec<usize>,
    /// Items of all rows, one row after the other.
    pub items: Vec<u32>,
}

impl Adjacency {
    /// The elements around each of `n_nodes` nodes.
    #[must_use]
    pub fn node_to_tets(n_nodes: usize, tets: &[[u32; 4]]) -> Self {
        let mut starts = vec![0; n_nodes + 1];
        for node in tets.iter().flatten() {
            starts[*node as usize + 1] += 1;
        }
        for i in 0..n_nodes {
            starts[i + 1] += starts[i];
        }
        let mut at = starts.clone();
        let mut items = vec![0; starts[n_nodes]];
        for (e, tet) in tets.iter().enumerate() {
            for node in tet {
                items[at[*node as usize]] = e as u32;
                at[*node as usize] += 1;
            }
        }
        Self { starts, items }
    }

    /// The nodes that share an element with each node, itself included: the pattern of a
    /// finite-element matrix.
    #[must_use]
    pub fn node_to_nodes(n_nodes: usize, tets: &[[u32; 4]]) -> Self {
        let around = Self::node_to_tets(n_nodes, tets);
        let mut starts = Vec::with_capacity(n_nodes + 1);
        starts.push(0);
        let mut items = Vec::with_capacity(16 * n_nodes);
        let mut row: Vec<u32> = Vec::new();
        for node in 0..n_nodes {
            row.clear();
            row.push(node as u32);
            for e in around.row(node) {
                row.extend_from_slice(&tets[*e as usize]);
            }
            row.sort_unstable();
            row.dedup();
            items.extend_from_slice(&row);
            starts.push(items.len());
        }
        Self { starts, items }
    }

    /// Number of rows, one for each node.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Items of row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> &[u32] {
        &self.items[self.starts[i]..self.starts[i + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_two_elements() {
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let elements = Adjacency::node_to_tets(6, &tets);
        assert_eq!(elements.row(0), [0]);
        assert_eq!(elements.row(2), [0, 1]);
        assert!(elements.row(5).is_empty());
        let nodes = Adjacency::node_to_nodes(6, &tets);
        assert_eq!(nodes.row(0), [0, 1, 2, 3]);
        assert_eq!(nodes.row(3), [0, 1, 2, 3, 4]);
        assert_eq!(nodes.row(5), [5]);
    }
}
