//! Parser of the `#SBATCH` lines that [`cardiotwin_slurm::script`] writes.

use cardiotwin_slurm::job::number;
use cardiotwin_slurm::walltime::{self, Limit};

/// Resources and options that a script requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Request {
    pub name: String,
    pub account: String,
    pub partition: String,
    pub qos: String,
    pub n_nodes: u32,
    pub walltime_s: u64,
    /// Number of elements of the array; `None` for a single job.
    pub array: Option<u32>,
    pub at_once: Option<u32>,
    pub exclude: Vec<String>,
    pub requeue: bool,
    pub held: bool,
}

impl Request {
    /// Reads a script. `Err` is the message of sbatch.
    pub fn read(text: &str) -> Result<Self, String> {
        let mut request = Self {
            name: "script".to_owned(),
            account: "t01".to_owned(),
            partition: "main".to_owned(),
            qos: "normal".to_owned(),
            n_nodes: 1,
            walltime_s: 3600,
            array: None,
            at_once: None,
            exclude: Vec::new(),
            requeue: true,
            held: false,
        };
        for option in text
            .lines()
            .filter_map(|line| line.strip_prefix("#SBATCH "))
        {
            let (key, value) = option.split_once('=').unwrap_or((option, ""));
            match key {
                "--job-name" => value.clone_into(&mut request.name),
                "--account" => value.clone_into(&mut request.account),
                "--partition" => value.clone_into(&mut request.partition),
                "--qos" => value.clone_into(&mut request.qos),
                "--nodes" => {
                    request.n_nodes = number(value).ok_or("Node count specification invalid")?
                }
                "--time" => match walltime::parse(value) {
                    Some(Limit::Seconds(s)) => request.walltime_s = s,
                    _ => {
                        return Err(
                            "Requested time limit is invalid (missing or exceeds some limit)"
                                .to_owned(),
                        );
                    }
                },
                "--array" => {
                    let wrong = "Invalid job array specification";
                    let (range, at_once) = value
                        .split_once('%')
                        .map_or((value, None), |(range, n)| (range, Some(n)));
                    let last = range
                        .strip_prefix("0-")
                        .and_then(number::<u32>)
                        .ok_or(wrong)?;
                    request.array = Some(last.checked_add(1).ok_or(wrong)?);
                    request.at_once = at_once.map(|n| number(n).ok_or(wrong)).transpose()?;
                }
                "--exclude" => request.exclude = value.split(',').map(str::to_owned).collect(),
                "--no-requeue" => request.requeue = false,
                "--hold" => request.held = true,
                "--ntasks-per-node" | "--cpus-per-task" | "--exclusive" | "--mem"
                | "--open-mode" | "--export" | "--signal" | "--chdir" | "--output" => {}
                _ => return Err(format!("unrecognized option '{key}'")),
            }
        }
        Ok(request)
    }
}
