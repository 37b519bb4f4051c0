//! Controlled steps: their error follows their tolerance, and a run continues from where it stood.

use std::ops::ControlFlow;

use cardiotwin_models::beat::{
    BeatOutcome, BeatResult, BeatSettings, BeatTraces, Beats, RunProgress, run_beats, run_observed,
};
use cardiotwin_models::circulation::LeftHeart;
use cardiotwin_models::circulation::left_heart::AORTA;
use cardiotwin_models::periodic::FitSubject;
use cardiotwin_models::step_control::StepControl;
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_units::{Ml, Mmhg, Ms};

const CYCLE: Ms = Ms(800.0);

fn subject() -> FitSubject {
    FitSubject::new(CYCLE, Ml(110.0))
}

fn settings(step_ms: f64, longest_ms: f64, tolerance_per_s: f64) -> BeatSettings {
    BeatSettings {
        step: Ms(step_ms),
        control: Some(StepControl {
            longest: Ms(longest_ms),
            tolerance_per_s,
        }),
        ..BeatSettings::one_beat(CYCLE)
    }
}

fn beat(settings: &BeatSettings) -> BeatResult {
    let mut model = subject()
        .model(&FitSubject::typical(), &[])
        .expect("typical values");
    match run_beats(&mut model.ventricle, &mut model.circulation, settings) {
        BeatOutcome::Finished(result) => {
            assert!(result.succeeded(), "{:?}", result.checks);
            *result
        }
        BeatOutcome::Diverged { reason, .. } => panic!("{reason}"),
    }
}

/// Largest error of the volume \[mL\] at every eighth millisecond.
fn error(result: &BeatResult, exact: &BeatResult) -> f64 {
    let at = |result: &BeatResult| -> Vec<f64> {
        let every = (8.0 / result.traces.time_ms[1]).round() as usize;
        result
            .traces
            .volume_ml
            .iter()
            .step_by(every)
            .copied()
            .collect()
    };
    let (values, exact) = (at(result), at(exact));
    assert_eq!(values.len(), exact.len());
    values
        .iter()
        .zip(&exact)
        .fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

/// Steps of one length under the rule of second order: the longest is the output interval.
fn uniform(step_ms: f64) -> BeatResult {
    beat(&settings(step_ms, step_ms, 1e9))
}

#[test]
fn the_circulation_is_of_second_order() {
    // A cavity whose pressure keeps the aortic valve open.
    let at = |step_ms: f64| {
        let heart = LeftHeart::of_an_adult(Mmhg(9.0), CYCLE);
        let mut blood = heart.build().expect("an adult's");
        let cavity = |t_ms: f64| Mmhg(150.0 + 5.0 * (t_ms / 40.0).sin());
        blood.set_start_weight(0.5);
        blood.begin_flows(cavity(0.0));
        for k in 1..=(160.0 / step_ms) as i32 {
            blood
                .try_step(cavity(f64::from(k) * step_ms), Ms(step_ms))
                .expect("a step");
            blood.commit();
        }
        let aorta = blood.compartment_idx(AORTA).expect("there is one");
        (blood.net_volume_in().0, blood.pressure(aorta).0)
    };
    let exact = at(1.0 / 64.0);
    let errors = [4.0, 2.0, 1.0].map(|step_ms| {
        let (volume, pressure) = at(step_ms);
        [volume - exact.0, pressure - exact.1].map(f64::abs)
    });
    for pair in errors.windows(2) {
        for (long, short) in pair[0].into_iter().zip(pair[1]) {
            let order = (long / short).log2();
            assert!((1.8..2.2).contains(&order), "{errors:?}");
        }
    }
}

#[test]
fn a_beat_is_of_second_order() {
    let exact = uniform(1.0 / 64.0);
    let errors = [2.0, 1.0, 0.5].map(|step_ms| error(&uniform(step_ms), &exact));
    // Valves move anywhere within a step, so that one halving may bring more than the next.
    let order = 0.5 * (errors[0] / errors[2]).log2();
    assert!((1.6..2.4).contains(&order), "{errors:?}");
    let first_order = beat(&BeatSettings {
        step: Ms(0.5),
        ..BeatSettings::one_beat(CYCLE)
    });
    assert!(error(&first_order, &exact) > 4.0 * errors[2], "{errors:?}");
}

#[test]
fn half_the_tolerance_is_half_the_error() {
    let exact = uniform(1.0 / 64.0);
    let runs =
        [64.0, 32.0, 16.0, 8.0, 4.0].map(|tolerance| beat(&settings(0.0625, 16.0, tolerance)));
    let errors = runs.each_ref().map(|run| error(run, &exact));
    let steps = runs.each_ref().map(|run| run.work.n_steps);
    // Lengths are powers of two, so that one halving may change little and the next much.
    let per_halving = (errors[0] / errors[4]).powf(0.25);
    assert!(
        (1.6..2.6).contains(&per_halving),
        "{errors:?} in {steps:?} steps"
    );
    assert!(steps.is_sorted(), "{steps:?}");
}

#[test]
fn long_steps_leave_every_sample_in_place() {
    let (every, long) = (uniform(1.0), beat(&settings(1.0, 8.0, 5.0)));
    assert!(
        2 * long.work.n_steps < every.work.n_steps,
        "{:?}",
        long.work
    );
    assert_eq!(long.traces.time_ms, every.traces.time_ms);
    assert!(error(&long, &every) < 0.1, "{}", error(&long, &every));
}

/// Sample at the end of each step of a beat, zero first.
fn ends_of_steps(settings: &BeatSettings) -> (Vec<usize>, BeatResult) {
    let mut model = subject()
        .model(&FitSubject::typical(), &[])
        .expect("typical values");
    let mut ends = vec![0];
    let outcome = run_observed(
        &mut model.ventricle,
        &mut model.circulation,
        settings,
        None,
        |seen| {
            ends.push(seen.progress.intervals);
            ControlFlow::<()>::Continue(())
        },
    );
    match outcome {
        ControlFlow::Continue(BeatOutcome::Finished(result)) => (ends, *result),
        _ => panic!("the beat ends"),
    }
}

#[test]
fn steps_are_short_in_isovolumic_contraction() {
    // A tolerance that would allow long steps everywhere.
    let (ends, result) = ends_of_steps(&settings(1.0, 8.0, 1e9));
    let BeatTraces {
        pressure_mmhg: p,
        aortic_open,
        mitral_open,
        ..
    } = &result.traces;
    let (mut contracting, mut long) = (0, 0);
    for step in ends.windows(2) {
        let (begin, end) = (step[0], step[1]);
        let is_closed = !(aortic_open[begin] || mitral_open[begin]);
        if is_closed && begin > 0 && p[begin] >= p[begin - 1] {
            contracting += 1;
            assert_eq!(end - begin, 1, "from {begin} ms");
        }
        long += usize::from(end - begin > 1);
    }
    assert!(contracting > 10 && long > 10, "{contracting} {long}");
    // Two steps of half a millisecond each, and never more in other phases.
    let (intervals, extra) = (ends.len() - 1, result.work.n_steps - (ends.len() - 1));
    assert!(
        (contracting..contracting + 2).contains(&extra),
        "{} steps over {intervals} ends, {contracting} in contraction",
        result.work.n_steps
    );
}

#[test]
fn samples_inside_a_step_are_as_accurate_as_its_ends() {
    let (ends, long) = ends_of_steps(&settings(1.0, 8.0, 5.0));
    let exact = uniform(1.0 / 16.0);
    let (mut at_ends, mut inside, mut of_lines) = (0.0_f64, 0.0_f64, 0.0_f64);
    let (p, fine) = (&long.traces.pressure_mmhg, &exact.traces.pressure_mmhg);
    let valves = |k: usize| (long.traces.aortic_open[k], long.traces.mitral_open[k]);
    for step in ends.windows(3) {
        let (before, begin, end) = (step[0], step[1], step[2]);
        if valves(before) != valves(begin) || valves(begin) != valves(end) {
            continue;
        }
        at_ends = at_ends.max((p[end] - fine[16 * end]).abs());
        for k in begin + 1..end {
            let share = (k - begin) as f64 / (end - begin) as f64;
            let line = p[begin] + share * (p[end] - p[begin]);
            inside = inside.max((p[k] - fine[16 * k]).abs());
            of_lines = of_lines.max((line - fine[16 * k]).abs());
        }
    }
    assert!(
        inside < 1.5 * at_ends && 1.5 * inside < of_lines,
        "ends {at_ends}, inside {inside}, lines {of_lines} mmHg"
    );
    // The volume is the integral of the flows between the samples of a long step.
    let (v, q) = (&long.traces.volume_ml, &long.traces.net_inflow_ml_per_s);
    let of_long = ends.windows(2).filter(|step| step[1] - step[0] > 1);
    for k in of_long.flat_map(|step| step[0] + 1..=step[1]) {
        let dt_ms = long.traces.time_ms[k] - long.traces.time_ms[k - 1];
        let come_in = 1e-3 * dt_ms * 0.5 * (q[k] + q[k - 1]);
        assert!((v[k] - v[k - 1] - come_in).abs() < 1e-6, "at {k} ms");
    }
}

#[test]
fn a_run_goes_on_with_the_same_steps_to_the_bit() {
    let settings = BeatSettings {
        beats: Beats::Exactly(2),
        ..settings(1.0, 8.0, 5.0)
    };
    let model = || {
        subject()
            .model(&FitSubject::typical(), &[])
            .expect("typical values")
    };
    let finished = |outcome| match outcome {
        ControlFlow::Continue(BeatOutcome::Finished(result)) => *result,
        _ => panic!("the run ends"),
    };
    let mut whole = model();
    let uninterrupted = finished(run_observed(
        &mut whole.ventricle,
        &mut whole.circulation,
        &settings,
        None,
        |_| ControlFlow::<()>::Continue(()),
    ));
    for stop_ms in [150.0, 640.0, 1000.0] {
        let mut first = model();
        let stopped = run_observed(
            &mut first.ventricle,
            &mut first.circulation,
            &settings,
            None,
            |seen| {
                if seen.ventricle.time().0 < stop_ms {
                    return ControlFlow::Continue(());
                }
                let (wall, blood) = (seen.ventricle.snapshot(), seen.circulation.snapshot());
                ControlFlow::Break((seen.progress.clone(), wall, blood))
            },
        );
        let ControlFlow::Break((progress, wall, blood)) = stopped else {
            panic!("stopped at {stop_ms} ms")
        };
        let text = serde_json::to_string(&progress).expect("numbers");
        let progress: RunProgress = serde_json::from_str(&text).expect("its own text");
        let mut second = model();
        second.ventricle.restore(&wall).expect("its own snapshot");
        second
            .circulation
            .restore(&blood)
            .expect("its own snapshot");
        let resumed = finished(run_observed(
            &mut second.ventricle,
            &mut second.circulation,
            &settings,
            Some(progress),
            |_| ControlFlow::<()>::Continue(()),
        ));
        assert_eq!(resumed, uninterrupted, "stopped at {stop_ms} ms");
    }
}
