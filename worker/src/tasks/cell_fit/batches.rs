//! Batches of cells, computed on all threads or recalled from an earlier attempt. A stop request
//! interrupts them.

use cardiotwin_cell_engine::{CellInput, CellOutput, Workspace};

use super::objective::Objective;
use crate::checkpoint::Journal;
use crate::context::Context;
use crate::error::TaskError;

/// Number of cells per thread between two checks of the stop flag; they take far less than a second
/// on any instruction set.
const CELLS_BETWEEN_LOOKS: usize = 1024;

/// Computes batches for one objective.
#[derive(Debug)]
pub struct Batches<'a> {
    objective: &'a Objective,
    journal: Journal,
    pool: Option<rayon::ThreadPool>,
    threads: usize,
    workspace: Workspace,
    inputs: Vec<CellInput>,
    outputs: Vec<CellOutput>,
    /// Whether the last batch was recalled from the journal.
    recalled: bool,
}

impl<'a> Batches<'a> {
    /// Batches on `threads` threads, recorded in `journal`.
    ///
    /// # Errors
    /// [`TaskError::Threads`] when the threads cannot be started.
    pub fn new(
        objective: &'a Objective,
        journal: Journal,
        threads: u32,
    ) -> Result<Self, TaskError> {
        let threads = threads.max(1) as usize;
        let pool =
            (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads).build());
        Ok(Self {
            objective,
            journal,
            pool: pool.transpose().map_err(TaskError::Threads)?,
            threads,
            workspace: Workspace::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            recalled: false,
        })
    }

    /// Costs of `points`.
    ///
    /// # Errors
    /// [`TaskError::Cancelled`] between parts of a large batch, [`TaskError::Checkpoint`] when the
    /// journal cannot be written.
    pub fn costs(&mut self, points: &[Vec<f64>], context: &Context) -> Result<Vec<f64>, TaskError> {
        let recalled = self.journal.recall(points);
        self.recalled = recalled.is_some();
        let costs = match recalled {
            Some(costs) => costs,
            None => self.compute(points, context)?,
        };
        self.journal
            .record(points, &costs)
            .map_err(TaskError::Checkpoint)?;
        Ok(costs)
    }

    /// Checks whether to stop, except while recalling: this takes no time, and the attempt should
    /// get as far as the earlier one.
    ///
    /// # Errors
    /// [`TaskError::Cancelled`] when a stop is requested.
    pub fn check_stop(&self, context: &Context) -> Result<(), TaskError> {
        if self.recalled {
            Ok(())
        } else {
            context.check_stop()
        }
    }

    /// Ignores the rest of the earlier attempt's costs: further cells are computed.
    pub fn forget(&mut self) {
        self.journal.forget();
    }

    fn compute(&mut self, points: &[Vec<f64>], context: &Context) -> Result<Vec<f64>, TaskError> {
        let mut costs = Vec::with_capacity(points.len());
        for (k, part) in points
            .chunks(CELLS_BETWEEN_LOOKS * self.threads)
            .enumerate()
        {
            if k > 0 {
                context.check_stop()?;
            }
            self.inputs.clear();
            self.inputs
                .extend(part.iter().map(|point| self.objective.input(point)));
            self.outputs.clear();
            self.outputs.resize(part.len(), CellOutput::default());
            let (engine, inputs, outputs) =
                (self.objective.engine(), &self.inputs, &mut self.outputs);
            match &self.pool {
                Some(pool) => {
                    let chunk = part.len().div_ceil(self.threads);
                    pool.install(|| engine.evaluate_parallel(inputs, None, chunk, outputs))?;
                }
                None => engine.evaluate(inputs, &mut self.workspace, outputs)?,
            }
            let cells = self.inputs.iter().zip(&self.outputs);
            costs.extend(cells.map(|(input, output)| self.objective.cost(input, output)));
        }
        Ok(costs)
    }
}
