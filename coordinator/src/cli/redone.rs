//! Finished work that a change of settings would compute again: what changed, and what it costs.

use std::collections::BTreeMap;
use std::io::{BufRead as _, IsTerminal as _, Write as _};

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::record::PatientRecord;
use serde_json::Value;

use super::error::CliError;
use super::place::Folders;
use super::table::duration;
use super::talk::{Talk, count, harmless};
use crate::engine::{self, Chosen, Foreseen, Reader, Stage, Step};
use crate::input::{Cohort, Merged};

/// Settings of the execution, which redo nothing.
const EXECUTION: &str = "executor.";

/// A setting that differs from the last run's.
#[derive(Debug, Clone, PartialEq)]
struct Changed {
    key: String,
    old: Option<Value>,
    new: Option<Value>,
    /// Layer that sets the new value.
    origin: String,
}

impl Changed {
    /// One line: key, old and new value, and the layer of the new one.
    fn line(&self) -> String {
        let value =
            |value: &Option<Value>| value.as_ref().map_or("absent".to_owned(), Value::to_string);
        let Self {
            key,
            old,
            new,
            origin,
        } = self;
        format!("  {key}: {} -> {} ({origin})", value(old), value(new))
    }
}

/// Settings that differ from those of the last run, in the order of their keys.
fn changed(before: &Value, now: &Merged) -> Vec<Changed> {
    let mut leaves = BTreeMap::new();
    crate::input::for_each_leaf(before, "", &mut |key, value| {
        leaves.insert(key.to_owned(), (Some(value.clone()), None));
    });
    for (key, value, _) in now.leaves() {
        leaves.entry(key).or_insert((None, None)).1 = Some(value);
    }
    leaves
        .into_iter()
        .filter(|(key, (old, new))| old != new && !key.starts_with(EXECUTION))
        .map(|(key, (old, new))| Changed {
            origin: now.origin(&key).to_string(),
            key,
            old,
            new,
        })
        .collect()
}

/// Finished tasks of a patient from a step on: their number, and the wall time that they took \[s\].
fn cost(record: &PatientRecord, from: Step) -> (usize, f64) {
    let only = |stage, of: Option<&Provenance>| of.map(|p| (Step::only(stage), p.wall_s));
    let mut tasks: Vec<(Step, f64)> = [
        only(
            Stage::Step0,
            record.step0.as_ref().map(|task| &task.provenance),
        ),
        only(
            Stage::Targets,
            record.targets.as_ref().map(|task| &task.provenance),
        ),
        only(
            Stage::Step2,
            record.cell_fit.as_ref().map(|task| &task.provenance),
        ),
        only(
            Stage::Verification,
            record.verification.as_ref().map(|task| &task.provenance),
        ),
        only(
            Stage::Posterior,
            record.posterior.as_ref().map(|task| &task.provenance),
        ),
    ]
    .into_iter()
    .flatten()
    .collect();
    let numbered = |stage, number, of: &Provenance| (Step { stage, number }, of.wall_s);
    for iteration in &record.iterations {
        let task = iteration.run.as_ref();
        tasks.extend(task.map(|t| numbered(Stage::Step1, iteration.number, &t.provenance)));
    }
    for iteration in &record.step3_iterations {
        let task = iteration.run.as_ref();
        tasks.extend(task.map(|t| numbered(Stage::Step3, iteration.number, &t.provenance)));
    }
    let redone = tasks.iter().filter(|(step, _)| *step >= from);
    let (n, wall_s) = redone.fold((0, 0.0), |(n, sum), (_, wall_s)| (n + 1, sum + wall_s));
    (n, wall_s)
}

/// Text about the finished work that changed settings would compute again; `None` if nothing is.
///
/// - `only`: patients that are worked on; empty means all
///
/// # Errors
/// Errors of the store.
pub async fn told(
    folders: &Folders,
    cohort: &Cohort,
    (plans, only): (&[ResolvedPatient], &[String]),
    chosen: Option<&Chosen>,
) -> Result<Option<String>, CliError> {
    let Some(before) = chosen.filter(|chosen| chosen.settings.is_object()) else {
        return Ok(None);
    };
    let changes = changed(&before.settings, &cohort.settings);
    if changes.is_empty() {
        return Ok(None);
    }
    let foreseen = engine::foresee(&folders.run, plans).await?;
    let is_wanted = |id: &PatientId| only.is_empty() || only.iter().any(|one| one == id.as_str());
    let redone: BTreeMap<&PatientId, Step> = foreseen
        .iter()
        .filter(|(id, _)| is_wanted(id))
        .filter_map(|(id, would)| match would {
            Foreseen::Redone(step) => Some((id, *step)),
            Foreseen::Stays | Foreseen::GoesOn(_) => None,
        })
        .collect();
    if redone.is_empty() {
        return Ok(None);
    }
    let record = Reader::open(&folders.run).await?.record().await?;
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
    let lines: Vec<String> = changes.iter().map(Changed::line).collect();
    Ok(Some(format!(
        "settings differ from the last run's:\n{}\n{} done would be redone: {}; {} that took {} of wall time",
        lines.join("\n"),
        count(redone.len(), "patient"),
        steps.join(", "),
        count(n_tasks, "task"),
        duration(wall_s),
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
    use super::*;
    use crate::input::{Layer, Report};

    #[test]
    fn a_changed_setting_is_told_with_both_values_and_its_layer() {
        let now = |set: &[&str]| {
            let set: Vec<String> = set.iter().map(|&s| s.to_owned()).collect();
            let given = Layer::from_command_line(&set, &mut Report::default());
            Merged::of([&Layer::defaults(), &given]).unwrap()
        };
        let before = now(&["solver.fidelity=reduced", "executor.workers=3"]);
        let lines: Vec<String> = changed(&before.value, &now(&["step1.damping=0.5"]))
            .iter()
            .map(Changed::line)
            .collect();
        assert_eq!(
            lines,
            [
                "  solver.fidelity: \"reduced\" -> \"finite-element\" (default)",
                "  step1.damping: 1.0 -> 0.5 (--set)",
            ]
        );
        assert_eq!(changed(&before.value, &before), []);
    }
}
