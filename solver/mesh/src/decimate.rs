//! Decimation of a closed surface. The corners that remain are corners of the original surface.
//!
//! Edges are collapsed onto one of their ends, the cheapest first. The cost is the quadric error
//! (Garland and Heckbert 1997, Proc SIGGRAPH, 209) plus a small term of the edge's length, which
//! decides on flat parts. Lines between labels remain, and so do corners at which lines meet. The
//! surface stays closed and does not fold.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::vec3::{Vec3, cross, distance, dot, norm, sub};

/// Weight of the fourth power of an edge's length relative to the quadric error; both are in mm⁴.
const LENGTH: f64 = 1e-3;
/// Cosine of the largest angle by which a triangle may turn, 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// Sum of squared distances to planes, weighted with the areas of the triangles: the upper half of
/// a symmetric 4×4 matrix.
#[derive(Clone, Copy, Default)]
struct Quadric([f64; 10]);

impl Quadric {
    fn of(normal: Vec3, through: Vec3, weight: f64) -> Self {
        let [a, b, c] = normal;
        let d = -dot(normal, through);
        Self(
            [
                a * a,
                a * b,
                a * c,
                a * d,
                b * b,
                b * c,
                b * d,
                c * c,
                c * d,
                d * d,
            ]
            .map(|x| x * weight),
        )
    }

    fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a += b);
    }

    fn at(&self, [x, y, z]: Vec3) -> f64 {
        let q = &self.0;
        q[0] * x * x
            + q[4] * y * y
            + q[7] * z * z
            + q[9]
            + 2.0 * (q[1] * x * y + q[2] * x * z + q[3] * x + q[5] * y * z + q[6] * y + q[8] * z)
    }
}

/// A collapse of `from` onto `to`. The cheapest one is on top of the heap.
struct Collapse {
    cost: f64,
    from: u32,
    to: u32,
    /// Numbers of changes of both ends at the time when the cost was computed.
    seen: (u32, u32),
}

impl PartialEq for Collapse {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Collapse {}

impl PartialOrd for Collapse {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Collapse {
    fn cmp(&self, other: &Self) -> Ordering {
        // The ends break ties, so that the result does not depend on the heap's order.
        other
            .cost
            .total_cmp(&self.cost)
            .then((other.from, other.to).cmp(&(self.from, self.to)))
    }
}

struct Surface<'a> {
    points: &'a [Vec3],
    labels: &'a [u32],
    triangles: Vec<[u32; 3]>,
    alive: Vec<bool>,
    around: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    changes: Vec<u32>,
}

/// Decimates a surface. Returns the numbers of the remaining triangles, with their new corners.
///
/// - `points`: position of each corner \[mm\]
/// - `labels`: label of each triangle; lines between labels remain
/// - `target`: approximate number of triangles to keep; more remain if no further edge can be
///   collapsed
#[must_use]
pub fn decimate(
    points: &[Vec3],
    triangles: &[[u32; 3]],
    labels: &[u32],
    target: usize,
) -> Vec<(usize, [u32; 3])> {
    let mut surface = Surface {
        points,
        labels,
        triangles: triangles.to_vec(),
        alive: vec![true; triangles.len()],
        around: vec![Vec::new(); points.len()],
        quadrics: vec![Quadric::default(); points.len()],
        changes: vec![0; points.len()],
    };
    for (k, triangle) in triangles.iter().enumerate() {
        let area = surface.area(*triangle);
        let length = norm(area);
        for corner in triangle {
            surface.around[*corner as usize].push(k as u32);
            if length > 0.0 {
                let normal = area.map(|x| x / length);
                let quadric = Quadric::of(normal, points[triangle[0] as usize], 0.5 * length);
                surface.quadrics[*corner as usize].add(&quadric);
            }
        }
    }
    let mut heap = BinaryHeap::new();
    for corner in 0..points.len() as u32 {
        surface
            .neighbours(corner)
            .into_iter()
            .for_each(|to| heap.push(surface.collapse(corner, to)));
    }
    let mut left = triangles.len();
    while left > target {
        let Some(Collapse { from, to, seen, .. }) = heap.pop() else {
            break;
        };
        if seen != (surface.changes[from as usize], surface.changes[to as usize])
            || !surface.may(from, to)
        {
            continue;
        }
        left -= surface.apply(from, to);
        for corner in surface.neighbours(to) {
            heap.push(surface.collapse(corner, to));
            heap.push(surface.collapse(to, corner));
        }
    }
    surface
        .triangles
        .iter()
        .copied()
        .enumerate()
        .filter(|(k, _)| surface.alive[*k])
        .collect()
}

impl Surface<'_> {
    fn point(&self, corner: u32) -> Vec3 {
        self.points[corner as usize]
    }

    /// Normal with the length of twice the area.
    fn area(&self, [a, b, c]: [u32; 3]) -> Vec3 {
        let a = self.point(a);
        cross(sub(self.point(b), a), sub(self.point(c), a))
    }

    fn neighbours(&self, corner: u32) -> Vec<u32> {
        let around = self.around[corner as usize].iter();
        let mut found: Vec<u32> = around
            .flat_map(|k| self.triangles[*k as usize])
            .filter(|other| *other != corner)
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Triangles on both sides of an edge.
    fn shared(&self, a: u32, b: u32) -> Vec<u32> {
        self.around[a as usize]
            .iter()
            .copied()
            .filter(|k| self.triangles[*k as usize].contains(&b))
            .collect()
    }

    fn n_labels(&self, corner: u32) -> usize {
        let mut labels: Vec<u32> = self.around[corner as usize]
            .iter()
            .map(|k| self.labels[*k as usize])
            .collect();
        labels.sort_unstable();
        labels.dedup();
        labels.len()
    }

    fn collapse(&self, from: u32, to: u32) -> Collapse {
        let length = distance(self.point(from), self.point(to));
        let cost =
            self.quadrics[from as usize].at(self.point(to)).max(0.0) + LENGTH * length.powi(4);
        Collapse {
            cost,
            from,
            to,
            seen: (self.changes[from as usize], self.changes[to as usize]),
        }
    }

    /// Whether a collapse keeps the surface a surface and lines lines, and folds no triangle.
    fn may(&self, from: u32, to: u32) -> bool {
        let shared = self.shared(from, to);
        let &[left, right] = shared.as_slice() else {
            return false;
        };
        let differ = self.labels[left as usize] != self.labels[right as usize];
        match self.n_labels(from) {
            1 => {}
            // A corner on a line may only move along it.
            2 if differ => {}
            _ => return false,
        }
        let (own, theirs) = (self.neighbours(from), self.neighbours(to));
        if own
            .iter()
            .filter(|n| theirs.binary_search(n).is_ok())
            .count()
            != 2
            || own.len() + theirs.len() <= 6
        {
            return false;
        }
        self.around[from as usize]
            .iter()
            .filter(|k| !shared.contains(k))
            .all(|k| {
                let before = self.triangles[*k as usize];
                let after = before.map(|corner| if corner == from { to } else { corner });
                let (before, after) = (self.area(before), self.area(after));
                dot(before, after) > LEAST_COSINE * norm(before) * norm(after)
            })
    }

    /// Carries out a collapse and returns the number of removed triangles.
    fn apply(&mut self, from: u32, to: u32) -> usize {
        let shared = self.shared(from, to);
        for k in &shared {
            self.alive[*k as usize] = false;
            for corner in self.triangles[*k as usize] {
                self.around[corner as usize].retain(|other| other != k);
            }
        }
        for k in std::mem::take(&mut self.around[from as usize]) {
            for corner in &mut self.triangles[k as usize] {
                if *corner == from {
                    *corner = to;
                }
            }
            self.around[to as usize].push(k);
        }
        let quadric = self.quadrics[from as usize];
        self.quadrics[to as usize].add(&quadric);
        for corner in [from, to] {
            self.changes[corner as usize] += 1;
        }
        shared.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cutaway::{Plane, Side, cut};
    use crate::ellipsoid::{EllipsoidSpec, generate};
    use crate::surface::area_vector;
    use cardiotwin_units::Ml;
    use std::collections::HashMap;

    #[test]
    fn a_tenth_of_the_triangles_keeps_volume_lines_and_closedness() {
        let mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 8000))
            .unwrap()
            .mesh;
        let half = cut(
            &mesh,
            &Plane {
                point: [0.0; 3],
                normal: [0.0, -1.0, 0.0],
            },
        );
        let points: Vec<Vec3> = half.corners.iter().map(|c| c.at(&mesh.nodes_mm)).collect();
        let mut names: Vec<(Side, i32)> = half.parts.clone();
        names.sort_unstable();
        names.dedup();
        let labels: Vec<u32> = half
            .parts
            .iter()
            .map(|p| names.binary_search(p).unwrap() as u32)
            .collect();
        let target = half.triangles.len() / 10;
        let kept = decimate(&points, &half.triangles, &labels, target);
        assert!(
            kept.len() <= target && kept.len() > target - 3,
            "{} of {}",
            kept.len(),
            half.triangles.len()
        );

        let volume = |triangles: &[[u32; 3]]| -> f64 {
            triangles
                .iter()
                .map(|t| dot(area_vector(*t, &points), points[t[0] as usize]) / 3.0)
                .sum()
        };
        let now: Vec<[u32; 3]> = kept.iter().map(|k| k.1).collect();
        let change = volume(&now) / volume(&half.triangles) - 1.0;
        assert!(change.abs() < 0.02, "{change}");
        let mut edges: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
        for (k, [a, b, c]) in &kept {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges
                    .entry((*from.min(to), *from.max(to)))
                    .or_default()
                    .push(labels[*k]);
            }
        }
        assert!(edges.values().all(|sides| sides.len() == 2), "closed");
        // Every label remains, with approximately its original area.
        let all: Vec<(usize, [u32; 3])> = half.triangles.iter().copied().enumerate().collect();
        for label in 0..names.len() as u32 {
            let area = |list: &[(usize, [u32; 3])]| -> f64 {
                list.iter()
                    .filter(|(k, _)| labels[*k] == label)
                    .map(|(_, t)| norm(area_vector(*t, &points)))
                    .sum()
            };
            let (before, after) = (area(&all), area(&kept));
            assert!(
                (after / before - 1.0).abs() < 0.1,
                "{:?}: {before} to {after}",
                names[label as usize]
            );
        }
    }

    #[test]
    fn a_small_surface_stays_as_it_is() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let triangles = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let kept = decimate(&points, &triangles, &[0; 4], 10);
        assert_eq!(kept, triangles.into_iter().enumerate().collect::<Vec<_>>());
        // A tetrahedron is the smallest closed surface.
        assert_eq!(decimate(&points, &triangles, &[0; 4], 1).len(), 4);
    }
}
