//! Answers of `sacctmgr show qos` and `show assoc`: limits of QoS and associations.

use super::{NoAnswer, Output, Table};
use crate::job::number;
use crate::walltime::{self, Limit};

/// Requested columns of QoS.
pub const COLUMNS: &str =
    "Name,Flags,MaxWall,MaxSubmitPU,MaxJobsPU,MaxTRES,MinTRES,MaxTRESPU,GrpTRES,UsageFactor";
const HEADER: &str =
    "Name|Flags|MaxWall|MaxSubmitPU|MaxJobsPU|MaxTRES|MinTRES|MaxTRESPU|GrpTRES|UsageFactor|";
/// Requested columns of associations.
pub const ASSOCIATION_COLUMNS: &str = "Cluster,Account,Partition,QOS,DefaultQOS,MaxSubmit,MaxJobs";
const ASSOCIATION_HEADER: &str = "Cluster|Account|Partition|QOS|Def QOS|MaxSubmit|MaxJobs|";

/// Limits on resources; `None` means no limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Amounts {
    /// Limit on the number of nodes.
    pub nodes: Option<u32>,
    /// Limit on the number of cores.
    pub cores: Option<u32>,
    /// Limit on the memory \[MiB\].
    pub memory_mib: Option<u64>,
}

/// A QoS and its limits; `None` means that the QoS has no such limit.
#[derive(Debug, Clone, PartialEq)]
pub struct QosRow {
    /// Name of the QoS.
    pub name: String,
    /// Whether a job that exceeds a limit is refused at once instead of waiting for ever.
    pub denies_on_limit: bool,
    /// Longest walltime of a job, s.
    pub walltime_s: Option<u64>,
    /// Largest number of a user's jobs that are queued or running.
    pub max_queued: Option<u32>,
    /// Largest number of a user's running jobs.
    pub max_running: Option<u32>,
    /// Largest resources of one job.
    pub of_a_job: Amounts,
    /// Smallest resources of one job.
    pub least_of_a_job: Amounts,
    /// Largest resources of all running jobs of a user.
    pub of_a_user: Amounts,
    /// Largest resources of all running jobs in this QoS.
    pub of_all: Amounts,
    /// Factor on the charge; 0 means free.
    pub usage_factor: Option<f64>,
}

/// An association of a user with an account.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AssociationRow {
    /// Name of the cluster.
    pub cluster: String,
    /// Name of the account.
    pub account: String,
    /// Name of the partition; `None` if the association holds in all of them.
    pub partition: Option<String>,
    /// Names of the QoS in which the user may submit to this account.
    pub qos: Vec<String>,
    /// QoS of jobs that do not name one.
    pub default_qos: Option<String>,
    /// Largest number of jobs of this user and account that are queued or running.
    pub max_queued: Option<u32>,
    /// Largest number of running jobs of this user and account.
    pub max_running: Option<u32>,
}

/// `Some(None)` for an empty cell, `Some(Some(value))` for a readable one, and `None` for any
/// other, which makes the row unreadable.
fn optional<T>(text: &str, read: impl Fn(&str) -> Option<T>) -> Option<Option<T>> {
    if text.is_empty() {
        Some(None)
    } else {
        read(text).map(Some)
    }
}

fn amounts(text: &str) -> Option<Amounts> {
    let mut amounts = Amounts::default();
    for part in text.split(',').filter(|part| !part.is_empty()) {
        let (what, how_much) = part.split_once('=')?;
        match what {
            "node" => amounts.nodes = Some(number(how_much)?),
            "cpu" => amounts.cores = Some(number(how_much)?),
            "mem" => amounts.memory_mib = Some(mebibytes(how_much)?),
            _ => {} // gres/gpu and others, which are never requested here
        }
    }
    Some(amounts)
}

/// Reads a size such as `128G` in MiB. A number without a unit is in MiB.
fn mebibytes(text: &str) -> Option<u64> {
    let (digits, factor) = match text.strip_suffix(['M', 'G', 'T', 'P']) {
        Some(digits) => (
            digits,
            match text.as_bytes()[text.len() - 1] {
                b'M' => 1,
                b'G' => 1 << 10,
                b'T' => 1 << 20,
                _ => 1 << 30,
            },
        ),
        None => (text, 1),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, "0"));
    let whole = number::<u64>(whole)?.checked_mul(factor)?;
    number::<u64>(fraction)?;
    // Slurm rounds `1.50T` for display. The fraction is rounded down so that the limit is never
    // exceeded.
    let fraction = format!("0.{fraction}").parse::<f64>().ok()?;
    whole.checked_add((fraction * factor as f64) as u64)
}

/// Reads the answer to [`crate::commands::qos`].
///
/// # Errors
/// [`NoAnswer`] if there is no accounting or the output is not the requested table.
pub fn read(output: &Output) -> Result<Table<QosRow>, NoAnswer> {
    super::table("sacctmgr show qos", output, HEADER, "", "|", |cells| {
        let [
            name,
            flags,
            wall,
            submit,
            jobs,
            max,
            min,
            of_user,
            of_all,
            usage,
        ] = cells
        else {
            return None;
        };
        let wall = optional(wall, walltime::parse)?.and_then(|limit| match limit {
            Limit::Seconds(s) => Some(s),
            Limit::Unlimited => None,
        });
        Some(QosRow {
            name: Some(*name).filter(|name| !name.is_empty())?.to_owned(),
            denies_on_limit: flags.split(',').any(|flag| flag == "DenyOnLimit"),
            walltime_s: wall,
            max_queued: optional(submit, number)?,
            max_running: optional(jobs, number)?,
            of_a_job: amounts(max)?,
            least_of_a_job: amounts(min)?,
            of_a_user: amounts(of_user)?,
            of_all: amounts(of_all)?,
            usage_factor: optional(usage, |text| {
                text.parse::<f64>()
                    .ok()
                    .filter(|f| f.is_finite() && *f >= 0.0)
            })?,
        })
    })
}

/// Reads the answer to [`crate::commands::associations`].
///
/// # Errors
/// As [`read`].
pub fn read_associations(output: &Output) -> Result<Table<AssociationRow>, NoAnswer> {
    super::table(
        "sacctmgr show assoc",
        output,
        ASSOCIATION_HEADER,
        "",
        "|",
        |cells| {
            let [cluster, account, partition, qos, default_qos, submit, jobs] = cells else {
                return None;
            };
            let some = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
            Some(AssociationRow {
                cluster: some(cluster)?,
                account: some(account)?,
                partition: some(partition),
                qos: qos
                    .split(',')
                    .filter(|name| !name.is_empty())
                    .map(str::to_owned)
                    .collect(),
                default_qos: some(default_qos),
                max_queued: optional(submit, number)?,
                max_running: optional(jobs, number)?,
            })
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Exit, NoAnswer, Output, recorded};
    use super::{HEADER, mebibytes, read, read_associations};
    use proptest::prelude::*;

    #[test]
    fn real_limits() {
        let table = read(&recorded::output("sacctmgr-qos")).expect("sacctmgr answered");
        assert!(table.is_whole(), "{:?}", table.unreadable);
        insta::assert_debug_snapshot!(table.rows);
        assert!(matches!(
            read(&recorded::output("sacctmgr-no-slurmdbd")),
            Err(NoAnswer::Failed { .. })
        ));
    }

    #[test]
    fn real_associations() {
        let table =
            read_associations(&recorded::output("sacctmgr-assoc")).expect("sacctmgr answered");
        assert!(table.is_whole());
        let account = table
            .rows
            .iter()
            .find(|row| row.account == "t01")
            .expect("account t01");
        assert!(account.qos.iter().any(|qos| qos == "taskfarm"));
        assert_eq!(
            (account.max_queued, account.default_qos.as_deref()),
            (None, Some("normal"))
        );
    }

    #[test]
    fn memory_with_its_unit() {
        for (text, mib) in [
            ("128G", Some(131_072)),
            ("2000", Some(2000)),
            ("1.50T", Some(1_572_864)),
            ("x", None),
            ("", None),
        ] {
            assert_eq!(mebibytes(text), mib, "{text:?}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(odd in "(\\PC|\n){0,200}") {
            let output = Output { exit: Exit::Code(0), stdout: format!("{HEADER}\n{odd}"), stderr: String::new() };
            let _ = read(&output);
            let _ = read_associations(&output);
        }
    }
}
