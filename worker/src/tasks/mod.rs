//! One module for each kind of task, which converts its specification to solver types.

pub mod cell_fit;
pub mod discover;
pub mod learn_law;
pub mod noop;
pub mod organ_beat;
pub mod passive_state;
pub mod posterior;
pub mod proposal;
pub mod surrogate;
pub mod sweep;
pub mod targets;

use cardiotwin_schemas::outcome::{Ending, TaskResult};
use cardiotwin_schemas::task::TaskSpec;

use crate::context::Context;
use crate::error::TaskError;

/// Executes `task`. Errors become endings, too.
pub fn run_task(task: &TaskSpec, context: &mut Context) -> Ending {
    let ending: Result<Ending, TaskError> = match task {
        TaskSpec::CellSweep(spec) => sweep::run(spec, context).map(succeeded),
        TaskSpec::Discover(spec) => discover::run(spec, context).map(succeeded),
        TaskSpec::Noop(spec) => noop::run(spec, context).map(succeeded),
        TaskSpec::PassiveState(spec) => passive_state::run(spec, context).map(succeeded),
        TaskSpec::OrganBeat(spec) => organ_beat::run(spec, context),
        TaskSpec::LearnLaw(spec) => learn_law::run(spec, context).map(succeeded),
        TaskSpec::Step1Proposal(spec) => proposal::step1::run(spec, context).map(succeeded),
        TaskSpec::Step3Proposal(spec) => proposal::step3::run(spec, context).map(succeeded),
        TaskSpec::Posterior(spec) => posterior::run(spec, context).map(succeeded),
        TaskSpec::Targets(spec) => targets::run(spec, context).map(succeeded),
        TaskSpec::CellFit(spec) => cell_fit::run(spec, context).map(succeeded),
    };
    ending.unwrap_or_else(TaskError::into_ending)
}

fn succeeded(result: TaskResult) -> Ending {
    Ending::Succeeded {
        result: Box::new(result),
    }
}
