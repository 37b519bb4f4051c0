//! Which column is the pressure, which the volume, and which the time.

use std::path::Path;

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_lab_files::plain::{self, PlainColumn, PlainTable};
use cardiotwin_lab_files::text::decode;
use cardiotwin_lab_files::{Request, Wanted, detect, read};
use cardiotwin_schemas::raw::FileFormat;
use cardiotwin_signals::Problem;

use super::rises::rises;
use super::told::{AsksFor, Choices, Learned, NotUnderstood, question};
use crate::nearest;

/// Least share of its enclosing rectangle that a pressure-volume loop fills so that its sense tells
/// which column is the pressure. Loops of hearts fill more than half.
const SENSE: f64 = 0.2;

/// A column with the reason why it was chosen.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) column: PlainColumn,
    pub(super) learned: Learned,
    pub(super) why: String,
}

/// The chosen columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chosen {
    pub(super) time: Option<Choice>,
    pub(super) pressure: Choice,
    pub(super) volume: Choice,
    /// Columns that are not read.
    pub(super) others: Vec<String>,
}

/// All columns of a file. Formats other than text tables carry their units, so that quantities come in
/// ours.
pub(super) fn table(path: &Path, bytes: &[u8]) -> Result<PlainTable, NotUnderstood> {
    let decoded = decode(bytes);
    let format = detect(bytes, decoded.as_ref(), path);
    if decoded.is_some() && matches!(format, Some(FileFormat::Csv) | None) {
        return Ok(plain::parse(bytes, path)?);
    }
    let wanted = [
        Wanted {
            names: vec![("time_ms".into(), 1.0), ("time_s".into(), 1000.0)],
            ..Wanted::required("time")
        },
        Wanted {
            required: true,
            ..Wanted::new("lv_pressure")
        },
        Wanted {
            required: true,
            ..Wanted::new("volume")
        },
    ];
    let request = Request {
        file: path,
        wanted: &wanted,
        format: None,
        sheet: None,
        block: None,
    };
    let folder = path.parent().unwrap_or_else(|| Path::new("."));
    let mut beside = |name: &str| {
        input_files::read(&folder.join(name), MaxBytes::TRACE).map_err(|error| error.to_string())
    };
    let reading = read(bytes, &request, &mut beside);
    let errors: Vec<Problem> = reading
        .problems
        .into_iter()
        .filter(Problem::is_error)
        .collect();
    let Some(table) = reading.table else {
        return Err(NotUnderstood::Problems(errors));
    };
    let units = [("time", "ms"), ("lv_pressure", "mmHg"), ("volume", "mL")];
    let mut columns = Vec::new();
    for (quantity, unit) in units {
        let Some(values) = table.columns.get(quantity) else {
            let problem = Problem::error(
                path,
                format!("no column of the {}", word(quantity)),
                "columns of time, left-ventricular pressure and volume, with their units",
                "export them as a text table, in which columns may have any name",
            );
            return Err(problem.into());
        };
        columns.push(PlainColumn {
            number: columns.len() + 1,
            label: table.names.get(quantity).cloned().unwrap_or_default(),
            quantity: Some(quantity),
            unit: Some(unit.to_owned()),
            factor: Some(1.0),
            values: values.clone(),
        });
    }
    let said = table.said.join("; ");
    Ok(PlainTable { columns, said })
}

/// What to do with pressure and volume in two files.
const TWO_FILES: &str = "put both into one file with the columns time_ms,pressure_mmHg,volume_mL; or keep two files: \
    `cardiotwin init DIR` makes a cohort, and its folder patients/P001 takes them as pressure.csv \
    (time_ms,pressure_mmHg) and volume.csv (time_ms,volume_mL)";

fn word(quantity: &str) -> &'static str {
    match quantity {
        "time" => "time",
        "volume" => "volume",
        _ => "left ventricle's pressure",
    }
}

/// Chooses the columns: as the user says, by the names in the header, by the course of the numbers.
pub(super) fn choose(
    path: &Path,
    table: &PlainTable,
    choices: &Choices,
) -> Result<Chosen, NotUnderstood> {
    let columns = &table.columns;
    let mut taken: Vec<usize> = Vec::new();
    let mut named = |given: &Option<String>, option: &str, quantity: &str| {
        told(path, columns, given, option, quantity, &mut taken)
    };
    let mut pressure = named(&choices.pressure, "--pressure", "lv_pressure")?;
    let mut volume = named(&choices.volume, "--volume", "volume")?;
    let mut time = named(&choices.time, "--time", "time")?;
    let mut rest: Vec<&PlainColumn> = columns
        .iter()
        .filter(|column| column.quantity.is_none() && !taken.contains(&column.number))
        .collect();
    if time.is_none()
        && let Some(place) = rest.iter().position(|column| is_clock(&column.values))
    {
        time = Some(guessed(rest.remove(place), "since its values only grow"));
    }
    match (&pressure, &volume, &rest[..]) {
        (None, None, [a, b]) => {
            let (p, v) = by_sense(path, a, b)?;
            pressure = Some(guessed(p, "since the loop turns as a ventricle's does"));
            volume = Some(guessed(v, "since the loop turns as a ventricle's does"));
        }
        (Some(_), None, [one]) => volume = Some(guessed(one, "as the only other column")),
        (None, Some(_), [one]) => pressure = Some(guessed(one, "as the only other column")),
        _ => {}
    }
    let labels = || {
        let all: Vec<String> = columns.iter().map(|c| format!("`{}`", c.label)).collect();
        format!("columns {}", all.join(", "))
    };
    let lacking = |asks_for, what: &str| {
        if columns.len() < 2 + usize::from(time.is_some()) {
            let problem = Problem::error(
                path,
                format!("only {}", labels()),
                "a column of the pressure and one of the volume",
                TWO_FILES,
            );
            return problem.into();
        }
        question(
            path,
            asks_for,
            labels(),
            format!("a column of the {what} that its name tells"),
            format!("{}: which one is the {what}?", labels()),
            "COLUMN (its name or number)",
        )
    };
    let pressure =
        pressure.ok_or_else(|| lacking(AsksFor::Pressure, "left ventricle's pressure"))?;
    let volume = volume.ok_or_else(|| lacking(AsksFor::Volume, "left ventricle's volume"))?;
    let sense = sense(&pressure.column.values, &volume.column.values);
    if sense > SENSE {
        let problem = Problem::error(
            path,
            format!(
                "a loop of `{}` over `{}` that turns as if the ventricle were driven by its blood",
                pressure.column.label, volume.column.label
            ),
            "a high pressure while the volume falls",
            "are both swapped, or not of the same beats? --pressure COLUMN --volume COLUMN say which is which",
        );
        return Err(problem.into());
    }
    let read = [&Some(pressure.clone()), &Some(volume.clone()), &time];
    let read: Vec<usize> = read
        .into_iter()
        .flatten()
        .map(|choice| choice.column.number)
        .collect();
    let others = columns.iter().filter(|c| !read.contains(&c.number));
    Ok(Chosen {
        others: others.map(|c| c.label.clone()).collect(),
        time,
        pressure,
        volume,
    })
}

fn guessed(column: &PlainColumn, why: &str) -> Choice {
    Choice {
        column: column.clone(),
        learned: Learned::Guessed,
        why: why.to_owned(),
    }
}

/// The column that the user or the header names.
fn told(
    path: &Path,
    columns: &[PlainColumn],
    given: &Option<String>,
    option: &str,
    quantity: &str,
    taken: &mut Vec<usize>,
) -> Result<Option<Choice>, NotUnderstood> {
    let choice = |column: &PlainColumn, why: &str| Choice {
        column: column.clone(),
        learned: Learned::Told,
        why: why.to_owned(),
    };
    if let Some(name) = given {
        let number = name.parse::<usize>().ok();
        let is_it = |c: &&PlainColumn| c.label == *name || Some(c.number) == number;
        let Some(column) = columns.iter().find(is_it) else {
            let labels: Vec<&str> = columns.iter().map(|c| c.label.as_str()).collect();
            let remedy = match nearest(name, labels.iter().copied()) {
                Some(meant) => format!("did you mean {option} `{meant}`?"),
                None => "name one of the columns, or give its number from 1".to_owned(),
            };
            let problem = Problem::error(
                path,
                format!("no column `{name}` ({option})"),
                format!("one of `{}`", labels.join("`, `")),
                remedy,
            );
            return Err(problem.into());
        };
        taken.push(column.number);
        return Ok(Some(choice(column, "as stated")));
    }
    let found: Vec<&PlainColumn> = columns
        .iter()
        .filter(|c| c.quantity == Some(quantity) && !taken.contains(&c.number))
        .collect();
    match found[..] {
        [] => Ok(None),
        [column] => {
            taken.push(column.number);
            Ok(Some(choice(column, "by its name")))
        }
        [first, ..] if quantity == "time" => {
            taken.push(first.number);
            Ok(Some(choice(first, "the first of its name")))
        }
        _ => {
            let labels: Vec<&str> = found.iter().map(|c| c.label.as_str()).collect();
            let asks_for = if quantity == "volume" {
                AsksFor::Volume
            } else {
                AsksFor::Pressure
            };
            let columns = format!("columns `{}`", labels.join("`, `"));
            Err(question(
                path,
                asks_for,
                columns.clone(),
                format!("one column of the {}", word(quantity)),
                format!("{columns}: which one is it?"),
                "COLUMN (its name or number)",
            ))
        }
    }
}

/// Whether values only grow, as a clock's do.
fn is_clock(values: &[f64]) -> bool {
    values.windows(2).all(|w| w[1] > w[0])
}

/// Tells pressure from volume by the sense of their loop: a ventricle does work on its blood, so that
/// the pressure is high while the volume falls.
fn by_sense<'a>(
    path: &Path,
    a: &'a PlainColumn,
    b: &'a PlainColumn,
) -> Result<(&'a PlainColumn, &'a PlainColumn), NotUnderstood> {
    let sense = sense(&a.values, &b.values);
    if sense < -SENSE {
        return Ok((a, b));
    }
    if sense > SENSE {
        return Ok((b, a));
    }
    Err(question(
        path,
        AsksFor::Pressure,
        format!(
            "columns `{}` and `{}`, whose loop has no sense",
            a.label, b.label
        ),
        "a loop in which the pressure is high while the volume falls",
        format!("`{}` or `{}`: which one is the pressure?", a.label, b.label),
        "COLUMN (its name or number)",
    ))
}

/// Area of the loop, ∮ p dV, over that of its enclosing rectangle and over the number of beats.
/// Negative in a ventricle that does work.
fn sense(pressure: &[f64], volume: &[f64]) -> f64 {
    let both: Vec<(f64, f64)> = pressure
        .iter()
        .copied()
        .zip(volume.iter().copied())
        .filter(|(p, v)| p.is_finite() && v.is_finite())
        .collect();
    let Some(first) = both.first() else {
        return 0.0;
    };
    let next = both.iter().skip(1).chain([first]);
    let area: f64 = both
        .iter()
        .zip(next)
        .map(|(a, b)| 0.5 * (a.0 + b.0) * (b.1 - a.1))
        .sum();
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        high - low
    };
    let rectangle = range(&mut both.iter().map(|x| x.0)) * range(&mut both.iter().map(|x| x.1));
    // Each beat rises once; a column that is the volume rises as often.
    let n_beats = rises(pressure).len().max(1) as f64;
    let share = area / (rectangle * n_beats);
    if share.is_finite() { share } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A loop of `n` samples: columns of pressure and volume.
    fn beat(n: usize) -> Vec<(f64, f64)> {
        super::super::beat::tests::beat(n)
    }

    fn table_of(header: &str, row: impl Fn(usize, (f64, f64)) -> String) -> PlainTable {
        let rows: Vec<String> = beat(80)
            .into_iter()
            .enumerate()
            .map(|(i, pv)| row(i, pv))
            .collect();
        let text = format!("{header}{}\n", rows.join("\n"));
        plain::parse(text.as_bytes(), Path::new("own.csv")).unwrap()
    }

    fn of(table: &PlainTable, choices: &Choices) -> Result<[usize; 3], NotUnderstood> {
        choose(Path::new("own.csv"), table, choices).map(|chosen| {
            let time = chosen.time.map_or(0, |t| t.column.number);
            [
                time,
                chosen.pressure.column.number,
                chosen.volume.column.number,
            ]
        })
    }

    #[test]
    fn names_the_clock_and_the_sense_of_the_loop_tell_the_columns() {
        let none = Choices::default();
        let named = table_of("volume,x,LVP\n", |i, (p, v)| format!("{v},{i},{p}"));
        assert_eq!(of(&named, &none), Ok([2, 3, 1]));
        let bare = table_of("", |i, (p, v)| format!("{i};{p};{v}"));
        assert_eq!(of(&bare, &none), Ok([1, 2, 3]));
        let swapped = table_of("", |_, (p, v)| format!("{v};{p}"));
        assert_eq!(of(&swapped, &none), Ok([0, 2, 1]));
        let half = table_of("signal\tV\n", |_, (p, v)| format!("{p}\t{v}"));
        assert_eq!(of(&half, &none), Ok([0, 1, 2]));
    }

    #[test]
    fn what_the_numbers_do_not_tell_is_asked_for() {
        let none = Choices::default();
        let asked = |table: &PlainTable| match of(table, &none) {
            Err(NotUnderstood::Question(question)) => question.asks_for,
            other => panic!("{other:?}"),
        };
        let many = table_of("a;b;c\n", |_, (p, v)| format!("{p};{v};{p}"));
        assert_eq!(asked(&many), AsksFor::Pressure);
        let two = table_of("LVP;Plv;LVV\n", |_, (p, v)| format!("{p};{p};{v}"));
        assert_eq!(asked(&two), AsksFor::Pressure);
        let flat = table_of("a;b\n", |_, (p, _)| format!("{p};{p}"));
        assert_eq!(asked(&flat), AsksFor::Pressure);
        let stated = Choices {
            pressure: Some("1".into()),
            volume: Some("b".into()),
            ..Choices::default()
        };
        assert_eq!(of(&many, &stated), Ok([0, 1, 2]));
    }

    #[test]
    fn swapped_names_and_wrong_options_are_refused_with_a_remedy() {
        let told = |table: &PlainTable, choices: &Choices| match of(table, choices) {
            Err(NotUnderstood::Problems(problems)) => problems[0].clone(),
            other => panic!("{other:?}"),
        };
        let swapped = table_of("LVV,LVP\n", |_, (p, v)| format!("{p},{v}"));
        assert!(
            told(&swapped, &Choices::default())
                .remedy
                .contains("swapped")
        );
        let right = table_of("LVP,LVV\n", |_, (p, v)| format!("{p},{v}"));
        let near = Choices {
            pressure: Some("LPV".into()),
            ..Choices::default()
        };
        assert!(
            told(&right, &near)
                .remedy
                .contains("did you mean --pressure `LVP`?")
        );
        let one = table_of("LVP,x\n", |_, (p, _)| format!("{p},"));
        assert!(
            told(&one, &Choices::default())
                .found
                .starts_with("only columns `LVP`")
        );
    }
}
