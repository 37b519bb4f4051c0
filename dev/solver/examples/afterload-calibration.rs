//! Hit and false alarm rates of the afterload search: how often it names an effect that is present,
//! any effect where none is missing, and any effect for gaps outside its catalogue.
//!
//! `cargo run --release --manifest-path dev/Cargo.toml --example afterload-calibration`
//!
//! Flows are the measured ones of `examples/afterload`, with noise of 1.5 % of their peak that the
//! fit does not see. Pressures are simulated by the same equations (an inverse crime), with
//! coloured noise of 1 mmHg or 2 % of the pulse.

use cardiotwin_calibrate::afterload::{
    DiscoverySettings, EFFECTS, Record, discover, fit_windkessel, simulate,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

const FLOWS: [(&str, &str); 3] = [
    ("human-1999/flow.csv", "human-1999/pressure.csv"),
    (
        "porcine-in-vivo/flow-1.csv",
        "porcine-in-vivo/pressure-1.csv",
    ),
    (
        "porcine-ex-vivo/flow-1.csv",
        "porcine-ex-vivo/pressure-1.csv",
    ),
];
const N_NULL: usize = 30;
const N_EACH: usize = 2;
const PRESSURE_NOISE: f64 = 0.02;
const FLOW_NOISE: f64 = 0.015;
const CORRELATION_MS: f64 = 10.0;

/// Weak and clear strengths of each effect, in the units of its parameters.
const STRENGTHS: [(&str, &[f64], &[f64]); 10] = [
    ("wave_reflection", &[1.5e-3, 0.3, 0.03], &[4e-3, 0.3, 0.05]),
    ("tube_reflection", &[20.0], &[50.0]),
    ("parallel_inertance", &[40.0], &[10.0]),
    ("series_inertance", &[4e-4], &[1.2e-3]),
    ("viscoelastic_wall", &[0.3, 100.0], &[0.7, 150.0]),
    ("quadratic_loss", &[3e-5], &[1.2e-4]),
    ("pressure_dependent_compliance", &[0.015], &[0.04]),
    ("outflow_pressure", &[20.0], &[50.0]),
    ("timing_misalignment", &[8.0], &[-25.0]),
    ("catheter_response", &[40.0, 0.3], &[80.0, 0.2]),
];

fn read(file: &str) -> (Vec<f64>, Vec<f64>) {
    let path = format!(
        "{}/../../examples/afterload/{file}",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(&path).expect(&path);
    let rows = text
        .lines()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_digit() || c == '-'));
    let row = |line: &str| {
        let (time, value) = line.split_once(',').expect("two columns");
        (
            time.parse::<f64>().expect("a time"),
            value.parse::<f64>().expect("a value"),
        )
    };
    rows.map(row).unzip()
}

/// Coloured noise (an Ornstein–Uhlenbeck process) at the given times.
fn noise(time_ms: &[f64], rms: f64, random: &mut Pcg64) -> Vec<f64> {
    let mut normal = || {
        let (u, v): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    };
    let mut state = rms * normal();
    (0..time_ms.len())
        .map(|i| {
            if i > 0 {
                let kept = (-(time_ms[i] - time_ms[i - 1]) / CORRELATION_MS).exp();
                state = kept * state + rms * (1.0 - kept * kept).sqrt() * normal();
            }
            state
        })
        .collect()
}

/// A gap outside the catalogue.
#[derive(Clone, Copy, Debug)]
enum Outside {
    /// A rattle of 25 Hz after each closure of the valve.
    Rattle,
    /// The flow probe saturates and reads too low at high flow.
    Saturation,
    /// The pressure drifts slowly, like a transducer that warms up.
    Drift,
}

struct Scene {
    flow: (Vec<f64>, Vec<f64>),
    pressure_time_ms: Vec<f64>,
    three: [f64; 3],
    start: f64,
    record: Record,
}

fn scene(idx: usize, random: &mut Pcg64) -> Scene {
    let (flow, pressure) = (read(FLOWS[idx % 3].0), read(FLOWS[idx % 3].1));
    let record =
        Record::new(&flow.0, &flow.1, &pressure.0, &pressure.1).expect("a record of the examples");
    let fit = fit_windkessel(&record, Default::default()).expect("a record of the examples");
    let mut vary = |x: f64| x * (0.75 + 0.5 * random.random::<f64>());
    let three = [
        vary(fit.r1.value),
        vary(fit.r2.value),
        vary(fit.compliance.value),
    ];
    Scene {
        flow,
        pressure_time_ms: pressure.0,
        three,
        start: fit.start.value,
        record,
    }
}

impl Scene {
    fn measured(&self, exact: Vec<f64>, outside: Option<Outside>, random: &mut Pcg64) -> Record {
        let span = |v: &[f64]| {
            let (low, high) = v
                .iter()
                .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
            high - low
        };
        let pulse = span(&exact);
        let top = self.flow.1.iter().copied().fold(0.0, f64::max);
        let n = exact.len();
        let time = &self.pressure_time_ms[..n];
        let cycle = self.record.cycle_ms();
        let mut pressure: Vec<f64> = exact
            .iter()
            .zip(noise(time, PRESSURE_NOISE * pulse, random))
            .map(|(p, e)| p + e)
            .collect();
        let mut flow: Vec<f64> = self
            .flow
            .1
            .iter()
            .zip(noise(&self.flow.0, FLOW_NOISE * top, random))
            .map(|(q, e)| q + e)
            .collect();
        match outside {
            Some(Outside::Rattle) => pressure.iter_mut().zip(time).for_each(|(p, t)| {
                let since = (t - 0.4 * cycle).rem_euclid(cycle);
                *p += 0.25 * pulse * (-since / 60.0).exp() * (since * 0.157).sin();
            }),
            Some(Outside::Saturation) => {
                flow.iter_mut()
                    .for_each(|q| *q = 0.5 * top * (*q / (0.5 * top)).tanh());
            }
            Some(Outside::Drift) => pressure.iter_mut().enumerate().for_each(|(i, p)| {
                *p += 0.3 * pulse * (4.0 * i as f64 / n as f64).sin();
            }),
            None => {}
        }
        Record::new(&self.flow.0, &flow, time, &pressure).expect("a simulated record")
    }
}

fn names(record: &Record) -> Vec<&'static str> {
    let found = discover(record, &DiscoverySettings::default()).expect("a simulated record");
    found.accepted.iter().map(|f| f.effect.name).collect()
}

fn class(name: &str) -> &str {
    match name {
        "wave_reflection" | "tube_reflection" | "parallel_inertance" => "reflection and inertance",
        "series_inertance" | "timing_misalignment" | "catheter_response" => "timing",
        "pressure_dependent_compliance" | "outflow_pressure" | "viscoelastic_wall" => "run-off",
        other => other,
    }
}

fn main() {
    let mut random = Pcg64::seed_from_u64(5);
    let mut false_alarms = Vec::new();
    for i in 0..N_NULL {
        let scene = scene(i, &mut random);
        let exact = simulate(&scene.record, scene.three, scene.start, &[]);
        let named = names(&scene.measured(exact, None, &mut random));
        false_alarms.extend(named.first().copied());
    }
    println!(
        "nothing missing: {} of {N_NULL} named {false_alarms:?}",
        false_alarms.len()
    );
    println!(
        "{:32}{:>8}{:>8}{:>8}{:>8}",
        "effect", "", "right", "class", "named"
    );
    for (name, weak, clear) in STRENGTHS {
        let effect = EFFECTS
            .iter()
            .find(|e| e.name == name)
            .expect("a candidate");
        for (level, strength) in [("weak", weak), ("clear", clear)] {
            let (mut right, mut alike, mut named) = (0, 0, 0);
            for i in 0..3 * N_EACH {
                let scene = scene(i, &mut random);
                let exact = simulate(
                    &scene.record,
                    scene.three,
                    scene.start,
                    &[(effect, strength)],
                );
                if let Some(first) = names(&scene.measured(exact, None, &mut random)).first() {
                    named += 1;
                    right += usize::from(*first == name);
                    alike += usize::from(class(first) == class(name));
                }
            }
            println!(
                "{name:32}{level:>8}{right:>8}{alike:>8}{named:>8}  of {}",
                3 * N_EACH
            );
        }
    }
    for outside in [Outside::Rattle, Outside::Saturation, Outside::Drift] {
        let mut named = Vec::new();
        for i in 0..3 * N_EACH {
            let scene = scene(i, &mut random);
            let exact = simulate(&scene.record, scene.three, scene.start, &[]);
            named.extend(
                names(&scene.measured(exact, Some(outside), &mut random))
                    .first()
                    .copied(),
            );
        }
        println!(
            "outside, {outside:?}: {} of {} named {named:?}",
            named.len(),
            3 * N_EACH
        );
    }
}
