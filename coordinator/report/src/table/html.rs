//! A table as an element of a page.

use cardiotwin_schemas::label::Label;
use maud::{Markup, html};

use super::digits::Digits;
use super::model::{Cell, Column, Kind, Table, Tone};
use crate::html::format::{raw, symbol};

/// The table with a scroll bar of its own on a narrow screen. Its key is its class.
#[must_use]
pub fn html(table: &Table) -> Markup {
    let shown: Vec<usize> = (0..table.columns.len())
        .filter(|k| table.columns[*k].kind != Kind::Data)
        .collect();
    let columns: Vec<&Column> = shown.iter().map(|k| &table.columns[*k]).collect();
    // Columns before the first group have one head as high as two.
    let n_before = columns.iter().position(|column| !column.group.is_empty());
    let opens: Vec<bool> = (0..columns.len())
        .map(|k| {
            n_before.is_some_and(|n| k >= n && (k == n || columns[k].group != columns[k - 1].group))
        })
        .collect();
    let size_of_group = |k: usize| {
        let same = |column: &&&Column| column.group == columns[k].group;
        columns[k..].iter().take_while(same).count()
    };
    let line = |row: &[Cell], span: usize| {
        let cells = shown.iter().enumerate();
        html! { tr { @for (k, place) in cells.filter(|(k, _)| *k == 0 || *k >= span) {
            (cell(columns[k], &row[*place], (k == 0).then_some(span), opens[k]))
        } } }
    };
    // The name of a last row takes the place of the cells without a group that it lacks.
    let span = |row: &[Cell]| {
        let others = &shown[1..n_before.unwrap_or(1).max(1)];
        let is_lacking = |place: &&usize| row[**place].value == "";
        1 + others.iter().take_while(is_lacking).count()
    };
    html! {
        div.scroll tabindex="0" { table class=(table.key) {
            caption { (table.title) }
            thead {
                @if let Some(n) = n_before { tr {
                    @for column in &columns[..n] { (head(column, false, true)) }
                    @for k in (n..columns.len()).filter(|k| opens[*k]) {
                        th.group colspan=(size_of_group(k)) scope="colgroup" { (columns[k].group) }
                    }
                } }
                tr { @for k in n_before.unwrap_or(0)..columns.len() { (head(columns[k], opens[k], false)) } }
            }
            tbody { @for row in &table.rows { (line(row, 1)) } }
            @if !table.foot.is_empty() { tfoot { @for row in &table.foot { (line(row, span(row))) } } }
        } }
    }
}

fn head(column: &Column, opens_group: bool, is_high: bool) -> Markup {
    let rowspan = is_high.then_some("2");
    let label = column.label.replace(" - ", " \u{2212} ");
    let unit = match column.kind {
        Kind::Numbers(Digits::Difference) => "%",
        _ => column.unit,
    };
    let class = match (opens_group, column.is_right()) {
        (true, _) => Some("group"),
        (false, false) => Some("unit"),
        (false, true) => None,
    };
    let title = Some(column.meaning).filter(|meaning| !meaning.is_empty());
    let whole = match unit {
        "" => column.label.to_string(),
        unit => format!("{} ({unit})", column.label),
    };
    html! {
        @match (column.symbol, column.kind) {
            (Some(b), _) => th class=[class] scope="col" rowspan=[rowspan] title=[title] data-value=(whole) { (symbol(b.key())) },
            _ if !column.short.is_empty() => th class=[class] scope="col" rowspan=[rowspan] title=[title] data-value=(whole) { (column.short) },
            (_, Kind::Keys) => { th scope="col" title=[title] { "" } th.unit scope="col" { "unit" } },
            _ if unit.is_empty() => th class=[class] scope="col" rowspan=[rowspan] title=[title] { (label) },
            _ => th class=[class] scope="col" rowspan=[rowspan] title=[title] data-value=(whole) { (label) ", " (unit) },
        }
    }
}

/// - `span`: number of columns that the row's name takes; `None` for a cell that is no name
fn cell(column: &Column, cell: &Cell, span: Option<usize>, opens_group: bool) -> Markup {
    let text = column.text(cell);
    let content = match column.kind {
        Kind::Keys => symbol(&text),
        Kind::Names => html! { (text.replace('_', " ")) },
        Kind::Figures | Kind::Numbers(_) => html! { (signs(&text)) },
        Kind::Words | Kind::Remarks | Kind::Data => html! { (text) },
    };
    let content = match cell.link.as_str() {
        "" => content,
        link => html! { a href=(link) { (content) } },
    };
    let sign = cell.tone.map(sign_of);
    let hint = Some(cell.hint.as_str()).filter(|hint| !hint.is_empty());
    let words = html! {
        @if let Some((class, sign)) = sign { span class=(class) { (sign) } " " } (content)
        @if !cell.note.is_empty() { br; span.quiet { (cell.note) } }
    };
    let unit = html! { @if column.kind == Kind::Keys { td.unit { (Label::of(&text).map_or("", |label| label.unit)) } } };
    if let Some(span) = span {
        return html! { th scope="row" title=[hint] colspan=[(span > 1).then_some(span)] { (words) } (unit) };
    }
    let Kind::Numbers(_) = column.kind else {
        let class = match column.kind {
            Kind::Figures => Some("num"),
            Kind::Remarks => Some("quiet"),
            _ => None,
        };
        return html! { td class=[class] title=[hint] { (words) } (unit) };
    };
    let (value, digits) = (cell.value.as_f64(), column.digits_of(cell));
    let size = match value.map(f64::abs) {
        _ if digits != Digits::Difference => "",
        Some(share) if share > 0.25 => " diff far",
        Some(share) if share > 0.10 => " diff off",
        _ => "",
    };
    let group = if opens_group { " group" } else { "" };
    let unrounded = value.map(|value| digits.factor() * value);
    html! {
        td class={ "num" (group) (size) } data-value=[(!cell.value.is_string()).then(|| raw(unrounded))] {
            (content) @if let Some((class, sign)) = sign { span class=(class) title=[hint] { " " (sign) } }
        }
    }
}

/// Class of the style sheet and sign of a tone, so that colour is not needed.
#[must_use]
pub fn sign_of(tone: Tone) -> (&'static str, &'static str) {
    match tone {
        Tone::Bad => ("bad", "✕"),
        Tone::Doubtful => ("warn", "▲"),
        Tone::Good => ("good", "●"),
        Tone::Quiet => ("quiet", "○"),
    }
}

/// Numbers with true minus signs, and a true dash for a missing one.
fn signs(text: &str) -> String {
    match text {
        "-" => "\u{2013}".to_owned(),
        _ => text.replace('-', "\u{2212}"),
    }
}
