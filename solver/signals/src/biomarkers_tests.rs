use super::*;
use cardiotwin_vocabulary::biomarkers::Biomarker;
use proptest::prelude::*;

const CYCLE_MS: f64 = 800.0;

/// A volume beat of known time constants: plateau, exponential ejection, plateau, exponential filling, kick.
fn volume(t: f64, tau_vd: f64, tau_vr: f64) -> f64 {
    let ejection_end = 0.02f64; // ejection stops where 2 % of the exponential are left
    let t_ej = 50.0;
    let t_es = t_ej - tau_vd * ejection_end.ln();
    let fall =
        |t: f64| 50.0 + 70.0 * ((-(t - t_ej) / tau_vd).exp() - ejection_end) / (1.0 - ejection_end);
    if t < t_ej {
        120.0
    } else if t < t_es {
        fall(t)
    } else if t < t_es + 60.0 {
        50.0
    } else {
        let filled = 50.0 + 58.0 * (1.0 - (-(t - t_es - 60.0) / tau_vr).exp());
        if t < 700.0 {
            filled
        } else {
            filled + (120.0 - filled) * (t - 700.0) / 100.0
        }
    }
}

/// A pressure beat: a smooth pulse between 60 and 360 ms over a diastolic pressure of 8 mmHg.
fn pressure(t: f64) -> f64 {
    8.0 + if (60.0..360.0).contains(&t) {
        110.0 * (std::f64::consts::PI * (t - 60.0) / 300.0).sin().powi(2)
    } else {
        0.0
    }
}

fn sampled(quantity: Quantity, step: f64, f: impl Fn(f64) -> f64) -> Trace {
    let n = (CYCLE_MS / step).round() as usize;
    Trace::uniform(quantity, step, (0..n).map(|i| f(i as f64 * step)).collect()).unwrap()
}

fn periodic() -> Continuation {
    Continuation::periodic(Ms(CYCLE_MS))
}

#[test]
fn pressure_biomarkers_of_a_pulse() {
    let b = BeatBiomarkers::of(
        Some(&sampled(Quantity::Pressure, 1.0, pressure)),
        None,
        periodic(),
    )
    .unwrap();
    assert_eq!(b.values.p_max_mmhg, Some(118.0));
    let slope = 110.0 * std::f64::consts::PI / 300.0;
    assert!((b.values.dpdt_max_mmhg_per_ms.unwrap() - slope).abs() < 1e-3 * slope);
    assert!((b.values.dpdt_min_mmhg_per_ms.unwrap() + slope).abs() < 1e-3 * slope);
    // sin² = 0.1 at both ends.
    let ptd90 = 300.0 * (1.0 - 2.0 * 0.1f64.sqrt().asin() / std::f64::consts::PI);
    assert!(
        (b.values.ptd90_ms.unwrap() - ptd90).abs() < 0.02,
        "{:?} {ptd90}",
        b.values.ptd90_ms
    );
    assert_eq!(
        (b.values.edp_mmhg, b.time_points.t2_ms),
        (Some(8.0), Some(210.0))
    );
    assert_eq!((b.values.sv_ml, b.flags.len()), (None, 0));
}

#[test]
fn an_atrial_kick_above_the_level_ends_at_the_foot_of_the_upstroke() {
    // The 10 % level of a pulse from 2 to 127 mmHg is 14.5: the end-diastolic 17 mmHg lie above it, from the kick on.
    let p = |t: f64| {
        if !(210.0..=720.0).contains(&t) {
            pressure(t) + 9.0
        } else {
            pressure(t)
        }
    };
    let trace = sampled(Quantity::Pressure, 1.0, |t| {
        if t > 400.0 && t < 700.0 { 2.0 } else { p(t) }
    });
    let [wrapped, single] = [periodic(), Continuation::Single]
        .map(|continuation| BeatBiomarkers::of(Some(&trace), None, continuation).unwrap());
    // 2.5 mmHg at a five-hundredth of 125 mmHg per ms below the foot at 60 ms, which the upstroke leaves a little later.
    let t1 = wrapped.time_points.t1_ms.unwrap();
    assert!((50.0..56.0).contains(&t1), "{t1}");
    assert_eq!(
        (single.time_points.t1_ms, single.values.ptd90_ms),
        (wrapped.time_points.t1_ms, wrapped.values.ptd90_ms)
    );
    assert_eq!(
        [wrapped.flags, single.flags],
        [
            [Flag::PressureRiseNotReached],
            [Flag::PressureRiseNotReached]
        ]
    );
}

#[test]
fn an_upstroke_from_the_first_sample_on_begins_before_the_beat() {
    let values: Vec<f64> = (0..=400).map(|t| pressure(f64::from(t) + 100.0)).collect();
    let b = BeatBiomarkers::of(
        Some(&Trace::uniform(Quantity::Pressure, 1.0, values).unwrap()),
        None,
        Continuation::Single,
    )
    .unwrap();
    assert!(b.time_points.t1_ms.unwrap() < 0.0);
    assert_eq!(
        b.flags,
        [Flag::PressureRiseNotReached, Flag::PressureRiseBeforeBeat]
    );
}

#[test]
fn pressure_that_does_not_fall_ends_with_the_beat() {
    let cut: Vec<f64> = (0..=300).map(|t| pressure(f64::from(t))).collect();
    let b = BeatBiomarkers::of(
        Some(&Trace::uniform(Quantity::Pressure, 1.0, cut).unwrap()),
        None,
        Continuation::Single,
    )
    .unwrap();
    assert_eq!(
        (b.time_points.t3_ms, b.flags.clone()),
        (Some(300.0), vec![Flag::PressureFallNotReached])
    );
}

#[test]
fn a_flat_or_rising_pressure_is_flagged() {
    for f in [|_: f64| 8.0, |t: f64| t] {
        let b = BeatBiomarkers::of(
            Some(&sampled(Quantity::Pressure, 1.0, f)),
            None,
            Continuation::Single,
        )
        .unwrap();
        assert!(b.has(Flag::NoPressurePulse), "{b:?}");
    }
}

#[test]
fn volume_biomarkers_of_known_exponentials() {
    let f = |t: f64| volume(t, 70.0, 45.0);
    for continuation in [periodic(), Continuation::Single] {
        let b = BeatBiomarkers::of(None, Some(&sampled(Quantity::Volume, 1.0, f)), continuation)
            .unwrap();
        assert!((b.values.sv_ml.unwrap() - 70.0).abs() < 0.1);
        assert_eq!(b.values.edv_ml, Some(120.0));
        // Offset by the 2 % that are left: −d ln(x + 0.02)/dt is smaller than that of x, so the fitted constant is.
        assert!(
            (b.values.tau_vd_ms.unwrap() / 70.0 - 0.931).abs() < 0.005,
            "{:?}",
            b.values.tau_vd_ms
        );
        assert!((b.time_points.t4_ms.unwrap() - 50.0).abs() <= 1.0);
        // Filling asymptotes to 58 mL, 80 % of SV are 56: nearly the whole exponential.
        assert!(
            (b.values.tau_vr_ms.unwrap() / 45.0 - 1.0).abs() < 0.15,
            "{:?}",
            b.values.tau_vr_ms
        );
        assert!(b.flags.is_empty(), "{:?}", b.flags);
    }
}

#[test]
fn an_exponential_is_recovered() {
    // V − min V = SV e^{−t/τ} down to the last sample, where it jumps to the minimum: the regression is exact but
    // for its two ends, where the crossing is found by linear interpolation.
    let tau = 60.0;
    let v = |t: f64| {
        if t < 200.0 {
            50.0 + 70.0 * (-t / tau).exp()
        } else {
            50.0
        }
    };
    let b = BeatBiomarkers::of(
        None,
        Some(&sampled(Quantity::Volume, 1.0, v)),
        Continuation::Single,
    )
    .unwrap();
    assert!((b.values.tau_vd_ms.unwrap() - tau).abs() < 1e-4);
    assert!((199.0..=200.0).contains(&b.time_points.t5_ms.unwrap()));
    assert!(b.has(Flag::FillingTooShort));
}

#[test]
fn filling_that_does_not_recover_ends_with_the_beat() {
    let values: Vec<f64> = (0..=330)
        .map(|t| volume(f64::from(t) + 60.0, 70.0, 200.0))
        .collect();
    let trace = Trace::uniform(Quantity::Volume, 1.0, values).unwrap();
    let b = BeatBiomarkers::of(None, Some(&trace), Continuation::Single).unwrap();
    assert!(b.has(Flag::FillingNotRecovered), "{b:?}");
    assert_eq!(b.time_points.t7_ms, Some(330.0));
    let gap = b
        .clone()
        .with_gap_to(Ml(120.0))
        .values
        .end_of_beat_gap_ml
        .unwrap();
    assert_eq!(gap, 120.0 - b.v_end_ml.unwrap());
}

#[test]
fn a_beat_that_ends_fuller_than_it_began_still_has_its_ejection() {
    let tau = 60.0;
    let v = |t: f64| {
        if t < 200.0 {
            60.0 + 40.0 * (-t / tau).exp()
        } else {
            60.0 + (t - 200.0) * 0.1
        }
    };
    let b = BeatBiomarkers::of(
        None,
        Some(&sampled(Quantity::Volume, 1.0, v)),
        Continuation::Single,
    )
    .unwrap();
    assert!(b.values.edv_ml.unwrap() < b.values.esv_ml.unwrap() + 0.9 * b.values.sv_ml.unwrap());
    assert!((b.values.tau_vd_ms.unwrap() - tau).abs() < 1e-4, "{b:?}");
}

#[test]
fn a_ventricle_that_never_ejects_is_flagged() {
    let b = BeatBiomarkers::of(
        None,
        Some(&sampled(Quantity::Volume, 1.0, |_| 100.0)),
        Continuation::Single,
    )
    .unwrap();
    assert_eq!(
        (b.values.sv_ml, b.flags),
        (Some(0.0), vec![Flag::NoEjection])
    );
}

#[test]
fn swapped_traces_are_refused() {
    let v = sampled(Quantity::Volume, 1.0, |t| volume(t, 70.0, 45.0));
    assert!(matches!(
        BeatBiomarkers::of(Some(&v), None, periodic()),
        Err(BiomarkerError::Quantity { .. })
    ));
}

#[test]
fn both_traces_of_a_beat_give_every_biomarker_and_time_point() {
    let p = sampled(Quantity::Pressure, 1.0, pressure);
    let v = sampled(Quantity::Volume, 1.0, |t| volume(t, 70.0, 45.0));
    let b = BeatBiomarkers::of(Some(&p), Some(&v), periodic())
        .unwrap()
        .with_gap_to(Ml(120.0));
    for biomarker in Biomarker::ALL {
        assert!(b.values.get(biomarker).is_some(), "{biomarker}");
    }
    let t = b.time_points;
    let times = [
        t.t1_ms, t.t2_ms, t.t3_ms, t.t4_ms, t.t5_ms, t.t6_ms, t.t7_ms,
    ];
    assert!(times.iter().all(Option::is_some), "{t:?}");
}

proptest! {
    #[test]
    fn finer_sampling_changes_biomarkers_little(tau_vd in 50.0..90.0f64, tau_vr in 30.0..60.0f64, step in 0.1..0.9f64) {
        let step = CYCLE_MS / (CYCLE_MS / step).round();
        let at = |s: f64| BeatBiomarkers::of_samples(
            Some(&sampled(Quantity::Pressure, s, pressure)),
            Some(&sampled(Quantity::Volume, s, |t| volume(t, tau_vd, tau_vr))), periodic()).unwrap();
        let (coarse, fine) = (at(1.0), at(step));
        let close = |a: f64, b: f64, relative: f64| (a - b).abs() <= relative * b.abs();
        prop_assert!(close(coarse.values.p_max_mmhg.unwrap(), fine.values.p_max_mmhg.unwrap(), 1e-4));
        prop_assert!(close(coarse.values.dpdt_max_mmhg_per_ms.unwrap(), fine.values.dpdt_max_mmhg_per_ms.unwrap(), 1e-3));
        prop_assert!(close(coarse.values.ptd90_ms.unwrap(), fine.values.ptd90_ms.unwrap(), 1e-3));
        prop_assert!(close(coarse.values.sv_ml.unwrap(), fine.values.sv_ml.unwrap(), 1e-3));
        prop_assert!(close(coarse.values.tau_vd_ms.unwrap(), fine.values.tau_vd_ms.unwrap(), 0.01));
        prop_assert!(close(coarse.values.tau_vr_ms.unwrap(), fine.values.tau_vr_ms.unwrap(), 0.02));
    }

    #[test]
    fn shifting_time_of_a_periodic_trace_moves_only_time(shift in 0usize..800) {
        let p = sampled(Quantity::Pressure, 1.0, pressure);
        let v = sampled(Quantity::Volume, 1.0, |t| volume(t, 70.0, 45.0));
        let rotate = |t: &Trace| {
            let mut values = t.values().to_vec();
            values.rotate_left(shift);
            Trace::uniform(t.quantity(), 1.0, values).unwrap()
        };
        let a = BeatBiomarkers::of(Some(&p), Some(&v), periodic()).unwrap();
        let b = BeatBiomarkers::of(Some(&rotate(&p)), Some(&rotate(&v)), periodic()).unwrap();
        prop_assert!((a.values.ptd90_ms.unwrap() - b.values.ptd90_ms.unwrap()).abs() < 1e-9);
        prop_assert!((a.values.tau_vd_ms.unwrap() - b.values.tau_vd_ms.unwrap()).abs() < 1e-9);
        prop_assert!((a.values.tau_vr_ms.unwrap() - b.values.tau_vr_ms.unwrap()).abs() < 1e-9);
        prop_assert_eq!(a.values.dpdt_max_mmhg_per_ms, b.values.dpdt_max_mmhg_per_ms);
        prop_assert_eq!(a.values.dpdt_min_mmhg_per_ms, b.values.dpdt_min_mmhg_per_ms);
        let moved = (a.time_points.t1_ms.unwrap() - b.time_points.t1_ms.unwrap() - shift as f64) / CYCLE_MS;
        prop_assert!((moved - moved.round()).abs() < 1e-9);
    }
}
