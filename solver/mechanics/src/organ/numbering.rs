//! Rank 0's record of which rank holds which nodes and points, to merge ranks' values in the order of a single rank.

use super::rank::{OrganRank, Places};

/// For each rank, the positions of its values in the whole ventricle.
#[derive(Debug, Clone, Default, PartialEq)]
struct Lists {
    n_all: usize,
    of_ranks: Vec<Vec<u32>>,
}

/// Nodes, points and muscle nodes of each rank.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct GlobalNumbering {
    nodes: Lists,
    /// Points for which a rank is responsible: each point is in exactly one list.
    spoken_points: Lists,
    /// Points that a rank holds; points of elements at the cut are in several lists.
    held_points: Lists,
    muscle: Lists,
    /// Nodes of the muscle, ascending.
    pub muscle_nodes: Vec<u32>,
    /// Share of the muscle's volume of each muscle node.
    pub weights: Vec<f64>,
}

impl GlobalNumbering {
    /// Collects the record from all ranks; it is empty on all but rank 0. Collective.
    pub fn take(rank: &OrganRank) -> Self {
        let comm = rank.comm();
        let owned: Vec<f64> = rank
            .part
            .owned_nodes()
            .iter()
            .map(|n| f64::from(*n))
            .collect();
        let elements: Vec<f64> = rank.points().map(|(e, _)| f64::from(e)).collect();
        let speaks: Vec<f64> = rank
            .points()
            .map(|(_, speaks)| f64::from(u8::from(speaks)))
            .collect();
        let muscle: Vec<f64> = rank
            .average
            .nodes
            .iter()
            .map(|n| f64::from(rank.part.nodes[*n as usize]))
            .collect();
        let lists = [&owned, &elements, &speaks, &muscle, &rank.average.weights]
            .map(|list| comm.gather(list));
        let [
            Some(owned),
            Some(elements),
            Some(speaks),
            Some(muscle),
            Some(weights),
        ] = lists
        else {
            return Self::default();
        };
        let whole =
            |numbers: Vec<f64>| -> Vec<u32> { numbers.into_iter().map(|n| n as u32).collect() };
        let of_ranks: Vec<Vec<u32>> = owned.into_iter().map(whole).collect();
        let nodes = Lists {
            n_all: of_ranks.iter().map(Vec::len).sum(),
            of_ranks,
        };
        let held_points = match <[Vec<f64>; 1]>::try_from(elements) {
            // A single rank keeps its own order of points, which may differ from the order of the elements.
            Ok([all]) => Lists {
                n_all: all.len(),
                of_ranks: vec![(0..all.len() as u32).collect()],
            },
            Err(several) => Lists::ascending(several.into_iter().map(whole).collect()).0,
        };
        let spoken = |(held, speaks): (&Vec<u32>, &Vec<f64>)| {
            held.iter()
                .zip(speaks)
                .filter(|(_, speaks)| **speaks > 0.0)
                .map(|(point, _)| *point)
                .collect()
        };
        let of_ranks = held_points
            .of_ranks
            .iter()
            .zip(&speaks)
            .map(spoken)
            .collect();
        let spoken_points = Lists {
            n_all: held_points.n_all,
            of_ranks,
        };
        let (muscle, muscle_nodes) = Lists::ascending(muscle.into_iter().map(whole).collect());
        let weights = muscle.merged(1, &weights);
        Self {
            nodes,
            spoken_points,
            held_points,
            muscle,
            muscle_nodes,
            weights,
        }
    }

    /// Number of values in the whole ventricle, `width` for each place.
    pub fn n_values(&self, places: Places, width: usize) -> usize {
        width * self.spoken(places).n_all
    }

    fn spoken(&self, places: Places) -> &Lists {
        match places {
            Places::Nodes => &self.nodes,
            Places::Points => &self.spoken_points,
            Places::Muscle => &self.muscle,
        }
    }

    /// Merges the ranks' values into the whole ventricle's; empty if the ranks sent nothing.
    pub fn merged(&self, places: Places, of_ranks: &[Vec<f64>]) -> Vec<f64> {
        let lists = self.spoken(places);
        let n: usize = of_ranks.iter().map(Vec::len).sum();
        lists.merged(n / lists.n_all.max(1), of_ranks)
    }

    /// Splits the whole ventricle's values by rank: owned nodes, and all points that a rank holds.
    pub fn split(&self, places: Places, all: &[f64]) -> Vec<Vec<f64>> {
        let lists = if places == Places::Points {
            &self.held_points
        } else {
            self.spoken(places)
        };
        let width = all.len() / lists.n_all.max(1);
        let of = |place: &u32| &all[*place as usize * width..(*place as usize + 1) * width];
        lists
            .of_ranks
            .iter()
            .map(|list| list.iter().flat_map(of).copied().collect())
            .collect()
    }
}

impl Lists {
    /// Positions of the numbers among the distinct numbers in ascending order, and these distinct numbers.
    fn ascending(numbers: Vec<Vec<u32>>) -> (Self, Vec<u32>) {
        let mut all: Vec<u32> = numbers.iter().flatten().copied().collect();
        all.sort_unstable();
        all.dedup();
        let place = |n: &u32| all.binary_search(n).unwrap_or_default() as u32;
        let of_ranks = numbers
            .iter()
            .map(|numbers| numbers.iter().map(place).collect())
            .collect();
        (
            Self {
                n_all: all.len(),
                of_ranks,
            },
            all,
        )
    }

    fn merged(&self, width: usize, of_ranks: &[Vec<f64>]) -> Vec<f64> {
        let mut out = vec![0.0; width * self.n_all];
        for (list, values) in self.of_ranks.iter().zip(of_ranks) {
            for (place, values) in list.iter().zip(values.chunks_exact(width.max(1))) {
                out[*place as usize * width..(*place as usize + 1) * width].copy_from_slice(values);
            }
        }
        out
    }
}
