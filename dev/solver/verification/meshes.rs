//! Meshes with closed forms: a box, and shells extruded from a triangulated surface.

use cardiotwin_linalg::parallel::{Layout, SingleProcess};
use cardiotwin_mechanics::body::{Body, BodyInput};
use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::Tissue;

/// Linear tetrahedra with the boundary triangles of each named side; triangles are seen counter-clockwise from outside.
#[derive(Debug, Clone)]
pub struct Mesh {
    pub nodes: Vec<[f64; 3]>,
    pub tets: Vec<[u32; 4]>,
    /// Box: x=0, x=1, y=0, y=1, z=0, z=1. Shell: inner, outer, rim.
    pub sides: Vec<Vec<[u32; 3]>>,
}

impl Mesh {
    /// A body of linear elements with nodal volume change, of one tissue with fibres along the first axis.
    pub fn of_one_tissue(&self, tissue: Tissue) -> Body {
        let tissue_of = vec![0; self.tets.len()];
        let input = BodyInput {
            nodes: &self.nodes,
            n_vertices: self.nodes.len(),
            tets: &self.tets,
            tissues: vec![tissue],
            tissue_of: &tissue_of,
            frame: &|_, _| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            volume: VolumeChange::Nodal {
                pointwise_share: 0.05,
            },
            layout: Layout::whole(self.nodes.len()),
            elements: &[],
        };
        Body::linear(&input, &SingleProcess).expect("a proper mesh")
    }
}

/// A box of `cells` cells an axis, six tetrahedra each, over the unit cube mapped by `place`.
pub fn cuboid(cells: [usize; 3], place: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    let [nx, ny, nz] = cells;
    let at = |p: [usize; 3]| ((p[0] * (ny + 1) + p[1]) * (nz + 1) + p[2]) as u32;
    let mut nodes = vec![];
    for i in 0..=nx {
        for j in 0..=ny {
            for k in 0..=nz {
                nodes.push(place([
                    i as f64 / nx as f64,
                    j as f64 / ny as f64,
                    k as f64 / nz as f64,
                ]));
            }
        }
    }
    let mut tets = vec![];
    for i in 0..nx {
        for j in 0..ny {
            for k in 0..nz {
                for order in [
                    [0, 1, 2],
                    [1, 2, 0],
                    [2, 0, 1],
                    [1, 0, 2],
                    [0, 2, 1],
                    [2, 1, 0],
                ] {
                    let mut p = [i, j, k];
                    let mut tet = [at(p); 4];
                    for (m, axis) in order.into_iter().enumerate() {
                        p[axis] += 1;
                        tet[m + 1] = at(p);
                    }
                    if matches!(order, [1, 0, 2] | [0, 2, 1] | [2, 1, 0]) {
                        tet.swap(1, 2);
                    }
                    tets.push(tet);
                }
            }
        }
    }
    let mut sides = vec![vec![]; 6];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for a in 0..cells[u] {
            for b in 0..cells[v] {
                for (high, side) in [(false, 2 * axis), (true, 2 * axis + 1)] {
                    let corner = |da: usize, db: usize| {
                        let mut p = [0; 3];
                        p[axis] = if high { cells[axis] } else { 0 };
                        p[u] = a + da;
                        p[v] = b + db;
                        at(p)
                    };
                    // Every face's diagonal runs from the low corner to the high one, as in the cells.
                    let (c00, c10, c01, c11) =
                        (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
                    if high {
                        sides[side].extend([[c00, c10, c11], [c00, c11, c01]]);
                    } else {
                        sides[side].extend([[c00, c11, c10], [c00, c01, c11]]);
                    }
                }
            }
        }
    }
    Mesh { nodes, tets, sides }
}

/// A triangulated disc or triangle in parameters, with its boundary edges.
pub struct Sheet {
    pub points: Vec<[f64; 2]>,
    pub triangles: Vec<[u32; 3]>,
}

/// The unit disc from a `2n` × `2n` grid of squares by concentric squares, or its first quadrant; radii to the power of
/// `grading`, which makes the middle finer.
pub fn disc(n: usize, quarter: bool, grading: f64) -> Sheet {
    let (m, first) = if quarter { (n, n) } else { (2 * n, 0) };
    let mut points = vec![];
    for i in first..=first + m {
        for j in first..=first + m {
            let (a, b) = (i as f64 / n as f64 - 1.0, j as f64 / n as f64 - 1.0);
            let (r, angle) = if a == 0.0 && b == 0.0 {
                (0.0, 0.0)
            } else if a.abs() > b.abs() {
                (a, std::f64::consts::FRAC_PI_4 * b / a)
            } else {
                (
                    b,
                    std::f64::consts::FRAC_PI_2 - std::f64::consts::FRAC_PI_4 * a / b,
                )
            };
            let r = r.signum() * r.abs().powf(grading);
            points.push([r * angle.cos(), r * angle.sin()]);
        }
    }
    let at = |i: usize, j: usize| (i * (m + 1) + j) as u32;
    let mut triangles = vec![];
    for i in 0..m {
        for j in 0..m {
            let (c00, c10, c01, c11) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
            // Diagonals point at the middle, so that no triangle has two edges on the rim.
            if quarter || (i < n) == (j < n) {
                triangles.extend([[c00, c10, c11], [c00, c11, c01]]);
            } else {
                triangles.extend([[c00, c10, c01], [c10, c11, c01]]);
            }
        }
    }
    Sheet { points, triangles }
}

/// A triangle of barycentric points (b₁, b₂) with `n` edges a side.
pub fn triangle(n: usize) -> Sheet {
    let mut points = vec![];
    let at = |i: usize, j: usize| (i * (2 * n + 3 - i) / 2 + j) as u32;
    for i in 0..=n {
        for j in 0..=n - i {
            points.push([i as f64 / n as f64, j as f64 / n as f64]);
        }
    }
    let mut triangles = vec![];
    for i in 0..n {
        for j in 0..n - i {
            triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            if i + j + 1 < n {
                triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    Sheet { points, triangles }
}

/// `layers` layers of prisms over a sheet, each cut into three tetrahedra; `place` maps (parameters, depth 0 inner to 1
/// outer) to space. The order of nodes is layer within point. Orientation is set by the first prism's volume.
pub fn extrude(sheet: &Sheet, layers: usize, place: impl Fn([f64; 2], f64) -> [f64; 3]) -> Mesh {
    let n = layers + 1;
    let mut nodes = vec![];
    for p in &sheet.points {
        for k in 0..n {
            nodes.push(place(*p, k as f64 / layers as f64));
        }
    }
    let at = |p: u32, k: usize| p * n as u32 + k as u32;
    let mut tets = vec![];
    for t in &sheet.triangles {
        // Points in ascending order: neighbours then cut their common face alike.
        let mut s = *t;
        s.sort_unstable();
        for k in 0..layers {
            let (lo, hi) = (s.map(|p| at(p, k)), s.map(|p| at(p, k + 1)));
            tets.extend([
                [lo[0], lo[1], lo[2], hi[2]],
                [lo[0], lo[1], hi[1], hi[2]],
                [lo[0], hi[0], hi[1], hi[2]],
            ]);
        }
    }
    for tet in &mut tets {
        if volume(&nodes, tet) < 0.0 {
            tet.swap(2, 3);
        }
    }
    let mut sides = vec![vec![]; 3];
    for t in &sheet.triangles {
        sides[0].push(t.map(|p| at(p, 0)));
        sides[1].push(t.map(|p| at(p, layers)));
    }
    orient(&nodes, &tets, &mut sides);
    Mesh { nodes, tets, sides }
}

fn volume(nodes: &[[f64; 3]], tet: &[u32; 4]) -> f64 {
    let p = tet.map(|n| nodes[n as usize]);
    let d = |k: usize| -> [f64; 3] { std::array::from_fn(|i| p[k][i] - p[0][i]) };
    let (a, b, c) = (d(1), d(2), d(3));
    (a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0]))
        / 6.0
}

/// Turns every side's triangles so that they are seen counter-clockwise from outside the body.
fn orient(nodes: &[[f64; 3]], tets: &[[u32; 4]], sides: &mut [Vec<[u32; 3]>]) {
    let mut opposite = std::collections::BTreeMap::new();
    for tet in tets {
        for k in 0..4 {
            let mut face: Vec<u32> = (0..4).filter(|m| *m != k).map(|m| tet[m]).collect();
            face.sort_unstable();
            opposite.insert([face[0], face[1], face[2]], tet[k]);
        }
    }
    for triangle in sides.iter_mut().flatten() {
        let mut key = *triangle;
        key.sort_unstable();
        // A tetrahedron of positive volume sees its face (a, b, c) counter-clockwise from outside when (c, b, a, d) is
        // positive, d being the node behind.
        let behind = opposite[&key];
        if volume(nodes, &[triangle[0], triangle[1], triangle[2], behind]) > 0.0 {
            triangle.swap(1, 2);
        }
    }
}
