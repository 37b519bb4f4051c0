//! Comparison of the single cell with Myokit (`reference/luo_rudy1991.py`, data in `tests/data`).

use cardiotwin_electrophysiology::luo_rudy1991::paced::{Stimulus, paced, rest};
use cardiotwin_electrophysiology::{Cells, Membrane, Parameters};

const STIMULUS: Stimulus = Stimulus {
    current_ua_cm2: 25.5,
    start_ms: 10.0,
    length_ms: 2.0,
};

/// Columns t \[ms\], V \[mV\], Ca \[mM\].
pub fn reference(name: &str) -> Vec<[f64; 3]> {
    let file = format!(
        "{}/../../solver/electrophysiology/tests/data/luo-rudy-1991-{name}.csv",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(&file).unwrap();
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    rows.map(|line| {
        let numbers: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    })
    .collect()
}

/// The last of `n_beats` from rest, with t, V, Ca at each step.
pub fn simulated(cycle_ms: f64, n_beats: usize, step_ms: f64) -> Vec<[f64; 3]> {
    let parameters = Parameters::default();
    let membrane = Membrane::new(parameters.clone(), step_ms);
    let begin = paced(
        &membrane,
        &rest(&parameters),
        &STIMULUS,
        cycle_ms,
        n_beats - 1,
    );
    let mut cell = Cells::new(1, &begin);
    let mut rows = vec![[0.0, cell.v_mv[0], cell.ca_mm[0]]];
    for step in 0..(cycle_ms / step_ms).round() as usize {
        let t = step as f64 * step_ms;
        cell.v_mv[0] += STIMULUS.charge(t, step_ms);
        cell.step(&membrane);
        rows.push([t + step_ms, cell.v_mv[0], cell.ca_mm[0]]);
    }
    rows
}

pub fn at(rows: &[[f64; 3]], t: f64, column: usize) -> f64 {
    let i = rows
        .partition_point(|row| row[0] < t - 1e-9)
        .min(rows.len() - 1);
    if (rows[i][0] - t).abs() < 1e-9 || i == 0 {
        return rows[i][column];
    }
    let (a, b) = (&rows[i - 1], &rows[i]);
    a[column] + (t - a[0]) / (b[0] - a[0]) * (b[column] - a[column])
}

/// Time at which the potential first rises through a level.
fn rises(rows: &[[f64; 3]], level: f64) -> f64 {
    let i = rows
        .windows(2)
        .position(|w| w[0][1] < level && w[1][1] >= level)
        .unwrap();
    let (a, b) = (&rows[i], &rows[i + 1]);
    a[0] + (level - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
}

fn falls(rows: &[[f64; 3]], level: f64) -> f64 {
    let i = rows
        .windows(2)
        .rposition(|w| w[0][1] > level && w[1][1] <= level)
        .unwrap();
    let (a, b) = (&rows[i], &rows[i + 1]);
    a[0] + (level - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
}

/// Duration from the upstroke to 90 % repolarisation.
fn apd90(rows: &[[f64; 3]]) -> f64 {
    let peak = rows.iter().map(|row| row[1]).fold(f64::MIN, f64::max);
    let resting = rows[0][1];
    falls(rows, peak - 0.9 * (peak - resting)) - rises(rows, -40.0)
}

/// Differences between the cell and the reference.
#[derive(Debug, Clone, Copy)]
pub struct Difference {
    /// Largest difference of the potential until 1 ms before the upstroke and from 2 ms after it
    /// \[mV\].
    pub away_mv: f64,
    /// Largest difference of the potential from 1 to 2 ms after the upstroke, where the action
    /// potential peaks \[mV\].
    pub peak_mv: f64,
    /// Difference of the upstroke's time \[ms\].
    pub upstroke_ms: f64,
    /// Duration at 90 % repolarisation in the reference \[ms\].
    pub apd90_ms: f64,
    /// Difference of this duration \[ms\].
    pub apd90_off_ms: f64,
    /// Difference of the potential before the stimulus \[mV\].
    pub rest_mv: f64,
    /// Largest difference of intracellular calcium, relative to the reference's maximum.
    pub calcium: f64,
}

/// Compares the last of `n_beats` with the reference.
pub fn compare(name: &str, cycle_ms: f64, n_beats: usize, step_ms: f64) -> Difference {
    let (expected, found) = (reference(name), simulated(cycle_ms, n_beats, step_ms));
    assert!(expected.len() > 600, "{name}: {} rows", expected.len());
    let upstroke = rises(&expected, -40.0);
    let largest = |column: usize, within: &dyn Fn(f64) -> bool| {
        let rows = expected.iter().filter(|row| within(row[0] - upstroke));
        rows.map(|row| (at(&found, row[0], column) - row[column]).abs())
            .fold(0.0, f64::max)
    };
    Difference {
        away_mv: largest(1, &|t| !(-1.0..2.0).contains(&t)),
        peak_mv: largest(1, &|t| (1.0..2.0).contains(&t)),
        upstroke_ms: rises(&found, -40.0) - upstroke,
        apd90_ms: apd90(&expected),
        apd90_off_ms: apd90(&found) - apd90(&expected),
        rest_mv: found[0][1] - expected[0][1],
        calcium: largest(2, &|_| true) / expected.iter().map(|row| row[2]).fold(0.0, f64::max),
    }
}
