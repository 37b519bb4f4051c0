//! `cardiotwin status`: the state of a run on one screen, failures first.

use std::time::Duration;

use cardiotwin_schemas::status::{
    ClusterStatus, JobState, PatientState, PatientStatus, RefusedPatient, Status,
};
use cardiotwin_schemas::sweep::SweepSpec;
use clap::Args;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::{Folders, Place};
use crate::cli::store::open;
use crate::cli::table::{Columns, duration, optional};
use crate::cli::talk::{Talk, Tone};
use crate::sweep::folder;

/// Rows shown without `--all`.
const ROWS: usize = 60;
/// Largest length of a note, characters.
const LONGEST_NOTE: usize = 100;

/// Show the state of each patient, failures first
#[derive(Debug, Args)]
pub struct StatusArgs {
    #[command(flatten)]
    place: Place,
    /// Print one JSON object (status.schema.json) instead of a table
    #[arg(long)]
    json: bool,
    /// Refresh every two seconds until the run is finished
    #[arg(long)]
    watch: bool,
    /// Show only failed patients
    #[arg(long)]
    failed: bool,
    /// Show all patients, even in a large cohort
    #[arg(long)]
    all: bool,
}

/// Prints the status.
///
/// # Errors
/// Errors of the store.
pub async fn execute(args: &StatusArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let reader = open(&folders).await?;
    let member = member(&folders)?;
    loop {
        let rows = if args.all || args.failed || args.json {
            usize::MAX
        } else {
            ROWS
        };
        let mut status = reader.screen(rows).await?;
        if args.failed {
            status
                .patients
                .retain(|patient| patient.state == PatientState::Failed);
        }
        if args.json {
            talk.json(&status)?;
        } else {
            if args.watch && talk.colour_out {
                talk.clear_screen()?;
            }
            talk.data(&screen(&status, member, rows, talk))?;
            if let Some(hint) = hint(&status, &folders) {
                talk.hint(&hint);
            }
        }
        if !args.watch || Talk::reader_left() || (is_over(&status) && !status.coordinator_running) {
            return Ok(Exit::Ok);
        }
        tokio::time::sleep(Duration::from_secs(2)).await;
    }
}

/// Heading of the first column: the kind of member that the run has.
fn member(folders: &Folders) -> Result<&'static str, CliError> {
    Ok(match folder::find(&folders.run)?.map(|file| file.sweep) {
        None => "PATIENT",
        Some(SweepSpec::Gsa(_)) => "CHUNK",
        Some(SweepSpec::Robustness(_)) => "MEMBER",
    })
}

fn is_over(status: &Status) -> bool {
    status
        .counts
        .iter()
        .all(|(state, n)| *n == 0 || state.is_over())
}

/// The table with counts and time stamp. `member` is the heading of its first column.
#[must_use]
pub fn screen(status: &Status, member: &str, rows: usize, talk: &Talk) -> String {
    let mut table = Columns::new(
        talk,
        &[
            member,
            "STEP",
            "STATE",
            "ITERATION",
            ">COST",
            ">TIME IN STATE",
            "NOTE",
        ],
    );
    for refused in &status.refused {
        table.toned(refused_row(refused));
    }
    for patient in status.patients.iter().take(rows) {
        table.toned(row(patient));
    }
    let mut text = table.text();
    // `patients` may hold only the rows that were read, whereas the counts cover all members.
    let all = usize::try_from(status.counts.values().sum::<u64>()).unwrap_or(usize::MAX);
    if all > rows {
        text.push_str(&format!(
            "… {} more; --all shows all, --failed only the failed ones\n",
            all - rows
        ));
    }
    let mut counts: Vec<String> = status
        .counts
        .iter()
        .filter(|(_, n)| **n > 0)
        .map(|(state, n)| format!("{n} {state}"))
        .collect();
    if !status.refused.is_empty() {
        counts.push(format!("{} refused", status.refused.len()));
    }
    let counts = if counts.is_empty() {
        "no patients".to_owned()
    } else {
        counts.join(", ")
    };
    let coordinator = if status.coordinator_running {
        "a coordinator is running"
    } else {
        "no coordinator is running"
    };
    text.push_str(&format!(
        "{}: {counts}; {coordinator}; as of {}\n",
        status.cohort, status.as_of
    ));
    text.push_str(&status.cluster.as_ref().map(of_cluster).unwrap_or_default());
    text
}

/// State and charge of the jobs, and the age of this information.
fn of_cluster(cluster: &ClusterStatus) -> String {
    let running = cluster
        .jobs
        .iter()
        .filter(|job| job.state == JobState::Running)
        .count();
    let age = match cluster.as_of.is_empty() {
        true => "the queue has never answered".to_owned(),
        false => format!("the queue answered {} ago", duration(cluster.age_s)),
    };
    let charge = match cluster.charge > 0.0 {
        true => format!(" ({:.2} {})", cluster.charge, cluster.charge_unit),
        false => String::new(),
    };
    let mut text = format!(
        "{}: {running} jobs running, {} pending; {:.2} node-hours so far{charge}, about {:.2} to \
         come; {age}\n",
        cluster.site,
        cluster.jobs.len() - running,
        cluster.node_hours,
        cluster.node_hours_left,
    );
    for (what, why) in [("no answer", &cluster.no_answer), ("holds", &cluster.holds)] {
        if let Some(why) = why {
            text.push_str(&format!("{what}: {why}\n"));
        }
    }
    text
}

/// Row of a patient whose files have errors.
fn refused_row(refused: &RefusedPatient) -> Vec<(String, Option<Tone>)> {
    let more = match refused.errors.len() {
        0 | 1 => String::new(),
        n => format!("; {} more", n - 1),
    };
    let first = refused.errors.first().map_or("", String::as_str);
    vec![
        (refused.patient.clone(), None),
        ("input".to_owned(), None),
        ("refused".to_owned(), Some(Tone::Bad)),
        ("-".to_owned(), None),
        ("-".to_owned(), None),
        ("-".to_owned(), None),
        (format!("[input] {}{more}", shortened(first)), None),
    ]
}

fn row(patient: &PatientStatus) -> Vec<(String, Option<Tone>)> {
    let tone = match patient.state {
        PatientState::Failed => Some(Tone::Bad),
        PatientState::Unknown | PatientState::Cancelled => Some(Tone::Doubtful),
        PatientState::Done => Some(Tone::Good),
        PatientState::Waiting => Some(Tone::Quiet),
        PatientState::Running => None,
    };
    let stalled = patient
        .step1_quality
        .as_deref()
        .filter(|quality| quality.starts_with("stalled"));
    let mut note = Vec::new();
    note.extend(
        stalled
            .filter(|quality| !patient.note.contains(*quality))
            .map(str::to_owned),
    );
    if let Some(class) = patient.failure_class {
        note.push(format!("[{}] {}", class.as_str(), patient.note));
    } else if !patient.note.is_empty() {
        note.push(patient.note.clone());
    }
    let cost = patient.step2_cost.or(patient.step1_cost);
    vec![
        (patient.patient.clone(), None),
        (patient.step_shown().to_owned(), None),
        (patient.state.to_string(), tone),
        (
            patient
                .iteration
                .map_or("-".to_owned(), |(now, limit)| format!("{now}/{limit}")),
            None,
        ),
        (optional(cost), None),
        (duration(patient.for_s), None),
        (shortened(&note.join("; ")), stalled.map(|_| Tone::Doubtful)),
    ]
}

/// The note, cut so that it fits beside the other columns. `show` and `--json` print it in full.
fn shortened(note: &str) -> String {
    if note.chars().count() <= LONGEST_NOTE {
        return note.to_owned();
    }
    format!(
        "{}…",
        note.chars()
            .take(LONGEST_NOTE - 1)
            .collect::<String>()
            .trim_end()
    )
}

/// The command to call next, if one is needed.
#[must_use]
pub fn hint(status: &Status, folders: &Folders) -> Option<String> {
    let of = folders.as_argument("--cohort ");
    if let Some(failed) = status
        .patients
        .iter()
        .find(|patient| patient.state == PatientState::Failed)
    {
        let id = &failed.patient;
        return Some(match failed.failure_class {
            Some(cardiotwin_schemas::failure::FailureClass::Site) => {
                format!(
                    "`cardiotwin logs {id}{of}` shows the log, `cardiotwin retry {id}{of}` tries \
                     again"
                )
            }
            _ => format!("`cardiotwin show {id}{of}` shows details"),
        });
    }
    if !status.refused.is_empty() {
        let check = folders.as_argument("");
        return Some(format!(
            "`cardiotwin check{check}` shows the errors of refused patients"
        ));
    }
    let waiting = status
        .patients
        .iter()
        .any(|p| !matches!(p.state, PatientState::Done | PatientState::Cancelled));
    let advance = || format!("`cardiotwin advance{}`", folders.as_argument(""));
    let command = || {
        if status.cluster.is_some() {
            advance()
        } else {
            folders.run_command()
        }
    };
    (waiting && !status.coordinator_running).then(|| format!("continue with {}", command()))
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::failure::FailureClass;

    use super::*;

    const PLAIN: Talk = Talk {
        colour_out: false,
        colour_err: false,
        quiet: true,
        bars: false,
    };

    fn patient(id: &str, step: &str, state: PatientState) -> PatientStatus {
        PatientStatus {
            patient: id.into(),
            step: step.into(),
            state,
            iteration: None,
            step1_cost: None,
            step1_quality: None,
            step2_cost: None,
            for_s: 12.3,
            failure_class: None,
            note: String::new(),
        }
    }

    fn status() -> Status {
        Status {
            schema_version: cardiotwin_schemas::formats::STATUS.version,
            cohort: "coa-seven".into(),
            as_of: "2026-03-01T12:00:00.000Z".into(),
            coordinator_running: true,
            counts: [
                (PatientState::Failed, 1),
                (PatientState::Running, 2),
                (PatientState::Done, 1),
                (PatientState::Waiting, 1),
            ]
            .into(),
            patients: vec![
                PatientStatus {
                    failure_class: Some(FailureClass::Numerics),
                    note: "verification diverged at 212 ms".into(),
                    for_s: 4360.0,
                    ..patient("04-CoA", "verification", PatientState::Failed)
                },
                PatientStatus {
                    iteration: Some((3, 10)),
                    step1_cost: Some(0.1832),
                    note: "iteration 4".into(),
                    ..patient("02-CoA", "step-1", PatientState::Running)
                },
                PatientStatus {
                    iteration: Some((9, 10)),
                    step1_cost: Some(0.142),
                    step1_quality: Some("stalled: best iteration 9".into()),
                    note: "generation 41, cost 0.0432".into(),
                    ..patient("03-CoA", "step-2", PatientState::Running)
                },
                patient("05-CoA", "step-0", PatientState::Waiting),
                PatientStatus {
                    iteration: Some((2, 10)),
                    step1_cost: Some(0.083),
                    step1_quality: Some("converged: iteration 2".into()),
                    step2_cost: Some(0.0071),
                    ..patient("01-CoA", "done", PatientState::Done)
                },
            ],
            refused: Vec::new(),
            cluster: None,
        }
    }

    #[test]
    fn failures_stand_first_and_columns_line_up() {
        let refused = RefusedPatient {
            patient: "06-CoA".into(),
            errors: vec![
                "patients/06-CoA/patient.toml:3:1: HR_bpm: found -4, expected a number from 20 to 300".into(),
                "patients/06-CoA/pressure.csv: found no such file, expected a pressure trace".into(),
            ],
        };
        let status = Status {
            refused: vec![refused],
            ..status()
        };
        insta::assert_snapshot!(screen(&status, "PATIENT", 60, &PLAIN));
    }

    #[test]
    fn a_long_cohort_is_cut_and_says_so() {
        assert!(screen(&status(), "PATIENT", 2, &PLAIN).contains("… 3 more; --all shows all"));
    }

    #[test]
    fn a_long_note_is_cut_where_the_table_would_wrap() {
        let mut long = status();
        long.patients[0].note = "é".repeat(300);
        let screen = screen(&long, "PATIENT", 60, &PLAIN);
        assert!(screen.lines().nth(1).unwrap().ends_with("é…"), "{screen}");
        assert!(
            screen.lines().all(|line| line.chars().count() < 170),
            "{screen}"
        );
    }

    #[test]
    fn the_hint_names_the_failed_patient_and_the_place() {
        let folders = Folders {
            cohort: Some("c".into()),
            run: "c/run".into(),
        };
        assert_eq!(
            hint(&status(), &folders).unwrap(),
            "`cardiotwin show 04-CoA --cohort c` shows details"
        );
        let mut site = status();
        site.patients[0].failure_class = Some(FailureClass::Site);
        assert!(
            hint(&site, &folders)
                .unwrap()
                .contains("retry 04-CoA --cohort c")
        );
        let mut stopped = status();
        stopped.patients.remove(0);
        assert_eq!(hint(&stopped, &folders), None, "a coordinator is at it");
        stopped.coordinator_running = false;
        assert_eq!(
            hint(&stopped, &folders).unwrap(),
            "continue with `cardiotwin run c`"
        );
    }

    #[test]
    fn colour_adds_nothing_to_the_words() {
        let coloured = screen(
            &status(),
            "PATIENT",
            60,
            &Talk {
                colour_out: true,
                ..PLAIN
            },
        );
        assert!(coloured.contains("\x1b["));
        let mut plain = String::new();
        let mut inside = false;
        for c in coloured.chars() {
            match c {
                '\x1b' => inside = true,
                'm' if inside => inside = false,
                c if !inside => plain.push(c),
                _ => {}
            }
        }
        let words = |text: &str| {
            text.split_whitespace()
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            words(&plain),
            words(&screen(&status(), "PATIENT", 60, &PLAIN))
        );
    }
}
