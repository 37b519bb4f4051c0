//! The 0D cell: one beat with traces, and batches of parameter sets.

use std::collections::BTreeMap;

use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellStatus, CellTrace, EngineSettings, NegativeKwu,
    Workspace,
};
use cardiotwin_vocabulary::biomarkers::CELL_BIOMARKERS;
use cardiotwin_worker::cell_parameters::{NamedCell, position};
use cardiotwin_worker::tasks::sweep::cell_status;
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray2, ToPyArray as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::current_num_threads;

use crate::error::{ModelError, model};
use crate::threads;

/// Number of cells that a thread takes at once, as in a sweep.
const CELLS_AT_ONCE: usize = 176;
/// Number of cells of a thread between two looks for Ctrl-C: about a quarter of a second.
const CELLS_UNTIL_SIGNALS: usize = 16_384;

fn engine(tolerance: f64, refuse_negative_kwu: bool) -> PyResult<CellEngine> {
    CellEngine::new(EngineSettings {
        tolerance,
        negative_kwu: if refuse_negative_kwu {
            NegativeKwu::Refuse
        } else {
            NegativeKwu::Keep
        },
        ..EngineSettings::default()
    })
    .map_err(|error| model(&error))
}

fn cell(
    parameters: &BTreeMap<String, f64>,
    cycle_length_ms: f64,
    lambda_0: f64,
) -> PyResult<CellInput> {
    NamedCell::new(cycle_length_ms, lambda_0)
        .with(parameters)
        .map(|cell| cell.input())
        .map_err(|error| model(&error))
}

fn has_beat(status: CellStatus) -> bool {
    matches!(status, CellStatus::Periodic | CellStatus::NotPeriodic)
}

/// One periodic beat of the cell: `status`, `biomarkers` by name, `beats`, and `traces` by column
/// (`time_ms`, `Sa_kPa`, `Ca_uM`, `lambda`).
///
/// Raises `ModelError` for an unknown name, a value outside of the model's range, or a cell
/// without a beat.
#[pyfunction]
pub fn cell_beat<'py>(
    py: Python<'py>,
    parameters: BTreeMap<String, f64>,
    cycle_length_ms: f64,
    lambda_0: f64,
    tolerance: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let engine = engine(tolerance, false)?;
    let input = [cell(&parameters, cycle_length_ms, lambda_0)?];
    let (mut output, mut trace) = ([CellOutput::default()], [CellTrace::default()]);
    engine
        .evaluate_with_traces(&input, &mut Workspace::new(), &mut output, &mut trace)
        .map_err(|error| model(&error))?;
    let ([output], [trace]) = (output, trace);
    match output.status {
        CellStatus::Refused(problem) => return Err(model(&problem)),
        CellStatus::Stuck { t_ms } => {
            return Err(ModelError::new_err(format!(
                "the cell has no beat: no step was short enough at {t_ms} ms"
            )));
        }
        CellStatus::Hopeless | CellStatus::Periodic | CellStatus::NotPeriodic => {}
    }
    let traces = PyDict::new(py);
    let time: Vec<f64> = (0..trace.sa_kpa.len()).map(|k| k as f64).collect();
    traces.set_item("time_ms", time.to_pyarray(py))?;
    traces.set_item("Sa_kPa", trace.sa_kpa.to_pyarray(py))?;
    traces.set_item("Ca_uM", trace.calcium_um.to_pyarray(py))?;
    traces.set_item("lambda", trace.lambda.to_pyarray(py))?;
    let biomarkers = PyDict::new(py);
    for (name, value) in output.reading.biomarkers.by_name() {
        biomarkers.set_item(name, value)?;
    }
    let answer = PyDict::new(py);
    answer.set_item("status", cell_status(output.status))?;
    answer.set_item("beats", output.beats)?;
    answer.set_item("biomarkers", biomarkers)?;
    answer.set_item("traces", traces)?;
    Ok(answer)
}

/// Biomarkers (sets × [`CELL_BIOMARKERS`]), beats of full accuracy, and the name of each set's
/// status.
type Batch<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u32>>,
    Vec<&'static str>,
);

/// Biomarkers of many cells: `values` holds a row for each set and a column for each of `names`;
/// all other parameters are those of `parameters` or the defaults. A set without a beat has a row
/// of NaN and a status that says why.
///
/// Raises `ModelError` for an unknown name or a setting outside of the engine's range.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn cell_batch<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f64>,
    names: Vec<String>,
    parameters: BTreeMap<String, f64>,
    cycle_length_ms: f64,
    lambda_0: f64,
    tolerance: f64,
    refuse_negative_kwu: bool,
    n_threads: usize,
) -> PyResult<Batch<'py>> {
    let engine = engine(tolerance, refuse_negative_kwu)?;
    let base = cell(&parameters, cycle_length_ms, lambda_0)?;
    let places = names
        .iter()
        .map(|name| position(name))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| model(&error))?;
    let values = values.as_array();
    let mut inputs = vec![base; values.nrows()];
    for (input, row) in inputs.iter_mut().zip(values.rows()) {
        for (place, value) in places.iter().zip(row) {
            input.parameters[*place] = *value;
        }
    }
    let mut outputs = vec![CellOutput::default(); inputs.len()];
    let slice = CELLS_UNTIL_SIGNALS * threads::run(py, n_threads, current_num_threads)?;
    for (inputs, outputs) in inputs.chunks(slice).zip(outputs.chunks_mut(slice)) {
        let evaluate = || match n_threads {
            1 => engine.evaluate(inputs, &mut Workspace::new(), outputs),
            _ => engine.evaluate_parallel(inputs, None, CELLS_AT_ONCE, outputs),
        };
        threads::run(py, n_threads, evaluate)?.map_err(|error| model(&error))?;
        py.check_signals()?;
    }
    let mut biomarkers = Vec::with_capacity(outputs.len() * CELL_BIOMARKERS.len());
    for output in &outputs {
        if has_beat(output.status) {
            biomarkers.extend(output.reading.biomarkers.values());
        } else {
            biomarkers.extend([f64::NAN; CELL_BIOMARKERS.len()]);
        }
    }
    let biomarkers =
        PyArray1::from_vec(py, biomarkers).reshape([outputs.len(), CELL_BIOMARKERS.len()])?;
    let beats = PyArray1::from_iter(py, outputs.iter().map(|output| output.beats));
    let status = outputs.iter().map(|output| cell_status(output.status));
    Ok((biomarkers, beats, status.collect()))
}
