//! Tables for the terminal: plain columns without frames, which can be cut and grepped.

use comfy_table::{Cell, CellAlignment, Color, ContentArrangement, Table};

use super::talk::{Talk, Tone, harmless, paint};

/// Tones, and the colours by which the table knows them until it is written.
const TONES: [Tone; 4] = [Tone::Bad, Tone::Doubtful, Tone::Good, Tone::Quiet];
const COLOURS: [Color; 4] = [Color::Red, Color::Yellow, Color::Green, Color::DarkGrey];
/// The sequences that the table writes for these colours, and for their end.
const CODES: [&str; 4] = [
    "\x1b[38;5;9m",
    "\x1b[38;5;11m",
    "\x1b[38;5;10m",
    "\x1b[38;5;8m",
];
const NO_COLOUR: &str = "\x1b[39m";

fn place(tone: Tone) -> usize {
    TONES
        .iter()
        .position(|one| *one == tone)
        .unwrap_or_default()
}

/// A table under construction.
pub struct Columns {
    table: Table,
    colour: bool,
}

impl Columns {
    /// An empty table with these headings. A heading that begins with `>` makes a right-aligned
    /// column of numbers.
    #[must_use]
    pub fn new(talk: &Talk, headings: &[&str]) -> Self {
        let mut table = Table::new();
        table.load_style(comfy_table::presets::NOTHING);
        table.set_content_arrangement(ContentArrangement::Disabled);
        if talk.colour_out {
            table.enforce_styling();
        } else {
            table.force_no_tty();
        }
        table.set_header(
            headings
                .iter()
                .map(|heading| heading.trim_start_matches('>')),
        );
        let n_columns = headings.len();
        for (i, heading) in headings.iter().enumerate() {
            if let Some(column) = table.column_mut(i) {
                column.set_padding((0, if i + 1 == n_columns { 0 } else { 2 }));
                if heading.starts_with('>') {
                    column.set_cell_alignment(CellAlignment::Right);
                }
            }
        }
        Self {
            table,
            colour: talk.colour_out,
        }
    }

    /// Adds a row of plain cells.
    pub fn row<T: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.toned(
            cells
                .into_iter()
                .map(|cell| (cell.as_ref().to_owned(), None)),
        );
    }

    /// Adds a row of cells that may have a tone.
    pub fn toned(&mut self, cells: impl IntoIterator<Item = (String, Option<Tone>)>) {
        let colour = self.colour;
        self.table.add_row(cells.into_iter().map(|(text, tone)| {
            // Widths are those of what is shown.
            let cell = Cell::new(harmless(&text));
            match tone.filter(|_| colour) {
                Some(tone) => cell.fg(COLOURS[place(tone)]),
                None => cell,
            }
        }));
    }

    /// The table as lines without trailing spaces, each ended by a line feed. Tones are marks, as
    /// in every text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.table.to_string();
        if self.colour {
            for (tone, code) in TONES.into_iter().zip(CODES) {
                let marked = paint(true, tone, "");
                let mut marks = marked.chars().map(String::from);
                let (begin, end) = (marks.next(), marks.next());
                text = text.replace(code, &begin.unwrap_or_default());
                text = text.replace(NO_COLOUR, &end.unwrap_or_default());
            }
        }
        text.lines()
            .map(|line| format!("{}\n", line.trim_end()))
            .collect()
    }
}

/// A number with as many digits as a table needs; very large and very small ones in scientific
/// notation.
#[must_use]
pub fn number(value: f64) -> String {
    let magnitude = value.abs();
    match value {
        _ if !value.is_finite() => value.to_string(),
        _ if magnitude == 0.0 => "0".to_owned(),
        _ if magnitude >= 1e5 => format!("{value:.3e}"),
        _ if magnitude >= 100.0 => format!("{value:.1}"),
        _ if magnitude >= 1.0 => format!("{value:.2}"),
        _ if magnitude >= 0.001 => format!("{value:.4}"),
        _ => format!("{value:.2e}"),
    }
}

/// The number as in [`number`], or a dash.
#[must_use]
pub fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), number)
}

/// A share as signed percent, or a dash.
#[must_use]
pub fn percent(value: Option<f64>) -> String {
    value.map_or_else(
        || "-".to_owned(),
        |share| format!("{:+.1} %", 100.0 * share),
    )
}

/// Seconds as `00:01:23`, short ones as `3.2 s`.
#[must_use]
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 0.0 {
        return "-".to_owned();
    }
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    format!(
        "{:02}:{:02}:{:02}",
        whole / 3600,
        whole / 60 % 60,
        whole % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::talk::coloured;

    #[test]
    fn columns_are_plain_and_numbers_stand_right() {
        let talk = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let mut table = Columns::new(&talk, &["PATIENT", ">COST", "NOTE"]);
        table.row(["01", "0.1", "long note"]);
        table.row(["02-long", "10.25", ""]);
        assert_eq!(
            table.text(),
            "PATIENT   COST  NOTE\n01         0.1  long note\n02-long  10.25\n"
        );
    }

    #[test]
    fn tones_become_our_own_colours_and_names_bring_none() {
        let talk = Talk {
            colour_out: true,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let mut table = Columns::new(&talk, &["PATIENT", "STATE", "NOTE"]);
        for tone in TONES {
            let cell = |text: &str| (text.to_owned(), None);
            let name = cell("e\x1b[38;5;9mvil");
            table.toned([name, ("word".to_owned(), Some(tone)), cell("note")]);
        }
        let shown = coloured(&harmless(&table.text())).into_owned();
        let lines: Vec<&str> = shown.lines().skip(1).collect();
        assert_eq!(
            lines,
            ["31", "33", "32", "2"]
                .map(|code| format!("e\\u001b[38;5;9mvil  \x1b[{code}mword   \x1b[0mnote"))
        );
    }

    #[test]
    fn quantities_for_people() {
        assert_eq!(
            [number(0.0834), number(12.3456), number(631.0), number(1e-5)],
            ["0.0834", "12.35", "631.0", "1.00e-5"]
        );
        assert_eq!(
            [duration(3.21), duration(83.0), duration(4360.0)],
            ["3.2 s", "00:01:23", "01:12:40"]
        );
        assert_eq!([percent(Some(-0.0531)), percent(None)], ["-5.3 %", "-"]);
    }
}
