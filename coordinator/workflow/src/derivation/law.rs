//! The law before a patient's first beat, where pilots of the cohort teach it.

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::task::{InputFile, LAW_FILE, TaskSpec};

use super::{Derivation, Derived, Next, Teaching, broken, wrong_kind};
use crate::patient::{Stage, Step};

impl Derivation<'_, '_> {
    /// The law that pilots taught; `None` without pilots to learn from.
    pub(super) fn taught_law(&mut self, teaching: &Teaching<'_>) -> Derived<Option<InputFile>> {
        let step = Step::only(Stage::LearnLaw);
        let lessons = match teaching {
            Teaching::None => return Ok(None),
            Teaching::Awaited(pilots) => {
                return Err(Next::Waits {
                    step,
                    pilots: pilots.clone(),
                });
            }
            Teaching::Lessons(lessons) => *lessons,
        };
        let spec = self.plan.learn_law_spec(lessons);
        let done = self.result(step, TaskSpec::LearnLaw(Box::new(spec)))?;
        if !matches!(done.result, TaskResult::LearnLaw(_)) {
            return Err(wrong_kind(step, done.result));
        }
        let Some(law) = done.artefacts.iter().find(|a| a.name == "law") else {
            return Err(broken(
                step,
                FailureClass::Bug,
                format!("task {} wrote no law", done.key),
            ));
        };
        let path = done.directory.join(&law.file);
        let file = InputFile {
            name: LAW_FILE.into(),
            path,
            sha256: law.sha256.clone(),
        };
        self.chain.law = Some(done.key);
        Ok(Some(file))
    }
}
