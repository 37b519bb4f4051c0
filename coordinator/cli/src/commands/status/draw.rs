//! Drawing of the terminal page of `status --watch`.

use std::iter::zip;

use cardiotwin_engine::clock;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Paragraph, Row, Table};

use super::page::{Entry, Opened, Page, Part};
use super::table::{columns, counted, of_cluster, refused_row, row};
use super::unseen;
use crate::table;
use crate::talk::{Tone, harmless};

const KEYS_OF_TABLE: &str =
    "↑↓ select  Enter open  l log  / filter  s sort  r reverse  f failed  q quit";
const KEYS_OF_PATIENT: &str = "↑↓←→ scroll  Tab results or log  q back";

/// Draws the page. `coloured` is whether colour is wanted.
pub fn draw(frame: &mut Frame<'_>, page: &mut Page, coloured: bool) {
    let heading = heading(page);
    let parts = Layout::vertical([
        Constraint::Length(u16::try_from(heading.len()).unwrap_or(1)),
        Constraint::Fill(1),
        Constraint::Length(1),
    ]);
    let [top, middle, bottom] = parts.areas(frame.area());
    frame.render_widget(Paragraph::new(heading), top);
    let keys = match &page.opened {
        Some(opened) => {
            page.height = usize::from(middle.height.saturating_sub(1));
            patient(frame, middle, opened);
            KEYS_OF_PATIENT.to_owned()
        }
        None => {
            table(frame, middle, page, coloured);
            match page.is_typing {
                true => format!("filter: {}▏  Enter keep  Esc clear", page.filter),
                false => KEYS_OF_TABLE.to_owned(),
            }
        }
    };
    let dim = Style::new().add_modifier(Modifier::DIM);
    frame.render_widget(Paragraph::new(Span::styled(keys, dim)), bottom);
}

/// Counts, expected end and queue.
fn heading(page: &Page) -> Vec<Line<'static>> {
    let status = &page.status;
    let mut lines = counted(status);
    if let Some(estimate) = &page.estimate {
        let end = clock::utc_text(estimate.end_ms);
        let minute = end.get(..16).unwrap_or(&end).replace('T', " ");
        lines.push_str(&format!(
            "about {minute} UTC all done, {}\n",
            estimate.basis
        ));
    }
    lines.push_str(&status.cluster.as_ref().map(of_cluster).unwrap_or_default());
    lines.push_str(&unseen::lines(status));
    let line = |text: &str| Line::from(harmless(text).into_owned());
    lines.lines().map(line).collect()
}

fn style(tone: Option<Tone>, coloured: bool) -> Style {
    match tone.filter(|_| coloured) {
        None => Style::new(),
        Some(Tone::Bad) => Style::new().fg(Color::Red),
        Some(Tone::Doubtful) => Style::new().fg(Color::Yellow),
        Some(Tone::Good) => Style::new().fg(Color::Green),
        Some(Tone::Quiet) => Style::new().add_modifier(Modifier::DIM),
    }
}

fn table(frame: &mut Frame<'_>, area: Rect, page: &mut Page, coloured: bool) {
    let entries = page.rows();
    let n_rows = entries.len();
    let columns = columns(page.member);
    let cells: Vec<Vec<(String, Option<Tone>)>> = entries
        .iter()
        .map(|entry| match entry {
            Entry::Refused(refused) => refused_row(refused),
            Entry::Patient(patient) => row(patient),
        })
        .map(|row| {
            zip(&columns, &row)
                .map(|(c, cell)| table::shown(c, cell))
                .collect()
        })
        .collect();
    let headings = columns.each_ref().map(table::heading);
    let width = |k: usize| {
        let words = cells.iter().filter_map(|row| row.get(k));
        let longest = words.map(|(text, _)| text.chars().count()).max();
        let longest = longest.unwrap_or(0).max(headings[k].chars().count());
        u16::try_from(longest).unwrap_or(u16::MAX)
    };
    let last = headings.len() - 1;
    let widths: Vec<Constraint> = (0..headings.len())
        .map(|k| match k == last {
            true => Constraint::Fill(1),
            false => Constraint::Length(width(k)),
        })
        .collect();
    let rows: Vec<Row<'_>> = cells
        .iter()
        .map(|cells| {
            Row::new(
                cells
                    .iter()
                    .map(|(text, tone)| Cell::new(text.as_str()).style(style(*tone, coloured))),
            )
        })
        .collect();
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let order = match page.is_reversed {
        true => format!("by {}, reversed", page.order.word()),
        false => format!("by {}", page.order.word()),
    };
    let mut chosen = vec![order];
    if page.only_failed {
        chosen.push("only failed".to_owned());
    }
    if !page.filter.is_empty() && !page.is_typing {
        chosen.push(format!("with {:?}", page.filter));
    }
    let shown = format!(
        "{n_rows} of {}: {}",
        page.status.patients.len() + page.status.refused.len(),
        chosen.join(", ")
    );
    let [head, body] = Layout::vertical([Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    let dim = Style::new().add_modifier(Modifier::DIM);
    frame.render_widget(Paragraph::new(Span::styled(shown, dim)), head);
    let table = Table::new(rows, widths)
        .header(Row::new(headings).style(bold))
        .column_spacing(2)
        .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED));
    frame.render_stateful_widget(table, body, &mut page.table);
}

fn patient(frame: &mut Frame<'_>, area: Rect, opened: &Opened) {
    let [head, body] = Layout::vertical([Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let part = match opened.part {
        Part::Results => "results",
        Part::Log => "log of the last attempt",
    };
    let title = format!("{}: {part}", opened.patient);
    frame.render_widget(
        Paragraph::new(Span::styled(harmless(&title).into_owned(), bold)),
        head,
    );
    let lines: Vec<&str> = opened.text().lines().collect();
    let height = usize::from(body.height);
    let last = lines.len().saturating_sub(height);
    let from = opened.from.unwrap_or(last).min(last);
    let text: Vec<Line<'_>> = lines
        .iter()
        .skip(from)
        .take(height)
        .map(|line| Line::from(harmless(line).replace('\t', "    ")))
        .collect();
    frame.render_widget(Paragraph::new(text).scroll((0, opened.column)), body);
}
