//! Tests of the organ's law.

use super::super::law_wall::halves;
use super::*;
use crate::beat::{BeatOutcome, BeatResult, BeatSettings, run_beats};
use crate::cell0d::{CellParameters, CellSolverSettings};
use crate::circulation::{LeftHeart, StartPressure};
use crate::contraction::{Tanh, TanhParameters};
use crate::ventricle::{
    ActivationSpread, GroupContraction, OneFibreParameters, OneFibreVentricle, PassiveLaw as _,
    Ventricle as _,
};
use cardiotwin_units::{Ml, Mmhg, Ms};
use cardiotwin_vocabulary::circulation::WindkesselParameters;
use proptest::prelude::*;
use std::sync::Arc;

const CYCLE: Ms = Ms(800.0);

fn passive() -> OneFibrePassive {
    OneFibrePassive::through(Ml(70.0), Ml(130.0), Mmhg(9.0), Ml(100.0), 9.24).unwrap()
}

fn law() -> OrganLaw {
    OrganLaw {
        pressure: [-0.5, -6.0, 1.22, 0.46, -0.08, -0.1, -0.5, 0.2],
        stretch: [-0.02, -0.005, -0.19, -0.01, 0.08, 0.27],
        deviation: [0.04, -0.02, 0.26, -0.03, 0.04, 0.6],
        compliance: 0.05,
        duration_share: 0.9,
    }
}

fn heart() -> LeftHeart {
    LeftHeart {
        left_atrial_pressure: Mmhg(7.0),
        mitral_forward: LeftHeart::FORWARD,
        mitral_backward: LeftHeart::BACKWARD,
        aortic_forward: LeftHeart::FORWARD,
        aortic_backward: LeftHeart::BACKWARD,
        windkessel: WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: 0.055,
            peripheral_resistance_mmhg_s_per_ml: 0.85,
            compliance_ml_per_mmhg: 1.5,
        },
        start: StartPressure::DiastolicCuff(Mmhg(70.0)),
        cycle_length: CYCLE,
    }
}

fn tanh() -> GroupContraction {
    let parameters = TanhParameters {
        smax_ref_kpa: 121.0,
        tau_sr_ref_ms: 3.0,
        tau_sd_ms: 22.0,
        t_cr_ms: 316.0,
        ..Default::default()
    };
    GroupContraction::tanh(Tanh::new(parameters).unwrap())
}

fn land() -> GroupContraction {
    let mut cell = CellParameters {
        cycle_length_ms: CYCLE.0,
        ..CellParameters::default()
    };
    cell.land.ca50_ref_um = 0.5;
    cell.land.n_trpn = 3.0;
    let cell = cell.build().unwrap();
    let beat = cell.solve_periodic(&CellSolverSettings::default()).unwrap();
    GroupContraction::land(&cell, &beat)
}

fn ventricle(contraction: GroupContraction, law: Option<OrganLaw>) -> OneFibreVentricle {
    OneFibreVentricle::new(OneFibreParameters {
        passive: passive(),
        activation: ActivationSpread::default(),
        contraction,
        cycle_length: CYCLE,
        pressure_terms: Vec::new(),
        law: law.map(Arc::new),
    })
    .unwrap()
}

fn beat(contraction: GroupContraction, law: Option<OrganLaw>) -> BeatResult {
    let settings = BeatSettings {
        record_nodes: true,
        ..BeatSettings::one_beat(CYCLE)
    };
    let outcome = run_beats(
        &mut ventricle(contraction, law),
        &mut heart().build().unwrap(),
        &settings,
    );
    match outcome {
        BeatOutcome::Finished(result) => *result,
        BeatOutcome::Diverged { t, reason, .. } => panic!("diverged at {t}: {reason}"),
    }
}

#[test]
fn a_beat_without_coefficients_is_one_of_the_one_fibre_ventricle() {
    for contraction in [tanh, land] {
        let (plain, with_law) = (
            beat(contraction(), None),
            beat(contraction(), Some(OrganLaw::default())),
        );
        let (a, b) = (&plain.traces, &with_law.traces);
        let largest = |a: &[f64], b: &[f64]| {
            a.iter()
                .zip(b)
                .fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
        };
        let apart = [
            largest(&a.pressure_mmhg, &b.pressure_mmhg),
            largest(&a.volume_ml, &b.volume_ml),
        ];
        assert!(apart[0] < 5e-3 && apart[1] < 5e-3, "{apart:?}");
    }
}

#[test]
fn every_sample_of_a_beat_lies_on_the_law() {
    for contraction in [tanh(), land()] {
        let result = beat(contraction, Some(law()));
        assert!(result.succeeded(), "{:?}", result.checks);
        let traces = &result.traces;
        let nodes = traces.nodes.as_ref().unwrap();
        let n = nodes.n_nodes;
        for (k, volume) in traces.volume_ml.iter().enumerate() {
            let of_sample = k * n..(k + 1) * n;
            let stress: f64 = (nodes.sa_kpa[of_sample.clone()].iter())
                .zip(&nodes.weights)
                .map(|(sa, w)| sa * w)
                .sum();
            let mean_of = |values: &[f64]| {
                values
                    .iter()
                    .zip(&nodes.weights)
                    .map(|(x, w)| x * w)
                    .sum::<f64>()
            };
            let halves = halves(&nodes.activation_ms, &nodes.weights);
            let products: Vec<f64> = nodes.sa_kpa[of_sample.clone()]
                .iter()
                .zip(&halves)
                .map(|(sa, half)| sa * half)
                .collect();
            let difference = law().stretch_per_difference(stress) * mean_of(&products);
            let lambda = (law().stretch(&passive(), *volume, stress).value + difference)
                / law().end_diastolic_stretch(&passive());
            let mean: f64 = (nodes.lambda[of_sample].iter())
                .zip(&nodes.weights)
                .map(|(lambda, w)| lambda * w)
                .sum();
            assert!((mean - lambda).abs() < 5e-5, "sample {k}: {mean} {lambda}");
            let pressure = law().pressure(&passive(), *volume, stress).value;
            let found = traces.pressure_mmhg[k];
            assert!(
                (found - pressure).abs() < 0.1,
                "sample {k}: {found} {pressure}"
            );
        }
        let per_step = result.work.n_iterations as f64 / result.work.n_steps as f64;
        assert!(per_step < 1.6, "{per_step} evaluations a step");
    }
}

#[test]
fn a_snapshot_restores_the_wall_bit_for_bit() {
    let mut first = ventricle(land(), Some(law()));
    let mut circulation = heart().build().unwrap();
    let step = |ventricle: &mut OneFibreVentricle,
                circulation: &mut crate::circulation::Circulation| {
        ventricle.try_step(circulation, Ms(1.0)).unwrap();
        ventricle.commit();
        circulation.commit();
    };
    (0..60).for_each(|_| step(&mut first, &mut circulation));
    let (kept, blood) = (first.snapshot(), circulation.snapshot());
    let mut second = ventricle(land(), Some(law()));
    second.restore(&kept).unwrap();
    let mut other = heart().build().unwrap();
    other.restore(&blood).unwrap();
    (0..40).for_each(|_| {
        step(&mut first, &mut circulation);
        step(&mut second, &mut other);
    });
    assert_eq!(first.snapshot(), second.snapshot());
    assert!(ventricle(land(), None).restore(&kept).is_err());
}

#[test]
fn without_coefficients_the_law_is_the_one_fibre_ventricle() {
    let (passive, law) = (passive(), OrganLaw::default());
    for (volume, stress) in [(130.0, 0.0), (100.0, 40.0), (60.0, 90.0)] {
        let factor = MMHG_PER_KPA * pressure_per_stress(volume, 100.0).0;
        let expected = passive.pressure(Ml(volume)).0 + factor * stress;
        assert!((law.pressure(&passive, volume, stress).value - expected).abs() < 1e-10);
        let lambda = law.stretch(&passive, volume, stress);
        let expected = unloaded_stretch(&passive, volume).0;
        assert!((lambda.value - expected).abs() < 1e-14);
        assert_eq!(lambda.per_kpa, 0.0);
    }
}

#[test]
fn a_relaxed_wall_has_its_reference_points_with_any_coefficients() {
    let (passive, law) = (passive(), law());
    assert!(law.pressure(&passive, 70.0, 0.0).value.abs() < 1e-12);
    assert!((law.stretch(&passive, 70.0, 0.0).value - 1.0).abs() < 1e-12);
    assert!((law.pressure(&passive, 130.0, 0.0).value - 9.0).abs() < 1e-10);
}

#[test]
fn rows_of_the_regression_are_the_law() {
    let (passive, law) = (passive(), law());
    let sum = |row: &[f64], c: &[f64]| row.iter().zip(c).map(|(a, b)| a * b).sum::<f64>();
    for (volume, stress) in [(130.0, 2.0), (95.0, 60.0), (65.0, 110.0)] {
        let (own, row) = OrganLaw::pressure_row(&passive, volume, stress);
        let expected = law.pressure(&passive, volume, stress).value;
        assert!((own + sum(&row, &law.pressure) - expected).abs() < 1e-10);
        let (own, row) = OrganLaw::stretch_row(&passive, volume, stress, 0.0);
        let expected = law.stretch(&passive, volume, stress).value;
        assert!((own + sum(&row, &law.stretch) - expected).abs() < 1e-12);
    }
}

#[test]
fn far_outside_of_its_domain_the_law_stays_bounded() {
    let (passive, law) = (passive(), law());
    let per_stress = |volume: f64, stress: f64| {
        let factor = MMHG_PER_KPA * pressure_per_stress(volume, 100.0).0;
        (law.pressure(&passive, volume, stress).value - law.pressure(&passive, volume, 0.0).value)
            / (stress * factor)
    };
    for (volume, stress) in [(5.0, 50.0), (400.0, 50.0), (100.0, 2000.0), (5.0, 2000.0)] {
        let factor = per_stress(volume, stress);
        assert!(
            (0.2..3.0).contains(&factor),
            "{volume} mL, {stress} kPa: {factor}"
        );
        let lambda = law.stretch(&passive, volume, stress);
        assert!(lambda.value.is_finite() && (0.3..2.5).contains(&lambda.value));
    }
}

#[test]
fn a_law_in_which_stiff_cells_find_no_stress_is_recognised() {
    assert!(law().is_settled(&passive()));
    let mut lengthening = law();
    lengthening.stretch[2] = -0.1;
    assert!(!lengthening.is_settled(&passive()));
}

#[test]
fn a_law_whose_pressure_falls_with_stress_is_recognised() {
    assert!(law().is_monotone(&passive()));
    let mut falling = law();
    falling.pressure[5] = -0.5;
    assert!(!falling.is_monotone(&passive()));
    let mut soft = law();
    soft.pressure[0] = -10.0;
    assert!(!soft.is_monotone(&passive()));
}

proptest! {
    #[test]
    fn derivatives_are_derivatives(volume in 20.0..300.0f64, stress in -20.0..300.0f64) {
        let (passive, law) = (passive(), law());
        let h = 1e-4;
        // Second derivatives jump at the domain's edges, which a central difference sees.
        let check = |f: &dyn Fn(f64, f64) -> LawValue| {
            let found = f(volume, stress);
            let per_ml = (f(volume + h, stress).value - f(volume - h, stress).value) / (2.0 * h);
            let per_kpa = (f(volume, stress + h).value - f(volume, stress - h).value) / (2.0 * h);
            prop_assert!((per_ml - found.per_ml).abs() < 1e-5 * (1e-2 + per_ml.abs()));
            prop_assert!((per_kpa - found.per_kpa).abs() < 1e-5 * (1e-2 + per_kpa.abs()));
            Ok(())
        };
        check(&|v, t| law.pressure(&passive, v, t))?;
        check(&|v, t| law.stretch(&passive, v, t))?;
    }
}
