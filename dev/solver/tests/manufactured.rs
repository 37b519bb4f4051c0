//! A manufactured solution: contracting muscle whose fibres turn through the wall, around a cavity under pressure.
//!
//! A smooth displacement is chosen on a bent slab of wall, and the nodal loads that hold it are integrated from its stress.
//! What the finite elements make of these loads differs from it by an error that falls with the order of the element.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_linalg::CondensedMatrix;
use cardiotwin_linalg::parallel::{Layout, SingleProcess, VectorLayout};
use cardiotwin_mechanics::body::{Body, BodyInput, Deformation};
use cardiotwin_mechanics::boundary::PressureSurface;
use cardiotwin_mechanics::element::batch::Frame;
use cardiotwin_mechanics::element::kernel::{ActivePoint, VolumeChange};
use cardiotwin_mechanics::element::quadratic::QuadraticMesh;
use cardiotwin_mechanics::element::shape::EDGES;
use cardiotwin_mechanics::linear::Assembled as _;
use cardiotwin_mechanics::material::{
    ActiveLaw, Guccione, Law, Load, Tissue, Volumetric, VolumetricLaw, respond,
};
use cardiotwin_mechanics::newton::{NewtonSettings, Smallest, System, Workspace, solve};
use cardiotwin_mechanics::organ::ElementKind;
use nalgebra::{Matrix3, Vector3};
use verification::meshes::{Mesh, cuboid};

/// Size of the slab \[mm\]; the wall is as thick as the last, and the cavity lies below it.
const SIZE: [f64; 3] = [12.0, 12.0, 8.0];
const PRESSURE_KPA: f64 = 2.0;
const ACTIVE_KPA: f64 = 10.0;
/// Fibres turn from −60° at the cavity to 60° outside.
const TURN: f64 = std::f64::consts::PI / 3.0;

const QUADRATIC_POINTWISE: ElementKind = ElementKind {
    quadratic: true,
    volume: VolumeChange::Pointwise,
};

fn tissue() -> Tissue {
    Tissue {
        law: Law::Guccione(Guccione {
            c_kpa: 4.0,
            b_f: 8.0,
            b_t: 2.0,
            b_fs: 4.0,
        }),
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa: 60.0,
        },
        active: Some(ActiveLaw::PAPER),
        density: 1.06,
    }
}

/// Fibre, sheet (through the wall) and normal of the sheet at a point.
fn frame(x: [f64; 3]) -> Frame {
    let (sin, cos) = ((2.0 * x[2] / SIZE[2] - 1.0) * TURN).sin_cos();
    [[cos, 0.0, sin], [sin, 0.0, -cos], [0.0, 1.0, 0.0]]
}

/// The displacement \[mm\] and its gradient.
fn displacement(x: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let [a, b, c] = [x[0] / SIZE[0], x[1] / SIZE[1], x[2] / SIZE[2]];
    let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
    let u = Vector3::new(0.9 * sa * cc, -0.7 * sb * ca, 0.8 * sc * cb * ca);
    let by = |g: [f64; 3]| [g[0] / SIZE[0], g[1] / SIZE[1], g[2] / SIZE[2]];
    let rows = [
        by([0.9 * ca * cc, 0.0, -0.9 * sa * sc]),
        by([0.7 * sb * sa, -0.7 * cb * ca, 0.0]),
        by([-0.8 * sc * cb * sa, -0.8 * sc * sb * ca, 0.8 * cc * cb * ca]),
    ];
    (u, Matrix3::from_fn(|i, j| rows[i][j]))
}

/// First Piola–Kirchhoff stress \[kPa\] and deformation gradient of the chosen displacement.
fn stress(x: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let f = Matrix3::identity() + displacement(x).1;
    let j = f.determinant();
    let axes = frame([x[0], x[1], x[2]]);
    let r = Matrix3::from_fn(|i, k| axes[i][k]);
    let c = r.transpose() * f.transpose() * f * r;
    let c = [
        c[(0, 0)],
        c[(1, 1)],
        c[(2, 2)],
        c[(0, 1)],
        c[(0, 2)],
        c[(1, 2)],
    ];
    let tissue = tissue();
    let Volumetric { law, kappa_kpa } = tissue.volumetric;
    let load = Load {
        pressure: kappa_kpa * law.slopes(j).0,
        bulk: 0.0,
        active: ACTIVE_KPA,
        active_slope: 0.0,
    };
    let s = respond::<f64, false>(&tissue, &c, j, &load).s;
    let s = Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]);
    (f * (r * s * r.transpose()), f)
}

/// Abscissae and weights of Gauss and Legendre on (0, 1), exact to degree 7.
fn gauss() -> [(f64, f64); 4] {
    let (a, b) = (0.339_981_043_584_856_3, 0.861_136_311_594_052_6);
    let (v, w) = (0.652_145_154_862_546_1, 0.347_854_845_137_453_9);
    [(-b, w), (-a, v), (a, v), (b, w)].map(|(x, w)| (0.5 * (1.0 + x), 0.5 * w))
}

/// Barycentric coordinates and shares of the volume of a tetrahedron.
fn tetrahedron_points() -> Vec<([f64; 4], f64)> {
    let mut points = vec![];
    for (r, wr) in gauss() {
        for (s, ws) in gauss() {
            for (t, wt) in gauss() {
                let (x, y, z) = (r, s * (1.0 - r), t * (1.0 - r) * (1.0 - s));
                points.push((
                    [1.0 - x - y - z, x, y, z],
                    6.0 * wr * ws * wt * (1.0 - r).powi(2) * (1.0 - s),
                ));
            }
        }
    }
    points
}

/// Values of the shape functions and their slopes by barycentric coordinate.
fn shape(l: [f64; 4], quadratic: bool) -> Vec<(f64, [f64; 4])> {
    let unit = |i: usize, slope: f64| std::array::from_fn(|k| if k == i { slope } else { 0.0 });
    if !quadratic {
        return (0..4).map(|i| (l[i], unit(i, 1.0))).collect();
    }
    let vertices = (0..4).map(|i| (l[i] * (2.0 * l[i] - 1.0), unit(i, 4.0 * l[i] - 1.0)));
    let edges = EDGES.map(|(i, j)| {
        let slopes = std::array::from_fn(|k| {
            if k == i {
                4.0 * l[j]
            } else if k == j {
                4.0 * l[i]
            } else {
                0.0
            }
        });
        (4.0 * l[i] * l[j], slopes)
    });
    vertices.chain(edges).collect()
}

/// The slab with its loads.
struct Slab {
    body: Body,
    cavity: PressureSurface,
    nodes: Vec<[f64; 3]>,
    elements: Vec<Vec<u32>>,
    faces: Vec<Vec<u32>>,
    fixed: Vec<[bool; 3]>,
    active: Vec<ActivePoint>,
    given: Vec<f64>,
    deformation: Deformation,
}

impl Slab {
    fn new(n: usize, element: ElementKind) -> Self {
        let mesh: Mesh = cuboid([n, n, n], |p| std::array::from_fn(|i| p[i] * SIZE[i]));
        let tissue_of = vec![0; mesh.tets.len()];
        let quadratic = QuadraticMesh::new(&mesh.nodes, &mesh.tets, |_, _| None);
        let nodes = if element.quadratic {
            quadratic.nodes.clone()
        } else {
            mesh.nodes.clone()
        };
        // The side at z = 0 bounds the cavity.
        let side = &mesh.sides[4];
        let (body, cavity, elements, faces) = if element.quadratic {
            let body = Body::quadratic(
                &input(
                    &nodes,
                    mesh.nodes.len(),
                    &quadratic.tets,
                    &tissue_of,
                    element,
                ),
                &SingleProcess,
            );
            let body = body.expect("a proper mesh");
            let faces: Vec<[u32; 6]> = side
                .iter()
                .map(|t| quadratic.triangle(*t).expect("a face"))
                .collect();
            let cavity = PressureSurface::new(&faces, body.pattern()).expect("a surface");
            let elements = quadratic.tets.iter().map(|t| t.to_vec()).collect();
            (
                body,
                cavity,
                elements,
                faces.iter().map(|f| f.to_vec()).collect(),
            )
        } else {
            let body = Body::linear(
                &input(&nodes, nodes.len(), &mesh.tets, &tissue_of, element),
                &SingleProcess,
            );
            let body = body.expect("a proper mesh");
            let cavity = PressureSurface::new(side, body.pattern()).expect("a surface");
            let elements = mesh.tets.iter().map(|t| t.to_vec()).collect();
            (
                body,
                cavity,
                elements,
                side.iter().map(|f| f.to_vec()).collect(),
            )
        };
        let held = |x: &[f64; 3]| [x[0] < 1e-9; 3];
        let point = ActivePoint {
            sa_kpa: [ACTIVE_KPA; 8],
            slope_kpa: [0.0; 8],
        };
        let mut slab = Self {
            fixed: nodes.iter().map(held).collect(),
            active: vec![point; body.n_point_batches()],
            given: vec![],
            deformation: Deformation::default(),
            body,
            cavity,
            nodes,
            elements,
            faces,
        };
        slab.given = slab.loads(element.quadratic);
        slab
    }

    fn at(&self, node: u32) -> Vector3<f64> {
        Vector3::from_column_slice(&self.nodes[node as usize])
    }

    /// ∫ P : ∇Nₐ dV of the chosen displacement, and the pressure on its cavity, which the slab's own pressure replaces.
    fn loads(&self, quadratic: bool) -> Vec<f64> {
        let mut loads = vec![0.0; 3 * self.nodes.len()];
        for element in &self.elements {
            let corners: [Vector3<f64>; 4] = std::array::from_fn(|i| self.at(element[i]));
            let edges = Matrix3::from_columns(&[1, 2, 3].map(|i| corners[i] - corners[0]));
            let inverse = edges.try_inverse().expect("a proper element");
            let volume = edges.determinant() / 6.0;
            let mut slopes = [Vector3::zeros(); 4];
            for i in 0..3 {
                slopes[i + 1] = inverse.row(i).transpose();
                slopes[0] -= slopes[i + 1];
            }
            for (l, share) in tetrahedron_points() {
                let x = (0..4).fold(Vector3::zeros(), |x, i| x + corners[i] * l[i]);
                let (p, _) = stress(&x);
                for (&node, (_, by)) in element.iter().zip(shape(l, quadratic)) {
                    let gradient = (0..4).fold(Vector3::zeros(), |sum, i| sum + slopes[i] * by[i]);
                    let force = p * gradient * (share * volume);
                    (0..3).for_each(|i| loads[3 * node as usize + i] += force[i]);
                }
            }
        }
        for face in &self.faces {
            let [a, b, c]: [Vector3<f64>; 3] = std::array::from_fn(|i| self.at(face[i]));
            let twice = (b - a).cross(&(c - a));
            for (r, wr) in gauss() {
                for (s, ws) in gauss() {
                    let (l1, l2) = (r, s * (1.0 - r));
                    let l = [1.0 - l1 - l2, l1, l2];
                    let (_, f) = stress(&(a * l[0] + b * l[1] + c * l[2]));
                    let cofactor =
                        f.try_inverse().expect("no inverted point").transpose() * f.determinant();
                    let force = cofactor * twice * (PRESSURE_KPA * wr * ws * (1.0 - r));
                    let pairs = [(0, 1), (1, 2), (2, 0)];
                    let values: Vec<f64> = if face.len() == 3 {
                        l.to_vec()
                    } else {
                        l.map(|l| l * (2.0 * l - 1.0))
                            .into_iter()
                            .chain(pairs.map(|(i, j)| 4.0 * l[i] * l[j]))
                            .collect()
                    };
                    for (&node, value) in face.iter().zip(values) {
                        (0..3).for_each(|i| loads[3 * node as usize + i] += force[i] * value);
                    }
                }
            }
        }
        loads
    }

    /// Root mean square of the difference to the chosen displacement \[mm\].
    fn error(&self, u: &[f64], quadratic: bool) -> f64 {
        let (mut sum, mut whole) = (0.0, 0.0);
        for element in &self.elements {
            let corners: [Vector3<f64>; 4] = std::array::from_fn(|i| self.at(element[i]));
            let volume = Matrix3::from_columns(&[1, 2, 3].map(|i| corners[i] - corners[0]))
                .determinant()
                / 6.0;
            for (l, share) in tetrahedron_points() {
                let x = (0..4).fold(Vector3::zeros(), |x, i| x + corners[i] * l[i]);
                let found = element.iter().zip(shape(l, quadratic)).fold(
                    Vector3::zeros(),
                    |sum, (&node, (value, _))| {
                        let at = 3 * node as usize;
                        sum + Vector3::from_column_slice(&u[at..at + 3]) * value
                    },
                );
                sum += share * volume * (found - displacement(&x).0).norm_squared();
                whole += share * volume;
            }
        }
        (sum / whole).sqrt()
    }

    fn add_loads(&self, u: &[f64], r: &mut [f64]) {
        self.cavity
            .add_forces(PRESSURE_KPA, self.body.reference(), u, r);
        r.iter_mut()
            .zip(&self.given)
            .for_each(|(r, given)| *r -= given);
        for (node, fixed) in self.fixed.iter().enumerate() {
            (0..3)
                .filter(|i| fixed[*i])
                .for_each(|i| r[3 * node + i] = 0.0);
        }
    }
}

fn input<'a, const N: usize>(
    nodes: &'a [[f64; 3]],
    n_vertices: usize,
    tets: &'a [[u32; N]],
    tissue_of: &'a [usize],
    element: ElementKind,
) -> BodyInput<'a, N> {
    BodyInput {
        nodes,
        n_vertices,
        tets,
        tissues: vec![tissue()],
        tissue_of,
        frame: &|_, x| frame(x),
        volume: element.volume,
        layout: Layout::whole(nodes.len()),
        elements: &[],
    }
}

impl System for Slab {
    fn space(&self) -> VectorLayout<'_> {
        VectorLayout {
            comm: &SingleProcess,
            layout: self.body.layout(),
        }
    }

    fn residual(&mut self, u: &mut [f64], r: &mut [f64]) -> Smallest {
        self.body.deform(u, &SingleProcess, &mut self.deformation);
        let (volume_ratio, element) = self.deformation.smallest;
        if volume_ratio > 0.0 {
            r.fill(0.0);
            self.body.add_forces(u, &self.active, &self.deformation, r);
            self.add_loads(u, r);
        }
        Smallest {
            volume_ratio,
            element,
        }
    }

    fn linearise(&mut self, u: &mut [f64], r: &mut [f64], tangent: &mut CondensedMatrix) {
        self.body.deform(u, &SingleProcess, &mut self.deformation);
        r.fill(0.0);
        self.body
            .tangent(u, &self.active, &self.deformation, r, tangent);
        self.add_loads(u, r);
        self.cavity
            .add_tangent(PRESSURE_KPA, self.body.reference(), u, tangent);
        let mean = tangent.mean_diagonal(self.space());
        tangent.constrain(&self.fixed, mean);
    }

    fn external_force(&self) -> f64 {
        self.given.iter().map(|f| f * f).sum::<f64>().sqrt()
    }

    fn reference(&self) -> &[f64] {
        self.body.reference()
    }
}

/// Errors on meshes of so many cells an axis, and orders from each to the next, of half its edges.
fn orders(element: ElementKind, sizes: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let error = |n: &usize| {
        let mut slab = Slab::new(*n, element);
        let chosen = |node: &[f64; 3]| displacement(&Vector3::from_column_slice(node)).0;
        let mut u: Vec<f64> = slab
            .nodes
            .iter()
            .flat_map(|node| chosen(node).as_slice().to_vec())
            .collect();
        let mut workspace = Workspace::new(slab.body.new_tangent());
        solve(
            &mut slab,
            &mut u,
            &mut workspace,
            &NewtonSettings::default(),
        )
        .expect("an equilibrium");
        slab.error(&u, element.quadratic)
    };
    let errors: Vec<f64> = sizes.iter().map(error).collect();
    let orders = errors
        .windows(2)
        .map(|pair| (pair[0] / pair[1]).log2())
        .collect();
    (errors, orders)
}

#[test]
fn contracting_muscle_around_a_cavity_converges_with_the_order_of_its_elements() {
    let (errors, found) = orders(ElementKind::default(), &[3, 6, 12]);
    println!("cohort's element: {errors:?} mm, orders {found:?}");
    assert!(
        found.last().is_some_and(|order| (1.7..2.4).contains(order)),
        "{errors:?} {found:?}"
    );
    let (errors, found) = orders(QUADRATIC_POINTWISE, &[2, 4, 8]);
    println!("quadratic pointwise: {errors:?} mm, orders {found:?}");
    assert!(
        found.last().is_some_and(|order| *order > 2.7),
        "{errors:?} {found:?}"
    );
    // The lumped nodal average of a volume change that varies is of second order itself.
    let (errors, found) = orders(ElementKind::QUADRATIC_NODAL, &[2, 4, 8]);
    println!("quadratic nodal: {errors:?} mm, orders {found:?}");
    assert!(
        found.last().is_some_and(|order| (1.8..2.4).contains(order)),
        "{errors:?} {found:?}"
    );
}
