//! `cardiotwin jobs`: what a run's jobs cost, by job or by patient.

use std::collections::{BTreeMap, HashMap};

use cardiotwin_engine::{ElementCost, JobCosts, JobUsage, Reader, usage_of};
use cardiotwin_report::table::{Cell, Column, Digits, Kind, Table, cells};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::status::JobState;
use clap::Args;
use serde::Serialize;

use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::table;
use crate::talk::Talk;

const JOULES_PER_KWH: f64 = 3.6e6;

/// Show what a run's jobs on a cluster cost: waiting, node-hours, efficiency, energy
#[derive(Debug, Args)]
#[command(
    after_help = "Efficiency is processor time over the time of all processors that the job had, as of `seff`; energy \
                  is what the site measures. Both come from `sacct`, and are empty where it does not answer."
)]
pub struct JobsArgs {
    #[command(flatten)]
    place: Place,
    /// One line for each patient; a job with several patients counts for each by its share
    #[arg(long)]
    by_patient: bool,
    /// Do not ask Slurm's accounting: no efficiency, no energy
    #[arg(long)]
    no_accounting: bool,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    /// Why efficiency and energy are missing; null where the accounting answered.
    no_accounting: Option<&'a str>,
    jobs: &'a Table,
}

/// Reads the jobs of the run and prints the table.
///
/// # Errors
/// [`CliError::Usage`] for a run without jobs; errors of the store.
pub async fn execute(args: &JobsArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    folders.refuse_sweep("`cardiotwin sweep status --out DIR` shows its progress")?;
    access::as_of_run(&folders.run);
    let costs = Reader::open(&folders.run).await?.job_costs().await?;
    let Some(costs) = costs.filter(|costs| !costs.elements.is_empty()) else {
        return Err(CliError::Usage(format!(
            "{} has no jobs: it ran on this machine only; `cardiotwin show PATIENT` has the time of its tasks",
            folders.run.display()
        )));
    };
    let (usage, silent) = match args.no_accounting {
        true => (HashMap::new(), Some("not asked".to_owned())),
        false => match usage_of(&costs).await {
            Ok(usage) => (usage, None),
            Err(why) => (HashMap::new(), Some(why.to_string())),
        },
    };
    let table = match args.by_patient {
        true => by_patient(&costs, &usage),
        false => by_job(&costs, &usage),
    };
    if args.json {
        talk.json(&Answer {
            schema_version: formats::JOB_COSTS.version,
            no_accounting: silent.as_deref(),
            jobs: &table,
        })?;
    } else {
        talk.data(&table::text(&table, talk))?;
        if let Some(why) = silent.filter(|_| !args.no_accounting) {
            talk.say(&format!("no efficiency and energy: {why}"));
        }
    }
    Ok(Exit::Ok)
}

/// Columns that both tables share.
fn cost_columns(costs: &JobCosts) -> [Column; 6] {
    let charge = match costs.charge_unit.is_empty() {
        true => Column::new("charge", Kind::Data),
        false => Column::fixed("charge", 3).label(format!("charge {}", costs.charge_unit)),
    };
    [
        Column::numbers("waited_s")
            .label("waited")
            .digits(Digits::Duration),
        Column::numbers("ran_s")
            .label("ran")
            .digits(Digits::Duration),
        Column::fixed("node_hours", 3).label("node-hours"),
        charge,
        Column::numbers("efficiency")
            .unit("%")
            .digits(Digits::Share),
        Column::fixed("energy_kWh", 3).label("energy").unit("kWh"),
    ]
}

fn by_job(costs: &JobCosts, usage: &HashMap<String, JobUsage>) -> Table {
    let mut columns = vec![
        Column::words("job"),
        Column::words("queue"),
        Column::words("state"),
        Column::numbers("nodes"),
        Column::words("patients"),
    ];
    columns.extend(cost_columns(costs));
    let mut table = Table::new("jobs", "", columns);
    let whole = |elements: &[ElementCost]| {
        Sum::of(elements.iter().map(|one| (one, 1.0)), usage).cells(costs)
    };
    for one in &costs.elements {
        let mut row = cells![
            one.id.as_str(),
            one.queue.as_str(),
            one.state.as_str(),
            one.nodes,
            one.patients.join(" ")
        ];
        row.extend(whole(std::slice::from_ref(one)));
        table.rows.push(row);
    }
    let mut all = cells!["all", "", "", "", ""];
    all.extend(whole(&costs.elements));
    table.foot = vec![all];
    without_energy(table)
}

fn by_patient(costs: &JobCosts, usage: &HashMap<String, JobUsage>) -> Table {
    let mut columns = vec![
        Column::words("patient"),
        Column::numbers("jobs"),
        Column::numbers("running"),
    ];
    columns.extend(cost_columns(costs));
    let mut table = Table::new("jobs-by-patient", "", columns);
    let mut of_patients: BTreeMap<&str, Vec<(&ElementCost, f64)>> = BTreeMap::new();
    for one in &costs.elements {
        let share = 1.0 / one.patients.len().max(1) as f64;
        for patient in &one.patients {
            of_patients.entry(patient).or_default().push((one, share));
        }
    }
    for (patient, elements) in of_patients {
        let sum = Sum::of(elements.iter().copied(), usage);
        let running = elements
            .iter()
            .filter(|(one, _)| one.state == JobState::Running);
        let mut row = cells![patient, elements.len(), running.count()];
        row.extend(sum.cells(costs));
        table.rows.push(row);
    }
    without_energy(table)
}

/// Sums over elements, of which only a share of the node-hours may count.
struct Sum {
    waited_s: Option<f64>,
    ran_s: Option<f64>,
    node_hours: f64,
    /// Use of those whose use is known.
    used: Option<JobUsage>,
}

impl Sum {
    fn of<'a>(
        elements: impl Iterator<Item = (&'a ElementCost, f64)> + Clone,
        usage: &HashMap<String, JobUsage>,
    ) -> Self {
        let known = |value: fn(&ElementCost) -> Option<f64>| {
            let known = elements.clone().filter_map(|(one, _)| value(one));
            known.fold(None, |sum: Option<f64>, one| Some(sum.unwrap_or(0.0) + one))
        };
        let used = elements.clone().filter_map(|(one, share)| {
            let used = usage.get(&one.id)?;
            Some(JobUsage {
                processor_s: share * used.processor_s,
                available_s: share * used.available_s,
                energy_j: used.energy_j.map(|j| share * j),
            })
        });
        Self {
            waited_s: known(|one| one.waited_s),
            ran_s: known(|one| one.ran_s),
            node_hours: elements
                .clone()
                .map(|(one, share)| share * one.node_hours())
                .sum(),
            used: used.reduce(|all, one| all.and(&one)),
        }
    }

    /// Cells of [`cost_columns`].
    fn cells(&self, costs: &JobCosts) -> Vec<Cell> {
        let energy_j = self.used.and_then(|used| used.energy_j);
        cells![
            self.waited_s,
            self.ran_s,
            self.node_hours,
            self.node_hours * costs.charge_per_node_hour,
            self.used.and_then(|used| used.efficiency()),
            energy_j.map(|j| j / JOULES_PER_KWH)
        ]
    }
}

/// The table without the energy of a site that does not measure it.
fn without_energy(table: Table) -> Table {
    let is_known = table.values("energy_kWh").any(|value| !value.is_null());
    table.without(|column| column.key == "energy_kWh" && !is_known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::talk::ColourChoice;

    fn element(id: &str, patients: &[&str], ran_s: Option<f64>) -> ElementCost {
        ElementCost {
            id: id.to_owned(),
            name: "ct-a".to_owned(),
            queue: "standard".to_owned(),
            state: match ran_s {
                Some(_) => JobState::Over,
                None => JobState::Waiting,
            },
            nodes: 2.0,
            patients: patients.iter().map(|&p| p.to_owned()).collect(),
            intended_ms: 0,
            waited_s: ran_s.map(|_| 90.0),
            ran_s,
        }
    }

    fn costs() -> JobCosts {
        JobCosts {
            elements: vec![
                element("42_0", &["A", "B"], Some(3600.0)),
                element("42_1", &["B"], Some(1800.0)),
                element("43", &["A"], None),
            ],
            charge_per_node_hour: 1.5,
            charge_unit: "CU".to_owned(),
        }
    }

    fn usage() -> HashMap<String, JobUsage> {
        let used = |processor_s, available_s| JobUsage {
            processor_s,
            available_s,
            energy_j: Some(7.2e6),
        };
        HashMap::from([
            ("42_0".to_owned(), used(60.0, 100.0)),
            ("42_1".to_owned(), used(20.0, 50.0)),
        ])
    }

    #[test]
    fn jobs_have_their_costs_and_sums() {
        let talk = Talk::new(ColourChoice::Never, true);
        insta::assert_snapshot!(table::text(&by_job(&costs(), &usage()), &talk));
        insta::assert_snapshot!(table::text(&by_job(&costs(), &HashMap::new()), &talk));
    }

    #[test]
    fn patients_share_a_job_and_all_shares_are_the_whole() {
        let table = by_patient(&costs(), &usage());
        insta::assert_snapshot!(table::text(&table, &Talk::new(ColourChoice::Never, true)));
        let sum = |key: &str| table.values(key).filter_map(|v| v.as_f64()).sum::<f64>();
        assert!((sum("node_hours") - 3.0).abs() < 1e-12);
        assert!((sum("energy_kWh") - 4.0).abs() < 1e-12);
    }
}
