use super::of_step1::FIRST_RADIUS;
use super::trust::radius;
use super::*;
use crate::Interval;
use crate::fixed_point::{Cost, Outcome, Weights};
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_vocabulary::step1::{Step1Parameter, Step1Parameters};
use cardiotwin_vocabulary::step1_settings::Step1Settings;
use proptest::prelude::*;
use std::sync::LazyLock;

const MEASURED: [f64; 6] = [120.0, 2.0, -1.8, 330.0, 80.0, 50.0];

fn biomarkers(values: [f64; 6]) -> Biomarkers {
    let mut found = Biomarkers::default();
    Biomarker::OF_ORGAN
        .into_iter()
        .zip(values)
        .for_each(|(biomarker, value)| found.set(biomarker, Some(value)));
    found
}

/// A heart whose biomarkers are powers of all parameters; `rows` holds the exponents and `scale`
/// the values at the guess.
fn heart(p: &Step1Parameters, scale: [f64; 6], rows: [[f64; 6]; 6]) -> Biomarkers {
    let guess = Step1Parameters::default();
    let x = Step1Parameter::ALL.map(|q| (p.get(q) / guess.get(q)).ln());
    let value = |j: usize| scale[j] * rows[j].iter().zip(x).map(|(e, x)| e * x).sum::<f64>().exp();
    biomarkers(std::array::from_fn(value))
}

const SCALE: [f64; 6] = [95.0, 1.4, -1.1, 380.0, 60.0, 90.0];
/// Each biomarker depends mostly on its own parameter.
const ROWS: [[f64; 6]; 6] = [
    [0.6, -0.1, 0.0, 0.1, 0.2, 0.0],
    [0.5, -0.7, 0.0, 0.0, 0.0, 0.0],
    [0.4, 0.0, -0.6, 0.1, 0.0, 0.0],
    [0.0, 0.0, -0.1, 0.8, 0.0, 0.0],
    [-0.2, 0.0, 0.0, 0.2, 0.5, 0.0],
    [-0.1, 0.0, 0.2, 0.0, 0.0, 0.6],
];

fn cheap(p: &Step1Parameters) -> Outcome {
    Outcome::Simulated(heart(p, SCALE, ROWS))
}

/// A stronger and steeper heart, with other couplings than the cheap one.
fn expensive(p: &Step1Parameters) -> Outcome {
    let scale = [70.0, 1.0, -0.9, 420.0, 75.0, 70.0];
    let mut rows = ROWS;
    (rows[0][0], rows[1][0], rows[3][2], rows[4][0]) = (0.75, 0.65, -0.2, -0.35);
    Outcome::Simulated(heart(p, scale, rows))
}

/// Proposes and simulates `n` times.
fn run(
    n: usize,
    settings: &Step1Settings,
    simulate: &dyn Fn(usize, &Step1Parameters) -> Outcome,
) -> (Vec<Step1Run>, Vec<Proposal>) {
    let (mut runs, mut proposals) = (Vec::new(), Vec::new());
    let (measured, initial) = (biomarkers(MEASURED), Step1Parameters::default());
    for i in 0..n {
        let problem = Step1Problem {
            measured: &measured,
            runs: &runs,
            initial: &initial,
            settings,
            weights: &Weights::default(),
            expected: [1.0; 7],
            is_trusted: false,
            seed: 1,
        };
        let Some((parameters, proposal)) = propose_step1(&problem, &cheap) else {
            break;
        };
        let outcome = simulate(i, &parameters);
        runs.push(Step1Run {
            parameters,
            outcome,
            predicted_misfit: Some(proposal.misfit),
        });
        proposals.push(proposal);
    }
    (runs, proposals)
}

fn cost(run: &Step1Run) -> f64 {
    match run.outcome {
        Outcome::Simulated(found) => Cost::of(&biomarkers(MEASURED), &found).total,
        _ => f64::INFINITY,
    }
}

#[test]
fn the_cheap_model_itself_is_solved_at_once() {
    let (runs, proposals) = run(2, &Step1Settings::default(), &|_, p| cheap(p));
    // The cost is far within the tolerance of 0.1; nearness to the guess leaves a small remainder.
    assert!(cost(&runs[0]) < 2e-2, "{proposals:?}");
    assert!((proposals[0].cost - cost(&runs[0])).abs() < 1e-9);
    assert_eq!((proposals[0].base, proposals[1].base), (None, Some(0)));
}

#[test]
fn another_model_is_solved_in_a_few_runs_and_the_correction_is_exact_at_its_base() {
    let (runs, proposals) = run(5, &Step1Settings::default(), &|_, p| expensive(p));
    let costs: Vec<f64> = runs.iter().map(cost).collect();
    assert!(
        costs[0] > 0.05 && costs[1] < 0.02 && costs[2] < costs[1] && costs[4] < 1e-3,
        "{costs:?}"
    );
    // Slopes from all runs make the predictions accurate.
    assert!(
        (proposals[4].cost - costs[4]).abs() < 1e-3,
        "{costs:?} {:?}",
        proposals[4]
    );
    let Outcome::Simulated(found) = runs[0].outcome else {
        panic!()
    };
    let Outcome::Simulated(reduced) = cheap(&runs[0].parameters) else {
        panic!()
    };
    for (biomarker, factor) in &proposals[1].correction {
        let product = factor * reduced.get(*biomarker).unwrap();
        assert!(
            (product / found.get(*biomarker).unwrap() - 1.0).abs() < 1e-12,
            "{biomarker}"
        );
    }
}

#[test]
fn frozen_parameters_and_what_nothing_was_measured_of_stay() {
    let settings = Step1Settings {
        frozen: vec![Step1Parameter::TCr.key().to_owned()],
        ..Step1Settings::default()
    };
    let initial = Step1Parameters::default()
        .with(Step1Parameter::TCr, 480.0)
        .with(Step1Parameter::RMvF, 0.02);
    let mut measured = biomarkers(MEASURED);
    measured.set(Biomarker::TauVr, None);
    let problem = Step1Problem {
        measured: &measured,
        runs: &[],
        initial: &initial,
        settings: &settings,
        weights: &Weights::default(),
        expected: [1.0; 7],
        is_trusted: false,
        seed: 1,
    };
    let parameters = propose_step1(&problem, &cheap).unwrap().0;
    assert_eq!(
        (
            parameters.tanh.t_cr_ms,
            parameters.valves.r_mv_f_mmhg_s_per_ml
        ),
        (480.0, 0.02)
    );
    assert_ne!(parameters.tanh.smax_ref_kpa, initial.tanh.smax_ref_kpa);
}

#[test]
fn what_is_expected_of_the_expensive_model_counts_before_the_first_run() {
    let (measured, initial, settings) = (
        biomarkers(MEASURED),
        Step1Parameters::default(),
        Step1Settings::default(),
    );
    let expected = [0.8, 0.7, 1.2, 1.1, 1.0, 0.6, 1.0];
    let problem = Step1Problem {
        measured: &measured,
        runs: &[],
        initial: &initial,
        settings: &settings,
        weights: &Weights::default(),
        expected,
        is_trusted: false,
        seed: 1,
    };
    let parameters = propose_step1(&problem, &cheap).unwrap().0;
    let mut found = heart(&parameters, SCALE, ROWS);
    for (biomarker, factor) in Biomarker::OF_ORGAN.into_iter().zip(expected) {
        found.set(biomarker, found.get(biomarker).map(|value| value * factor));
    }
    assert!(Cost::of(&measured, &found).total < 2e-2, "{found:?}");
}

#[test]
fn a_run_that_diverges_shortens_the_step_and_is_never_the_base() {
    let fails = |i: usize, p: &Step1Parameters| {
        if i == 1 {
            Outcome::Failed
        } else {
            expensive(p)
        }
    };
    let (runs, proposals) = run(4, &Step1Settings::default(), &fails);
    let (long, short) = (proposals[1].step.unwrap(), proposals[2].radius.unwrap());
    assert!(
        (short / (0.25 * long) - 1.0).abs() < 1e-9,
        "{short} after {long}"
    );
    assert_eq!((proposals[2].base, proposals[3].base), (Some(0), Some(2)));
    assert!(cost(&runs[3]) < cost(&runs[0]));
}

#[test]
fn if_nothing_runs_the_initial_guess_is_next_and_in_the_end_there_is_nothing_left() {
    let (runs, proposals) = run(9, &Step1Settings::default(), &|_, _| Outcome::Failed);
    assert_eq!(runs.len(), 5);
    assert!(
        runs[1]
            .parameters
            .close_to(&Step1Parameters::default(), 1e-12)
    );
    assert!(proposals.iter().all(|p| p.base.is_none()));
    for i in 0..5 {
        for j in 0..i {
            assert!(
                !runs[i].parameters.close_to(&runs[j].parameters, 1e-6),
                "{i} repeats {j}"
            );
        }
    }
}

/// The aortic valve opens once the pressure exceeds the aortic pressure.
fn shut_below(p: &Step1Parameters, pressure: f64) -> Outcome {
    let Outcome::Simulated(found) = expensive(p) else {
        panic!()
    };
    if found.p_max_mmhg.unwrap() >= pressure {
        return Outcome::Simulated(found);
    }
    Outcome::NoWholeBeat(Biomarkers {
        tau_vd_ms: None,
        tau_vr_ms: None,
        ..found
    })
}

#[test]
fn a_beat_whose_valves_stay_shut_leads_on_by_its_pressure() {
    let (runs, proposals) = run(4, &Step1Settings::default(), &|_, p| shut_below(p, 100.0));
    assert!(
        matches!(runs[0].outcome, Outcome::NoWholeBeat(_)),
        "{:?}",
        runs[0]
    );
    assert!(
        matches!(runs[1].outcome, Outcome::Simulated(_)),
        "{:?}",
        runs[1]
    );
    assert_eq!((proposals[1].base, proposals[2].base), (Some(0), Some(1)));
    assert!(cost(&runs[3]) < 0.1, "{}", cost(&runs[3]));
}

/// Biomarkers of which only the first has a value.
fn only(value: f64) -> Biomarkers {
    let mut found = Biomarkers::default();
    found.set(Biomarker::OF_ORGAN[0], Some(value));
    found
}

/// A run of one parameter with the value of [`only`].
fn run_at(x: f64, value: f64) -> Run {
    Run {
        x: vec![x],
        outcome: Outcome::Simulated(only(value)),
        also: Vec::new(),
        predicted_misfit: None,
    }
}

/// Nothing holds the search near a point.
const NOWHERE: Nearness = Nearness {
    at_first: 0.0,
    of_best: 0.0,
    of_doubt: 0.0,
};

/// A problem of one parameter, without prior, nearness or expectation.
fn plain<'a>(measured: &'a Biomarkers, runs: &'a [Run]) -> Problem<'a> {
    static WEIGHTS: LazyLock<Weights> = LazyLock::new(Weights::default);
    static INTERVALS: LazyLock<[Interval; 1]> = LazyLock::new(|| [Interval::new(-2.0, 2.0)]);
    Problem {
        measured,
        weights: &WEIGHTS,
        runs,
        start: &[0.0],
        intervals: &*INTERVALS,
        prior: &[],
        nearness: NOWHERE,
        expected: [1.0; 7],
        reach: [f64::INFINITY; 7],
        first_radius: 3.0,
        effort: Effort::Gradients {
            points: 8,
            best: 1,
            local: crate::least_squares::Settings {
                cost_tolerance: 1e-12,
                step_tolerance: 1e-9,
                max_steps: 50,
                difference_step: 1e-4,
            },
        },
        seed: 1,
    }
}

#[test]
fn other_residuals_are_exact_at_the_best_run() {
    // The cheap model's second residual vanishes at 1, the expensive one's at 1.5.
    let exponential = |x: &[f64]| Outcome::Simulated(only(100.0 * x[0].exp()));
    let cheap = |x: &[f64]| Trial {
        outcome: exponential(x),
        also: vec![x[1] - 1.0],
    };
    let start = [0.0, 0.5];
    let run = Run {
        x: start.to_vec(),
        outcome: exponential(&start),
        also: vec![start[1] - 1.5],
        predicted_misfit: None,
    };
    let (measured, runs) = (only(120.0), [run]);
    let problem = Problem {
        weights: &Weights::of_uncertainty_percent(
            &[(Biomarker::OF_ORGAN[0].key().to_owned(), 1.0)].into(),
        ),
        start: &start,
        intervals: &[Interval::new(-2.0, 2.0); 2],
        ..plain(&measured, &runs)
    };
    let proposal = super::propose(&problem, &cheap).expect("a proposal");
    assert!(
        (proposal.x[0] - 1.2_f64.ln()).abs() < 1e-4,
        "{:?}",
        proposal.x
    );
    assert!((proposal.x[1] - 1.5).abs() < 1e-4, "{:?}", proposal.x);
    assert!(proposal.misfit < 1e-6, "{}", proposal.misfit);
}

#[test]
fn a_gap_that_changed_from_run_to_run_shortens_the_next_step() {
    let cheap = |x: &[f64]| Trial::from(Outcome::Simulated(only(100.0 * x[0].exp())));
    let step = |other: f64, of_doubt: f64| {
        // The models agree at the best run, 0, and differ by `other` at -1.
        let runs = [
            run_at(-1.0, other * 100.0 * (-1.0_f64).exp()),
            run_at(0.0, 100.0),
        ];
        let measured = only(150.0);
        let problem = Problem {
            nearness: Nearness {
                of_doubt,
                ..NOWHERE
            },
            effort: Effort::Gradients {
                points: 64,
                best: 4,
                local: crate::least_squares::Settings::default(),
            },
            ..plain(&measured, &runs)
        };
        super::propose(&problem, &cheap).expect("a proposal").x[0]
    };
    let whole = step(1.0, 1.0);
    assert!((whole - 1.5_f64.ln()).abs() < 1e-3, "{whole}: no doubt");
    let [none, third, all] = [0.0, 0.3, 1.0].map(|share| step(1.5, share));
    assert!(
        0.0 < all && all < third && third < none,
        "{all} {third} {none}"
    );
}

#[test]
fn a_run_far_from_the_measurement_speaks_less_of_the_factors_than_what_is_expected() {
    // The measured factor is 2 at the start; 1.2 is expected.
    let cheap = |x: &[f64]| Trial::from(Outcome::Simulated(only(100.0 * x[0].exp())));
    let run = run_at(0.0, 200.0);
    let factor = |measured_value: f64, reach: f64| {
        let measured = only(measured_value);
        let problem = Problem {
            expected: [1.2; 7],
            reach: [reach; 7],
            ..plain(&measured, std::slice::from_ref(&run))
        };
        super::propose(&problem, &cheap)
            .expect("a proposal")
            .correction[0]
            .1
    };
    assert!(
        (factor(200.0, 0.1) - 2.0).abs() < 1e-12,
        "on the measurement the run is exact"
    );
    let half = factor(200.0 * 0.1_f64.exp(), 0.1);
    assert!(
        (half - (2.0 * 1.2_f64).sqrt()).abs() < 1e-12,
        "{half}: the geometric mean where the run lies one reach off"
    );
    assert!(
        (factor(400.0, 0.01) / 1.2 - 1.0).abs() < 1e-3,
        "far off nearly as expected"
    );
    assert_eq!(factor(400.0, f64::INFINITY), 2.0);
}

#[test]
fn the_radius_follows_what_predictions_were_worth() {
    let at = |x: f64, outcome, predicted_misfit| Run {
        x: vec![x],
        outcome,
        also: Vec::new(),
        predicted_misfit,
    };
    let whole = Outcome::Simulated(Biomarkers::default());
    let after = |predicted: Option<f64>, outcome: Outcome, found: Option<f64>| {
        let runs = [at(0.0, whole, None), at(0.8, outcome, predicted)];
        let costs = [Some(1.0), found];
        radius(&runs, &costs, FIRST_RADIUS, &|i| {
            matches!(runs[i].outcome, Outcome::Simulated(_))
        })
    };
    assert_eq!(after(Some(0.2), whole, Some(0.25)), 1.6, "kept its promise");
    assert_eq!(
        after(Some(0.2), whole, Some(0.6)),
        FIRST_RADIUS,
        "kept half of it"
    );
    assert_eq!(after(Some(0.2), whole, Some(0.9)), 0.4, "gained little");
    assert_eq!(after(Some(0.2), whole, Some(3.0)), 0.4, "lost");
    assert_eq!(after(Some(0.2), Outcome::Failed, None), 0.2);
    assert_eq!(
        after(None, whole, Some(3.0)),
        FIRST_RADIUS,
        "nothing had been promised"
    );
    assert_eq!(
        after(
            Some(0.2),
            Outcome::NoWholeBeat(Biomarkers::default()),
            Some(0.9)
        ),
        0.2,
        "a whole beat was lost"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// For any results of simulations, parameters are finite and within the bounds, the best run is
    /// the base, and equal histories give equal proposals.
    #[test]
    fn proposals_make_sense_whatever_comes_back(
        answers in prop::collection::vec((0u8..4, prop::array::uniform6(0.3f64..3.0)), 1..5),
        narrow in any::<bool>(),
    ) {
        let mut settings = Step1Settings::default();
        if narrow {
            settings.bounds.insert(Step1Parameter::SmaxRef.key().to_owned(), [90.0, 110.0]);
            settings.bounds.insert(Step1Parameter::TauSd.key().to_owned(), [400.0, 500.0]);
        }
        let simulate = |i: usize, p: &Step1Parameters| {
            let (kind, factors) = answers[i];
            let mut found = heart(p, SCALE, ROWS);
            for (biomarker, factor) in Biomarker::OF_ORGAN.into_iter().zip(factors) {
                found.set(biomarker, found.get(biomarker).map(|value| value * factor));
            }
            match kind {
                0 => Outcome::Failed,
                1 => Outcome::NoWholeBeat(Biomarkers { tau_vd_ms: None, tau_vr_ms: None, ..found }),
                _ => Outcome::Simulated(found),
            }
        };
        let (runs, proposals) = run(answers.len(), &settings, &simulate);
        prop_assert_eq!(runs.len(), answers.len());
        for (i, (proposal, run)) in proposals.iter().zip(&runs).enumerate() {
            prop_assert!(proposal.cost.is_finite());
            // A fallback to the initial guess is clamped to the bounds too.
            prop_assert!(settings.admits(&run.parameters), "{:?}", run.parameters);
            if let (Some(step), Some(radius), false) = (proposal.step, proposal.radius, narrow) {
                prop_assert!(step <= radius + 1e-9, "{step} > {radius}");
            }
            let whole = (0..i).filter(|j| matches!(runs[*j].outcome, Outcome::Simulated(_)));
            let best = whole.min_by(|a, b| cost(&runs[*a]).total_cmp(&cost(&runs[*b])));
            prop_assert!(best.is_none() || proposal.base == best);
        }
        prop_assert_eq!(run(answers.len(), &settings, &simulate).1, proposals);
    }
}

#[test]
fn descents_from_several_starts_find_the_deeper_valley_within_the_bounds() {
    // The residual (x² − 1)/0.1 vanishes at ±1; the second one makes −1 the better valley. The start
    // lies in the other one.
    let cheap = |x: &[f64]| Trial {
        outcome: Outcome::Simulated(only(100.0)),
        also: vec![(x[0] * x[0] - 1.0) / 0.1, x[0] + 1.0, x[1] - 5.0],
    };
    let (measured, start) = (only(100.0), [0.9, 0.0]);
    let prior = [Prior {
        centre: 0.0,
        width: 3.0,
    }; 2];
    let with = |points, best| {
        let problem = Problem {
            start: &start,
            intervals: &[Interval::new(-2.0, 2.0); 2],
            prior: &prior,
            effort: Effort::Descents {
                points,
                best,
                spread: 1.0,
                steps: 60,
                weight_of_prior: 0.1,
            },
            ..plain(&measured, &[])
        };
        super::propose(&problem, &cheap).expect("a proposal")
    };
    let (one, several) = (with(0, 0), with(20, 3));
    assert!((one.x[0] - 1.0).abs() < 0.05, "{:?}", one.x);
    assert!((several.x[0] + 1.0).abs() < 0.05, "{:?}", several.x);
    // The second parameter pushes against its bound.
    assert!(several.x[1] > 1.8 && several.x[1] <= 2.0, "{:?}", several.x);
    assert!(several.cheap_beats > one.cheap_beats);
    assert_eq!(with(20, 3), several);
}
