//! The reference beats (SciPy Radau, rtol 1e-10; see tests/data/cell0d.json) at the tolerances that their README suggests.

mod common;

use cardiotwin_cell_engine::{
    CellEngine, CellOutput, CellTrace, EngineSettings, NegativeKwu, Objective, Workspace,
};
use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use common::{Reference, file, references};

fn evaluate(sets: &[Reference], settings: EngineSettings) -> (Vec<CellOutput>, Vec<CellTrace>) {
    let engine = CellEngine::new(EngineSettings {
        negative_kwu: NegativeKwu::Keep,
        ..settings
    })
    .unwrap();
    let inputs: Vec<_> = sets.iter().map(|s| s.input).collect();
    let mut outputs = vec![CellOutput::default(); inputs.len()];
    let mut traces = vec![CellTrace::default(); inputs.len()];
    engine
        .evaluate_with_traces(&inputs, &mut Workspace::new(), &mut outputs, &mut traces)
        .unwrap();
    (outputs, traces)
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - y).abs())
        .fold(0.0, f64::max)
}

#[test]
fn every_trajectory_within_the_suggested_tolerance() {
    let sets = references();
    let (outputs, traces) = evaluate(&sets, EngineSettings::default());
    let mut failed = Vec::new();
    for ((set, output), trace) in sets.iter().zip(&outputs).zip(&traces) {
        let sa = largest_difference(&trace.sa_kpa, &set.sa_kpa);
        let lambda = largest_difference(&trace.lambda, &set.lambda);
        println!(
            "{:32} Sa {sa:.1e} kPa, lambda {lambda:.1e}, {} beats, {} steps",
            set.name, output.beats, output.steps
        );
        assert!(output.is_periodic(), "{}: {:?}", set.name, output.status);
        if sa > 0.005 || lambda > 2e-5 {
            failed.push((&set.name, sa, lambda));
        }
    }
    assert_eq!(sets.len(), 31);
    assert!(
        failed.is_empty(),
        "(set, Sa, lambda) beyond 0.005 kPa or 2e-5: {failed:?}"
    );
}

#[test]
fn calcium_is_the_analytic_transient() {
    let sets = references();
    let (_, traces) = evaluate(&sets, EngineSettings::default());
    for (set, trace) in sets.iter().zip(&traces) {
        let peak = trace.calcium_um.iter().copied().fold(0.0, f64::max);
        let (ca_res, ca_max) = (set.input.parameters[17], set.input.parameters[18]);
        assert_eq!(trace.calcium_um.len(), set.sa_kpa.len());
        assert!((trace.calcium_um[0] - ca_res).abs() < 1e-15);
        assert!(
            peak <= ca_max && peak > ca_max - 1e-3 * (ca_max - ca_res),
            "{}: {peak}",
            set.name
        );
    }
}

#[test]
fn biomarkers_of_the_1_ms_grid() {
    let sets = references();
    let (outputs, _) = evaluate(&sets, EngineSettings::default());
    for (set, output) in sets.iter().zip(&outputs) {
        let expected = &set.entry["biomarkers_1ms_grid"];
        let value = |key: &str| expected[key].as_f64();
        let (reading, b) = (&output.reading, &output.reading.biomarkers);
        let relative = [
            ("Sa_max_kPa", b.sa_max_kpa, 1e-3),
            ("dSa_dt_max_kPa_per_ms", b.dsadt_max_kpa_per_ms, 5e-3),
            ("lambda_min", b.lambda_min, 1e-3),
            ("CTD50_ms", reading.ctd50_ms, 1e-9),
            ("CTD90_ms", reading.ctd90_ms, 1e-9),
        ];
        for (key, found, tolerance) in relative {
            let expected = value(key).unwrap();
            assert!(
                (found / expected - 1.0).abs() <= tolerance,
                "{}: {key} {found}, expected {expected}",
                set.name
            );
        }
        for (key, found, cut) in [
            ("STD30_ms", b.std30_ms, reading.cut[0]),
            ("STD50_ms", b.std50_ms, reading.cut[1]),
            ("STD90_ms", b.std90_ms, reading.cut[2]),
        ] {
            match value(key) {
                Some(expected) => {
                    assert!(!cut, "{}: {key}", set.name);
                    assert!(
                        (found - expected).abs() <= 0.2,
                        "{}: {key} {found}, expected {expected}",
                        set.name
                    );
                }
                None => assert!(cut, "{}: {key} should not be crossed", set.name),
            }
        }
        for (key, found) in [
            ("Sa_res_kPa", reading.sa_res_kpa),
            ("Sa_min_kPa", reading.sa_min_kpa),
        ] {
            let expected = value(key).unwrap();
            assert!(
                (found - expected).abs() <= 0.005,
                "{}: {key} {found}, expected {expected}",
                set.name
            );
        }
        let rise = value("max_rise_after_max_kPa_per_ms").unwrap();
        assert!(
            (reading.max_rise_after_peak_kpa_per_ms - rise).abs() <= 1e-6 + 5e-3 * rise,
            "{}: {reading:?}",
            set.name
        );
    }
}

#[test]
fn penalty_and_cost() {
    let sets = references();
    let (outputs, _) = evaluate(&sets, EngineSettings::default());
    let file = file();
    let target = |key: &str| file["target_of_the_cost"][key].as_f64().unwrap();
    let objective = Objective::new(CellBiomarkers {
        sa_max_kpa: target("Sa_max_kPa"),
        dsadt_max_kpa_per_ms: target("dSa_dt_max_kPa_per_ms"),
        std30_ms: target("STD30_ms"),
        std50_ms: target("STD50_ms"),
        std90_ms: target("STD90_ms"),
        lambda_min: target("lambda_min"),
    });
    let mut n_costs = 0;
    for (set, output) in sets.iter().zip(&outputs) {
        let p = &output.penalty;
        let term = |key: &str| set.entry["penalty_terms_1ms_grid"][key].as_f64().unwrap();
        // A stress that is right to 0.001 kPa.
        let residual = term("Sa_res");
        assert!(
            (p.sa_res.sqrt() - residual.sqrt()).abs() <= 1e-3
                && (p.sa_res - residual).abs() < 2e-3 * residual + 1e-4,
            "{}: Sa_res {}, not {residual}",
            set.name,
            p.sa_res
        );
        let mut total = residual;
        let terms = [
            ("negative_stress", p.negative_stress),
            ("rise_after_max", p.rise_after_peak),
            ("CTD50_low", p.ctd50_low),
            ("CTD50_high", p.ctd50_high),
            ("CTD90_low", p.ctd90_low),
            ("CTD90_high", p.ctd90_high),
        ];
        for (key, found) in terms {
            let expected = term(key);
            total += expected;
            assert!(
                (found - expected).abs() <= 1e-5 + 2e-3 * expected,
                "{}: {key} {found}, not {expected}",
                set.name
            );
        }
        assert!(
            (p.total() - total).abs() < 2e-3 * total + 1e-4,
            "{}: penalty {}, not {total}",
            set.name,
            p.total()
        );
        if let Some(expected) = set.entry["cost_total_1ms_grid"].as_f64() {
            // The reference keeps the penalty apart.
            let found = objective.cost(&output.reading.biomarkers, p) - p.total();
            assert!(
                (found / expected - 1.0).abs() <= 2e-3,
                "{}: cost {found}, not {expected}",
                set.name
            );
            n_costs += 1;
        }
    }
    assert_eq!(n_costs, 27);
}

#[test]
fn the_periodic_state_does_not_depend_on_where_it_was_sought() {
    let sets = references();
    let (usual, _) = evaluate(&sets, EngineSettings::default());
    // From equilibrium at t = 0 without a run-in, and held to a hundredth of the usual change of state.
    let other = EngineSettings {
        run_in_ms: 0.0,
        tolerance: 1e-6,
        ..EngineSettings::default()
    };
    let (sharp, _) = evaluate(&sets, other);
    for ((set, a), b) in sets.iter().zip(&usual).zip(&sharp) {
        assert!(
            b.is_periodic() && b.state_change <= 1e-6,
            "{}: {:?}",
            set.name,
            b.status
        );
        assert!(
            (a.reading.sa_res_kpa - b.reading.sa_res_kpa).abs() <= 0.003,
            "{}: {a:?} {b:?}",
            set.name
        );
    }
}
