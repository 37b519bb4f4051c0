//! Notices: commands of the operator and mail when a run is done, a patient fails or stalls, or the
//! disk fills up.
//!
//! Notices are derived from the database and not from what a process observed, so a coordinator
//! that is killed before it sent one is followed by another that does. Each event has a name of its
//! own and a folder with this name in `notices/` of the run:
//!
//! ```text
//!  event.json       the event, durable before any command is started
//!  begun-COMMAND    created exclusively just before the command starts, at most once
//!  ended-COMMAND    how the command ended
//! ```
//! Each command is therefore started at most once: a `kill -9` between the second and the third
//! file leaves no second attempt. Notices never change the run. A command that fails is reported
//! and noted next to the event.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_protocol::files::{self, SyncedDraft};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::notices::{Notice, NoticeKind, NoticeSettings};
use cardiotwin_store::clock;
use cardiotwin_store::{Notable, Reader};

use super::EngineError;
use super::books::ATTEMPTS;
use crate::dispatch::{CommandEnd, run_limited};

const FOLDER: &str = "notices";

/// Sends all notices that have not been sent. Returns one line for each command that went wrong.
///
/// # Errors
/// [`EngineError`] if the store cannot be read or a folder cannot be written. The caller reports it
/// and continues without notices.
pub async fn tell(run_dir: &Path, settings: &NoticeSettings) -> Result<Vec<String>, EngineError> {
    if settings.is_silent() {
        return Ok(Vec::new());
    }
    let reader = Reader::open(run_dir).await?;
    let notable = reader.notable().await?;
    // Attempts may be on a file system of their own.
    let free = |path: &Path| {
        rustix::fs::statvfs(path)
            .ok()
            .map(|told| told.f_bavail * told.f_frsize)
    };
    let free_bytes = [free(run_dir), free(&run_dir.join(ATTEMPTS))]
        .into_iter()
        .flatten()
        .min();
    let mut said = Vec::new();
    for (name, notice) in events(&notable, settings, free_bytes) {
        let folder = reader.run_dir().join(FOLDER).join(&name);
        said.extend(tell_one(&folder, &notice, settings).await?);
    }
    Ok(said)
}

/// Present notices. The name of each is the same whenever it is derived.
fn events(
    notable: &Notable,
    settings: &NoticeSettings,
    free_bytes: Option<u64>,
) -> Vec<(String, Notice)> {
    let at = clock::utc_text(clock::now_ms());
    let base = |kind| Notice {
        schema_version: formats::NOTICE.version,
        event: kind,
        cohort: notable.cohort.clone(),
        at: at.clone(),
        patient: None,
        step: None,
        class: None,
        counts: notable.counts.clone(),
        free_bytes: None,
    };
    let mut events = Vec::new();
    for patient in &notable.patients {
        let kind = if patient.failed {
            NoticeKind::Failed
        } else {
            NoticeKind::Stalled
        };
        let notice = Notice {
            patient: Some(patient.patient.clone()),
            step: Some(patient.step.clone()),
            class: patient.class,
            ..base(kind)
        };
        events.push((
            format!("{}-{}-{}", kind.as_str(), patient.patient, patient.mark),
            notice,
        ));
    }
    if let Some(mark) = notable.over_since_ms {
        events.push((format!("done-{mark}"), base(NoticeKind::Done)));
    }
    let least = settings.least_free_gb * 1e9;
    if let Some(free) = free_bytes.filter(|free| (*free as f64) < least) {
        // Once a day, as long as the condition lasts.
        let day = at.get(..10).unwrap_or_default();
        events.push((
            format!("quota-low-{day}"),
            Notice {
                free_bytes: Some(free),
                ..base(NoticeKind::QuotaLow)
            },
        ));
    }
    events.retain(|(_, notice)| settings.events.contains(&notice.event));
    events
}

async fn tell_one(
    folder: &Path,
    notice: &Notice,
    settings: &NoticeSettings,
) -> Result<Vec<String>, EngineError> {
    let mut said = Vec::new();
    if settings
        .commands()
        .iter()
        .all(|(name, _)| folder.join(format!("begun-{name}")).exists())
    {
        return Ok(said);
    }
    fs::create_dir_all(folder).map_err(file("create", folder))?;
    let json = serde_json::to_string_pretty(notice).expect("a notice is JSON");
    write_synced(&folder.join("event.json"), &json)?;
    let limit = Duration::from_secs_f64(settings.time_limit_s);
    for (name, command) in settings.commands() {
        if !claim(&folder.join(format!("begun-{name}")))? {
            continue;
        }
        let input = if name == "mail" {
            mail(notice, &settings.mail)
        } else {
            json.clone()
        };
        let how = match run_limited(&command, &input, limit).await {
            CommandEnd::Code(0) => "succeeded".to_owned(),
            CommandEnd::Code(code) => format!("ended with {code}"),
            CommandEnd::Signal => "was killed".to_owned(),
            CommandEnd::TimedOut => format!("was killed after {} s", settings.time_limit_s),
            CommandEnd::NotStarted(why) => format!("could not be started: {why}"),
        };
        write_synced(&folder.join(format!("ended-{name}")), &how)?;
        if how != "succeeded" {
            let event = folder
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            said.push(format!(
                "notice {event}: {} {how}; the run continues",
                command.join(" ")
            ));
        }
    }
    Ok(said)
}

/// A message for sendmail: pseudonyms, steps and classes, but no data or paths.
fn mail(notice: &Notice, to: &[String]) -> String {
    let who = notice
        .patient
        .as_ref()
        .map(|patient| format!(" {patient}"))
        .unwrap_or_default();
    let mut lines = vec![
        format!("To: {}", to.join(", ")),
        format!(
            "Subject: cardiotwin {}: {}{who}",
            notice.cohort,
            notice.event.as_str()
        ),
        "Auto-Submitted: auto-generated".to_owned(),
        "Content-Type: text/plain; charset=utf-8".to_owned(),
        String::new(),
        format!("{} at {}", notice.event.meaning(), notice.at),
    ];
    lines.extend(
        notice
            .patient
            .iter()
            .map(|patient| format!("patient: {patient}")),
    );
    lines.extend(notice.step.iter().map(|step| format!("step: {step}")));
    lines.extend(
        notice
            .class
            .iter()
            .map(|class| format!("class: {}", class.as_str())),
    );
    lines.extend(
        notice
            .free_bytes
            .map(|free| format!("free: {:.1} GB", 1e-9 * free as f64)),
    );
    let counts: Vec<String> = notice
        .counts
        .iter()
        .map(|(state, n)| format!("{n} {state}"))
        .collect();
    lines.push(format!("patients: {}", counts.join(", ")));
    lines.push("`cardiotwin status` shows details.".to_owned());
    // Names come from files, so control characters are replaced: no name may add a header.
    let plain = |line: &String| {
        line.chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect::<String>()
    };
    lines.iter().map(plain).collect::<Vec<_>>().join("\n") + "\n"
}

/// Whether this process is the first: the file is created exclusively.
fn claim(path: &Path) -> Result<bool, EngineError> {
    SyncedDraft::beside(path, b"")
        .and_then(|draft| draft.place_exclusively(path))
        .map_err(file("create", path))
}

fn write_synced(path: &Path, text: &str) -> Result<(), EngineError> {
    files::write_atomic(path, text.as_bytes()).map_err(file("write", path))
}

fn file(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> EngineError {
    let path: PathBuf = path.to_owned();
    move |source| EngineError::File { what, path, source }
}
