//! Contents of the terminal page of `status --watch`: order and filter of its table, the opened
//! patient, and the meaning of the keys.

use std::cmp::Ordering;

use cardiotwin_dashboard::Estimate;
use cardiotwin_schemas::status::{PatientState, PatientStatus, RefusedPatient, Status};
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::widgets::TableState;

/// Rows that a page key moves by.
const ROWS_OF_A_PAGE: isize = 15;
/// Columns that an arrow key moves a log by.
const COLUMNS: u16 = 20;

/// Order of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Failures first, as `status` prints it.
    State,
    /// Name of the patient.
    Patient,
    /// Cost, the largest first.
    Cost,
    /// Time in the state, the longest first.
    Time,
}

impl Order {
    /// The next one, for a key that goes through all of them.
    fn next(self) -> Self {
        match self {
            Self::State => Self::Patient,
            Self::Patient => Self::Cost,
            Self::Cost => Self::Time,
            Self::Time => Self::State,
        }
    }

    /// The order in words.
    pub fn word(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Patient => "name",
            Self::Cost => "cost",
            Self::Time => "time in state",
        }
    }

    fn compare(self, a: &PatientStatus, b: &PatientStatus) -> Ordering {
        let cost = |patient: &PatientStatus| {
            let cost = patient.step2_cost.or(patient.step1_cost);
            cost.unwrap_or(f64::NEG_INFINITY)
        };
        match self {
            Self::State => Ordering::Equal,
            Self::Patient => a.patient.cmp(&b.patient),
            Self::Cost => cost(b).total_cmp(&cost(a)),
            Self::Time => b.for_s.total_cmp(&a.for_s),
        }
    }
}

/// A row of the table.
#[derive(Debug, Clone, Copy)]
pub enum Entry<'a> {
    /// A patient with errors in its files.
    Refused(&'a RefusedPatient),
    /// A patient of the run.
    Patient(&'a PatientStatus),
}

impl Entry<'_> {
    /// Name of the patient.
    pub fn name(&self) -> &str {
        match self {
            Self::Refused(refused) => &refused.patient,
            Self::Patient(patient) => &patient.patient,
        }
    }

    fn contains(&self, text: &str) -> bool {
        let has = |part: &str| part.to_lowercase().contains(text);
        match self {
            Self::Refused(refused) => {
                has(&refused.patient) || has("refused") || refused.errors.iter().any(|e| has(e))
            }
            Self::Patient(patient) => {
                has(&patient.patient)
                    || has(patient.step_shown())
                    || has(&patient.state.to_string())
                    || has(&patient.note)
            }
        }
    }
}

/// A part of an opened patient's page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Text of `cardiotwin show`.
    Results,
    /// End of the log of the last attempt.
    Log,
}

/// An opened patient.
#[derive(Debug, Clone)]
pub struct Opened {
    /// Name of the patient.
    pub patient: String,
    /// Part on the screen.
    pub part: Part,
    /// Text of the results.
    pub results: String,
    /// Text of the log.
    pub log: String,
    /// First line on the screen; `None` follows the end.
    pub from: Option<usize>,
    /// First column on the screen.
    pub column: u16,
}

impl Opened {
    /// Text of the part on the screen.
    pub fn text(&self) -> &str {
        match self.part {
            Part::Results => &self.results,
            Part::Log => &self.log,
        }
    }

    fn turn_to(&mut self, part: Part) {
        self.part = part;
        self.column = 0;
        self.from = match part {
            Part::Results => Some(0),
            Part::Log => None,
        };
    }
}

/// Result of a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// The page is drawn again.
    Draw,
    /// The texts of the opened patient are needed.
    Read,
    /// The page ends.
    Leave,
}

/// The page.
#[derive(Debug)]
pub struct Page {
    /// Heading of the first column.
    pub member: &'static str,
    /// State of the run.
    pub status: Status,
    /// Expected end.
    pub estimate: Option<Estimate>,
    /// Order of the table.
    pub order: Order,
    /// Whether the order is reversed.
    pub is_reversed: bool,
    /// Text that rows have to contain.
    pub filter: String,
    /// Whether keys are letters of the filter.
    pub is_typing: bool,
    /// Whether only failed and refused patients are shown.
    pub only_failed: bool,
    /// The opened patient.
    pub opened: Option<Opened>,
    /// Selected row and first row on the screen.
    pub table: TableState,
    /// Lines of text that fit on the screen, as of the last drawing.
    pub height: usize,
    selected: Option<String>,
}

impl Page {
    /// A page with the first row selected.
    pub fn new(status: Status, member: &'static str, only_failed: bool) -> Self {
        let mut page = Self {
            member,
            status,
            estimate: None,
            order: Order::State,
            is_reversed: false,
            filter: String::new(),
            is_typing: false,
            only_failed,
            opened: None,
            table: TableState::new(),
            height: 0,
            selected: None,
        };
        page.select(0);
        page
    }

    /// Takes over a newer state. The same patient stays selected.
    pub fn update(&mut self, status: Status, estimate: Option<Estimate>) {
        self.status = status;
        self.estimate = estimate;
        self.find_selected();
    }

    /// Rows that pass the filters, in order.
    pub fn rows(&self) -> Vec<Entry<'_>> {
        let text = self.filter.to_lowercase();
        let mut patients: Vec<&PatientStatus> = self
            .status
            .patients
            .iter()
            .filter(|patient| !self.only_failed || patient.state == PatientState::Failed)
            .collect();
        patients.sort_by(|a, b| self.order.compare(a, b));
        if self.is_reversed {
            patients.reverse();
        }
        let refused = self.status.refused.iter().map(Entry::Refused);
        refused
            .chain(patients.into_iter().map(Entry::Patient))
            .filter(|entry| text.is_empty() || entry.contains(&text))
            .collect()
    }

    fn select(&mut self, index: usize) {
        let rows = self.rows();
        let index = index.min(rows.len().saturating_sub(1));
        let selected = rows.get(index).map(|entry| entry.name().to_owned());
        self.table.select(selected.is_some().then_some(index));
        self.selected = selected;
    }

    fn find_selected(&mut self) {
        let name = self.selected.as_deref();
        let found = self
            .rows()
            .iter()
            .position(|entry| Some(entry.name()) == name);
        self.select(found.or(self.table.selected()).unwrap_or(0));
    }

    fn move_by(&mut self, n: isize) {
        let height = self.height;
        match &mut self.opened {
            None => {
                let now = self.table.selected().unwrap_or(0);
                self.select(now.saturating_add_signed(n));
            }
            Some(opened) => {
                let last = opened.text().lines().count().saturating_sub(height);
                let from = opened.from.unwrap_or(last).saturating_add_signed(n);
                // At its end, a log is followed again.
                opened.from =
                    (from < last || opened.part == Part::Results).then_some(from.min(last));
            }
        }
    }

    /// Answers a key.
    pub fn on(&mut self, key: KeyEvent) -> Action {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        if control && matches!(key.code, KeyCode::Char('c' | 'd')) {
            return Action::Leave;
        }
        if self.is_typing {
            self.write(key.code);
            return Action::Draw;
        }
        match key.code {
            KeyCode::Up | KeyCode::Char('k') => self.move_by(-1),
            KeyCode::Down | KeyCode::Char('j') => self.move_by(1),
            KeyCode::PageUp => self.move_by(-ROWS_OF_A_PAGE),
            KeyCode::PageDown | KeyCode::Char(' ') => self.move_by(ROWS_OF_A_PAGE),
            KeyCode::Home | KeyCode::Char('g') => self.move_by(isize::MIN / 2),
            KeyCode::End | KeyCode::Char('G') => self.move_by(isize::MAX / 2),
            code => {
                return match self.opened {
                    None => self.on_table(code),
                    Some(_) => self.on_patient(code),
                };
            }
        }
        Action::Draw
    }

    fn write(&mut self, code: KeyCode) {
        match code {
            KeyCode::Enter => self.is_typing = false,
            KeyCode::Esc => {
                self.is_typing = false;
                self.filter.clear();
            }
            KeyCode::Backspace => {
                self.filter.pop();
            }
            KeyCode::Char(c) => self.filter.push(c),
            _ => {}
        }
        self.find_selected();
    }

    fn on_table(&mut self, code: KeyCode) -> Action {
        match code {
            KeyCode::Char('q') => return Action::Leave,
            KeyCode::Esc if self.filter.is_empty() => return Action::Leave,
            KeyCode::Esc => self.filter.clear(),
            KeyCode::Char('/') => self.is_typing = true,
            KeyCode::Char('s') => self.order = self.order.next(),
            KeyCode::Char('r') => self.is_reversed = !self.is_reversed,
            KeyCode::Char('f') => self.only_failed = !self.only_failed,
            KeyCode::Enter => return self.open(Part::Results),
            KeyCode::Char('l') => return self.open(Part::Log),
            _ => {}
        }
        self.find_selected();
        Action::Draw
    }

    fn open(&mut self, part: Part) -> Action {
        let Some(patient) = self.selected.clone() else {
            return Action::Draw;
        };
        let mut opened = Opened {
            patient,
            part,
            results: String::new(),
            log: String::new(),
            from: Some(0),
            column: 0,
        };
        opened.turn_to(part);
        self.opened = Some(opened);
        Action::Read
    }

    fn on_patient(&mut self, code: KeyCode) -> Action {
        let Some(opened) = &mut self.opened else {
            return Action::Draw;
        };
        match code {
            KeyCode::Char('q') | KeyCode::Esc | KeyCode::Backspace => self.opened = None,
            KeyCode::Char('l') => opened.turn_to(Part::Log),
            KeyCode::Enter => opened.turn_to(Part::Results),
            KeyCode::Tab => opened.turn_to(match opened.part {
                Part::Results => Part::Log,
                Part::Log => Part::Results,
            }),
            KeyCode::Left => opened.column = opened.column.saturating_sub(COLUMNS),
            KeyCode::Right => opened.column = opened.column.saturating_add(COLUMNS),
            _ => {}
        }
        Action::Draw
    }
}
