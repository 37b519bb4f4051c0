//! No biomarker jumps: traces shifted, scaled and perturbed, each change bounded by a stated constant times the
//! perturbation; and sweeps through the places where a literal crossing jumps.

use cardiotwin_signals::{
    BeatBiomarkers, Continuation, Flag, Quantity, Trace, read_trace, resample,
};
use cardiotwin_units::Ms;
use proptest::prelude::*;
use std::path::Path;

/// Largest change of PTD90, ms per unit of perturbation over the pressure's amplitude A. Either crossing moves by at most
/// (ε + δ)/rate with δ ≤ ε the change of the level and rate = A/500 ms, which is 1000; the rate itself changes by at most
/// 2 ε/A, which moves an extension of up to 0.4 A, 200 ms long, by 400.
const PTD90_MS: f64 = 2.0 * (1000.0 + 400.0);
/// Relative change of a time constant per unit of perturbation over the stroke volume, at most.
const TAU: f64 = 60.0;

const COHORT: [&str; 7] = [
    "01-CoA", "02-CoA", "03-CoA", "04-CoA", "05-CoA", "06-CoA", "07-CoA",
];
const CYCLES_MS: [f64; 7] = [659.0, 1231.0, 917.0, 631.0, 654.0, 697.0, 852.0];

/// Pressure and volume of a patient at 1 ms.
fn patient(k: usize) -> (Trace, Trace, Continuation) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../examples/coa-seven/patients")
        .join(COHORT[k]);
    let continuation = Continuation::periodic(Ms(CYCLES_MS[k]));
    let read = |file: &str, quantity| {
        let trace = read_trace(&folder.join(file), quantity).trace.unwrap();
        resample(&trace, continuation, Ms(1.0)).unwrap()
    };
    (
        read("pressure.csv", Quantity::Pressure),
        read("volume.csv", Quantity::Volume),
        continuation,
    )
}

/// The trace with each sample and its time changed.
fn changed(trace: &Trace, change: impl Fn(usize, f64) -> f64) -> Trace {
    let values = trace
        .values()
        .iter()
        .enumerate()
        .map(|(i, v)| change(i, *v))
        .collect();
    Trace::new(trace.quantity(), trace.time_ms().to_vec(), values).unwrap()
}

fn amplitude(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - values.iter().copied().fold(f64::INFINITY, f64::min)
}

fn of(pressure: &Trace, volume: &Trace, continuation: Continuation) -> BeatBiomarkers {
    BeatBiomarkers::of_samples(Some(pressure), Some(volume), continuation).unwrap()
}

/// Values that a perturbation must move little: P_max, rates, PTD90, SV, tau_VD, tau_VR.
fn values(b: &BeatBiomarkers) -> [f64; 7] {
    [
        b.values.p_max_mmhg.unwrap(),
        b.values.dpdt_max_mmhg_per_ms.unwrap(),
        b.values.dpdt_min_mmhg_per_ms.unwrap(),
        b.values.ptd90_ms.unwrap(),
        b.values.sv_ml.unwrap(),
        b.values.tau_vd_ms.unwrap(),
        b.values.tau_vr_ms.unwrap(),
    ]
}

/// Each change over its bound, for samples moved by up to `p` mmHg and `v` mL.
fn over_bounds(
    a: &BeatBiomarkers,
    b: &BeatBiomarkers,
    amplitude: f64,
    [p, v]: [f64; 2],
) -> [f64; 7] {
    let ([a, b], sv) = ([values(a), values(b)], a.values.sv_ml.unwrap());
    let bounds = [
        p,
        p,
        p,
        PTD90_MS * p / amplitude,
        2.0 * v,
        TAU * v / sv * a[5],
        TAU * v / sv * a[6],
    ];
    std::array::from_fn(|k| (b[k] - a[k]).abs() / (bounds[k] + 1e-9))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn a_small_perturbation_moves_every_biomarker_little(
        k in 0usize..7, share in -5.0..-2.0f64, noise in prop::collection::vec(-1.0..1.0f64, 1231),
        wave in 0usize..200, smooth in 0.0..1.0f64,
    ) {
        let (p, v, continuation) = patient(k);
        let share = 10.0f64.powf(share);
        let shape = |i: usize| smooth * (i as f64 * wave as f64 / 100.0).sin() + (1.0 - smooth) * noise[i];
        let size = [share * amplitude(p.values()), share * amplitude(v.values())];
        let moved = |t: &Trace, size: f64| changed(t, |i, x| x + size * shape(i));
        let (a, b) = (of(&p, &v, continuation), of(&moved(&p, size[0]), &moved(&v, size[1]), continuation));
        let over = over_bounds(&a, &b, amplitude(p.values()), size);
        prop_assert!(over.iter().all(|x| *x <= 1.0), "{:?}: {:?}", COHORT[k], over);
    }

    #[test]
    fn neither_the_begin_of_a_periodic_trace_nor_its_scale_matters(
        k in 0usize..7, shift in 0usize..1231, scale in 0.3..3.0f64, offset in -20.0..50.0f64,
    ) {
        let (p, v, continuation) = patient(k);
        // Samples of a cycle of whole milliseconds lie alike wherever it begins.
        let n = p.n_samples();
        let rotated = |t: &Trace| changed(t, |i, _| scale * t.values()[(i + shift) % n] + offset);
        let (a, b) = (values(&of(&p, &v, continuation)), values(&of(&rotated(&p), &rotated(&v), continuation)));
        let expected = [a[0] * scale + offset, a[1] * scale, a[2] * scale, a[3], a[4] * scale, a[5], a[6]];
        for (x, y) in b.iter().zip(expected) {
            prop_assert!((x - y).abs() <= 1e-9 * (1.0 + y.abs()), "{:?} {:?}", b, expected);
        }
    }
}

/// The note's case: a lower pressure in early diastole sends the 10 % level below end-diastolic pressure.
#[test]
fn a_level_that_sinks_through_end_diastolic_pressure_moves_ptd90_smoothly() {
    for (k, id) in COHORT.into_iter().enumerate() {
        let (p, v, periodic) = patient(k);
        let fall = of(&p, &v, periodic).time_points.t3_ms.unwrap();
        let dip = |depth: f64| {
            changed(&p, |i, x| {
                x - depth * (-((i as f64 - fall - 60.0) / 20.0).powi(2)).exp()
            })
        };
        for continuation in [periodic, Continuation::Single] {
            let at = |depth: f64| of(&dip(depth), &v, continuation);
            let mut before = at(0.0);
            assert!(!before.has(Flag::PressureRiseNotReached));
            let step = 0.02;
            for i in 1..=500 {
                let b = at(f64::from(i) * step);
                let over = over_bounds(&before, &b, amplitude(p.values()), [step, 0.0])[3];
                assert!(
                    over <= 1.0,
                    "{id} at {}: {over} times the bound",
                    f64::from(i) * step
                );
                before = b;
            }
            assert!(
                before.has(Flag::PressureRiseNotReached),
                "{id}: the level passed no pressure"
            );
        }
    }
}

/// Diastasis near 72 % of the stroke volume, where the window of τ_VR ends: before or after the atrial kick.
#[test]
fn a_diastasis_that_passes_the_window_moves_tau_vr_smoothly() {
    let volume = |filled: f64| {
        let v = move |t: f64| {
            let ejected = 70.0 * (1.0 - (-(t - 60.0).clamp(0.0, 250.0) / 70.0).exp());
            let early = filled * 70.0 * (1.0 - (-(t - 380.0).max(0.0) / 45.0).exp());
            let kick = (70.0 - filled * 70.0) * ((t - 850.0) / 100.0).clamp(0.0, 1.0);
            120.0 - ejected + early + kick
        };
        Trace::uniform(
            Quantity::Volume,
            1.0,
            (0..1000).map(|t| v(f64::from(t))).collect(),
        )
        .unwrap()
    };
    let tau = |filled: f64| {
        let continuation = Continuation::periodic(Ms(1000.0));
        BeatBiomarkers::of_samples(None, Some(&volume(filled)), continuation)
            .unwrap()
            .values
            .tau_vr_ms
            .unwrap()
    };
    let (step, mut before) = (2e-4, tau(0.66));
    for i in 1..=400 {
        let now = tau(0.66 + f64::from(i) * step);
        assert!(
            (now / before - 1.0).abs() <= TAU * step,
            "{before} to {now} ms at {}",
            0.66 + f64::from(i) * step
        );
        before = now;
    }
}
