//! The terminal page of `status --watch`: keys, refreshing, and the terminal's state.

use std::time::Duration;

use cardiotwin_dashboard::Estimate;
use cardiotwin_engine::Reader;
use cardiotwin_engine::clock;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::status::Status;
use ratatui::crossterm::event::{Event, KeyEventKind, poll, read};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tokio::time::Instant;

use super::draw::draw;
use super::page::{Action, Page};
use super::unseen;
use crate::commands::logs::end_of_logs;
use crate::commands::show::text_of;
use crate::error::CliError;
use crate::estimate::estimate;
use crate::place::Folders;
use crate::talk::Talk;

/// Time between two readings of the database.
const PERIOD: Duration = Duration::from_secs(2);
/// Time between two readings of the cohort's files.
const PERIOD_OF_FILES: Duration = Duration::from_secs(10);
/// Longest wait for a key before the thread looks whether the page has ended.
const PATIENCE: Duration = Duration::from_millis(100);
/// Largest part of each log file that the page shows, bytes.
const END_OF_LOG: u64 = 256 * 1024;

/// Gives the terminal back, however the page ends.
struct Terminal(ratatui::DefaultTerminal);

impl Drop for Terminal {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

fn of_terminal(source: std::io::Error) -> CliError {
    CliError::Io {
        what: "cannot use the terminal; `cardiotwin status --watch | cat` needs none",
        source,
    }
}

/// Shows the page until a key or a signal ends it, and returns the last state.
///
/// # Errors
/// Errors of the store; [`CliError::Io`] if the terminal cannot be used.
pub async fn watch(
    reader: &Reader,
    folders: &Folders,
    member: &'static str,
    only_failed: bool,
    talk: &Talk,
) -> Result<Status, CliError> {
    let mut status = reader.status().await?;
    let of_cohort = member == "PATIENT";
    if of_cohort {
        unseen::add(&mut status, folders).await?;
    }
    let mut files_read = Instant::now();
    let mut page = Page::new(status, member, only_failed);
    page.estimate = expected_end(reader, &page.status).await?;
    let mut ended = signal(SignalKind::terminate()).map_err(of_terminal)?;
    let mut terminal = Terminal(ratatui::try_init().map_err(of_terminal)?);
    let (tell, mut events) = unbounded_channel();
    let listening = std::thread::spawn(move || listen(&tell));
    let mut next = Instant::now() + PERIOD;
    loop {
        if Instant::now() >= next {
            let mut status = reader.status().await?;
            if of_cohort && files_read.elapsed() >= PERIOD_OF_FILES {
                unseen::add(&mut status, folders).await?;
                files_read = Instant::now();
            } else if !status.coordinator_running {
                status.new_patients = std::mem::take(&mut page.status.new_patients);
                status.changed_patients = std::mem::take(&mut page.status.changed_patients);
            }
            let end = expected_end(reader, &status).await?;
            page.update(status, end);
            read_opened(reader, &mut page, talk).await?;
            next = Instant::now() + PERIOD;
        }
        let drawn = terminal
            .0
            .draw(|frame| draw(frame, &mut page, talk.colour_out));
        drawn.map_err(of_terminal)?;
        let action = tokio::select! {
            event = events.recv() => match event {
                Some(Event::Key(key)) if key.kind == KeyEventKind::Press => page.on(key),
                Some(_) => Action::Draw,
                None => Action::Leave,
            },
            _ = ended.recv() => Action::Leave,
            () = tokio::time::sleep_until(next) => Action::Draw,
        };
        match action {
            Action::Draw => {}
            Action::Read => read_opened(reader, &mut page, talk).await?,
            Action::Leave => break,
        }
    }
    drop(events);
    // A thread that still reads would take the shell's next key.
    let _ = tokio::task::spawn_blocking(move || listening.join()).await;
    Ok(page.status)
}

/// Sends the terminal's events until nobody wants them any more.
fn listen(tell: &UnboundedSender<Event>) {
    while !tell.is_closed() {
        let event = match poll(PATIENCE) {
            Ok(false) => continue,
            Ok(true) => read(),
            Err(error) => Err(error),
        };
        if event.is_err() || event.is_ok_and(|event| tell.send(event).is_err()) {
            return;
        }
    }
}

/// Expected end of a local run.
async fn expected_end(reader: &Reader, status: &Status) -> Result<Option<Estimate>, CliError> {
    if !status.coordinator_running || status.cluster.is_some() {
        return Ok(None);
    }
    let now_ms = clock::now_ms();
    Ok(estimate(&reader.pace(now_ms).await?, now_ms))
}

/// Reads the texts of the opened patient.
async fn read_opened(reader: &Reader, page: &mut Page, talk: &Talk) -> Result<(), CliError> {
    let Some(opened) = &mut page.opened else {
        return Ok(());
    };
    let refused = page.status.refused.iter();
    if let Some(refused) = refused
        .clone()
        .find(|refused| refused.patient == opened.patient)
    {
        opened.results = refused.errors.join("\n");
        return Ok(());
    }
    let id = PatientId(opened.patient.clone());
    let record = reader.patient_record(&id).await?;
    let plain = Talk {
        colour_out: false,
        ..*talk
    };
    opened.results = text_of(&record, &plain);
    opened.log = match reader.attempts(&id).await?.last() {
        None => "no attempt of any task yet\n".to_owned(),
        Some(attempt) => end_of_logs(attempt, END_OF_LOG)?,
    };
    Ok(())
}
