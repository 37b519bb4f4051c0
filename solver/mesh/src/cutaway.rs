//! Closed surface of the half of a body that lies behind a cutting plane.
//!
//! Every corner lies on an edge of the mesh, so that the same cut through the tissue can be shown
//! in any deformed state. On linear elements this is exact.

use std::collections::HashMap;

use crate::surface::boundary;
use crate::tet_mesh::{EDGES, TetMesh};
use crate::vec3::{Vec3, cross, dot, sub};

/// Plane that cuts a body into halves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point in the plane \[mm\].
    pub point: Vec3,
    /// Normal of the plane. The half on the opposite side is kept.
    pub normal: Vec3,
}

/// A point on an edge of the mesh: `(1 − share) x(from) + share x(to)`. For a node of the mesh,
/// both ends are this node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Node at share 0.
    pub from: u32,
    /// Node at share 1.
    pub to: u32,
    /// Position between the two nodes, from 0 to 1.
    pub share: f64,
}

impl Corner {
    /// Value at this point, interpolated from nodal values.
    #[must_use]
    pub fn of(&self, values: &[f64]) -> f64 {
        let (from, to) = (values[self.from as usize], values[self.to as usize]);
        from + self.share * (to - from)
    }

    /// Position of this point for given nodal positions.
    #[must_use]
    pub fn at(&self, positions: &[Vec3]) -> Vec3 {
        let (from, to) = (positions[self.from as usize], positions[self.to as usize]);
        std::array::from_fn(|i| from[i] + self.share * (to[i] - from[i]))
    }
}

/// Origin of a triangle on the half's surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// The surface of the mesh with this index.
    Surface(usize),
    /// A boundary face that belongs to no surface.
    Unnamed,
    /// The cutting plane, which closes the half.
    Cut,
}

/// Surface of one half.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Half {
    /// Corners of the triangles.
    pub corners: Vec<Corner>,
    /// Triangles, with normals out of the tissue.
    pub triangles: Vec<[u32; 3]>,
    /// Origin of each triangle, and tag of its element.
    pub parts: Vec<(Side, i32)>,
}

/// Surface of the half of a mesh that lies behind a plane; empty if no part of the mesh does.
#[must_use]
pub fn cut(mesh: &TetMesh, plane: &Plane) -> Half {
    let heights: Vec<f64> = mesh
        .nodes_mm
        .iter()
        .map(|x| dot(sub(*x, plane.point), plane.normal))
        .collect();
    let largest = heights.iter().fold(0.0, |m: f64, h| m.max(h.abs()));
    // A node in the plane counts as behind it, so that no edge is cut at its end.
    let heights: Vec<f64> = heights
        .into_iter()
        .map(|h| {
            if h.abs() <= 1e-9 * largest {
                -1e-9 * largest
            } else {
                h
            }
        })
        .collect();
    let mut surface_of: HashMap<[u32; 3], usize> = HashMap::new();
    for (k, surface) in mesh.surfaces.iter().enumerate() {
        for triangle in &surface.triangles {
            // If two surfaces share a triangle, it belongs to the first one.
            surface_of.entry(ordered(*triangle)).or_insert(k);
        }
    }
    let mut maker = Maker {
        heights: &heights,
        found: HashMap::new(),
        half: Half::default(),
    };
    for face in boundary(mesh) {
        let side = surface_of
            .get(&ordered(face.triangle))
            .map_or(Side::Unnamed, |k| Side::Surface(*k));
        maker.clipped(face.triangle, (side, mesh.tags[face.tet as usize]));
    }
    for (tet, tag) in mesh.tets.iter().zip(&mesh.tags) {
        let cut: Vec<u32> = EDGES
            .iter()
            .map(|[i, j]| (tet[*i], tet[*j]))
            .filter(|(a, b)| (heights[*a as usize] > 0.0) != (heights[*b as usize] > 0.0))
            .map(|(a, b)| maker.between(a, b))
            .collect();
        maker.polygon(mesh, &cut, plane.normal, (Side::Cut, *tag));
    }
    maker.half
}

fn ordered(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

struct Maker<'a> {
    heights: &'a [f64],
    found: HashMap<(u32, u32), u32>,
    half: Half,
}

impl Maker<'_> {
    fn corner(&mut self, key: (u32, u32), share: f64) -> u32 {
        let corners = &mut self.half.corners;
        *self.found.entry(key).or_insert_with(|| {
            corners.push(Corner {
                from: key.0,
                to: key.1,
                share,
            });
            corners.len() as u32 - 1
        })
    }

    /// The point at which the plane cuts an edge.
    fn between(&mut self, a: u32, b: u32) -> u32 {
        let (from, to) = (a.min(b), a.max(b));
        let (h0, h1) = (self.heights[from as usize], self.heights[to as usize]);
        self.corner((from, to), h0 / (h0 - h1))
    }

    fn triangle(&mut self, corners: [u32; 3], part: (Side, i32)) {
        self.half.triangles.push(corners);
        self.half.parts.push(part);
    }

    /// Adds the part of a boundary face that lies behind the plane.
    fn clipped(&mut self, triangle: [u32; 3], part: (Side, i32)) {
        let mut polygon = Vec::with_capacity(4);
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let (behind, next) = (
                self.heights[a as usize] <= 0.0,
                self.heights[b as usize] <= 0.0,
            );
            if behind {
                polygon.push(self.corner((a, a), 0.0));
            }
            if behind != next {
                polygon.push(self.between(a, b));
            }
        }
        for k in 2..polygon.len() {
            self.triangle([polygon[0], polygon[k - 1], polygon[k]], part);
        }
    }

    /// Adds a convex polygon of three or four corners in any order, with its normal in the
    /// direction of `normal`.
    fn polygon(&mut self, mesh: &TetMesh, corners: &[u32], normal: Vec3, part: (Side, i32)) {
        if corners.len() < 3 {
            return;
        }
        let at = |k: u32| self.half.corners[k as usize].at(&mesh.nodes_mm);
        let points: Vec<Vec3> = corners.iter().map(|k| at(*k)).collect();
        let n = points.len() as f64;
        let centre: Vec3 = std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / n);
        let axis = sub(points[0], centre);
        let across = cross(normal, axis);
        let angle = |p: &Vec3| dot(sub(*p, centre), across).atan2(dot(sub(*p, centre), axis));
        let mut order: Vec<usize> = (0..corners.len()).collect();
        order.sort_by(|i, j| angle(&points[*i]).total_cmp(&angle(&points[*j])));
        for k in 2..order.len() {
            self.triangle([order[0], order[k - 1], order[k]].map(|i| corners[i]), part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ellipsoid::{EllipsoidSpec, generate};
    use crate::surface::area_vector;
    use crate::tet_mesh::tags;
    use cardiotwin_units::Ml;

    fn half_of(plane: &Plane) -> (TetMesh, Half, Vec<Vec3>) {
        let mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 1000))
            .unwrap()
            .mesh;
        let half = cut(&mesh, plane);
        let points = half.corners.iter().map(|c| c.at(&mesh.nodes_mm)).collect();
        (mesh, half, points)
    }

    #[test]
    fn the_surface_is_closed_and_holds_half_of_the_wall() {
        let plane = Plane {
            point: [0.0, 0.3, 0.0],
            normal: [0.0, -1.0, 0.0],
        };
        let (mesh, half, points) = half_of(&plane);
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for [a, b, c] in &half.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((*from.min(to), *from.max(to))).or_default() +=
                    if from < to { 1 } else { -1 };
            }
        }
        assert!(
            edges.values().all(|n| *n == 0),
            "each edge once in either direction"
        );
        let volume: f64 = half
            .triangles
            .iter()
            .map(|t| dot(area_vector(*t, &points), points[t[0] as usize]) / 3.0)
            .sum();
        let whole = mesh.tissue_volume(&[]).0 * 1e3;
        assert!((volume / whole - 0.5).abs() < 0.01, "{volume} of {whole}");
    }

    #[test]
    fn the_cut_lies_in_the_plane_and_every_part_is_told() {
        let plane = Plane {
            point: [0.0, 0.3, 0.0],
            normal: [0.0, -1.0, 0.0],
        };
        let (mesh, half, points) = half_of(&plane);
        assert!(points.iter().all(|x| x[1] >= 0.3 - 1e-6));
        for (triangle, (side, tag)) in half.triangles.iter().zip(&half.parts) {
            assert_ne!(*side, Side::Unnamed);
            assert!([tags::LEFT_VENTRICLE, tags::AORTIC_ROOT].contains(tag));
            if *side == Side::Cut {
                assert!(
                    triangle
                        .iter()
                        .all(|k| (points[*k as usize][1] - 0.3).abs() < 1e-6)
                );
                assert!(dot(area_vector(*triangle, &points), plane.normal) >= 0.0);
            }
        }
        let sides: std::collections::BTreeSet<Side> = half.parts.iter().map(|p| p.0).collect();
        assert_eq!(sides.len(), mesh.surfaces.len() + 1, "{sides:?}");
        // In a stretched state, corners move with their nodes.
        let stretched: Vec<Vec3> = mesh
            .nodes_mm
            .iter()
            .map(|[x, y, z]| [2.0 * x, *y, *z])
            .collect();
        assert!(
            half.corners
                .iter()
                .zip(&points)
                .all(|(c, x)| (c.at(&stretched)[0] - 2.0 * x[0]).abs() < 1e-9)
        );
    }

    #[test]
    fn a_plane_beside_the_body_leaves_all_or_nothing() {
        let far = |y| Plane {
            point: [0.0, y, 0.0],
            normal: [0.0, 1.0, 0.0],
        };
        assert!(half_of(&far(-1e3)).1.triangles.is_empty());
        let (mesh, all, _) = half_of(&far(1e3));
        assert_eq!(all.triangles.len(), boundary(&mesh).len());
    }
}
