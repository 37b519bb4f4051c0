//! Batches of eight elements: node numbers, gradients in the fibre frame, weights.

use super::shape::{slopes, tetrahedron_rule, values};
use super::{BATCH, Eight};

/// An orthonormal right-handed fibre frame with columns fibre, sheet, sheet-normal: entry `[i][k]` is component `i` of axis
/// `k`.
pub type Frame = [[f64; 3]; 3];

/// An integration point in each of eight elements.
#[derive(Debug, Clone)]
pub struct Point<const N: usize> {
    /// Gradient of each node's shape function in the fibre frame \[1/mm\].
    pub grad: [[Eight; 3]; N],
    /// Reference volume of the point \[mm³\]; zero in unused lanes.
    pub weight: Eight,
}

/// Up to eight elements of one tissue.
#[derive(Debug, Clone)]
pub struct Batch<const N: usize, const Q: usize> {
    /// Index of the tissue in the body's list.
    pub tissue: usize,
    /// Number of lanes in use; the others repeat the last element with weight zero.
    pub n: usize,
    /// Index of each lane's element in the mesh.
    pub elements: [u32; BATCH],
    /// Nodes of each lane's element.
    pub nodes: [[u32; BATCH]; N],
    /// Gradients and weights at the integration points.
    pub points: [Point<N>; Q],
}

/// Reasons why an element cannot be integrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ElementError {
    /// The element's reference volume is not positive.
    #[error(
        "element {element} has Jacobian {jacobian_mm3:.3e} mm³ at an integration point, but it must be positive: \
         the element is inverted or degenerate, or its nodes are in the wrong order"
    )]
    NotPositive {
        /// Index of the element.
        element: usize,
        /// Six times the reference volume of the point \[mm³\].
        jacobian_mm3: f64,
    },
    /// A node number is outside the mesh.
    #[error("element {element} names node {node}, but the mesh has {n_nodes} nodes")]
    NodeOutOfRange {
        /// Index of the element.
        element: usize,
        /// Node number outside the mesh.
        node: u32,
        /// Number of nodes in the mesh.
        n_nodes: usize,
    },
}

impl ElementError {
    /// Replaces the element's index by its number in the whole mesh, if `numbers` lists it.
    #[must_use]
    pub fn renumbered(mut self, numbers: &[u32]) -> Self {
        let (Self::NotPositive { element, .. } | Self::NodeOutOfRange { element, .. }) = &mut self;
        *element = numbers
            .get(*element)
            .map_or(*element, |number| *number as usize);
        self
    }
}

/// Linear shape functions of the vertices at each integration point; they interpolate nodal pressures.
#[must_use]
pub fn vertex_values<const Q: usize>() -> [[f64; 4]; Q] {
    let rule = tetrahedron_rule(Q);
    std::array::from_fn(|q| values::<4>(&rule[q].0))
}

/// Groups the elements `tets` into batches by tissue, in the given order within a tissue.
///
/// - `frame`: fibre frame at a point of an element (element, coordinates \[mm\])
///
/// # Errors
/// [`ElementError`] for the first element that is inverted, degenerate or names a missing node.
pub fn batches<const N: usize, const Q: usize>(
    nodes: &[[f64; 3]],
    tets: &[[u32; N]],
    tissue_of: &[usize],
    frame: &dyn Fn(usize, [f64; 3]) -> Frame,
) -> Result<Vec<Batch<N, Q>>, ElementError> {
    let mut order: Vec<usize> = (0..tets.len()).collect();
    order.sort_by_key(|&e| tissue_of[e]);
    let mut out = Vec::with_capacity(tets.len().div_ceil(BATCH) + 4);
    for same in order.chunk_by(|&a, &b| tissue_of[a] == tissue_of[b]) {
        for lanes in same.chunks(BATCH) {
            let mut batch = Batch {
                tissue: tissue_of[lanes[0]],
                n: lanes.len(),
                elements: [0; BATCH],
                nodes: [[0; BATCH]; N],
                points: std::array::from_fn(|_| Point {
                    grad: [[[0.0; BATCH]; 3]; N],
                    weight: [0.0; BATCH],
                }),
            };
            for lane in 0..BATCH {
                let e = lanes[lane.min(lanes.len() - 1)];
                batch.elements[lane] = e as u32;
                for a in 0..N {
                    if tets[e][a] as usize >= nodes.len() {
                        return Err(ElementError::NodeOutOfRange {
                            element: e,
                            node: tets[e][a],
                            n_nodes: nodes.len(),
                        });
                    }
                    batch.nodes[a][lane] = tets[e][a];
                }
                let x: [[f64; 3]; N] = std::array::from_fn(|a| nodes[tets[e][a] as usize]);
                for (point, (l, share)) in batch.points.iter_mut().zip(tetrahedron_rule(Q)) {
                    let (grad, jacobian) = gradients(&x, &l);
                    if !(jacobian > 0.0) {
                        return Err(ElementError::NotPositive {
                            element: e,
                            jacobian_mm3: jacobian,
                        });
                    }
                    let shape = values::<N>(&l);
                    let at: [f64; 3] =
                        std::array::from_fn(|i| (0..N).map(|a| shape[a] * x[a][i]).sum());
                    let axes = frame(e, at);
                    point.weight[lane] = if lane < lanes.len() {
                        share * jacobian / 6.0
                    } else {
                        0.0
                    };
                    for a in 0..N {
                        for k in 0..3 {
                            point.grad[a][k][lane] = (0..3).map(|i| axes[i][k] * grad[a][i]).sum();
                        }
                    }
                }
            }
            out.push(batch);
        }
    }
    Ok(out)
}

/// Spatial gradients of the shape functions, and six times the reference volume of the point.
fn gradients<const N: usize>(x: &[[f64; 3]; N], l: &[f64; 4]) -> ([[f64; 3]; N], f64) {
    let slope = slopes::<N>(l);
    // ξ_k = l_{k+1}; l₀ = 1 − Σ ξ.
    let local: [[f64; 3]; N] =
        std::array::from_fn(|a| std::array::from_fn(|k| slope[a][k + 1] - slope[a][0]));
    let mut jac = [[0.0; 3]; 3];
    for i in 0..3 {
        for k in 0..3 {
            jac[i][k] = (0..N).map(|a| x[a][i] * local[a][k]).sum();
        }
    }
    let cof = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        jac[r1][c1] * jac[r2][c2] - jac[r1][c2] * jac[r2][c1]
    };
    let det: f64 = (0..3).map(|c| jac[0][c] * cof(0, c)).sum();
    let grad = std::array::from_fn(|a| {
        std::array::from_fn(|i| (0..3).map(|k| local[a][k] * cof(i, k)).sum::<f64>() / det)
    });
    (grad, det)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODES: [[f64; 3]; 4] = [[0.0; 3], [2.0, 0.1, 0.0], [0.3, 1.5, 0.0], [0.2, 0.1, 1.2]];
    const AXES: Frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    #[test]
    fn gradients_reproduce_a_linear_field_and_weights_the_volume() {
        let batch = &batches::<4, 1>(&NODES, &[[0, 1, 2, 3]], &[0], &|_, _| AXES)
            .expect("a proper element")[0];
        for i in 0..3 {
            for k in 0..3 {
                let got: f64 = (0..4)
                    .map(|a| NODES[a][i] * batch.points[0].grad[a][k][0])
                    .sum();
                assert!((got - f64::from(u8::from(i == k))).abs() < 1e-14);
            }
        }
        let volume = (2.0 * 1.5 - 0.1 * 0.3) * 1.2 / 6.0;
        assert!((batch.points[0].weight[0] - volume).abs() < 1e-14);
        assert_eq!(batch.points[0].weight[1..], [0.0; 7]);
    }

    #[test]
    fn an_inverted_element_is_named() {
        let error = batches::<4, 1>(&NODES, &[[0, 1, 2, 3], [0, 2, 1, 3]], &[0, 0], &|_, _| AXES)
            .expect_err("inverted");
        assert!(matches!(
            error,
            ElementError::NotPositive { element: 1, .. }
        ));
        let error =
            batches::<4, 1>(&NODES, &[[0, 1, 2, 4]], &[0], &|_, _| AXES).expect_err("no such node");
        assert!(
            error
                .to_string()
                .contains("names node 4, but the mesh has 4 nodes")
        );
    }
}
