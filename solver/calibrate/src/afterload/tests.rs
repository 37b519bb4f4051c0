use super::*;
use proptest::prelude::*;
use std::f64::consts::TAU;

const LOAD: [f64; 3] = [0.05, 0.9, 1.4];

fn effect(name: &str) -> &'static Effect {
    EFFECTS.iter().find(|e| e.name == name).unwrap()
}

/// Beats with half a sine of ejection over 300 ms of 800 ms, and a backflow when the valve closes.
fn ejections(n_beats: usize, step_ms: f64) -> (Vec<f64>, Vec<f64>) {
    let n = (800.0 * n_beats as f64 / step_ms) as usize;
    let time: Vec<f64> = (0..=n).map(|i| i as f64 * step_ms).collect();
    let at = |t: &f64| match (t - 80.0).rem_euclid(800.0) {
        s if s < 300.0 => 400.0 * (TAU * s / 600.0).sin(),
        s if s < 340.0 => -60.0 * (TAU * (s - 300.0) / 80.0).sin(),
        _ => 0.0,
    };
    (time.clone(), time.iter().map(at).collect())
}

/// A record with the simulated pressure of a load.
fn made(n_beats: usize, three: [f64; 3], terms: &[(&Effect, &[f64])]) -> Record {
    let (time, flow) = ejections(n_beats, 4.0);
    let blank = Record::new(&time, &flow, &time, &vec![80.0; time.len()]).unwrap();
    let pressure = simulate(&blank, three, 85.0, terms);
    Record::new(&time, &flow, &time, &pressure).unwrap()
}

fn example(case: [&str; 2]) -> [(Vec<f64>, Vec<f64>); 2] {
    case.map(|text| {
        text.lines()
            .filter_map(|line| line.split_once(','))
            .filter_map(|(t, v)| Some((t.parse::<f64>().ok()?, v.parse::<f64>().ok()?)))
            .unzip()
    })
}

fn human() -> [(Vec<f64>, Vec<f64>); 2] {
    example([
        include_str!("../../../../examples/afterload/human-1999/flow.csv"),
        include_str!("../../../../examples/afterload/human-1999/pressure.csv"),
    ])
}

/// The reference values come from least squares with exact integration, for a flow that is linear
/// between its samples.
#[test]
fn the_human_record_has_its_reference_values() {
    let [q, p] = human();
    let record = Record::new(&q.0, &q.1, &p.0, &p.1).unwrap();
    let fit = fit_windkessel(&record, WindkesselFitSettings::default()).unwrap();
    for (found, expected) in [
        (fit.r1.value, 0.030_04),
        (fit.r2.value, 0.741_33),
        (fit.compliance.value, 1.832_96),
        (fit.start.value, 72.136),
        (fit.root_mean_square_mmhg, 2.8568),
    ] {
        assert!((found / expected - 1.0).abs() < 3e-4, "{found} {expected}");
    }
    assert_eq!(
        (fit.r1.determined, fit.r2.determined, record.n_beats()),
        (Determined::Well, Determined::Well, 1)
    );
}

/// The reference values come close if samples are paired by index, 5 ms apart, regardless of their
/// time stamps.
#[test]
fn the_porcine_record_has_its_reference_values_when_paired_by_position() {
    let [q, p] = example([
        include_str!("../../../../examples/afterload/porcine-in-vivo/flow-1.csv"),
        include_str!("../../../../examples/afterload/porcine-in-vivo/pressure-1.csv"),
    ]);
    let time: Vec<f64> = (0..q.1.len()).map(|i| 5.0 * i as f64).collect();
    let record = Record::new(&time, &q.1, &time, &p.1).unwrap();
    let fit = fit_windkessel(&record, WindkesselFitSettings::default()).unwrap();
    for (found, expected) in [
        (fit.r1.value, 0.0992),
        (fit.r2.value, 3.455_45),
        (fit.compliance.value, 1.213_97),
        (fit.start.value, 99.178),
        (fit.root_mean_square_mmhg, 4.1443),
    ] {
        assert!((found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
    }
    assert_eq!(record.n_beats(), 5);
}

#[test]
fn a_ramp_of_flow_has_its_closed_form() {
    // C dP/dt = a t − P/R2 from P0: P = R2 a (t − τ) + (P0 + R2 a τ) e^(−t/τ), at samples of any
    // spacing.
    let time: Vec<f64> = (0..60)
        .map(|i| 7.0 * f64::from(i) + 0.05 * f64::from(i * i))
        .collect();
    let flow: Vec<f64> = time.iter().map(|t| 0.5 * t).collect();
    let record = Record::new(&time, &flow, &time, &vec![80.0; 60]).unwrap();
    let tau = LOAD[1] * LOAD[2];
    for (t, p) in time.iter().zip(simulate(&record, LOAD, 85.0, &[])) {
        let (t, a) = (t * 1e-3, 500.0);
        let pc = LOAD[1] * a * (t - tau) + (85.0 + LOAD[1] * a * tau) * (-t / tau).exp();
        assert!((p - pc - LOAD[0] * a * t).abs() < 1e-9, "{t} {p} {pc}");
    }
}

/// A complex number with the operations that impedances need.
#[derive(Clone, Copy)]
struct Z(f64, f64);

impl Z {
    fn plus(self, o: Z) -> Z {
        Z(self.0 + o.0, self.1 + o.1)
    }
    fn times(self, o: Z) -> Z {
        Z(self.0 * o.0 - self.1 * o.1, self.0 * o.1 + self.1 * o.0)
    }
    fn inverse(self) -> Z {
        let n = self.0 * self.0 + self.1 * self.1;
        Z(self.0 / n, -self.1 / n)
    }
    fn turned(angle: f64) -> Z {
        Z(angle.cos(), angle.sin())
    }
}

fn real(x: f64) -> Z {
    Z(x, 0.0)
}

/// The simulated response to a sine agrees with the impedance of each linear effect from circuit
/// theory.
#[test]
fn linear_effects_have_their_impedance() {
    let [r1, r2, c] = LOAD;
    let w = TAU / 0.8 * 3.0;
    let jw = Z(0.0, w);
    let parallel = |a: Z, b: Z| a.inverse().plus(b.inverse()).inverse();
    let shunt = |admittance: Z| real(1.0 / r2).plus(admittance).inverse();
    let plain = shunt(jw.times(real(c)));
    let three = real(r1).plus(plain);
    let (f, l, r) = (0.3, 0.004, 0.05);
    let distal = shunt(jw.times(real((1.0 - f) * c)));
    let split = parallel(
        jw.times(real(f * c)).inverse(),
        jw.times(real(l)).plus(real(r)).plus(distal),
    );
    let (share, tau) = (0.6, 0.15);
    let creep =
        real(1.0 - share).plus(real(share).times(real(1.0).plus(jw.times(real(tau))).inverse()));
    // A tube of impedance R1 and delay T that ends in R1 + (R2 | C) reflects with e^(−2jωT).
    let travel = 0.05;
    let load = real(r1).plus(plain);
    let gamma = load
        .plus(real(-r1))
        .times(load.plus(real(r1)).inverse())
        .times(Z::turned(-2.0 * w * travel));
    let tube = real(r1)
        .times(real(1.0).plus(gamma))
        .times(real(1.0).plus(Z(-gamma.0, -gamma.1)).inverse());
    let (period, damping) = (0.08, 0.3);
    let w0 = TAU / period;
    let filter = real(w0 * w0).times(Z(w0 * w0 - w * w, 2.0 * damping * w0 * w).inverse());
    let expected: [(&str, &[f64], Z); 7] = [
        ("wave_reflection", &[l, f, r], real(r1).plus(split)),
        ("tube_reflection", &[1e3 * travel], tube),
        (
            "parallel_inertance",
            &[10.0],
            plain.plus(parallel(real(r1), jw.times(real(r1 / 10.0)))),
        ),
        (
            "series_inertance",
            &[1e-3],
            three.plus(jw.times(real(1e-3))),
        ),
        (
            "viscoelastic_wall",
            &[share, 1e3 * tau],
            real(r1).plus(shunt(jw.times(real(c)).times(creep))),
        ),
        (
            "timing_misalignment",
            &[20.0],
            three.times(Z::turned(-0.02 * w)),
        ),
        (
            "catheter_response",
            &[1e3 * period, damping],
            three.times(filter),
        ),
    ];
    let time: Vec<f64> = (0..12_000).map(f64::from).collect();
    let flow: Vec<f64> = time
        .iter()
        .map(|t| 80.0 + 60.0 * (w * t * 1e-3).sin())
        .collect();
    let record = Record::new(&time, &flow, &time, &vec![80.0; 12_000]).unwrap();
    for (name, strength, z) in expected {
        let pressure = simulate(&record, LOAD, 76.0, &[(effect(name), strength)]);
        let last = 12_000 - 800..12_000;
        let mean = pressure[last.clone()].iter().sum::<f64>() / 800.0;
        for i in last {
            let (s, co) = (w * time[i] * 1e-3).sin_cos();
            let wave = 60.0 * (z.0 * s + z.1 * co);
            assert!(
                (pressure[i] - mean - wave).abs() < 0.05,
                "{name} at {i}: {} {wave}",
                pressure[i] - mean
            );
        }
    }
}

/// A flow that rises twice in its ejection is one beat where the cycle is known.
#[test]
fn a_flow_with_two_bumps_is_one_cycle() {
    let time: Vec<f64> = (0..900).map(f64::from).collect();
    let bump = |t: f64, from: f64| {
        let inside = (from..from + 150.0).contains(&t);
        f64::from(u8::from(inside)) * 400.0 * ((t - from) * TAU / 300.0).sin()
    };
    let flow: Vec<f64> = (time.iter())
        .map(|t| bump(*t, 50.0) + bump(*t, 280.0))
        .collect();
    let blank = Record::new(&time, &flow, &time, &vec![80.0; 900]).unwrap();
    assert_eq!(blank.n_beats(), 2);
    let blank = blank.of_one_cycle(900.0);
    assert_eq!((blank.n_beats(), blank.cycle_ms()), (1, 900.0));
    let periodic = WindkesselFitSettings {
        start: Start::Periodic,
        ..WindkesselFitSettings::default()
    };
    let mut start = 80.0;
    let pressure = loop {
        let pressure = simulate(&blank, LOAD, start, &[]);
        let end = pressure[899] - LOAD[0] * flow[899];
        if (end - start).abs() < 1e-3 {
            break pressure;
        }
        start = end;
    };
    let fit = fit_windkessel(&blank.with_pressure(pressure), periodic).unwrap();
    for (found, true_value) in [fit.r1, fit.r2, fit.compliance].iter().zip(LOAD) {
        assert!(
            (found.value / true_value - 1.0).abs() < 0.02,
            "{found:?} {true_value}"
        );
    }
}

/// A shift of either zero gives the same pressure as an outflow pressure to round-off, so that the
/// two cannot be distinguished.
#[test]
fn outflow_pressure_and_shifted_zeros_are_one() {
    let (time, flow) = ejections(2, 5.0);
    let blank = |flow: &[f64]| Record::new(&time, flow, &time, &vec![80.0; time.len()]).unwrap();
    let outflow = effect("outflow_pressure");
    let with = simulate(&blank(&flow), LOAD, 85.0, &[(outflow, &[12.0])]);
    let shifted: Vec<f64> = simulate(&blank(&flow), LOAD, 73.0, &[])
        .iter()
        .map(|p| p + 12.0)
        .collect();
    let more: Vec<f64> = flow.iter().map(|q| q + 20.0).collect();
    // Q + q0 into R1 and R2 acts as an outflow pressure of R2 q0 plus a shift of R1 q0, together
    // (R1 + R2) q0.
    let flow_shifted = simulate(&blank(&more), LOAD, 85.0, &[]);
    let q0 = 20.0;
    let as_outflow = simulate(
        &blank(&flow),
        LOAD,
        85.0 + LOAD[0] * q0,
        &[(outflow, &[(LOAD[0] + LOAD[1]) * q0])],
    );
    for i in 0..time.len() {
        assert!((with[i] - shifted[i]).abs() < 1e-9);
        assert!((flow_shifted[i] - as_outflow[i]).abs() < 1e-9);
    }
}

#[test]
fn the_nonlinear_load_joins_the_linear_one_and_bends_away() {
    let (time, flow) = ejections(2, 5.0);
    let record = Record::new(&time, &flow, &time, &vec![80.0; time.len()]).unwrap();
    let stiffening = effect("pressure_dependent_compliance");
    let at = |beta: f64| simulate(&record, LOAD, 85.0, &[(stiffening, &[beta])]);
    let gap = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    assert!(
        gap(&at(0.0), &at(1e-9)) < 1e-5,
        "{}",
        gap(&at(0.0), &at(1e-9))
    );
    assert!(gap(&at(0.0), &at(0.02)) > 1.0);
}

#[test]
fn a_periodic_start_returns_after_its_cycle() {
    let record = made(3, LOAD, &[]);
    let settings = WindkesselFitSettings {
        start: Start::Periodic,
        ..Default::default()
    };
    let (time, flow) = ejections(1, 4.0);
    let periodic = {
        let mut pc = 85.0;
        // Ten time constants of the same cycle reach the periodic state.
        for _ in 0..20 {
            let blank = Record::new(&time, &flow, &time, &vec![80.0; time.len()]).unwrap();
            pc = *simulate(&blank, LOAD, pc, &[]).last().unwrap();
        }
        let blank = Record::new(&time, &flow, &time, &vec![80.0; time.len()]).unwrap();
        Record::new(&time, &flow, &time, &simulate(&blank, LOAD, pc, &[])).unwrap()
    };
    let fit = fit_windkessel(&periodic, settings).unwrap();
    assert!(fit.root_mean_square_mmhg < 1e-4, "{fit:?}");
    for (found, truth) in [
        (fit.r1.value, LOAD[0]),
        (fit.r2.value, LOAD[1]),
        (fit.compliance.value, LOAD[2]),
    ] {
        assert!((found / truth - 1.0).abs() < 1e-3, "{found} {truth}");
    }
    // A record that has not yet reached the periodic state does not fit a periodic start.
    assert!(
        fit_windkessel(&record, settings)
            .unwrap()
            .root_mean_square_mmhg
            > 0.1
    );
}

#[test]
fn little_flow_does_not_determine_the_peripheral_resistance() {
    // All outflow returns: the mean says nothing about R2, and diastole is too short for it.
    let (time, flow) = ejections(1, 4.0);
    let mean = flow.iter().sum::<f64>() / flow.len() as f64;
    let flow: Vec<f64> = flow.iter().map(|q| q - mean).collect();
    let blank = Record::new(&time, &flow, &time, &vec![80.0; time.len()]).unwrap();
    let noisy: Vec<f64> = simulate(&blank, [0.05, 40.0, 1.4], 85.0, &[])
        .iter()
        .enumerate()
        .map(|(i, p)| p + 1.5 * (i as f64 * 0.9).sin() + 1.5 * (i as f64 * 0.13).cos())
        .collect();
    let record = Record::new(&time, &flow, &time, &noisy).unwrap();
    let fit = fit_windkessel(&record, WindkesselFitSettings::default()).unwrap();
    assert_eq!(fit.r2.determined, Determined::Not, "{:?}", fit.r2);
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    let (time, flow) = ejections(1, 4.0);
    let p = vec![80.0; time.len()];
    assert!(matches!(
        Record::new(&time[..9], &flow[..9], &time, &p),
        Err(AfterloadError::Samples { .. })
    ));
    let mut bad = p.clone();
    bad[3] = f64::NAN;
    assert!(matches!(
        Record::new(&time, &flow, &time, &bad),
        Err(AfterloadError::Sample { idx: 3, .. })
    ));
    let still = vec![90.0; time.len()];
    assert!(matches!(
        Record::new(&time, &still, &time, &p),
        Err(AfterloadError::NoEjection { .. })
    ));
    let later: Vec<f64> = time.iter().map(|t| t + 5000.0).collect();
    assert!(matches!(
        Record::new(&time, &flow, &later, &p),
        Err(AfterloadError::Overlap { n_samples: 0, .. })
    ));
    let record = made(1, LOAD, &[]);
    let settings = WindkesselFitSettings {
        confidence_level: 1.0,
        ..Default::default()
    };
    assert!(matches!(
        fit_windkessel(&record, settings),
        Err(AfterloadError::Confidence { .. })
    ));
}

#[test]
fn pressures_without_flow_are_left_out() {
    let (time, flow) = ejections(2, 4.0);
    let record = Record::new(&time[..300], &flow[..300], &time, &vec![80.0; time.len()]).unwrap();
    assert_eq!(
        (record.n_samples(), record.n_dropped()),
        (301, time.len() - 301)
    );
}

/// Deterministic noise: two incommensurate sines of half a millimetre of mercury.
fn noise(i: usize) -> f64 {
    0.5 * ((i as f64 * 1.7).sin() + (i as f64 * 0.61).cos())
}

fn discovered(terms: &[(&Effect, &[f64])]) -> Discovery {
    let record = made(3, LOAD, terms);
    let noisy = record
        .pressure_samples()
        .iter()
        .enumerate()
        .map(|(i, (_, p))| p + noise(i))
        .collect();
    discover(&record.with_pressure(noisy), &DiscoverySettings::default()).unwrap()
}

#[test]
fn nothing_missing_is_called_nothing() {
    let found = discovered(&[]);
    assert!(
        found.accepted.is_empty() && found.unexplained.is_none(),
        "{:?}",
        found.stages[0].candidates
    );
    assert_eq!(found.gap.before_mmhg, found.gap.after_mmhg);
}

#[test]
fn what_is_missing_is_named_with_its_strength_and_the_gap_closes() {
    let cases: [(&str, &[f64]); 3] = [
        ("tube_reflection", &[40.0]),
        ("wave_reflection", &[0.004, 0.3, 0.05]),
        ("timing_misalignment", &[-25.0]),
    ];
    for (name, strength) in cases {
        let found = discovered(&[(effect(name), strength)]);
        let names: Vec<_> = found.accepted.iter().map(|f| f.effect.name).collect();
        assert_eq!(names, [name]);
        let fitted = found.accepted[0].strength[0].1;
        assert!((fitted / strength[0] - 1.0).abs() < 0.1, "{name}: {fitted}");
        let gap = found.gap;
        assert!(
            gap.by_beat && gap.held_out_after_mmhg < 0.6 * gap.held_out_before_mmhg,
            "{name}: {gap:?}"
        );
        assert!(
            (found.after[1] / LOAD[1] - 1.0).abs() < 0.1,
            "{name}: {:?}",
            found.after
        );
    }
}

#[test]
fn an_outflow_pressure_is_not_told_from_a_shifted_zero() {
    let found = discovered(&[(effect("outflow_pressure"), &[45.0])]);
    assert_eq!(found.accepted[0].effect.name, "outflow_pressure");
    let others: Vec<_> = found.confusable.iter().map(|c| c.other).collect();
    assert!(
        others.contains(&"pressure_offset") && others.contains(&"flow_offset"),
        "{others:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// The fit recovers known loads for any two samplings, and the intervals cover them.
    #[test]
    fn loads_are_recovered(r1 in 0.02..0.12f64, r2 in 0.4..3.0f64, tau in 0.6..3.0f64, step in 3.0..9.0f64, late in 0.0..4.0f64) {
        let (time, flow) = ejections(2, 5.0);
        let times: Vec<f64> = (0..(1500.0 / step) as usize).map(|i| late + step * i as f64).collect();
        let three = [r1, r2, tau / r2];
        let blank = Record::new(&time, &flow, &times, &vec![80.0; times.len()]).unwrap();
        let exact = simulate(&blank, three, 85.0, &[]);
        let record = Record::new(&time, &flow, &times, &exact).unwrap();
        let fit = fit_windkessel(&record, WindkesselFitSettings::default()).unwrap();
        for (found, truth) in [(fit.r1, three[0]), (fit.r2, three[1]), (fit.compliance, three[2]), (fit.time_constant, tau)] {
            prop_assert!((found.value / truth - 1.0).abs() < 1e-4, "{found:?} {truth}");
        }
        let noisy: Vec<f64> = exact.iter().enumerate().map(|(i, p)| p + noise(i)).collect();
        let fit = fit_windkessel(&record.with_pressure(noisy), WindkesselFitSettings::default()).unwrap();
        for estimate in [fit.r1, fit.r2, fit.compliance] {
            let (low, high) = (estimate.lower.unwrap_or(0.0), estimate.upper.unwrap_or(f64::INFINITY));
            prop_assert!(low < estimate.value && estimate.value < high, "{estimate:?}");
        }
    }
}
