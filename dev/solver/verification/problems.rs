//! The static problems of the verification: Land et al. 2015, Proc R Soc A 471:20150641, problems 1 to 3, and a thick
//! neo-Hookean sphere with a closed form.

use cardiotwin_linalg::parallel::{Layout, SingleProcess};
use cardiotwin_linalg::vec3::{cross, norm};
use cardiotwin_mechanics::body::{Body, BodyInput, Deformation};
use cardiotwin_mechanics::boundary::PressureSurface;
use cardiotwin_mechanics::element::batch::Frame;
use cardiotwin_mechanics::element::kernel::{ActivePoint, VolumeChange};
use cardiotwin_mechanics::element::quadratic::QuadraticMesh;
use cardiotwin_mechanics::material::{
    ActiveLaw, Guccione, Law, NeoHookean, Tissue, Volumetric, VolumetricLaw,
};
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mechanics::statics::{LoadSteps, StaticProblem, StaticReport, load};

use super::meshes::{Mesh, cuboid, disc, extrude, triangle};

/// Elements of the verification, which a ventricle can have as well.
pub type Element = ElementKind;

pub const P1: Element = ElementKind::LINEAR_POINTWISE;
pub const P1_NODAL: Element = ElementKind::LINEAR_NODAL;
pub const P2: Element = Element {
    quadratic: true,
    volume: VolumeChange::Pointwise,
};
pub const P2_NODAL: Element = ElementKind::QUADRATIC_NODAL;

pub const fn p1_nodal(pointwise_share: f64) -> Element {
    Element {
        quadratic: false,
        volume: VolumeChange::Nodal { pointwise_share },
    }
}

/// The elements of the tables by name: a cohort's, which the verdicts are about, then others next to them.
pub fn compared() -> Vec<(String, Element)> {
    let cohorts = Element::default();
    let others = [P1, P1_NODAL, P2_NODAL]
        .into_iter()
        .filter(|element| *element != cohorts);
    let named = others.map(|element| (element.to_string(), element));
    std::iter::once((format!("cohort's: {cohorts}"), cohorts))
        .chain(named)
        .collect()
}

/// Bulk modulus of the benchmark's problems \[kPa\].
pub const KAPPA_KPA: f64 = 1000.0;

/// A problem on a linear mesh, to be solved with any element.
pub struct Problem {
    pub mesh: Mesh,
    /// Place of the node between two vertices, for curved sides.
    pub middle: Box<dyn Fn(u32, u32) -> Option<[f64; 3]>>,
    pub frame: Box<dyn Fn(usize, [f64; 3]) -> Frame>,
    pub tissue: Tissue,
    /// Side of the mesh under pressure and the pressure \[kPa\].
    pub pressure: (usize, f64),
    /// Fixed components of a node at these coordinates.
    pub fixed: Box<dyn Fn([f64; 3]) -> [bool; 3]>,
    pub active_kpa: f64,
    /// A point in the plane of the cavity's opening.
    pub about: [f64; 3],
    pub first_step: f64,
    /// Number of copies of the mesh that make the whole body.
    pub copies: f64,
    /// Nodes along each direction of a mesh that is a grid, the last one the fastest.
    pub grid: Option<[usize; 3]>,
}

/// A problem in equilibrium, with its mesh.
pub struct Solution {
    pub nodes: Vec<[f64; 3]>,
    pub displacement: Vec<f64>,
    pub report: StaticReport,
    pub cavity_mm3: f64,
    pub n_tets: usize,
    /// Mean pressure of each element \[kPa\].
    pub pressure_kpa: Vec<f64>,
}

impl Solution {
    /// Deformed position of the node nearest to `at` in the reference configuration.
    pub fn position(&self, at: [f64; 3]) -> [f64; 3] {
        let distance = |x: &[f64; 3]| (0..3).map(|i| (x[i] - at[i]).powi(2)).sum::<f64>();
        let k = (0..self.nodes.len()).fold(0, |m, k| {
            if distance(&self.nodes[k]) < distance(&self.nodes[m]) {
                k
            } else {
                m
            }
        });
        std::array::from_fn(|i| self.nodes[k][i] + self.displacement[3 * k + i])
    }

    pub fn degrees_of_freedom(&self) -> usize {
        self.displacement.len()
    }
}

impl Problem {
    pub fn solve(&self, element: Element) -> Solution {
        let steps = LoadSteps {
            first: self.first_step,
            ..LoadSteps::default()
        };
        self.solve_with(element, &steps)
            .expect("the problem has a solution")
    }

    pub fn solve_with(
        &self,
        element: Element,
        steps: &LoadSteps,
    ) -> Result<Solution, Box<dyn std::error::Error>> {
        self.solve_from(element, steps, vec![])
    }

    /// As [`Self::solve_with`], from a displacement at the nodes; from rest where it is empty.
    pub fn solve_from(
        &self,
        element: Element,
        steps: &LoadSteps,
        mut displacement: Vec<f64>,
    ) -> Result<Solution, Box<dyn std::error::Error>> {
        let tissue_of = vec![0; self.mesh.tets.len()];
        let side = &self.mesh.sides[self.pressure.0];
        let (nodes, body, surface) = if element.quadratic {
            let mesh = QuadraticMesh::new(&self.mesh.nodes, &self.mesh.tets, &self.middle);
            let input = self.input(
                &mesh.nodes,
                mesh.n_vertices,
                &mesh.tets,
                &tissue_of,
                element,
            );
            let body = Body::quadratic(&input, &SingleProcess)?;
            let faces: Vec<[u32; 6]> = side
                .iter()
                .map(|t| mesh.triangle(*t).expect("a face of the mesh"))
                .collect();
            let surface = PressureSurface::new(&faces, body.pattern())?;
            (mesh.nodes, body, surface)
        } else {
            let n = self.mesh.nodes.len();
            let input = self.input(&self.mesh.nodes, n, &self.mesh.tets, &tissue_of, element);
            let body = Body::linear(&input, &SingleProcess)?;
            let surface = PressureSurface::new(side, body.pattern())?;
            (self.mesh.nodes.clone(), body, surface)
        };
        let active = ActivePoint {
            sa_kpa: [self.active_kpa; 8],
            slope_kpa: [0.0; 8],
        };
        let problem = StaticProblem {
            body: &body,
            comm: &SingleProcess,
            pressures: vec![(surface.clone(), self.pressure.1)],
            springs: vec![],
            fixed: nodes.iter().map(|x| (self.fixed)(*x)).collect(),
            prescribed: vec![],
            active: if self.active_kpa == 0.0 {
                vec![]
            } else {
                vec![active; body.n_point_batches()]
            },
        };
        displacement.resize(3 * nodes.len(), 0.0);
        let report = load(&problem, &mut displacement, steps)?;
        let cavity_mm3 = self.copies * surface.volume(self.about, body.reference(), &displacement);
        let pressure_kpa = self.element_pressures(&body, element, &displacement);
        Ok(Solution {
            nodes,
            displacement,
            report,
            cavity_mm3,
            n_tets: self.mesh.tets.len(),
            pressure_kpa,
        })
    }

    /// The displacement of a solution on a coarser grid of linear elements, between its nodes; `None` where either is no grid.
    pub fn interpolated(&self, coarse: &Self, solution: &Solution) -> Option<Vec<f64>> {
        let (to, from) = (self.grid?, coarse.grid?);
        let mut out = Vec::with_capacity(3 * self.mesh.nodes.len());
        for node in 0..self.mesh.nodes.len() {
            let place = [node / (to[1] * to[2]), node / to[2] % to[1], node % to[2]];
            // The cell's first corner and the way along its edges.
            let along: [(usize, f64); 3] = std::array::from_fn(|d| {
                let x = (place[d] * (from[d] - 1)) as f64 / (to[d] - 1) as f64;
                let low = (x as usize).min(from[d] - 2);
                (low, x - low as f64)
            });
            let mut sum = [0.0; 3];
            for corner in 0..8 {
                let (mut k, mut weight) = (0, 1.0);
                for (d, (low, share)) in along.into_iter().enumerate() {
                    let high = corner >> d & 1;
                    k = k * from[d] + low + high;
                    weight *= if high == 1 { share } else { 1.0 - share };
                }
                (0..3).for_each(|i| sum[i] += weight * solution.displacement[3 * k + i]);
            }
            out.extend(sum);
        }
        Some(out)
    }

    /// Mean of `U'(J)` of each element, as its integration points see it \[kPa\].
    fn element_pressures(&self, body: &Body, element: Element, displacement: &[f64]) -> Vec<f64> {
        let mut deformation = Deformation::default();
        body.deform(displacement, &SingleProcess, &mut deformation);
        let Volumetric { law, kappa_kpa } = self.tissue.volumetric;
        let mut sums = vec![[0.0; 2]; self.mesh.tets.len()];
        for (idx, ratios) in deformation.volume_ratio.iter().enumerate() {
            let (n_lanes, elements) = body.point_lanes(idx);
            for lane in 0..n_lanes {
                let e = elements[lane] as usize;
                let nodal = (self.mesh.tets[e].iter().zip(body.vertex_shape(idx)))
                    .map(|(v, share)| {
                        share * deformation.nodal_pressure.get(*v as usize).unwrap_or(&0.0)
                    })
                    .sum::<f64>();
                let own = element.volume.pointwise() * kappa_kpa * law.slopes(ratios[lane]).0;
                let volume = body.point_volume(idx)[lane];
                sums[e][0] += volume * (nodal + own);
                sums[e][1] += volume;
            }
        }
        sums.iter()
            .map(|[pressure, volume]| pressure / volume)
            .collect()
    }

    fn input<'a, const N: usize>(
        &'a self,
        nodes: &'a [[f64; 3]],
        n_vertices: usize,
        tets: &'a [[u32; N]],
        tissue_of: &'a [usize],
        element: Element,
    ) -> BodyInput<'a, N> {
        BodyInput {
            nodes,
            n_vertices,
            tets,
            tissues: vec![self.tissue],
            tissue_of,
            frame: &self.frame,
            volume: element.volume,
            layout: Layout::whole(nodes.len()),
            elements: &[],
        }
    }
}

fn tissue(law: Law, kappa_kpa: f64, active: bool) -> Tissue {
    Tissue {
        law,
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa,
        },
        active: active.then_some(ActiveLaw::BENCHMARK),
        density: 1.0,
    }
}

const AXES: Frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Problem 1: a beam of 10 × 1 × 1 mm, fixed at x = 0, 0.004 kPa from below. `n` cells across, `4 n` along, denser at the
/// clamp.
pub fn beam(n: usize, kappa_kpa: f64) -> Problem {
    let mesh = cuboid([4 * n, n, n], |p| [10.0 * p[0].powf(1.3), p[1], p[2]]);
    let law = Guccione {
        c_kpa: 2.0,
        b_f: 8.0,
        b_t: 2.0,
        b_fs: 4.0,
    };
    Problem {
        mesh,
        middle: Box::new(|_, _| None),
        frame: Box::new(|_, _| AXES),
        tissue: tissue(Law::Guccione(law), kappa_kpa, false),
        pressure: (4, 0.004),
        fixed: Box::new(|x| [x[0] < 1e-9; 3]),
        active_kpa: 0.0,
        about: [0.0; 3],
        first_step: 0.25,
        copies: 1.0,
        grid: Some([4 * n + 1, n + 1, n + 1]),
    }
}

/// Points at which the problems are probed.
pub const BEAM_TIP: [f64; 3] = [10.0, 0.5, 1.0];
pub const APEX_ENDO: [f64; 3] = [0.0, 0.0, -17.0];
pub const APEX_EPI: [f64; 3] = [0.0, 0.0, -20.0];

/// The ventricle of problems 2 and 3: (parameters in the unit disc, depth) to space. `u` runs from −π at the apex to the
/// base plane z = 5 at the disc's rim.
fn ventricle_point(p: [f64; 2], t: f64) -> [f64; 3] {
    let (rs, rl) = (7.0 + 3.0 * t, 17.0 + 3.0 * t);
    let r = p[0].hypot(p[1]);
    let u = -std::f64::consts::PI + r * (std::f64::consts::PI - (5.0 / rl).acos());
    let (c, s) = if r == 0.0 {
        (1.0, 0.0)
    } else {
        (p[0] / r, p[1] / r)
    };
    // sin u is negative: v is turned by π, which keeps the map continuous at the apex.
    let radius = -rs * u.sin();
    [radius * c, radius * s, rl * u.cos()]
}

/// Depth of a point in the wall of the ventricle, by bisection.
fn ventricle_depth(x: [f64; 3]) -> f64 {
    let level = |t: f64| {
        let (rs, rl) = (7.0 + 3.0 * t, 17.0 + 3.0 * t);
        (x[0].powi(2) + x[1].powi(2)) / (rs * rs) + x[2].powi(2) / (rl * rl) - 1.0
    };
    let (mut low, mut high) = (-0.2, 1.2);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if level(middle) > 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// The benchmark's frame at a point: f = n(dx/du) sin α + n(dx/dv) cos α, α = 90° − 180° t.
fn ventricle_frame(x: [f64; 3]) -> Frame {
    let t = ventricle_depth(x).clamp(0.0, 1.0);
    let (rs, rl) = (7.0 + 3.0 * t, 17.0 + 3.0 * t);
    let r = x[0].hypot(x[1]);
    let (c, s) = if r < 1e-12 {
        (1.0, 0.0)
    } else {
        (x[0] / r, x[1] / r)
    };
    // sin u < 0, so that cos v = −c, sin v = −s.
    let (sin_u, cos_u) = (-(r / rs), x[2] / rl);
    let du = unit([-rs * cos_u * c, -rs * cos_u * s, -rl * sin_u]);
    let dv = [-s, c, 0.0];
    let alpha = std::f64::consts::FRAC_PI_2 * (1.0 - 2.0 * t);
    let f: [f64; 3] = std::array::from_fn(|i| du[i] * alpha.sin() + dv[i] * alpha.cos());
    let n = unit(cross(du, dv));
    let side = cross(n, f);
    std::array::from_fn(|i| [f[i], side[i], n[i]])
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let n = norm(a);
    a.map(|x| x / n)
}

/// The ventricle of problems 2 and 3: `n` squares from apex to base, `8 n` around the base, `layers` through the wall;
/// distances from the apex to the power of `grading`.
#[expect(
    clippy::too_many_arguments,
    reason = "a problem's numbers, each of its own kind"
)]
fn ventricle(
    n: usize,
    layers: usize,
    law: Guccione,
    pressure: f64,
    active_kpa: f64,
    kappa: f64,
    first: f64,
    grading: f64,
) -> Problem {
    // Without fibres a quarter is enough.
    let quarter = active_kpa == 0.0;
    let sheet = disc(n, quarter, grading);
    let mesh = extrude(&sheet, layers, ventricle_point);
    let n_layer = layers as u32 + 1;
    let points = sheet.points;
    let middle = move |a: u32, b: u32| {
        let (pa, pb) = (
            points[(a / n_layer) as usize],
            points[(b / n_layer) as usize],
        );
        let depth = |n: u32| f64::from(n % n_layer) / f64::from(n_layer - 1);
        // Half-way in radius and direction: the middle of two points of the rim stays on the rim.
        let (ra, rb) = (pa[0].hypot(pa[1]), pb[0].hypot(pb[1]));
        let m = [pa[0] + pb[0], pa[1] + pb[1]];
        let scale = 0.5 * (ra + rb) / m[0].hypot(m[1]).max(1e-300);
        Some(ventricle_point(
            [m[0] * scale, m[1] * scale],
            0.5 * (depth(a) + depth(b)),
        ))
    };
    Problem {
        mesh,
        middle: Box::new(middle),
        frame: Box::new(|_, x| ventricle_frame(x)),
        tissue: tissue(Law::Guccione(law), kappa, active_kpa > 0.0),
        pressure: (0, pressure),
        fixed: Box::new(move |x| {
            let base = x[2] > 5.0 - 1e-9;
            [
                base || (quarter && x[0].abs() < 1e-9),
                base || (quarter && x[1].abs() < 1e-9),
                base,
            ]
        }),
        active_kpa,
        about: [0.0, 0.0, 5.0],
        first_step: first,
        copies: if quarter { 4.0 } else { 1.0 },
        grid: None,
    }
}

/// Problem 2: inflation of a ventricle of isotropic tissue to 10 kPa.
pub fn inflation(n: usize, layers: usize, kappa_kpa: f64) -> Problem {
    let law = Guccione {
        c_kpa: 10.0,
        b_f: 1.0,
        b_t: 1.0,
        b_fs: 1.0,
    };
    ventricle(n, layers, law, 10.0, 0.0, kappa_kpa, 0.1, 1.3)
}

/// Problem 3: inflation and contraction of a ventricle with fibres.
pub fn contraction(n: usize, layers: usize, kappa_kpa: f64) -> Problem {
    let law = Guccione {
        c_kpa: 2.0,
        b_f: 8.0,
        b_t: 2.0,
        b_fs: 4.0,
    };
    // The fibres are singular at the endocardial apex: what counts is how fine the mesh is there.
    ventricle(n, layers, law, 15.0, 60.0, kappa_kpa, 0.05, 2.2)
}

/// Inner and outer radius of the sphere \[mm\].
pub const SPHERE: [f64; 2] = [10.0, 12.0];

/// An octant of a thick neo-Hookean sphere, µ = 1 kPa, under `pressure` from inside.
pub fn sphere(n: usize, layers: usize, pressure: f64, kappa_kpa: f64) -> Problem {
    fn place(b: [f64; 2], t: f64) -> [f64; 3] {
        let d = unit([b[0], b[1], 1.0 - b[0] - b[1]]);
        d.map(|x| {
            if x.abs() < 1e-14 {
                0.0
            } else {
                x * (SPHERE[0] + t * (SPHERE[1] - SPHERE[0]))
            }
        })
    }
    let sheet = triangle(n);
    let mesh = extrude(&sheet, layers, place);
    let n_layer = layers as u32 + 1;
    let points = sheet.points;
    let middle = move |a: u32, b: u32| {
        let (pa, pb) = (
            points[(a / n_layer) as usize],
            points[(b / n_layer) as usize],
        );
        let depth = |n: u32| f64::from(n % n_layer) / f64::from(n_layer - 1);
        Some(place(
            [0.5 * (pa[0] + pb[0]), 0.5 * (pa[1] + pb[1])],
            0.5 * (depth(a) + depth(b)),
        ))
    };
    Problem {
        mesh,
        middle: Box::new(middle),
        frame: Box::new(|_, _| AXES),
        tissue: tissue(
            Law::NeoHookean(NeoHookean { mu_kpa: 1.0 }),
            kappa_kpa,
            false,
        ),
        pressure: (0, pressure),
        fixed: Box::new(|x| x.map(|x| x.abs() < 1e-12)),
        active_kpa: 0.0,
        about: [0.0; 3],
        first_step: 0.25,
        copies: 8.0,
        grid: None,
    }
}
