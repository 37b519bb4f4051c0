//! Choice of the columns for the wanted quantities, with problems and decisions in words.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::headers::{KNOWN, Label, NoMatch, find};
use crate::wanted::Wanted;

/// Words before the list of a file's columns or signals that are not read.
pub const UNREAD: &str = "that are not read";

/// A column to read: its position in a line, its index in `wanted`, and its factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Column {
    pub(crate) place: usize,
    pub(crate) wanted: usize,
    pub(crate) factor: f64,
}

/// Columns with the choice in words.
#[derive(Debug, Default)]
pub(crate) struct Chosen {
    pub(crate) columns: Vec<Column>,
    pub(crate) said: Vec<String>,
    pub(crate) problems: Vec<Problem>,
}

/// A header whose columns are chosen.
pub(crate) struct Header<'a> {
    pub(crate) file: &'a Path,
    /// Line of the header; `None` in a binary file.
    pub(crate) line: Option<usize>,
    pub(crate) labels: &'a [Label],
    /// Whether columns that are not read get a warning; formats with columns of their own only
    /// report them.
    pub(crate) warn_of_others: bool,
}

impl Header<'_> {
    /// Chooses a column for each wanted quantity that the file has.
    pub(crate) fn choose(&self, wanted: &[Wanted]) -> Chosen {
        let mut chosen = Chosen::default();
        for (idx, one) in wanted.iter().enumerate() {
            self.one(idx, one, &mut chosen);
        }
        let read: Vec<usize> = chosen.columns.iter().map(|c| c.place).collect();
        let others: Vec<&str> = (0..self.labels.len())
            .filter(|place| !read.contains(place))
            .map(|place| self.labels[place].full.as_str())
            .filter(|full| !full.is_empty())
            .collect();
        if !others.is_empty() {
            let list = others.join("`, `");
            if self.warn_of_others {
                let all: Vec<String> = wanted.iter().map(names_of).collect();
                let problem = Problem::warning(
                    self.file,
                    format!("columns {UNREAD}: `{list}`"),
                    all.join("; "),
                    "remove them, or say in prepare.toml what they are, if they should be read",
                );
                self.add(problem, &mut chosen);
            } else {
                chosen.said.push(format!("columns {UNREAD}: `{list}`"));
            }
        }
        chosen
    }

    fn add(&self, problem: Problem, chosen: &mut Chosen) {
        chosen.problems.push(Problem {
            line: self.line,
            ..problem
        });
    }

    fn one(&self, idx: usize, wanted: &Wanted, chosen: &mut Chosen) {
        let found: Vec<(usize, f64)> = self
            .labels
            .iter()
            .enumerate()
            .filter_map(|(place, label)| {
                let named =
                    |known: &str| known == label.full || (wanted.given && known == label.name);
                let (_, factor) = wanted.names.iter().find(|(known, _)| named(known))?;
                Some((place, *factor))
            })
            .collect();
        let key = wanted
            .names
            .first()
            .map_or(wanted.quantity, |(name, _)| name.as_str())
            .to_owned();
        match found[..] {
            [(place, factor)] => {
                if wanted.given {
                    self.same_unit(wanted, place, factor, &key, chosen);
                }
                self.say(wanted, place, chosen);
                chosen.columns.push(Column {
                    place,
                    wanted: idx,
                    factor,
                });
            }
            [] if !wanted.given => self.by_known_names(idx, wanted, key, chosen),
            [] => self.lacking(wanted, key, chosen),
            _ => {
                let problem = Problem::error(
                    self.file,
                    format!("{} columns of it", found.len()),
                    format!("one column {}", names_of(wanted)),
                    "remove or rename the others",
                );
                self.add(problem.at_key(key), chosen);
            }
        }
    }

    /// An error where prepare.toml reads a column in another unit than its header states.
    fn same_unit(
        &self,
        wanted: &Wanted,
        place: usize,
        factor: f64,
        key: &str,
        chosen: &mut Chosen,
    ) {
        let known = KNOWN.iter().find(|known| known.quantity == wanted.quantity);
        let label = &self.labels[place];
        let (Some(known), Some(unit)) = (known, &label.unit) else {
            return;
        };
        let stated = known.dimension.factor(unit);
        if stated.is_some_and(|stated| (stated / factor - 1.0).abs() > 1e-6) {
            let problem = Problem::error(
                self.file,
                format!("column `{}` in {unit}", label.full),
                format!("the unit of {}", names_of(wanted)),
                "use the key in the columns of prepare.toml ([catheter.columns], [cine.columns]) that has the column's unit",
            );
            self.add(problem.at_key(key), chosen);
        }
    }

    fn say(&self, wanted: &Wanted, place: usize, chosen: &mut Chosen) {
        let full = &self.labels[place].full;
        if !wanted.names.iter().any(|(name, _)| name == full) || wanted.given {
            chosen
                .said
                .push(format!("{} from column `{full}`", words(wanted.quantity)));
        }
    }

    fn by_known_names(&self, idx: usize, wanted: &Wanted, key: String, chosen: &mut Chosen) {
        let name = |place: usize| self.labels[place].full.as_str();
        let remedy = format!(
            "write the unit into the header, or name the column in prepare.toml: {key} = \"NAME\" \
             in [catheter.columns] or [cine.columns]"
        );
        match find(self.labels, wanted) {
            Ok(found) => {
                if found.by_kind {
                    let problem = Problem::warning(
                        self.file,
                        format!(
                            "column `{}`, taken for the {}, since it is the only one of its kind",
                            name(found.place),
                            words(wanted.quantity)
                        ),
                        "a name that tells the quantity",
                        "name the column in prepare.toml, in [catheter.columns] or [cine.columns]",
                    );
                    self.add(problem.at_key(key), chosen);
                }
                self.say(wanted, found.place, chosen);
                if found.others > 0
                    && let Some(said) = chosen.said.last_mut()
                {
                    said.push_str(&format!(", the first of {}", found.others + 1));
                }
                chosen.columns.push(Column {
                    place: found.place,
                    wanted: idx,
                    factor: found.factor,
                });
            }
            Err(NoMatch::None) => self.lacking(wanted, key, chosen),
            Err(NoMatch::Several(places)) => {
                let names: Vec<&str> = places.iter().map(|place| name(*place)).collect();
                let problem = Problem::error(
                    self.file,
                    format!("columns `{}`", names.join("`, `")),
                    format!("one column of the {}", words(wanted.quantity)),
                    format!(
                        "say which one it is in prepare.toml: {key} = \"NAME\" in [catheter.columns] or [cine.columns]"
                    ),
                );
                self.add(problem.at_key(key), chosen);
            }
            Err(NoMatch::NoUnit(place)) => {
                let problem = Problem::error(
                    self.file,
                    format!("column `{}` without a unit", name(place)),
                    format!("a column {}", names_of(wanted)),
                    remedy,
                );
                self.add(problem.at_key(key), chosen);
            }
            Err(NoMatch::OtherUnit(place, kind)) => {
                let problem = Problem::error(
                    self.file,
                    format!("column `{}`", name(place)),
                    format!("the unit of {kind}, as in {}", names_of(wanted)),
                    "export the calibrated channel, or name another column in [catheter.columns] or [cine.columns] of \
                     prepare.toml",
                );
                self.add(problem.at_key(key), chosen);
            }
        }
    }

    fn lacking(&self, wanted: &Wanted, key: String, chosen: &mut Chosen) {
        let alike = self
            .labels
            .iter()
            .map(|label| label.full.as_str())
            .find(|name| {
                name.to_lowercase()
                    .starts_with(wanted.quantity.split('_').next().unwrap_or_default())
            });
        // A column with the name of a quantity and without a unit must not be ignored silently.
        let without_unit = self
            .labels
            .iter()
            .any(|label| label.full.to_lowercase().starts_with(wanted.quantity));
        if !wanted.required && !without_unit {
            return;
        }
        let found = alike.map_or_else(
            || {
                let names: Vec<&str> = self.labels.iter().map(|l| l.full.as_str()).collect();
                format!("`{}`", names.join(","))
            },
            |name| format!("column `{name}`"),
        );
        let problem = Problem::error(
            self.file,
            found,
            format!("a column {}", names_of(wanted)),
            "name the column so, or say in prepare.toml which column it is; the name carries the \
             unit",
        );
        self.add(problem.at_key(key), chosen);
    }
}

/// Accepted names of a quantity.
pub(crate) fn names_of(wanted: &Wanted) -> String {
    let names: Vec<String> = wanted
        .names
        .iter()
        .map(|(name, _)| format!("`{name}`"))
        .collect();
    names.join(" or ")
}

fn words(quantity: &str) -> &str {
    match quantity {
        "lv_pressure" => "left-ventricular pressure",
        "aortic_pressure" => "aortic pressure",
        "ecg" => "electrocardiogram",
        other => other,
    }
}
