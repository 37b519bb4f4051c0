//! Models must not panic, hang or return a number that is not finite within the admissible boxes. A
//! failure must be an error.

use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_beats};
use cardiotwin_models::calcium::Rice2008Parameters;
use cardiotwin_models::cell0d::{
    CalciumInput, CellError, CellParameters, CellSolverSettings, LandPassiveParameters,
};
use cardiotwin_models::circulation::windkessel::WindkesselParameters;
use cardiotwin_models::circulation::{LeftHeart, StartPressure};
use cardiotwin_models::contraction::{Land2017Parameters, Tanh, TanhParameters};
use cardiotwin_models::ventricle::{
    ActivationSpread, GroupContraction, OneFibreParameters, OneFibrePassive, OneFibreVentricle,
    PassiveLaw as _, PassiveStateInput, PassiveStateMode,
};
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};
use proptest::collection::vec;
use proptest::prelude::*;

/// A point of Table A5's box (Jung 2022) from numbers between 0 and 1, with a_p between 1 and 100
/// kPa.
fn cell(u: &[f64], lambda0: f64, cycle_length_ms: f64) -> CellParameters {
    let at = |i: usize, low: f64, high: f64| low + u[i] * (high - low);
    CellParameters {
        land: Land2017Parameters {
            k_trpn_per_ms: at(0, 0.05, 0.4),
            n_trpn: at(1, 1.0, 5.0),
            ca50_ref_um: at(2, 0.5, 2.0),
            k_u_per_ms: at(3, 0.01, 2.0),
            n_tm: at(4, 3.0, 7.0),
            trpn50: at(5, 0.3, 0.5),
            k_uw_per_ms: at(6, 0.026, 0.312),
            k_ws_per_ms: at(7, 0.004, 0.048),
            r_w: at(8, 0.25, 0.75),
            r_s: at(9, 0.1, 0.25),
            gamma_s_per_ms: at(10, 0.005, 0.02),
            gamma_w_per_ms: at(11, 0.05, 3.0),
            phi: at(12, 0.1, 4.0),
            a_eff: at(13, 12.5, 37.5),
            beta0: at(14, 1.15, 4.6),
            beta1_um: at(15, -3.6, -1.2),
            smax_ref_kpa: at(16, 90.0, 140.0),
            cap_unblocking: false,
            allow_negative_k_wu: true,
        },
        passive: LandPassiveParameters {
            a_p_kpa: at(21, 1.0, 100.0),
            ..Default::default()
        },
        calcium: CalciumInput::Rice(Rice2008Parameters {
            ca_res_um: at(17, 0.075, 0.225),
            ca_max_um: at(18, 0.3, 0.9),
            tau_cr_ms: at(19, 64.5, 192.5),
            tau_cd_ms: at(20, 64.0, 192.0),
        }),
        cycle_length_ms,
        lambda0,
    }
}

/// With the setting of the sensitivity analysis (a_p 42 kPa, λ0 1.1, 1000 ms), at most two of 2000
/// quasi-random points of the box have no periodic state, and the others need few beats.
#[test]
fn cells_of_the_sensitivity_analysis_are_periodic() {
    let (mut n_failed, mut n_beats) = (0, 0);
    for draw in 1..=2000u32 {
        // Kronecker sequence with square roots of primes.
        let primes = [
            2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79,
        ];
        let u: Vec<f64> = primes
            .map(|p: u32| (f64::from(p).sqrt() * f64::from(draw)).fract())
            .to_vec();
        let mut parameters = cell(&u, 1.1, 1000.0);
        parameters.passive.a_p_kpa = 42.0;
        match parameters
            .build()
            .unwrap()
            .solve_periodic(&CellSolverSettings::default())
        {
            Ok(beat) => n_beats += beat.beats_to_periodic,
            Err(CellError::NotPeriodic { .. }) => n_failed += 1,
            Err(error) => panic!("{error}: {parameters:?}"),
        }
    }
    assert!(n_failed <= 2, "{n_failed}");
    assert!(n_beats < 2 * 2000 + 200, "{n_beats}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    /// A soft or slow cell can oscillate by itself, out of step with the beat (about 1 draw in
    /// 10,000). It then has no periodic state, and the error says so. No other failure is allowed.
    #[test]
    fn every_cell_in_the_box_is_solved(
        u in vec(0.0..=1.0f64, 22), long in any::<bool>(), cycle_length_ms in 400.0..1300.0f64
    ) {
        let parameters = cell(&u, if long { 1.1 } else { 1.0 }, cycle_length_ms);
        let beat = match parameters.build().unwrap().solve_periodic(&CellSolverSettings::default()) {
            Err(CellError::NotPeriodic { beats: 60, change }) => {
                prop_assert!(change.is_finite());
                return Ok(());
            }
            result => result.unwrap(),
        };
        prop_assert!(beat.sa_kpa.iter().chain(&beat.lambda).all(|x| x.is_finite()));
        prop_assert!(beat.remaining_change <= 1e-6 && beat.n_steps < 2000);
        prop_assert_eq!(beat.sa_kpa.len(), beat.time_ms.len());
        prop_assert_eq!(*beat.time_ms.last().unwrap(), cycle_length_ms);
        prop_assert!((beat.sa_kpa[0] - beat.sa_kpa.last().unwrap()).abs() < 2e-3);
        // An active cell is never longer than at rest, up to the default tolerance's error of stretch.
        prop_assert!(beat.lambda.iter().all(|l| *l <= parameters.lambda0 * (1.0 + 2e-5) && *l > 0.5));
        prop_assert!(beat.read().is_some());
    }

    /// A beat of the reduced ventricle ends or diverges for any parameters of step 1 within
    /// generous bounds.
    #[test]
    fn every_beat_ends(
        smax in 20.0..600.0f64, tau_sr in 0.3..150.0f64, tau_sd in 3.0..300.0f64, t_cr in 80.0..700.0f64,
        log_r_av in -5.0..-1.0f64, log_r_mv in -4.0..-0.5f64, edv in 40.0..300.0f64, edp in 2.0..25.0f64
    ) {
        let tanh = TanhParameters {
            smax_ref_kpa: smax, tau_sr_ref_ms: tau_sr, tau_sd_ms: tau_sd, t_cr_ms: t_cr, ..Default::default()
        };
        let cycle_length = Ms(750.0);
        let (passive, _) = OneFibrePassive::fit(&PassiveStateInput {
            end_diastolic_volume: Ml(edv),
            end_diastolic_pressure: Mmhg(edp),
            diastasis: None,
            wall_volume: Ml(0.75 * edv),
            mode: PassiveStateMode::EndDiastole,
        })
        .unwrap();
        let heart = LeftHeart {
            left_atrial_pressure: Mmhg(0.8 * edp),
            mitral_forward: MmhgSPerMl(10f64.powf(log_r_mv)),
            mitral_backward: LeftHeart::BACKWARD,
            aortic_forward: MmhgSPerMl(10f64.powf(log_r_av)),
            aortic_backward: LeftHeart::BACKWARD,
            windkessel: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.05,
                peripheral_resistance_mmhg_s_per_ml: 100.0 / edv,
                compliance_ml_per_mmhg: edv / 90.0,
            },
            start: StartPressure::StrokeVolume(Ml(0.6 * edv)),
            cycle_length,
        };
        let mut ventricle = OneFibreVentricle::new(OneFibreParameters {
            passive,
            activation: ActivationSpread::default(),
            contraction: GroupContraction::tanh(Tanh::new(tanh).unwrap()),
            cycle_length,
            pressure_terms: Vec::new(),
            law: None,
        })
        .unwrap();
        let outcome = run_beats(&mut ventricle, &mut heart.build().unwrap(), &BeatSettings::one_beat(cycle_length));
        match outcome {
            BeatOutcome::Finished(result) => {
                prop_assert!(result.traces.pressure_mmhg.iter().chain(&result.traces.volume_ml).all(|x| x.is_finite()));
                prop_assert!(result.checks.iter().any(|c| c.name == "volume_balance_ml" && c.passed));
                prop_assert!(result.work.n_iterations < 5 * result.work.n_steps, "{:?}", result.work);
            }
            BeatOutcome::Diverged { t, .. } => prop_assert!(t.0 < 750.0),
        }
    }
}
