//! Diffusion compared with closed-form solutions.

mod common;

use cardiotwin_electrophysiology::diffusion::Diffusion;
use common::block;
use std::f64::consts::PI;

const LENGTH_MM: f64 = 4.0;
const DIFFUSIVITIES: [f64; 3] = [0.4, 0.1, 0.2];
const END_MS: f64 = 4.0;

/// Sum of a cosine along each axis of the tensor, each with its own decay rate.
fn modes(x: &[f64; 3], t_ms: f64, axes: [usize; 3]) -> f64 {
    let k = PI / LENGTH_MM;
    (0..3)
        .map(|i| (k * x[axes[i]]).cos() * (-DIFFUSIVITIES[i] * k * k * t_ms).exp())
        .sum()
}

/// Computed and exact potential at the end.
fn solved(n: usize, step_ms: f64) -> (Vec<f64>, Vec<f64>) {
    let mesh = block([n; 3], [LENGTH_MM; 3], [1.0, 0.0, 0.0]);
    // Axis of space for each direction of the tissue.
    let frame = mesh.frames[0];
    let axis = |v: [f64; 3]| (0..3).find(|k| v[*k].abs() > 0.99).unwrap();
    let axes = [axis(frame.fibre), axis(frame.sheet), axis(frame.normal)];
    let mut diffusion = Diffusion::new(
        &mesh.nodes_mm,
        &mesh.tets,
        &mesh.frames,
        DIFFUSIVITIES,
        step_ms,
    );
    let at = |t_ms: f64| {
        mesh.nodes_mm
            .iter()
            .map(|x| modes(x, t_ms, axes))
            .collect::<Vec<_>>()
    };
    let mut v = at(0.0);
    let before = diffusion.integral(&v);
    for _ in 0..(END_MS / step_ms).round() as usize {
        diffusion.step(&mut v).unwrap();
    }
    assert!(
        (diffusion.integral(&v) - before).abs() < 1e-4,
        "what diffuses is kept"
    );
    (v, at(END_MS))
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn diffusion_is_of_second_order_in_space() {
    let errors = [4, 8, 16].map(|n| {
        let (v, exact) = solved(n, 0.1);
        distance(&v, &exact)
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.2, "{order}: {errors:?}");
    }
}

#[test]
fn diffusion_is_of_second_order_in_time() {
    // Compared with short steps on the same mesh, so that the spatial error cancels.
    let (fine, _) = solved(6, 0.03125);
    let errors = [2.0, 1.0, 0.5].map(|step_ms| distance(&solved(6, step_ms).0, &fine));
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.2, "{order}: {errors:?}");
    }
}
