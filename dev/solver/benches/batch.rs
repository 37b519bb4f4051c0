//! Time per evaluation, periodic state included, amortised over a batch on one core.

#[path = "../../../solver/cell-engine/tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Duration;

use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellStatus, CostBound, EngineSettings, NegativeKwu,
    Objective, SimdPath, Workspace,
};
use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use common::{sensitivity_cells, step_2_cells, thread_seconds};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const CELLS: usize = 1024;

fn engine(path: SimdPath) -> CellEngine {
    CellEngine::new(EngineSettings {
        path: Some(path),
        negative_kwu: NegativeKwu::Keep,
        ..EngineSettings::default()
    })
    .unwrap()
}

fn batch(c: &mut Criterion) {
    let boxes: [(&str, Vec<CellInput>); 2] = [
        ("step-2", step_2_cells(CELLS, 1)),
        ("sensitivity", sensitivity_cells(CELLS, 1)),
    ];
    for (name, cells) in &boxes {
        let mut group = c.benchmark_group(format!("{CELLS} cells, {name} box"));
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(300))
            .measurement_time(Duration::from_secs(2));
        group.throughput(Throughput::Elements(CELLS as u64));
        for path in [SimdPath::Avx512, SimdPath::Avx2, SimdPath::Portable] {
            if !path.is_available() {
                continue;
            }
            let (engine, mut workspace) = (engine(path), Workspace::new());
            let mut outputs = vec![CellOutput::default(); CELLS];
            group.bench_function(format!("{path:?}"), |b| {
                b.iter(|| {
                    engine
                        .evaluate(black_box(cells), &mut workspace, black_box(&mut outputs))
                        .unwrap()
                });
            });
            let n = CELLS as f64;
            let steps = outputs
                .iter()
                .map(|o| f64::from(o.steps + o.steps_refused))
                .sum::<f64>()
                / n;
            let beats = outputs.iter().map(|o| f64::from(o.beats)).sum::<f64>() / n;
            let done = outputs.iter().filter(|o| o.is_periodic()).count();
            println!(
                "    {path:?}: {steps:.1} steps tried and {beats:.2} full beats a cell, {done} of {CELLS} periodic"
            );
        }
        // An optimiser late in its search: few trials are better than what it has.
        let objective = Objective::new(CellBiomarkers {
            sa_max_kpa: 48.8,
            dsadt_max_kpa_per_ms: 0.75,
            std30_ms: 250.0,
            std50_ms: 300.0,
            std90_ms: 420.0,
            lambda_min: 0.86,
        });
        let bounds = vec![0.5; CELLS];
        let (engine, mut workspace) = (engine(SimdPath::best()), Workspace::new());
        let mut outputs = vec![CellOutput::default(); CELLS];
        let bound = CostBound {
            objective: &objective,
            bounds: &bounds,
            margin: 1.5,
        };
        group.bench_function("best, bounded", |b| {
            b.iter(|| {
                engine
                    .evaluate_bounded(black_box(cells), &bound, &mut workspace, &mut outputs)
                    .unwrap()
            });
        });
        let given_up = outputs
            .iter()
            .filter(|o| o.status == CellStatus::Hopeless)
            .count();
        println!("    bounded: {given_up} of {CELLS} given up");
        group.finish();
        let mut times: Vec<f64> = (0..31)
            .map(|_| {
                let start = thread_seconds();
                engine
                    .evaluate(cells, &mut workspace, &mut outputs)
                    .unwrap();
                (thread_seconds() - start) * 1e6 / CELLS as f64
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!(
            "    best path, processor time of 31 runs: median {:.1}, smallest {:.1} µs a cell",
            times[15], times[0]
        );
    }
}

criterion_group!(benches, batch);
criterion_main!(benches);
