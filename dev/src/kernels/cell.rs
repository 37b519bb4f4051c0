//! Times the evaluation of a 0D cell up to its periodic state, on the batched engine and on the
//! scalar cell.

use std::collections::BTreeMap;

use cardiotwin_calibrate::latin_hypercube;
use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, EngineSettings, SimdPath, Workspace,
};
use cardiotwin_models::cell0d::{CellBeat, CellSolverSettings};
use cardiotwin_schemas::settings::CellFitSettings;
use serde::Serialize;

use super::{CYCLE_MS, median_seconds, processor};
use cardiotwin_worker::cell_parameters::NamedCell;
use cardiotwin_worker::error::TaskError;

/// Number of cells in a batch.
const CELLS: usize = 1024;
/// Number of these cells that are also computed by the scalar cell.
const SCALAR_CELLS: usize = 64;

/// Median times on one core, over random cells within step 2's bounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CellTiming {
    /// Time per cell of a batch with the best instruction set of the processor.
    pub us_per_evaluation: f64,
    /// Time per cell with each instruction set that the processor supports.
    pub us_per_evaluation_by_instruction_set: BTreeMap<String, f64>,
    /// Time per cell of the scalar cell, which computes beats until they are periodic at its
    /// default tolerance.
    pub us_per_evaluation_scalar: f64,
    /// Instruction set behind `us_per_evaluation`.
    pub instruction_set: String,
    /// Number of cells in a batch.
    pub cells: usize,
    /// Mean number of full-accuracy beats in a batched evaluation.
    pub beats_per_evaluation: f64,
    /// Model name of the processor.
    pub processor: String,
}

/// Times evaluations of the cell.
///
/// # Errors
/// Never for the built-in parameters.
pub fn cell() -> Result<CellTiming, TaskError> {
    let cells = random_cells()?;
    let mut outputs = vec![CellOutput::default(); CELLS];
    let mut by_set = BTreeMap::new();
    let mut best = 0.0;
    for path in [SimdPath::Portable, SimdPath::Avx2, SimdPath::Avx512]
        .into_iter()
        .filter(|path| path.is_available())
    {
        let engine = CellEngine::new(EngineSettings {
            path: Some(path),
            ..EngineSettings::default()
        })?;
        let mut workspace = Workspace::new();
        let inputs: Vec<CellInput> = cells.iter().map(NamedCell::input).collect();
        let (seconds, _) =
            median_seconds(|| Ok(engine.evaluate(&inputs, &mut workspace, &mut outputs)?))?;
        best = 1e6 * seconds / CELLS as f64;
        by_set.insert(name(path), best);
    }
    let beats: f64 = outputs.iter().map(|output| f64::from(output.beats)).sum();
    let (scalar, settings) = (&cells[..SCALAR_CELLS], CellSolverSettings::default());
    let mut beat = CellBeat::default();
    let (seconds, _) = median_seconds(|| {
        scalar.iter().try_for_each(|cell| {
            Ok(cell
                .parameters()
                .build()?
                .solve_periodic_into(&settings, &mut beat)?)
        })
    })?;
    Ok(CellTiming {
        us_per_evaluation: best,
        us_per_evaluation_by_instruction_set: by_set,
        us_per_evaluation_scalar: 1e6 * seconds / SCALAR_CELLS as f64,
        instruction_set: name(SimdPath::best()),
        cells: CELLS,
        beats_per_evaluation: beats / CELLS as f64,
        processor: processor(),
    })
}

fn name(path: SimdPath) -> String {
    format!("{path:?}").to_lowercase()
}

fn random_cells() -> Result<Vec<NamedCell>, TaskError> {
    let bounds = CellFitSettings::default().bounds;
    let points = latin_hypercube::unit(CELLS, bounds.len(), 1);
    let cell = |point: Vec<f64>| {
        let values = bounds
            .iter()
            .zip(point)
            .map(|((name, [low, high]), u)| (name.clone(), low + (high - low) * u));
        NamedCell::new(CYCLE_MS, 1.0).with(&values.collect())
    };
    points.into_iter().map(cell).collect()
}
