//! Time of the paper's sensitivity analysis on one thread: 45,056 rows and six outputs, with and
//! without failed rows.
//!
//! `cargo run --release --manifest-path dev/Cargo.toml --example sobol-analysis-time`

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::sobol::{
    AnalysisSettings, DesignSettings, Ranking, SaltelliDesign, analyse,
};
use std::time::Instant;

fn main() {
    let start = Instant::now();
    let design =
        SaltelliDesign::new(&[Interval::new(-1.0, 2.0); 21], DesignSettings::default()).unwrap();
    let rows = design.rows(0..design.n_blocks());
    println!(
        "{} rows: {:.1} ms",
        rows.len(),
        1e3 * start.elapsed().as_secs_f64()
    );
    let output = |x: &[f64], o: usize| -> f64 {
        x.iter()
            .enumerate()
            .map(|(i, v)| v / (1 + i) as f64 + 0.3 * v * x[(i + 1 + o) % 21])
            .sum()
    };
    let values: Vec<f64> = rows
        .iter()
        .flat_map(|x| (0..6).map(|o| output(x, o)))
        .collect();
    for share_of_failures in [0.0, 0.001, 0.05] {
        let mut values = values.clone();
        for (idx, row) in values.chunks_mut(6).enumerate() {
            if (idx as f64 * 0.618_033_988_75).fract() < share_of_failures {
                row.fill(f64::NAN);
            }
        }
        for n_resamples in [0, 100, 1000] {
            let settings = AnalysisSettings {
                n_resamples,
                ..AnalysisSettings::default()
            };
            let start = Instant::now();
            let analysis = analyse(21, 6, &values, settings).unwrap();
            let ranking = Ranking::of(&analysis);
            println!(
                "{share_of_failures} failed, {n_resamples} resamples: {:.0} ms; first {:?}",
                1e3 * start.elapsed().as_secs_f64(),
                ranking.select(3)
            );
        }
    }
}
