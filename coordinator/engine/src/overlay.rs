//! `models/<patient>/model.toml`: everything learned about a patient, versioned, and never mixed
//! with measured data.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;

use cardiotwin_protocol::files;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::organ::{OrganSpec, VALVE_PARAMETERS};
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_store::clock::utc_text;
use cardiotwin_workflow::cell_fit::cell_parameters;
use cardiotwin_workflow::derivation::Settled;
use cardiotwin_workflow::patient::Stage;
use cardiotwin_workflow::patient::Step;

use super::EngineError;
use super::books::Books;

/// Everything learned about a patient so far, without version and time; `None` before step 0.
pub fn learned(books: &Books, i: usize) -> Result<Option<ModelOverlay>, EngineError> {
    let plan = books.plan(i)?;
    let chain = &books.patient(i).chain;
    let result = |key| match books.settled(key) {
        Some(Settled::Published { result, .. }) => Some(result),
        _ => None,
    };
    let Some(TaskResult::PassiveState(step0)) = chain.step0.as_ref().and_then(result) else {
        return Ok(None);
    };
    let passive = match &step0.organ {
        OrganSpec::Reduced { passive, .. } => Some(*passive),
        // The passive law belongs to a mesh, so it stays with step 0's artefact.
        OrganSpec::FiniteElement(_) | OrganSpec::External(_) => None,
    };
    let fit = match chain.cell_fit.as_ref().and_then(result) {
        Some(TaskResult::CellFit(fit)) => Some(fit),
        _ => None,
    };
    let step3 = chain.step3.as_ref();
    // Iterations of steps 1 and 3 other than the best one do not contribute to the model.
    let best = [
        chain.step1.as_ref().map(|s| s.best_iteration),
        chain.step3.as_ref().map(|s| s.best_iteration),
    ];
    let has_no_answer = |key: &TaskKey| chain.unanswered.iter().any(|task| task.task == *key);
    let from = chain
        .steps()
        .filter(|(step, key)| is_foundation(*step, best) && !has_no_answer(key))
        .map(|(step, key)| (step.stage.to_string(), key.to_string()));
    Ok(Some(ModelOverlay {
        version: 0,
        patient: plan.id.to_string(),
        written: String::new(),
        from: from.collect(),
        afterload: Some(step0.circulation.afterload),
        left_atrial_pressure_mmhg: Some(step0.circulation.left_atrial_pressure_mmhg),
        passive,
        tanh: chain.step1.as_ref().map(|s| s.parameters.tanh),
        valves: chain.step1.as_ref().map(|s| {
            step3.map_or(s.parameters.valves, |step3| {
                s.parameters.valves.with(&step3.parameters)
            })
        }),
        // `a_p` is not used in the organ, but it was fitted, and the overlay keeps every fitted
        // parameter.
        cell: fit.map_or_else(BTreeMap::new, |fit| {
            let mut cell = cell_parameters(plan, fit);
            cell.extend(fit.parameters.iter().map(|p| (p.name.clone(), p.value)));
            let moved = step3.iter().flat_map(|step3| &step3.parameters);
            cell.extend(
                moved
                    .filter(|(name, _)| !is_valve(name))
                    .map(|(name, value)| (name.clone(), *value)),
            );
            cell
        }),
        effects: plan.effects.clone(),
        corrections: plan.step0.corrections.clone(),
        accepted: None,
    }))
}

/// - `best`: best iterations of step 1 and of step 3
fn is_foundation(step: Step, best: [Option<u32>; 2]) -> bool {
    match step.stage {
        Stage::Step1 | Stage::Step1Proposal => best[0] == Some(step.number),
        Stage::Step3 | Stage::Step3Proposal => best[1] == Some(step.number),
        _ => true,
    }
}

fn is_valve(name: &str) -> bool {
    VALVE_PARAMETERS.contains(&name)
}

/// Writes everything learned about a patient, if there is anything yet.
pub fn write_of(books: &Books, patient_id: i64) -> Result<(), EngineError> {
    let Some(i) = books.by_id(patient_id) else {
        return Ok(());
    };
    match learned(books, i)? {
        Some(learned) => write(books.run_dir(), learned, utc_text(books.now_ms())),
        None => Ok(()),
    }
}

/// Writes the next version if it differs from the present one. Earlier versions stay as
/// `model.vN.toml`.
///
/// - `now`: UTC, RFC 3339
pub fn write(run_dir: &Path, mut overlay: ModelOverlay, now: String) -> Result<(), EngineError> {
    let folder = run_dir.join("models").join(&overlay.patient);
    let path = folder.join("model.toml");
    let file = |what, path: &Path| {
        let path = path.to_owned();
        move |source| EngineError::File { what, path, source }
    };
    let before = match fs::read_to_string(&path) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(source) => return Err(file("read", &path)(source)),
    };
    if let Some(text) = &before {
        // A file that a person has made unreadable is kept like any other version, under the next
        // free number.
        let old = toml::from_str::<ModelOverlay>(text).ok();
        let version = old
            .as_ref()
            .map_or_else(|| kept_versions(&folder) + 1, |old| old.version);
        if let Some(old) = old {
            overlay.version = old.version;
            overlay.written.clone_from(&old.written);
            if overlay == old {
                return Ok(());
            }
        }
        let kept = folder.join(format!("model.v{version}.toml"));
        files::write_atomic(&kept, text.as_bytes()).map_err(file("write", &kept))?;
        overlay.version = version + 1;
    } else {
        overlay.version = kept_versions(&folder) + 1;
    }
    overlay.written = now;
    let text = toml::to_string(&overlay)
        .map_err(|error| file("write", &path)(io::Error::new(io::ErrorKind::InvalidData, error)))?;
    let head = "# Written by cardiotwin from results; measured input is never changed. Older versions: model.vN.toml\n";
    fs::create_dir_all(&folder).map_err(file("create", &folder))?;
    files::write_atomic(&path, format!("{head}{text}").as_bytes()).map_err(file("write", &path))
}

/// Highest N of the `model.vN.toml` in a folder; 0 if there is none.
fn kept_versions(folder: &Path) -> u32 {
    let number = |name: &str| {
        name.strip_prefix("model.v")?
            .strip_suffix(".toml")?
            .parse::<u32>()
            .ok()
    };
    fs::read_dir(folder)
        .map(|entries| {
            entries
                .flatten()
                .filter_map(|e| number(&e.file_name().to_string_lossy()))
                .max()
                .unwrap_or(0)
        })
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlay(pressure: f64) -> ModelOverlay {
        ModelOverlay {
            version: 0,
            patient: "P1".into(),
            written: String::new(),
            from: [("step-0".to_owned(), "key".to_owned())].into(),
            afterload: None,
            left_atrial_pressure_mmhg: Some(pressure),
            passive: None,
            tanh: Some(Default::default()),
            valves: None,
            cell: BTreeMap::new(),
            effects: vec![],
            corrections: vec![],
            accepted: None,
        }
    }

    #[test]
    fn a_new_version_only_when_something_changed_and_the_old_ones_stay() {
        let dir = tempfile::tempdir().unwrap();
        let read = |name: &str| {
            let text = fs::read_to_string(dir.path().join("models/P1").join(name)).unwrap();
            toml::from_str::<ModelOverlay>(&text).unwrap()
        };
        write(dir.path(), overlay(6.0), "t".into()).unwrap();
        write(dir.path(), overlay(6.0), "t".into()).unwrap();
        assert_eq!(read("model.toml").version, 1);
        write(dir.path(), overlay(7.0), "t".into()).unwrap();
        let now = read("model.toml");
        assert_eq!((now.version, now.left_atrial_pressure_mmhg), (2, Some(7.0)));
        assert_eq!(read("model.v1.toml").left_atrial_pressure_mmhg, Some(6.0));
    }
}
