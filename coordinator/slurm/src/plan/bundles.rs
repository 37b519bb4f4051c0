//! Packing of 3D simulations into multi-node jobs.

use super::{
    Choices, InUse, PlanError, check, check_time, longest_work_s, nodes_for, room, unit, walltime_s,
};
use crate::site::{Queue, Site, Unit};

/// A simulation to be packed.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Identifier of its task.
    pub task: String,
    /// Number of ranks, with one core each.
    pub ranks: u32,
    /// Expected duration on its ranks \[s\].
    pub predicted_s: f64,
    /// Whether it writes checkpoints. Only then may it be longer than a job.
    pub has_checkpoints: bool,
}

/// A place in a bundle, and the simulations that are expected to run there in sequence. The actual
/// assignment is made while the job runs: a free place takes the next simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Lane {
    /// Tasks in their order.
    pub tasks: Vec<String>,
    /// Sum of their expected durations, s.
    pub predicted_s: f64,
}

/// A job of many simulations.
#[derive(Debug, Clone, PartialEq)]
pub struct Bundle {
    /// Number of nodes of the job.
    pub n_nodes: u32,
    /// Number of nodes of each simulation.
    pub nodes_per_step: u32,
    /// Number of ranks of each simulation.
    pub ranks: u32,
    /// Places of the bundle.
    pub lanes: Vec<Lane>,
    /// Walltime to request for the whole job \[s\].
    pub walltime_s: u64,
    /// Whether it belongs to this wave. Other jobs are submitted once earlier ones have ended.
    pub now: bool,
    /// Expected node-hours. All nodes are charged until the last simulation ends.
    pub node_hours: f64,
}

impl Bundle {
    /// Expected duration of its fullest place, s.
    #[must_use]
    pub fn predicted_s(&self) -> f64 {
        self.lanes
            .iter()
            .map(|lane| lane.predicted_s)
            .fold(0.0, f64::max)
    }

    /// Tasks in the order of their start: the first of every place, then the second,
    /// and so on.
    #[must_use]
    pub fn order(&self) -> Vec<&str> {
        let longest = self
            .lanes
            .iter()
            .map(|lane| lane.tasks.len())
            .max()
            .unwrap_or(0);
        (0..longest)
            .flat_map(|i| {
                self.lanes
                    .iter()
                    .filter_map(move |lane| lane.tasks.get(i).map(String::as_str))
            })
            .collect()
    }
}

/// Packs all simulations, longest first, each into the place that becomes free first, so that the
/// places of a bundle end together. As many bundles are side by side as the queue runs at once.
///
/// # Errors
/// [`PlanError`] if a simulation fits into no job of the queue, or a duration is not a positive
/// number.
pub fn bundles(
    simulations: &[Simulation],
    site: &Site,
    queue: &Queue,
    in_use: InUse,
    choices: &Choices,
) -> Result<Vec<Bundle>, PlanError> {
    check(choices)?;
    let mut plan = Vec::new();
    let mut sizes = simulations
        .iter()
        .map(|s| s.ranks.max(1))
        .collect::<Vec<_>>();
    sizes.sort_unstable();
    sizes.dedup();
    let room = room(queue, in_use);
    let (mut jobs, mut running, mut nodes) = (room.jobs, room.running, room.nodes);
    for ranks in sizes.into_iter().rev() {
        let same = simulations
            .iter()
            .filter(|s| s.ranks.max(1) == ranks)
            .collect::<Vec<_>>();
        for bundle in of_one_size(&same, ranks, (running, nodes), site, queue, choices)? {
            let now = jobs > 0;
            jobs = jobs.saturating_sub(1);
            running = running.saturating_sub(1);
            nodes = nodes.saturating_sub(bundle.n_nodes);
            plan.push(Bundle { now, ..bundle });
        }
    }
    Ok(plan)
}

fn of_one_size(
    simulations: &[&Simulation],
    ranks: u32,
    (running, nodes): (u32, u32),
    site: &Site,
    queue: &Queue,
    choices: &Choices,
) -> Result<Vec<Bundle>, PlanError> {
    let nodes_per_step = nodes_for(ranks, site.node);
    let most = queue
        .max_nodes_per_job
        .unwrap_or(u32::MAX)
        .min(queue.nodes.unwrap_or(u32::MAX));
    let most = most.min(queue.max_nodes_per_user.unwrap_or(u32::MAX));
    let longest_s = longest_work_s(queue, choices);
    for simulation in simulations {
        check_time("predicted time", simulation.predicted_s)?;
        let not = |needs: String, limit: String| PlanError::DoesNotFit {
            task: simulation.task.clone(),
            needs,
            queue: queue.name.clone(),
            limit,
        };
        if nodes_per_step > most {
            return Err(not(
                format!("needs {nodes_per_step} nodes"),
                format!("{most}"),
            ));
        }
        if simulation.predicted_s > longest_s && !simulation.has_checkpoints {
            let needs = format!(
                "is expected to take {:.0} s and writes no checkpoints",
                simulation.predicted_s
            );
            return Err(not(needs, format!("{longest_s:.0} s of work")));
        }
    }
    // On a queue that gives single cores, a bundle would only wait for its last simulation, so each
    // simulation gets a job of its own.
    let bundle_nodes = match unit(site, queue) {
        Unit::Core => nodes_per_step,
        Unit::Node => choices
            .bundle_nodes
            .unwrap_or(most)
            .min(most)
            .max(nodes_per_step),
    };
    let places_of_a_bundle = (bundle_nodes / nodes_per_step).max(1);
    let n = simulations.len();
    // Number of places side by side: no more than the queue runs at once, but at least one, for the
    // time when there is room again.
    let side_by_side = (running.max(1).saturating_mul(places_of_a_bundle))
        .min(nodes / nodes_per_step)
        .max(1);
    let places = n.min(side_by_side as usize);

    let mut order = simulations.to_vec();
    order.sort_by(|a, b| {
        b.predicted_s
            .total_cmp(&a.predicted_s)
            .then_with(|| a.task.cmp(&b.task))
    });
    let (mut rounds, mut lanes) = (Vec::new(), Vec::<Lane>::new());
    for simulation in order {
        // A simulation that is longer than a job is cut by the walltime and continues from its
        // checkpoint in a later job.
        let takes_s = simulation.predicted_s.min(longest_s);
        let n_lanes = lanes.len();
        let least = lanes
            .iter_mut()
            .min_by(|a, b| a.predicted_s.total_cmp(&b.predicted_s));
        match least.filter(|lane| lane.predicted_s + takes_s <= longest_s) {
            Some(lane) if n_lanes == places => {
                lane.tasks.push(simulation.task.clone());
                lane.predicted_s += takes_s;
                continue;
            }
            None if n_lanes == places => {
                // Every place is full for the length of a job: close these jobs and begin further
                // ones.
                rounds.push(std::mem::take(&mut lanes));
            }
            _ => {}
        }
        lanes.push(Lane {
            tasks: vec![simulation.task.clone()],
            predicted_s: takes_s,
        });
    }
    rounds.push(lanes);

    let mut plan = Vec::new();
    for mut lanes in rounds {
        // Places of similar length share a job, so that few of its nodes idle at its end.
        lanes.sort_by(|a, b| b.predicted_s.total_cmp(&a.predicted_s));
        for lanes in lanes.chunks(places_of_a_bundle as usize) {
            let n_nodes =
                (lanes.len() as u32 * nodes_per_step).max(queue.min_nodes_per_job.unwrap_or(1));
            let work_s = lanes.first().map_or(0.0, |lane| lane.predicted_s);
            let walltime_s = walltime_s(work_s, queue, choices);
            let share = match unit(site, queue) {
                Unit::Node => f64::from(n_nodes),
                Unit::Core => f64::from(ranks) / f64::from(site.node.cores),
            };
            let node_hours = share * work_s / 3600.0;
            plan.push(Bundle {
                n_nodes,
                nodes_per_step,
                ranks,
                lanes: lanes.to_vec(),
                walltime_s,
                now: false,
                node_hours,
            });
        }
    }
    Ok(plan)
}
