use super::*;
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_vocabulary::step1::{Step1Parameter, Step1Parameters};
use cardiotwin_vocabulary::step1_settings::{Step1Settings, StopRule, Update};
use proptest::prelude::*;

fn measured() -> Biomarkers {
    Biomarkers {
        p_max_mmhg: Some(120.0),
        dpdt_max_mmhg_per_ms: Some(2.0),
        dpdt_min_mmhg_per_ms: Some(-1.8),
        ptd90_ms: Some(330.0),
        tau_vd_ms: Some(80.0),
        tau_vr_ms: Some(50.0),
        ..Biomarkers::default()
    }
}

/// A heart in which every biomarker is a power of its parameter: the fixed point contracts by 1 −
/// exponent.
fn heart(p: &Step1Parameters, exponent: f64) -> Biomarkers {
    let d = Step1Parameters::default();
    let x = |q: Step1Parameter| (p.get(q) / d.get(q)).powf(exponent);
    Biomarkers {
        p_max_mmhg: Some(95.0 * x(Step1Parameter::SmaxRef)),
        dpdt_max_mmhg_per_ms: Some(1.4 / x(Step1Parameter::TauSrRef)),
        dpdt_min_mmhg_per_ms: Some(-1.1 / x(Step1Parameter::TauSd)),
        ptd90_ms: Some(380.0 * x(Step1Parameter::TCr)),
        tau_vd_ms: Some(60.0 * x(Step1Parameter::RAvF)),
        tau_vr_ms: Some(90.0 * x(Step1Parameter::RMvF)),
        ..Biomarkers::default()
    }
}

/// Runs the loop to its end and fails if the same parameters are requested twice.
fn run(
    settings: &Step1Settings,
    measured: &Biomarkers,
    mut history: History,
    simulate: impl Fn(usize, &Step1Parameters) -> Outcome,
) -> (History, Quality, Ending, Option<usize>) {
    for _ in 0..100 {
        match decide(settings, measured, &history).unwrap() {
            Decision::Next { parameters, .. } => {
                assert!(
                    !history
                        .iterations
                        .iter()
                        .any(|i| i.parameters.same_as(&parameters)),
                    "asked twice"
                );
                let outcome = simulate(history.iterations.len(), &parameters);
                history.push(parameters, outcome);
            }
            Decision::Ended {
                quality,
                because,
                best,
            } => return (history, quality, because, best),
        }
    }
    panic!("the loop did not end");
}

fn healthy(_: usize, p: &Step1Parameters) -> Outcome {
    Outcome::Simulated(heart(p, 0.8))
}

#[test]
fn begins_with_the_initial_guess_and_updates_by_the_papers_ratios() {
    let mut history = History::new(Step1Parameters::default());
    let settings = Step1Settings::default();
    let first = decide(&settings, &measured(), &history).unwrap();
    assert_eq!(
        first,
        Decision::Next {
            parameters: Step1Parameters::default(),
            from: None
        }
    );
    history.push(
        Step1Parameters::default(),
        Outcome::Simulated(heart(&Step1Parameters::default(), 0.8)),
    );
    let Decision::Next {
        parameters: p,
        from,
    } = decide(&settings, &measured(), &history).unwrap()
    else {
        panic!()
    };
    assert_eq!(from, Some(0));
    let expected = [
        100.0 * 120.0 / 95.0,
        40.0 * 1.4 / 2.0,
        110.0 * 1.1 / 1.8,
        550.0 * 330.0 / 380.0,
        0.01 * 80.0 / 60.0,
        0.01 * 50.0 / 90.0,
    ];
    for (parameter, value) in Step1Parameter::ALL.into_iter().zip(expected) {
        assert!(
            (p.get(parameter) / value - 1.0).abs() < 1e-12,
            "{parameter}"
        );
    }
}

#[test]
fn converges_within_the_tolerance_and_names_the_best() {
    let (history, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        healthy,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::Converged, Ending::Tolerance, Some(1))
    );
    assert_eq!(history.iterations.len(), 2);
}

#[test]
fn best_of_limit_goes_on_beyond_the_tolerance() {
    let settings = Step1Settings {
        stop: StopRule::BestOfLimit,
        ..Step1Settings::default()
    };
    let (history, quality, because, best) = run(
        &settings,
        &measured(),
        History::new(Step1Parameters::default()),
        healthy,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::Converged, Ending::Limit, Some(9))
    );
    assert_eq!(history.iterations.len(), 10);
}

#[test]
fn damping_is_an_exponent_of_the_ratios() {
    let mut history = History::new(Step1Parameters::default());
    history.push(
        Step1Parameters::default(),
        healthy(0, &Step1Parameters::default()),
    );
    let settings = Step1Settings {
        damping: 0.5,
        ..Step1Settings::default()
    };
    let Decision::Next { parameters: p, .. } = decide(&settings, &measured(), &history).unwrap()
    else {
        panic!()
    };
    assert!((p.tanh.smax_ref_kpa - 100.0 * (120.0f64 / 95.0).sqrt()).abs() < 1e-9);
    assert!((p.valves.r_mv_f_mmhg_s_per_ml - 0.01 * (50.0f64 / 90.0).sqrt()).abs() < 1e-12);
}

#[test]
fn pressure_alone_leaves_the_valves() {
    let only_pressure = Biomarkers {
        tau_vd_ms: None,
        tau_vr_ms: None,
        ..measured()
    };
    let (history, quality, _, _) = run(
        &Step1Settings::default(),
        &only_pressure,
        History::new(Step1Parameters::default()),
        healthy,
    );
    assert_eq!(quality, Quality::Converged);
    assert!(
        history
            .iterations
            .iter()
            .all(|i| i.parameters.valves.r_av_f_mmhg_s_per_ml == 0.01
                && i.parameters.valves.r_mv_f_mmhg_s_per_ml == 0.01)
    );
    let Outcome::Simulated(b) = history.iterations[1].outcome else {
        panic!()
    };
    assert_eq!(Cost::of(&only_pressure, &b).terms.len(), 4);
}

#[test]
fn cost_is_the_sum_of_squared_relative_differences() {
    let m = Biomarkers {
        tau_vd_ms: None,
        tau_vr_ms: None,
        ..measured()
    };
    let s = Biomarkers {
        p_max_mmhg: Some(108.0),
        dpdt_max_mmhg_per_ms: Some(2.4),
        ..m
    };
    let cost = Cost::of(&m, &s);
    assert!((cost.total - (0.01 + 0.04)).abs() < 1e-12);
    assert!((cost.terms[1].relative_difference + 0.2).abs() < 1e-12);
    // A biomarker that the simulation cannot give counts with a difference of 1, and the cost is
    // finite.
    let none = Cost::of(
        &m,
        &Biomarkers {
            ptd90_ms: None,
            ..m
        },
    );
    assert_eq!(none.total, 1.0);
}

#[test]
fn the_best_iteration_is_that_of_lowest_misfit_among_those_within_the_tolerance() {
    let m = Biomarkers {
        sv_ml: Some(100.0),
        ..measured()
    };
    let beat = |p_max: f64, sv: f64| {
        Outcome::Simulated(Biomarkers {
            p_max_mmhg: Some(p_max),
            sv_ml: Some(sv),
            ..measured()
        })
    };
    let mut history = History::new(Step1Parameters::default());
    // Costs are 0.25, 0 and 0.04; the stroke volume is off by 0, 40 and 5 %.
    for (k, outcome) in [beat(60.0, 100.0), beat(120.0, 60.0), beat(96.0, 95.0)]
        .into_iter()
        .enumerate()
    {
        history.push(
            Step1Parameters::default().with(Step1Parameter::TCr, 400.0 + k as f64),
            outcome,
        );
    }
    let best = |weights: &[(Biomarker, f64)]| match decide(
        &Step1Settings {
            update: Update::SpaceMapping,
            stop: StopRule::FirstConverged,
            weights: weights
                .iter()
                .map(|(b, w)| (b.key().to_owned(), *w))
                .collect(),
            ..Step1Settings::default()
        },
        &m,
        &history,
    ) {
        Ok(Decision::Ended {
            quality: Quality::Converged,
            best,
            ..
        }) => best,
        other => panic!("{other:?}"),
    };
    assert_eq!(best(&[]), Some(1), "the misfit is the cost");
    assert_eq!(
        best(&[(Biomarker::Sv, 1.0)]),
        Some(2),
        "0.04 + 0.05² < 0.4²"
    );
    // The first iteration has a still lower misfit but is outside the tolerance.
    assert_eq!(
        best(&[(Biomarker::PMax, 0.01), (Biomarker::Sv, 9.0)]),
        Some(2)
    );
}

#[test]
fn a_failure_ends_the_loop_with_the_best_earlier_iteration() {
    let stubborn = |k: usize, p: &Step1Parameters| {
        if k == 4 {
            Outcome::Failed
        } else {
            Outcome::Simulated(heart(p, 0.1))
        }
    };
    let (history, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        stubborn,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::FailedAt(4), Ending::Failure, Some(3))
    );
    assert_eq!(history.iterations.len(), 5);

    let at_once = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        |_, _| Outcome::Failed,
    );
    assert_eq!((at_once.1, at_once.3), (Quality::FailedAt(0), None));
}

/// A heart whose valves stay shut while the stress is small: it has biomarkers of pressure only.
fn weak_below(smax_ref_kpa: f64) -> impl Fn(usize, &Step1Parameters) -> Outcome {
    move |_, p| {
        let beat = heart(p, 0.8);
        if p.tanh.smax_ref_kpa < smax_ref_kpa {
            Outcome::NoWholeBeat(Biomarkers {
                tau_vd_ms: None,
                tau_vr_ms: None,
                ..beat
            })
        } else {
            Outcome::Simulated(beat)
        }
    }
}

#[test]
fn early_beats_without_open_valves_lead_on_by_their_pressure() {
    let weak = Step1Parameters::default().with(Step1Parameter::SmaxRef, 30.0);
    let (history, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(weak),
        weak_below(90.0),
    );
    assert_eq!((quality, because), (Quality::Converged, Ending::Tolerance));
    assert!(matches!(
        history.iterations[0].outcome,
        Outcome::NoWholeBeat(_)
    ));
    assert!(matches!(
        history.iterations[best.unwrap()].outcome,
        Outcome::Simulated(_)
    ));
    // Pressure updates its parameters; parameters without a biomarker do not change.
    let second = history.iterations[1].parameters;
    assert!(second.tanh.smax_ref_kpa > 60.0);
    assert_eq!(
        second.valves.r_av_f_mmhg_s_per_ml,
        weak.valves.r_av_f_mmhg_s_per_ml
    );
}

#[test]
fn a_beat_without_open_valves_is_never_the_result() {
    // All pressures match and volume is not measured: the cost alone would report convergence.
    let only_pressure = Biomarkers {
        tau_vd_ms: None,
        tau_vr_ms: None,
        ..measured()
    };
    let shut = |_: usize, _: &Step1Parameters| Outcome::NoWholeBeat(only_pressure);
    let (_, quality, because, best) = run(
        &Step1Settings::default(),
        &only_pressure,
        History::new(Step1Parameters::default()),
        shut,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::Stalled, Ending::NothingNew, None)
    );

    // Three iterations in a row without gain end the loop; the first whole beat is a gain at any
    // cost.
    let far = |k: usize| Biomarkers {
        p_max_mmhg: Some(if k == 3 { 400.0 } else { 90.0 }),
        ..measured()
    };
    let then_whole = |k: usize, _: &Step1Parameters| {
        if k < 3 {
            Outcome::NoWholeBeat(far(k))
        } else {
            Outcome::Simulated(far(k))
        }
    };
    let (history, quality, _, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        then_whole,
    );
    assert_eq!((quality, best), (Quality::Converged, Some(4)));
    assert_eq!(history.iterations.len(), 5);
    let never = |k: usize, _: &Step1Parameters| Outcome::NoWholeBeat(far(k + 4));
    let (history, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        never,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::Stalled, Ending::Stagnation, None)
    );
    assert_eq!(history.iterations.len(), 4);
}

#[test]
fn a_beat_that_loses_its_valves_after_a_whole_one_is_a_failure() {
    let loses = |k: usize, p: &Step1Parameters| {
        let beat = heart(p, 0.1);
        if k == 2 {
            Outcome::NoWholeBeat(beat)
        } else {
            Outcome::Simulated(beat)
        }
    };
    let (_, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        loses,
    );
    assert_eq!(
        (quality, because, best),
        (Quality::FailedAt(2), Ending::Failure, Some(1))
    );
}

#[test]
fn a_rerun_continues_from_the_best_stored_iteration_with_the_new_damping() {
    let stubborn = |k: usize, p: &Step1Parameters| {
        if k == 4 {
            Outcome::Failed
        } else {
            Outcome::Simulated(heart(p, 0.1))
        }
    };
    let (history, _, _, _) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        stubborn,
    );
    let resumed = history.clone().resumed();

    let same = decide(&Step1Settings::default(), &measured(), &resumed).unwrap();
    // Under the same settings the update leads to the failed parameters again, so nothing is left
    // to try.
    assert_eq!(
        same,
        Decision::Ended {
            quality: Quality::FailedAt(4),
            because: Ending::NothingNew,
            best: Some(3)
        }
    );

    let careful = Step1Settings {
        damping: 0.5,
        ..Step1Settings::default()
    };
    let Decision::Next { parameters, from } = decide(&careful, &measured(), &resumed).unwrap()
    else {
        panic!()
    };
    assert_eq!(from, Some(3));
    let Outcome::Simulated(b) = history.iterations[3].outcome else {
        panic!()
    };
    let expected = history.iterations[3].parameters.tanh.smax_ref_kpa
        * (120.0f64 / b.p_max_mmhg.unwrap()).sqrt();
    assert!((parameters.tanh.smax_ref_kpa - expected).abs() < 1e-9);

    let (after, quality, _, best) = run(&careful, &measured(), resumed, |_, p| {
        Outcome::Simulated(heart(p, 0.8))
    });
    assert_eq!(quality, Quality::Converged);
    assert!(best.unwrap() >= 5 && after.iterations.len() > 5);
}

#[test]
fn a_rerun_with_bounds_never_leaves_them() {
    let fails_high = |_: usize, p: &Step1Parameters| {
        if p.tanh.smax_ref_kpa > 150.0 {
            Outcome::Failed
        } else {
            Outcome::Simulated(heart(p, 0.3))
        }
    };
    let (history, quality, _, _) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        fails_high,
    );
    assert!(matches!(quality, Quality::FailedAt(_)), "{quality:?}");
    let bounds = [(Step1Parameter::SmaxRef.key().to_owned(), [80.0, 140.0])].into();
    let settings = Step1Settings {
        bounds,
        ..Step1Settings::default()
    };
    let n = history.iterations.len();
    let (after, quality, _, best) = run(&settings, &measured(), history.resumed(), fails_high);
    assert!(!matches!(quality, Quality::FailedAt(_)));
    assert!(
        after.iterations[n..]
            .iter()
            .all(|i| i.parameters.tanh.smax_ref_kpa <= 140.0)
    );
    assert!(settings.admits(&after.iterations[best.unwrap()].parameters));
}

#[test]
fn a_result_outside_the_new_bounds_does_not_count() {
    let mut history = History::new(Step1Parameters::default());
    history.push(Step1Parameters::default(), Outcome::Simulated(measured()));
    let bounds = [(Step1Parameter::SmaxRef.key().to_owned(), [1.0, 50.0])].into();
    let settings = Step1Settings {
        bounds,
        ..Step1Settings::default()
    };
    let decision = decide(&settings, &measured(), &history.resumed()).unwrap();
    let Decision::Next { parameters, .. } = decision else {
        panic!("{decision:?}")
    };
    assert_eq!(parameters.tanh.smax_ref_kpa, 50.0);
}

#[test]
fn three_in_a_row_without_improvement_stall() {
    let costs = [1.0, 0.9, 0.88, 0.95, 0.87, 0.5];
    let deaf = |k: usize, _: &Step1Parameters| {
        let p_max_mmhg = 120.0 * (1.0 + f64::sqrt(costs[k]));
        Outcome::Simulated(Biomarkers {
            p_max_mmhg: Some(p_max_mmhg),
            ..measured()
        })
    };
    let (history, quality, because, best) = run(
        &Step1Settings::default(),
        &measured(),
        History::new(Step1Parameters::default()),
        deaf,
    );
    assert_eq!((quality, because), (Quality::Stalled, Ending::Stagnation));
    // Misfits 0.88, 0.95 and 0.87 all exceed 0.95 times the best misfit before.
    assert_eq!((history.iterations.len(), best), (5, Some(4)));
}

#[test]
fn with_everything_frozen_there_is_nothing_new() {
    let settings = Step1Settings {
        frozen: Step1Parameter::KEYS.map(str::to_owned).into(),
        ..Step1Settings::default()
    };
    let (history, quality, because, best) = run(
        &settings,
        &measured(),
        History::new(Step1Parameters::default()),
        healthy,
    );
    assert_eq!(
        (history.iterations.len(), quality, because, best),
        (1, Quality::Stalled, Ending::NothingNew, Some(0))
    );
}

#[test]
fn nonsense_is_refused_by_name() {
    let history = History::new(Step1Parameters::default());
    let with = |f: fn(&mut Step1Settings)| {
        let mut s = Step1Settings::default();
        f(&mut s);
        decide(&s, &measured(), &history).unwrap_err().to_string()
    };
    assert!(with(|s| s.damping = 0.0).contains("damping is 0"));
    assert!(with(|s| s.tolerance = f64::NAN).contains("tolerance is NaN"));
    assert!(with(|s| s.max_iterations = 0).contains("max_iterations"));
    assert!(
        with(|s| {
            s.bounds
                .insert(Step1Parameter::TauSd.key().to_owned(), [5.0, 1.0]);
        })
        .contains("tau_SD_ms are 5 to 1")
    );
    assert!(with(|s| s.frozen.push("tau_XX".into())).contains("tau_SR_ref_ms"));
    let mut unknown = Step1Settings {
        update: Update::SpaceMapping,
        ..Step1Settings::default()
    };
    unknown.weights.insert("SV".into(), 1.0);
    let message = validate(&unknown).unwrap_err().to_string();
    assert!(
        message.contains("SV;") && message.contains("SV_mL"),
        "{message}"
    );
    let flipped = Biomarkers {
        dpdt_min_mmhg_per_ms: Some(1.0),
        ..measured()
    };
    assert!(
        decide(&Step1Settings::default(), &flipped, &history)
            .unwrap_err()
            .to_string()
            .contains("negative")
    );
    let missing = Biomarkers {
        ptd90_ms: None,
        ..measured()
    };
    assert!(
        decide(&Step1Settings::default(), &missing, &history)
            .unwrap_err()
            .to_string()
            .contains("PTD90_ms is None")
    );
    let mut beyond = history.clone();
    beyond.resumed_at = 1;
    assert!(matches!(
        decide(&Step1Settings::default(), &measured(), &beyond),
        Err(FixedPointError::ResumedAt {
            resumed_at: 1,
            n_iterations: 0
        })
    ));
}

#[test]
fn a_history_survives_storage() {
    let settings = Step1Settings {
        bounds: [(Step1Parameter::TCr.key().to_owned(), [100.0, 600.0])].into(),
        frozen: vec![Step1Parameter::RMvF.key().to_owned()],
        ..Step1Settings::default()
    };
    let (history, _, _, _) = run(
        &settings,
        &measured(),
        History::new(Step1Parameters::default()),
        healthy,
    );
    let back: History = serde_json::from_str(&serde_json::to_string(&history).unwrap()).unwrap();
    assert_eq!(
        decide(&settings, &measured(), &back),
        decide(&settings, &measured(), &history)
    );
}

proptest! {
    /// For any simulation results, the loop ends, stays within its bounds, requests no parameters
    /// twice and reports the best iteration.
    #[test]
    fn any_simulation_comes_to_an_end(
        values in prop::collection::vec((0.0..3.0f64, -3.0..3.0f64, 0u8..12), 40),
        damping in 0.1..1.0f64, best_of_limit: bool, reruns in 0usize..3,
    ) {
        let simulate = |k: usize, p: &Step1Parameters| {
            let (a, b, kind) = values[k];
            match kind {
                0 => Outcome::Failed,
                1 => Outcome::Simulated(Biomarkers { ptd90_ms: None, tau_vr_ms: None, ..heart(p, a) }),
                3 | 4 => Outcome::NoWholeBeat(Biomarkers { tau_vd_ms: None, tau_vr_ms: None, ..heart(p, a) }),
                2 => Outcome::Simulated(Biomarkers { dpdt_min_mmhg_per_ms: Some(b), p_max_mmhg: Some(f64::NAN), ..heart(p, a) }),
                _ => Outcome::Simulated(heart(p, b)),
            }
        };
        let mut history = History::new(Step1Parameters::default());
        for rerun in 0..=reruns {
            let settings = Step1Settings {
                damping: damping / (1.0 + rerun as f64),
                stop: if best_of_limit { StopRule::BestOfLimit } else { StopRule::FirstConverged },
                ..Step1Settings::default()
            };
            let (after, _, _, best) = run(&settings, &measured(), history.resumed(), simulate);
            prop_assert!(after.iterations.len() - after.resumed_at <= settings.max_iterations as usize);
            prop_assert!(after.iterations.iter().all(|i| settings.admits(&i.parameters)));
            let costs: Vec<f64> = after.iterations.iter().map(|i| match &i.outcome {
                Outcome::Simulated(b) => Cost::of(&measured(), b).total,
                Outcome::NoWholeBeat(_) | Outcome::Failed => f64::INFINITY,
            }).collect();
            if let Some(best) = best {
                prop_assert!(costs.iter().all(|c| costs[best] <= *c));
            } else {
                prop_assert!(costs.iter().all(|c| c.is_infinite()));
            }
            history = after;
        }
    }
}
