//! Laplace and Poisson problems on linear tetrahedra, for fields that fibre rules and depths are made of.

use crate::adjacency::Adjacency;
use crate::tet_mesh::{TetMesh, shape_gradients};
use crate::vec3::dot;

/// Relative residual at which conjugate gradients stop.
pub const TOLERANCE: f64 = 1e-10;
/// Iterations for each unknown's square root; far more than a sound mesh needs.
const MOST_ITERATIONS: usize = 20_000;

/// Why a field could not be solved for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LaplaceError {
    /// Nothing holds the field.
    #[error(
        "{field}: no node has a given value; the surfaces that should hold it ({expected}) have no nodes in this part of the mesh"
    )]
    Floating {
        /// Which field.
        field: &'static str,
        /// Where values were expected.
        expected: &'static str,
    },
    /// Conjugate gradients did not converge.
    #[error(
        "{field}: conjugate gradients stand at a relative residual of {residual:.1e} after {iterations} iterations, expected {TOLERANCE:.0e}: look for degenerate elements"
    )]
    NotConverged {
        /// Which field.
        field: &'static str,
        /// Where it stands.
        residual: f64,
        /// After so many.
        iterations: usize,
    },
}

/// A symmetric matrix in compressed rows.
struct Matrix {
    pattern: Adjacency,
    values: Vec<f64>,
}

impl Matrix {
    fn times(&self, x: &[f64], y: &mut [f64]) {
        for (i, out) in y.iter_mut().enumerate() {
            let row = self.pattern.starts[i]..self.pattern.starts[i + 1];
            *out = row.map(|k| self.values[k] * x[self.pattern.items[k] as usize]).sum();
        }
    }
}

/// Solves −Δu = `source` (per mm²) on the elements that `within` accepts, with u = `fixed` at the nodes where that is
/// given and no flux elsewhere. Returns a value for each node; not-a-number at nodes of no accepted element.
///
/// # Errors
/// [`LaplaceError`], which names `field`.
pub fn solve(
    field: &'static str,
    mesh: &TetMesh,
    within: &dyn Fn(usize) -> bool,
    fixed: &[Option<f64>],
    source: f64,
) -> Result<Vec<f64>, LaplaceError> {
    let n = mesh.n_nodes();
    let tets: Vec<[u32; 4]> = (0..mesh.n_tets()).filter(|e| within(*e)).map(|e| mesh.tets[e]).collect();
    let mut active = vec![false; n];
    for node in tets.iter().flatten() {
        active[*node as usize] = true;
    }
    if !(0..n).any(|node| active[node] && fixed[node].is_some()) {
        return Err(LaplaceError::Floating { field, expected: "its ends" });
    }
    let pattern = Adjacency::node_to_nodes(n, &tets);
    let mut matrix = Matrix { values: vec![0.0; pattern.items.len()], pattern };
    let mut right = vec![0.0; n];
    for tet in &tets {
        let (gradients, volume) = shape_gradients(tet.map(|node| mesh.nodes_mm[node as usize]));
        for (i, row) in tet.map(|node| node as usize).into_iter().enumerate() {
            if fixed[row].is_some() {
                continue;
            }
            right[row] += source * volume / 4.0;
            for (j, column) in tet.iter().enumerate() {
                let entry = volume * dot(gradients[i], gradients[j]);
                match fixed[*column as usize] {
                    Some(value) => right[row] -= entry * value,
                    None => {
                        if let Ok(k) = matrix.pattern.row(row).binary_search(column) {
                            matrix.values[matrix.pattern.starts[row] + k] += entry;
                        }
                    }
                }
            }
        }
    }
    let mut u = conjugate_gradients(field, &matrix, &right)?;
    for node in 0..n {
        u[node] = match fixed[node] {
            _ if !active[node] => f64::NAN,
            Some(value) => value,
            None => u[node],
        };
    }
    Ok(u)
}

/// Jacobi-preconditioned; rows without entries stay zero.
fn conjugate_gradients(field: &'static str, a: &Matrix, b: &[f64]) -> Result<Vec<f64>, LaplaceError> {
    let n = b.len();
    let inverse: Vec<f64> = (0..n)
        .map(|i| {
            let diagonal =
                a.pattern.row(i).binary_search(&(i as u32)).map_or(0.0, |k| a.values[a.pattern.starts[i] + k]);
            if diagonal > 0.0 { 1.0 / diagonal } else { 0.0 }
        })
        .collect();
    let inner = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let mut x = vec![0.0; n];
    let mut r = b.to_vec();
    let mut z: Vec<f64> = r.iter().zip(&inverse).map(|(r, m)| r * m).collect();
    let mut p = z.clone();
    let mut ap = vec![0.0; n];
    let mut rz = inner(&r, &z);
    let start = inner(b, b).sqrt();
    let mut residual = 1.0;
    if start == 0.0 {
        return Ok(x);
    }
    for _ in 0..MOST_ITERATIONS {
        a.times(&p, &mut ap);
        let step = rz / inner(&p, &ap);
        for i in 0..n {
            x[i] += step * p[i];
            r[i] -= step * ap[i];
            z[i] = inverse[i] * r[i];
        }
        residual = inner(&r, &r).sqrt() / start;
        if residual < TOLERANCE {
            return Ok(x);
        }
        if !residual.is_finite() {
            break;
        }
        let next = inner(&r, &z);
        let turn = next / rz;
        rz = next;
        for i in 0..n {
            p[i] = z[i] + turn * p[i];
        }
    }
    Err(LaplaceError::NotConverged { field, residual, iterations: MOST_ITERATIONS })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_meshes::cube;

    #[test]
    fn a_linear_field_is_exact() {
        let mesh = cube(4, 2.0);
        let fixed: Vec<_> = mesh
            .nodes_mm
            .iter()
            .map(|x| (x[0] == 0.0).then_some(1.0).or_else(|| (x[0] == 2.0).then_some(5.0)))
            .collect();
        let u = solve("u", &mesh, &|_| true, &fixed, 0.0).unwrap();
        for (x, u) in mesh.nodes_mm.iter().zip(u) {
            assert!((u - (1.0 + 2.0 * x[0])).abs() < 1e-8);
        }
    }

    #[test]
    fn a_parabola_is_approached_with_second_order() {
        // −u″ = 2 between u = 0 at both ends of [0, 1]: u = x (1 − x)
        let errors = [4, 8, 16].map(|n| {
            let mesh = cube(n, 1.0);
            let ends = |x: &[f64; 3]| (x[2] == 0.0 || x[2] == 1.0).then_some(0.0);
            let fixed: Vec<_> = mesh.nodes_mm.iter().map(ends).collect();
            let u = solve("u", &mesh, &|_| true, &fixed, 2.0).unwrap();
            let squares: f64 = (0..mesh.n_tets())
                .map(|e| {
                    // at centroids: nodal values of a one-dimensional problem are exact
                    let mean = mesh.tets[e].iter().map(|node| u[*node as usize]).sum::<f64>() / 4.0;
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
        let error = solve("u", &mesh, &|_| true, &vec![None; mesh.n_nodes()], 1.0).unwrap_err();
        assert!(error.to_string().starts_with("u: no node has a given value"));
        let low = |e: usize| mesh.centroid_mm(e)[2] < 0.5;
        let fixed: Vec<_> = mesh.nodes_mm.iter().map(|x| (x[2] == 0.0).then_some(3.0)).collect();
        let u = solve("u", &mesh, &low, &fixed, 0.0).unwrap();
        for (x, u) in mesh.nodes_mm.iter().zip(u) {
            assert!(if x[2] > 0.5 { u.is_nan() } else { (u - 3.0).abs() < 1e-9 }, "{x:?} {u}");
        }
    }
}
