//! Compares step 2's strategies on the same targets and seeds: cost reached, computing time, and
//! scatter of the fitted parameters.

use std::collections::BTreeMap;
use std::time::Instant;

use cardiotwin_calibrate::statistics::{median, standard_deviation};
use cardiotwin_schemas::biomarkers::CellBiomarkers;
use cardiotwin_schemas::settings::{CellFitSettings, Strategy};
use cardiotwin_schemas::task::CellFitSpec;
use serde::{Deserialize, Serialize};

use super::processor;
use cardiotwin_worker::error::TaskError;
use cardiotwin_worker::tasks::cell_fit;

/// Targets of one fit.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Case {
    /// Name of the subject.
    pub name: String,
    /// Cycle length at which the cell is paced \[ms\].
    pub cycle_length_ms: f64,
    /// Initial stretch of the fibre.
    pub lambda_0: f64,
    /// Biomarkers that the fit should reach.
    pub targets: CellBiomarkers,
    /// Cost that SciPy's differential evolution reached with an independent implementation of the
    /// cell, where known.
    pub reference_cost: Option<f64>,
}

/// Result of one strategy on one case, over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub case: String,
    /// Strategy of the fits.
    pub strategy: Strategy,
    /// Median of the reached costs.
    pub median_cost: f64,
    /// Largest of the reached costs.
    pub worst_cost: f64,
    /// Cost that SciPy's differential evolution reached with an independent implementation of the
    /// cell, where known.
    pub reference_cost: Option<f64>,
    /// Median number of cell evaluations.
    pub median_evaluations: f64,
    /// Median wall time on one thread.
    pub median_s: f64,
    /// Standard deviation of each parameter over the seeds, % of the interval between its bounds.
    pub spread_percent: BTreeMap<String, f64>,
}

/// Results of all strategies on all cases.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Number of seeds behind each row.
    pub seeds: u64,
    /// Model name of the processor.
    pub processor: String,
    /// One row for each case and strategy.
    pub rows: Vec<Row>,
}

#[derive(Deserialize)]
struct Cases {
    cases: Vec<Case>,
}

/// The bundled cases.
///
/// # Panics
/// Never in practice: a test checks the bundled data.
#[must_use]
pub fn cases() -> Vec<Case> {
    let file: Cases = serde_json::from_str(include_str!("../../data/step2-targets.json"))
        .expect("the data are sound");
    file.cases
}

impl Case {
    /// Specification of this case's fit.
    #[must_use]
    pub fn spec(&self, settings: CellFitSettings) -> CellFitSpec {
        CellFitSpec {
            cycle_length_ms: self.cycle_length_ms,
            lambda_0: self.lambda_0,
            lambda_max: self.lambda_0,
            targets: self.targets,
            seed: settings.seed,
            settings,
            fixed: BTreeMap::new(),
            calcium: None,
        }
    }
}

/// Runs all strategies on all cases with seeds 1 to `seeds`, without profiles.
///
/// # Errors
/// [`TaskError`] when a fit fails.
pub fn strategies(seeds: u64, mut done: impl FnMut(&Row)) -> Result<Comparison, TaskError> {
    let mut rows = Vec::new();
    for case in cases() {
        for strategy in [Strategy::DifferentialEvolution, Strategy::CmaEs] {
            let row = row(&case, strategy, seeds)?;
            done(&row);
            rows.push(row);
        }
    }
    Ok(Comparison {
        seeds,
        processor: processor(),
        rows,
    })
}

fn row(case: &Case, strategy: Strategy, seeds: u64) -> Result<Row, TaskError> {
    let (mut costs, mut evaluations, mut seconds, mut sets) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let begin = Instant::now();
        let found = cell_fit::search_alone(&case.spec(CellFitSettings {
            seed,
            strategy,
            ..CellFitSettings::default()
        }))?;
        seconds.push(begin.elapsed().as_secs_f64());
        costs.push(found.cost);
        evaluations.push(found.evaluations as f64);
        sets.push(found.parameters);
    }
    let settings = CellFitSettings::default();
    let spread = |(p, name): (usize, &String)| {
        let values: Vec<f64> = sets.iter().map(|set| set[p]).collect();
        let [lower, upper] = settings.bounds[name];
        let spread = if values.len() > 1 {
            standard_deviation(&values)
        } else {
            0.0
        };
        (name.clone(), 100.0 * spread / (upper - lower))
    };
    Ok(Row {
        case: case.name.clone(),
        strategy,
        median_cost: median(&costs),
        worst_cost: costs.iter().copied().fold(0.0, f64::max),
        reference_cost: case.reference_cost,
        median_evaluations: median(&evaluations),
        median_s: median(&seconds),
        spread_percent: settings.parameters.iter().enumerate().map(spread).collect(),
    })
}

impl Comparison {
    /// The comparison as a Markdown table.
    #[must_use]
    pub fn table(&self) -> String {
        let heading = format!(
            "{} seeds each, one thread, {}\n",
            self.seeds, self.processor
        );
        let mut text =
            heading + "| targets | strategy | cost median | worst | reference | evaluations | s |";
        let names: Vec<&String> = self
            .rows
            .first()
            .map_or_else(Vec::new, |row| row.spread_percent.keys().collect());
        names
            .iter()
            .for_each(|name| text.push_str(&format!(" {name} % |")));
        text.push('\n');
        text.push_str(&"| --- ".repeat(7 + names.len()));
        text.push_str("|\n");
        for row in &self.rows {
            let strategy = serde_json::to_value(row.strategy).unwrap_or_default();
            text.push_str(&format!(
                "| {} | {} | {:.4} | {:.4} | {} | {:.0} | {:.2} |",
                row.case,
                strategy.as_str().unwrap_or_default(),
                row.median_cost,
                row.worst_cost,
                row.reference_cost
                    .map_or_else(String::new, |cost| cost.to_string()),
                row.median_evaluations,
                row.median_s
            ));
            row.spread_percent
                .values()
                .for_each(|spread| text.push_str(&format!(" {spread:.1} |")));
            text.push('\n');
        }
        text
    }
}
