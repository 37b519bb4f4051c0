//! What `cardiotwin init --from` says: a table of what was understood, one of what is estimated and
//! how much that matters, and the next command.

use std::path::{Path, PathBuf};

use cardiotwin_input::own_traces::{Fact, Origin};
use cardiotwin_schemas::formats::OWN_TRACES;
use cardiotwin_schemas::preparation::StepDone;
use serde::Serialize;

use super::twin::{Change, SHARE, Twin, Weighed};
use crate::error::CliError;
use crate::table::{Columns, number, percent};
use crate::talk::{Talk, Tone};

/// Width of the column that tells what a value comes from, characters.
const WIDTH: usize = 56;

/// A patient that was made.
#[derive(Debug, Serialize)]
pub struct NewPatient {
    /// Pseudonym of the patient.
    pub id: String,
    /// Folder of the patient.
    pub folder: PathBuf,
    /// Files that were read.
    pub files: Vec<String>,
    /// What was understood of a table of traces.
    #[serde(rename = "understood", serialize_with = "facts")]
    pub facts: Vec<Fact>,
    /// Steps of the preparation.
    pub steps: Vec<StepDone>,
    /// Columns that were not read.
    pub others: Vec<String>,
    /// Points to check.
    pub warnings: Vec<String>,
    /// The reduced twin of step 1.
    pub twin: Option<Twin>,
    /// Picture of what was understood.
    pub picture: Option<PathBuf>,
    /// Page of the preparation.
    pub page: PathBuf,
}

fn facts<S: serde::Serializer>(facts: &[Fact], to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Row<'a> {
        quantity: &'a str,
        value: &'a str,
        origin: &'a str,
        from: &'a str,
    }
    to.collect_seq(facts.iter().map(|fact| Row {
        quantity: fact.quantity,
        value: &fact.value,
        origin: fact.origin.word(),
        from: &fact.from,
    }))
}

/// All that is said.
#[derive(Debug, Serialize)]
pub struct Answer {
    schema_version: u32,
    cohort: String,
    folder: PathBuf,
    /// Share by which each estimate was changed.
    changed_by: f64,
    /// Patients in the order of their names.
    pub patients: Vec<NewPatient>,
}

impl Answer {
    /// An answer without patients.
    pub fn new(folder: &Path, name: &str) -> Self {
        Self {
            schema_version: OWN_TRACES.version,
            cohort: name.to_owned(),
            folder: folder.to_owned(),
            changed_by: SHARE,
            patients: Vec::new(),
        }
    }

    /// Pictures of all patients.
    pub fn pictures(&self) -> impl Iterator<Item = &Path> {
        self.patients
            .iter()
            .filter_map(|patient| patient.picture.as_deref())
    }

    /// Prints tables or JSON, and the next command.
    ///
    /// # Errors
    /// Stdout cannot be written.
    pub fn tell(&self, json: bool, talk: &Talk) -> Result<(), CliError> {
        if json {
            return talk.json(self);
        }
        for patient in &self.patients {
            talk.data(&patient.text(talk))?;
        }
        talk.hint(&format!(
            "`cardiotwin run {}` makes the twin",
            self.folder.display()
        ));
        Ok(())
    }
}

impl NewPatient {
    fn text(&self, talk: &Talk) -> String {
        let mut text = format!("{} from {}\n\n", self.id, self.files.join(", "));
        if self.facts.is_empty() {
            let mut table = Columns::new(talk, &["STEP", "STATE", "WHAT"]);
            for step in &self.steps {
                table.row([&step.step, step.state.word(), &step.what]);
            }
            text.push_str(&table.text());
        } else {
            text.push_str(&understood(&self.facts, self.twin.as_ref(), talk));
        }
        if !self.others.is_empty() {
            text.push_str(&format!(
                "columns that are not read: {}\n",
                self.others.join(", ")
            ));
        }
        for warning in &self.warnings {
            text.push_str(&format!("warning: {warning}\n"));
        }
        if let Some(twin) = &self.twin {
            text.push_str(&matters(twin, talk));
        }
        if let Some(picture) = &self.picture {
            text.push_str(&format!("\npicture: {}\n", picture.display()));
        }
        text.push_str(&format!("steps: {}\n\n", self.page.display()));
        text
    }
}

/// Name and unit for a key of the patient's file.
fn name(key: &str) -> (&str, &str) {
    match key {
        "anatomy.wall_volume_mL" => ("wall volume", "mL"),
        "afterload.characteristic_resistance_mmHg_s_per_mL" => ("afterload R1", "mmHg s/mL"),
        "afterload.peripheral_resistance_mmHg_s_per_mL" => ("afterload R2", "mmHg s/mL"),
        "afterload.compliance_mL_per_mmHg" => ("afterload C", "mL/mmHg"),
        "preload.left_atrial_pressure_mmHg" => ("filling pressure", "mmHg"),
        "solver.activation.onset_ms" => ("first activation", "ms"),
        other => (other, ""),
    }
}

/// The table of all quantities: measured, assumed, estimated.
fn understood(facts: &[Fact], twin: Option<&Twin>, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["QUANTITY", "VALUE", "HOW", "FROM WHAT"]);
    for fact in facts {
        let tone = match fact.origin {
            Origin::Measured => Tone::Good,
            Origin::Assumed => Tone::Doubtful,
        };
        let first = (fact.quantity, fact.value.as_str());
        rows(&mut table, first, (fact.origin.word(), tone), &fact.from);
    }
    let mut before = "";
    for estimate in twin.iter().flat_map(|twin| &twin.estimates) {
        let (name, unit) = name(&estimate.key);
        let method = estimate
            .method
            .strip_prefix("estimated: ")
            .unwrap_or(&estimate.method);
        // The three numbers of a load have one method.
        let from = if method == before { "as above" } else { method };
        before = method;
        let value = format!("{} {unit}", number(estimate.value));
        rows(
            &mut table,
            (name, &value),
            ("estimated", Tone::Doubtful),
            from,
        );
    }
    table.text()
}

/// A quantity as a row, with further rows for a long last column.
fn rows(
    table: &mut Columns,
    (quantity, value): (&str, &str),
    (how, tone): (&str, Tone),
    from: &str,
) {
    let mut lines = vec![String::new()];
    for word in from.split(' ') {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > WIDTH {
            lines.push(word.to_owned());
            continue;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    let mut first = Some([(quantity, None), (value, None), (how, Some(tone))]);
    for line in lines {
        let cells = first.take().unwrap_or([("", None); 3]);
        let cells = cells.map(|(text, tone)| (text.to_owned(), tone));
        table.toned(cells.into_iter().chain([(line, None)]));
    }
}

/// How well the twin fits, and what an error of each estimate does to it.
fn matters(twin: &Twin, talk: &Talk) -> String {
    let fit = if twin.converged {
        "fits"
    } else {
        "does not fit yet"
    };
    let mut text = format!(
        "\nThe reduced ventricle {fit} after {} beats of step 1 (cost {:.3}).\n",
        twin.beats, twin.cost
    );
    let weighed: Vec<&Weighed> = twin
        .estimates
        .iter()
        .filter(|one| one.if_smaller.is_some() || one.if_larger.is_some())
        .collect();
    if weighed.is_empty() {
        return text;
    }
    let share = 100.0 * SHARE;
    text.push_str(&format!(
        "If an estimate is {share:.0} % off, its steady beats change by:\n"
    ));
    let less = format!("{share:.0} % LESS:");
    let more = format!("{share:.0} % MORE:");
    let mut table = Columns::new(
        talk,
        &[
            "ESTIMATED",
            &format!(">{less} SV"),
            ">P_MAX",
            &format!(">{more} SV"),
            ">P_MAX",
        ],
    );
    for one in weighed {
        let cells = |change: Option<Change>| {
            [
                percent(change.map(|c| c.stroke_volume)),
                percent(change.map(|c| c.largest_pressure)),
            ]
        };
        let [a, b] = cells(one.if_smaller);
        let [c, d] = cells(one.if_larger);
        table.row([name(&one.key).0.to_owned(), a, b, c, d]);
    }
    text.push_str(&table.text());
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Talk = Talk {
        colour_out: false,
        colour_err: false,
        quiet: true,
        bars: false,
    };

    #[test]
    fn tables_tell_measured_assumed_and_estimated_apart() {
        let change = |stroke_volume, largest_pressure| {
            Some(Change {
                stroke_volume,
                largest_pressure,
            })
        };
        let patient = NewPatient {
            id: "P001".into(),
            folder: "c/patients/P001".into(),
            files: vec!["own.csv".into()],
            facts: vec![
                Fact {
                    quantity: "pressure",
                    value: "5.1 to 118.0 mmHg".into(),
                    origin: Origin::Measured,
                    from: "column `LVP (mmHg)`".into(),
                },
                Fact {
                    quantity: "volume",
                    value: "55.0 to 120.0 mL".into(),
                    origin: Origin::Assumed,
                    from: "column `V`, mL by its size".into(),
                },
            ],
            steps: Vec::new(),
            others: vec!["ECG".into()],
            warnings: vec!["the mean covers only 2 beats".into()],
            twin: Some(Twin {
                cost: 0.0123,
                converged: true,
                beats: 4,
                estimates: vec![
                    Weighed {
                        key: "anatomy.wall_volume_mL".into(),
                        value: 90.0,
                        method: "0.75 of the end-diastolic volume".into(),
                        if_smaller: change(-0.041, -0.062),
                        if_larger: change(0.031, 0.05),
                    },
                    Weighed {
                        key: "solver.activation.onset_ms".into(),
                        value: 12.0,
                        method: "from the upstroke".into(),
                        if_smaller: None,
                        if_larger: None,
                    },
                ],
            }),
            picture: Some("c/patients/P001/prepared/understood.svg".into()),
            page: "c/patients/P001/prepared/prepare.html".into(),
        };
        insta::assert_snapshot!(patient.text(&QUIET));
        let mut answer = Answer::new(Path::new("c"), "c");
        answer.patients.push(patient);
        let json = serde_json::to_value(&answer).unwrap();
        assert_eq!(json["patients"][0]["understood"][1]["origin"], "assumed");
        assert_eq!(
            json["patients"][0]["twin"]["estimates"][0]["if_larger"]["stroke_volume"],
            0.031
        );
    }
}
