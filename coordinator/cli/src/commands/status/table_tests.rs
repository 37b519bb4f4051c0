//! Tests of the table that `status` prints.

use cardiotwin_schemas::failure::FailureClass;

use cardiotwin_schemas::status::{PatientState, PatientStatus, RefusedPatient, Status};

use super::hint;
use super::table::screen;
use crate::place::Folders;
use crate::talk::Talk;

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

pub(super) fn status() -> Status {
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
        new_patients: Vec::new(),
        changed_patients: Vec::new(),
        learned: None,
        cluster: None,
    }
}

#[test]
fn failures_stand_first_and_columns_line_up() {
    let refused = RefusedPatient {
        patient: "06-CoA".into(),
        errors: vec![
            "patients/06-CoA/patient.toml:3:1: HR_bpm: found -4, expected a number from 20 to 300"
                .into(),
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
    let coloured = crate::talk::coloured(&crate::talk::harmless(&coloured)).into_owned();
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
