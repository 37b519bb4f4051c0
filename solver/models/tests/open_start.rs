//! A beat that begins with an open mitral valve: the filling pressure is above the end-diastolic one.

use cardiotwin_models::beat::{BeatOutcome, BeatSettings, Beats, run_beats};
use cardiotwin_models::circulation::LeftHeart;
use cardiotwin_models::periodic::FitSubject;
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_units::{Ml, Mmhg, Ms};

const CYCLE: Ms = Ms(800.0);

fn beats(above_mmhg: f64, beats: Beats) -> cardiotwin_models::beat::BeatResult {
    let subject = FitSubject::new(CYCLE, Ml(110.0));
    let mut values = FitSubject::typical();
    let mut model = subject.model(&values, &[]).expect("typical values");
    let edp = model.ventricle.pressure();
    values[0] = edp.0 + above_mmhg;
    model = subject.model(&values, &[]).expect("typical values");
    assert_eq!(model.ventricle.pressure(), edp);
    let settings = BeatSettings {
        beats,
        ..BeatSettings::one_beat(CYCLE)
    };
    match run_beats(&mut model.ventricle, &mut model.circulation, &settings) {
        BeatOutcome::Finished(result) => *result,
        BeatOutcome::Diverged { reason, .. } => panic!("{reason}"),
    }
}

#[test]
fn filling_goes_on_until_the_pressure_rises() {
    for above in [0.5, 3.0, 10.0] {
        let result = beats(above, Beats::Exactly(1));
        assert!(result.succeeded(), "{above}: {:?}", result.checks);
        assert_eq!(result.work.n_cut, 0);
        let traces = &result.traces;
        let (atrium, p) = (traces.left_atrial_pressure_mmhg[1], &traces.pressure_mmhg);
        // The first step is in balance already: flow, pressures and valve belong together.
        let flow = (atrium - p[1]) / LeftHeart::FORWARD.0;
        assert!(traces.mitral_open[1] && flow > 0.0);
        assert!((traces.mitral_flow_ml_per_s[1] - flow).abs() < 1e-6 * flow);
        let gained = traces.volume_ml[1] - traces.volume_ml[0];
        assert!((gained - 1e-3 * traces.net_inflow_ml_per_s[1]).abs() < 1e-6);
        // Pressure rises at once: nothing jumps, and the valve closes before the aortic one opens.
        let jump = (p[1] - p[0]).abs();
        assert!(jump < 1.0, "{above}: {jump} mmHg in the first step");
        let closes = (1..p.len()).find(|i| !traces.mitral_open[*i]);
        let opens = traces.aortic_open.iter().position(|open| *open);
        assert!(closes < opens, "{closes:?} {opens:?}");
    }
}

#[test]
fn higher_filling_gives_a_larger_periodic_beat() {
    let limit = Beats::UntilPeriodic {
        limit: 60,
        volume: Ml(1e-3),
        pressure: Mmhg(1e-3),
    };
    let stroke = |above: f64| {
        let result = beats(above, limit);
        assert_eq!(result.periodic, Some(true));
        let range = |(l, h): (f64, f64), v: &f64| (v.min(l), v.max(h));
        let (low, high) = (result.traces.volume_ml.iter()).fold((f64::MAX, 0.0), range);
        high - low
    };
    let strokes = [-2.0, 0.5, 3.0].map(stroke);
    assert!(
        strokes[0] < strokes[1] && strokes[1] < strokes[2],
        "{strokes:?}"
    );
}
