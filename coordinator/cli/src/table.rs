//! Tables for the terminal: plain columns without frames, which can be cut and grepped.

use cardiotwin_report::table::{Cell, Column, Digits, Kind, Table};
pub use cardiotwin_report::table::{duration, number, optional, percent};
use unicode_width::UnicodeWidthStr as _;

use super::talk::{Talk, Tone, harmless, paint};

/// Spaces between columns.
const GAP: usize = 2;

/// The table as lines without trailing spaces, each ended by a line feed. Tones are marks, as in
/// every text.
#[must_use]
pub fn text(table: &Table, talk: &Talk) -> String {
    let headings: Vec<String> = table.columns.iter().map(heading).collect();
    lines(table, &headings, talk)
}

/// Label and unit of a column in capitals. A word with a capital or an underscore, such as `EDV` or
/// `P_max`, stays as it is.
#[must_use]
pub fn heading(column: &Column) -> String {
    let is_name = |word: &str| word.contains(|c: char| c.is_uppercase() || c == '_');
    let word = |word: &str| match is_name(word) {
        true => word.to_owned(),
        false => word.to_uppercase(),
    };
    let words: Vec<String> = column.label.split(' ').map(word).collect();
    format!("{} {}", words.join(" "), column.unit)
        .trim_end()
        .to_owned()
}

/// What the terminal shows of a cell, and in which tone.
#[must_use]
pub fn shown(column: &Column, cell: &Cell) -> (String, Option<Tone>) {
    let text = column.text(cell);
    match column.kind {
        Kind::Numbers(Digits::Difference) if cell.value.is_number() => {
            (format!("{text} %"), cell.tone)
        }
        Kind::Remarks => (harmless(&text).into_owned(), Some(Tone::Quiet)),
        // Widths are those of what is shown.
        _ => (harmless(&text).into_owned(), cell.tone),
    }
}

fn lines(table: &Table, headings: &[String], talk: &Talk) -> String {
    let places: Vec<usize> = (0..headings.len())
        .filter(|k| table.columns[*k].kind != Kind::Data)
        .collect();
    let head = places
        .iter()
        .map(|k| (headings[*k].clone(), None))
        .collect();
    let mut rows: Vec<Vec<(String, Option<Tone>)>> = vec![head];
    for row in table.rows.iter().chain(&table.foot) {
        let cell = |k: &usize| match row.get(*k) {
            Some(cell) => shown(&table.columns[*k], cell),
            None => (String::new(), None),
        };
        rows.push(places.iter().map(cell).collect());
    }
    let width = |k: usize| {
        let texts = rows.iter().flat_map(|row| row[k].0.split('\n'));
        texts.map(|line| line.width()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..places.len()).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        let height = row.iter().map(|(text, _)| text.split('\n').count()).max();
        for n in 0..height.unwrap_or(0) {
            let mut line = String::new();
            for (k, (text, tone)) in row.iter().enumerate() {
                let part = text.split('\n').nth(n).unwrap_or_default();
                let space = " ".repeat(widths[k] - part.width());
                let gap = if k + 1 == row.len() { 0 } else { GAP };
                let padded = match table.columns[places[k]].is_right() {
                    true => format!("{space}{part}{:gap$}", ""),
                    false => format!("{part}{space}{:gap$}", ""),
                };
                let coloured = tone.filter(|_| talk.colour_out);
                line += &coloured.map_or(padded.clone(), |tone| paint(true, tone, &padded));
            }
            text += line.trim_end();
            text.push('\n');
        }
    }
    text
}

/// A table that only a terminal shows, under construction.
pub struct Columns {
    table: Table,
    headings: Vec<String>,
    talk: Talk,
}

impl Columns {
    /// An empty table with these headings. A heading that begins with `>` makes a right-aligned
    /// column of numbers.
    #[must_use]
    pub fn new(talk: &Talk, headings: &[&str]) -> Self {
        let column = |heading: &&str| match heading.strip_prefix('>') {
            Some(label) => Column::figures(label.to_owned()),
            None => Column::words((*heading).to_owned()),
        };
        let without_mark = |heading: &&str| heading.trim_start_matches('>').to_owned();
        Self {
            table: Table::new("", "", headings.iter().map(column)),
            headings: headings.iter().map(without_mark).collect(),
            talk: *talk,
        }
    }

    /// Adds a row of plain cells.
    pub fn row<T: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = T>) {
        let cells = cells.into_iter().map(|cell| Cell::from(cell.as_ref()));
        self.table.rows.push(cells.collect());
    }

    /// Adds a row of cells that may have a tone.
    pub fn toned(&mut self, cells: impl IntoIterator<Item = (String, Option<Tone>)>) {
        let cells = cells
            .into_iter()
            .map(|(text, tone)| Cell::from(text).toned(tone));
        self.table.rows.push(cells.collect());
    }

    /// The table as in [`text`].
    #[must_use]
    pub fn text(&self) -> String {
        lines(&self.table, &self.headings, &self.talk)
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_report::table::{cells, csv, html};
    use proptest::prelude::*;

    use super::*;
    use crate::talk::coloured;

    const PLAIN: Talk = Talk {
        colour_out: false,
        colour_err: false,
        quiet: true,
        bars: false,
    };

    #[test]
    fn headings_are_words_in_capitals_with_a_unit() {
        let headings = [
            Column::words("held_out_before"),
            Column::numbers("edv").label("EDV").unit("mL"),
            Column::numbers("p").label("P_max"),
            Column::figures("d").label("diff mean (SD; max)").unit("%"),
        ]
        .map(|column| heading(&column));
        let expected = [
            "HELD OUT BEFORE",
            "EDV mL",
            "P_max",
            "DIFF MEAN (SD; MAX) %",
        ];
        assert_eq!(headings, expected);
    }

    proptest! {
        /// Terminal and page print the same digits, and CSV and JSON hold the number behind them.
        #[test]
        fn every_medium_has_the_same_numbers(
            values in proptest::collection::vec(
                proptest::option::of(-1e6f64..1e6), 1..6
            ),
            scale in -9i32..1,
        ) {
            let formats = [
                Digits::Auto, Digits::Fixed(2), Digits::Signed(1),
                Digits::Share, Digits::Difference, Digits::Duration,
            ];
            let columns = formats.iter().enumerate()
                .map(|(k, digits)| Column::numbers(format!("c{k}")).digits(*digits));
            let names = [Column::words("name")];
            let mut table = Table::new("t", "T", names.into_iter().chain(columns));
            for value in values {
                let value = value.map(|value| value * 10f64.powi(scale));
                let mut row = cells!["<a> & \"b\""];
                row.extend(formats.map(|_| Cell::from(value)));
                table.rows.push(row);
            }
            let text = text(&table, &PLAIN);
            let page = html(&table).into_string();
            let page = page.replace(['\u{2212}', '\u{2013}'], "-");
            prop_assert!(page.contains("&lt;a&gt; &amp; &quot;b&quot;"));
            let file = csv(&table);
            let mut lines = file.lines();
            prop_assert_eq!(lines.next(), Some("name,c0,c1,c2,c3,c4,c5"));
            let json = serde_json::to_value(&table).unwrap();
            for (k, row) in table.rows.iter().enumerate() {
                let line = text.lines().nth(k + 1).unwrap();
                let of_file = lines.next().unwrap().rsplit_once('"').unwrap().1;
                let of_file: Vec<&str> = of_file.split(',').skip(1).collect();
                for (i, cell) in row.iter().enumerate().skip(1) {
                    let (column, shown) = (&table.columns[i], table.columns[i].text(cell));
                    prop_assert!(line.contains(&shown), "{} is not in {}", shown, line);
                    prop_assert!(page.contains(&format!(">{shown}<")), "{} is not in {}", shown, page);
                    let of_json = Cell::from(json[k][column.key.as_ref()].clone());
                    prop_assert_eq!(&of_json.value, &cell.value);
                    let number: Option<f64> = of_file[i - 1].parse().ok();
                    prop_assert_eq!(column.text(&Cell::from(number)), shown);
                }
            }
        }
    }

    #[test]
    fn columns_are_plain_and_numbers_stand_right() {
        let mut table = Columns::new(&PLAIN, &["PATIENT", ">COST", "NOTE"]);
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
            ..PLAIN
        };
        let mut table = Columns::new(&talk, &["PATIENT", "STATE", "NOTE"]);
        for tone in [Tone::Bad, Tone::Doubtful, Tone::Good, Tone::Quiet] {
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
}
