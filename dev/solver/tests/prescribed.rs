//! Bodies under prescribed loads: viscosity, and the balance of energy over a beat.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_linalg::Operator as _;
use cardiotwin_linalg::parallel::{SingleProcess, VectorLayout};
use verification::beat::{ETA_KPA_MS, beat, body, deform};

#[test]
fn viscous_power_is_viscosity_times_the_squared_rate_of_strain_and_its_tangent_is_exact_at_rest() {
    let (mesh, body) = body(ETA_KPA_MS);
    let n = 3 * mesh.nodes.len();
    // A homogeneous F and rate of F: Ė = sym(Fᵀ Ḟ).
    let f = [[1.1, 0.05, 0.0], [0.0, 0.95, 0.1], [0.02, 0.0, 0.97]];
    let rate = [
        [0.01, 0.02, 0.0],
        [0.005, -0.01, 0.003],
        [0.0, 0.004, 0.006],
    ];
    let field = |a: &[[f64; 3]; 3], minus: f64| -> Vec<f64> {
        mesh.nodes
            .iter()
            .flat_map(|x| {
                let moved: [f64; 3] = std::array::from_fn(|i| {
                    (0..3).map(|k| a[i][k] * x[k]).sum::<f64>() - minus * x[i]
                });
                moved
            })
            .collect()
    };
    let (u, v) = (field(&f, 1.0), field(&rate, 0.0));
    let deformation = deform(&body, &u);
    let (mut still, mut moving) = (vec![0.0; n], vec![0.0; n]);
    body.add_forces(&u, &[], &deformation, &mut still);
    body.add_forces_in_motion(&u, &v, &[], &deformation, &mut moving);
    let power: f64 = (0..n).map(|k| (moving[k] - still[k]) * v[k]).sum();
    let squared: f64 = (0..3)
        .flat_map(|m| (0..3).map(move |k| (m, k)))
        .map(|(m, k)| {
            (0..3)
                .map(|i| 0.5 * (f[i][m] * rate[i][k] + f[i][k] * rate[i][m]))
                .sum::<f64>()
                .powi(2)
        })
        .sum();
    assert!(
        (power / (ETA_KPA_MS * squared * 1000.0) - 1.0).abs() < 1e-10,
        "{power}"
    );

    let velocity_rate = 1.7;
    let mut tangent = body.new_tangent();
    let mut force = vec![0.0; n];
    let zero = vec![0.0; n];
    body.tangent_in_motion(
        &u,
        (&zero, velocity_rate),
        &[],
        &deformation,
        &mut force,
        (1.0, &mut tangent),
    );
    let mut d: Vec<f64> = (0..n).map(|k| (1.3 * k as f64).sin()).collect();
    let mut got = vec![0.0; n];
    tangent.multiply(
        VectorLayout {
            comm: &SingleProcess,
            layout: body.layout(),
        },
        &mut d,
        &mut got,
    );
    let at = |h: f64| {
        let shifted: Vec<f64> = u.iter().zip(&d).map(|(u, d)| u + h * d).collect();
        let v: Vec<f64> = d.iter().map(|d| h * velocity_rate * d).collect();
        let mut out = vec![0.0; n];
        body.add_forces_in_motion(&shifted, &v, &[], &deform(&body, &shifted), &mut out);
        out
    };
    let (plus, minus) = (at(1e-6), at(-1e-6));
    let scale = got.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    for k in 0..n {
        assert!(
            (got[k] - (plus[k] - minus[k]) / 2e-6).abs() < 1e-6 * scale,
            "{k}"
        );
    }
    assert!(
        body_error().contains("viscosity_kPa_ms = -1"),
        "{}",
        body_error()
    );
}

fn body_error() -> String {
    let error = body(0.0)
        .1
        .set_viscosity(vec![-1.0])
        .expect_err("a negative viscosity");
    format!(
        "{error}: {}",
        std::error::Error::source(&error).expect("the parameter")
    )
}

#[test]
fn over_a_beat_the_work_of_muscle_and_pressure_is_stored_or_dissipated_within_half_a_per_cent() {
    let rows = beat();
    for b in &rows {
        assert!(
            b.gap().abs() < 0.005 * b.turned_over.max(10.0),
            "{b:?}: {}",
            b.gap()
        );
    }
    let last = rows.last().expect("a beat");
    assert!(
        last.muscle > 0.0 && last.lost > 0.1 * last.turned_over,
        "{last:?}"
    );
}
