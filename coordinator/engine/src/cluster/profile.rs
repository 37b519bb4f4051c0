//! Profiles of sites: shipped ones by name, others by path, refined by the limits that the site
//! reports.

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_schemas::settings::SlurmSettings;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::answers::config::{self, SiteConfig};
use cardiotwin_slurm::answers::qos::{self, QosRow};
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands;
use cardiotwin_slurm::directives::check_directive;
use cardiotwin_slurm::site::{Scheduler as Kind, Site};
use cardiotwin_store::Writer;

use super::Cluster;
use crate::EngineError;

const SHIPPED: [(&str, &str); 6] = [
    (
        "archer2",
        include_str!("../../../../deploy/sites/archer2.toml"),
    ),
    (
        "generic",
        include_str!("../../../../deploy/sites/generic.toml"),
    ),
    (
        "laptop",
        include_str!("../../../../deploy/sites/laptop.toml"),
    ),
    (
        "levante",
        include_str!("../../../../deploy/sites/levante.toml"),
    ),
    ("lumi", include_str!("../../../../deploy/sites/lumi.toml")),
    ("roihu", include_str!("../../../../deploy/sites/roihu.toml")),
];
/// Time after which the site is asked for its limits again, ms.
const TOLD_FOR_MS: i64 = 24 * 3600 * 1000;
/// Keys of the site's answers among the store's single values.
const TOLD: [&str; 3] = ["site_told_ms", "site_config", "site_qos"];

/// Loads the profile that the settings name.
///
/// # Errors
/// [`EngineError::Site`] with the file and the key at fault.
pub fn load_site(settings: &SlurmSettings) -> Result<Site, EngineError> {
    let name = &settings.site;
    let wrong = |message: String| EngineError::Site { message };
    let read =
        |file: &str, text: &str| Site::read(file, text).map_err(|error| wrong(error.to_string()));
    let mut site = match SHIPPED.iter().find(|(shipped, _)| shipped == name) {
        Some((file, text)) => read(file, text)?,
        None => {
            let text = input_files::read_text(name.as_ref(), MaxBytes::TEXT).map_err(|error| {
                let known = SHIPPED.map(|(name, _)| name).join(", ");
                wrong(format!(
                    "executor.slurm.site is `{name}`, which is neither a readable file \
                               ({error}) nor one of {known}"
                ))
            })?;
            read(name, &text)?
        }
    };
    if site.scheduler != Kind::Slurm {
        return Err(wrong(format!(
            "site {name} has no Slurm: use executor.kind = \"local\" there, or another site"
        )));
    }
    if let Some(walltime) = &settings.walltime {
        let limit = cardiotwin_slurm::walltime::parse(walltime);
        let Some(cardiotwin_slurm::walltime::Limit::Seconds(seconds)) = limit else {
            return Err(wrong(format!(
                "executor.slurm.walltime is `{walltime}`, expected a time such as \"04:00:00\""
            )));
        };
        for queue in &mut site.queue {
            if seconds < queue.walltime_s() {
                walltime.clone_into(&mut queue.walltime);
            }
        }
        let overhead_s = overhead_s(settings);
        if seconds <= overhead_s {
            return Err(wrong(format!(
                "executor.slurm.walltime is `{walltime}`, but a job's start, its warning and its end \
                 take {overhead_s} s, 2 (executor.slurm.warning_s + 60 s): ask for more time, or \
                 lower executor.slurm.warning_s ({})",
                settings.warning_s
            )));
        }
    }
    if settings.max_jobs > 0 {
        for queue in &mut site.queue {
            let of_queue = queue.max_queued.unwrap_or(u32::MAX);
            queue.max_queued = Some(of_queue.min(settings.max_jobs));
        }
    }
    for directive in &settings.directives {
        check_directive(directive).map_err(|problem| {
            wrong(format!(
                "executor.slurm.directives has `{directive}`: {problem}"
            ))
        })?;
    }
    site.directives.extend(settings.directives.iter().cloned());
    let named = (settings.queue.iter().map(|name| ("queue", name))).chain(
        settings
            .fallback_queues
            .iter()
            .map(|name| ("fallback_queues", name)),
    );
    for (key, name) in named {
        if site.queue.iter().all(|queue| queue.name != *name) {
            let known: Vec<&str> = site.queue.iter().map(|queue| queue.name.as_str()).collect();
            return Err(wrong(format!(
                "executor.slurm.{key} is `{name}`; site {} has {}",
                site.name,
                known.join(", ")
            )));
        }
    }
    if site.needs_account && settings.account.is_none() {
        return Err(EngineError::NoAccount { site: site.name });
    }
    Ok(site)
}

/// Time of a job without work \[s\]: to start and to end, and the warning, which Slurm may send a
/// minute early.
pub(super) fn overhead_s(settings: &SlurmSettings) -> u64 {
    2 * (settings.warning_s + 60)
}

/// The site's configuration and limits. The site is asked once a day, since these hardly change; in
/// between, its last answers are read from the store.
pub(super) async fn limits<S: Scheduler>(
    cluster: &mut Cluster<S>,
) -> Result<(Option<SiteConfig>, Vec<QosRow>), EngineError> {
    let now_ms = cluster.state.books.now_ms();
    let meta = cluster.writer.meta().await?;
    let value = |key: &str| meta.get(key).cloned().unwrap_or_default();
    let told_ms: i64 = value(TOLD[0]).parse().unwrap_or(0);
    let stored = |key: &str| Output {
        exit: Exit::Code(0),
        stdout: value(key),
        stderr: String::new(),
    };
    let (config, qos) = if now_ms - told_ms < TOLD_FOR_MS {
        (stored(TOLD[1]), stored(TOLD[2]))
    } else {
        let config = cluster.run_command(&commands::config()).await?;
        let qos = cluster.run_command(&commands::qos()).await?;
        // If the site did not answer, it is asked again at the next tick.
        if config.exit == Exit::Code(0) {
            remember(&mut cluster.writer, now_ms, &config.stdout, &qos.stdout).await?;
        }
        (config, qos)
    };
    let rows = qos::read(&qos).map(|table| table.rows).unwrap_or_default();
    Ok((config::read(&config).ok(), rows))
}

/// Refines a profile by the limits that the site reports now. Returns what this changed.
pub async fn discover_now(site: &mut Site, scheduler: &mut impl Scheduler) -> Vec<String> {
    let config = config::read(&scheduler.ask(&commands::config()).await).ok();
    let rows = qos::read(&scheduler.ask(&commands::qos()).await)
        .map(|table| table.rows)
        .unwrap_or_default();
    site.discover(config.as_ref(), &rows)
}

async fn remember(
    writer: &mut Writer,
    now_ms: i64,
    config: &str,
    qos: &str,
) -> Result<(), EngineError> {
    let now = now_ms.to_string();
    Ok(writer
        .set_meta(&[(TOLD[0], &now), (TOLD[1], config), (TOLD[2], qos)])
        .await?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cohort_may_ask_for_fewer_jobs_than_a_queue_allows() {
        let of = |max_jobs: u32| {
            let settings = SlurmSettings {
                site: "lumi".to_owned(),
                account: Some("t01".to_owned()),
                max_jobs,
                ..SlurmSettings::default()
            };
            let site = load_site(&settings).expect("a site");
            site.queue
                .iter()
                .map(|queue| queue.max_queued)
                .collect::<Vec<_>>()
        };
        assert_eq!(of(0), [Some(120), Some(220), Some(2)]);
        assert_eq!(of(5), [Some(5), Some(5), Some(2)]);
    }

    #[test]
    fn an_unknown_fallback_queue_is_refused_with_those_that_there_are() {
        let settings = SlurmSettings {
            site: "archer2".to_owned(),
            account: Some("t01".to_owned()),
            fallback_queues: vec!["short".to_owned(), "slow".to_owned()],
            ..SlurmSettings::default()
        };
        let refusal = load_site(&settings).expect_err("no such queue").to_string();
        assert!(
            refusal.contains("executor.slurm.fallback_queues is `slow`; site archer2 has taskfarm"),
            "{refusal}"
        );
    }
}
