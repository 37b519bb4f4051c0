//! Worker processes on this machine, a limited number at once.
//!
//! Each worker leads its own process group, so that Ctrl-C on the terminal reaches only the
//! coordinator. A worker that outlives its coordinator is found by its claim and watched like a
//! child process. Two workers in one directory are harmless: the claim is created exclusively, and
//! the second worker ends with exit code 3.
//!
//! A 3D simulation may run on MPI ranks under a launcher. Rank 0 then holds the claim, and a
//! request to stop goes to rank 0 instead of the launcher. Rank 0 ends the other ranks. In a job
//! with several nodes, each attempt runs in a place of its own, and rank 0 may be on another node:
//! the launcher then passes the request on, and its end is the end of all ranks.

use std::collections::HashMap;
use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_protocol::claim::{self, ClaimFile};
use cardiotwin_protocol::{exit_code, files, names, process};
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, ExternalId};
use cardiotwin_schemas::progress::Claim;
use rustix::process::Signal;
use tokio::process::Command;
use tokio::sync::mpsc;

use super::evidence;
use super::launcher::{Launcher, Place, Places, SessionFolder};
use super::process::{signal_group, signal_process};
use super::{AttemptFindings, DispatchError, Executor, Found, News, Order};

/// Interval at which orphans and stopped workers are checked.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Time that a worker has to leave after SIGTERM. A beat finishes its current step before it writes
/// a checkpoint, which takes seconds on a large mesh.
const GRACE: Duration = Duration::from_secs(20);
/// Age from which an unreadable claim counts as cut off by the end of its writer.
const CLAIM_GRACE: Duration = Duration::from_secs(5);

/// Executor that runs worker processes on this machine.
#[derive(Debug)]
pub struct Local {
    worker: PathBuf,
    launcher: Option<Launcher>,
    /// Places of a job in which the launcher starts every attempt; `None` outside of a job.
    places: Option<Places>,
    at_once: usize,
    grace: Duration,
    running: HashMap<AttemptId, Running>,
    exits: mpsc::UnboundedReceiver<Exit>,
    tell: mpsc::UnboundedSender<Exit>,
}

#[derive(Debug)]
struct Running {
    directory: PathBuf,
    /// Place that is given back at the end.
    place: Option<Place>,
    pid: u32,
    start: u64,
    /// Claim of a worker that is not a child process and is therefore polled.
    orphan: Option<Claim>,
    stopped: Option<Instant>,
}

#[derive(Debug)]
struct Exit {
    attempt: AttemptId,
    status: std::io::Result<ExitStatus>,
}

impl Local {
    /// An executor that runs at most `at_once` processes of `worker`.
    #[must_use]
    pub fn new(worker: PathBuf, at_once: usize) -> Self {
        let (tell, exits) = mpsc::unbounded_channel();
        Self {
            worker,
            launcher: None,
            places: None,
            at_once,
            grace: GRACE,
            running: HashMap::new(),
            exits,
            tell,
        }
    }

    /// Runs 3D simulations that have several threads on as many ranks.
    #[must_use]
    pub fn with_launcher(self, launcher: Option<Launcher>) -> Self {
        Self { launcher, ..self }
    }

    /// Starts every attempt with the launcher, in one of these places of a job, whose number then
    /// limits the attempts at once.
    #[must_use]
    pub fn with_places(self, places: Option<Places>) -> Self {
        Self { places, ..self }
    }

    /// Command that runs an attempt, on ranks if it has several and there is a launcher, and the
    /// program's name for error messages.
    fn program(&self, n_ranks: u32, threads: u32, place: Option<&Place>) -> (Command, PathBuf) {
        let Some(launcher) = &self.launcher else {
            return (Command::new(&self.worker), self.worker.clone());
        };
        let command = match (place, n_ranks) {
            (Some(place), 1) => launcher.at(place, &self.worker, 1, threads),
            (Some(place), n) => launcher.at(place, &launcher.worker, n, 1),
            (None, 1) => return (Command::new(&self.worker), self.worker.clone()),
            (None, n) => launcher.anywhere(n),
        };
        (command, launcher.program().into())
    }

    /// Sets the time that workers have to leave before they are killed.
    #[must_use]
    pub fn with_grace(self, grace: Duration) -> Self {
        Self { grace, ..self }
    }

    fn spawn(&mut self, order: &Order, place: Option<&Place>) -> Result<u32, DispatchError> {
        let directory = &order.directory;
        let file = |what, path: PathBuf| move |source| DispatchError::File { what, path, source };
        fs::create_dir_all(directory).map_err(file("create", directory.clone()))?;
        let spec = serde_json::to_vec(&order.spec).expect("an attempt's spec is JSON");
        // A worker of an earlier coordinator may be reading the file, so that it is replaced as a
        // whole.
        let path = directory.join(names::SPEC);
        files::replace(&path, &spec).map_err(file("write", path))?;
        let path = directory.join(names::LOG);
        let log = File::options()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(file("open", path))?;
        let n_ranks = if order.spec.task.is_in_3d() {
            order.spec.threads
        } else {
            1
        };
        let (mut command, worker) = self.program(n_ranks, order.spec.threads, place);
        let session = match &self.launcher {
            Some(launcher) if worker == Path::new(launcher.program()) => {
                SessionFolder::of(launcher, &mut command)
            }
            _ => None,
        };
        let mut child = command
            .arg("run")
            .arg(directory)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .process_group(0)
            .spawn()
            .map_err(|source| DispatchError::Spawn { worker, source })?;
        let pid = child.id().unwrap_or_default();
        let (tell, attempt) = (self.tell.clone(), order.spec.attempt.clone());
        tokio::spawn(async move {
            let status = child.wait().await;
            drop(session);
            // The channel is closed only if the coordinator is ending.
            let _ = tell.send(Exit { attempt, status });
        });
        Ok(pid)
    }

    /// News that follow from the exit of a child process; `None` if the attempt is not watched any
    /// more.
    fn ended(&mut self, exit: Exit) -> Result<Option<News>, DispatchError> {
        let Exit { attempt, status } = exit;
        let Some(running) = self.running.get(&attempt) else {
            return Ok(None);
        };
        let directory = running.directory.clone();
        let was_placed = running.place.is_some();
        let claimed_before = status
            .as_ref()
            .is_ok_and(|s| s.code() == Some(i32::from(exit_code::CLAIMED)));
        let news = match self.look(&directory)? {
            // Another process holds the claim. An earlier coordinator started it and was killed
            // before it recorded that.
            Found::Alive(claim) if claim.pid != running.pid => {
                self.watch(&attempt, &directory, &claim);
                return Ok(Some(News::Alive { attempt, claim }));
            }
            Found::Over {
                evidence: found @ AttemptFindings::Outcome { .. },
                claim,
            } => News::Ended {
                attempt: attempt.clone(),
                evidence: found,
                claim,
            },
            Found::Over {
                evidence: found,
                claim,
            } if claimed_before => News::Ended {
                attempt: attempt.clone(),
                evidence: found,
                claim,
            },
            // A launcher ends after its ranks, wherever they ran.
            Found::Elsewhere(claim) if was_placed && !claimed_before => News::Ended {
                attempt: attempt.clone(),
                evidence: verdict(&directory, &status),
                claim: Some(claim),
            },
            Found::Elsewhere(_) => News::Vanished {
                attempt: attempt.clone(),
            },
            // The claim is being written by another process, as the child's exit code shows.
            Found::BeingClaimed if claimed_before => News::Vanished {
                attempt: attempt.clone(),
            },
            found => {
                let claim = match found {
                    Found::Over { claim, .. } => claim,
                    _ => None,
                };
                News::Ended {
                    attempt: attempt.clone(),
                    evidence: verdict(&directory, &status),
                    claim,
                }
            }
        };
        self.forget(&attempt);
        Ok(Some(news))
    }

    /// Stops watching an attempt that has ended, and gives its place back. An empty log is
    /// removed: an empty file costs a parallel file system as much as a full one.
    fn forget(&mut self, attempt: &AttemptId) {
        let Some(ended) = self.running.remove(attempt) else {
            return;
        };
        let log = ended.directory.join(names::LOG);
        if fs::metadata(&log).is_ok_and(|log| log.len() == 0) {
            // Whether it can be removed makes no difference to the attempt.
            let _ = fs::remove_file(&log);
        }
        let place = ended.place;
        if let (Some(places), Some(place)) = (&mut self.places, place) {
            places.give_back(place);
        }
    }

    fn look(&self, directory: &Path) -> Result<Found, DispatchError> {
        match evidence::claim_on(directory)? {
            ClaimFile::Absent => Ok(Found::Unclaimed),
            // A claim of unknown age may be being written at this moment.
            ClaimFile::Unreadable if claim::age(directory).is_none_or(|age| age < CLAIM_GRACE) => {
                Ok(Found::BeingClaimed)
            }
            ClaimFile::Unreadable => self.over(directory, None),
            ClaimFile::By(claim) if claim.host != process::host() => {
                match evidence::outcome(directory)? {
                    Some(evidence) => Ok(Found::Over {
                        evidence,
                        claim: Some(claim),
                    }),
                    None => Ok(Found::Elsewhere(claim)),
                }
            }
            ClaimFile::By(claim) if process::lives(&claim) => Ok(Found::Alive(claim)),
            ClaimFile::By(claim) => self.over(directory, Some(claim)),
        }
    }

    /// State of an attempt without a living process. Only now can the absence of an outcome be
    /// trusted, because no process is left to write one.
    fn over(&self, directory: &Path, claim: Option<Claim>) -> Result<Found, DispatchError> {
        let evidence = evidence::outcome(directory)?.unwrap_or_else(|| AttemptFindings::Nothing {
            class: FailureClass::Site,
            reason: with_last_words("the worker ended without an outcome", directory),
        });
        Ok(Found::Over { evidence, claim })
    }

    fn watch(&mut self, attempt: &AttemptId, directory: &Path, claim: &Claim) {
        let place = self
            .running
            .remove(attempt)
            .and_then(|earlier| earlier.place);
        let running = Running {
            directory: directory.to_owned(),
            place,
            pid: claim.pid,
            start: claim.pid_start_ticks,
            orphan: Some(claim.clone()),
            stopped: None,
        };
        self.running.insert(attempt.clone(), running);
    }

    /// Checks processes that are not children, and kills workers that did not leave in time.
    fn patrol(&mut self) -> Result<Vec<News>, DispatchError> {
        let mut over = Vec::new();
        for (attempt, running) in &mut self.running {
            if running
                .orphan
                .as_ref()
                .is_some_and(|claim| !process::lives(claim))
            {
                over.push((attempt.clone(), running.directory.clone()));
            } else if running.stopped.is_some_and(|at| at.elapsed() > self.grace) {
                running.press(true);
            }
        }
        let mut news = Vec::new();
        for (attempt, directory) in over {
            self.forget(&attempt);
            if let Found::Over { evidence, claim } = self.look(&directory)? {
                news.push(News::Ended {
                    attempt,
                    evidence,
                    claim,
                });
            }
        }
        Ok(news)
    }

    fn needs_patrol(&self) -> bool {
        self.running
            .values()
            .any(|r| r.orphan.is_some() || r.stopped.is_some())
    }
}

impl Running {
    /// Asks the worker to leave, or kills it `by_force`.
    fn press(&self, by_force: bool) {
        let rank_0 = match evidence::claim_on(&self.directory) {
            Ok(ClaimFile::By(claim)) if claim.pid != self.pid => Some(claim),
            _ => None,
        };
        let signal = if by_force { Signal::KILL } else { Signal::TERM };
        match rank_0 {
            // A launcher that gets the signal ends its ranks after a moment, before there is a
            // checkpoint. A launcher that loses a rank ends the other ones.
            Some(claim) if claim.host == process::host() && process::lives(&claim) => {
                signal_group(claim.pid, claim.pid_start_ticks, signal);
            }
            // Launchers end their ranks at SIGTERM, and pass SIGUSR2 on to them, at which a worker
            // leaves as at SIGTERM.
            Some(claim) if claim.host != process::host() && !by_force => {
                signal_process(self.pid, self.start, Signal::USR2);
            }
            _ => signal_group(self.pid, self.start, signal),
        }
    }
}

/// Evidence about a worker that left no outcome.
fn verdict(directory: &Path, status: &std::io::Result<ExitStatus>) -> AttemptFindings {
    let (class, reason) = match status {
        Ok(status) => match (status.signal(), status.code()) {
            (Some(6), _) => (
                FailureClass::Bug,
                "the worker aborted (signal 6)".to_owned(),
            ),
            (Some(signal), _) => (
                FailureClass::Site,
                format!("the worker was killed by signal {signal}"),
            ),
            (None, Some(101)) => (FailureClass::Bug, "the worker panicked".to_owned()),
            (None, Some(2)) => (
                FailureClass::Bug,
                "the worker rejected its arguments".to_owned(),
            ),
            (None, code) => {
                let code = code.unwrap_or_default();
                (
                    FailureClass::Site,
                    format!("the worker ended with exit code {code} and without an outcome"),
                )
            }
        },
        Err(error) => (
            FailureClass::Site,
            format!("cannot wait for the worker: {error}"),
        ),
    };
    AttemptFindings::Nothing {
        class,
        reason: with_last_words(&reason, directory),
    }
}

fn with_last_words(reason: &str, directory: &Path) -> String {
    evidence::last_words(directory)
        .map_or_else(|| reason.to_owned(), |words| format!("{reason}; {words}"))
}

/// Reports an unreadable directory as an end of class [`FailureClass::Site`], so that the engine's
/// loop decides what follows.
fn told(result: Result<Vec<News>, DispatchError>, attempt: Option<AttemptId>) -> Vec<News> {
    match (result, attempt) {
        (Ok(news), _) => news,
        (Err(error), Some(attempt)) => {
            let reason = error.to_string();
            vec![News::Ended {
                attempt,
                evidence: AttemptFindings::Nothing {
                    class: FailureClass::Site,
                    reason,
                },
                claim: None,
            }]
        }
        (Err(_), None) => Vec::new(), // the next patrol looks again
    }
}

impl Executor for Local {
    fn kind(&self) -> &'static str {
        "local"
    }

    fn free(&self) -> usize {
        match &self.places {
            Some(places) => places.n_free(),
            None => self.at_once.saturating_sub(self.running.len()),
        }
    }

    async fn submit(&mut self, order: Order) -> Result<ExternalId, DispatchError> {
        let place = self.places.as_mut().and_then(Places::take);
        let pid = match self.spawn(&order, place.as_ref()) {
            Ok(pid) => pid,
            Err(error) => {
                if let (Some(places), Some(place)) = (&mut self.places, place) {
                    places.give_back(place);
                }
                return Err(error);
            }
        };
        let start = process::start_ticks(pid).unwrap_or_default();
        let running = Running {
            directory: order.directory,
            place,
            pid,
            start,
            orphan: None,
            stopped: None,
        };
        self.running.insert(order.spec.attempt, running);
        Ok(ExternalId(pid.to_string()))
    }

    fn adopt(&mut self, attempt: &AttemptId, directory: &Path) -> Result<Found, DispatchError> {
        let found = self.look(directory)?;
        if let Found::Alive(claim) = &found {
            self.watch(attempt, directory, claim);
        }
        Ok(found)
    }

    fn stop(
        &mut self,
        attempt: &AttemptId,
        directory: &Path,
        now: bool,
    ) -> Result<bool, DispatchError> {
        evidence::revoke(directory, attempt, "its coordinator or its job stopped it")?;
        if let Some(running) = self.running.get_mut(attempt) {
            running.stopped.get_or_insert_with(Instant::now);
            running.press(now);
            return Ok(true);
        }
        Ok(false)
    }

    async fn news(&mut self) -> Vec<News> {
        loop {
            let mut news = Vec::new();
            let exit = if self.needs_patrol() {
                let result = self.patrol();
                news.extend(told(result, None));
                if !news.is_empty() {
                    return news;
                }
                tokio::time::timeout(LOOK_EVERY, self.exits.recv())
                    .await
                    .ok()
                    .flatten()
            } else {
                self.exits.recv().await
            };
            // Exits often come in groups. Those that are here already share a commit.
            let mut next = exit;
            while let Some(exit) = next {
                let attempt = exit.attempt.clone();
                let result = self.ended(exit).map(|news| news.into_iter().collect());
                if result.is_err() {
                    self.forget(&attempt);
                }
                news.extend(told(result, Some(attempt)));
                next = self.exits.try_recv().ok();
            }
            if !news.is_empty() {
                return news;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_protocol::closing::{PreparedOutcome, Winner};

    use super::*;

    #[test]
    fn a_half_written_claim_is_looked_at_again_and_given_up_once_it_is_old() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(names::CLAIM);
        std::fs::write(&path, "{\"host\":").unwrap();
        let local = Local::new("/bin/worker".into(), 1);
        let found = local.look(folder.path()).unwrap();
        assert!(matches!(found, Found::BeingClaimed), "{found:?}");
        let claim = std::fs::File::options().write(true).open(&path).unwrap();
        let long_ago = std::time::SystemTime::now() - 2 * CLAIM_GRACE;
        claim.set_modified(long_ago).unwrap();
        let found = local.look(folder.path()).unwrap();
        assert!(
            matches!(found, Found::Over { claim: None, .. }),
            "{found:?}"
        );
    }

    #[test]
    fn an_outcome_that_is_there_before_the_stop_is_found_and_none_comes_after() {
        let attempt = AttemptId {
            task: cardiotwin_schemas::ids::TaskKey("0".repeat(64)),
            generation: 1,
        };
        let outcome = cardiotwin_schemas::outcome::TaskOutcome {
            schema_version: cardiotwin_schemas::formats::OUTCOME.version,
            attempt: attempt.clone(),
            ending: cardiotwin_schemas::outcome::Ending::Cancelled,
            artefacts: vec![],
            provenance: Default::default(),
            sha256: None,
        };
        for is_first in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            let dead = Claim {
                pid_start_ticks: 0,
                ..crate::dispatch::claim_of_this_process()
            };
            assert!(claim::take(folder.path(), &dead).unwrap());
            let prepared = PreparedOutcome::new(folder.path(), &outcome).unwrap();
            let mut local = Local::new("/bin/worker".into(), 1);
            let winner = if is_first {
                let winner = prepared.publish().unwrap();
                assert!(!local.stop(&attempt, folder.path(), false).unwrap());
                winner
            } else {
                assert!(!local.stop(&attempt, folder.path(), false).unwrap());
                prepared.publish().unwrap()
            };
            assert_eq!(winner == Winner::Worker, is_first);
            let found = local.adopt(&attempt, folder.path()).unwrap();
            let Found::Over { evidence, .. } = found else {
                panic!("{found:?}")
            };
            assert_eq!(
                matches!(evidence, AttemptFindings::Outcome { .. }),
                is_first
            );
        }
    }

    #[test]
    fn several_ranks_go_to_the_launcher_where_there_is_one() {
        let launcher = Launcher {
            command: vec!["mpirun".to_owned()],
            worker: "/bin/ranks".into(),
        };
        let place = Place {
            hosts: vec!["n1".to_owned()],
            memory_mib: None,
        };
        let called = |launcher: Option<&Launcher>, n_ranks, place: Option<&Place>| {
            let local = Local::new("/bin/worker".into(), 1).with_launcher(launcher.cloned());
            let (command, named) = local.program(n_ranks, 4, place);
            let command = command.as_std();
            let words = std::iter::once(command.get_program()).chain(command.get_args());
            let line: Vec<String> = words
                .map(|word| word.to_string_lossy().into_owned())
                .collect();
            (line.join(" "), named.display().to_string())
        };
        let of = |line: &str, program: &str| (line.to_owned(), program.to_owned());
        let worker = of("/bin/worker", "/bin/worker");
        assert_eq!(called(None, 4, None), worker);
        assert_eq!(called(Some(&launcher), 1, None), worker);
        assert_eq!(
            called(Some(&launcher), 4, None),
            of("mpirun -n 4 /bin/ranks", "mpirun")
        );
        // In a place even one process is started by the launcher: the place may be on another node.
        assert_eq!(
            called(Some(&launcher), 1, Some(&place)),
            of("mpirun -n 1 --host n1:1 /bin/worker", "mpirun")
        );
        assert_eq!(
            called(Some(&launcher), 4, Some(&place)),
            of("mpirun -n 4 --host n1:4 /bin/ranks", "mpirun")
        );
    }
}
