//! Packs waiting patients into jobs for the site and within its limits.

use std::collections::BTreeMap;

use cardiotwin_schemas::allocation::Steps;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::plan::{self, Choices, InUse, Simulation, Sweep};
use cardiotwin_slurm::site::{Queue, Site, Unit};
use cardiotwin_slurm::state::Liveness;
use cardiotwin_store::cluster_jobs::{Allotment, JobSpec, Placed};

use super::expect::Expectations;
use super::profile::overhead_s;
use super::resources::ResourceRequest;
use crate::EngineError;
use crate::books::Books;

/// A job that would be submitted.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedJob {
    /// Resources and patients of the job.
    pub spec: JobSpec,
    /// Patients of each element, as indices into the books' patients.
    pub patients: Vec<Vec<usize>>,
    /// Expected working time of an element, s.
    pub predicted_s: f64,
    /// Whether the job belongs to this wave. Other jobs are submitted once earlier ones have ended.
    pub now: bool,
}

/// Key of a group of patients whose jobs get the same resources.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct JobGroupKey {
    share: ResourceRequest,
    memory_mib: Option<u64>,
    lanes: Option<u32>,
    exclude: Vec<String>,
}

/// Share of a queue's limits that the user's jobs take, whether they belong to this run or not.
pub fn in_use(queue: &Queue, rows: &[QueueRow], intended: u32) -> InUse {
    let mut used = InUse {
        queued: intended,
        ..InUse::default()
    };
    for row in rows
        .iter()
        .filter(|row| queue.qos.as_ref().is_none_or(|qos| row.qos == *qos))
    {
        let bearing = row.state.bearing();
        used.queued += u32::from(bearing != Liveness::Ended);
        if bearing == Liveness::Running {
            used.running += 1;
            used.nodes += row.n_nodes.unwrap_or(1);
            used.cores += row.n_cores.unwrap_or(1);
        }
    }
    used
}

/// Packs patients into jobs.
///
/// # Errors
/// [`EngineError::Site`] if the site has no queue for the work, or a patient fits into no job.
pub fn plan_jobs(
    books: &Books,
    patients: &[usize],
    site: &Site,
    settings: &ExecutorSettings,
    expected: &Expectations,
    in_use: &dyn Fn(&Queue) -> InUse,
) -> Result<Vec<PlannedJob>, EngineError> {
    let mut groups: BTreeMap<JobGroupKey, Vec<usize>> = BTreeMap::new();
    for &i in patients {
        let plan = books.plan(i)?;
        let Allotment {
            memory_mib,
            lanes,
            ranks_per_node,
            exclude,
            ..
        } = books.jobs().allotment(books.patient(i).row.id);
        let mesh_nodes = expected.mesh_nodes(plan);
        let like = JobGroupKey {
            share: ResourceRequest::of(plan, mesh_nodes, site, settings, ranks_per_node),
            memory_mib,
            lanes,
            exclude,
        };
        groups.entry(like).or_default().push(i);
    }
    let mut jobs = Vec::new();
    let mut taken: BTreeMap<&str, u32> = BTreeMap::new();
    for (like, patients) in groups {
        let queues = like
            .share
            .queues(site, settings)
            .map_err(|error| EngineError::Site {
                message: error.to_string(),
            })?;
        let mut plan_on = |queue, patients: &[usize]| -> Result<_, EngineError> {
            let mut used = in_use(queue);
            let queued = taken.entry(&queue.name).or_default();
            used.queued += *queued;
            let group = Group {
                books,
                site,
                queue,
                settings,
                expected,
                like: &like,
                used,
            };
            let whole_nodes = queue.unit.unwrap_or(site.node.unit) == Unit::Node;
            let planned = if like.share.in_3d && whole_nodes {
                group.bundles(patients)?
            } else {
                group.chunks(patients)?
            };
            let (now, later): (Vec<_>, Vec<_>) = planned.into_iter().partition(|job| job.now);
            let elements: usize = now.iter().map(|job| job.patients.len()).sum();
            *queued += u32::try_from(elements).unwrap_or(u32::MAX);
            Ok((now, later))
        };
        let [first, fallbacks @ ..] = &queues[..] else {
            continue;
        };
        let (now, mut later) = plan_on(first, &patients)?;
        jobs.extend(now);
        // What no fallback has room for waits for the first one.
        let last = fallbacks.last().map(|_| first);
        for queue in fallbacks.iter().chain(last) {
            if later.is_empty() {
                break;
            }
            let (now, rest) = plan_on(queue, &waiting_in(&later))?;
            jobs.extend(now);
            later = rest;
        }
        jobs.extend(later);
    }
    Ok(jobs)
}

/// Patients of jobs.
fn waiting_in(jobs: &[PlannedJob]) -> Vec<usize> {
    jobs.iter()
        .flat_map(|job| job.patients.iter().flatten().copied())
        .collect()
}

struct Group<'a> {
    books: &'a Books,
    site: &'a Site,
    queue: &'a Queue,
    settings: &'a ExecutorSettings,
    expected: &'a Expectations,
    like: &'a JobGroupKey,
    used: InUse,
}

impl Group<'_> {
    fn choices(&self) -> Choices {
        let slurm = &self.settings.slurm;
        let bundle_nodes = Some(slurm.bundle_nodes).filter(|n| *n > 0);
        Choices {
            good_length_s: slurm.job_s,
            bundle_nodes,
            overhead_s: overhead_s(slurm),
            ..Choices::default()
        }
    }

    fn rest_s(&self, i: usize) -> Result<f64, EngineError> {
        Ok(self.expected.rest_s(
            self.books.plan(i)?,
            &self.books.patient(i).chain,
            self.like.share.threads,
        ))
    }

    /// Number of patients side by side on a whole node.
    fn lanes(&self) -> u32 {
        let processes = self
            .like
            .share
            .ranks_per_node
            .unwrap_or(self.site.node.cores);
        let fit = (processes / self.like.share.threads.max(1)).max(1);
        self.like.lanes.unwrap_or(fit).clamp(1, fit)
    }

    /// Steps of MPI ranks, if simulations run on ranks.
    fn steps(&self) -> Option<Steps> {
        self.like.share.ranks_per_node.map(|_| Steps {
            nodes: self.like.share.nodes(),
            memory_mib: self
                .site
                .launcher
                .memory_of_share_mib(self.site.node, self.lanes()),
        })
    }

    fn refused(&self, error: &plan::PlanError) -> EngineError {
        EngineError::Site {
            message: format!("site {}: {error}", self.site.name),
        }
    }

    fn placed(&self, i: usize) -> Placed {
        let patient = self.books.patient(i);
        let plan = self.books.jobs().allotment(patient.row.id).plans;
        Placed {
            patient_id: patient.row.id,
            settled: patient.chain.steps().count(),
            plan,
        }
    }

    fn spec(
        &self,
        elements: &[Vec<usize>],
        is_array: bool,
        n_nodes: u32,
        walltime_s: u64,
    ) -> JobSpec {
        let whole_nodes = self.queue.unit.unwrap_or(self.site.node.unit) == Unit::Node;
        let lanes = if whole_nodes { self.lanes() } else { 1 };
        let n_cores = if whole_nodes {
            self.site.node.cores
        } else {
            self.like.share.threads.div_ceil(n_nodes.max(1))
        };
        let memory_mib = self
            .like
            .memory_mib
            .unwrap_or(self.settings.slurm.memory_mib)
            * u64::from(lanes);
        JobSpec {
            queue: self.queue.name.clone(),
            qos: self.queue.qos.clone(),
            is_array,
            at_once: None,
            n_nodes,
            n_cores,
            memory_mib: (!whole_nodes).then_some(memory_mib.min(self.site.node.memory_mib)),
            lanes,
            threads: self.like.share.threads,
            steps: self.steps(),
            walltime_s,
            expected_node_hours: 0.0,
            nodes_charged: if whole_nodes {
                f64::from(n_nodes)
            } else {
                f64::from(n_cores * n_nodes) / f64::from(self.site.node.cores)
            },
            exclude: self.like.exclude.clone(),
            elements: elements
                .iter()
                .map(|list| list.iter().map(|&i| self.placed(i)).collect())
                .collect(),
        }
    }

    /// Packs simulations into jobs of many whole nodes, with as many on each node as its cores
    /// allow. Every node takes the next patient when it is free.
    fn bundles(&self, patients: &[usize]) -> Result<Vec<PlannedJob>, EngineError> {
        let mut rests = Vec::with_capacity(patients.len());
        for &i in patients {
            rests.push((self.rest_s(i)?, i));
        }
        // Patients of similar length share a node, so that none waits long for the last of them.
        rests.sort_by(|a, b| b.0.total_cmp(&a.0));
        let loads: Vec<&[(f64, usize)]> = rests.chunks(self.lanes() as usize).collect();
        // A load takes whole nodes, whatever the number of its ranks.
        let ranks = self.site.node.cores * self.steps().map_or(1, |steps| steps.nodes);
        let simulations: Vec<Simulation> = (loads.iter().enumerate())
            .map(|(n, load)| Simulation {
                task: n.to_string(),
                ranks,
                predicted_s: load[0].0,
                has_checkpoints: true,
            })
            .collect();
        let bundles = plan::bundles(
            &simulations,
            self.site,
            self.queue,
            self.used,
            &self.choices(),
        );
        let bundles = bundles.map_err(|error| self.refused(&error))?;
        Ok(bundles
            .into_iter()
            .map(|bundle| {
                let order = bundle
                    .order()
                    .into_iter()
                    .filter_map(|task| task.parse::<usize>().ok());
                let list: Vec<usize> = order
                    .flat_map(|n| loads[n].iter().map(|(_, i)| *i))
                    .collect();
                let mut spec = self.spec(
                    std::slice::from_ref(&list),
                    false,
                    bundle.n_nodes,
                    bundle.walltime_s,
                );
                spec.expected_node_hours = bundle.node_hours;
                PlannedJob {
                    spec,
                    patients: vec![list],
                    predicted_s: bundle.predicted_s(),
                    now: bundle.now,
                }
            })
            .collect())
    }

    /// Packs work for single cores: many patients per element, many elements per array.
    fn chunks(&self, patients: &[usize]) -> Result<Vec<PlannedJob>, EngineError> {
        let mut rests = Vec::with_capacity(patients.len());
        for &i in patients {
            rests.push(self.rest_s(i)?);
        }
        let whole_nodes = self.queue.unit.unwrap_or(self.site.node.unit) == Unit::Node;
        // Core time on a node: a patient takes as many cores as it has threads.
        let share = if whole_nodes {
            f64::from(self.like.share.threads)
        } else {
            1.0
        };
        let mean_s = rests.iter().sum::<f64>() / rests.len().max(1) as f64 * share;
        let sweep = Sweep {
            n_blocks: patients.len() as u64,
            samples_per_block: 1,
            s_per_sample: mean_s,
        };
        // A chunk may not be longer than a job. If a single chain is, its driver leaves off and
        // continues in another job.
        let mut choices = self.choices();
        let longest_s =
            self.queue.walltime_s().saturating_sub(choices.overhead_s) as f64 / choices.safety;
        let sweep = Sweep {
            s_per_sample: sweep.s_per_sample.min(longest_s.max(1.0)),
            ..sweep
        };
        choices.good_length_s = choices.good_length_s.min(longest_s as u64).max(1);
        let chunks = plan::chunks(&sweep, self.site, self.queue, self.used, &choices)
            .map_err(|e| self.refused(&e))?;
        Ok(chunks
            .arrays
            .iter()
            .map(|array| {
                let lists: Vec<Vec<usize>> = (array.first..array.first + u64::from(array.n))
                    .map(|chunk| {
                        chunks
                            .blocks(chunk)
                            .filter_map(|block| patients.get(usize::try_from(block).ok()?).copied())
                            .collect()
                    })
                    .collect();
                let n_nodes = self.steps().map_or(1, |steps| steps.nodes);
                let mut spec = self.spec(&lists, array.n > 1, n_nodes, chunks.walltime_s);
                spec.at_once = array.at_once;
                spec.expected_node_hours =
                    chunks.node_hours * f64::from(array.n) / chunks.n_chunks.max(1) as f64;
                PlannedJob {
                    spec,
                    patients: lists,
                    predicted_s: chunks.predicted_s,
                    now: array.now,
                }
            })
            .collect())
    }
}
