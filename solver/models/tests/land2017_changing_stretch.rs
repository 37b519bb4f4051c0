//! The organ's step of Land 2017 against SciPy, under a prescribed stretch that changes. The script
//! next to `tests/data/land2017_changing_stretch.json` generated these data.

use cardiotwin_models::calcium::{Calcium, Rice2008, Rice2008Parameters};
use cardiotwin_models::contraction::{
    ActiveStress, Contraction, Land2017, Land2017Parameters, NodeStep, UniformStep,
};
use serde_json::Value;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// A case of the reference.
struct Case {
    name: String,
    land: Land2017,
    calcium: Rice2008,
    law: Value,
    samples: Vec<Value>,
}

fn cases() -> Vec<Case> {
    let text = include_str!("data/land2017_changing_stretch.json");
    let document: Value = serde_json::from_str(text).unwrap();
    let case = |case: &Value| {
        let parameter = |name: &str| number(&case["parameters"][name]);
        let land = Land2017Parameters::TABLE.map(|p| parameter(p.name));
        let rice = Rice2008Parameters::TABLE.map(|p| parameter(p.name));
        let land = Land2017Parameters {
            cap_unblocking: case["cap_unblocking"].as_bool().unwrap(),
            ..Land2017Parameters::from_values(land)
        };
        Case {
            name: case["name"].as_str().unwrap().to_owned(),
            land: Land2017::new(land).unwrap(),
            calcium: Rice2008::new(Rice2008Parameters::from_values(rice)).unwrap(),
            law: case["stretch_law"].clone(),
            samples: case["samples"].as_array().unwrap().clone(),
        }
    };
    let cases = document["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 5);
    cases.iter().map(case).collect()
}

impl Case {
    fn stretch(&self, t_ms: f64) -> f64 {
        let waves = self.law["waves"].as_array().unwrap();
        let wave = |wave: &Value| {
            let turns = t_ms / number(&wave[1]);
            number(&wave[0]) * (std::f64::consts::TAU * turns + number(&wave[2])).sin()
        };
        number(&self.law["mean"]) + waves.iter().map(wave).sum::<f64>()
    }

    /// Largest difference of stress \[kPa\] over the samples, with `n` steps between two of them.
    /// The step of many nodes runs alongside the step of one node and must agree bit for bit.
    fn error_kpa(&self, n: usize) -> f64 {
        let mut state: [f64; 6] = std::array::from_fn(|i| number(&self.samples[0]["states"][i]));
        let mut largest: f64 = 0.0;
        for pair in self.samples.windows(2) {
            let (from, to) = (number(&pair[0]["t_ms"]), number(&pair[1]["t_ms"]));
            let dt_ms = (to - from) / n as f64;
            let mut stress = ActiveStress::default();
            for k in 0..n {
                let (t0, t1) = (from + k as f64 * dt_ms, from + (k + 1) as f64 * dt_ms);
                let step = NodeStep {
                    since_activation_ms: t1,
                    dt_ms,
                    ca_start_um: self.calcium.concentration_um(t0),
                    ca_end_um: self.calcium.concentration_um(t1),
                    lambda_prev: self.stretch(t0),
                    lambda: self.stretch(t1),
                };
                let mut trial = [0.0; 6];
                stress = self.land.try_step(&step, &state, &mut trial).unwrap();
                let (mut trials, mut both) = ([0.0; 12], [ActiveStress::default(); 2]);
                let uniform = UniformStep {
                    dt_ms,
                    lambda_prev: step.lambda_prev,
                    lambda: step.lambda,
                    since_activation_ms: &[t1; 2],
                    ca_start_um: &[step.ca_start_um; 2],
                    ca_end_um: &[step.ca_end_um; 2],
                };
                let states = [state; 2].concat();
                self.land
                    .try_step_uniform(&uniform, &states, &mut trials, &mut both)
                    .unwrap();
                assert_eq!(
                    (both, &trials[6..]),
                    ([stress; 2], &trial[..]),
                    "{}",
                    self.name
                );
                state = trial;
            }
            largest = largest.max((stress.sa_kpa - number(&pair[1]["Sa_kPa"])).abs());
        }
        largest
    }
}

#[test]
fn organ_step_converges_to_the_outside_reference() {
    for case in cases() {
        let errors = [1, 10, 200].map(|n| case.error_kpa(n));
        let [ten, one, fine] = errors;
        println!(
            "{:20} steps of 10, 1 and 0.05 ms: {ten:.1e}, {one:.1e}, {fine:.1e} kPa",
            case.name
        );
        // The method is of second order; one millisecond is the step of an organ beat.
        assert!(errors[1] < 0.5, "{} {errors:?}", case.name);
        assert!(errors[2] < 2e-3, "{} {errors:?}", case.name);
        assert!(errors[2] < 0.01 * errors[1], "{} {errors:?}", case.name);
    }
}
