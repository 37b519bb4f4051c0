//! Expected duration of tasks: the longest that was measured in this run, or else a guess.

use std::collections::BTreeMap;

use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::{ExecutorSettings, Fidelity, LastStep, Surrogate, Update};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_slurm::plan::beat_s;
use cardiotwin_slurm::site::Site;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::Stage;
use cardiotwin_workflow::task::Task;

use crate::books::Books;
use crate::mesh_size::MeshSizes;

/// Number of measured tasks of a kind that suffices.
pub(super) const ENOUGH: usize = 20;
/// Guess for a beat of the finite-element ventricle over that of the model: a fitted cell takes 1.4 times the model's Tanh, and
/// other processors twice the time.
const SLOWER: f64 = 3.0;
/// What one core does before a beat, and writes after it, s per node of the mesh.
const ALONE_S_PER_NODE: f64 = 5e-4;
/// Guess for a beat of an external solver before one was measured, s.
const EXTERNAL_S: f64 = 3600.0;
/// Expected numbers of simulations of steps 1 and 3 where the organ's law proposes (docs/organ-law.md).
const IN_LAW: [usize; 2] = [2, 1];
/// The same without the law. The paper's step 1 takes two to four (SPEC section 5), and one more for a patient at the edge.
const WITHOUT_LAW: [usize; 2] = [5, 3];

/// Expected seconds by kind of task.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expectations {
    measured: BTreeMap<String, f64>,
    simulation_s: f64,
    cores_per_node: u32,
    mesh_sizes: MeshSizes,
}

impl Expectations {
    /// Collects measured wall times of this run and the guess from its settings and the site's cores.
    #[must_use]
    pub fn of(
        books: &Books,
        settings: &ExecutorSettings,
        site: &Site,
        mesh_sizes: &MeshSizes,
    ) -> Self {
        let mut seen: BTreeMap<String, (usize, f64)> = BTreeMap::new();
        for task in books
            .tasks()
            .values()
            .filter(|task| matches!(task.state, Task::Published { .. }))
        {
            let entry = seen.entry(task.kind.clone()).or_default();
            if entry.0 < ENOUGH
                && let Some(wall_s) = task.wall_s()
            {
                *entry = (entry.0 + 1, entry.1.max(wall_s));
            }
        }
        let measured = seen
            .into_iter()
            .map(|(kind, (_, wall_s))| (kind, wall_s))
            .collect();
        Self {
            measured,
            simulation_s: settings.slurm.simulation_s,
            cores_per_node: site.node.cores,
            mesh_sizes: mesh_sizes.clone(),
        }
    }

    /// Number of nodes of a patient's mesh.
    #[must_use]
    pub fn mesh_nodes(&self, plan: &ResolvedPatient) -> u32 {
        self.mesh_sizes.nodes(plan)
    }

    fn beat_s(&self, plan: &ResolvedPatient, threads: u32) -> f64 {
        let guess = match plan.settings.solver.fidelity {
            _ if self.simulation_s > 0.0 => self.simulation_s,
            Fidelity::Reduced => 1.0,
            // No better guess exists before the first beat has ended; `executor.slurm.simulation_s`
            // sets one.
            Fidelity::External => EXTERNAL_S,
            Fidelity::FiniteElement => {
                let nodes = self.mesh_nodes(plan);
                SLOWER * beat_s(nodes, threads, self.cores_per_node)
                    + ALONE_S_PER_NODE * f64::from(nodes)
            }
        };
        self.measured.get("organ-beat").copied().unwrap_or(guess)
    }

    /// Expected duration of one task of a patient on `threads` threads or ranks, s.
    #[must_use]
    pub fn task_s(&self, kind: &str, plan: &ResolvedPatient, threads: u32) -> f64 {
        if let Some(measured) = self.measured.get(kind) {
            return *measured;
        }
        match kind {
            "organ-beat" => self.beat_s(plan, threads),
            // With an external solver, step 0 runs on the reduced ventricle.
            "passive-state" if plan.settings.solver.fidelity == Fidelity::External => 3.0,
            "passive-state" => 3.0 * self.beat_s(plan, threads),
            "step1-proposal" | "step3-proposal" | "posterior" | "cell-fit" | "cell-sweep" => 60.0,
            "discover" => 600.0,
            _ => 1.0,
        }
    }

    /// Expected seconds for all kinds of a patient's chain, for the driver.
    #[must_use]
    pub fn by_kind(&self, plan: &ResolvedPatient, threads: u32) -> BTreeMap<String, f64> {
        let kinds = [
            "passive-state",
            "organ-beat",
            "step1-proposal",
            "step3-proposal",
            "posterior",
            "targets",
            "cell-fit",
            "cell-sweep",
            "discover",
            "noop",
        ];
        kinds
            .into_iter()
            .map(|kind| (kind.to_owned(), self.task_s(kind, plan, threads)))
            .collect()
    }

    /// Expected duration of the rest of a patient's chain, s; at least 0.1.
    #[must_use]
    pub fn rest_s(&self, plan: &ResolvedPatient, chain: &Chain, threads: u32) -> f64 {
        let task = |kind: &str| match &plan.workflow {
            Workflow::Noop { sleep_ms } => *sleep_ms as f64 / 1000.0 + 0.1,
            Workflow::Task { task } if kind == "noop" => match task.as_ref() {
                TaskSpec::Noop(noop) => noop.sleep_ms as f64 / 1000.0 + 0.1,
                _ => 0.1,
            },
            _ => self.task_s(kind, plan, threads),
        };
        rest(plan, chain)
            .into_iter()
            .map(|(kind, n)| n as f64 * task(kind))
            .sum::<f64>()
            .max(0.1)
    }
}

/// Number of remaining tasks of a patient's chain, by kind.
#[must_use]
pub fn rest(plan: &ResolvedPatient, chain: &Chain) -> Vec<(&'static str, usize)> {
    match &plan.workflow {
        Workflow::Noop { .. } => vec![("noop", 3 - chain.noops.len().min(3))],
        Workflow::Task { task } => vec![(task.kind(), usize::from(chain.task.is_none()))],
        Workflow::Personalise => {
            let proposes = plan.settings.step1_update() == Update::SpaceMapping;
            let in_law = plan.settings.solver.fidelity != Fidelity::Reduced
                && plan.settings.workflow.surrogate == Surrogate::OrganLaw;
            let [of_step1, of_step3] = if in_law { IN_LAW } else { WITHOUT_LAW };
            let iterations = if chain.step1.is_some() {
                0
            } else {
                of_step1.saturating_sub(chain.iterations.len()).max(1)
            };
            let settings = &plan.settings;
            let is_wanted =
                settings.verification.enabled && settings.workflow.until == LastStep::Step3;
            let step3 = if !is_wanted || chain.step3.is_some() {
                0
            } else {
                let most = of_step3.min(settings.step3.max_iterations as usize);
                most.saturating_sub(chain.step3_iterations.len())
            };
            vec![
                ("passive-state", usize::from(chain.step0.is_none())),
                (
                    "organ-beat",
                    iterations + usize::from(chain.verification.is_none()) + step3,
                ),
                ("step3-proposal", step3),
                (
                    "posterior",
                    usize::from(
                        is_wanted
                            && settings.posterior.enabled
                            && chain.posterior.is_none()
                            && chain.unanswered(Stage::Posterior).is_none(),
                    ),
                ),
                ("step1-proposal", if proposes { iterations } else { 0 }),
                ("targets", usize::from(chain.targets.is_none())),
                ("cell-fit", usize::from(chain.cell_fit.is_none())),
            ]
        }
    }
}
