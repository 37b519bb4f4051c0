//! Laplace and Poisson problems on linear tetrahedra, for the fields of fibre rules and transmural
//! depths.

use cardiotwin_linalg::conjugate_gradients::{Directions, Measure, SymmetricSystem, iterate};
use cardiotwin_linalg::{Csr, Pattern};

use crate::joint::{Joint, any, dots, flags};
use crate::tet_mesh::{TetMesh, shape_gradients};
use crate::vec3::dot;

/// Relative residual at which the conjugate gradients stop.
pub const TOLERANCE: f64 = 1e-10;
/// Largest number of iterations, far more than a sound mesh needs.
const MOST_ITERATIONS: usize = 20_000;

/// Reasons why a field could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LaplaceError {
    /// No node of the field has a prescribed value.
    #[error(
        "{field}: no node has a given value; the surfaces that should hold it ({expected}) have no nodes in this \
         part of the mesh"
    )]
    Floating {
        /// Name of the field.
        field: &'static str,
        /// Surfaces that should prescribe values.
        expected: &'static str,
    },
    /// The conjugate gradients did not converge.
    #[error(
        "{field}: conjugate gradients reached a relative residual of {residual:.1e} after {iterations} iterations, \
         expected {TOLERANCE:.0e}: look for degenerate elements"
    )]
    NotConverged {
        /// Name of the field.
        field: &'static str,
        /// Relative residual that was reached.
        residual: f64,
        /// Number of iterations that were made.
        iterations: usize,
    },
}

/// Solves −Δu = `source` (per mm²) on the elements that `within` accepts, with u = `fixed` at the
/// nodes that have a prescribed value, and no flux elsewhere. Returns one value per node;
/// not-a-number at nodes without an accepted element.
///
/// On a part of a mesh, `fixed` applies to owned nodes, and values are the same bit for bit for any
/// partition. Collective.
///
/// # Errors
/// [`LaplaceError`] with the name `field`, on all parts.
pub fn solve(
    field: &'static str,
    mesh: &TetMesh,
    joint: &dyn Joint,
    within: &dyn Fn(usize) -> bool,
    fixed: &[Option<f64>],
    source: f64,
) -> Result<Vec<f64>, LaplaceError> {
    let (n, n_owned) = (mesh.n_nodes(), joint.n_owned());
    let tets: Vec<[u32; 4]> = (0..mesh.n_tets())
        .filter(|e| within(*e))
        .map(|e| mesh.tets[e])
        .collect();
    let mut active = vec![false; n];
    for node in tets.iter().flatten() {
        active[*node as usize] = true;
    }
    let active = flags(joint, &active);
    let mut held: Vec<f64> = fixed
        .iter()
        .map(|value| value.unwrap_or(f64::NAN))
        .collect();
    joint.update(&mut held);
    let fixed: Vec<Option<f64>> = held
        .into_iter()
        .map(|value| (!value.is_nan()).then_some(value))
        .collect();
    if !any(
        joint,
        (0..n_owned).any(|node| active[node] && fixed[node].is_some()),
    ) {
        return Err(LaplaceError::Floating {
            field,
            expected: "its ends",
        });
    }
    let rows = tets.iter().map(|tet| (&tet[..], &tet[..]));
    let mut matrix = Csr::zeros(Pattern::of_elements(n_owned, rows));
    let mut right = vec![0.0; n];
    for tet in &tets {
        let (gradients, volume) = shape_gradients(tet.map(|node| mesh.nodes_mm[node as usize]));
        for (i, row) in tet.map(|node| node as usize).into_iter().enumerate() {
            if row >= n_owned || fixed[row].is_some() {
                continue;
            }
            right[row] += source * volume / 4.0;
            for (j, column) in tet.iter().enumerate() {
                let entry = volume * dot(gradients[i], gradients[j]);
                match fixed[*column as usize] {
                    Some(value) => right[row] -= entry * value,
                    None => matrix.add(row as u32, *column, entry),
                }
            }
        }
    }
    let mut u = conjugate_gradients(field, matrix, joint, right)?;
    for node in 0..n_owned {
        u[node] = match fixed[node] {
            _ if !active[node] => f64::NAN,
            Some(value) => value,
            None => u[node],
        };
    }
    joint.update(&mut u);
    Ok(u)
}

/// Matrix rows of the owned nodes, with the inverse diagonal.
struct Jacobi<'a> {
    matrix: &'a Csr,
    inverse: &'a [f64],
    joint: &'a dyn Joint,
}

impl SymmetricSystem for Jacobi<'_> {
    type Number = f64;

    fn precondition(&self, r: &[f64], z: &mut [f64]) {
        for ((z, r), inverse) in z.iter_mut().zip(r).zip(self.inverse) {
            *z = inverse * r;
        }
    }

    fn multiply(&self, p: &mut [f64], q: &mut [f64]) {
        self.joint.update(p);
        self.matrix
            .multiply_rows(0, p, &mut q[..self.joint.n_owned()]);
    }

    fn dot(&self, p: &[f64], q: &[f64]) -> f64 {
        dots(self.joint, [(p, q)])[0]
    }

    fn measure(&self, r: &[f64], z: &[f64]) -> Measure {
        let [squared_size, rz] = dots(self.joint, [(r, r), (r, z)]);
        Measure { rz, squared_size }
    }
}

/// Jacobi-preconditioned conjugate gradients; rows without entries stay zero. Products add the
/// entries of a row in the whole mesh's order, so that a part's row gives the same sum as in the
/// whole mesh.
fn conjugate_gradients(
    field: &'static str,
    mut matrix: Csr,
    joint: &dyn Joint,
    b: Vec<f64>,
) -> Result<Vec<f64>, LaplaceError> {
    let mut inverse = matrix.diagonal();
    for d in &mut inverse {
        *d = if *d > 0.0 { 1.0 / *d } else { 0.0 };
    }
    matrix.order_rows_by(|column| joint.node(column as usize));
    let mut x = vec![0.0; b.len()];
    let mut directions = Directions::new(b.len());
    directions.r = b;
    let system = Jacobi {
        matrix: &matrix,
        inverse: &inverse,
        joint,
    };
    let (mut start, mut residual) = (None, 1.0);
    let ended = iterate(
        &system,
        &mut x,
        &mut directions,
        MOST_ITERATIONS,
        |squared| {
            let size = squared.sqrt();
            let start = *start.get_or_insert(size);
            residual = if start == 0.0 { 0.0 } else { size / start };
            residual < TOLERANCE || !residual.is_finite()
        },
    );
    if residual < TOLERANCE {
        Ok(x)
    } else {
        Err(LaplaceError::NotConverged {
            field,
            residual,
            iterations: ended.iterations,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint::Alone;
    use crate::test_meshes::cube;

    #[test]
    fn a_linear_field_is_exact() {
        let mesh = cube(4, 2.0);
        let fixed: Vec<_> = mesh
            .nodes_mm
            .iter()
            .map(|x| {
                (x[0] == 0.0)
                    .then_some(1.0)
                    .or_else(|| (x[0] == 2.0).then_some(5.0))
            })
            .collect();
        let u = solve("u", &mesh, &Alone(mesh.n_nodes()), &|_| true, &fixed, 0.0).unwrap();
        for (x, u) in mesh.nodes_mm.iter().zip(u) {
            assert!((u - (1.0 + 2.0 * x[0])).abs() < 1e-8);
        }
    }

    #[test]
    fn a_parabola_is_approached_with_second_order() {
        // −u″ = 2 with u = 0 at both ends of [0, 1]: u = x (1 − x).
        let errors = [4, 8, 16].map(|n| {
            let mesh = cube(n, 1.0);
            let ends = |x: &[f64; 3]| (x[2] == 0.0 || x[2] == 1.0).then_some(0.0);
            let fixed: Vec<_> = mesh.nodes_mm.iter().map(ends).collect();
            let u = solve("u", &mesh, &Alone(mesh.n_nodes()), &|_| true, &fixed, 2.0).unwrap();
            let squares: f64 = (0..mesh.n_tets())
                .map(|e| {
                    // Compared at centroids, because nodal values of a one-dimensional problem are
                    // exact.
                    let mean = mesh.tets[e]
                        .iter()
                        .map(|node| u[*node as usize])
                        .sum::<f64>()
                        / 4.0;
                    let z = mesh.centroid_mm(e)[2];
                    (mean - z * (1.0 - z)).powi(2) * mesh.volume_mm3(e)
                })
                .sum();
            squares.sqrt()
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.2, "{errors:?}");
        }
    }

    #[test]
    fn a_field_that_nothing_holds_is_refused_and_other_parts_have_no_value() {
        let mesh = cube(2, 1.0);
        let error = solve(
            "u",
            &mesh,
            &Alone(mesh.n_nodes()),
            &|_| true,
            &vec![None; mesh.n_nodes()],
            1.0,
        )
        .unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("u: no node has a given value")
        );
        let low = |e: usize| mesh.centroid_mm(e)[2] < 0.5;
        let fixed: Vec<_> = mesh
            .nodes_mm
            .iter()
            .map(|x| (x[2] == 0.0).then_some(3.0))
            .collect();
        let u = solve("u", &mesh, &Alone(mesh.n_nodes()), &low, &fixed, 0.0).unwrap();
        for (x, u) in mesh.nodes_mm.iter().zip(u) {
            assert!(
                if x[2] > 0.5 {
                    u.is_nan()
                } else {
                    (u - 3.0).abs() < 1e-9
                },
                "{x:?} {u}"
            );
        }
    }
}
