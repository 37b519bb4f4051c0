//! Tests of designs and tables with invented patients whose moments are known.

use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::robustness::{
    MemberRole, RobustnessMember, RobustnessResult, RobustnessSpec, TableKind, Uncertainty,
};
use cardiotwin_schemas::settings::LastStep;
use cardiotwin_schemas::status::PatientState;
use cardiotwin_schemas::step1::Step1Parameter;
use cardiotwin_schemas::task::InputFile;
use proptest::prelude::*;

use super::tables::of_members;
use super::*;

fn patient(id: &str) -> ResolvedPatient {
    let mut patient = ResolvedPatient::without_data(PatientId::from(id), Workflow::Personalise);
    let trace = |name: &str| {
        Some(InputFile {
            name: name.into(),
            path: name.into(),
            sha256: name.into(),
        })
    };
    (patient.step0.pressure, patient.step0.volume) = (trace("pressure"), trace("volume"));
    patient
}

fn spec(over: Uncertainty, n_samples: u32, n_seeds: u32) -> RobustnessSpec {
    let range = if over == Uncertainty::Data { 0.1 } else { 0.5 };
    RobustnessSpec {
        over,
        patients: vec![PatientId::from("02-CoA")],
        n_samples,
        n_seeds,
        range,
        seed: 1,
    }
}

fn measured() -> Biomarkers {
    Biomarkers {
        p_max_mmhg: Some(100.0),
        dpdt_max_mmhg_per_ms: Some(1.5),
        dpdt_min_mmhg_per_ms: Some(-1.5),
        ptd90_ms: Some(450.0),
        sv_ml: Some(120.0),
        tau_vd_ms: Some(200.0),
        tau_vr_ms: Some(50.0),
        ..Biomarkers::default()
    }
}

/// A member that meets its targets except for a relative error. Each parameter is proportional to
/// its biomarker's factor.
fn finished(member: &Member, error: f64) -> RobustnessMember {
    let factor = |name: &str| member.inputs.get(name).copied().unwrap_or(1.0);
    let mut values: BTreeMap<TableKind, BTreeMap<String, f64>> = BTreeMap::new();
    let parameters = Step1Parameter::KEYS.iter().zip(Biomarker::COST_KEYS);
    let parameters =
        parameters.map(|(name, biomarker)| ((*name).to_owned(), 10.0 * factor(biomarker)));
    values.insert(TableKind::Step1Parameters, parameters.collect());
    let simulated = Biomarker::TABLE_2
        .into_iter()
        .chain([Biomarker::TauVd, Biomarker::TauVr])
        .map(|b| {
            let key = b.key();
            (
                key.to_owned(),
                measured().get(b).unwrap() * factor(key) * (1.0 + error),
            )
        });
    let simulated: BTreeMap<String, f64> = simulated.collect();
    values.insert(TableKind::Step1Biomarkers, simulated.clone());
    let seed = member.inputs.get("step2.seed").copied().unwrap_or(1.0);
    let fitted = member
        .plan
        .settings
        .step2
        .parameters
        .iter()
        .map(|name| (name.clone(), 2.0 + 0.1 * seed));
    values.insert(TableKind::Step2Parameters, fitted.collect());
    values.insert(TableKind::Step2Biomarkers, simulated);
    RobustnessMember {
        id: member.plan.id.clone(),
        role: member.role,
        state: PatientState::Done,
        failure: None,
        inputs: member.inputs.clone(),
        step1: Some("converged: iteration 3".into()),
        step1_iterations: 3,
        step1_cost: Some(0.05),
        step2_cost: Some(0.03),
        step2_evaluations: Some(9000),
        verification_cost: Some(0.1),
        values,
    }
}

fn of(spec: &RobustnessSpec, members: Vec<RobustnessMember>) -> RobustnessResult {
    RobustnessResult {
        schema_version: cardiotwin_schemas::formats::ROBUSTNESS.version,
        version: "test".into(),
        cohort: "test".into(),
        spec: spec.clone(),
        patients: vec![of_members(
            spec,
            &patient("02-CoA"),
            members,
            Some(measured()),
        )],
    }
}

#[test]
fn members_of_uncertain_data_differ_in_factors_alone() {
    let plan = patient("02-CoA");
    let all = members(&plan, &spec(Uncertainty::Data, 10, 2)).unwrap();
    let ids: Vec<&str> = all.iter().map(|m| m.plan.id.as_str()).collect();
    assert_eq!(
        (ids[0], ids[1], ids[10], ids[11], ids.len()),
        ("02-CoA.base", "02-CoA.d01", "02-CoA.d10", "02-CoA.s01", 13)
    );
    for member in &all {
        assert_eq!(member.plan.random_stream().as_str(), "02-CoA");
        let mut bare = member.plan.clone();
        (bare.id, bare.random_stream) = (plan.id.clone(), None);
        bare.step0.biomarker_factors.clear();
        assert_eq!(
            bare.settings.workflow.until,
            LastStep::Step2Verification,
            "the paper's tables"
        );
        bare.settings.workflow = plan.settings.workflow.clone();
        if member.role == MemberRole::Seed {
            assert_ne!(bare.settings.step2.seed, plan.settings.step2.seed);
            bare.settings.step2.seed = plan.settings.step2.seed;
        }
        assert_eq!(bare, plan);
        assert_eq!(
            member.plan.step0.biomarker_factors.len(),
            if member.role == MemberRole::Sample {
                6
            } else {
                0
            }
        );
    }
    let again = members(&plan, &spec(Uncertainty::Data, 10, 2)).unwrap();
    assert_eq!(all, again);
    let other = members(
        &plan,
        &RobustnessSpec {
            seed: 2,
            ..spec(Uncertainty::Data, 10, 2)
        },
    )
    .unwrap();
    assert_ne!(all[1], other[1]);
}

#[test]
fn what_was_not_measured_is_not_perturbed_and_other_factors_stay() {
    let (full, mut bare) = (patient("A"), patient("B"));
    bare.step0.volume = None;
    let spec = spec(Uncertainty::Data, 4, 0);
    let factors = |p: &ResolvedPatient| members(p, &spec).unwrap()[2].inputs.clone();
    let (mut all, pressure) = (factors(&full), factors(&bare));
    all.retain(|name, _| !name.starts_with("tau_V"));
    assert_eq!((pressure.len(), &pressure), (4, &all));
    bare.step0.biomarkers.tau_vd_ms = Some(200.0);
    assert_eq!(factors(&bare).len(), 5);
}

#[test]
fn members_of_guesses_start_elsewhere_in_both_steps() {
    let mut plan = patient("02-CoA");
    plan.settings.step1.frozen = vec!["R_AV_f_mmHg_s_per_mL".into()];
    plan.settings
        .step2
        .bounds
        .insert("n_TRPN".into(), [2.5, 5.0]); // the default, 2, lies below
    let all = members(&plan, &spec(Uncertainty::Guess, 5, 0)).unwrap();
    assert_eq!(all.len(), 6);
    for member in &all[1..] {
        let settings = &member.plan.settings;
        assert_eq!(settings.step1.valves.r_av_f_mmhg_s_per_ml, 0.01, "frozen");
        assert_ne!(settings.step1.initial.smax_ref_kpa, 100.0);
        assert_eq!(
            settings.step1.initial.a7, plan.settings.step1.initial.a7,
            "not updated by step 1"
        );
        assert_eq!(settings.step2.initial.len(), 10);
        for (name, value) in &settings.step2.initial {
            let [lower, upper] = settings.step2.bounds[name];
            assert!((lower..=upper).contains(value), "{name} {value}");
        }
        assert_eq!(
            (settings.step2.seed, member.inputs.len()),
            (plan.settings.step2.seed, 15)
        );
    }
    plan.settings.step2.parameters.push("k_XX".into());
    let refused = members(&plan, &spec(Uncertainty::Guess, 5, 0))
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("`k_XX`") && refused.contains("02-CoA"),
        "{refused}"
    );
}

proptest! {
    /// Results proportional to their inputs have the inputs' spread, and errors that do not depend on the sample.
    #[test]
    fn proportional_results_are_neither_damped_nor_amplified(n in 2u32..12, error in -0.05f64..0.05, seed: u64) {
        let spec = RobustnessSpec { seed, ..spec(Uncertainty::Data, n, 0) };
        let plan = patient("02-CoA");
        let members: Vec<_> = members(&plan, &spec).unwrap().iter().map(|m| finished(m, error)).collect();
        let found = &of(&spec, members).patients[0];
        for table in &found.tables {
            for q in &table.quantities {
                prop_assert_eq!((q.n, q.n_missing), (n, 0));
                let proportional = table.table != TableKind::Step2Parameters && q.name != "SV_mL";
                let ratio = q.amplification.as_ref().map(|a| a.ratio);
                if proportional {
                    prop_assert!((ratio.unwrap() - 1.0).abs() < 1e-9, "{} {ratio:?}", q.name);
                    prop_assert!(q.relative_differences.unwrap().maximum <= 0.1 + 1e-12);
                } else {
                    prop_assert!(ratio.unwrap() < 1e-9);
                }
                let rounding = 1e-12 * q.original.abs();
                let m = q.values;
                prop_assert!(m.minimum <= m.mean + rounding && m.mean <= m.maximum + rounding);
            }
        }
        prop_assert_eq!(found.target_errors.len(), 12);
        for e in &found.target_errors {
            prop_assert!((e.original - error.abs()).abs() < 1e-9);
            prop_assert!((e.to_perturbed.mean - error.abs()).abs() < 1e-9);
            prop_assert!(e.to_measured.maximum <= 0.1 + 1.1 * error.abs() + 1e-9);
            prop_assert!(e.beyond.is_empty());
        }
    }

    /// With any members missing, nothing panics, and the finished ones are counted.
    #[test]
    fn unfinished_sweeps_give_the_tables_of_what_is_there(done in proptest::collection::vec(any::<bool>(), 8)) {
        let spec = spec(Uncertainty::Data, 5, 2);
        let plan = patient("02-CoA");
        let members: Vec<_> = members(&plan, &spec).unwrap().iter().zip(&done).map(|(m, done)| {
            let mut member = finished(m, 0.01);
            if !done {
                member.values.clear();
                member.state = PatientState::Running;
            }
            member
        }).collect();
        let result = of(&spec, members);
        let found = &result.patients[0];
        let n = done[1..6].iter().filter(|d| **d).count() as u32;
        prop_assert_eq!(found.tables.is_empty(), !done[0] || n == 0);
        for q in found.tables.iter().flat_map(|t| &t.quantities) {
            prop_assert_eq!((q.n, q.n_missing), (n, 5 - n));
        }
        let every = found.conditions[0].passed;
        prop_assert_eq!(every, done.iter().all(|d| *d).then_some(true));
        let seeds = done[6] || done[7];
        prop_assert_eq!(tables_csv(&result).lines().count() > 1, n > 0 || (done[0] && seeds));
        prop_assert_eq!(members_csv(&result).lines().count(), 9);
        prop_assert_eq!(targets_csv(&result).lines().count(), if done[0] && n > 0 { 13 } else { 1 });
    }
}

#[test]
fn a_fit_that_ignores_its_targets_misses_the_conditions() {
    let spec = spec(Uncertainty::Data, 10, 0);
    let plan = patient("02-CoA");
    let stubborn = |m: &Member| {
        let mut m = m.clone();
        let inputs = std::mem::take(&mut m.inputs);
        RobustnessMember {
            inputs,
            ..finished(&m, 0.0)
        }
    };
    let all = members(&plan, &spec).unwrap();
    let passed = |found: RobustnessResult| -> Vec<Option<bool>> {
        found.patients[0]
            .conditions
            .iter()
            .map(|c| c.passed)
            .collect()
    };
    assert_eq!(
        passed(of(&spec, all.iter().map(|m| finished(m, 0.0)).collect())),
        vec![Some(true); 7]
    );
    let result = of(&spec, all.iter().map(stubborn).collect());
    for e in &result.patients[0].target_errors {
        // Factors within two points of 1 give targets that a fit to the measured values still
        // meets.
        assert!(!e.beyond.is_empty() && e.beyond.len() < 10, "{e:?}");
    }
    let beyond = result.patients[0].target_errors[0].beyond.len();
    let found = &result.patients[0].conditions[2].found;
    assert!(
        found.contains(&format!("samples beyond: {beyond} P_max_mmHg, ")),
        "{found}"
    );
    let stubborn = passed(result);
    assert_eq!(
        stubborn,
        [
            Some(true),
            Some(false),
            Some(false),
            Some(false),
            Some(false),
            Some(false),
            Some(false)
        ]
    );
}

#[test]
fn spreads_of_guesses_stand_against_the_printed_ones() {
    let spec = spec(Uncertainty::Guess, 5, 5);
    let plan = patient("02-CoA");
    let all = members(&plan, &spec).unwrap();
    // Guesses change nothing, and seeds change the fitted cell.
    let steady = |m: &Member| RobustnessMember {
        inputs: m.inputs.clone(),
        ..finished(
            &Member {
                inputs: BTreeMap::new(),
                ..m.clone()
            },
            0.0,
        )
    };
    let members = all
        .iter()
        .map(|m| {
            if m.role == MemberRole::Seed {
                finished(m, 0.0)
            } else {
                steady(m)
            }
        })
        .collect();
    let result = of(&spec, members);
    let found = &result.patients[0];
    assert!(
        found.conditions.iter().all(|c| c.passed == Some(true)),
        "{:?}",
        found.conditions
    );
    assert_eq!(found.conditions.len(), 7);
    let paper = found.tables[0].quantities[0].paper.as_ref().unwrap();
    assert_eq!(
        (found.tables[0].paper_table, paper.mean.to_string().as_str()),
        (7, "102.3")
    );
    let seeds = found
        .seed_tables
        .iter()
        .find(|t| t.table == TableKind::Step2Parameters)
        .unwrap();
    assert!(
        seeds
            .quantities
            .iter()
            .all(|q| q.spread.unwrap() > 0.05 && q.paper.is_none())
    );
    assert_eq!(found.inputs.len(), 16);
    assert!((found.inputs[0].original, found.inputs[6].name.as_str()) == (100.0, "step2.n_TRPN"));
}
