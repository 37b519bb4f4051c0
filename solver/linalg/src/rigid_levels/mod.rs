//! An additive preconditioner of several levels: block Jacobi over the nodes, and rigid motions of nested groups of nodes.
//!
//! Block Jacobi leaves the slow motions of whole regions to the Krylov method. Here each group of 16 and of 64 nodes moves as a
//! rigid body by itself, and some hundred large groups move together, with the exact Galerkin stiffness of the whole tangent,
//! volume terms included. Groups end at the border of a rank; one sum over all ranks for each application is the only
//! communication.
//!
//! Sources: Bramble, Pasciak and Xu 1990, Math. Comput. 55:1 (additive levels); Nicolaides 1987, SIAM J. Numer. Anal. 24:355
//! (aggregates).

mod bisection;
mod coarse;
mod entries;
mod galerkin;
mod motion;

use nalgebra::Matrix6;

use self::bisection::Groups;
use self::coarse::{Coarse, first_and_all};
pub use self::entries::Entries;
use self::galerkin::{moment_of, stiffness};
use self::motion::{Block6, Six, moment_about, motion_about_origin, stiffness_about};
use crate::parallel::{Communicator, VectorLayout};
use crate::{Preconditioner, SingleBlockJacobi};

/// Numbers of nodes in groups that move by themselves.
const ALONE: [usize; 2] = [16, 64];
/// Number of large groups that is aimed at, over all ranks, and the least size that they are allowed.
const TOGETHER: usize = 128;
const LEAST: usize = 500;
/// Weight of a group by itself, since the levels overlap.
const WEIGHT: f64 = 0.5;

/// Groups that move by themselves.
#[derive(Debug, Clone, PartialEq)]
struct Alone {
    centres: Vec<[f64; 3]>,
    /// Inverses of the groups' stiffness about their centres.
    inverses: Vec<Block6>,
}

/// The levels of a matrix; later changes of the matrix have no effect.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidLevels {
    groups: Groups,
    /// Finest group of each own node, and its position.
    group: Vec<u32>,
    points: Vec<[f32; 3]>,
    alone: Vec<Alone>,
    coarse: Option<Coarse>,
}

impl RigidLevels {
    fn groups(space: VectorLayout<'_>, reference: &[f64]) -> Groups {
        let n_owned = space.layout.n_owned;
        let (_, n) = first_and_all(space.comm, n_owned);
        // A quarter more, so that rounding does not double the number of groups.
        let largest = (5 * n / (4 * TOGETHER)).max(LEAST);
        let sizes: Vec<usize> = ALONE
            .into_iter()
            .filter(|size| 2 * size <= largest)
            .chain([largest])
            .collect();
        Groups::new(&reference.as_chunks::<3>().0[..n_owned], &sizes)
    }

    /// Builds the levels. Collective.
    ///
    /// - `reference`: positions by which the nodes are grouped, three numbers each
    /// - `positions`: current positions of the nodes, including ghosts, three numbers each
    #[must_use]
    pub fn new(
        space: VectorLayout<'_>,
        matrix: &dyn Entries,
        reference: &[f64],
        positions: &[f64],
    ) -> Self {
        let comm = space.comm;
        let groups = Self::groups(space, reference);
        let points = positions.as_chunks::<3>().0;
        let last = groups.parents.len();
        let (first, _) = first_and_all(comm, groups.len(last));
        let mut number = vec![0.0; space.layout.n_local];
        for (to, group) in number.iter_mut().zip(groups.of_nodes(last)) {
            *to = (first + group as usize) as f64;
        }
        comm.update_ghosts(space.layout, 1, &mut number);
        let number: Vec<u32> = number.iter().map(|x| *x as u32).collect();
        let stiffness = stiffness(matrix, points, &groups, &number);
        let alone = stiffness.alone.iter().enumerate().map(|(level, blocks)| {
            let centres = centres(&groups, level, points);
            let inverses = blocks
                .iter()
                .zip(&centres)
                .map(|(block, centre)| inverse(&stiffness_about(*centre, *centre, block)))
                .collect();
            Alone { centres, inverses }
        });
        let alone = alone.collect();
        let centres = centres(&groups, last, points);
        let per_mm = per_mm(comm, &groups, last, points, &centres);
        Self {
            group: groups.of_nodes(0),
            points: single(&points[..space.layout.n_owned]),
            alone,
            coarse: Coarse::new(comm, centres, per_mm, &stiffness.pairs),
            groups,
        }
    }

    /// `z +=` the levels' share of the solution for `r`, over own nodes. Collective.
    pub fn add(&self, comm: &dyn Communicator, r: &[f32], z: &mut [f32]) {
        let n = self.points.len();
        let last = self.groups.parents.len();
        let mut forces: Vec<Vec<Six>> = (0..=last)
            .map(|level| vec![[0.0; 6]; self.groups.len(level)])
            .collect();
        for ((f, x), group) in r.as_chunks::<3>().0[..n]
            .iter()
            .zip(&self.points)
            .zip(&self.group)
        {
            let (to, from) = (&mut forces[0][*group as usize], moment_of(*x, *f));
            (0..6).for_each(|i| to[i] += f64::from(from[i]));
        }
        for level in 0..last {
            let (below, above) = forces.split_at_mut(level + 1);
            for (from, parent) in below[level].iter().zip(&self.groups.parents[level]) {
                let to = &mut above[0][*parent as usize];
                (0..6).for_each(|i| to[i] += from[i]);
            }
        }
        let mut motions = match &self.coarse {
            Some(coarse) => coarse.solve(comm, &forces[last]),
            None => vec![[0.0; 6]; self.groups.len(last)],
        };
        for level in (0..last).rev() {
            let Alone { centres, inverses } = &self.alone[level];
            motions = (self.groups.parents[level].iter())
                .zip(&forces[level])
                .zip(centres.iter().zip(inverses))
                .map(|((parent, force), (centre, inverse))| {
                    let force = moment_about(*centre, force);
                    let about: Six = std::array::from_fn(|i| {
                        WEIGHT * (0..6).map(|j| inverse[6 * i + j] * force[j]).sum::<f64>()
                    });
                    let (own, of_parent) = (
                        motion_about_origin(*centre, &about),
                        &motions[*parent as usize],
                    );
                    std::array::from_fn(|i| own[i] + of_parent[i])
                })
                .collect();
        }
        for ((z, [x, y, w]), group) in z.as_chunks_mut::<3>().0[..n]
            .iter_mut()
            .zip(&self.points)
            .zip(&self.group)
        {
            let m = motions[*group as usize].map(|x| x as f32);
            z[0] += m[0] + m[4] * w - m[5] * y;
            z[1] += m[1] + m[5] * x - m[3] * w;
            z[2] += m[2] + m[3] * y - m[4] * x;
        }
    }

    /// This rank's part in numbers, for [`Self::from_numbers`].
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        let points = self.points.as_flattened().iter();
        let mut numbers: Vec<f64> = points.map(|x| f64::from(*x)).collect();
        for Alone { centres, inverses } in &self.alone {
            numbers.extend(centres.as_flattened());
            numbers.extend(inverses.as_flattened());
        }
        numbers.extend(self.coarse.iter().flat_map(Coarse::numbers));
        numbers
    }

    /// The levels of [`Self::numbers`]; `None` for numbers of another mesh or partition. Collective.
    #[must_use]
    pub fn from_numbers(
        space: VectorLayout<'_>,
        reference: &[f64],
        numbers: &[f64],
    ) -> Option<Self> {
        let groups = Self::groups(space, reference);
        let (points, mut rest) = numbers.split_at_checked(3 * space.layout.n_owned)?;
        let mut alone = vec![];
        for level in 0..groups.parents.len() {
            let (centres, others) = rest.split_at_checked(3 * groups.len(level))?;
            let (inverses, others) = others.split_at_checked(36 * groups.len(level))?;
            rest = others;
            alone.push(Alone {
                centres: centres.as_chunks().0.to_vec(),
                inverses: inverses.as_chunks().0.to_vec(),
            });
        }
        Some(Self {
            group: groups.of_nodes(0),
            points: single(points.as_chunks().0),
            alone,
            coarse: Coarse::from_numbers(rest),
            groups,
        })
    }
}

fn single(points: &[[f64; 3]]) -> Vec<[f32; 3]> {
    points.iter().map(|x| x.map(|x| x as f32)).collect()
}

/// Block Jacobi and the levels together.
#[derive(Debug)]
pub struct WithLevels<'a> {
    /// The nodes by themselves.
    pub jacobi: SingleBlockJacobi,
    /// The groups.
    pub levels: &'a RigidLevels,
}

impl Preconditioner<f32> for WithLevels<'_> {
    fn apply(&self, space: VectorLayout<'_>, r: &[f32], z: &mut [f32]) {
        self.jacobi.apply(space, r, z);
        self.levels.add(space.comm, r, z);
    }
}

impl Preconditioner for WithLevels<'_> {
    fn apply(&self, space: VectorLayout<'_>, r: &[f64], z: &mut [f64]) {
        let r: Vec<f32> = r.iter().map(|x| *x as f32).collect();
        let mut found = vec![0.0_f32; z.len()];
        self.apply(space, &r, &mut found);
        for (z, found) in z.iter_mut().zip(found) {
            *z = f64::from(found);
        }
    }
}

/// Mean positions of a level's groups.
fn centres(groups: &Groups, level: usize, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    (0..groups.len(level))
        .map(|group| {
            let nodes = groups.nodes(level, group);
            let mut sum = [0.0; 3];
            for node in nodes {
                (0..3).for_each(|i| sum[i] += points[*node as usize][i]);
            }
            sum.map(|x| x / nodes.len().max(1) as f64)
        })
        .collect()
}

/// Inverse of the groups' mean radius, over all ranks. Collective.
fn per_mm(
    comm: &dyn Communicator,
    groups: &Groups,
    level: usize,
    points: &[[f64; 3]],
    centres: &[[f64; 3]],
) -> f64 {
    let mut sums = [0.0; 2];
    for (group, centre) in centres.iter().enumerate() {
        for node in groups.nodes(level, group) {
            let x = &points[*node as usize];
            sums[0] += (0..3).map(|i| (x[i] - centre[i]).powi(2)).sum::<f64>();
            sums[1] += 1.0;
        }
    }
    comm.sum(&mut sums);
    let radius = (sums[0] / sums[1].max(1.0)).sqrt();
    if radius > 0.0 { 1.0 / radius } else { 1.0 }
}

/// Inverse of a group's stiffness; zero where it is not positive definite.
fn inverse(block: &Block6) -> Block6 {
    const RIDGE: f64 = 1e-7;
    let mut matrix = Matrix6::from_row_slice(block);
    matrix = 0.5 * (matrix + matrix.transpose());
    let largest = matrix.diagonal().amax();
    for k in 0..6 {
        matrix[(k, k)] += RIDGE * (matrix[(k, k)].abs() + largest);
    }
    let Some(factor) = matrix.cholesky() else {
        return [0.0; 36];
    };
    let inverse = factor.inverse();
    std::array::from_fn(|k| inverse[(k / 6, k % 6)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pattern;
    use crate::parallel::{Layout, SingleProcess};

    /// Springs between all neighbours on a line of nodes, with volumes.
    struct Line(Pattern);

    impl Entries for Line {
        fn pattern(&self) -> &Pattern {
            &self.0
        }

        fn stiffness(&self, slot: usize) -> [[f64; 3]; 3] {
            let row = self.0.row_start.partition_point(|k| *k as usize <= slot) - 1;
            let own = self.0.column[slot] as usize == row;
            let spring = |i: usize| {
                if own {
                    5.0 + i as f64
                } else {
                    -1.0 - 0.3 * i as f64
                }
            };
            std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    if i == j {
                        spring(i)
                    } else {
                        0.1 * f64::from(own)
                    }
                })
            })
        }

        fn volume_of_row(&self, slot: usize) -> [f64; 3] {
            let row = self.0.row_start.partition_point(|k| *k as usize <= slot) - 1;
            volume(row, self.0.column[slot] as usize)
        }

        fn volume_of_column(&self, slot: usize) -> [f64; 3] {
            let row = self.0.row_start.partition_point(|k| *k as usize <= slot) - 1;
            volume(self.0.column[slot] as usize, row)
        }

        fn bulk(&self) -> &[f64] {
            &[3.0; 40]
        }
    }

    fn volume(of: usize, node: usize) -> [f64; 3] {
        std::array::from_fn(|i| (of as f64 - 1.7 * node as f64 + i as f64).cos())
    }

    fn product(line: &Line, x: &[f64]) -> Vec<f64> {
        let n = line.0.n_rows();
        let (mut y, mut p) = (vec![0.0; x.len()], vec![0.0; n]);
        for row in 0..n {
            for slot in line.0.row(row) {
                let column = line.0.column[slot] as usize;
                let (k, g) = (line.stiffness(slot), line.volume_of_row(slot));
                for j in 0..3 {
                    (0..3).for_each(|i| y[3 * row + i] += k[i][j] * x[3 * column + j]);
                    p[row] += g[j] * x[3 * column + j];
                }
            }
        }
        for row in 0..n {
            for slot in line.0.row(row) {
                let vertex = line.0.column[slot] as usize;
                let g = line.volume_of_column(slot);
                (0..3).for_each(|i| y[3 * row + i] += 3.0 * g[i] * p[vertex]);
            }
        }
        y
    }

    #[test]
    fn motions_of_groups_are_found_from_their_forces() {
        let n = 40;
        let pairs: Vec<[u32; 2]> = (1..n).map(|k| [k - 1, k]).collect();
        let line = Line(Pattern::of_elements(
            n as usize,
            pairs.iter().map(|p| (&p[..], &p[..])),
        ));
        let layout = Layout::whole(n as usize);
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let points: Vec<f64> = (0..n)
            .flat_map(|k| {
                let k = f64::from(k);
                [20.0 + k, (0.9 * k).sin(), (1.3 * k).cos()]
            })
            .collect();
        let levels = RigidLevels::new(space, &line, &points, &points);
        assert_eq!(levels.groups.parents.len(), 2);
        let motion =
            |group: usize| -> Six { std::array::from_fn(|i| ((3 * group + i) as f64).sin()) };
        // Each level finds a motion of its own groups from the forces that it causes: all groups at once on the last level,
        // each by itself on the others.
        for level in 0..3 {
            let of_nodes = levels.groups.of_nodes(level);
            let mut found = vec![];
            for alone in 0..levels.groups.len(level) {
                let mut x = vec![0.0; 3 * n as usize];
                for (node, group) in of_nodes.iter().enumerate() {
                    if *group as usize == alone {
                        let m = motion(alone);
                        let p: [f64; 3] = std::array::from_fn(|i| points[3 * node + i]);
                        let turned = motion::cross([m[3], m[4], m[5]], p);
                        (0..3).for_each(|i| x[3 * node + i] = m[i] + turned[i]);
                    }
                }
                let r = product(&line, &x);
                let mut force = [0.0; 6];
                for (node, group) in of_nodes.iter().enumerate() {
                    if *group as usize == alone {
                        let f: [f64; 3] = std::array::from_fn(|i| r[3 * node + i]);
                        let p: [f64; 3] = std::array::from_fn(|i| points[3 * node + i]);
                        let from = moment_of(p, f);
                        (0..6).for_each(|i| force[i] += from[i]);
                    }
                }
                found.push(match levels.alone.get(level) {
                    Some(Alone { centres, inverses }) => {
                        let (centre, inverse) = (centres[alone], &inverses[alone]);
                        let force = moment_about(centre, &force);
                        let about: Six = std::array::from_fn(|i| {
                            (0..6).map(|j| inverse[6 * i + j] * force[j]).sum()
                        });
                        motion_about_origin(centre, &about)
                    }
                    None => {
                        let coarse = levels.coarse.as_ref().expect("positive definite");
                        coarse.solve(&SingleProcess, &[force])[alone]
                    }
                });
            }
            for (group, found) in found.iter().enumerate() {
                for (x, wanted) in found.iter().zip(motion(group)) {
                    assert!((x - wanted).abs() < 1e-3, "{level} {group}: {x} {wanted}");
                }
            }
        }
    }
}
