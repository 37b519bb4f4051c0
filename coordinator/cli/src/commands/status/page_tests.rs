//! Tests of the terminal page of `status --watch`: keys, and drawings on a terminal in memory.

use cardiotwin_dashboard::Estimate;
use cardiotwin_schemas::status::{ChangedPatient, PatientState, RefusedPatient, Status};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use super::draw::draw;
use super::page::{Action, Page, Part};
use super::table_tests::status;

fn page() -> Page {
    let mut status = status();
    status.refused = vec![RefusedPatient {
        patient: "06-CoA".into(),
        errors: vec!["patients/06-CoA/patient.toml:3:1: HR_bpm: found -4".into()],
    }];
    Page::new(status, "PATIENT", false)
}

fn press(page: &mut Page, code: KeyCode) -> Action {
    page.on(KeyEvent::new(code, KeyModifiers::NONE))
}

fn write(page: &mut Page, text: &str) {
    for c in text.chars() {
        press(page, KeyCode::Char(c));
    }
}

fn names(page: &Page) -> Vec<String> {
    page.rows()
        .iter()
        .map(|entry| entry.name().to_owned())
        .collect()
}

fn selected(page: &Page) -> String {
    names(page)[page.table.selected().unwrap()].clone()
}

/// The page on a terminal of 100 by 14 characters.
fn drawn(page: &mut Page) -> String {
    let mut terminal = Terminal::new(TestBackend::new(100, 14)).unwrap();
    terminal.draw(|frame| draw(frame, page, true)).unwrap();
    terminal.backend().to_string()
}

#[test]
fn the_table_has_the_columns_of_status_and_says_what_is_chosen() {
    let mut page = page();
    let estimate = Estimate {
        end_ms: 1_772_370_000_000,
        basis: "from 1 finished patient that took 30 s each, and 2 attempts at work".into(),
    };
    page.update(page.status.clone(), Some(estimate));
    insta::assert_snapshot!(drawn(&mut page));
}

#[test]
fn new_and_changed_patients_stand_above_the_table() {
    let mut page = page();
    assert!(!drawn(&mut page).contains("the run"));
    page.status.new_patients = vec!["09-CoA".into()];
    page.status.changed_patients = vec![ChangedPatient {
        patient: "01-CoA".into(),
        from: "step-1".into(),
    }];
    let drawn = drawn(&mut page);
    for line in [
        "not in the run yet: 09-CoA",
        "changed since the run: 01-CoA (from step-1 on)",
    ] {
        assert!(drawn.contains(line), "{drawn}");
    }
}

#[test]
fn keys_sort_filter_and_keep_the_selected_patient() {
    let mut page = page();
    assert_eq!(
        names(&page),
        ["06-CoA", "04-CoA", "02-CoA", "03-CoA", "05-CoA", "01-CoA"]
    );
    press(&mut page, KeyCode::Down);
    press(&mut page, KeyCode::Down);
    assert_eq!(selected(&page), "02-CoA");
    press(&mut page, KeyCode::Char('s'));
    assert_eq!(names(&page)[1..3], ["01-CoA", "02-CoA"], "by name");
    assert_eq!(selected(&page), "02-CoA");
    press(&mut page, KeyCode::Char('s'));
    assert_eq!(
        names(&page)[1..4],
        ["02-CoA", "03-CoA", "01-CoA"],
        "by cost"
    );
    press(&mut page, KeyCode::Char('s'));
    assert_eq!(names(&page)[1], "04-CoA", "by time in the state");
    press(&mut page, KeyCode::Char('r'));
    assert_eq!(names(&page).last().unwrap(), "04-CoA", "reversed");

    press(&mut page, KeyCode::Char('/'));
    // Letters that are keys elsewhere are text in here.
    write(&mut page, "STEP-1q");
    press(&mut page, KeyCode::Backspace);
    assert_eq!(names(&page), ["02-CoA"]);
    press(&mut page, KeyCode::Enter);
    assert!(drawn(&mut page).contains("1 of 6: by time in state, reversed, with \"STEP-1\""));
    assert_eq!(press(&mut page, KeyCode::Esc), Action::Draw);
    assert_eq!(names(&page).len(), 6);
    press(&mut page, KeyCode::Char('f'));
    assert_eq!(names(&page), ["06-CoA", "04-CoA"], "refused and failed");
    assert_eq!(press(&mut page, KeyCode::Char('q')), Action::Leave);
}

#[test]
fn a_selected_patient_that_vanishes_leaves_its_row_selected() {
    let mut page = page();
    press(&mut page, KeyCode::End);
    assert_eq!(selected(&page), "01-CoA");
    let mut fewer = page.status.clone();
    fewer.patients.pop();
    page.update(fewer, None);
    assert_eq!(selected(&page), "05-CoA");
    let none = Status {
        patients: Vec::new(),
        refused: Vec::new(),
        ..page.status.clone()
    };
    page.update(none, None);
    assert_eq!(page.table.selected(), None);
    assert_eq!(press(&mut page, KeyCode::Enter), Action::Draw);
    drawn(&mut page);
}

#[test]
fn a_patient_is_opened_scrolled_and_its_log_followed() {
    let mut page = page();
    press(&mut page, KeyCode::Down);
    assert_eq!(press(&mut page, KeyCode::Enter), Action::Read);
    let opened = page.opened.as_mut().unwrap();
    opened.results = (1..=30).map(|n| format!("result {n}\n")).collect();
    opened.log = (1..=30).map(|n| format!("line\t{n} \x1b[2J\n")).collect();
    let screen = drawn(&mut page);
    assert!(
        screen.contains("04-CoA: results") && screen.contains("result 1 "),
        "{screen}"
    );
    press(&mut page, KeyCode::Down);
    let screen = drawn(&mut page);
    assert!(
        !screen.contains("result 1 ") && screen.contains("result 2 "),
        "{screen}"
    );
    press(&mut page, KeyCode::Tab);
    let screen = drawn(&mut page);
    assert!(
        screen.contains("log of the last attempt") && screen.contains("line    30 \\u001b[2J"),
        "{screen}"
    );
    page.opened.as_mut().unwrap().log.push_str("line\t31\n");
    assert!(
        drawn(&mut page).contains("line    31"),
        "the end is followed"
    );
    press(&mut page, KeyCode::Up);
    page.opened.as_mut().unwrap().log.push_str("line\t32\n");
    assert!(
        !drawn(&mut page).contains("line    32"),
        "a scrolled log stands still"
    );
    press(&mut page, KeyCode::End);
    assert!(
        drawn(&mut page).contains("line    32"),
        "its end is followed again"
    );
    assert_eq!(page.opened.as_ref().unwrap().part, Part::Log);
    assert_eq!(press(&mut page, KeyCode::Esc), Action::Draw);
    assert!(page.opened.is_none());
    let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
    assert_eq!(page.on(control_c), Action::Leave);
}

#[test]
fn colour_adds_nothing_on_a_small_terminal() {
    let mut page = page();
    for (width, height) in [(1, 1), (20, 3), (300, 100)] {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        for coloured in [false, true] {
            terminal
                .draw(|frame| draw(frame, &mut page, coloured))
                .unwrap();
        }
    }
    assert_eq!(page.status.counts[&PatientState::Failed], 1);
}
