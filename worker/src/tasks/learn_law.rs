//! The organ's law that pilots of a cohort teach. Artefact: `law.json`, a law file.

use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ_law::LawFile;
use cardiotwin_schemas::outcome::{LearnLawResult, TaskResult};
use cardiotwin_schemas::task::{LEARN_LAW, LearnLawSpec};

use crate::context::Context;
use crate::error::TaskError;
use crate::learn::learned;
use crate::tasks::surrogate::prior_of;

/// Learns the law and writes its file.
///
/// # Errors
/// [`TaskError`] if samples or the law at the start cannot be used, or the file cannot be written.
pub fn run(spec: &LearnLawSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let (organs, prior) = learned(&spec.lessons, &prior_of(spec.start.as_ref())?)?;
    let file = LawFile {
        schema_version: formats::LAW.version,
        // The hash of this file is part of further keys, so it has no version of a program: the
        // same lessons give the same file.
        program: LEARN_LAW.to_owned(),
        learned_from: spec.start.as_ref().map(|file| file.sha256.clone()),
        organs: organs.clone(),
        prior,
    };
    let mut text = serde_json::to_string_pretty(&file).expect("a law is JSON");
    text.push('\n');
    context.artefacts.write("law", "law.json", &text)?;
    Ok(TaskResult::LearnLaw(LearnLawResult { organs }))
}
