//! Shape functions and quadrature of tetrahedra and triangles in barycentric coordinates.

/// Number of nodes of a linear tetrahedron.
pub const LINEAR: usize = 4;
/// Number of nodes of a quadratic tetrahedron: four vertices, then the midpoints of [`EDGES`].
pub const QUADRATIC: usize = 10;

/// Edges of a tetrahedron in the order of VTK's mid-edge nodes; gmsh swaps the last two.
pub const EDGES: [(usize, usize); 6] = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)];

/// Barycentric coordinates and weight (volume fraction) of each point of a tetrahedron's quadrature rule.
#[must_use]
pub fn tetrahedron_rule(n_points: usize) -> Vec<([f64; 4], f64)> {
    match n_points {
        1 => vec![([0.25; 4], 1.0)],
        4 => {
            // Exact to degree 2: a = (5 + 3√5)/20, b = (5 − √5)/20.
            let (a, b) = (0.585_410_196_624_968_5, 0.138_196_601_125_010_5);
            (0..4)
                .map(|i| (std::array::from_fn(|k| if k == i { a } else { b }), 0.25))
                .collect()
        }
        _ => panic!("the rules of a tetrahedron here have 1 or 4 points, not {n_points}"),
    }
}

/// Values of the shape functions of an element with `N` nodes.
#[must_use]
pub fn values<const N: usize>(l: &[f64; 4]) -> [f64; N] {
    std::array::from_fn(|a| match (N, a) {
        (LINEAR, _) => l[a],
        (_, 0..4) => l[a] * (2.0 * l[a] - 1.0),
        _ => {
            let (i, j) = EDGES[a - 4];
            4.0 * l[i] * l[j]
        }
    })
}

/// Derivatives of the shape functions with respect to the four barycentric coordinates, taken as independent.
#[must_use]
pub fn slopes<const N: usize>(l: &[f64; 4]) -> [[f64; 4]; N] {
    std::array::from_fn(|a| {
        let mut d = [0.0; 4];
        match (N, a) {
            (LINEAR, _) => d[a] = 1.0,
            (_, 0..4) => d[a] = 4.0 * l[a] - 1.0,
            _ => {
                let (i, j) = EDGES[a - 4];
                d[i] = 4.0 * l[j];
                d[j] = 4.0 * l[i];
            }
        }
        d
    })
}

/// Barycentric coordinates and weights (area fractions) of a triangle's quadrature rule with 1, 3 or 6 points, exact to degree
/// 1, 2 or 4.
#[must_use]
pub fn triangle_rule(n_points: usize) -> Vec<([f64; 3], f64)> {
    match n_points {
        1 => vec![([1.0 / 3.0; 3], 1.0)],
        3 => (0..3)
            .map(|i| {
                (
                    std::array::from_fn(|k| if k == i { 2.0 / 3.0 } else { 1.0 / 6.0 }),
                    1.0 / 3.0,
                )
            })
            .collect(),
        6 => {
            // Dunavant 1985, degree 4.
            let orbits = [
                (
                    0.108_103_018_168_070,
                    0.445_948_490_915_965,
                    0.223_381_589_678_011,
                ),
                (
                    0.816_847_572_980_459,
                    0.091_576_213_509_771,
                    0.109_951_743_655_322,
                ),
            ];
            orbits
                .iter()
                .flat_map(|&(a, b, w)| {
                    (0..3).map(move |i| (std::array::from_fn(|k| if k == i { a } else { b }), w))
                })
                .collect()
        }
        _ => panic!("the rules of a triangle here have 1, 3 or 6 points, not {n_points}"),
    }
}

/// Edges of a triangle in the order of the quadratic triangle's mid-edge nodes.
pub const TRIANGLE_EDGES: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

/// Values and derivatives with respect to (ξ, η), the second and third barycentric coordinate, of the shape functions of a
/// triangle with three or six nodes.
#[must_use]
pub fn triangle(n_nodes: usize, l: &[f64; 3]) -> Vec<(f64, [f64; 2])> {
    let d = |slope: [f64; 3]| [slope[1] - slope[0], slope[2] - slope[0]];
    let unit = |i: usize, x: f64| std::array::from_fn(|k| if k == i { x } else { 0.0 });
    match n_nodes {
        3 => (0..3).map(|i| (l[i], d(unit(i, 1.0)))).collect(),
        6 => {
            let corners = (0..3).map(|i| (l[i] * (2.0 * l[i] - 1.0), d(unit(i, 4.0 * l[i] - 1.0))));
            let edges = TRIANGLE_EDGES.iter().map(|&(i, j)| {
                let mut slope = [0.0; 3];
                slope[i] = 4.0 * l[j];
                slope[j] = 4.0 * l[i];
                (4.0 * l[i] * l[j], d(slope))
            });
            corners.chain(edges).collect()
        }
        _ => panic!("a triangle has 3 or 6 nodes here, not {n_nodes}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ l₀ᵃ l₁ᵇ l₂ᶜ over a simplex of unit measure in n dimensions: a! b! c! n! / (a + b + c + n)!
    fn exact(powers: [u32; 3], n: u32) -> f64 {
        let f = |k: u32| (1..=k).product::<u32>() as f64;
        powers.iter().map(|p| f(*p)).product::<f64>() * f(n) / f(powers.iter().sum::<u32>() + n)
    }

    #[test]
    fn rules_integrate_polynomials_of_their_degree() {
        for (n, degree) in [(1, 1), (4, 2)] {
            for powers in [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]] {
                if powers.iter().sum::<u32>() <= degree {
                    let got: f64 = tetrahedron_rule(n)
                        .iter()
                        .map(|(l, w)| {
                            w * (0..3).map(|k| l[k].powi(powers[k] as i32)).product::<f64>()
                        })
                        .sum();
                    assert!((got - exact(powers, 3)).abs() < 1e-14);
                }
            }
        }
        for (n, degree) in [(1, 1), (3, 2), (6, 4)] {
            for powers in [
                [0, 0, 0],
                [1, 0, 0],
                [1, 1, 0],
                [2, 0, 0],
                [2, 1, 1],
                [2, 2, 0],
                [4, 0, 0],
                [3, 1, 0],
            ] {
                if powers.iter().sum::<u32>() <= degree {
                    let got: f64 = triangle_rule(n)
                        .iter()
                        .map(|(l, w)| {
                            w * (0..3).map(|k| l[k].powi(powers[k] as i32)).product::<f64>()
                        })
                        .sum();
                    assert!(
                        (got - exact(powers, 2)).abs() < 1e-14,
                        "{n} points, {powers:?}: {got}"
                    );
                }
            }
        }
    }

    #[test]
    fn shape_functions_are_one_at_their_node_and_sum_to_one() {
        let mut nodes = vec![];
        for i in 0..4 {
            nodes.push(std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 }));
        }
        for (i, j) in EDGES {
            nodes.push(std::array::from_fn(|k| {
                if k == i || k == j { 0.5 } else { 0.0 }
            }));
        }
        for (n, l) in nodes.iter().enumerate() {
            for (a, v) in values::<QUADRATIC>(l).into_iter().enumerate() {
                assert_eq!(v, if a == n { 1.0 } else { 0.0 });
            }
        }
        let l = [0.1, 0.2, 0.3, 0.4];
        assert!((values::<QUADRATIC>(&l).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        let total: [f64; 4] =
            std::array::from_fn(|k| slopes::<QUADRATIC>(&l).iter().map(|s| s[k]).sum());
        assert!(
            total.iter().all(|t| (t - total[0]).abs() < 1e-14),
            "a constant has no gradient along the simplex"
        );
        let six = triangle(6, &[0.2, 0.3, 0.5]);
        assert!((six.iter().map(|s| s.0).sum::<f64>() - 1.0).abs() < 1e-15);
        assert!(six.iter().map(|s| s.1[0]).sum::<f64>().abs() < 1e-14);
    }
}
