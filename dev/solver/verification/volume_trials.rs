//! Ways to resist a change of volume that the library does not have, on linear tetrahedra in equilibrium, next to the one
//! that it has: what `docs/decisions/0005-linear-elements.md` compares.
//!
//! All minimise `∫ W(Ē) + s κ/2 (J − 1)² dV + max_p (pᵀ (B(J) − V) − pᵀ M p / 2)`: pressures `p` in some space, `B(J)` the
//! deformed volumes that it sees, `M` its compliance. They differ in `B` and `M` alone.

use cardiotwin_linalg::{BlockCsr, CondensedMatrix, Pattern};
use cardiotwin_mechanics::boundary::PressureSurface;
use cardiotwin_mechanics::element::batch::{Batch, batches};
use cardiotwin_mechanics::material::tensor::at;
use cardiotwin_mechanics::material::{Load, respond};

use super::patches::patches;
use super::problems::Problem;
use super::symmetric::Symmetric;

/// The space of pressures and its compliance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trial {
    /// The library's: a pressure a vertex, lumped compliance; a share of κ stays pointwise.
    Nodal { share: f64 },
    /// Dohrmann and Bochev 2004, P1–P1: consistent compliance, and on top that of the pressure's distance from its mean over
    /// each element at this modulus.
    Projected { modulus_kpa: f64 },
    /// De Souza Neto et al. 2005: a pressure for each patch of so many elements; a share of κ stays pointwise.
    Patch { elements: usize, share: f64 },
}

/// An equilibrium and what it cost.
pub struct Equilibrium {
    pub displacement: Vec<f64>,
    /// Mean pressure `U'(J)` of each element \[kPa\].
    pub pressure_kpa: Vec<f64>,
    /// Volume ratio of each element.
    pub volume_ratio: Vec<f64>,
    pub cavity_mm3: f64,
    pub newton: usize,
    pub n_cut: usize,
}

struct Setting<'a> {
    problem: &'a Problem,
    batches: Vec<Batch<4, 1>>,
    surface: PressureSurface,
    surface_tangent: CondensedMatrix,
    fixed: Vec<bool>,
    /// Unknowns of each element: twelve displacements, then its pressures.
    unknowns: Vec<Vec<u32>>,
    n_displacements: usize,
    /// Share of κ that is pointwise, and the modulus of the projection.
    share: f64,
    projection: Option<f64>,
    compliance: Symmetric,
    matrix: Symmetric,
}

/// State at a displacement.
struct State {
    u: Vec<f64>,
    element_pressure: Vec<f64>,
    volume_ratio: Vec<f64>,
    smallest: f64,
}

/// Loads `problem` in steps as the library does: halved on failure, grown by half after two quick solves.
///
/// # Errors
/// The share of the load that was reached.
pub fn equilibrium(problem: &Problem, trial: Trial) -> Result<Equilibrium, f64> {
    let mut setting = Setting::new(problem, trial);
    let n = setting.n_displacements;
    let (mut u, mut before): (Vec<f64>, Option<(f64, Vec<f64>)>) = (vec![0.0; n], None);
    let (mut reached, mut step, mut quick, mut newton, mut n_cut) =
        (0.0, problem.first_step, 0, 0, 0);
    let (mut pressure_kpa, mut volume_ratio) = (vec![], vec![]);
    while reached < 1.0 {
        let now = if reached + step > 1.0 - 1e-9 {
            1.0 - reached
        } else {
            step
        };
        let mut start = u.clone();
        if let Some((last, before)) = &before {
            let ratio = now / (reached - last);
            let guess: Vec<f64> = u
                .iter()
                .zip(before)
                .map(|(u, b)| u + ratio * (u - b))
                .collect();
            if setting.state(guess.clone()).smallest > 0.1 {
                start = guess;
            }
        }
        match setting.newton(start, reached + now) {
            Ok((state, iterations)) => {
                newton += iterations;
                quick = if iterations <= 6 { quick + 1 } else { 0 };
                if quick >= 2 {
                    (step, quick) = ((1.5 * step).min(1.0), 0);
                }
                before = Some((reached, std::mem::replace(&mut u, state.u)));
                (pressure_kpa, volume_ratio) = (state.element_pressure, state.volume_ratio);
                reached += now;
            }
            Err(()) => {
                n_cut += 1;
                (step, quick) = (0.5 * now, 0);
                if step < 1e-3 {
                    return Err(reached);
                }
            }
        }
    }
    let cavity_mm3 = problem.copies
        * setting
            .surface
            .volume(problem.about, problem.mesh.nodes.as_flattened(), &u);
    Ok(Equilibrium {
        displacement: u,
        cavity_mm3,
        pressure_kpa,
        volume_ratio,
        newton,
        n_cut,
    })
}

/// What a patch test finds.
#[derive(Debug)]
pub struct Patch {
    /// Largest force on a node that is free, over the largest on a fixed one.
    pub force_inside: f64,
    /// Farthest that a free node ends from its place when Newton's method begins next to it \[mm\].
    pub distance_mm: f64,
}

/// The homogeneous deformation `f` of a body without loads, whose fixed nodes are where it takes them.
pub fn homogeneous(problem: &Problem, trial: Trial, f: [[f64; 3]; 3]) -> Patch {
    let mut setting = Setting::new(problem, trial);
    let nodes = &problem.mesh.nodes;
    let displaced = |x: &[f64; 3], i: usize| (0..3).map(|k| f[i][k] * x[k]).sum::<f64>() - x[i];
    let u: Vec<f64> = nodes
        .iter()
        .flat_map(|x| (0..3).map(move |i| displaced(x, i)))
        .collect();
    let state = setting.state(u.clone());
    // Nothing is fixed while forces are told, or those on the surface were left out.
    let n = setting.fixed.len();
    let fixed = std::mem::replace(&mut setting.fixed, vec![false; n]);
    let (force, _) = setting.linearise(&state, 1.0, false);
    setting.fixed = fixed;
    let largest = |of_fixed: bool| {
        let sizes = (force.iter().zip(&setting.fixed))
            .filter(|(_, fixed)| **fixed == of_fixed)
            .map(|(r, _)| r.abs());
        sizes.fold(0.0, f64::max)
    };
    let force_inside = largest(false) / largest(true);
    let aside = |k: usize| {
        if setting.fixed[k] {
            0.0
        } else {
            0.005 * (17.0 * k as f64).sin()
        }
    };
    let start = u.iter().enumerate().map(|(k, u)| u + aside(k)).collect();
    let distance_mm = match setting.newton(start, 1.0) {
        Ok((found, _)) => found
            .u
            .iter()
            .zip(&u)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max),
        Err(()) => f64::INFINITY,
    };
    Patch {
        force_inside,
        distance_mm,
    }
}

impl<'a> Setting<'a> {
    fn new(problem: &'a Problem, trial: Trial) -> Self {
        let mesh = &problem.mesh;
        let (n_nodes, n_tets) = (mesh.nodes.len(), mesh.tets.len());
        let pattern = std::sync::Arc::new(Pattern::of_elements(
            n_nodes,
            mesh.tets.iter().map(|t| (&t[..], &t[..])),
        ));
        let surface = PressureSurface::new(&mesh.sides[problem.pressure.0], &pattern)
            .expect("faces of the mesh");
        let surface_tangent = CondensedMatrix {
            stiffness: BlockCsr::zeros(pattern),
            coupling: None,
            bulk: vec![],
        };
        let batches = batches::<4, 1>(&mesh.nodes, &mesh.tets, &vec![0; n_tets], &problem.frame)
            .expect("a proper mesh");
        let (share, projection, patches) = match trial {
            Trial::Nodal { share } => (share, None, None),
            Trial::Projected { modulus_kpa } => (0.0, Some(modulus_kpa), None),
            Trial::Patch { elements, share } => (share, None, Some(patches(&mesh.tets, elements))),
        };
        let pressures = |e: usize| match &patches {
            Some(patches) => vec![patches[e]],
            None => mesh.tets[e].to_vec(),
        };
        let n_pressures = patches.as_ref().map_or(n_nodes, |p| {
            1 + *p.iter().max().expect("an element") as usize
        });
        let of_pressures: Vec<Vec<u32>> = (0..n_tets).map(pressures).collect();
        let n = 3 * n_nodes;
        let unknowns: Vec<Vec<u32>> = (mesh.tets.iter().zip(&of_pressures))
            .map(|(t, p)| {
                let displacements = t.iter().flat_map(|a| (0..3).map(move |i| 3 * a + i));
                displacements
                    .chain(p.iter().map(|p| n as u32 + p))
                    .collect()
            })
            .collect();
        let mut fixed: Vec<bool> = mesh
            .nodes
            .iter()
            .flat_map(|x| (problem.fixed)(*x))
            .collect();
        fixed.resize(n + n_pressures, false);
        let matrix = Symmetric::new(n + n_pressures, &unknowns);
        let compliance = Symmetric::new(n_pressures, &of_pressures);
        let mut setting = Self {
            problem,
            batches,
            surface,
            surface_tangent,
            fixed,
            unknowns,
            share,
            projection,
            compliance,
            matrix,
            n_displacements: n,
        };
        for (e, p) in of_pressures.iter().enumerate() {
            let m = setting.element_compliance(e);
            setting.compliance.add(p, &m, &vec![false; n_pressures]);
        }
        setting.compliance.factorise();
        setting
    }

    fn volume_mm3(&self, e: usize) -> f64 {
        self.batches[e / 8].points[0].weight[e % 8]
    }

    /// An element's part of `M`, row by row.
    fn element_compliance(&self, e: usize) -> Vec<f64> {
        let (n, volume) = (self.unknowns[e].len() - 12, self.volume_mm3(e));
        let kappa = (1.0 - self.share) * self.problem.tissue.volumetric.kappa_kpa;
        let entry = |a: usize, b: usize| {
            let one = f64::from(u8::from(a == b));
            match self.projection {
                // ∫ Nₐ N_b = V (1 + δ)/20 and ∫ (Nₐ − ¼)(N_b − ¼) = V (δ − ¼)/20.
                Some(modulus) => volume / 20.0 * ((1.0 + one) / kappa + (one - 0.25) / modulus),
                None => volume / n as f64 / kappa * one,
            }
        };
        (0..n * n).map(|k| entry(k / n, k % n)).collect()
    }

    fn deformation(&self, e: usize, u: &[f64]) -> [[f64; 3]; 3] {
        let mut f = [[0.0; 3]; 3];
        for (a, node) in self.problem.mesh.tets[e].iter().enumerate() {
            for i in 0..3 {
                let x = self.problem.mesh.nodes[*node as usize][i] + u[3 * *node as usize + i];
                (0..3).for_each(|k| f[i][k] += x * self.batches[e / 8].points[0].grad[a][k][e % 8]);
            }
        }
        f
    }

    /// Pressures at `u`: `M p = B(J) − V`.
    fn state(&self, u: Vec<f64>) -> State {
        let n = self.n_displacements;
        let mut p = vec![0.0; self.fixed.len() - n];
        let ratios: Vec<f64> = (0..self.unknowns.len())
            .map(|e| cofactor(&self.deformation(e, &u)).1)
            .collect();
        for (e, (unknowns, j)) in self.unknowns.iter().zip(&ratios).enumerate() {
            let pressures = &unknowns[12..];
            for v in pressures {
                p[*v as usize - n] += self.volume_mm3(e) * (j - 1.0) / pressures.len() as f64;
            }
        }
        self.compliance.solve(&mut p);
        let kappa = self.share * self.problem.tissue.volumetric.kappa_kpa;
        let mean = |(of, j): (&Vec<u32>, &f64)| {
            let sum: f64 = of[12..].iter().map(|v| p[*v as usize - n]).sum();
            sum / (of.len() - 12) as f64 + kappa * (j - 1.0)
        };
        let element_pressure = self.unknowns.iter().zip(&ratios).map(mean).collect();
        // A NaN must not pass for a large volume.
        let smallest = ratios.iter().fold(
            f64::INFINITY,
            |m, j| if *j < m || j.is_nan() { *j } else { m },
        );
        State {
            u,
            element_pressure,
            volume_ratio: ratios,
            smallest,
        }
    }

    /// The residual at a share of the load, the norm of its external part, and with `tangent` the matrix.
    fn linearise(&mut self, state: &State, load: f64, tangent: bool) -> (Vec<f64>, f64) {
        let tissue = &self.problem.tissue;
        let n = self.n_displacements;
        let reference = self.problem.mesh.nodes.as_flattened();
        let pressure = load * self.problem.pressure.1;
        let mut r = vec![0.0; n];
        self.surface
            .add_forces(pressure, reference, &state.u, &mut r);
        let external = norm(&r);
        if tangent {
            self.matrix.clear();
            self.surface_tangent.stiffness.blocks.fill([0.0; 9]);
            self.surface.add_symmetric_tangent(
                pressure,
                reference,
                &state.u,
                &mut self.surface_tangent,
            );
        }
        for e in 0..self.unknowns.len() {
            let f = self.deformation(e, &state.u);
            let (cof, j) = cofactor(&f);
            let product = |m: usize, n: usize| (0..3).map(|i| f[i][m] * f[i][n]).sum::<f64>();
            let c = [
                product(0, 0),
                product(1, 1),
                product(2, 2),
                product(0, 1),
                product(0, 2),
                product(1, 2),
            ];
            let at_point = Load {
                pressure: state.element_pressure[e],
                bulk: self.share * tissue.volumetric.kappa_kpa,
                active: load * self.problem.active_kpa,
                active_slope: 0.0,
            };
            let response = respond::<f64, true>(tissue, &c, j, &at_point);
            let (s, d, volume) = (response.s, response.d, self.volume_mm3(e));
            let s = [[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]];
            let g: [[f64; 3]; 4] = std::array::from_fn(|a| {
                std::array::from_fn(|k| self.batches[e / 8].points[0].grad[a][k][e % 8])
            });
            let times = |m: &[[f64; 3]; 3], v: &[f64; 3]| -> [f64; 3] {
                std::array::from_fn(|i| (0..3).map(|k| m[i][k] * v[k]).sum())
            };
            let unknowns = &self.unknowns[e];
            for a in 0..4 {
                let force = times(&f, &times(&s, &g[a]));
                (0..3).for_each(|i| r[unknowns[3 * a + i] as usize] += volume * force[i]);
            }
            if !tangent {
                continue;
            }
            // Engineering strain by each displacement of the element.
            let strain: [[f64; 6]; 12] = std::array::from_fn(|q| {
                let (a, i) = (q / 3, q % 3);
                let shear = |k: usize, l: usize| f[i][k] * g[a][l] + f[i][l] * g[a][k];
                [
                    f[i][0] * g[a][0],
                    f[i][1] * g[a][1],
                    f[i][2] * g[a][2],
                    shear(0, 1),
                    shear(0, 2),
                    shear(1, 2),
                ]
            });
            let size = unknowns.len();
            let mut matrix = vec![0.0; size * size];
            for q in 0..12 {
                let stress: [f64; 6] =
                    std::array::from_fn(|m| (0..6).map(|n| d[at(m, n)] * strain[q][n]).sum());
                let sg = times(&s, &g[q / 3]);
                for t in 0..12 {
                    let geometric = if q % 3 == t % 3 {
                        (0..3).map(|k| g[t / 3][k] * sg[k]).sum()
                    } else {
                        0.0
                    };
                    let material: f64 = (0..6).map(|m| strain[t][m] * stress[m]).sum();
                    matrix[q * size + t] = volume * (material + geometric);
                }
                let change = volume * times(&cof, &g[q / 3])[q % 3] / (size - 12) as f64;
                for v in 12..size {
                    matrix[q * size + v] = change;
                    matrix[v * size + q] = change;
                }
            }
            for (k, m) in self.element_compliance(e).into_iter().enumerate() {
                matrix[(12 + k / (size - 12)) * size + 12 + k % (size - 12)] = -m;
            }
            self.matrix.add(unknowns, &matrix, &self.fixed);
        }
        if tangent {
            let stiffness = &self.surface_tangent.stiffness;
            for node in 0..n / 3 {
                for k in stiffness.pattern.row(node) {
                    let other = stiffness.pattern.column[k];
                    for m in 0..9 {
                        let (row, column) = (3 * node as u32 + m / 3, 3 * other + m % 3);
                        if !self.fixed[row as usize] && !self.fixed[column as usize] {
                            self.matrix
                                .add_entry(row, column, stiffness.blocks[k][m as usize]);
                        }
                    }
                }
            }
        }
        (0..n).filter(|k| self.fixed[*k]).for_each(|k| r[k] = 0.0);
        (r, external)
    }

    /// Newton's method with the library's tolerances and its guard against inverted elements, pressures eliminated.
    fn newton(&mut self, u: Vec<f64>, load: f64) -> Result<(State, usize), ()> {
        let mut state = self.state(u);
        let mut wanted = 0.0;
        for iteration in 0..=15 {
            let (r, external) = self.linearise(&state, load, true);
            let size = norm(&r);
            if iteration == 0 {
                wanted = 1e-8 * size.max(external);
            }
            if size <= wanted {
                return Ok((state, iteration));
            }
            let mut step = r;
            step.resize(self.fixed.len(), 0.0);
            for k in (0..step.len()).filter(|k| self.fixed[*k]) {
                self.matrix.add_entry(k as u32, k as u32, 1.0);
            }
            self.matrix.factorise();
            self.matrix.solve(&mut step);
            let tried = (0..=6)
                .map(|halvings| 0.5_f64.powi(halvings))
                .find_map(|share| {
                    let trial = self.state(
                        state
                            .u
                            .iter()
                            .zip(&step)
                            .map(|(u, s)| u - share * s)
                            .collect(),
                    );
                    (trial.smallest > 0.1
                        && norm(&self.linearise(&trial, load, false).0) <= 1e3 * size.max(wanted))
                    .then_some(trial)
                });
            state = tried.ok_or(())?;
        }
        Err(())
    }
}

/// Cofactor and determinant of `F`.
fn cofactor(f: &[[f64; 3]; 3]) -> ([[f64; 3]; 3], f64) {
    let entry = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        f[r1][c1] * f[r2][c2] - f[r1][c2] * f[r2][c1]
    };
    let cof: [[f64; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)));
    (cof, (0..3).map(|k| f[0][k] * cof[0][k]).sum())
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}
