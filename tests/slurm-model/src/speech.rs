//! Answers of the model, in the words of the real Slurm.

use super::{Fault, Job, Model, script::Request};
use cardiotwin_slurm::answers::{Exit, Output, accounting, queue};
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm::job::number;
use cardiotwin_slurm::state::{Liveness, SlurmState};
use cardiotwin_slurm::walltime;

const TIMED_OUT: &str = "Socket timed out on send/recv operation";
const NO_CONTROLLER: &str = "Unable to contact slurm controller (connect failure)";

fn said(code: i32, stdout: String, stderr: String) -> Output {
    Output {
        exit: Exit::Code(code),
        stdout,
        stderr,
    }
}

fn refused(detail: Option<&str>, why: &str) -> Output {
    let detail = detail
        .map(|detail| format!("sbatch: error: {detail}\n"))
        .unwrap_or_default();
    said(
        1,
        String::new(),
        format!("{detail}sbatch: error: Batch job submission failed: {why}\n"),
    )
}

const POLICY: &str =
    "Job violates accounting/QOS policy (job submit limit, user's size and/or time limits)";

impl Model {
    /// Runs one of [`cardiotwin_slurm::commands`]. `file` returns a script's text by its path. A fault applies
    /// to this command only.
    pub fn answer(
        &mut self,
        command: &Command,
        file: impl Fn(&str) -> Option<String>,
        fault: Option<Fault>,
    ) -> Output {
        let failed = |why: &str| match command.program {
            "sbatch" => refused(None, why),
            "squeue" => said(1, String::new(), format!("slurm_load_jobs error: {why}\n")),
            "sacct" => said(
                1,
                String::new(),
                "sacct: error: Problem talking to the database: Connection refused\n".to_owned(),
            ),
            program => said(1, String::new(), format!("{program}: error: {why}\n")),
        };
        match fault {
            Some(Fault::Down) => return failed(NO_CONTROLLER),
            Some(Fault::TimeoutBefore) => return failed(TIMED_OUT),
            Some(Fault::Refused(why)) => return failed(&why),
            _ => {}
        }
        let arguments = command
            .arguments
            .iter()
            .map(String::as_str)
            .collect::<Vec<_>>();
        let mut output = match command.program {
            "sbatch" => self.submit(
                arguments.last().copied().unwrap_or(""),
                file,
                arguments.contains(&"--test-only"),
            ),
            "squeue" => said(0, self.show_queue(), String::new()),
            "sacct" => self.show_accounting(&arguments),
            "scancel" => {
                self.cancel_those(&arguments);
                said(0, String::new(), String::new())
            }
            program => said(
                127,
                String::new(),
                format!("bash: {program}: command not found\n"),
            ),
        };
        match fault {
            Some(Fault::TimeoutAfter) => return failed(TIMED_OUT),
            Some(Fault::KilledAfter) => {
                return Output {
                    exit: Exit::Signal(9),
                    stdout: String::new(),
                    stderr: String::new(),
                };
            }
            Some(Fault::Garbage(garbage)) => output.stdout = garbage,
            Some(Fault::Cut(at)) => {
                let at = (0..=at.min(output.stdout.len()))
                    .rev()
                    .find(|at| output.stdout.is_char_boundary(*at))
                    .unwrap_or(0);
                output.stdout.truncate(at);
            }
            Some(Fault::Banner(banner)) => output.stdout = format!("{banner}\n{}", output.stdout),
            _ => {}
        }
        output
    }

    fn submit(
        &mut self,
        path: &str,
        file: impl Fn(&str) -> Option<String>,
        test_only: bool,
    ) -> Output {
        let Some(text) = file(path) else {
            return said(
                1,
                String::new(),
                format!("sbatch: error: Unable to open file {path}\n"),
            );
        };
        let request = match Request::read(&text) {
            Ok(request) => request,
            Err(why) if why.starts_with("unrecognized option") => {
                return said(
                    255,
                    String::new(),
                    format!("sbatch: {why}\nTry \"sbatch --help\" for more information\n"),
                );
            }
            Err(why) => return refused(None, &why),
        };
        let Some(limits) = self.settings.qos.get(&request.qos) else {
            return refused(None, "Invalid qos specification");
        };
        if request
            .array
            .is_some_and(|n| n > self.settings.max_array_size)
        {
            return refused(None, "Invalid job array specification");
        }
        if request.n_nodes == 0 || request.n_nodes > self.settings.n_nodes {
            return refused(None, "Node count specification invalid");
        }
        if limits
            .max_nodes_per_job
            .is_some_and(|n| request.n_nodes > n)
        {
            return refused(Some("QOSMaxNodePerJobLimit"), POLICY);
        }
        if limits.walltime_s.is_some_and(|s| request.walltime_s > s) {
            return refused(Some("QOSMaxWallDurationPerJobLimit"), POLICY);
        }
        let alive =
            |job: &&Job| job.request.qos == request.qos && job.state.bearing() != Liveness::Ended;
        let n_alive = self.jobs.iter().filter(alive).count() as u64;
        if limits
            .max_queued
            .is_some_and(|n| n_alive + u64::from(request.array.unwrap_or(1)) > n.into())
        {
            return refused(Some("QOSMaxSubmitJobPerUserLimit"), POLICY);
        }
        if test_only {
            return said(
                0,
                String::new(),
                format!(
                    "sbatch: Job {} to start at {}\n",
                    self.next_number, self.now
                ),
            );
        }
        let first = self.next_number;
        for element in 0..request.array.unwrap_or(1) {
            self.jobs.push(Job {
                number: self.next_number,
                array: request.array.map(|_| (first, element)),
                request: request.clone(),
                state: SlurmState::Pending,
                reason: if request.held { "JobHeldUser" } else { "None" }.to_owned(),
                submitted: self.now,
                start: None,
                end: None,
                nodes: Vec::new(),
                code: 0,
                signal: 0,
                cancelled: false,
                run: None,
            });
            self.next_number += 1;
            if !request.held {
                self.tell(self.jobs.len() - 1);
            }
        }
        said(0, format!("{first}\n"), String::new())
    }

    fn cancel_those(&mut self, arguments: &[&str]) {
        let name = arguments
            .iter()
            .find_map(|argument| argument.strip_prefix("--name="));
        for i in 0..self.jobs.len() {
            let job = &self.jobs[i];
            let (own, array) = (job.number.to_string(), job.array);
            let meant = |argument: &&str| match argument.split_once('_') {
                Some((number_of, element)) => array.is_some_and(|(a, e)| {
                    number(number_of) == Some(a) && number(element) == Some(e)
                }),
                None => {
                    **argument == own && array.is_none()
                        || array.is_some_and(|(a, _)| number(argument) == Some(a))
                }
            };
            if name.is_some_and(|name| name == job.request.name) || arguments.iter().any(meant) {
                self.cancel(i);
            }
        }
    }

    fn show_queue(&self) -> String {
        let mut text = format!("{}\n", queue::HEADER);
        let time = |time: Option<i64>| time.map_or("N/A".to_owned(), |time| time.to_string());
        for job in &self.jobs {
            let request = &job.request;
            let (array, element) = job
                .array
                .map_or((job.number, "N/A".to_owned()), |(a, e)| (a, e.to_string()));
            // For a job that was cancelled before it began, the end also appears as the start.
            let start = time(job.start.or(job.end));
            let end = time(
                job.end
                    .or_else(|| job.start.map(|start| start + request.walltime_s as i64)),
            );
            text += &format!(
                "ctq|{array}|{element}|{}|{}|{}|{}|{}|{}|{}|{}|{}|{}|{start}|{end}|{}|{}|ctq.\n",
                job.number,
                job.state.as_str(),
                job.reason,
                request.partition,
                request.qos,
                request.account,
                request.n_nodes,
                request.n_nodes,
                nodes(job),
                job.submitted,
                walltime::text(request.walltime_s),
                request.name,
            );
        }
        text
    }

    fn show_accounting(&self, arguments: &[&str]) -> Output {
        if !self.settings.has_accounting {
            return said(
                1,
                String::new(),
                "Slurm accounting storage is disabled\n".to_owned(),
            );
        }
        let option = |key: &str| {
            arguments
                .iter()
                .find_map(|argument| argument.strip_prefix(key))
        };
        let names = option("--name=").map(|names| names.split(',').collect::<Vec<_>>());
        let since = option("--starttime=uts")
            .and_then(number::<i64>)
            .unwrap_or(0);
        // The last report on each run that has reached the database.
        let mut rows = Vec::<&Job>::new();
        for (when, job) in &self.told {
            if *when > self.now - self.settings.accounting_lag_s
                || job.end.is_some_and(|end| end < since)
            {
                continue;
            }
            if names
                .as_ref()
                .is_some_and(|names| !names.contains(&job.request.name.as_str()))
            {
                continue;
            }
            let same = |row: &&mut &Job| row.number == job.number && row.submitted == job.submitted;
            match rows.iter_mut().find(same) {
                Some(row) => *row = job,
                None => rows.push(job),
            }
        }
        let mut text = format!("{}|\n", accounting::COLUMNS.replace(',', "|"));
        let time = |time: Option<i64>| time.map_or("Unknown".to_owned(), |time| time.to_string());
        for job in rows {
            let id = job
                .array
                .map_or(job.number.to_string(), |(a, e)| format!("{a}_{e}"));
            let by = if job.cancelled { " by 0" } else { "" };
            let elapsed = job
                .start
                .map_or(0, |start| job.end.unwrap_or(self.now) - start);
            let nodes = if job.nodes.is_empty() {
                "None assigned".to_owned()
            } else {
                nodes(job)
            };
            let request = &job.request;
            text += &format!(
                "{id}|{}|{}{by}|{}:{}|None|{}|{}|{}|{elapsed}|{}|{}|{nodes}|{}|{}|{}|\n",
                job.number,
                job.state.as_str(),
                job.code,
                job.signal,
                job.submitted,
                time(job.start),
                time(job.end),
                request.n_nodes,
                request.n_nodes,
                request.partition,
                request.qos,
                request.name,
            );
        }
        said(0, text, String::new())
    }
}

/// Names of a job's nodes, such as `n1,n3`. Slurm would write `n[1,3]`, but no code here takes that
/// apart.
fn nodes(job: &Job) -> String {
    job.nodes
        .iter()
        .map(|node| format!("n{node}"))
        .collect::<Vec<_>>()
        .join(",")
}
