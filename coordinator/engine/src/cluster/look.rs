//! Answers the questions of decisions from folders, Slurm and the store. The answers are plain data,
//! and nothing is decided here.

use cardiotwin_protocol::closing;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::access::folder::{self, JobFolder};
use cardiotwin_slurm::answers::{Output, accounting, queue};
use cardiotwin_slurm::commands::{self, Command};

use super::decide::{
    AttemptRemains, AttemptSeen, DriverReport, DriverReports, ElementFiles, Observation, Question,
    Remains, SiteSeen, Traces,
};
use super::{Cluster, profile};
use crate::EngineError;
use crate::dispatch;
use crate::files_seen::FilesSeen;
use crate::mesh_size;

impl<S: Scheduler> Cluster<S> {
    pub(super) async fn answer(&mut self, question: Question) -> Result<Observation, EngineError> {
        Ok(match question {
            Question::Chain(asked) => {
                let books = &mut self.state.books;
                books.recall(&mut self.writer, &asked.tasks).await?;
                Observation::Chain(FilesSeen::look(asked.files))
            }
            Question::Attempt { attempt, is_begun } => {
                Observation::Attempt(self.look_at_attempt(&attempt, is_begun)?)
            }
            Question::DriverReports { elements, intended } => {
                Observation::DriverReports(self.driver_reports(elements, intended))
            }
            Question::Queue => {
                let output = self.ask(&commands::queue()).await?;
                Observation::Queue(queue::read(&output))
            }
            Question::Accounting { names, since_s } => {
                let output = self.ask(&commands::accounting(&names, since_s)).await?;
                Observation::Accounting(accounting::read(&output))
            }
            Question::Traces(elements) => {
                let traces = elements.into_iter().map(|files| {
                    let traces = self.traces(&files);
                    (files.id, traces)
                });
                Observation::Traces(traces.collect())
            }
            Question::Remains { attempts, elements } => {
                Observation::Remains(self.remains(attempts, elements))
            }
            Question::Site {
                wants_limits,
                meshes,
            } => {
                let limits = match wants_limits {
                    true => Some(profile::limits(self).await?),
                    false => None,
                };
                let nodes = |path: std::path::PathBuf| {
                    let nodes = mesh_size::of_file(&path);
                    (path, nodes)
                };
                Observation::Site(SiteSeen {
                    limits,
                    mesh_nodes: meshes.into_iter().map(nodes).collect(),
                })
            }
        })
    }

    /// Runs a query of the scheduler.
    async fn ask(&mut self, command: &Command) -> Result<Output, EngineError> {
        self.commands += 1;
        self.run_command(command).await
    }

    fn folder_of(&self, files: &ElementFiles) -> JobFolder {
        JobFolder::of(self.state.books.run_dir(), &files.id.0)
    }

    fn look_at_attempt(
        &self,
        attempt: &AttemptId,
        is_begun: bool,
    ) -> Result<AttemptSeen, EngineError> {
        let directory = self.directory(attempt);
        if !is_begun {
            return Ok(match folder::is_begun(&directory) {
                true => AttemptSeen::Begun(folder::allocation_of(&directory)),
                false => AttemptSeen::Nothing,
            });
        }
        if let Some(evidence) = dispatch::outcome(&directory)? {
            return Ok(AttemptSeen::Ended(evidence));
        }
        let next = AttemptId {
            task: attempt.task.clone(),
            generation: attempt.generation + 1,
        };
        // A later job goes past an attempt only after revoking it, so it can publish nothing.
        let is_superseded =
            folder::is_begun(&self.directory(&next)) && closing::is_revoked(&directory);
        Ok(match is_superseded {
            true => AttemptSeen::Superseded,
            false => AttemptSeen::Nothing,
        })
    }

    fn driver_reports(
        &self,
        elements: Vec<(ElementFiles, bool)>,
        intended: Vec<String>,
    ) -> DriverReports {
        let report = |(files, is_accepted): (ElementFiles, bool)| {
            let report = self.driver_report(&files, is_accepted);
            (files.id, report)
        };
        let was_submitting =
            |name: &String| JobFolder::of(self.state.books.run_dir(), name).was_submitting();
        DriverReports {
            elements: elements.into_iter().map(report).collect(),
            submitting: intended.into_iter().filter(was_submitting).collect(),
        }
    }

    fn driver_report(&self, files: &ElementFiles, is_accepted: bool) -> DriverReport {
        let (folder, element) = (self.folder_of(files), files.id.1);
        let mut report = DriverReport::default();
        if !is_accepted {
            let Some(started) = folder.started(element, 0) else {
                return report;
            };
            report.has_started = true;
            report.job = started
                .job
                .and_then(|id| id.split('_').next()?.parse().ok());
        }
        let ends = (0..files.n_drivers).map(|node| folder.ended(element, node));
        report.ends = ends.collect();
        report
    }

    fn traces(&self, files: &ElementFiles) -> Traces {
        let (folder, element) = (self.folder_of(files), files.id.1);
        let drivers = 0..files.n_drivers;
        let has_started = |node| folder.started(element, node).is_some();
        Traces {
            started: drivers.clone().map(has_started).collect(),
            ends: drivers
                .clone()
                .map(|node| folder.ended(element, node))
                .collect(),
            asked_to_end: drivers
                .into_iter()
                .any(|node| folder.was_asked_to_end(element, node)),
            log_tail: folder.log_tail(files.is_array.then_some(element)),
        }
    }

    fn remains(&self, attempts: Vec<AttemptId>, elements: Vec<ElementFiles>) -> Remains {
        let of_attempt = |attempt: AttemptId| {
            let directory = self.directory(&attempt);
            let remains = AttemptRemains {
                job: folder::allocation_of(&directory).map(|allocation| allocation.job),
                is_revoked: closing::is_revoked(&directory),
                has_checkpoint: folder::has_checkpoint(&directory),
            };
            (attempt, remains)
        };
        let driver_ends = |files: ElementFiles| {
            let folder = self.folder_of(&files);
            let ends = (0..files.n_drivers).filter_map(|node| folder.ended(files.id.1, node));
            (files.id.clone(), ends.collect())
        };
        Remains {
            attempts: attempts.into_iter().map(of_attempt).collect(),
            driver_ends: elements.into_iter().map(driver_ends).collect(),
        }
    }
}
