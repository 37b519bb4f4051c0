//! How long tasks are expected to take: the longest that were measured in this run, before that a guess.

use std::collections::BTreeMap;

use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::{ExecutorSettings, Fidelity, Update};
use cardiotwin_schemas::task::TaskSpec;

use super::mesh_size;
use crate::engine::world::World;
use crate::machine::chain::Chain;
use crate::machine::task::Task;

/// So many measured tasks of a kind tell enough.
const ENOUGH: usize = 20;
/// One thread's time of a beat of the finite-element ventricle, s for each node of the mesh (docs/benchmarks.md).
const S_PER_NODE: f64 = 0.1;
/// A beat of an external solver, before one was measured, s.
const EXTERNAL_S: f64 = 3600.0;
/// Iterations of step 1 that a patient is expected to need (SPEC section 5: two to four, and one more).
const ITERATIONS: usize = 5;

/// Expected seconds by a task's kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expectations {
    measured: BTreeMap<String, f64>,
    simulation_s: f64,
}

impl Expectations {
    /// From what this run measured, and what its settings say.
    #[must_use]
    pub fn of(world: &World, settings: &ExecutorSettings) -> Self {
        let mut seen: BTreeMap<String, (usize, f64)> = BTreeMap::new();
        for task in world.tasks.values().filter(|task| matches!(task.state, Task::Published { .. })) {
            let entry = seen.entry(task.kind.clone()).or_default();
            if entry.0 < ENOUGH
                && let Some(outcome) = task.outcome()
            {
                *entry = (entry.0 + 1, entry.1.max(outcome.provenance.wall_s));
            }
        }
        let measured = seen.into_iter().map(|(kind, (_, wall_s))| (kind, wall_s)).collect();
        Self { measured, simulation_s: settings.slurm.simulation_s }
    }

    fn beat_s(&self, plan: &ResolvedPatient) -> f64 {
        let guess = match plan.settings.solver.fidelity {
            _ if self.simulation_s > 0.0 => self.simulation_s,
            Fidelity::Reduced => 1.0,
            // Nothing is known of it until the first has ended: `executor.slurm.simulation_s` says more.
            Fidelity::External => EXTERNAL_S,
            Fidelity::FiniteElement => f64::from(mesh_size::nodes(plan)) * S_PER_NODE,
        };
        self.measured.get("organ-beat").copied().unwrap_or(guess)
    }

    /// One task of a patient's.
    #[must_use]
    pub fn task_s(&self, kind: &str, plan: &ResolvedPatient) -> f64 {
        if let Some(measured) = self.measured.get(kind) {
            return *measured;
        }
        match kind {
            "organ-beat" => self.beat_s(plan),
            // Step 0 of an external solver is that of the reduced ventricle.
            "passive-state" if plan.settings.solver.fidelity == Fidelity::External => 3.0,
            "passive-state" => 3.0 * self.beat_s(plan),
            "step1-proposal" | "cell-fit" | "cell-sweep" => 60.0,
            "discover" => 600.0,
            _ => 1.0,
        }
    }

    /// All kinds of a patient's chain, for its driver.
    #[must_use]
    pub fn by_kind(&self, plan: &ResolvedPatient) -> BTreeMap<String, f64> {
        let kinds =
            ["passive-state", "organ-beat", "step1-proposal", "targets", "cell-fit", "cell-sweep", "discover", "noop"];
        kinds.into_iter().map(|kind| (kind.to_owned(), self.task_s(kind, plan))).collect()
    }

    /// What is left of a patient's chain.
    #[must_use]
    pub fn rest_s(&self, plan: &ResolvedPatient, chain: &Chain) -> f64 {
        let task = |kind: &str| self.task_s(kind, plan);
        let rest = match &plan.workflow {
            Workflow::Noop { sleep_ms } => (3 - chain.noops.len().min(3)) as f64 * (*sleep_ms as f64 / 1000.0 + 0.1),
            Workflow::Task { task: spec } => match spec.as_ref() {
                TaskSpec::Noop(noop) => noop.sleep_ms as f64 / 1000.0 + 0.1,
                other => task(other.kind()),
            },
            Workflow::Personalise => {
                let proposes = plan.settings.step1_update() == Update::SpaceMapping;
                let iteration = task("organ-beat") + if proposes { task("step1-proposal") } else { 0.0 };
                let iterations =
                    if chain.step1.is_some() { 0 } else { ITERATIONS.saturating_sub(chain.iterations.len()).max(1) };
                let left = |is_there: bool, kind: &str| if is_there { 0.0 } else { task(kind) };
                left(chain.step0.is_some(), "passive-state")
                    + iterations as f64 * iteration
                    + left(chain.targets.is_some(), "targets")
                    + left(chain.cell_fit.is_some(), "cell-fit")
                    + left(chain.verification.is_some(), "organ-beat")
            }
        };
        rest.max(0.1)
    }
}
