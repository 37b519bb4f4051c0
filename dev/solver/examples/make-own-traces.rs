//! Prints pressure and volume of a few beats on one clock, as a conductance catheter records them:
//! `make-own-traces [BEATS [SEED [HZ]]]`. `examples/own-traces/traces.csv` was made by
//! `make-own-traces 8 23 200`.

#[path = "../../../solver/recordings/tests/made/mod.rs"]
#[allow(dead_code)]
mod made;

use cardiotwin_validation::random::Random;
use made::{Wish, make, periodic, usual_time};

/// Noise of a sample of the volume \[mL\].
const VOLUME_NOISE_ML: f64 = 0.6;

fn main() {
    let arguments: Vec<f64> = std::env::args()
        .skip(1)
        .map(|text| text.parse().expect("a number"))
        .collect();
    let number = |k: usize, otherwise: f64| arguments.get(k).copied().unwrap_or(otherwise);
    let (n_beats, seed, hz) = (
        number(0, 8.0) as usize,
        number(1, 23.0) as u64,
        number(2, 200.0),
    );
    let wish = Wish {
        n_beats,
        step_ms: 1000.0 / hz,
        ectopic_every: 0,
        damage_every: 0,
        noise: (0.5, 8.0),
        ..Wish::usual(seed)
    };
    let (raw, truth) = make(&wish);
    let pressure = raw.recording.channels.lv_pressure_mmhg.expect("made");
    let mut random = Random::new(seed, 78);
    println!("time,LVP,LVV");
    for (k, p) in pressure.iter().enumerate() {
        let t = k as f64 * wish.step_ms;
        let i = truth.onsets_ms.partition_point(|onset| *onset <= t);
        let (onset, length) = match i {
            0 => (truth.onsets_ms[0] - truth.cycle_ms, truth.cycle_ms),
            _ => (
                truth.onsets_ms[i - 1],
                truth
                    .onsets_ms
                    .get(i)
                    .map_or(truth.cycle_ms, |next| next - truth.onsets_ms[i - 1]),
            ),
        };
        let at = usual_time(&truth, t - onset, length);
        let v = periodic(&truth.beat.volume, at) + VOLUME_NOISE_ML * random.normal();
        println!("{:.3},{p:.1},{v:.1}", 1e-3 * t);
    }
}
