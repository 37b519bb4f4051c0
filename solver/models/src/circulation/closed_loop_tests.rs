//! Tests of the closed loop without a ventricle: a cavity pressure is given.

use super::*;
use proptest::prelude::*;
use std::f64::consts::PI;

const CYCLE: Ms = Ms(800.0);

fn adult() -> ClosedLoop {
    let left = LeftHeart::of_an_adult(Mmhg(8.0), CYCLE);
    ClosedLoop::around(left, Ms(20.0), Ml(75.0))
}

/// A cavity pressure with a systole of 300 ms.
fn cavity(t_ms: f64) -> Mmhg {
    let t = t_ms.rem_euclid(CYCLE.0) - 20.0;
    Mmhg(
        7.0 + if (0.0..300.0).contains(&t) {
            110.0 * (PI * t / 300.0).sin()
        } else {
            0.0
        },
    )
}

#[test]
fn start_is_in_balance() {
    let circuit = adult().build().unwrap();
    let at = |name| circuit.pressure(circuit.compartment_idx(name).unwrap()).0;
    assert!((at(LEFT_ATRIUM) - 8.0).abs() < 1e-9);
    // Normal resting pressures: Harrison's ranges of mean pressure, RA 0 to 8, PA 9 to 18 mmHg.
    assert!(
        (1.0..8.0).contains(&at(RIGHT_ATRIUM)),
        "{}",
        at(RIGHT_ATRIUM)
    );
    let lungs = at(PULMONARY_ARTERIES);
    assert!((9.0..20.0).contains(&lungs), "{lungs}");
    assert!(at(SYSTEMIC_VEINS) > at(RIGHT_ATRIUM) && at(AORTA) > at(SYSTEMIC_VEINS));
}

#[test]
fn blood_only_moves() {
    let mut circuit = adult().build().unwrap();
    let whole = circuit.volume().unwrap().0;
    for step in 0..8000 {
        circuit
            .try_step(cavity(f64::from(step + 1)), Ms(1.0))
            .unwrap();
        circuit.commit();
    }
    assert!(circuit.net_volume_in().0.abs() > 1.0, "blood went through");
    // What the circuit lost is in the ventricle; the sum differs by the rounding of 8000 additions.
    let now = circuit.volume().unwrap().0 + circuit.net_volume_in().0;
    assert!((now - whole).abs() < 1e-9 * whole, "{}", now - whole);
    assert!(
        LeftHeart::of_an_adult(Mmhg(8.0), CYCLE)
            .build()
            .unwrap()
            .volume()
            .is_none()
    );
}

#[test]
fn paths_of_the_ventricle_stay_first() {
    let mut circuit = adult().build().unwrap();
    let twin = adult().build().unwrap();
    let leak = crate::circulation::Orifice::new("leak", 0.0).unwrap();
    let atrium = circuit.compartment_idx(LEFT_ATRIUM).unwrap();
    assert_eq!(
        circuit.connect(Box::new(leak), atrium, Direction::OutOfVentricle),
        2
    );
    let mut both = [circuit, twin];
    for step in 0..400 {
        let flows = both
            .each_mut()
            .map(|c| c.try_step(cavity(f64::from(step)), Ms(1.0)).unwrap());
        assert_eq!(flows[0], flows[1]);
        both.iter_mut().for_each(Circulation::commit);
    }
    let flow = |c: &Circulation| c.flow(c.path_idx("periphery").unwrap()).0;
    assert!(flow(&both[0]) > 10.0 && flow(&both[0]) == flow(&both[1]));
}

#[test]
fn restored_loop_goes_on_the_same() {
    let mut circuit = adult().build().unwrap();
    let run = |circuit: &mut Circulation| {
        for step in 0..300 {
            circuit.try_step(cavity(f64::from(step)), Ms(1.0)).unwrap();
            circuit.commit();
        }
        circuit.snapshot()
    };
    run(&mut circuit);
    let text = serde_json::to_string(&circuit.snapshot()).unwrap();
    let first = run(&mut circuit);
    let mut other = adult().build().unwrap();
    other
        .restore(&serde_json::from_str(&text).unwrap())
        .unwrap();
    let second = run(&mut other);
    for (a, b) in first.states.iter().zip(&second.states) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

proptest! {
    #[test]
    fn slope_is_that_of_the_net_flow(pressure in 0.0..200.0f64, dt in 0.05..4.0f64, time in 0u32..40) {
        let mut circuit = adult().build().unwrap();
        for step in 0..time {
            circuit.try_step(cavity(10.0 * f64::from(step + 1)), Ms(10.0)).unwrap();
            circuit.commit();
        }
        let mut at = |p: f64| circuit.try_step(Mmhg(p), Ms(dt)).unwrap();
        let h = 1e-4;
        let (up, down, here) = (at(pressure + h), at(pressure - h), at(pressure));
        let slope = (up.inflow_ml_per_s - down.inflow_ml_per_s) / (2.0 * h);
        let kink = (up.slope_ml_per_s_per_mmhg - down.slope_ml_per_s_per_mmhg).abs();
        prop_assert!(
            (slope - here.slope_ml_per_s_per_mmhg).abs() < 1e-3 * (1.0 + slope.abs()) + kink,
            "{slope} {here:?}"
        );
        prop_assert!(here.slope_ml_per_s_per_mmhg <= 0.0);
    }
}

#[test]
fn another_loop_goes_on_from_contents() {
    let step = |circuit: &mut Circulation, t_ms: f64| {
        circuit.try_step(cavity(t_ms), Ms(1.0)).unwrap();
        circuit.commit();
    };
    let mut first = adult().build().unwrap();
    (1..=800).for_each(|ms| step(&mut first, f64::from(ms)));
    let contents = first.contents().unwrap();
    let mut second = adult().build().unwrap();
    second.begin_with(&contents).unwrap();
    assert_eq!(second.contents().unwrap(), contents);
    // A beat later both agree, although the second one counts its time from zero.
    for ms in 1..=800 {
        step(&mut first, f64::from(800 + ms));
        step(&mut second, f64::from(ms));
    }
    let [a, b] = [&first, &second].map(|circuit| circuit.contents().unwrap());
    for (name, volume_ml) in &a.volumes_ml {
        let other = b.volumes_ml[name];
        assert!(
            (volume_ml - other).abs() < 1e-9,
            "{name}: {volume_ml} {other}"
        );
    }
    let before = second.volume().unwrap().0;
    assert!(second.add_blood(PULMONARY_VEINS, Ml(-3.0)));
    assert!((second.volume().unwrap().0 - (before - 3.0)).abs() < 1e-9);
}

#[test]
fn contents_of_another_circuit_are_refused_with_their_names() {
    let mut circuit = adult().build().unwrap();
    let mut contents = circuit.contents().unwrap();
    let mut open = LeftHeart::of_an_adult(Mmhg(8.0), CYCLE).build().unwrap();
    assert!(open.contents().is_none() && !open.add_blood(AORTA, Ml(1.0)));
    assert!(open.begin_with(&contents).is_err());
    let volume_ml = contents.volumes_ml.remove(SYSTEMIC_VEINS).unwrap();
    contents
        .volumes_ml
        .insert("vena_cava".to_owned(), volume_ml);
    let refused = circuit.begin_with(&contents).unwrap_err().to_string();
    assert!(
        refused.contains("vena_cava") && refused.contains(SYSTEMIC_VEINS),
        "{refused}"
    );
}
