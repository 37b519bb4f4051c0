//! Text files that LabChart (ADInstruments) exports, of PowerLab and of Millar's catheters.
//!
//! Each block begins with header lines `Key=` and tabs: `Interval=`, `ExcelDateTime=`,
//! `TimeFormat=`, `DateFormat=`, `ChannelTitle=`, `Range=`, and in newer versions `UnitName=`,
//! `TopValue=` and `BottomValue=`. Rows follow: the time (an option of the export), a value for each
//! channel, and comments after `#`. A unit `*` means the range's unit. Without `UnitName=`, a unit in
//! the title goes before the range's unit, which is the amplifier's. An empty cell at the end of a
//! row is a cell. Times of day may pass midnight, have AM or PM, and stand behind a column of dates. Where
//! times are rounded, the stated interval counts.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::clock::{Clock, DAY_MS, is_date, other_interval, time_of_day_ms};
use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::Label;
use crate::number::{Decimal, is_missing, number};
use crate::text::Decoded;
use crate::told::{Told, shown};
use crate::wanted::{TableReading, Wanted, times_of_the_file};

/// Keys of the header lines.
const KEYS: [&str; 9] = [
    "Interval=",
    "ExcelDateTime=",
    "TimeFormat=",
    "DateFormat=",
    "ChannelTitle=",
    "Range=",
    "UnitName=",
    "TopValue=",
    "BottomValue=",
];
/// Largest number of comments that are reported one by one.
const COMMENTS: usize = 6;

/// Whether a text has the header of LabChart among its first lines.
#[must_use]
pub fn is_labchart(text: &str) -> bool {
    text.lines()
        .take(12)
        .any(|line| line.starts_with("Interval=") || line.starts_with("ChannelTitle="))
}

#[derive(Debug, Default)]
struct Block {
    /// Line of the first header line, from 1.
    line: usize,
    titles: Vec<String>,
    units: Vec<String>,
    ranges: Vec<String>,
    interval_ms: Option<f64>,
    /// Days since 1900 at the block's begin.
    date: Option<f64>,
    from_start_of_block: bool,
    has_time: bool,
    /// Whether a column of dates stands before the times.
    has_date: bool,
    /// Whether rows lack the tabs of empty channels at their end.
    is_trimmed: bool,
    /// Clock of the times, which may pass midnight.
    clock: Clock,
    /// Most decimals of a time in seconds.
    decimals: usize,
    times_ms: Vec<f64>,
    columns: Vec<Vec<f64>>,
    runs: Vec<(usize, usize)>,
}

/// Reads an export.
/// - `wanted_block`: number of the block to read, from 1; without it, all blocks are joined
#[must_use]
pub fn parse(
    decoded: &Decoded<'_>,
    file: &Path,
    wanted: &[Wanted],
    wanted_block: Option<usize>,
) -> TableReading {
    let mut reader = Reader {
        file,
        told: Told::default(),
        comments: Vec::new(),
    };
    let decimal = decimal_of(&decoded.text);
    let mut blocks = reader.blocks(&decoded.text, decimal);
    let problems = reader.told.problems();
    if problems.iter().any(Problem::is_error) {
        return TableReading {
            table: None,
            problems,
        };
    }
    let n_blocks = blocks.len();
    let rounded = blocks.iter_mut().filter_map(Block::exact_times).next();
    let joined = match choose(blocks, file, wanted_block) {
        Ok(joined) => joined,
        Err(problem) => return refused(problem),
    };
    let mut said = vec![format!(
        "LabChart text, {}, decimal {}, {n_blocks} {}",
        decoded.encoding,
        decimal.word(),
        match (n_blocks, wanted_block) {
            (1, _) => "block".to_owned(),
            (_, Some(block)) => format!("blocks, of which block {block} is read"),
            _ => "blocks, joined by their dates".to_owned(),
        }
    )];
    if !joined.has_time {
        said.push("no column of times: time from the interval between samples".to_owned());
    }
    if let Some(interval_ms) = rounded {
        said.push(format!(
            "rounded times: the stated interval of {interval_ms} ms counts"
        ));
    }
    if joined.has_date {
        said.push(
            "the column of dates is not read: a time of day after midnight counts on".to_owned(),
        );
    }
    if !reader.comments.is_empty() {
        let named: Vec<String> = reader
            .comments
            .iter()
            .take(COMMENTS)
            .map(|(line, text)| format!("`{text}` (line {line})"))
            .collect();
        let more = reader.comments.len().saturating_sub(COMMENTS);
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        said.push(format!("comments: {}{more}", named.join(", ")));
    }
    let labels = joined.labels();
    let contradiction = other_interval(file, joined.interval_ms, &joined.times_ms);
    let Block {
        line,
        times_ms,
        columns,
        runs,
        ..
    } = joined;
    let grid = Grid {
        labels: std::iter::once(Label::new("time_ms"))
            .chain(labels)
            .collect(),
        columns: std::iter::once(times_ms).chain(columns).collect(),
        header_line: Some(line),
        lines: runs,
        said,
    };
    let mut reading = grid.choose(file, &times_of_the_file(wanted));
    reading.problems.extend(contradiction);
    reading
}

/// Decimal sign of the export, from the interval and the first rows.
fn decimal_of(text: &str) -> Decimal {
    let numbers = text
        .lines()
        .take(200)
        .filter(|line| line.starts_with("Interval=") || !line.contains('='))
        .map(|line| line.split('#').next().unwrap_or_default());
    let comma = numbers
        .flat_map(|line| line.split(['\t', ' ']))
        .any(|cell| cell.contains(',') && number(cell.trim().as_bytes(), Decimal::Comma).is_some());
    if comma {
        Decimal::Comma
    } else {
        Decimal::Point
    }
}

struct Reader<'a> {
    file: &'a Path,
    told: Told,
    comments: Vec<(usize, String)>,
}

impl Reader<'_> {
    fn blocks(&mut self, text: &str, decimal: Decimal) -> Vec<Block> {
        let mut blocks: Vec<Block> = Vec::new();
        let mut in_header = false;
        let lines: Vec<&str> = text.lines().collect();
        for (idx, line) in lines.iter().enumerate() {
            let number_of_line = idx + 1;
            // A tab at the end is an empty cell.
            let line = line.trim_end_matches(['\r', '\n', ' ']);
            if let Some(key) = KEYS.iter().find(|key| line.starts_with(*key)) {
                if !in_header {
                    blocks.push(Block {
                        line: number_of_line,
                        from_start_of_block: true,
                        ..Block::default()
                    });
                    in_header = true;
                }
                if let Some(block) = blocks.last_mut() {
                    self.header(key, &line[key.len()..], block, decimal, number_of_line);
                }
                continue;
            }
            if line.trim().is_empty() {
                continue;
            }
            in_header = false;
            match blocks.last_mut() {
                Some(block) => {
                    if block.columns.is_empty() {
                        block.form(&lines[idx..], decimal);
                    }
                    self.row(line, block, decimal, number_of_line);
                }
                None => {
                    let problem = Problem::error(
                        self.file,
                        format!("`{}` before any header", shown(line.as_bytes())),
                        "the header lines of LabChart, from `Interval=` on",
                        "export the file again with its block header",
                    );
                    self.told.tell("header", problem.at_line(number_of_line));
                }
            }
        }
        blocks.retain(|block| !block.times_ms.is_empty());
        if blocks.is_empty() && self.told.is_empty() {
            self.told.add(Problem::error(
                self.file,
                "a header of LabChart and no samples",
                "rows of samples below the header",
                "select the whole recording in LabChart and export it again",
            ));
        }
        blocks
    }

    fn header(&mut self, key: &str, rest: &str, block: &mut Block, decimal: Decimal, line: usize) {
        let cells = || rest.split('\t').map(|cell| cell.trim().to_owned());
        let after_tab = || cells().skip(1).collect::<Vec<String>>();
        match key {
            "ChannelTitle=" => {
                block.titles = after_tab();
                while block.titles.last().is_some_and(String::is_empty) {
                    block.titles.pop();
                }
            }
            "UnitName=" => block.units = after_tab(),
            "Range=" => block.ranges = after_tab(),
            "TimeFormat=" => {
                block.from_start_of_block = rest.trim().eq_ignore_ascii_case("StartOfBlock")
            }
            "ExcelDateTime=" => {
                block.date = cells()
                    .nth(1)
                    .and_then(|cell| number(cell.as_bytes(), decimal));
            }
            "Interval=" => {
                let text = rest.trim();
                let (value, unit) = text.split_once(' ').unwrap_or((text, "s"));
                let factor = Label::with_unit("time", Some(unit))
                    .unit
                    .and_then(|unit| crate::headers::KNOWN[0].dimension.factor(&unit));
                match number(value.as_bytes(), decimal).zip(factor) {
                    Some((value, factor)) if value > 0.0 => {
                        block.interval_ms = Some(value * factor)
                    }
                    _ => {
                        let problem = Problem::error(
                            self.file,
                            format!("`Interval={text}`"),
                            "a time with its unit, such as 0.001 s",
                            "export the file again with one rate for all channels",
                        );
                        self.told.tell("interval", problem.at_line(line));
                    }
                }
            }
            _ => {}
        }
    }

    fn row(&mut self, line: &str, block: &mut Block, decimal: Decimal, number_of_line: usize) {
        let (numbers, comment) = match line.split_once('#') {
            Some((numbers, comment)) => (numbers, Some(comment)),
            None => (line, None),
        };
        if let Some(comment) = comment {
            let text = comment
                .trim_start_matches(|c: char| c == '*' || c.is_ascii_digit())
                .trim();
            self.comments.push((number_of_line, text.to_owned()));
        }
        if numbers.trim().is_empty() {
            return;
        }
        let mut cells = cells_of(numbers);
        let n = block.titles.len();
        if block.columns.is_empty() {
            if n == 0 {
                let problem = Problem::error(
                    self.file,
                    "a block without names of channels",
                    "a line `ChannelTitle=` in its header",
                    "export the file again with its block header",
                );
                self.told.tell("titles", problem.at_line(block.line));
                block.columns = vec![Vec::new(); 1];
                return;
            }
            block.columns = vec![Vec::new(); n];
        }
        if n == 0 {
            return;
        }
        let expected = n + usize::from(block.has_time) + usize::from(block.has_date);
        // A tab before a comment or at the end of each row closes the last cell.
        while cells.len() > expected && cells.last().is_some_and(|cell| cell.is_empty()) {
            cells.pop();
        }
        while block.is_trimmed && cells.len() < expected {
            cells.push("");
        }
        if cells.len() != expected {
            let problem = Problem::error(
                self.file,
                format!("{} fields in `{}`", cells.len(), shown(line.as_bytes())),
                format!(
                    "{expected} (the block in line {} has {n} channels)",
                    block.line
                ),
                "export the file again; a decimal comma needs tabs between the cells",
            );
            self.told.tell("fields", problem.at_line(number_of_line));
            return;
        }
        if block.has_date {
            cells.remove(0);
        }
        let time = if block.has_time {
            block.time_ms(cells[0], decimal)
        } else if let Some(interval) = block.interval_ms {
            Some(block.times_ms.len() as f64 * interval)
        } else {
            let problem = Problem::error(
                self.file,
                "a block without times",
                "a column of times, or `Interval=` in the header",
                "tick the time in LabChart's export",
            );
            self.told.tell("interval", problem.at_line(block.line));
            return;
        };
        let Some(time) = time else {
            let problem = Problem::error(
                self.file,
                format!("`{}`", shown(cells[0].as_bytes())),
                "a time in seconds, or hours:minutes:seconds with or without AM and PM",
                "choose seconds in LabChart's export",
            );
            self.told.tell("time", problem.at_line(number_of_line));
            return;
        };
        let expected = block
            .runs
            .last()
            .map(|(row, line)| line + block.times_ms.len() - row);
        if expected != Some(number_of_line) {
            block.runs.push((block.times_ms.len(), number_of_line));
        }
        block.times_ms.push(time);
        for (i, cell) in cells[usize::from(block.has_time)..].iter().enumerate() {
            let value = number(cell.as_bytes(), decimal);
            if value.is_none() && !is_missing(cell.as_bytes()) {
                let problem = Problem::error(
                    self.file,
                    format!("`{}`", shown(cell.as_bytes())),
                    "a number, or an empty cell",
                    format!("export the file again with a decimal {}", decimal.word()),
                );
                self.told.tell(
                    "number",
                    problem
                        .at_line(number_of_line)
                        .at_key(block.titles[i].clone()),
                );
            }
            block.columns[i].push(value.unwrap_or(f64::NAN));
        }
    }
}

/// Cells of the part of a row before its comment.
fn cells_of(numbers: &str) -> Vec<&str> {
    numbers.split('\t').map(str::trim).collect()
}

/// Number of rows from which the form of a block is seen.
const PROBE: usize = 200;
/// Number of rows over which no channel but a time rises all the time.
const RISING: usize = 20;

/// Whether numbers rise as times do: by the interval, or for longer than any signal.
fn rises_as_time(times_ms: &[f64], interval_ms: Option<f64>) -> bool {
    let steps = || times_ms.windows(2).map(|pair| pair[1] - pair[0]);
    let by_interval = |interval: f64| steps().all(|step| (step - interval).abs() <= 0.5 * interval);
    let rises = steps().all(|step| step >= 0.0) && steps().any(|step| step > 0.0);
    match times_ms.len() {
        0 | 1 => false,
        n if n < RISING => interval_ms.is_some_and(by_interval),
        _ => rises,
    }
}

impl Block {
    /// Sees from the first rows whether there are columns of dates and times: from the most cells that
    /// a row has. Where no more cells are filled than there are channels, the last channels may be empty,
    /// with their tabs or without them: the first column is a time if it rises as one.
    fn form(&mut self, lines: &[&str], decimal: Decimal) {
        let n = self.titles.len();
        let rows: Vec<Vec<&str>> = lines
            .iter()
            .take_while(|line| !KEYS.iter().any(|key| line.starts_with(key)))
            .map(|line| line.trim_end_matches(['\r', '\n', ' ']))
            .map(|line| line.split('#').next().unwrap_or_default())
            .filter(|line| !line.trim().is_empty())
            .take(PROBE)
            .map(cells_of)
            .collect();
        let dated = rows
            .iter()
            .all(|row| row.len() > n && is_date(row[0]) && row[1].contains(':'));
        self.has_date = dated && !rows.is_empty();
        let skip = usize::from(self.has_date);
        let filled = |row: &Vec<&str>| {
            let end = row.iter().rposition(|cell| !cell.is_empty());
            end.map_or(0, |end| end + 1)
        };
        let most = rows.iter().map(filled).max().unwrap_or(0);
        let written = rows.iter().map(Vec::len).max().unwrap_or(0);
        self.has_time = if written > n + skip && most != n + skip {
            true
        } else {
            let mut clock = Clock::default();
            let times: Option<Vec<f64>> = rows
                .iter()
                .map(|row| clock.count_on(time_of_day_ms(row.get(skip)?, decimal)?))
                .collect();
            times.is_some_and(|times| rises_as_time(&times, self.interval_ms))
        };
        // Editors and scripts take tabs from the ends of lines: the last channels are empty.
        let expected = n + skip + usize::from(self.has_time);
        self.is_trimmed = written < expected && written > skip + usize::from(self.has_time);
    }

    /// A time as seconds or hours:minutes:seconds, in ms; after midnight it counts on.
    fn time_ms(&mut self, cell: &str, decimal: Decimal) -> Option<f64> {
        let last = cell.rsplit(':').next().unwrap_or_default();
        let decimals = last
            .split_once(char::from(decimal.byte()))
            .map_or(0, |(_, after)| {
                after.bytes().take_while(u8::is_ascii_digit).count()
            });
        self.decimals = self.decimals.max(decimals);
        self.clock.count_on(time_of_day_ms(cell, decimal)?)
    }

    /// Replaces rounded times by the stated interval if they are those times but for their rounding;
    /// returns it then.
    fn exact_times(&mut self) -> Option<f64> {
        let interval = self.interval_ms.filter(|_| self.has_time)?;
        let unit = 1e3 * 0.1_f64.powi(self.decimals as i32);
        let first = *self.times_ms.first()?;
        let off = |(i, t): (usize, &f64)| t - first - i as f64 * interval;
        let (low, high) = self
            .times_ms
            .iter()
            .enumerate()
            .map(off)
            .fold((0.0_f64, 0.0_f64), |(l, h), d| (l.min(d), h.max(d)));
        // Exact multiples stay as they are written.
        let rounded = high - low > 0.01 * interval;
        // A time may be rounded or cut: both leave a spread of one unit at most.
        if !rounded || high - low > 1.001 * unit {
            return None;
        }
        for (i, t) in self.times_ms.iter_mut().enumerate() {
            *t = first + i as f64 * interval;
        }
        Some(interval)
    }

    fn labels(&self) -> Vec<Label> {
        let unit_of_range = |i: usize| {
            self.ranges
                .get(i)
                .and_then(|range| range.split_once(' '))
                .map(|(_, unit)| unit.trim().to_owned())
        };
        (0..self.titles.len())
            .map(|i| {
                let unit = self
                    .units
                    .get(i)
                    .filter(|unit| !unit.is_empty() && *unit != "*")
                    .cloned();
                let titled = Label::new(&self.titles[i]);
                if unit.is_none() && titled.unit.is_some() {
                    return titled;
                }
                Label::with_unit(
                    &self.titles[i],
                    unit.or_else(|| unit_of_range(i)).as_deref(),
                )
            })
            .collect()
    }
}

/// The chosen block, or all blocks on one clock.
fn choose(mut blocks: Vec<Block>, file: &Path, wanted: Option<usize>) -> Result<Block, Problem> {
    let n = blocks.len();
    if let Some(number) = wanted {
        if !(1..=n).contains(&number) {
            return Err(Problem::error(
                file,
                format!("block {number} in prepare.toml"),
                format!("a block from 1 to {n}"),
                "correct `block`, or remove it to read all blocks",
            ));
        }
        return Ok(blocks.swap_remove(number - 1));
    }
    let mut blocks = blocks.into_iter();
    let Some(mut whole) = blocks.next() else {
        return Err(Problem::error(
            file,
            "no block",
            "a block of samples",
            "export the recording again",
        ));
    };
    for (number, block) in (2..).zip(blocks) {
        let differs = |what: &str| {
            Problem::error(
                file,
                format!("{what} in block {number}"),
                "blocks that can be joined",
                format!("choose one block in prepare.toml: block = 1 to block = {n}"),
            )
            .at_line(block.line)
        };
        if block.titles != whole.titles || block.labels() != whole.labels() {
            return Err(differs("other channels or units"));
        }
        let same_rate = match (block.interval_ms, whole.interval_ms) {
            (Some(a), Some(b)) => (a / b - 1.0).abs() < 1e-6,
            _ => true,
        };
        if !same_rate {
            return Err(differs("another interval between samples"));
        }
        let offset = if block.from_start_of_block || !block.has_time {
            let (Some(first), Some(here)) = (whole.date, block.date) else {
                return Err(differs("times from its own begin and no date"));
            };
            (here - first) * DAY_MS
        } else if let (Some(first), Some(here)) = (whole.date, block.date) {
            // Times of day begin again on each day.
            (here.floor() - first.floor()) * DAY_MS
        } else {
            0.0
        };
        let rows = whole.times_ms.len();
        whole
            .runs
            .extend(block.runs.iter().map(|(row, line)| (row + rows, *line)));
        whole
            .times_ms
            .extend(block.times_ms.iter().map(|t| t + offset));
        for (all, more) in whole.columns.iter_mut().zip(block.columns) {
            all.extend(more);
        }
    }
    Ok(whole)
}

#[cfg(test)]
mod tests;
