//! The tables as CSV in tidy form: one row per quantity or member, shares as fractions, units in
//! the names.

use std::collections::BTreeSet;

use cardiotwin_schemas::robustness::{Moments, QuantitySpread, RobustnessResult, TableKind};

/// One row for each quantity of each table: its spread over samples, over seeds, and over the
/// inputs, next to the mean difference printed in the paper.
#[must_use]
pub fn tables_csv(result: &RobustnessResult) -> String {
    let mut out = Rows::new(&[
        "patient",
        "table",
        "paper_table",
        "members",
        "quantity",
        "original",
        "n",
        "n_missing",
        "mean",
        "SD",
        "min",
        "max",
        "difference_mean",
        "difference_SD",
        "difference_min",
        "difference_max",
        "spread",
        "input",
        "input_spread",
        "spread_over_input_spread",
        "paper_original",
        "paper_mean",
        "paper_SD",
        "paper_difference_mean_percent",
        "paper_difference_SD_percent",
        "paper_difference_max_percent",
    ]);
    for patient in &result.patients {
        let mut row = |table: &str, paper: Option<u32>, members: &str, q: &QuantitySpread| {
            let head = [
                patient.patient.to_string(),
                table.to_owned(),
                paper.map_or(String::new(), |p| p.to_string()),
            ];
            out.row(head.into_iter().chain([members.to_owned()]).chain(cells(q)));
        };
        patient
            .inputs
            .iter()
            .for_each(|q| row("inputs", None, "sample", q));
        for (members, tables) in [("sample", &patient.tables), ("seed", &patient.seed_tables)] {
            for table in tables {
                let paper = (members == "sample").then_some(table.paper_table);
                table
                    .quantities
                    .iter()
                    .for_each(|q| row(table.table.word(), paper, members, q));
            }
        }
    }
    out.text()
}

fn cells(q: &QuantitySpread) -> Vec<String> {
    let mut cells = vec![
        q.name.clone(),
        number(Some(q.original)),
        q.n.to_string(),
        q.n_missing.to_string(),
    ];
    cells.extend(moments(Some(&q.values)));
    cells.extend(moments(q.relative_differences.as_ref()));
    cells.push(number(q.spread));
    cells.push(
        q.amplification
            .as_ref()
            .map_or(String::new(), |a| a.input.clone()),
    );
    cells.push(number(q.amplification.as_ref().map(|a| a.input_spread)));
    cells.push(number(q.amplification.as_ref().map(|a| a.ratio)));
    let paper = q.paper.as_ref();
    let printed = paper.map(|p| {
        [
            p.original,
            p.mean,
            p.sd,
            p.mean_of_rel_diff_percent,
            p.sd_of_rel_diff_percent,
            p.max_of_rel_diff_percent,
        ]
    });
    match printed {
        Some(printed) => cells.extend(printed.map(|p| p.to_string())),
        None => cells.extend(vec![String::new(); 6]),
    }
    cells
}

/// One row for each personalisation: its inputs, state and results.
#[must_use]
pub fn members_csv(result: &RobustnessResult) -> String {
    let members = || {
        result
            .patients
            .iter()
            .flat_map(|p| p.members.iter().map(move |m| (&p.patient, m)))
    };
    let inputs: BTreeSet<&String> = members().flat_map(|(_, m)| m.inputs.keys()).collect();
    let results: BTreeSet<(TableKind, &String)> = members()
        .flat_map(|(_, m)| {
            m.values
                .iter()
                .flat_map(|(t, v)| v.keys().map(|name| (*t, name)))
        })
        .collect();
    let mut head: Vec<String> = [
        "patient",
        "member",
        "role",
        "state",
        "failure",
        "step1",
        "step1_iterations",
        "step1_cost",
        "step2_cost",
        "step2_evaluations",
        "verification_cost",
    ]
    .map(str::to_owned)
    .to_vec();
    head.extend(inputs.iter().map(|name| format!("input:{name}")));
    head.extend(
        results
            .iter()
            .map(|(table, name)| format!("{}:{name}", table.word())),
    );
    let mut out = Rows::new(&head);
    for (patient, m) in members() {
        let mut cells = vec![
            patient.to_string(),
            m.id.to_string(),
            m.role.word().to_owned(),
            m.state.to_string(),
            m.failure.clone().unwrap_or_default(),
            m.step1.clone().unwrap_or_default(),
            m.step1_iterations.to_string(),
            number(m.step1_cost),
            number(m.step2_cost),
            m.step2_evaluations.map_or(String::new(), |n| n.to_string()),
            number(m.verification_cost),
        ];
        cells.extend(
            inputs
                .iter()
                .map(|name| number(m.inputs.get(*name).copied())),
        );
        cells.extend(
            results
                .iter()
                .map(|(t, name)| number(m.values.get(t).and_then(|v| v.get(*name)).copied())),
        );
        out.row(cells);
    }
    out.text()
}

/// One row for each target and step: errors of the fits to perturbed and to measured values.
#[must_use]
pub fn targets_csv(result: &RobustnessResult) -> String {
    let mut head: Vec<String> = ["patient", "table", "biomarker", "error_original"]
        .map(str::to_owned)
        .to_vec();
    for to in ["to_perturbed", "to_measured"] {
        head.extend(["mean", "SD", "min", "max"].map(|m| format!("error_{to}_{m}")));
    }
    let mut out = Rows::new(&head);
    for patient in &result.patients {
        for e in &patient.target_errors {
            let head = [
                patient.patient.to_string(),
                e.table.word().to_owned(),
                e.biomarker.clone(),
                number(Some(e.original)),
            ];
            out.row(
                head.into_iter()
                    .chain(moments(Some(&e.to_perturbed)))
                    .chain(moments(Some(&e.to_measured))),
            );
        }
    }
    out.text()
}

fn moments(m: Option<&Moments>) -> [String; 4] {
    [
        m.map(|m| m.mean),
        m.and_then(|m| m.standard_deviation),
        m.map(|m| m.minimum),
        m.map(|m| m.maximum),
    ]
    .map(number)
}

/// A number with nine significant digits, because the last bits of a sum depend on the order of its
/// terms.
fn number(value: Option<f64>) -> String {
    let rounded = value
        .filter(|v| v.is_finite())
        .and_then(|v| format!("{v:.8e}").parse::<f64>().ok());
    rounded.map_or(String::new(), |v| v.to_string())
}

struct Rows(csv::Writer<Vec<u8>>);

impl Rows {
    fn new<T: AsRef<[u8]>>(head: &[T]) -> Self {
        let mut rows = Self(csv::WriterBuilder::new().from_writer(Vec::new()));
        rows.0.write_record(head).expect("memory takes any row");
        rows
    }

    fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.0
            .write_record(cells)
            .expect("every row has the header's width");
    }

    fn text(self) -> String {
        String::from_utf8(self.0.into_inner().expect("memory is flushed"))
            .expect("CSV of text is text")
    }
}
