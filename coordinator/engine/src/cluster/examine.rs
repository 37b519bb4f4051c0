//! Examines a site before anything is submitted, for `doctor`.

use cardiotwin_schemas::settings::SlurmSettings;
use cardiotwin_slurm::access::{Installed, Scheduler as _};
use cardiotwin_slurm::answers::{config, qos};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::site::Queue;

use super::profile::load_site;
use crate::EngineError;

/// Profile and limits of a site, as the site itself reports them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SiteReport {
    /// Slurm's version and the cluster's name.
    pub version: String,
    /// Reason why Slurm did not answer; `None` if it did.
    pub silent: Option<String>,
    /// Limits of the site that are tighter than the profile's, and further remarks.
    pub remarks: Vec<String>,
    /// Queues of the profile, in its order.
    pub queues: Vec<QueueReport>,
}

/// A queue of the profile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueueReport {
    /// Name of the queue in the profile.
    pub name: String,
    /// Limits on walltime, jobs and nodes, as one line of text.
    pub limits: String,
    /// Note that the site has no QoS of the queue's name; `None` if it has one or none is set.
    pub missing: Option<String>,
}

/// Reads the profile and queries the site.
///
/// # Errors
/// [`EngineError::Site`] if the profile does not exist or is wrong.
pub async fn examine_site(settings: &SlurmSettings) -> Result<SiteReport, EngineError> {
    let mut site = load_site(settings)?;
    let mut scheduler = Installed::default();
    let told = config::read(&scheduler.ask(&commands::config()).await);
    let known = match &told {
        Ok(_) => qos::read(&scheduler.ask(&commands::qos()).await)
            .ok()
            .map(|table| table.rows),
        Err(_) => None,
    };
    let mut remarks = site.discover(told.as_ref().ok(), known.as_deref().unwrap_or_default());
    if let Ok(config) = &told {
        if config.has_accounting == Some(false) {
            remarks.push(
                "no accounting: the fate of jobs that left the queue follows only from their own \
                 files"
                    .to_owned(),
            );
        }
        if config.enforces_limits == Some(false) {
            remarks.push("limits of QoS are not enforced".to_owned());
        }
        remarks.extend(
            config
                .max_array_size
                .map(|size| format!("arrays have at most {size} elements")),
        );
    }
    let queues = site.queue.iter().map(|queue| QueueReport {
        name: queue.name.clone(),
        limits: limits(queue),
        missing: (known.as_ref().zip(queue.qos.as_ref()))
            .filter(|(known, qos)| !known.is_empty() && known.iter().all(|row| row.name != **qos))
            .map(|(_, qos)| format!("the site has no QoS `{qos}`")),
    });
    let queues = queues.collect();
    let silent = told.as_ref().err().map(ToString::to_string);
    let version = told.map(|config| {
        let cluster = config
            .cluster
            .map(|name| format!(" of cluster {name}"))
            .unwrap_or_default();
        format!(
            "{}{cluster}",
            config
                .version
                .unwrap_or_else(|| "of an unknown version".to_owned())
        )
    });
    Ok(SiteReport {
        version: version.unwrap_or_default(),
        silent,
        remarks,
        queues,
    })
}

fn limits(queue: &Queue) -> String {
    let mut words = vec![format!("walltime {}", queue.walltime)];
    for (what, limit) in [
        ("jobs queued", queue.max_queued),
        ("running", queue.max_running),
        ("nodes per job", queue.max_nodes_per_job),
        ("nodes per user", queue.max_nodes_per_user),
        ("cores per user", queue.max_cores_per_user),
    ] {
        words.extend(limit.map(|limit| format!("{limit} {what}")));
    }
    words.join(", ")
}
