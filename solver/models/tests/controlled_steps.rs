//! Controlled steps: their error follows their tolerance, and a run continues from where it stood.

use std::ops::ControlFlow;

use cardiotwin_models::beat::{
    BeatOutcome, BeatResult, BeatSettings, Beats, RunProgress, run_beats, run_observed,
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
