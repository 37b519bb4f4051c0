//! Command lines that start a worker on MPI ranks, on the nodes of its place.
//!
//! In a job, a step inherits the job's options from its environment: cores of a task, tasks of a
//! node, memory. Everything that decides where ranks run is therefore stated on the command line.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::process::Command;

/// Launcher that runs 3D simulations on MPI ranks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Launcher {
    /// The launcher's program and arguments.
    pub command: Vec<String>,
    /// Executable of each rank.
    pub worker: PathBuf,
}

/// Nodes on which a simulation runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Names of the nodes, as the launcher knows them.
    pub hosts: Vec<String>,
    /// Memory of the simulation on its node, MiB, where it shares the node with others; `None`
    /// means all memory of its nodes.
    pub memory_mib: Option<u64>,
}

/// Family of launchers with the same options.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Family {
    /// The launcher of Slurm's steps, srun.
    Srun,
    /// mpirun and mpiexec of Open MPI.
    OpenMpi,
    /// mpirun and mpiexec of MPICH and its relatives.
    Hydra,
}

impl Family {
    /// Family of a program, by its name. A bare `mpirun` or `mpiexec` is taken for Open MPI's.
    fn of(program: &str) -> Self {
        let name = Path::new(program)
            .file_name()
            .unwrap_or(OsStr::new(program));
        match name.to_string_lossy().as_ref() {
            "srun" => Self::Srun,
            "mpirun.mpich" | "mpiexec.mpich" | "mpiexec.hydra" => Self::Hydra,
            _ => Self::OpenMpi,
        }
    }
}

impl Launcher {
    /// A launcher of the MPI executable next to `worker`; `None` for an empty command.
    #[must_use]
    pub fn beside(command: &[String], worker: &Path) -> Option<Self> {
        let worker = worker.with_file_name("cardiotwin-worker-mpi");
        (!command.is_empty()).then(|| Self {
            command: command.to_vec(),
            worker,
        })
    }

    /// The launcher's program, for messages.
    #[must_use]
    pub fn program(&self) -> &str {
        self.words().1
    }

    /// The command in three: `env` and its assignments, where it starts with them, the launcher's
    /// program, and the program's own arguments.
    fn words(&self) -> (&[String], &str, &[String]) {
        let prepares = |word: &String| word == "env" || word.contains('=');
        let starts_with_env = self.command.first().is_some_and(|word| word == "env");
        let at = if starts_with_env {
            self.command.iter().position(|word| !prepares(word))
        } else {
            None
        };
        let (environment, rest) = self.command.split_at(at.unwrap_or(0));
        match rest.split_first() {
            Some((program, arguments)) => (environment, program, arguments),
            None => (environment, "", &[]),
        }
    }

    /// Command that runs `n_ranks` ranks of the worker on this machine, or wherever the launcher
    /// itself decides.
    #[must_use]
    pub fn anywhere(&self, n_ranks: u32) -> Command {
        self.line(&["-n".to_owned(), n_ranks.to_string()], &self.worker)
    }

    /// Command that runs `n_processes` processes of `worker` on the nodes of a place, with
    /// `n_cores` cores for each.
    #[must_use]
    pub fn at(&self, place: &Place, worker: &Path, n_processes: u32, n_cores: u32) -> Command {
        let n_nodes = u32::try_from(place.hosts.len()).unwrap_or(u32::MAX);
        let n_nodes = n_nodes.clamp(1, n_processes.max(1));
        let per_node = n_processes.div_ceil(n_nodes);
        let hosts = &place.hosts[..place.hosts.len().min(n_nodes as usize)];
        let options = match Family::of(self.program()) {
            Family::Srun => vec![
                "--exact".to_owned(),
                format!("--nodes={n_nodes}"),
                format!("--ntasks={n_processes}"),
                format!("--ntasks-per-node={per_node}"),
                format!("--cpus-per-task={n_cores}"),
                match place.memory_mib {
                    Some(memory) => format!("--mem={memory}M"),
                    None => "--mem=0".to_owned(),
                },
                format!("--nodelist={}", hosts.join(",")),
            ],
            Family::OpenMpi => {
                let slots = |host: &String| format!("{host}:{per_node}");
                let hosts: Vec<String> = hosts.iter().map(slots).collect();
                let mut options = ["-n", &n_processes.to_string(), "--host", &hosts.join(",")]
                    .map(str::to_owned)
                    .to_vec();
                // Where simulations share a node, each mpirun would bind its ranks to the node's
                // first cores.
                if place.memory_mib.is_some() {
                    options.extend(["--bind-to", "none"].map(str::to_owned));
                }
                options
            }
            Family::Hydra => [
                "-n",
                &n_processes.to_string(),
                "-ppn",
                &per_node.to_string(),
                "-hosts",
                &hosts.join(","),
            ]
            .map(str::to_owned)
            .to_vec(),
        };
        self.line(&options, worker)
    }

    /// The command's own arguments come last, so that they win where a launcher takes the last of
    /// two options.
    fn line(&self, options: &[String], worker: &Path) -> Command {
        let (environment, program, arguments) = self.words();
        let mut words = environment.iter().map(String::as_str).chain([program]);
        let mut command = Command::new(words.next().unwrap_or_default());
        command
            .args(words)
            .args(options)
            .args(arguments)
            .arg(worker);
        if Family::of(program) == Family::Srun && std::env::var_os(PMIX_FENCE).is_none() {
            command.env(PMIX_FENCE, "tree");
        }
        command
    }
}

/// Variable that chooses how the nodes of a step wait for each other in Slurm's PMIx plugin. The
/// plugin's own choice, two algorithms in turn, lets ranks leave `MPI_Init` before others are ready,
/// which crashes Open MPI (3 of 100 starts on four nodes; docs/mpi.md).
const PMIX_FENCE: &str = "SLURM_PMIX_FENCE";

/// Variables that name the parent of an mpirun's session folder: Open MPI 4, and 5.
const SESSION_PARENTS: [&str; 2] = ["OMPI_MCA_orte_tmpdir_base", "PRTE_MCA_prte_tmpdir_base"];

/// Folder for the session of one mpirun of Open MPI, removed with the value.
///
/// By default all sessions of a user on a node have one parent. An mpirun that ends removes the
/// parent, and another one that is creating its session there at that moment fails (Open MPI,
/// issue 8510). Simulations side by side therefore get parents of their own.
#[derive(Debug)]
pub struct SessionFolder {
    path: PathBuf,
}

impl SessionFolder {
    /// A new folder for a command of this launcher, which is told of it. `None` for other launchers
    /// than Open MPI's, where the user has chosen a parent, and where no folder can be created.
    pub fn of(launcher: &Launcher, command: &mut Command) -> Option<Self> {
        static N_SESSIONS: AtomicU64 = AtomicU64::new(0);
        let is_chosen = SESSION_PARENTS
            .map(std::env::var_os)
            .iter()
            .any(Option::is_some);
        if Family::of(launcher.program()) != Family::OpenMpi || is_chosen {
            return None;
        }
        let n = N_SESSIONS.fetch_add(1, Ordering::Relaxed);
        let name = format!("cardiotwin-mpirun-{}-{n}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).ok()?;
        for variable in SESSION_PARENTS {
            command.env(variable, &path);
        }
        Some(Self { path })
    }
}

impl Drop for SessionFolder {
    fn drop(&mut self) {
        // What a killed mpirun left goes, too. A folder that stays makes no difference.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

/// Places of a job, free and taken.
#[derive(Debug, Clone)]
pub struct Places {
    free: Vec<Place>,
}

impl Places {
    /// Places on `hosts`: each takes `nodes_per_place` nodes, or a share of one node where `lanes`
    /// simulations run side by side on it.
    ///
    /// - `memory_mib`: memory of such a share, MiB
    #[must_use]
    pub fn on(
        hosts: &[String],
        nodes_per_place: usize,
        lanes: usize,
        memory_mib: Option<u64>,
    ) -> Self {
        let nodes_per_place = nodes_per_place.max(1);
        let lanes = if nodes_per_place > 1 { 1 } else { lanes.max(1) };
        let whole = hosts.chunks_exact(nodes_per_place);
        // Every node gets its first simulation before any gets its second.
        let mut free: Vec<Place> = (0..lanes)
            .flat_map(|_| whole.clone())
            .map(|hosts| Place {
                hosts: hosts.to_vec(),
                memory_mib: memory_mib.filter(|_| lanes > 1),
            })
            .collect();
        free.reverse();
        Self { free }
    }

    /// Number of free places.
    #[must_use]
    pub fn n_free(&self) -> usize {
        self.free.len()
    }

    /// Takes a free place; `None` if all are taken.
    pub fn take(&mut self) -> Option<Place> {
        self.free.pop()
    }

    /// Gives a place back.
    pub fn give_back(&mut self, place: Place) {
        self.free.push(place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_mpirun_of_open_mpi_has_a_session_folder_until_it_ends() {
        let launcher = |program: &str| Launcher {
            command: vec![program.to_owned()],
            worker: "/bin/ranks".into(),
        };
        let parent = |command: &Command| {
            let mut variables = command.as_std().get_envs();
            let found = variables.find(|(name, _)| *name == SESSION_PARENTS[0]);
            found.and_then(|(_, value)| Some(PathBuf::from(value?)))
        };
        let mut commands = [(); 2].map(|()| launcher("mpirun").anywhere(2));
        let sessions = commands
            .each_mut()
            .map(|command| SessionFolder::of(&launcher("mpirun"), command));
        let folders = commands.each_ref().map(parent);
        assert_ne!(folders[0], folders[1]);
        assert!(
            folders
                .iter()
                .flatten()
                .filter(|path| path.is_dir())
                .count()
                == 2
        );
        drop(sessions);
        assert!(!folders.iter().flatten().any(|path| path.exists()));
        for other in ["srun", "mpirun.mpich"] {
            let mut command = launcher(other).anywhere(2);
            assert!(SessionFolder::of(&launcher(other), &mut command).is_none());
            assert_eq!(parent(&command), None);
        }
    }

    fn words(command: &Command) -> String {
        let command = command.as_std();
        let words = std::iter::once(command.get_program()).chain(command.get_args());
        words
            .map(|word| word.to_string_lossy().into_owned())
            .collect::<Vec<_>>()
            .join(" ")
    }

    fn launcher(command: &[&str]) -> Launcher {
        Launcher {
            command: command.iter().map(|&word| word.to_owned()).collect(),
            worker: "/bin/ranks".into(),
        }
    }

    #[test]
    fn every_launcher_is_told_where_its_ranks_run() {
        let two = Place {
            hosts: vec!["n1".into(), "n2".into()],
            memory_mib: None,
        };
        let line = |command: &[&str], place: &Place, n: u32| {
            let launcher = launcher(command);
            words(&launcher.at(place, &launcher.worker, n, 1))
        };
        assert_eq!(
            line(&["/usr/bin/srun", "--mpi=pmix"], &two, 6),
            "/usr/bin/srun --exact --nodes=2 --ntasks=6 --ntasks-per-node=3 --cpus-per-task=1 \
             --mem=0 --nodelist=n1,n2 --mpi=pmix /bin/ranks"
        );
        assert_eq!(
            line(&["mpirun", "--oversubscribe"], &two, 6),
            "mpirun -n 6 --host n1:3,n2:3 --oversubscribe /bin/ranks"
        );
        assert_eq!(
            line(&["mpiexec.hydra"], &two, 6),
            "mpiexec.hydra -n 6 -ppn 3 -hosts n1,n2 /bin/ranks"
        );
        let share = Place {
            hosts: vec!["n1".into()],
            memory_mib: Some(96_000),
        };
        assert!(line(&["srun"], &share, 64).contains("--nodes=1 --ntasks=64 --ntasks-per-node=64 --cpus-per-task=1 --mem=96000M --nodelist=n1"));
        assert!(line(&["mpirun"], &share, 2).contains("--bind-to none"));
        // A task of one process runs on the first node of its place, with the place's cores.
        let srun = launcher(&["srun"]);
        let alone = words(&srun.at(&two, Path::new("/bin/worker"), 1, 8));
        assert!(
            alone.contains("--nodes=1 --ntasks=1 --ntasks-per-node=1 --cpus-per-task=8")
                && alone.contains("--nodelist=n1 /bin/worker"),
            "{alone}"
        );
        assert_eq!(
            words(&launcher(&["mpirun", "--bind-to", "none"]).anywhere(4)),
            "mpirun -n 4 --bind-to none /bin/ranks"
        );
        let prepared = launcher(&["env", "A=1", "B=2", "mpiexec.hydra", "-v"]);
        assert_eq!(prepared.program(), "mpiexec.hydra");
        assert_eq!(
            words(&prepared.at(&two, &prepared.worker, 2, 1)),
            "env A=1 B=2 mpiexec.hydra -n 2 -ppn 1 -hosts n1,n2 -v /bin/ranks"
        );
    }

    #[test]
    fn nodes_are_shared_out_once() {
        let hosts: Vec<String> = ["n1", "n2", "n3"].map(str::to_owned).to_vec();
        let taken = |mut places: Places| -> Vec<String> {
            std::iter::from_fn(|| places.take())
                .map(|place| place.hosts.join("+"))
                .collect()
        };
        let shared = taken(Places::on(&hosts, 1, 2, Some(1000)));
        assert_eq!(shared, ["n1", "n2", "n3", "n1", "n2", "n3"]);
        assert_eq!(taken(Places::on(&hosts, 2, 4, None)), ["n1+n2"]);
        let mut places = Places::on(&hosts, 3, 1, None);
        let place = places.take().expect("a place");
        assert_eq!((places.n_free(), places.take()), (0, None));
        places.give_back(place);
        assert_eq!(places.n_free(), 1);
    }
}
