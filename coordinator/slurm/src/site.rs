//! Profile of a site: partitions, limits, launcher and charge as data (`deploy/sites/*.toml`),
//! refined by the limits that the site itself reports.

use serde::Deserialize;

use crate::answers::config::SiteConfig;
use crate::answers::qos::QosRow;
use crate::directives::{DirectiveError, check_directive};
use crate::walltime::{self, Limit};

/// Error in a profile. `toml`'s own messages name line and key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SiteError {
    /// The file is not TOML, or a key is unknown, missing, or has the wrong type.
    #[error("site profile {file}: {message}")]
    Read {
        /// Name of the file.
        file: String,
        /// Message with line and key.
        message: String,
    },
    /// An option that a job cannot have.
    #[error("site profile {file}: directives has `{directive}`: {problem}")]
    Directive {
        /// Name of the file.
        file: String,
        /// Option as the profile gives it.
        directive: String,
        /// Reason.
        problem: DirectiveError,
    },
    /// A value is out of its range.
    #[error("site profile {file}: {key} is {found}, expected {expected}")]
    Value {
        /// Name of the file.
        file: String,
        /// Name of the key.
        key: String,
        /// Value as the profile gives it.
        found: String,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
}

/// Smallest unit of resources that a job can get.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// A job gets whole nodes and is charged for all their cores.
    Node,
    /// A job can get some of a node's cores.
    Core,
}

/// Scheduler of a site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheduler {
    /// Slurm: tasks run in batch jobs.
    Slurm,
    /// No scheduler: tasks run on this machine with the local executor.
    Local,
}

/// Profile of a site.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Name of the site.
    pub name: String,
    /// Description for a person, with the source of the limits.
    pub description: String,
    /// Scheduler of the site.
    pub scheduler: Scheduler,
    /// Nodes of the site.
    pub node: Node,
    /// Queues. The first one of a use is taken unless another one is named.
    #[serde(default)]
    pub queue: Vec<Queue>,
    /// Support for job arrays.
    #[serde(default)]
    pub arrays: Arrays,
    /// Command that starts steps.
    #[serde(default)]
    pub launcher: Launcher,
    /// First lines of every script, such as modules and paths.
    #[serde(default)]
    pub setup: Vec<String>,
    /// Further options of every job, as on sbatch's command line.
    #[serde(default)]
    pub directives: Vec<String>,
    /// Whether jobs must name an account.
    #[serde(default)]
    pub needs_account: bool,
    /// Charge for a node-hour, in `charge_unit`.
    #[serde(default)]
    pub charge_per_node_hour: f64,
    /// Unit of the charge.
    #[serde(default)]
    pub charge_unit: String,
    /// Pause between two ticks.
    #[serde(default)]
    pub poll: Poll,
}

/// Nodes of a site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Cores that a job may use.
    pub cores: u32,
    /// Memory that a job may use, MiB.
    pub memory_mib: u64,
    /// Smallest unit of resources that a job can get.
    pub unit: Unit,
}

/// Use of a queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Use {
    /// Multi-node jobs of 3D simulations.
    Simulations,
    /// Chunks of 0D work.
    Chunks,
    /// The coordinator's own tick.
    Tick,
}

/// A partition with a QoS, and its limits; `None` means no such limit.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Queue {
    /// Name of the queue in this profile.
    pub name: String,
    /// Name of the partition; `None` means the site's default.
    pub partition: Option<String>,
    /// Name of the QoS; `None` means the site's default.
    pub qos: Option<String>,
    /// Uses of the queue.
    pub uses: Vec<Use>,
    /// Longest walltime of a job, as `D-HH:MM:SS`.
    pub walltime: String,
    /// Shortest walltime of a job, as `D-HH:MM:SS`.
    pub least_walltime: Option<String>,
    /// Largest number of a user's jobs that are queued or running. An element of an array counts as
    /// a job.
    pub max_queued: Option<u32>,
    /// Largest number of a user's running jobs.
    pub max_running: Option<u32>,
    /// Largest number of nodes of a job.
    pub max_nodes_per_job: Option<u32>,
    /// Smallest number of nodes of a job.
    pub min_nodes_per_job: Option<u32>,
    /// Largest number of nodes of a user's running jobs.
    pub max_nodes_per_user: Option<u32>,
    /// Largest number of cores of a user's running jobs.
    pub max_cores_per_user: Option<u32>,
    /// Number of nodes of the partition.
    pub nodes: Option<u32>,
    /// Smallest unit of resources that its jobs can get; `None` means [`Node::unit`].
    pub unit: Option<Unit>,
    /// Whether its jobs are not charged.
    #[serde(default)]
    pub free: bool,
}

/// Support for job arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arrays {
    /// Whether the site allows them.
    pub allowed: bool,
    /// Slurm's MaxArraySize, the largest number of elements of an array.
    #[serde(default = "slurms_default")]
    pub max_size: u32,
}

fn slurms_default() -> u32 {
    1001
}

impl Default for Arrays {
    fn default() -> Self {
        Self {
            allowed: true,
            max_size: slurms_default(),
        }
    }
}

/// Command that starts steps.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Launcher {
    /// Program and options for every step.
    #[serde(default = "srun")]
    pub command: Vec<String>,
    /// Further options of an MPI step.
    #[serde(default)]
    pub mpi: Vec<String>,
    /// Memory per core of a step that shares its node with others, MiB; `None` means an equal share
    /// of the node's memory.
    pub memory_per_core_mib: Option<u64>,
}

impl Launcher {
    /// Launcher of a simulation's step, from the one that the settings name: where both are the
    /// same program, the site's options come before the settings' options.
    #[must_use]
    pub fn of_steps(&self, named: &[String]) -> Vec<String> {
        match (named, &self.command[..]) {
            ([program, rest @ ..], [of_site, ..]) if program == of_site => {
                [&self.command[..], &self.mpi, rest].concat()
            }
            _ => named.to_vec(),
        }
    }

    /// Memory of a simulation on a node that `lanes` of them share, MiB.
    #[must_use]
    pub fn memory_of_share_mib(&self, node: Node, lanes: u32) -> u64 {
        let share = node.memory_mib / u64::from(lanes.max(1));
        let cores = u64::from(node.cores / lanes.max(1));
        self.memory_per_core_mib
            .map_or(share, |per_core| share.min(per_core * cores))
    }
}

fn srun() -> Vec<String> {
    vec!["srun".to_owned(), "--kill-on-bad-exit=1".to_owned()]
}

impl Default for Launcher {
    fn default() -> Self {
        Self {
            command: srun(),
            mpi: Vec::new(),
            memory_per_core_mib: None,
        }
    }
}

/// Pause between two ticks of the coordinator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Poll {
    /// Shortest pause, taken while jobs change their states \[s\].
    pub shortest_s: u64,
    /// Longest pause, reached when nothing changes \[s\].
    pub longest_s: u64,
}

impl Default for Poll {
    fn default() -> Self {
        Self {
            shortest_s: 30,
            longest_s: 180,
        }
    }
}

impl Queue {
    /// Longest walltime of a job \[s\].
    #[must_use]
    pub fn walltime_s(&self) -> u64 {
        seconds(&self.walltime).unwrap_or(0) // checked by `read`
    }

    /// Shortest walltime of a job \[s\]; 0 if the queue has no such limit.
    #[must_use]
    pub fn least_walltime_s(&self) -> u64 {
        self.least_walltime
            .as_deref()
            .and_then(seconds)
            .unwrap_or(0)
    }
}

fn seconds(text: &str) -> Option<u64> {
    match walltime::parse(text) {
        Some(Limit::Seconds(s)) if s > 0 => Some(s),
        _ => None,
    }
}

impl Site {
    /// Reads a profile. `file` is its name, for messages.
    ///
    /// # Errors
    /// [`SiteError`] for any mistake that would disturb a run later.
    pub fn read(file: &str, text: &str) -> Result<Self, SiteError> {
        let site: Self = toml::from_str(text).map_err(|error| SiteError::Read {
            file: file.to_owned(),
            message: error.to_string(),
        })?;
        site.check(file)?;
        Ok(site)
    }

    fn check(&self, file: &str) -> Result<(), SiteError> {
        let wrong = |key: String, found: String, expected| {
            Err(SiteError::Value {
                file: file.to_owned(),
                key,
                found,
                expected,
            })
        };
        if self.node.cores == 0 || self.node.memory_mib == 0 {
            return wrong(
                "node.cores or node.memory_mib".to_owned(),
                "0".to_owned(),
                "at least 1",
            );
        }
        if !(self.charge_per_node_hour.is_finite() && self.charge_per_node_hour >= 0.0) {
            return wrong(
                "charge_per_node_hour".to_owned(),
                self.charge_per_node_hour.to_string(),
                "0 or more",
            );
        }
        if self.launcher.command.is_empty() {
            return wrong(
                "launcher.command".to_owned(),
                "empty".to_owned(),
                "a program, such as [\"srun\"]",
            );
        }
        for directive in &self.directives {
            if let Err(problem) = check_directive(directive) {
                return Err(SiteError::Directive {
                    file: file.to_owned(),
                    directive: directive.clone(),
                    problem,
                });
            }
        }
        if self.arrays.allowed && self.arrays.max_size == 0 {
            return wrong(
                "arrays.max_size".to_owned(),
                "0".to_owned(),
                "at least 1, or allowed = false",
            );
        }
        if self.poll.shortest_s == 0 || self.poll.longest_s < self.poll.shortest_s {
            return wrong(
                "poll".to_owned(),
                format!("{:?}", self.poll),
                "shortest_s from 1, longest_s not below it",
            );
        }
        if self.scheduler == Scheduler::Slurm && self.queue.is_empty() {
            return wrong(
                "queue".to_owned(),
                "empty".to_owned(),
                "at least one [[queue]]",
            );
        }
        for (i, queue) in self.queue.iter().enumerate() {
            let key = |key: &str| format!("{key} of queue '{}'", queue.name);
            if self.queue[..i].iter().any(|other| other.name == queue.name) {
                return wrong(
                    "queue".to_owned(),
                    format!("'{}' twice", queue.name),
                    "a name for each queue",
                );
            }
            if seconds(&queue.walltime).is_none() {
                return wrong(
                    key("walltime"),
                    format!("'{}'", queue.walltime),
                    "a time such as \"24:00:00\" or \"4-00:00:00\"",
                );
            }
            let least = queue.least_walltime.as_deref();
            if least.is_some_and(|text| seconds(text).is_none_or(|s| s > queue.walltime_s())) {
                return wrong(
                    key("least_walltime"),
                    format!("{least:?}"),
                    "a time that is not above walltime",
                );
            }
            for (name, limit) in [
                ("max_queued", queue.max_queued),
                ("max_running", queue.max_running),
                ("max_nodes_per_job", queue.max_nodes_per_job),
                ("max_nodes_per_user", queue.max_nodes_per_user),
                ("max_cores_per_user", queue.max_cores_per_user),
                ("nodes", queue.nodes),
            ] {
                if limit == Some(0) {
                    return wrong(
                        key(name),
                        "0".to_owned(),
                        "at least 1; remove it if there is no limit",
                    );
                }
            }
            if queue.min_nodes_per_job > queue.max_nodes_per_job.or(queue.nodes).or(Some(u32::MAX))
            {
                return wrong(
                    key("min_nodes_per_job"),
                    format!("{:?}", queue.min_nodes_per_job),
                    "at most max_nodes_per_job",
                );
            }
        }
        Ok(())
    }

    /// The queue of this name, or else the first of this use.
    #[must_use]
    pub fn queue(&self, name: Option<&str>, used_for: Use) -> Option<&Queue> {
        self.queue.iter().find(|queue| match name {
            Some(name) => queue.name == name,
            None => queue.uses.contains(&used_for),
        })
    }

    /// Refines the profile by the limits that the site reports: the tighter of two limits holds.
    /// Returns what was changed.
    pub fn discover(&mut self, config: Option<&SiteConfig>, qos: &[QosRow]) -> Vec<String> {
        let mut changes = Vec::new();
        if let Some(size) = config
            .and_then(|config| config.max_array_size)
            .filter(|size| *size != self.arrays.max_size)
        {
            changes.push(format!(
                "arrays have at most {size} elements, but the profile has {}",
                self.arrays.max_size
            ));
            self.arrays = Arrays {
                allowed: self.arrays.allowed && size > 0,
                max_size: size,
            };
        }
        for queue in &mut self.queue {
            let Some(row) = qos.iter().find(|row| Some(&row.name) == queue.qos.as_ref()) else {
                continue;
            };
            let mut tighten = |what: &str, limit: &mut Option<u32>, told: Option<u32>| {
                if let Some(told) = told.filter(|told| limit.is_none_or(|limit| *told < limit)) {
                    changes.push(format!(
                        "queue '{}': {what} is {told}, but the profile has {limit:?}",
                        queue.name
                    ));
                    *limit = Some(told);
                }
            };
            tighten("max_queued", &mut queue.max_queued, row.max_queued);
            tighten("max_running", &mut queue.max_running, row.max_running);
            tighten(
                "max_nodes_per_job",
                &mut queue.max_nodes_per_job,
                row.of_a_job.nodes,
            );
            tighten(
                "max_nodes_per_user",
                &mut queue.max_nodes_per_user,
                row.of_a_user.nodes,
            );
            tighten(
                "max_cores_per_user",
                &mut queue.max_cores_per_user,
                row.of_a_user.cores,
            );
            if let Some(told) = row
                .walltime_s
                .filter(|told| *told > 0 && *told < queue.walltime_s())
            {
                let told = walltime::text(told);
                changes.push(format!(
                    "queue '{}': walltime is {told}, but the profile has {}",
                    queue.name, queue.walltime
                ));
                queue.walltime = told;
            }
        }
        changes
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{Scheduler, Site, SiteError, Unit, Use};
    use crate::answers::{config, qos, recorded};

    pub(crate) fn shipped(name: &str) -> Site {
        let file = format!(
            "{}/../../deploy/sites/{name}.toml",
            env!("CARGO_MANIFEST_DIR")
        );
        let text =
            std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("cannot read {file}: {e}"));
        Site::read(name, &text).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn the_shipped_profiles() {
        let archer2 = shipped("archer2");
        assert_eq!((archer2.node.cores, archer2.node.unit), (128, Unit::Node));
        let taskfarm = archer2
            .queue(None, Use::Simulations)
            .expect("a queue for simulations");
        assert_eq!(
            (taskfarm.name.as_str(), taskfarm.max_nodes_per_user),
            ("taskfarm", Some(256))
        );
        assert_eq!(shipped("generic").node.unit, Unit::Core);
        assert_eq!(shipped("laptop").scheduler, Scheduler::Local);
    }

    /// The one-machine Slurm has the limits of ARCHER2, so its reports agree with the profile.
    #[test]
    fn what_a_site_tells_is_laid_over_its_profile() {
        let qos = qos::read(&recorded::output("sacctmgr-qos"))
            .expect("an answer")
            .rows;
        let config = config::read(&recorded::output("scontrol-config")).expect("an answer");
        let mut site = shipped("archer2");
        assert_eq!(site.discover(Some(&config), &qos), Vec::<String>::new());
        site.queue[0].max_running = None;
        site.queue[0].walltime = "2-00:00:00".to_owned();
        site.arrays.max_size = 10;
        let changes = site.discover(Some(&config), &qos);
        assert_eq!(changes.len(), 3, "{changes:#?}");
        assert_eq!(site, shipped("archer2").clone_with_walltime("1-00:00:00"));
    }

    impl Site {
        fn clone_with_walltime(mut self, walltime: &str) -> Self {
            walltime.clone_into(&mut self.queue[0].walltime);
            self
        }
    }

    #[test]
    fn mistakes_are_named() {
        let good = "name='x'\ndescription=''\nscheduler='slurm'\nnode={cores=4,memory_mib=1,unit='core'}\n\
                    [[queue]]\nname='q'\nuses=['chunks']\nwalltime='01:00:00'\n";
        assert!(Site::read("x.toml", good).is_ok());
        for (from, to, says) in [
            ("01:00:00", "1 hour", "walltime of queue 'q' is '1 hour'"),
            ("cores=4", "cores=0", "node.cores"),
            ("uses", "use", "unknown field `use`"),
            ("'slurm'", "'pbs'", "unknown variant `pbs`"),
            (
                "name='q'",
                "name='q'\nmax_queued=0",
                "max_queued of queue 'q' is 0",
            ),
            (
                "name='q'",
                "name='q'\nleast_walltime='02:00:00'",
                "least_walltime",
            ),
        ] {
            let error = Site::read("x.toml", &good.replace(from, to)).expect_err(to);
            assert!(
                error.to_string().contains(says) && error.to_string().contains("x.toml"),
                "{error}"
            );
            if to == "use" {
                assert!(
                    matches!(&error, SiteError::Read { message, .. } if message.contains("line")),
                    "{error}"
                );
            }
        }
    }
}
