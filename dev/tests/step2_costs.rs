//! Step 2 on targets with a known reference cost, which SciPy's differential evolution reached on
//! an independent implementation of the cell. The remaining misses are checked, too.

use cardiotwin_dev::kernels::{Case, cases};
use cardiotwin_schemas::outcome::{CellFitResult, Determination, Ending, TaskResult};
use cardiotwin_schemas::settings::{CellFitSettings, InstructionSet, Strategy};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_worker::context::Context;
use cardiotwin_worker::run::simulate;

fn fit(case: &Case, settings: CellFitSettings, instruction_set: InstructionSet) -> CellFitResult {
    let scratch = tempfile::tempdir().unwrap();
    let task = TaskSpec::CellFit(Box::new(case.spec(settings)));
    let outcome = simulate(
        &task,
        Context {
            instruction_set,
            ..Context::plain(scratch.path(), 2)
        },
    );
    assert!(
        outcome.provenance.arithmetic.contains(" lanes"),
        "{}",
        outcome.provenance.arithmetic
    );
    match outcome.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::CellFit(result) => result,
            other => panic!("{other:?}"),
        },
        ending => panic!("{}: {ending:?}", case.name),
    }
}

fn stand_ins() -> Vec<Case> {
    cases()
        .into_iter()
        .filter(|case| case.reference_cost.is_some())
        .collect()
}

#[test]
fn costs_are_no_higher_than_the_references() {
    let cases = stand_ins();
    assert_eq!(cases.len(), 7);
    for case in cases {
        let result = fit(&case, CellFitSettings::default(), InstructionSet::Auto);
        let reference = case.reference_cost.unwrap();
        // Half a percent allows for errors of the two implementations and for the tolerances of the
        // two searches.
        assert!(
            result.cost <= 1.005 * reference,
            "{}: {} against {reference}",
            case.name,
            result.cost
        );
        assert!(result.converged, "{}", case.name);
        assert!(
            (result.cost_terms.values().sum::<f64>() - result.cost).abs() < 1e-9,
            "{:?}",
            result.cost_terms
        );
    }
}

#[test]
fn every_strategy_and_the_portable_lanes_find_02s_stand_in() {
    let case = &stand_ins()[1];
    for strategy in [Strategy::DifferentialEvolution, Strategy::CmaEs] {
        let settings = CellFitSettings {
            strategy,
            identifiability: false,
            ..CellFitSettings::default()
        };
        let result = fit(case, settings, InstructionSet::Portable);
        assert!(
            result.cost <= 1.05 * case.reference_cost.unwrap(),
            "{strategy:?}: {}",
            result.cost
        );
        assert_eq!(result.identifiability, None);
    }
}

#[test]
fn every_parameter_has_an_interval_around_its_value_within_the_bounds() {
    let result = fit(
        &stand_ins()[1],
        CellFitSettings::default(),
        InstructionSet::Auto,
    );
    let identifiability = result.identifiability.unwrap();
    assert!(identifiability.threshold > result.cost);
    assert!(
        identifiability.evaluations as f64 <= 0.3 * result.evaluations as f64,
        "{identifiability:?}"
    );
    for parameter in &result.parameters {
        let near = parameter.near_optimal.unwrap();
        let inside = parameter.lower <= near.lower && near.upper <= parameter.upper;
        assert!(
            inside && near.lower <= parameter.value && parameter.value <= near.upper,
            "{parameter:?}"
        );
    }
    // Rice's transient hardly changes when its two time constants are exchanged. The passive scale
    // determines only the smallest stretch.
    let mark = |name: &str| {
        result
            .parameters
            .iter()
            .find(|parameter| parameter.name == name)
            .unwrap()
            .near_optimal
            .unwrap()
            .mark
    };
    assert_ne!(mark("tau_CR_ms"), Determination::Determined);
    assert_ne!(mark("a_p_kPa"), Determination::NotDetermined);
}

#[test]
fn a_guess_enters_the_first_population_and_may_lie_outside_the_bounds() {
    let case = &stand_ins()[1];
    let short = CellFitSettings {
        popsize: 2,
        max_generations: 3,
        polish: false,
        identifiability: false,
        ..CellFitSettings::default()
    };
    let without = fit(case, short.clone(), InstructionSet::Auto);
    let best = fit(
        case,
        CellFitSettings {
            identifiability: false,
            ..CellFitSettings::default()
        },
        InstructionSet::Auto,
    );
    let initial = best
        .parameters
        .iter()
        .map(|p| (p.name.clone(), p.value))
        .collect();
    let with = fit(
        case,
        CellFitSettings {
            initial,
            ..short.clone()
        },
        InstructionSet::Auto,
    );
    assert!(
        with.cost <= best.cost * (1.0 + 1e-9) && with.cost < without.cost,
        "{} {}",
        with.cost,
        without.cost
    );
    let initial = [("Ca_max_uM".to_owned(), 50.0), ("n_Tm".to_owned(), -3.0)].into();
    let outside = fit(
        case,
        CellFitSettings { initial, ..short },
        InstructionSet::Auto,
    );
    assert!(
        outside
            .parameters
            .iter()
            .all(|p| p.lower <= p.value && p.value <= p.upper)
    );
}
