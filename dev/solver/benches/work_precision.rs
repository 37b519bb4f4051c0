//! Work and precision: processor time per evaluation against the error of the beat, at several tolerances, on one core.
//! The reference of each cell is its own beat at tolerance 1e-9 (that one is within 4e-6 kPa of SciPy's on the stored sets).
//! With `--csv` the stored sets alone, against the stored beats, for `reference/work_precision.py`.

#[path = "../../../solver/cell-engine/tests/common/mod.rs"]
mod common;

use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellTrace, EngineSettings, NegativeKwu, SimdPath, Workspace,
};
use common::{references, sensitivity_cells, step_2_cells, thread_seconds};

fn engine(tolerance: f64) -> CellEngine {
    let settings = EngineSettings {
        tolerance,
        negative_kwu: NegativeKwu::Keep,
        ..EngineSettings::default()
    };
    CellEngine::new(settings).unwrap()
}

fn beats(cells: &[CellInput], tolerance: f64) -> (Vec<CellOutput>, Vec<CellTrace>) {
    let mut outputs = vec![CellOutput::default(); cells.len()];
    let mut traces = vec![CellTrace::default(); cells.len()];
    engine(tolerance)
        .evaluate_with_traces(cells, &mut Workspace::new(), &mut outputs, &mut traces)
        .unwrap();
    (outputs, traces)
}

/// Processor time, median of seven.
fn microseconds(cells: &[CellInput], tolerance: f64) -> f64 {
    let (engine, mut workspace) = (engine(tolerance), Workspace::new());
    let mut outputs = vec![CellOutput::default(); cells.len()];
    // Enough work for the coarsest of clocks.
    let rounds = 4096_usize.div_ceil(cells.len());
    let mut time = || {
        let start = thread_seconds();
        for _ in 0..rounds {
            engine
                .evaluate(cells, &mut workspace, &mut outputs)
                .unwrap();
        }
        (thread_seconds() - start) * 1e6 / (rounds * cells.len()) as f64
    };
    let mut times: Vec<f64> = (0..7).map(|_| time()).collect();
    times.sort_by(f64::total_cmp);
    times[3]
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - y).abs())
        .fold(0.0, f64::max)
}

const TOLERANCES: [f64; 7] = [3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 1e-6];

/// Errors against the stored beats, a row for each tolerance.
fn csv() {
    let references = references();
    let cells: Vec<CellInput> = references.iter().map(|r| r.input).collect();
    println!(
        "solver,right_hand_side,tolerance,us_per_cell,steps_per_beat,beats,error_median_kPa,error_largest_kPa"
    );
    for tolerance in TOLERANCES {
        let (outputs, traces) = beats(&cells, tolerance);
        let mut sa: Vec<f64> = traces
            .iter()
            .zip(&references)
            .map(|(t, r)| largest(&t.sa_kpa, &r.sa_kpa))
            .collect();
        sa.sort_by(f64::total_cmp);
        let sum =
            |f: &dyn Fn(&CellOutput) -> u32| outputs.iter().map(|o| f64::from(f(o))).sum::<f64>();
        let (steps, n_beats) = (sum(&|o| o.steps + o.steps_refused), sum(&|o| o.beats));
        println!(
            "cell engine,compiled,{tolerance:.0e},{:.1},{:.0},{:.2},{:.1e},{:.1e}",
            microseconds(&cells, tolerance),
            steps / n_beats,
            n_beats / cells.len() as f64,
            sa[sa.len() / 2],
            sa[sa.len() - 1],
        );
    }
}

fn main() {
    if std::env::args().any(|argument| argument == "--csv") {
        return csv();
    }
    println!("instructions: {:?}", SimdPath::best());
    let stored: Vec<_> = references().iter().map(|r| r.input).collect();
    let boxes = [
        ("stored sets", stored),
        ("step-2 box", step_2_cells(512, 1)),
        ("sensitivity box", sensitivity_cells(512, 1)),
    ];
    println!(
        "| cells | tolerance | µs | steps tried | beats | Sa median | Sa 95 % | Sa 99 % | Sa largest | λ largest |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, cells) in &boxes {
        let (_, exact) = beats(cells, 1e-9);
        for tolerance in TOLERANCES {
            let (outputs, traces) = beats(cells, tolerance);
            let mut sa: Vec<f64> = traces
                .iter()
                .zip(&exact)
                .map(|(a, b)| largest(&a.sa_kpa, &b.sa_kpa))
                .collect();
            let lambda = traces
                .iter()
                .zip(&exact)
                .map(|(a, b)| largest(&a.lambda, &b.lambda))
                .fold(0.0, f64::max);
            sa.sort_by(f64::total_cmp);
            let n = cells.len() as f64;
            let share = |x: f64| sa[((x * n) as usize).min(sa.len() - 1)];
            let mean = |f: &dyn Fn(&CellOutput) -> u32| {
                outputs.iter().map(|o| f64::from(f(o))).sum::<f64>() / n
            };
            println!(
                "| {name} | {tolerance:.0e} | {:.1} | {:.0} | {:.2} | {:.1e} | {:.1e} | {:.1e} | {:.1e} | {lambda:.1e} |",
                microseconds(cells, tolerance),
                mean(&|o| o.steps + o.steps_refused),
                mean(&|o| o.beats),
                share(0.5),
                share(0.95),
                share(0.99),
                share(1.0),
            );
        }
    }
}
