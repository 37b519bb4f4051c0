//! Finished work that a change of settings would compute again: what changed, and what it costs.

use std::collections::BTreeMap;
use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::Path;

use cardiotwin_engine::{self as engine, Chosen, Foreseen, LeafChange, Reader, Stage, Step};
use cardiotwin_input::Merged;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::{PatientRecord, TaskRecord};
use serde_json::Value;

use super::error::CliError;
use super::table::duration;
use super::talk::{Talk, count, harmless};

/// Beginning of the keys of the execution's settings, which redo nothing.
pub const EXECUTION: &str = "executor.";

/// Leaves of the settings that differ from those of the last run, in the order of their keys, without
/// those of the execution. Empty without a last run.
pub fn leaves(before: Option<&Chosen>, now: &Value) -> Vec<LeafChange> {
    let Some(before) = before.map(|chosen| &chosen.settings) else {
        return Vec::new();
    };
    if !before.is_object() {
        return Vec::new();
    }
    let changes = engine::leaf_changes(before, now).into_iter();
    changes
        .filter(|change| !change.path.starts_with(EXECUTION))
        .collect()
}

/// Lines about settings that differ from those of the last run: key, old and new value, and the layer
/// of the new one.
pub fn changed(before: Option<&Chosen>, now: &Merged) -> Vec<String> {
    let line = |change: LeafChange| {
        let key = change.path.split('[').next().unwrap_or_default();
        format!("  {} ({})", change.words(), now.origin(key))
    };
    leaves(before, &now.value).into_iter().map(line).collect()
}

/// A finished task's step, and the wall time that it took \[s\].
fn took<T>(stage: Stage, number: u32, task: &Option<TaskRecord<T>>) -> Option<(Step, f64)> {
    let wall_s = task.as_ref()?.provenance.wall_s;
    Some((Step { stage, number }, wall_s))
}

/// Finished tasks of a patient from a step on: their number, and the wall time that they took \[s\].
fn cost(record: &PatientRecord, from: Step) -> (usize, f64) {
    let of_step1 = record.iterations.iter().flat_map(|i| {
        let proposal = took(Stage::Step1Proposal, i.number, &i.proposal);
        [proposal, took(Stage::Step1, i.number, &i.run)]
    });
    let of_step3 = record.step3_iterations.iter().flat_map(|i| {
        let proposal = took(Stage::Step3Proposal, i.number, &i.proposal);
        [proposal, took(Stage::Step3, i.number, &i.run)]
    });
    [
        took(Stage::Step0, 1, &record.step0),
        took(Stage::Targets, 1, &record.targets),
        took(Stage::Step2, 1, &record.cell_fit),
        took(Stage::Step2Organ, 1, &record.organ_fit),
        took(Stage::Verification, 1, &record.verification),
        took(Stage::Posterior, 1, &record.posterior),
    ]
    .into_iter()
    .chain(of_step1)
    .chain(of_step3)
    .flatten()
    .filter(|(step, _)| *step >= from)
    .fold((0, 0.0), |(n, sum), (_, wall_s)| (n + 1, sum + wall_s))
}

/// Text about the finished work that changed settings would compute again; `None` if nothing is.
///
/// - `changes`: lines about the settings, of [`changed`]
/// - `plans`: called only where settings changed, because a cohort's plans are large
/// - `only`: patients that are worked on; empty means all
///
/// # Errors
/// Errors of the store.
pub async fn told(
    run_dir: &Path,
    plans: impl FnOnce() -> Vec<ResolvedPatient>,
    only: &[String],
    changes: &[String],
) -> Result<Option<String>, CliError> {
    if changes.is_empty() {
        return Ok(None);
    }
    let foreseen = engine::foresee(run_dir, &plans()).await?;
    let is_wanted = |id: &PatientId| only.is_empty() || only.iter().any(|one| one == id.as_str());
    let redone: BTreeMap<&PatientId, Step> = foreseen
        .iter()
        .filter(|(id, _)| is_wanted(id))
        .filter_map(|(id, would)| match would {
            Foreseen::Redone(step) => Some((id, *step)),
            Foreseen::Stays | Foreseen::GoesOn(_) | Foreseen::Waits => None,
        })
        .collect();
    if redone.is_empty() {
        return Ok(None);
    }
    let record = Reader::open(run_dir).await?.record().await?;
    let (mut n_tasks, mut wall_s) = (0, 0.0);
    for patient in &record.patients {
        if let Some(step) = redone.get(&patient.plan.id) {
            let (n, s) = cost(patient, *step);
            (n_tasks, wall_s) = (n_tasks + n, wall_s + s);
        }
    }
    let mut steps: BTreeMap<Step, usize> = BTreeMap::new();
    redone
        .values()
        .for_each(|step| *steps.entry(*step).or_default() += 1);
    let steps: Vec<String> = steps
        .iter()
        .map(|(step, n)| format!("{n} from {step} on"))
        .collect();
    // Members of a sweep have one task, whose time the record does not hold.
    let took = match n_tasks {
        0 => String::new(),
        n => format!(
            "; {} that took {} of wall time",
            count(n, "task"),
            duration(wall_s)
        ),
    };
    Ok(Some(format!(
        "settings differ from the last run's:\n{}\n{} done would be redone: {}{took}",
        changes.join("\n"),
        count(redone.len(), "patient"),
        steps.join(", "),
    )))
}

/// Says what is redone, and asks for consent on a terminal.
///
/// # Errors
/// [`CliError::Usage`] without consent: `yes`, or an answer on the terminal.
pub fn consent(told: &str, yes: bool, talk: &Talk) -> Result<(), CliError> {
    if yes {
        talk.say(told);
        return Ok(());
    }
    talk.insist(told);
    let refused = |why: &str| {
        CliError::Usage(format!(
            "nothing was done: {why}; `--dry-run` shows each patient, `--run-dir DIR` keeps this run beside a new one"
        ))
    };
    if !(std::io::stdin().is_terminal() && std::io::stderr().is_terminal()) {
        return Err(refused(
            "add --yes to redo finished work, or give the settings of before",
        ));
    }
    let mut err = std::io::stderr().lock();
    let asked = write!(err, "{}", harmless("redo them? [y/N] ")).and_then(|()| err.flush());
    let mut answer = String::new();
    let answered = asked.and_then(|()| std::io::stdin().lock().read_line(&mut answer));
    match (answered, answer.trim().to_lowercase().as_str()) {
        (Ok(_), "y" | "yes") => Ok(()),
        _ => Err(refused("the answer was no")),
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_input::{Layer, Report};

    use super::*;

    #[test]
    fn a_changed_setting_is_told_with_both_values_and_its_layer() {
        let now = |set: &[&str]| {
            let set: Vec<String> = set.iter().map(|&s| s.to_owned()).collect();
            let given = Layer::from_command_line(&set, &mut Report::default());
            Merged::of([&Layer::defaults(), &given]).unwrap()
        };
        let before = now(&["solver.fidelity=reduced", "executor.workers=3"]);
        let chosen = Chosen {
            settings: before.value.clone(),
            ..Chosen::default()
        };
        assert_eq!(
            changed(Some(&chosen), &now(&["step1.damping=0.5"])),
            [
                "  solver.fidelity: \"reduced\" -> \"finite-element\" (default)",
                "  step1.damping: 1.0 -> 0.5 (--set)",
            ]
        );
        assert!(changed(Some(&chosen), &before).is_empty());
        assert!(changed(None, &before).is_empty());
    }
}
