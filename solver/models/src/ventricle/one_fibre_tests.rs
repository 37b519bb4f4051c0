//! Tests of the one-fibre ventricle with its circulation.

use super::*;
use crate::beat::{BeatOutcome, BeatResult, BeatSettings, Beats, run_beats};
use crate::calcium::Rice2008Parameters;
use crate::cell0d::{CalciumInput, CellParameters, CellSolverSettings};
use crate::circulation::{LeftHeart, StartPressure};
use crate::contraction::{Land2017, Tanh, TanhParameters};
use crate::median_traces::MedianTraces;
use crate::ventricle::{PassiveStateInput, PassiveStateMode};
use cardiotwin_vocabulary::circulation::WindkesselParameters;

const CYCLE: Ms = Ms(659.0);

fn passive() -> OneFibrePassive {
    OneFibrePassive::fit(&PassiveStateInput {
        end_diastolic_volume: Ml(161.2),
        end_diastolic_pressure: Mmhg(7.0),
        diastasis: None,
        wall_volume: Ml(120.9),
        mode: PassiveStateMode::EndDiastole,
    })
    .unwrap()
    .0
}

fn heart() -> LeftHeart {
    LeftHeart {
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
    }
}

fn tanh() -> GroupContraction {
    let p = TanhParameters {
        smax_ref_kpa: 121.0,
        tau_sr_ref_ms: 3.0,
        tau_sd_ms: 22.0,
        t_cr_ms: 316.0,
        ..Default::default()
    };
    GroupContraction::tanh(Tanh::new(p).unwrap())
}

/// A Land cell that ejects: it is sensitive, and calcium is high enough.
fn land() -> GroupContraction {
    let mut cell = CellParameters {
        cycle_length_ms: CYCLE.0,
        ..CellParameters::default()
    };
    cell.land.ca50_ref_um = 0.5;
    cell.land.n_trpn = 3.0;
    cell.passive.a_p_kpa = 60.0;
    cell.calcium = CalciumInput::Rice(Rice2008Parameters {
        ca_res_um: 0.1,
        ca_max_um: 0.8,
        tau_cr_ms: 80.0,
        tau_cd_ms: 75.0,
    });
    let cell = cell.build().unwrap();
    GroupContraction::land(
        &cell,
        &cell.solve_periodic(&CellSolverSettings::default()).unwrap(),
    )
}

fn ventricle(
    contraction: GroupContraction,
    terms: Vec<Box<dyn CavityPressureTerm>>,
) -> OneFibreVentricle {
    OneFibreVentricle::new(OneFibreParameters {
        passive: passive(),
        activation: ActivationSpread::default(),
        contraction,
        cycle_length: CYCLE,
        pressure_terms: terms,
        law: None,
    })
    .unwrap()
}

fn run(contraction: GroupContraction, settings: &BeatSettings) -> BeatResult {
    match run_beats(
        &mut ventricle(contraction, Vec::new()),
        &mut heart().build().unwrap(),
        settings,
    ) {
        BeatOutcome::Finished(result) => *result,
        BeatOutcome::Diverged { t, reason, .. } => panic!("diverged at {t}: {reason}"),
    }
}

fn largest(trace: &[f64]) -> f64 {
    trace.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x))
}

#[test]
fn begins_at_end_diastole() {
    for contraction in [tanh(), land()] {
        let v = ventricle(contraction, Vec::new());
        assert_eq!(v.volume(), Ml(161.2));
        // A Land cell has a small stress at rest.
        assert!((v.pressure().0 - 7.0).abs() < 0.5, "{}", v.pressure());
        let mut lambda = vec![0.0; v.activation_times_ms().len()];
        v.stretch(&mut lambda);
        assert!(lambda.iter().all(|l| (l - 1.0).abs() < 1e-12));
    }
}

#[test]
fn a_beat_ejects_fills_and_passes_every_check() {
    for contraction in [tanh(), land()] {
        let result = run(contraction, &BeatSettings::one_beat(CYCLE));
        assert!(result.succeeded(), "{:?}", result.checks);
        assert_eq!(result.traces.time_ms.len(), 660);
        assert_eq!(result.checks.len(), 8);
        let peak = largest(&result.traces.pressure_mmhg);
        assert!((80.0..200.0).contains(&peak), "{peak}");
        assert!(
            result.work.n_iterations < 4 * result.work.n_steps,
            "{:?}",
            result.work
        );
        let balance = result
            .checks
            .iter()
            .find(|c| c.name == "volume_balance_ml")
            .unwrap();
        assert!(balance.value.abs() < 1e-4, "{}", balance.value);
    }
}

#[test]
fn volume_changes_by_what_the_valves_let_through() {
    let t = run(tanh(), &BeatSettings::one_beat(CYCLE)).traces;
    for k in 1..t.time_ms.len() {
        let moved = (t.mitral_flow_ml_per_s[k] - t.aortic_flow_ml_per_s[k]) * 1e-3;
        assert!(
            (t.volume_ml[k] - t.volume_ml[k - 1] - moved).abs() < 1e-7,
            "{k}"
        );
    }
}

#[test]
fn error_of_the_time_step_is_of_first_order() {
    let at = |dt: f64| {
        let result = run(
            tanh(),
            &BeatSettings {
                step: Ms(dt),
                ..BeatSettings::one_beat(Ms(600.0))
            },
        );
        let every = (4.0 / dt) as usize;
        result
            .traces
            .volume_ml
            .iter()
            .step_by(every)
            .copied()
            .collect::<Vec<f64>>()
    };
    let exact = at(1.0 / 64.0);
    let error = |dt: f64| {
        at(dt)
            .iter()
            .zip(&exact)
            .fold(0.0f64, |m, (a, b)| m.max((a - b).abs()))
    };
    let (coarse, fine) = (error(1.0), error(0.25));
    let order = (coarse / fine).log2() / 2.0;
    assert!((order - 1.0).abs() < 0.2, "{coarse} {fine} {order}");
    assert!(coarse < 1.5, "{coarse} mL at 1 ms");
}

#[test]
fn small_corrections_without_another_evaluation_leave_the_beat_alone() {
    for contraction in [tanh as fn() -> GroupContraction, land] {
        let beat = |is_plain: bool| {
            let mut ventricle = ventricle(contraction(), Vec::new());
            if is_plain {
                ventricle.solve_plainly(1e-12);
            }
            let settings = BeatSettings::one_beat(CYCLE);
            match run_beats(&mut ventricle, &mut heart().build().unwrap(), &settings) {
                BeatOutcome::Finished(result) => *result,
                BeatOutcome::Diverged { t, reason, .. } => panic!("diverged at {t}: {reason}"),
            }
        };
        let (usual, exact) = (beat(false), beat(true));
        let apart = |a: &[f64], b: &[f64]| {
            let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
            differences.fold(0.0, f64::max)
        };
        let volume = apart(&usual.traces.volume_ml, &exact.traces.volume_ml);
        let pressure = apart(&usual.traces.pressure_mmhg, &exact.traces.pressure_mmhg);
        assert!(volume < 1e-4 && pressure < 5e-4, "{volume} {pressure}");
        let evaluations =
            |result: &BeatResult| result.work.n_iterations as f64 / result.work.n_steps as f64;
        let (usual, exact) = (evaluations(&usual), evaluations(&exact));
        assert!(usual < 1.3 && exact > 1.8, "{usual} {exact}");
    }
}

#[test]
fn rolled_back_steps_leave_no_trace_and_snapshots_restore_bit_for_bit() {
    for contraction in [tanh as fn() -> GroupContraction, land] {
        let (mut v, mut c) = (
            ventricle(contraction(), Vec::new()),
            heart().build().unwrap(),
        );
        let step = |v: &mut OneFibreVentricle, c: &mut Circulation, dt: f64| {
            v.try_step(c, Ms(dt)).unwrap();
            v.commit();
            c.commit();
        };
        for _ in 0..120 {
            step(&mut v, &mut c, 1.0);
        }
        let (snapshot, circulation) = (v.snapshot(), c.snapshot());
        v.try_step(&mut c, Ms(0.3)).unwrap();
        v.roll_back();
        c.roll_back();
        v.commit();
        assert_eq!(v.snapshot(), snapshot);
        let text = serde_json::to_string(&snapshot).unwrap();
        let (mut other, mut other_c) = (
            ventricle(contraction(), Vec::new()),
            heart().build().unwrap(),
        );
        other
            .restore(&serde_json::from_str(&text).unwrap())
            .unwrap();
        other_c.restore(&circulation).unwrap();
        for _ in 0..50 {
            step(&mut v, &mut c, 1.0);
            step(&mut other, &mut other_c, 1.0);
        }
        // The compartments' last pressures only start an iteration, so that results agree to its
        // tolerance.
        let difference = v
            .snapshot()
            .values
            .iter()
            .zip(&other.snapshot().values)
            .fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(difference < 1e-9, "{difference}");
    }
    let mut v = ventricle(tanh(), Vec::new());
    let foreign = ventricle(land(), Vec::new()).snapshot();
    assert!(matches!(
        v.restore(&foreign),
        Err(VentricleError::ForeignSnapshot { .. })
    ));
}

#[test]
fn several_beats_become_periodic() {
    let beats = Beats::UntilPeriodic {
        limit: 40,
        volume: Ml(0.01),
        pressure: Mmhg(0.01),
    };
    let result = run(
        tanh(),
        &BeatSettings {
            beats,
            ..BeatSettings::one_beat(CYCLE)
        },
    );
    assert_eq!(result.periodic, Some(true));
    assert!((2..40).contains(&result.n_beats), "{}", result.n_beats);
    let v = &result.traces.volume_ml;
    assert!((v[0] - v[659]).abs() < 0.01);
    assert!(
        v[0] < 161.2,
        "without an atrial kick the periodic volume is below the measured one"
    );
}

#[test]
fn land_cells_see_the_last_transients_tail_before_activation() {
    let v = ventricle(land(), Vec::new());
    let mut ca = vec![0.0; 32];
    v.calcium_um(&mut ca);
    // All groups start shortly before the end of the previous cycle, the last activated one
    // earliest.
    assert!(ca.windows(2).all(|w| w[0] < w[1]) && ca[0] > 0.1);
}

#[test]
fn long_steps_in_late_filling_leave_the_same_samples_and_hardly_move_them() {
    let usual = BeatSettings {
        record_nodes: true,
        ..BeatSettings::one_beat(Ms(1200.0))
    };
    let long = BeatSettings {
        diastolic_step: Ms(8.0),
        ..usual
    };
    let (usual, long) = (run(tanh(), &usual), run(tanh(), &long));
    assert!(long.succeeded(), "{:?}", long.checks);
    assert!(
        long.work.n_steps < usual.work.n_steps - 100,
        "{:?} {:?}",
        long.work,
        usual.work
    );
    assert_eq!(long.traces.time_ms, usual.traces.time_ms);
    assert_eq!(long.traces.mitral_open.len(), long.traces.time_ms.len());
    let apart = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
    };
    let pressures = apart(&long.traces.pressure_mmhg, &usual.traces.pressure_mmhg);
    let volumes = apart(&long.traces.volume_ml, &usual.traces.volume_ml);
    assert!(pressures < 0.2 && volumes < 0.2, "{pressures} {volumes}");
    let stretch = |result: &BeatResult| {
        result
            .traces
            .nodes
            .as_ref()
            .expect("recorded")
            .lambda
            .clone()
    };
    assert_eq!(stretch(&long).len(), stretch(&usual).len());
    assert!(apart(&stretch(&long), &stretch(&usual)) < 1e-3);
    // A diastolic step that does not exceed two intervals has no effect.
    let none = run(
        tanh(),
        &BeatSettings {
            diastolic_step: Ms(1.9),
            ..BeatSettings::one_beat(CYCLE)
        },
    );
    assert_eq!(none, run(tanh(), &BeatSettings::one_beat(CYCLE)));
}

#[test]
fn median_traces_of_a_beat() {
    let settings = BeatSettings {
        record_nodes: true,
        ..BeatSettings::one_beat(CYCLE)
    };
    let result = run(tanh(), &settings);
    let median = MedianTraces::of(&result.traces).unwrap();
    let b = median.biomarkers().unwrap();
    let nodes = result.traces.nodes.as_ref().unwrap();
    assert_eq!(nodes.sa_kpa.len(), 660 * 32);
    assert!(b.sa_max_kpa > 30.0 && b.sa_max_kpa < largest(&nodes.sa_kpa));
    assert!(
        b.lambda_min > 0.75 && b.lambda_min < 0.9,
        "{}",
        b.lambda_min
    );
    assert!((*median.time_ms.last().unwrap() - (659.0 - 39.375f64).floor()).abs() < 1e-9);
    assert_eq!(median.sa_kpa[0], 0.0);
}

#[test]
fn cycle_lengths_need_not_be_whole() {
    let result = run(tanh(), &BeatSettings::one_beat(Ms(658.4)));
    assert_eq!(result.traces.time_ms.len(), 660);
    assert_eq!(*result.traces.time_ms.last().unwrap(), 658.4);
    assert!(result.succeeded(), "{:?}", result.checks);
}

/// A model that fails from a given time on.
#[derive(Debug)]
struct Failing(f64);
impl Contraction for Failing {
    fn n_states(&self) -> usize {
        0
    }
    fn needs_calcium(&self) -> bool {
        false
    }
    fn rest(&self, _state: &mut [f64]) {}
    fn try_step(
        &self,
        step: &crate::contraction::NodeStep,
        _state: &[f64],
        _trial: &mut [f64],
    ) -> Result<ActiveStress, crate::contraction::ContractionError> {
        if step.since_activation_ms > self.0 {
            Err(crate::contraction::ContractionError::Stretch {
                lambda: step.lambda,
            })
        } else {
            Ok(ActiveStress {
                sa_kpa: 0.05 * step.since_activation_ms.max(0.0),
                dsa_dlambda_kpa: 0.0,
            })
        }
    }
}

#[test]
fn divergence_is_an_ending_with_the_last_good_state() {
    let contraction = GroupContraction::new(Box::new(Failing(100.3)), None, Vec::new()).unwrap();
    let (mut v, mut c) = (ventricle(contraction, Vec::new()), heart().build().unwrap());
    let BeatOutcome::Diverged {
        t,
        last_good,
        reason,
        traces,
        work,
    } = run_beats(&mut v, &mut c, &BeatSettings::one_beat(CYCLE))
    else {
        panic!("must diverge")
    };
    // The first group, activated at 0.625 ms, fails 100.3 ms later; steps of 1/64 ms come that
    // close.
    assert!(
        (t.0 - 100.925).abs() < 1.0 / 64.0 + 1e-9 && t.0 <= 100.925,
        "{t}"
    );
    assert!(matches!(reason, VentricleError::Contraction { .. }));
    assert_eq!(last_good.ventricle, v.snapshot());
    assert_eq!(last_good.ventricle.values[0], t.0);
    assert_eq!(traces.time_ms.len(), 101);
    assert!(work.n_cut >= 6);
}

/// Wall viscosity and a constraint, in the form in which effects add them.
#[derive(Debug)]
struct Viscous(f64);
impl CavityPressureTerm for Viscous {
    fn pressure(&self, _volume_ml: f64, rate_ml_per_s: f64) -> (f64, f64, f64) {
        (self.0 * rate_ml_per_s, 0.0, self.0)
    }
}

#[test]
fn a_pressure_term_changes_filling_and_keeps_newton_fast() {
    let mut v = ventricle(tanh(), vec![Box::new(Viscous(0.01))]);
    let BeatOutcome::Finished(with) = run_beats(
        &mut v,
        &mut heart().build().unwrap(),
        &BeatSettings::one_beat(CYCLE),
    ) else {
        panic!("must finish")
    };
    let without = run(tanh(), &BeatSettings::one_beat(CYCLE));
    assert!(with.succeeded());
    assert!(
        largest(&with.traces.mitral_flow_ml_per_s) < largest(&without.traces.mitral_flow_ml_per_s)
    );
    assert!(with.work.n_iterations < 4 * with.work.n_steps);
}

#[test]
fn a_late_part_of_the_wall_slows_the_rise() {
    let late = ActivationGroups::new(vec![5.0, 20.0, 35.0, 80.0], vec![1.0; 4]).unwrap();
    let parameters = OneFibreParameters {
        passive: passive(),
        activation: ActivationSpread::default(),
        contraction: tanh(),
        cycle_length: CYCLE,
        pressure_terms: Vec::new(),
        law: None,
    };
    let mut v = OneFibreVentricle::with_groups(parameters, &late).unwrap();
    let BeatOutcome::Finished(with) = run_beats(
        &mut v,
        &mut heart().build().unwrap(),
        &BeatSettings::one_beat(CYCLE),
    ) else {
        panic!("must finish")
    };
    let rise = |r: &BeatResult| {
        largest(
            &r.traces
                .pressure_mmhg
                .windows(11)
                .map(|w| w[10] - w[0])
                .collect::<Vec<f64>>(),
        )
    };
    let without = run(tanh(), &BeatSettings::one_beat(CYCLE));
    assert!(
        with.succeeded() && rise(&with) < 0.9 * rise(&without),
        "{} {}",
        rise(&with),
        rise(&without)
    );
}

#[test]
fn slope_of_the_cavity_pressure_is_its_slope() {
    for contraction in [tanh as fn() -> GroupContraction, land] {
        let (mut v, mut c) = (
            ventricle(contraction(), vec![Box::new(Viscous(0.004))]),
            heart().build().unwrap(),
        );
        for _ in 0..90 {
            v.try_step(&mut c, Ms(1.0)).unwrap();
            v.commit();
            c.commit();
        }
        v.prepare_groups(91.0);
        let volume = v.volume().0 - 0.7;
        let h = 1e-4;
        let mut at = |x: f64| v.cavity_pressure(x, 1.0).unwrap();
        let slope = (at(volume + h).0 - at(volume - h).0) / (2.0 * h);
        let tangent = at(volume).1;
        assert!(
            (slope - tangent).abs() < 1e-5 * slope.abs(),
            "{slope} {tangent}"
        );
    }
}

#[test]
fn refuses_nonsense() {
    let bad = OneFibreParameters {
        passive: passive(),
        activation: ActivationSpread::default(),
        contraction: tanh(),
        cycle_length: Ms(20.0),
        pressure_terms: Vec::new(),
        law: None,
    };
    assert!(matches!(
        OneFibreVentricle::new(bad),
        Err(VentricleError::Parameter {
            name: "cycle length",
            ..
        })
    ));
    let land = Land2017::new(Default::default()).unwrap();
    assert!(GroupContraction::new(Box::new(land), None, vec![0.0; 6]).is_err());
    assert!(GroupContraction::new(Box::new(land), None, vec![0.0; 5]).is_err());
    let mut v = ventricle(tanh(), Vec::new());
    assert!(v.try_step(&mut heart().build().unwrap(), Ms(0.0)).is_err());
}
