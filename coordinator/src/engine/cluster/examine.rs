//! What a site is like before anything is submitted: for `doctor`.

use cardiotwin_schemas::settings::SlurmSettings;
use cardiotwin_slurm::answers::{config, qos};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::site::Queue;

use super::profile::load_site;
use crate::dispatch::slurm::{Installed, Scheduler as _};
use crate::engine::EngineError;

/// What profile and site say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SiteReport {
    /// Slurm's version and the cluster's name.
    pub version: String,
    /// Why Slurm did not answer, where it did not.
    pub silent: Option<String>,
    /// Limits that bind tighter than the profile says, and what else matters.
    pub remarks: Vec<String>,
    /// Queues of the profile.
    pub queues: Vec<QueueReport>,
}

/// A queue of the profile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueueReport {
    /// Our name for it.
    pub name: String,
    /// Its limits, in words.
    pub limits: String,
    /// What the site does not know of it.
    pub missing: Option<String>,
}

/// Reads the profile and asks the site.
///
/// # Errors
/// [`EngineError::Site`] where there is no such profile, or it is wrong.
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
                "no accounting: jobs that left the queue are judged by their own evidence alone"
                    .to_owned(),
            );
        }
        if config.enforces_limits == Some(false) {
            remarks.push("limits of QoS are not enforced".to_owned());
        }
        remarks.extend(
            config
                .max_array_size
                .map(|size| format!("arrays of {size} elements at most")),
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
        ("nodes a job", queue.max_nodes_per_job),
        ("nodes of a user", queue.max_nodes_per_user),
        ("cores of a user", queue.max_cores_per_user),
    ] {
        words.extend(limit.map(|limit| format!("{limit} {what}")));
    }
    words.join(", ")
}
