//! The 0D cell as the model of a sweep, on the batched engine.

use cardiotwin_cell_engine::{
    CellEngine, CellInput, CellOutput, CellStatus, EngineSettings, NegativeKwu, SimdPath, Workspace,
};
use cardiotwin_schemas::settings::InstructionSet;
use cardiotwin_schemas::sweep::{CellDesign, SAMPLES_HEADING};
use rayon::ThreadPool;

use super::model::Model;
use crate::cell_parameters::{NamedCell, position};
use crate::engine::settings_for;
use crate::error::TaskError;

/// Number of cells that a thread takes at once.
const CELLS_AT_ONCE: usize = 176;

/// Base cell, from which the samples differ in the swept parameters.
pub(super) struct Cells {
    base: CellInput,
    swept: Vec<usize>,
    engine: CellEngine,
    workspace: Workspace,
    outputs: Vec<CellOutput>,
}

impl Cells {
    pub(super) fn of(
        design: &CellDesign,
        instruction_set: InstructionSet,
    ) -> Result<Self, TaskError> {
        let engine = CellEngine::new(EngineSettings {
            tolerance: design.tolerance,
            // As in the published analysis: the parameter box contains negative values, and the
            // equations are valid there.
            negative_kwu: NegativeKwu::Keep,
            ..settings_for(instruction_set)
        })?;
        let base = NamedCell::new(design.cycle_length_ms, design.lambda_0)
            .with(&design.fixed)?
            .input();
        let swept = design
            .parameters
            .iter()
            .map(|p| position(&p.name))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            base,
            swept,
            engine,
            workspace: Workspace::new(),
            outputs: Vec::new(),
        })
    }

    fn input(&self, row: &[f64]) -> CellInput {
        let mut input = self.base;
        for (at, value) in self.swept.iter().zip(row) {
            input.parameters[*at] = *value;
        }
        input
    }
}

impl Model for Cells {
    const HEADING: &'static str = SAMPLES_HEADING;
    /// A few milliseconds of work.
    const BLOCKS_AT_ONCE: usize = 16;

    fn arithmetic(&self) -> &'static str {
        match self.engine.path() {
            SimdPath::Portable => "portable",
            SimdPath::Avx2 => "avx2",
            SimdPath::Avx512 => "avx512",
        }
    }

    fn lines(
        &mut self,
        rows: &[Vec<f64>],
        pool: Option<&ThreadPool>,
    ) -> Result<Vec<String>, TaskError> {
        let inputs: Vec<CellInput> = rows.iter().map(|row| self.input(row)).collect();
        self.outputs.clear();
        self.outputs.resize(inputs.len(), CellOutput::default());
        let Self {
            engine,
            workspace,
            outputs,
            ..
        } = self;
        match pool {
            Some(pool) => {
                pool.install(|| engine.evaluate_parallel(&inputs, None, CELLS_AT_ONCE, outputs))?
            }
            None => engine.evaluate(&inputs, workspace, outputs)?,
        }
        Ok(self.outputs.iter().map(line).collect())
    }
}

/// Name of a status in `samples.csv`.
#[must_use]
pub fn status(status: CellStatus) -> &'static str {
    match status {
        CellStatus::Periodic => "periodic",
        CellStatus::NotPeriodic => "not-periodic",
        // Without an upper limit of the cost, the engine never gives up a cell.
        CellStatus::Hopeless | CellStatus::Stuck { .. } => "stuck",
        CellStatus::Refused(_) => "refused",
    }
}

/// A sample's line from its status on. `{:?}` gives the shortest form of a number that parses back
/// to the same value.
fn line(output: &CellOutput) -> String {
    let word = status(output.status);
    match output.status {
        CellStatus::Periodic | CellStatus::NotPeriodic => {
            let (r, b) = (&output.reading, &output.reading.biomarkers);
            let cut = u8::from(r.cut.contains(&true));
            format!(
                "{word},{:?},{:?},{:?},{:?},{:?},{cut},{:?},{:?},{:?},{:?},{}",
                b.sa_max_kpa,
                b.dsadt_max_kpa_per_ms,
                b.std30_ms,
                b.std50_ms,
                b.std90_ms,
                b.lambda_min,
                r.sa_res_kpa,
                r.sa_min_kpa,
                r.max_rise_after_peak_kpa_per_ms,
                output.beats
            )
        }
        _ => format!("{word},,,,,,,,,,,{}", output.beats),
    }
}
