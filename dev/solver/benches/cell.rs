//! One periodic 0D cell evaluation at the default settings (1 ms output, reference tolerance), one core.

use cardiotwin_models::cell0d::{CellBeat, CellParameters, CellSolverSettings};
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;

fn cell(c: &mut Criterion) {
    let default = CellParameters::default().build().unwrap();
    let mut fast = CellParameters {
        cycle_length_ms: 659.0,
        ..CellParameters::default()
    };
    fast.passive.a_p_kpa = 60.0;
    fast.land.ca50_ref_um = 0.5;
    let fast = fast.build().unwrap();
    let settings = CellSolverSettings::default();
    let mut beat = CellBeat::default();
    for (name, cell) in [("defaults_1000ms", default), ("patient_like_659ms", fast)] {
        c.bench_function(&format!("cell0d/periodic/{name}"), |b| {
            b.iter(|| {
                black_box(&cell)
                    .solve_periodic_into(&settings, &mut beat)
                    .unwrap();
                black_box(beat.beats_to_periodic)
            });
        });
    }
}

criterion_group!(benches, cell);
criterion_main!(benches);
