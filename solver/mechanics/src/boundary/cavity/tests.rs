//! Volume, its gradient and the load of a box without a lid, and of a tube.

use cardiotwin_linalg::parallel::SingleProcess;

use super::*;

/// The unit cube's surface with inward normals, out of the surrounding tissue; bottom and top come first.
fn cube() -> (Vec<f64>, Vec<[u32; 3]>) {
    let nodes = (0..8_u32)
        .flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(f64::from))
        .collect();
    let quads = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let triangles = quads
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .collect();
    (nodes, triangles)
}

/// The cube without its first `n` sides, with its openings in the direction of the remaining triangles' edges.
fn open_cube(n: usize) -> (Vec<f64>, Cavity) {
    let (nodes, triangles) = cube();
    let pattern = Pattern::of_elements(
        8,
        [(&[0, 1, 2, 3, 4, 5, 6, 7][..], &[0, 1, 2, 3, 4, 5, 6, 7][..])].into_iter(),
    );
    let openings = [vec![0, 1, 3, 2], vec![4, 6, 7, 5]][..n]
        .iter()
        .map(|o| o.iter().rev().copied().collect())
        .collect();
    let cavity = Cavity::new(
        &triangles[2 * n..],
        openings,
        &triangles[..2 * n],
        &nodes,
        &pattern,
        &SingleProcess,
    );
    (nodes, cavity.expect("triangles of the body"))
}

#[test]
fn volume_counts_the_caps_and_moves_with_the_body() {
    for n in 0..=2 {
        let (nodes, cavity) = open_cube(n);
        let still = vec![0.0; 24];
        assert!(
            (cavity.volume(&SingleProcess, &nodes, &still) - 1.0).abs() < 1e-14,
            "{n} openings"
        );
        let moved: Vec<f64> = (0..24).map(|k| [3.0, -2.0, 5.0][k % 3]).collect();
        assert!(
            (cavity.volume(&SingleProcess, &nodes, &moved) - 1.0).abs() < 1e-13,
            "{n} openings"
        );
    }
}

#[test]
fn gradient_is_the_slope_of_the_volume() {
    for n in 0..=2 {
        let (nodes, cavity) = open_cube(n);
        let u: Vec<f64> = (0..24).map(|k| 0.1 * (1.7 * f64::from(k)).sin()).collect();
        let mut gradient = vec![0.0; 24];
        cavity.add_volume_gradient(&SingleProcess, 2.0, &nodes, &u, &mut gradient);
        for k in 0..24 {
            let at = |h: f64| {
                let mut moved = u.clone();
                moved[k] += h;
                cavity.volume(&SingleProcess, &nodes, &moved)
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (gradient[k] - 2.0 * slope).abs() < 1e-9,
                "{n} openings, {k}: {} {slope}",
                gradient[k]
            );
        }
    }
}

#[test]
fn caps_that_hang_on_the_rim_take_the_resultant_away() {
    let (nodes, cavity) = open_cube(1);
    let u: Vec<f64> = (0..24).map(|k| 0.1 * (1.7 * f64::from(k)).sin()).collect();
    let mut force = vec![0.0; 24];
    cavity.add_forces(&SingleProcess, 3.0, &nodes, &u, &mut force);
    for i in 0..3 {
        assert!(force.iter().skip(i).step_by(3).sum::<f64>().abs() < 1e-14);
    }
    // At rest the lid of unit area pulls its ring with the pressure, evenly over the four corners.
    let mut force = vec![0.0; 24];
    cavity.add_forces(&SingleProcess, 3.0, &nodes, &[0.0; 24], &mut force);
    let ring: f64 = [0, 1, 2, 3].iter().map(|n| force[3 * n + 2]).sum();
    let wall_alone: f64 = [4, 5, 6, 7].iter().map(|n| force[3 * n + 2]).sum();
    assert!(
        (ring + wall_alone).abs() < 1e-14 && (ring - 3.0).abs() < 1e-13,
        "{ring} {wall_alone}"
    );
}
