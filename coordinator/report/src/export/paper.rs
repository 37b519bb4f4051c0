//! The paper's Tables 1, 2, A6 and A7 (Jung et al. 2022) for this cohort. The paper's LFM is step 1
//! and its HFM step 2. Columns that the paper lacks come last.

use std::collections::BTreeSet;

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::cell::TABLE_A7;
use cardiotwin_schemas::organ::VALVE_PARAMETERS;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use serde_json::{Value, json};

use super::table::{Row, Table, number};
use crate::results::model::Model;
use crate::results::tables::biomarkers;
use crate::results::twin::moved_in_the_organ;
use crate::results::{MeanSd, PatientView, Step};

fn rows(run: &RunRecord, values: impl Fn(PatientView) -> Vec<Value>) -> Vec<Row> {
    let row = |p: &PatientRecord| Row {
        patient: p.plan.id.to_string(),
        kind: None,
        values: values(PatientView(p)),
    };
    run.patients.iter().map(row).collect()
}

fn names(columns: &[&str]) -> Vec<String> {
    columns.iter().map(|c| (*c).to_owned()).collect()
}

fn integer(value: Option<u64>) -> Value {
    value.map_or(Value::Null, |v| json!(v))
}

/// Mesh, cycle length, times and iterations.
pub fn table_1(run: &RunRecord) -> Table {
    Table {
        name: "table_1",
        caption: "Mesh, times, numbers of iterations (step 1) and of cell evaluations (step 2), model",
        columns: names(&[
            "nodes",
            "elements",
            "cycle_length_ms",
            "time_per_iteration_step1_s",
            "time_per_evaluation_step2_s",
            "iterations_step1",
            "evaluations_step2",
            "iteration_taken_step1",
            "first_within_tolerance_step1",
            "cost_step1",
            "quality_step1",
            "cost_step2",
            "wall_time_s",
            "organ",
            "passive_law",
            "contraction_step1",
            "contraction_step2",
            "effects",
        ]),
        rows: rows(run, |view| {
            let p = view.0;
            // A ventricle with a mesh counts nodes and elements; the reduced one has none.
            let counted = |name: &str| {
                number(
                    view.beat(Step::Step1)
                        .and_then(|r| r.result.counters.get(name).copied()),
                )
            };
            let per_beat = MeanSd::of(
                p.iterations
                    .iter()
                    .map(|i| i.run.as_ref().map(|r| r.provenance.wall_s)),
            );
            let fit = p.cell_fit.as_ref();
            let per_cell = fit
                .filter(|f| f.result.evaluations > 0)
                .map(|f| f.provenance.wall_s / f.result.evaluations as f64);
            let step1 = p.step1.as_ref();
            let model = Model::of(p);
            vec![
                counted("nodes"),
                counted("elements"),
                number(Some(p.plan.step0.cycle_length_ms)),
                number(per_beat.map(|m| m.mean)),
                number(per_cell),
                integer((!p.iterations.is_empty()).then_some(p.iterations.len() as u64)),
                integer(fit.map(|f| f.result.evaluations)),
                integer(step1.map(|s| u64::from(s.best_iteration))),
                integer(step1.and_then(|s| s.first_converged).map(u64::from)),
                number(step1.map(|s| s.cost)),
                step1.map_or(Value::Null, |s| json!(s.to_string())),
                number(fit.map(|f| f.result.cost)),
                number(view.wall_s()),
                json!(model.organ),
                json!(model.passive_law),
                json!(model.contraction_step1),
                json!(model.contraction_step2),
                json!(model.effects),
            ]
        }),
    }
}

/// Biomarkers: measured, step 1, step 2, with absolute relative differences in percent, as the paper prints them.
pub fn table_2(run: &RunRecord) -> Table {
    let mut rows = Vec::new();
    let has_step3 = run.patients.iter().any(|p| p.step3.is_some());
    for p in &run.patients {
        let table = biomarkers::by_step(p);
        let mut row = |kind, key, written: fn(f64) -> f64| {
            let values = table
                .values(key)
                .map(|value| number(value.as_f64().map(written)));
            rows.push(Row {
                patient: p.plan.id.to_string(),
                kind: Some(kind),
                values: values.collect(),
            });
        };
        let percent = |share: f64| 100.0 * share.abs();
        row("measured", "measured", |value| value);
        row("step1", "step1", |value| value);
        row("step1_difference_percent", "step1_difference", percent);
        row("step2", "step2", |value| value);
        row("step2_difference_percent", "step2_difference", percent);
        if has_step3 {
            row("step3", "step3", |value| value);
            row("step3_difference_percent", "step3_difference", percent);
        }
    }
    Table {
        name: "table_2",
        caption: "Simulated and measured LV pressure and volume biomarkers",
        columns: Biomarker::ALL.iter().map(|b| b.key().to_owned()).collect(),
        rows,
    }
}

/// Personalised Tanh and valve models.
pub fn table_a6(run: &RunRecord) -> Table {
    let valves = moved(run, |name| VALVE_PARAMETERS.contains(&name));
    let mut table = Table {
        name: "table_A6",
        caption: "Personalised Tanh model and valve models",
        columns: names(&[
            "Smax_ref_kPa",
            "tau_SR_ref_ms",
            "tau_SD_ms",
            "t_CR_ms",
            "R_AV_f_mmHg_s_per_mL",
            "R_MV_f_mmHg_s_per_mL",
            "quality",
        ]),
        rows: rows(run, |view| match &view.0.step1 {
            Some(step1) => step1
                .parameters
                .updated()
                .iter()
                .map(|v| number(Some(*v)))
                .chain([json!(step1.to_string())])
                .collect(),
            None => vec![Value::Null; 7],
        }),
    };
    of_twins(run, &mut table, &valves);
    table
}

/// The wanted ones of the parameters that any patient's step 3 has moved.
fn moved(run: &RunRecord, is_wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let all = run.patients.iter().filter_map(moved_in_the_organ);
    let names: BTreeSet<&String> = all.flat_map(|of_one| of_one.keys()).collect();
    let wanted = names.into_iter().filter(|name| is_wanted(name.as_str()));
    wanted.cloned().collect()
}

/// Adds a column `NAME_twin` for each of these parameters: its value in the patient's twin, which is
/// step 3's, or that of the steps before where step 3 left it.
fn of_twins(run: &RunRecord, table: &mut Table, parameters: &[String]) {
    for name in parameters {
        let before = table.columns.iter().position(|column| column == name);
        table.columns.push(format!("{name}_twin"));
        for (row, patient) in std::iter::zip(&mut table.rows, &run.patients) {
            let moved = moved_in_the_organ(patient).and_then(|all| all.get(name));
            let left = before.map_or(Value::Null, |column| row.values[column].clone());
            row.values.push(match (patient.twin(), moved) {
                (None, _) => Value::Null,
                (Some(_), Some(value)) => number(Some(*value)),
                (Some(_), None) => left,
            });
        }
    }
}

/// Personalised Land and Rice models with a_p, followed by other fitted parameters and the smallest
/// stretch.
pub fn table_a7(run: &RunRecord) -> Table {
    let mut columns = names(&TABLE_A7);
    columns.push("a_p_kPa".to_owned());
    for fit in run.patients.iter().filter_map(|p| p.cell_fit.as_ref()) {
        for parameter in &fit.result.parameters {
            if !columns.contains(&parameter.name) {
                columns.push(parameter.name.clone());
            }
        }
    }
    let fitted = columns.clone();
    columns.extend(names(&["lambda_min", "lambda_min_reached", "on_bounds"]));
    // Near-optimal intervals and marks of the parameters for which they were computed.
    let profiled: Vec<String> = fitted
        .iter()
        .filter(|name| is_profiled(run, name))
        .cloned()
        .collect();
    for name in &profiled {
        columns.extend(["lower", "upper", "mark"].map(|end| format!("{name}_near_optimal_{end}")));
    }
    let twins = moved(run, |name| !VALVE_PARAMETERS.contains(&name));
    let mut table = Table {
        name: "table_A7",
        caption: "Personalised Land and Rice models; lambda_min is that of step 1's median trace, the target",
        columns,
        rows: rows(run, |view| {
            let fit = view.0.cell_fit.as_ref().map(|f| &f.result);
            let value = |name: &String| {
                number(
                    fit.and_then(|f| f.parameters.iter().find(|p| p.name == *name))
                        .map(|p| p.value),
                )
            };
            let on_bounds = fit.map(|f| {
                f.parameters
                    .iter()
                    .filter(|p| p.at_bound)
                    .map(|p| p.name.as_str())
                    .collect::<Vec<_>>()
                    .join(" ")
            });
            let mut values: Vec<Value> = fitted.iter().map(value).collect();
            values.push(number(
                view.0.targets.as_ref().map(|t| t.result.targets.lambda_min),
            ));
            values.push(number(fit.map(|f| f.reached.lambda_min)));
            values.push(on_bounds.map_or(Value::Null, Value::String));
            for name in &profiled {
                let near =
                    fit.and_then(|f| f.parameters.iter().find(|p| p.name == *name)?.near_optimal);
                values.push(number(near.map(|near| near.lower)));
                values.push(number(near.map(|near| near.upper)));
                values.push(near.map_or(Value::Null, |near| {
                    Value::String(near.mark.as_str().to_owned())
                }));
            }
            values
        }),
    };
    of_twins(run, &mut table, &twins);
    table
}

fn is_profiled(run: &RunRecord, name: &str) -> bool {
    let mut parameters = run
        .patients
        .iter()
        .filter_map(|p| p.cell_fit.as_ref())
        .flat_map(|f| &f.result.parameters);
    parameters.any(|p| p.name == name && p.near_optimal.is_some())
}
