//! Words of the status: the table, its rows, and the counts below it.

use cardiotwin_report::table::{Cell, Column, Digits, Table, cells};
use cardiotwin_schemas::status::{
    ClusterStatus, JobState, LearnedStatus, PatientState, PatientStatus, RefusedPatient, Status,
};

use crate::table::{duration, text};
use crate::talk::{Talk, Tone};

/// The columns. `member` names what stands in the first one.
pub fn columns(member: &'static str) -> [Column; 7] {
    [
        Column::words("patient").label(member),
        Column::words("step"),
        Column::words("state"),
        Column::words("iteration").label("in step 1"),
        Column::numbers("cost"),
        Column::numbers("for_s")
            .label("time in state")
            .digits(Digits::Duration),
        Column::words("note"),
    ]
}

/// Largest length of a note, characters.
const LONGEST_NOTE: usize = 100;

/// The table with counts and time stamp.
pub fn screen(status: &Status, member: &'static str, rows: usize, talk: &Talk) -> String {
    let mut table = Table::new("status", "", columns(member));
    let patients = status.patients.iter().take(rows);
    table.rows.extend(status.refused.iter().map(refused_row));
    table.rows.extend(patients.map(row));
    let mut text = text(&table, talk);
    // `patients` may hold only the rows that were read, whereas the counts cover all members.
    let all = usize::try_from(status.counts.values().sum::<u64>()).unwrap_or(usize::MAX);
    if all > rows {
        text.push_str(&format!(
            "… {} more; --all shows all, --failed only the failed ones\n",
            all - rows
        ));
    }
    text.push_str(&counted(status));
    text.push_str(&status.learned.as_ref().map(learned).unwrap_or_default());
    text.push_str(&status.cluster.as_ref().map(of_cluster).unwrap_or_default());
    text
}

/// The number of patients in each state, and whether a coordinator is running.
pub fn counted(status: &Status) -> String {
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
    format!(
        "{}: {counts}; {coordinator}; as of {}\n",
        status.cohort, status.as_of
    )
}

/// What pilots taught.
pub fn learned(learned: &LearnedStatus) -> String {
    format!(
        "the law of further patients is learned from {}: {}\n",
        learned.organs.join(", "),
        learned.words
    )
}

/// State and charge of the jobs, and the age of this information.
pub fn of_cluster(cluster: &ClusterStatus) -> String {
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
    // Less than half of the last digit would be read as nothing to do.
    let to_come = match cluster.node_hours_left {
        left if left <= 0.0 => String::new(),
        left if left < 0.005 => ", less than 0.01 to come".to_owned(),
        left => format!(", about {left:.2} to come"),
    };
    let mut text = format!(
        "{}: {running} jobs running, {} pending; {:.2} node-hours so far{charge}{to_come}; {age}\n",
        cluster.site,
        cluster.jobs.len() - running,
        cluster.node_hours,
    );
    for (what, why) in [("no answer", &cluster.no_answer), ("holds", &cluster.holds)] {
        if let Some(why) = why {
            text.push_str(&format!("{what}: {why}\n"));
        }
    }
    text
}

/// Row of a patient whose files have errors.
pub fn refused_row(refused: &RefusedPatient) -> Vec<Cell> {
    let more = match refused.errors.len() {
        0 | 1 => String::new(),
        n => format!("; {} more", n - 1),
    };
    let first = refused.errors.first().map_or("", String::as_str);
    cells![
        refused.patient.as_str(),
        "input",
        Cell::from("refused").toned(Tone::Bad),
        Cell::default(),
        Cell::default(),
        Cell::default(),
        format!("[input] {}{more}", shortened(first))
    ]
}

pub fn row(patient: &PatientStatus) -> Vec<Cell> {
    let tone = match patient.state {
        PatientState::Failed => Some(Tone::Bad),
        PatientState::Unknown | PatientState::Cancelled => Some(Tone::Doubtful),
        // A verified twin outside of the tolerances is done, but nothing to be glad of.
        PatientState::Done if patient.is_off() => Some(Tone::Doubtful),
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
    let iteration = patient.iteration;
    cells![
        patient.patient.as_str(),
        patient.step_shown(),
        Cell::from(patient.state.to_string()).toned(tone),
        iteration.map(|(now, limit)| format!("{now}/{limit}")),
        patient.step2_cost.or(patient.step1_cost),
        patient.for_s,
        Cell::from(shortened(&note.join("; "))).toned(stalled.map(|_| Tone::Doubtful))
    ]
}

/// The note, cut so that it fits next to the other columns. `show` and `--json` print it in full.
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
