//! The reference beats and random cells, for every test and benchmark of the crate.
#![allow(dead_code)]

use cardiotwin_cell_engine::{CellInput, DEFAULT_PARAMETERS, N_PARAMETERS};
use serde_json::Value;

/// One beat of the reference.
pub struct Reference {
    pub name: String,
    pub input: CellInput,
    pub sa_kpa: Vec<f64>,
    pub lambda: Vec<f64>,
    pub entry: Value,
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect()
}

/// Beats that a reference implementation computed, from `tests/data/cell0d.json`.
pub fn file() -> Value {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../solver/cell-engine/tests/data/cell0d.json"
    );
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// All beats of the reference.
pub fn references() -> Vec<Reference> {
    let file = file();
    let sets = file["sets"].as_array().unwrap();
    sets.iter()
        .map(|set| Reference {
            name: set["name"].as_str().unwrap().to_owned(),
            input: CellInput::new(
                numbers(&set["parameters"]).try_into().unwrap(),
                set["cycle_length_ms"].as_f64().unwrap(),
                set["lambda_0"].as_f64().unwrap(),
            ),
            sa_kpa: numbers(&set["Sa_kPa"]),
            lambda: numbers(&set["lambda"]),
            entry: set.clone(),
        })
        .collect()
}

/// Lower bounds of Table A5 of Jung et al. 2022.
pub const LOW: [f64; N_PARAMETERS] = [
    0.05, 1.0, 0.5, 0.01, 3.0, 0.3, 0.026, 0.004, 0.25, 0.1, 0.005, 0.05, 0.1, 12.5, 1.15, -3.6,
    90.0, 0.075, 0.3, 64.5, 64.0, 1.0,
];
/// Upper bounds of the same table.
pub const HIGH: [f64; N_PARAMETERS] = [
    0.4, 5.0, 2.0, 2.0, 7.0, 0.5, 0.312, 0.048, 0.75, 0.25, 0.02, 3.0, 4.0, 37.5, 4.6, -1.2, 140.0,
    0.225, 0.9, 192.5, 192.0, 100.0,
];
/// Step 2's ten parameters.
pub const STEP_2: [usize; 10] = [1, 15, 4, 2, 6, 17, 18, 19, 20, 21];

/// SplitMix64: the same cells on every machine.
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// `n` cells of step 2's box: ten parameters, λ₀ = 1, cycle 700 ms.
pub fn step_2_cells(n: usize, seed: u64) -> Vec<CellInput> {
    let mut random = Random(seed);
    let mut cell = || {
        let mut p = DEFAULT_PARAMETERS;
        for i in STEP_2 {
            p[i] = LOW[i] + (HIGH[i] - LOW[i]) * random.uniform();
        }
        CellInput::new(p, 700.0, 1.0)
    };
    (0..n).map(|_| cell()).collect()
}

/// `n` cells of the sensitivity analysis: 21 parameters, λ₀ = 1.1, cycle 1000 ms, a_p = 42 kPa.
pub fn sensitivity_cells(n: usize, seed: u64) -> Vec<CellInput> {
    let mut random = Random(seed);
    let mut cell = || {
        let mut p = DEFAULT_PARAMETERS;
        for i in 0..21 {
            p[i] = LOW[i] + (HIGH[i] - LOW[i]) * random.uniform();
        }
        p[21] = 42.0;
        CellInput::new(p, 1000.0, 1.1)
    };
    (0..n).map(|_| cell()).collect()
}

/// Processor seconds of this thread, which other work on the machine does not count into; the clock's where unknown.
pub fn thread_seconds() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(
        || {
            START
                .get_or_init(std::time::Instant::now)
                .elapsed()
                .as_secs_f64()
        },
        |nanoseconds| nanoseconds * 1e-9,
    )
}
