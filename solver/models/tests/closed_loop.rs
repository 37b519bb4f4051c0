//! The closed loop around a ventricle: conservation, limit cycle, the atrium's part, and the loop of
//! another program.

use cardiotwin_models::beat::{BeatOutcome, BeatResult, BeatSettings, Beats, run_beats};
use cardiotwin_models::circulation::closed_loop::{
    PULMONARY_ARTERIES, PULMONARY_VEINS, RIGHT_ATRIUM, RIGHT_VENTRICLE, SYSTEMIC_VEINS,
};
use cardiotwin_models::circulation::left_heart::{AORTA, LEFT_ATRIUM};
use cardiotwin_models::circulation::{
    Circulation, ClosedLoop, LeftHeart, Resistance, StartPressure, windkessel::WindkesselParameters,
};
use cardiotwin_models::effects::{self, Assembled};
use cardiotwin_models::periodic::{
    Filling, FitSubject, PeriodicBeat, PeriodicSettings, blood_volume, find, find_filled,
};
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};

const CYCLE: Ms = Ms(800.0);
/// Blood that stretches vessels and chambers.
const BLOOD_ML: f64 = 2283.0;

/// Blood in ventricle and loop \[mL\].
fn whole(model: &Assembled) -> f64 {
    model.ventricle.volume().0 + model.circulation.volume().expect("closed").0
}

/// A typical one-fibre ventricle in a loop, its periphery times a factor and its blood the same.
fn model(periphery: f64) -> Assembled {
    let subject = FitSubject::new(CYCLE, Ml(110.0));
    let mut values = FitSubject::typical();
    values[5] *= periphery;
    let base = subject.base(&values).expect("typical values");
    let mut closed = ClosedLoop::around(base.heart, base.activation.onset, Ml(70.0));
    let mut model = subject.model(&values, &[]).expect("typical values");
    model.circulation = closed.build().expect("a loop");
    closed.extra = Ml(BLOOD_ML - whole(&model));
    model.circulation = closed.build().expect("a loop");
    model
}

fn run(model: &mut Assembled, beats: Beats) -> BeatResult {
    let settings = BeatSettings {
        beats,
        ..BeatSettings::one_beat(CYCLE)
    };
    match run_beats(&mut model.ventricle, &mut model.circulation, &settings) {
        BeatOutcome::Finished(result) => *result,
        BeatOutcome::Diverged { reason, .. } => panic!("{reason}"),
    }
}

fn range(values: &[f64]) -> (f64, f64) {
    let wider = |(l, h): (f64, f64), v: &f64| (v.min(l), v.max(h));
    values.iter().fold((f64::MAX, f64::MIN), wider)
}

#[test]
fn volume_of_blood_stays_over_fifty_beats() {
    let mut model = model(1.0);
    let before = whole(&model);
    let of_loop =
        |m: &Assembled| m.circulation.volume().expect("closed").0 + m.circulation.net_volume_in().0;
    let loop_before = of_loop(&model);
    let result = run(&mut model, Beats::Exactly(50));
    assert!(result.succeeded(), "{:?}", result.checks);
    let lost = whole(&model) - before;
    // The ventricle's volume is the solution of its own equation, to that equation's tolerance.
    assert!(lost.abs() < 1e-8 * before, "{lost} mL of {before}");
    // What left the loop is what entered the ventricle, to rounding.
    let moved = of_loop(&model) - loop_before;
    println!("{lost:.1e} mL with the ventricle, {moved:.1e} mL in the loop");
    assert!(moved.abs() < 1e-11 * before, "{moved} mL of {before}");
}

#[test]
fn limit_cycle_is_where_plain_repetition_ends() {
    let mut searched = model(1.0);
    let settings = PeriodicSettings {
        limit: 60,
        ..PeriodicSettings::with_step(CYCLE, Ms(1.0))
    };
    let start = whole(&searched);
    let found = find(&mut searched, CYCLE, &settings, None).expect("a beat");
    assert!(found.periodic, "{} after {}", found.change, found.n_beats);
    let lost = whole(&searched) - start;
    assert!(lost.abs() < 1e-6 * start, "{lost} of {start}");
    let limit = Beats::UntilPeriodic {
        limit: 600,
        volume: Ml(1e-6),
        pressure: Mmhg(1e-6),
    };
    let plain = run(&mut model(1.0), limit);
    assert_eq!(plain.periodic, Some(true));
    for (i, v) in found.heart.volume_ml.iter().enumerate().skip(1) {
        let other = plain.traces.volume_ml[i];
        assert!((v - other).abs() < 2e-3, "{i}: {v} {other}");
    }
    println!(
        "{} beats searched, {} repeated",
        found.n_beats, plain.n_beats
    );
}

#[test]
fn atrium_kicks_and_preload_follows_afterload() {
    let settings = PeriodicSettings {
        limit: 60,
        ..PeriodicSettings::with_step(CYCLE, Ms(1.0))
    };
    let beat =
        |periphery: f64| find(&mut model(periphery), CYCLE, &settings, None).expect("a beat");
    let (rest, dilated) = (beat(1.0), beat(0.75));
    assert!(rest.periodic && dilated.periodic);
    let (low, high) = range(&rest.heart.volume_ml);
    let stroke = high - low;
    // The atrium begins to contract a fifth of the cycle before the ventricle's onset, at 10 ms.
    let begins = (10.0 - 0.2 * CYCLE.0).rem_euclid(CYCLE.0) as usize;
    let kick = (high - rest.heart.volume_ml[begins]) / stroke;
    println!(
        "stroke {stroke:.1} mL, kick {:.0} %, atrium {:?}, aorta {:?}",
        100.0 * kick,
        range(&rest.atrial_pressure_mmhg),
        range(&rest.aortic_pressure_mmhg)
    );
    // 10 to 40 % by MRI, with age (Alhogbani et al.).
    assert!((0.05..0.4).contains(&kick), "{kick}");
    let atrium = &rest.atrial_pressure_mmhg;
    let during: f64 = atrium[begins..].iter().copied().fold(f64::MIN, f64::max);
    assert!(
        during > atrium[begins] + 0.5,
        "an a-wave: {during} {}",
        atrium[begins]
    );
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let end_diastolic = |b: &cardiotwin_models::periodic::PeriodicBeat| range(&b.heart.volume_ml).1;
    println!(
        "periphery -25 %: end-diastolic {:.1} to {:.1} mL, forward {:.1} to {:.1} mL, atrium {:.2} to {:.2} mmHg",
        end_diastolic(&rest),
        end_diastolic(&dilated),
        rest.forward_volume_ml,
        dilated.forward_volume_ml,
        mean(&rest.atrial_pressure_mmhg),
        mean(&dilated.atrial_pressure_mmhg)
    );
    // What the arteries no longer hold fills the heart.
    assert!(mean(&dilated.atrial_pressure_mmhg) > mean(atrium) + 0.2);
    assert!(end_diastolic(&dilated) > end_diastolic(&rest) + 1.0);
    assert!(dilated.forward_volume_ml > 1.05 * rest.forward_volume_ml);
}

/// The loop of Regazzoni's program from its initial state.
fn of_the_program() -> Circulation {
    let left = LeftHeart {
        left_atrial_pressure: Mmhg(10.0),
        mitral_forward: MmhgSPerMl(0.0075),
        mitral_backward: MmhgSPerMl(75_006.2),
        aortic_forward: MmhgSPerMl(0.0075),
        aortic_backward: MmhgSPerMl(75_006.2),
        windkessel: WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: 0.0,
            peripheral_resistance_mmhg_s_per_ml: 1.2,
            compliance_ml_per_mmhg: 1.2,
        },
        start: StartPressure::DiastolicCuff(Mmhg(70.0)),
        cycle_length: CYCLE,
    };
    let mut circuit = ClosedLoop::around(left, Ms(80.0), Ml(70.0))
        .build()
        .expect("a loop");
    for (name, resistance, inertance) in [("periphery", 0.84, 5e-3), ("venous_return", 0.32, 5e-4)]
    {
        let path = circuit.path_idx(name).expect("a path");
        let vessel = Resistance::new(name, MmhgSPerMl(resistance)).expect("a vessel");
        circuit.replace_path(path, Box::new(vessel));
        circuit.set_inertance(path, inertance);
    }
    let mut state = circuit.snapshot();
    for (name, volume_ml) in [
        (LEFT_ATRIUM, 80.0),
        (AORTA, 70.0 * 1.2),
        (SYSTEMIC_VEINS, 40.0 * 60.0),
        (RIGHT_ATRIUM, 80.0),
        (RIGHT_VENTRICLE, 110.0),
        (PULMONARY_ARTERIES, 25.0 * 10.0),
        (PULMONARY_VEINS, 20.0 * 16.0),
    ] {
        state.states[circuit.compartment_idx(name).expect(name)] = volume_ml;
    }
    circuit.restore(&state).expect("the same loop");
    circuit
}

/// The measured cavity pressure of a 3D ventricle in the loop of another program drives ours: its
/// volume must come out, over five beats from the same initial state.
#[test]
fn volume_of_a_3d_ventricle_in_another_programs_loop() {
    let text = include_str!("data/cardioemulator.csv");
    let rows: Vec<[f64; 3]> = (text.lines().skip(3))
        .map(|line| {
            let mut cells = line.split(',').map(|cell| cell.parse().expect("a number"));
            std::array::from_fn(|_| cells.next().expect("three columns"))
        })
        .collect();
    let volume_errors = |steps: usize| {
        let mut circuit = of_the_program();
        let mut errors = Vec::new();
        for pair in rows.windows(2) {
            let dt = (pair[1][0] - pair[0][0]) / steps as f64;
            for k in 1..=steps {
                let share = k as f64 / steps as f64;
                let pressure = pair[0][1] + share * (pair[1][1] - pair[0][1]);
                circuit.try_step(Mmhg(pressure), Ms(dt)).expect("a step");
                circuit.commit();
            }
            errors.push(110.0 + circuit.net_volume_in().0 - pair[1][2]);
        }
        errors
    };
    let errors = volume_errors(4);
    for (beat, errors) in errors.chunks(400).enumerate() {
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        println!("beat {}: mean {mean:.2}, rms {rms:.2} mL", beat + 1);
        assert!(rms < 3.0, "beat {beat}: {rms} mL");
    }
    let coarse = volume_errors(2);
    let moved = (coarse.iter().zip(&errors)).map(|(a, b)| (a - b).abs());
    println!(
        "1 ms instead of 0.5 ms: {:.2} mL",
        moved.fold(0.0, f64::max)
    );
}

/// An effect with a part of its own would replace one of the loop's; a leak does not.
#[test]
fn effects_with_their_own_parts_are_refused() {
    let subject = FitSubject::new(CYCLE, Ml(110.0));
    let with = |name: &str| {
        let mut base = subject
            .base(&FitSubject::typical())
            .expect("typical values");
        base.closed = Some(ClosedLoop::around(
            base.heart,
            base.activation.onset,
            Ml(70.0),
        ));
        let effect = effects::find(name).expect(name);
        effects::assemble(base, &[effects::EffectSetting::typical(effect)])
    };
    for name in [
        "atrial_kick",
        "wave_reflection",
        "ventricular_septal_defect",
    ] {
        let refused = with(name).expect_err(name);
        assert!(
            matches!(refused, effects::EffectError::NoPart { .. }),
            "{refused}"
        );
    }
    let mut leaking = with("mitral_regurgitation").expect("a leak");
    let before = whole(&leaking);
    let result = run(&mut leaking, Beats::Exactly(5));
    assert!(result.succeeded(), "{:?}", result.checks);
    assert!((whole(&leaking) - before).abs() < 1e-8 * before);
    let leak = leaking.circulation.paths_out_to(LEFT_ATRIUM)[0];
    assert!(leaking.circulation.passed(leak).0 > 1.0);
}

/// A typical ventricle with another cycle and periphery, in the loop of the body at rest.
fn changed(cycle: Ms, periphery: f64) -> Assembled {
    let typical = FitSubject::typical();
    let at_rest = FitSubject::new(CYCLE, Ml(110.0))
        .base(&typical)
        .expect("typical values")
        .heart;
    let mut values = typical;
    values[5] *= periphery;
    let mut base = FitSubject::new(cycle, Ml(110.0))
        .base(&values)
        .expect("typical values");
    let onset = base.activation.onset;
    base.closed = Some(ClosedLoop {
        rest: at_rest,
        ..ClosedLoop::around(base.heart, onset, Ml(70.0))
    });
    effects::assemble(base, &[]).expect("a loop")
}

fn filled(model: &mut Assembled, cycle: Ms, filling: Filling) -> PeriodicBeat {
    let settings = PeriodicSettings {
        limit: 60,
        ..PeriodicSettings::with_step(cycle, Ms(1.0))
    };
    let found = find_filled(model, cycle, &settings, filling).expect("a beat");
    assert!(found.periodic, "{} after {}", found.change, found.n_beats);
    model.begin_orbit(&found.orbit);
    found
}

#[test]
fn blood_is_found_that_fills_the_ventricle() {
    let mut model = changed(CYCLE, 1.0);
    let plain = find(
        &mut changed(CYCLE, 1.0),
        CYCLE,
        &PeriodicSettings {
            limit: 60,
            ..PeriodicSettings::with_step(CYCLE, Ms(1.0))
        },
        None,
    )
    .expect("a beat");
    let wanted = 1.1 * range(&plain.heart.volume_ml).1;
    let found = filled(&mut model, CYCLE, Filling::EndDiastolicVolume(Ml(wanted)));
    let (_, end_diastolic) = range(&found.heart.volume_ml);
    assert!(
        (end_diastolic - wanted).abs() < 1e-5,
        "{end_diastolic} {wanted}"
    );
    let blood = blood_volume(&model).expect("closed");
    assert!(blood.0 > 10.0 + blood_volume(&changed(CYCLE, 1.0)).expect("closed").0);
    // The same blood gives the same beat.
    let again = filled(&mut changed(CYCLE, 1.0), CYCLE, Filling::BloodVolume(blood));
    let (_, same) = range(&again.heart.volume_ml);
    assert!((same - wanted).abs() < 1e-3, "{same} {wanted}");
    // More blood raises the atrial pressure.
    let mean = |beat: &PeriodicBeat| {
        let pressures = &beat.atrial_pressure_mmhg;
        pressures.iter().sum::<f64>() / pressures.len() as f64
    };
    let pressure = 1.2 * mean(&found);
    let mut fuller = changed(CYCLE, 1.0);
    let beat = filled(
        &mut fuller,
        CYCLE,
        Filling::LeftAtrialPressure(Mmhg(pressure)),
    );
    assert!((mean(&beat) - pressure).abs() < 1e-5);
    assert!(blood_volume(&fuller).expect("closed").0 > blood.0 + 10.0);
    println!(
        "{} beats for the volume, {} for the pressure, {} with the blood known",
        found.n_beats, beat.n_beats, again.n_beats
    );
}

#[test]
fn blood_stays_under_another_resistance_and_rate() {
    let blood = Ml(BLOOD_ML);
    let held = |cycle: Ms, periphery: f64| {
        let mut model = changed(cycle, periphery);
        let beat = filled(&mut model, cycle, Filling::BloodVolume(blood));
        let now = blood_volume(&model).expect("closed");
        assert!((now.0 - blood.0).abs() < 1e-9, "{}", now.0 - blood.0);
        let (low, high) = range(&beat.heart.volume_ml);
        (high - low, range(&beat.aortic_pressure_mmhg).1)
    };
    let (rest, dilated, fast) = (held(CYCLE, 1.0), held(CYCLE, 0.75), held(Ms(600.0), 1.0));
    assert!(
        dilated.0 > 1.02 * rest.0 && dilated.1 < rest.1,
        "{rest:?} {dilated:?}"
    );
    assert!(fast.0 < 0.97 * rest.0, "{rest:?} {fast:?}");
    // Neither start follows the change of the other: the body's own values are those of rest.
    let veins = |model: &Assembled| {
        let circuit = &model.circulation;
        circuit
            .pressure(circuit.compartment_idx(SYSTEMIC_VEINS).expect("veins"))
            .0
    };
    let starts = [(CYCLE, 0.75), (Ms(600.0), 1.0)].map(|(c, p)| veins(&changed(c, p)));
    assert_eq!(starts, [veins(&changed(CYCLE, 1.0)); 2]);
}

#[test]
fn an_open_circuit_has_no_blood_volume() {
    let subject = FitSubject::new(CYCLE, Ml(110.0));
    let mut open = subject
        .model(&FitSubject::typical(), &[])
        .expect("typical values");
    let settings = PeriodicSettings::with_step(CYCLE, Ms(1.0));
    assert!(blood_volume(&open).is_none());
    let filling = Filling::BloodVolume(Ml(BLOOD_ML));
    assert!(find_filled(&mut open, CYCLE, &settings, filling).is_err());
}
