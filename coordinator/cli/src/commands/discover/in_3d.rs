//! `--in-3d`: the patients' finite-element ventricles without and with the named effects, as a run of
//! their own next to the searches.

use std::path::Path;

use cardiotwin_engine::{Reader, RunOptions};
use cardiotwin_input::{cannot_act_in_3d, with_overlay};
use cardiotwin_report::results::discovery::finite_element::compare;
use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{Fidelity, LastStep};
use cardiotwin_sweep::discovery::overlay::proposed;

use super::args::DiscoverArgs;
use super::choice::Choice;
use super::search::executor;
use super::source::Source;
use crate::commands::sweep::drive;
use crate::error::CliError;
use crate::talk::Talk;

/// Folder of the simulations, inside that of the searches.
const FOLDER: &str = "in-3d";

/// Outcome of the simulations.
#[derive(Default)]
pub struct Ended {
    /// Patients without a comparison, each with the message.
    pub failures: Vec<(String, String)>,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
}

/// Simulates what earlier runs do not hold, and adds the comparisons to the cases.
///
/// # Errors
/// Errors of the engine and the store.
pub async fn add(
    args: &DiscoverArgs,
    (source, choice): (&Source, &Choice),
    run_dir: &Path,
    cases: &mut DiscoverCases,
    talk: &Talk,
) -> Result<Ended, CliError> {
    let (mut ended, mut members) = (Ended::default(), Vec::new());
    for searched in &source.patients {
        let patient = &searched.patient;
        let (Some(case), Some(plan)) = (cases.get(&patient.id), &patient.measured) else {
            continue;
        };
        if case.found.findings.none {
            continue;
        }
        match pair(case, plan, choice.mesh_nodes) {
            Ok(pair) => members.extend(pair),
            Err(why) => ended.failures.push((patient.id.clone(), why)),
        }
    }
    if members.is_empty() {
        return Ok(ended);
    }
    let ids: Vec<PatientId> = members.iter().map(|plan| plan.id.clone()).collect();
    let folder = run_dir.join(FOLDER);
    let options = RunOptions {
        run_dir: folder.clone(),
        chosen: None,
        cohort_name: source.name.clone(),
        description: "finite-element ventricles without and with the named effects".to_owned(),
        cohort_dir: source.folder.clone(),
        executor: executor(args.jobs, members.len()),
        patients: Some(members),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        worker: args.worker.clone(),
        adopt_version: true,
        watch: false,
    };
    ended.stopped = drive(options, "ventricles", talk).await?.stopped;
    let reader = Reader::open(&folder).await?;
    for pair in ids.chunks(2) {
        let (Some(before), Some(after)) = (pair.first(), pair.get(1)) else {
            continue;
        };
        let records = [
            reader.patient_record(before).await?,
            reader.patient_record(after).await?,
        ];
        let name = before.0.strip_suffix(WITHOUT);
        let Some((name, case)) = name.and_then(|name| Some((name, cases.get_mut(name)?))) else {
            continue;
        };
        case.finite_element = compare(&case.found, &records[0], &records[1]);
        if case.finite_element.is_none() && !ended.stopped {
            let why = (records.iter())
                .find_map(|record| record.failure.as_ref())
                .map_or("the twin has no beat".to_owned(), |failure| {
                    failure.message.clone()
                });
            ended.failures.push((name.to_owned(), why));
        }
    }
    Ok(ended)
}

/// Endings of the names under which a patient's two ventricles are run.
const WITHOUT: &str = ".without";
const WITH: &str = ".with";

/// The patient as measured and with the named effects, up to step 3, or the reason why an effect
/// cannot act.
fn pair(
    case: &DiscoverCase,
    plan: &ResolvedPatient,
    mesh_nodes: Option<u32>,
) -> Result<[ResolvedPatient; 2], String> {
    let mut without = plan.clone();
    without.id = PatientId(format!("{}{WITHOUT}", case.case));
    let settings = &mut without.settings;
    settings.solver.fidelity = Fidelity::FiniteElement;
    if let Some(n) = mesh_nodes {
        settings.solver.finite_element.mesh_nodes = n;
    }
    settings.workflow.until = LastStep::Step3;
    settings.verification.enabled = true;
    settings.posterior.enabled = false;
    let mut with = with_overlay(without.clone(), &proposed(case, None));
    with.id = PatientId(format!("{}{WITH}", case.case));
    match cannot_act_in_3d(&with.effects, &with.settings.solver) {
        Some(why) => Err(why),
        None => Ok([without, with]),
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::kick;
    use cardiotwin_schemas::muscle::MuscleLaw;
    use cardiotwin_schemas::organ::EffectSpec;
    use cardiotwin_schemas::plan::Workflow;
    use cardiotwin_sweep::discovery;

    use super::*;

    #[test]
    fn a_patient_is_run_without_and_with_the_named_effects() {
        let mut case = discovery::case("P1", "task", &kick());
        let mut plan = ResolvedPatient::without_data(PatientId::from("P1"), Workflow::Personalise);
        let [without, with] = pair(&case, &plan, Some(700)).unwrap();
        assert_eq!(
            (without.id.0.as_str(), with.id.0.as_str()),
            ("P1.without", "P1.with")
        );
        assert_eq!(
            (&without.effects, &with.effects),
            (&Vec::new(), &case.found.model.effects)
        );
        assert_eq!(with.step0.afterload, Some(case.found.model.afterload));
        assert_eq!(without.settings, with.settings);
        assert_eq!(with.settings.solver.finite_element.mesh_nodes, 700);
        case.found.model.effects = vec![EffectSpec {
            name: "passive_stiffening".to_owned(),
            parameters: [("exponent_factor".to_owned(), 3.0)].into(),
        }];
        plan.settings.solver.finite_element.wall.muscle_law = MuscleLaw::NeoHookean;
        let why = pair(&case, &plan, None).unwrap_err();
        assert!(why.contains("passive_stiffening cannot act"), "{why}");
    }
}
