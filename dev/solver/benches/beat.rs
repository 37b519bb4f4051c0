//! One beat of the reduced ventricle at 1 ms steps: Tanh and Land, with and without nodal traces.

use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_beats};
use cardiotwin_models::cell0d::{CellParameters, CellSolverSettings};
use cardiotwin_models::circulation::windkessel::WindkesselParameters;
use cardiotwin_models::circulation::{LeftHeart, StartPressure};
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::{
    ActivationSpread, GroupContraction, OneFibreParameters, OneFibrePassive, OneFibreVentricle,
    PassiveLaw as _, PassiveStateInput, PassiveStateMode,
};
use cardiotwin_units::{Ml, Mmhg, Ms};
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;

const CYCLE: Ms = Ms(659.0);

fn run(contraction: GroupContraction, record_nodes: bool) -> f64 {
    let (passive, _) = OneFibrePassive::fit(&PassiveStateInput {
        end_diastolic_volume: Ml(161.2),
        end_diastolic_pressure: Mmhg(7.0),
        diastasis: None,
        wall_volume: Ml(120.9),
        mode: PassiveStateMode::EndDiastole,
    })
    .unwrap();
    let heart = LeftHeart {
        left_atrial_pressure: Mmhg(6.43),
        mitral_forward: LeftHeart::FORWARD,
        mitral_backward: LeftHeart::BACKWARD,
        aortic_forward: LeftHeart::FORWARD,
        aortic_backward: LeftHeart::BACKWARD,
        windkessel: WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: 0.0523,
            peripheral_resistance_mmhg_s_per_ml: 0.4934,
            compliance_ml_per_mmhg: 2.0263,
        },
        start: StartPressure::DiastolicCuff(Mmhg(68.7)),
        cycle_length: CYCLE,
    };
    let parameters = OneFibreParameters {
        passive,
        activation: ActivationSpread::default(),
        contraction,
        cycle_length: CYCLE,
        pressure_terms: Vec::new(),
        law: None,
    };
    let mut ventricle = OneFibreVentricle::new(parameters).unwrap();
    let mut circulation = heart.build().unwrap();
    let settings = BeatSettings {
        record_nodes,
        ..BeatSettings::one_beat(CYCLE)
    };
    match run_beats(&mut ventricle, &mut circulation, &settings) {
        BeatOutcome::Finished(result) => result.traces.volume_ml[300],
        BeatOutcome::Diverged { reason, .. } => panic!("{reason}"),
    }
}

fn beat(c: &mut Criterion) {
    let tanh = TanhParameters {
        smax_ref_kpa: 121.0,
        tau_sr_ref_ms: 3.0,
        tau_sd_ms: 22.0,
        t_cr_ms: 316.0,
        ..Default::default()
    };
    for (name, nodes) in [("traces", false), ("nodal_traces", true)] {
        c.bench_function(&format!("one_fibre/tanh/{name}"), |b| {
            b.iter(|| {
                black_box(run(
                    GroupContraction::tanh(Tanh::new(black_box(tanh)).unwrap()),
                    nodes,
                ))
            });
        });
    }
    let mut cell = CellParameters {
        cycle_length_ms: CYCLE.0,
        ..CellParameters::default()
    };
    cell.land.ca50_ref_um = 0.5;
    let cell = cell.build().unwrap();
    let periodic = cell.solve_periodic(&CellSolverSettings::default()).unwrap();
    c.bench_function("one_fibre/land/nodal_traces", |b| {
        b.iter(|| black_box(run(GroupContraction::land(&cell, &periodic), true)));
    });
}

criterion_group!(benches, beat);
criterion_main!(benches);
