use super::super::Land2017Parameters;
use super::*;
use crate::calcium::{Calcium, Rice2008, Rice2008Parameters};
use crate::contraction::Contraction;
use cardiotwin_units::{MicroMolar, Stretch};
use cardiotwin_vocabulary::cell::cell_parameter;
use proptest::prelude::*;

fn cell(p: Land2017Parameters) -> Land2017 {
    Land2017::new(p).unwrap()
}

const STEP: NodeStep = NodeStep {
    since_activation_ms: 60.0,
    dt_ms: 1.0,
    ca_start_um: 0.5,
    ca_end_um: 0.51,
    lambda_prev: 0.97,
    lambda: 0.967,
};
const STATE: [f64; 6] = [0.25, 0.6, 0.1, 0.05, 0.12, -0.2];

fn stress(p: Land2017Parameters, step: NodeStep) -> ActiveStress {
    cell(p).try_step(&step, &STATE, &mut [0.0; 6]).unwrap()
}

#[test]
fn steady_state_stays() {
    let land = cell(Land2017Parameters::default());
    let state = land.steady_state(MicroMolar(0.6), Stretch(0.95)).unwrap();
    let step = NodeStep {
        ca_start_um: 0.6,
        ca_end_um: 0.6,
        lambda_prev: 0.95,
        lambda: 0.95,
        ..STEP
    };
    let mut trial = [0.0; 6];
    land.try_step(&step, &state, &mut trial).unwrap();
    for (a, b) in trial.iter().zip(state) {
        assert!((a - b).abs() < 1e-14);
    }
}

#[test]
fn is_second_order_in_time() {
    let land = cell(Land2017Parameters::default());
    let rice = Rice2008::new(Rice2008Parameters::default()).unwrap();
    let run = |n: usize| {
        let dt = 200.0 / n as f64;
        let mut state = land.steady_state(MicroMolar(0.15), Stretch(1.0)).unwrap();
        let lambda = |t: f64| 1.0 - 0.15 * (t / 200.0).powi(2);
        let mut sa = 0.0;
        for k in 0..n {
            let (t0, t1) = (k as f64 * dt, (k + 1) as f64 * dt);
            let step = NodeStep {
                since_activation_ms: t1,
                dt_ms: dt,
                ca_start_um: rice.concentration_um(t0),
                ca_end_um: rice.concentration_um(t1),
                lambda_prev: lambda(t0),
                lambda: lambda(t1),
            };
            let mut trial = [0.0; 6];
            sa = land.try_step(&step, &state, &mut trial).unwrap().sa_kpa;
            state = trial;
        }
        sa
    };
    let exact = run(6400);
    let errors = [100, 200, 400].map(|n| (run(n) - exact).abs());
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.2, "{errors:?}");
    }
    assert!(errors[1] < 0.05, "1 ms steps: {errors:?}");
}

#[test]
fn each_parameter_moves_stress_and_tangent() {
    let b = Land2017Parameters::default();
    let reference = stress(b, STEP);
    let moved = [
        Land2017Parameters {
            k_trpn_per_ms: 0.11,
            ..b
        },
        Land2017Parameters { n_trpn: 2.1, ..b },
        Land2017Parameters {
            ca50_ref_um: 0.79,
            ..b
        },
        Land2017Parameters {
            k_u_per_ms: 1.1,
            ..b
        },
        Land2017Parameters { n_tm: 5.1, ..b },
        Land2017Parameters { trpn50: 0.36, ..b },
        Land2017Parameters {
            k_uw_per_ms: 0.19,
            ..b
        },
        Land2017Parameters {
            k_ws_per_ms: 0.013,
            ..b
        },
        Land2017Parameters { r_w: 0.51, ..b },
        Land2017Parameters { r_s: 0.26, ..b },
        Land2017Parameters {
            gamma_w_per_ms: 0.63,
            ..b
        },
        Land2017Parameters { phi: 2.3, ..b },
        Land2017Parameters { a_eff: 26.0, ..b },
        Land2017Parameters { beta0: 2.4, ..b },
        Land2017Parameters {
            beta1_um: -2.5,
            ..b
        },
        Land2017Parameters {
            smax_ref_kpa: 121.0,
            ..b
        },
    ];
    for p in moved {
        let other = stress(p, STEP);
        assert!((other.sa_kpa - reference.sa_kpa).abs() > 1e-7, "{p:?}");
        assert!(
            (other.dsa_dlambda_kpa - reference.dsa_dlambda_kpa).abs() > 1e-7,
            "{p:?}"
        );
    }
    // γ_S acts outside −1 < ζ_S < 0 only.
    let lengthening = NodeStep {
        lambda: 1.0,
        ..STEP
    };
    let other = stress(
        Land2017Parameters {
            gamma_s_per_ms: 0.02,
            ..b
        },
        lengthening,
    );
    assert!((other.sa_kpa - stress(b, lengthening).sa_kpa).abs() > 1e-7);
}

#[test]
fn bad_input_is_an_error() {
    let land = cell(Land2017Parameters::default());
    let mut trial = [0.0; 6];
    let bad = NodeStep {
        lambda: f64::NAN,
        ..STEP
    };
    assert!(matches!(
        land.try_step(&bad, &STATE, &mut trial),
        Err(ContractionError::Stretch { .. })
    ));
    let far = cell(Land2017Parameters {
        beta1_um: -6.0,
        ..Default::default()
    });
    let long = NodeStep {
        lambda: 1.2,
        lambda_prev: 1.19,
        ..STEP
    };
    assert!(matches!(
        far.try_step(&long, &STATE, &mut trial),
        Err(ContractionError::Sensitivity { .. })
    ));
}

fn states_of(n: usize) -> Vec<f64> {
    (0..n)
        .flat_map(|i| STATE.map(|x| x * (1.0 - 0.01 * i as f64)))
        .collect()
}

/// Whether nodes ended as each does alone, to the bit.
fn are_as_alone(
    step: impl Fn(usize) -> NodeStep,
    states: &[f64],
    (trials, stress): (&[f64], &[ActiveStress]),
) {
    let land = cell(Land2017Parameters::default());
    let n = stress.len();
    for (node, stress) in stress.iter().enumerate() {
        let (range, mut trial) = (6 * node..6 * node + 6, [0.0; 6]);
        let alone = land
            .try_step(&step(node), &states[range.clone()], &mut trial)
            .unwrap();
        assert_eq!(
            (alone, &trial[..]),
            (*stress, &trials[range]),
            "node {node} of {n}"
        );
    }
}

#[test]
fn nodes_of_one_stretch_step_as_each_alone_to_the_bit() {
    let land = cell(Land2017Parameters::default());
    for n in [1, 7, 16, 32, 37] {
        let ca: Vec<f64> = (0..n).map(|i| 0.1 + 0.02 * i as f64).collect();
        let ca_end: Vec<f64> = ca.iter().map(|ca| 1.05 * ca).collect();
        let since = vec![60.0; n];
        let states = states_of(n);
        let step = UniformStep {
            dt_ms: 1.0,
            lambda_prev: 0.97,
            lambda: 0.967,
            since_activation_ms: &since,
            ca_start_um: &ca,
            ca_end_um: &ca_end,
        };
        let (mut trials, mut stress) = (vec![0.0; 6 * n], vec![ActiveStress::default(); n]);
        land.try_step_uniform(&step, &states, &mut trials, &mut stress)
            .unwrap();
        are_as_alone(|node| step.node(node), &states, (&trials, &stress));
    }
}

#[test]
fn nodes_with_stretches_of_their_own_step_as_each_alone_to_the_bit() {
    let land = cell(Land2017Parameters::default());
    for n in [1, 16, 37] {
        let ca: Vec<f64> = (0..n).map(|i| 0.1 + 0.02 * i as f64).collect();
        let lambda_prev: Vec<f64> = (0..n).map(|i| 1.1 - 0.01 * i as f64).collect();
        let lambda: Vec<f64> = lambda_prev.iter().map(|l| 0.997 * l).collect();
        let states = states_of(n);
        let step = EachStep {
            dt_ms: 1.0,
            lambda_prev: &lambda_prev,
            lambda: &lambda,
            since_activation_ms: &vec![60.0; n],
            ca_start_um: &ca,
            ca_end_um: &ca,
        };
        let (mut trials, mut stress) = (vec![0.0; 6 * n], vec![ActiveStress::default(); n]);
        land.try_step_each(&step, &states, &mut trials, &mut stress)
            .unwrap();
        are_as_alone(|node| step.node(node), &states, (&trials, &stress));
    }
}

#[test]
fn the_first_node_that_fails_is_named() {
    let land = cell(Land2017Parameters::default());
    let (ca, states) = ([0.3, 0.3, -1.0], STATE.repeat(3));
    let step = UniformStep {
        dt_ms: 1.0,
        lambda_prev: 0.97,
        lambda: 0.967,
        since_activation_ms: &[60.0; 3],
        ca_start_um: &ca,
        ca_end_um: &ca,
    };
    let (mut trials, mut stress) = ([0.0; 18], [ActiveStress::default(); 3]);
    let error = land
        .try_step_uniform(&step, &states, &mut trials, &mut stress)
        .unwrap_err();
    assert!(
        matches!(error, ContractionError::Sensitivity { .. }),
        "{error:?}"
    );
}

proptest! {
    /// A stage solves x = base + γh f(x) of the equations, and so does its derivative with the candidate stretch.
    #[test]
    fn stages_solve_the_equations(
        place in prop::array::uniform17(0.0..1.0f64), capped in any::<bool>(),
        lambda in 0.7..1.25f64, lambda_prev in 0.7..1.25f64, dt in 0.05..2.0f64, ca in 0.1..1.0f64,
        trpn in 0.05..0.9f64, w in 0.0..0.3f64, s in 0.0..0.3f64, zw in -0.5..0.5f64, zs in -1.5..0.5f64,
    ) {
        let mut i = 0;
        let mut p = Land2017Parameters::from_values(Land2017Parameters::TABLE.map(|row| {
            let [low, high] = cell_parameter(row.name).unwrap().interval.unwrap();
            i += 1;
            low + place[i - 1] * (high - low)
        }));
        p.cap_unblocking = capped;
        p.allow_negative_k_wu = true;
        let land = cell(p);
        let shared = Shared::new(&land, dt);
        let Ok(stretched) = Stretched::new(&land, dt, lambda_prev, lambda) else {
            // Ca50 is not positive at this stretch.
            return Ok(());
        };
        // Any derivative of the base will do: the stage is linear in it.
        let base = [trpn, 0.4, w, s, zw, zs].map(|v| Dual { v, d: 0.3 - v });
        for (ca50, share) in stretched.ca50.into_iter().zip([GAMMA, 1.0]) {
            let x = shared.stage(base, ca, stretched.rate, ca50);
            let at = Dual { v: lambda_prev + share * (lambda - lambda_prev), d: share };
            let rates = land.k.rates(&x, Dual::of(ca), at, stretched.rate);
            // The rate of B is a difference of large terms.
            let stiff = shared.gh * land.k.k_b * land.k.blocking(x[0].v.ln()).0;
            // So is the rate of CaTRPN where little of Ca50 is left.
            let binding = shared.gh * land.k.k_trpn * land.k.binding((ca / ca50.v).ln());
            for i in 0..N {
                let (change, slope) = (shared.gh * rates[i].v, shared.gh * rates[i].d);
                let size = 1.0 + change.abs() + stiff + if i == 0 { binding } else { 0.0 };
                let dsize = 1.0 + slope.abs() + x[i].d.abs() + 100.0 * stiff;
                let miss = x[i].v - base[i].v - change;
                let dmiss = x[i].d - base[i].d - slope;
                prop_assert!(miss.abs() < 1e-12 * size, "state {}: {} of {}", i, miss, change);
                prop_assert!(dmiss.abs() < 1e-11 * dsize, "slope {}: {} of {}", i, dmiss, slope);
            }
        }
    }

    #[test]
    fn tangent_is_the_slope(
        lambda in 0.75..1.15f64, lambda_prev in 0.75..1.15f64, dt in 0.05..2.0f64, ca in 0.1..1.0f64,
        trpn in 0.05..0.9f64, w in 0.0..0.3f64, s in 0.0..0.3f64, zw in -0.5..0.5f64, zs in -1.2..0.5f64
    ) {
        let land = cell(Land2017Parameters::default());
        let state = [trpn, 0.4, w, s, zw, zs];
        let at = |lambda: f64| {
            let step = NodeStep { lambda, lambda_prev, dt_ms: dt, ca_start_um: ca, ca_end_um: 1.02 * ca, ..STEP };
            land.try_step(&step, &state, &mut [0.0; 6]).unwrap()
        };
        let h = 1e-7;
        let slope = (at(lambda + h).sa_kpa - at(lambda - h).sa_kpa) / (2.0 * h);
        let tangent = at(lambda).dsa_dlambda_kpa;
        // Kinks of the distortion rates inside the difference are allowed to miss, everything else is not.
        let one_sided = (at(lambda + h).dsa_dlambda_kpa - at(lambda - h).dsa_dlambda_kpa).abs();
        prop_assert!((slope - tangent).abs() < 1e-4 * (1.0 + tangent.abs()) + one_sided, "{slope} {tangent}");
    }
}
