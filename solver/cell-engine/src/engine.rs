//! The engine: workspace, and the lanes' refilling from the list of inputs.

use std::sync::Arc;

use rayon::prelude::*;

use crate::calcium::SampledCalcium;
use crate::dispatch::{Available, PathMissing, SimdPath};
use crate::input::CellInput;
use crate::lanes::LANES;
use crate::output::{CellOutput, CellTrace, CostBound};
use crate::schedule::{Run, Slots};
use crate::settings::EngineSettings;

/// Reasons why an engine could not be made or used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// The pinned path does not run here.
    #[error(transparent)]
    Path(#[from] PathMissing),
    /// A setting is outside of its range.
    #[error("setting {name} is {value}, expected {expected}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Value of the setting.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
    /// Slices of different lengths.
    #[error("found {inputs} inputs, but {others} {name}: give one for each input")]
    Lengths {
        /// Number of cells to evaluate.
        inputs: usize,
        /// Length of the other slice.
        others: usize,
        /// Plural noun for the entries of the other slice.
        name: &'static str,
    },
}

/// Memory of one thread: made once, used for any number of batches, never grown inside a batch once it has seen the
/// longest beat.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    pub(crate) slots: Option<Box<Slots>>,
}

impl Workspace {
    /// A workspace that takes its memory at the first batch.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

/// Evaluates cells in batches.
///
/// A lane's arithmetic depends on its own cell alone (own time, steps, iterations), so an output has the same bits
/// whatever else is in the batch, in whatever order, on any number of threads.
#[derive(Debug, Clone)]
pub struct CellEngine {
    settings: EngineSettings,
    path: Available,
    calcium: Option<Arc<SampledCalcium>>,
}

impl CellEngine {
    /// An engine with these settings.
    ///
    /// # Errors
    /// [`EngineError`] when the pinned path does not run here, or a setting is out of range.
    pub fn new(settings: EngineSettings) -> Result<Self, EngineError> {
        let ranges = [
            ("tolerance", settings.tolerance, 1e-10, 0.1, "1e-10 to 0.1"),
            ("run_in_ms", settings.run_in_ms, 0.0, 1e5, "0 to 1e5"),
            (
                "run_in_tolerance",
                settings.run_in_tolerance,
                1.0,
                1e6,
                "1 to 1e6",
            ),
            (
                "oscillation_tolerance",
                settings.oscillation_tolerance,
                1e-6,
                1.0,
                "1e-6 to 1",
            ),
            (
                "max_beats",
                f64::from(settings.max_beats),
                1.0,
                1e6,
                "1 to 1e6",
            ),
            (
                "max_steps_per_beat",
                f64::from(settings.max_steps_per_beat),
                10.0,
                1e9,
                "10 to 1e9",
            ),
        ];
        for (name, value, low, high, expected) in ranges {
            if !(low..=high).contains(&value) {
                return Err(EngineError::Setting {
                    name,
                    value,
                    expected,
                });
            }
        }
        Ok(Self {
            settings,
            path: Available::choose(settings.path)?,
            calcium: None,
        })
    }

    /// The same engine with these samples as the calcium of every cell: Rice's four parameters then have no effect (they
    /// are checked all the same). Calcium's durations are those of the samples within the cycle.
    #[must_use]
    pub fn with_calcium(self, samples: SampledCalcium) -> Self {
        Self {
            calcium: Some(Arc::new(samples)),
            ..self
        }
    }

    /// The instruction set in use, for the provenance of results.
    #[must_use]
    pub fn path(&self) -> SimdPath {
        self.path.path()
    }

    /// Settings with which the engine was made.
    #[must_use]
    pub fn settings(&self) -> &EngineSettings {
        &self.settings
    }

    /// Evaluates `inputs` on this thread.
    ///
    /// # Errors
    /// [`EngineError::Lengths`] when `outputs` is not as long as `inputs`. A cell's own problem is
    /// in its output.
    pub fn evaluate(
        &self,
        inputs: &[CellInput],
        workspace: &mut Workspace,
        outputs: &mut [CellOutput],
    ) -> Result<(), EngineError> {
        self.run(inputs, None, None, workspace, outputs)
    }

    /// As [`CellEngine::evaluate`], but gives up cells whose cost cannot come below their bound.
    ///
    /// # Errors
    /// [`EngineError::Lengths`] when `outputs` or the bounds are not as many as `inputs`.
    pub fn evaluate_bounded(
        &self,
        inputs: &[CellInput],
        bound: &CostBound<'_>,
        workspace: &mut Workspace,
        outputs: &mut [CellOutput],
    ) -> Result<(), EngineError> {
        self.run(inputs, Some(bound), None, workspace, outputs)
    }

    /// As [`CellEngine::evaluate`], with the beats themselves.
    ///
    /// # Errors
    /// [`EngineError::Lengths`] when `outputs` or `traces` are not as many as `inputs`.
    pub fn evaluate_with_traces(
        &self,
        inputs: &[CellInput],
        workspace: &mut Workspace,
        outputs: &mut [CellOutput],
        traces: &mut [CellTrace],
    ) -> Result<(), EngineError> {
        self.run(inputs, None, Some(traces), workspace, outputs)
    }

    /// Evaluates `inputs` on the threads of rayon's current pool, in chunks of `chunk` cells (at least four vectors).
    ///
    /// # Errors
    /// As [`CellEngine::evaluate_bounded`].
    pub fn evaluate_parallel(
        &self,
        inputs: &[CellInput],
        bound: Option<&CostBound<'_>>,
        chunk: usize,
        outputs: &mut [CellOutput],
    ) -> Result<(), EngineError> {
        same_length(inputs.len(), outputs.len(), "outputs")?;
        if let Some(bound) = bound {
            same_length(inputs.len(), bound.bounds.len(), "bounds")?;
        }
        let chunk = chunk.max(4 * LANES);
        inputs
            .par_chunks(chunk)
            .zip(outputs.par_chunks_mut(chunk))
            .enumerate()
            .try_for_each_init(Workspace::new, |workspace, (k, (inputs, outputs))| {
                let part = bound.map(|b| CostBound {
                    bounds: &b.bounds[k * chunk..][..inputs.len()],
                    ..*b
                });
                self.run(inputs, part.as_ref(), None, workspace, outputs)
            })
    }

    fn run(
        &self,
        inputs: &[CellInput],
        bound: Option<&CostBound<'_>>,
        traces: Option<&mut [CellTrace]>,
        workspace: &mut Workspace,
        outputs: &mut [CellOutput],
    ) -> Result<(), EngineError> {
        same_length(inputs.len(), outputs.len(), "outputs")?;
        if let Some(bound) = bound {
            same_length(inputs.len(), bound.bounds.len(), "bounds")?;
        }
        if let Some(traces) = &traces {
            same_length(inputs.len(), traces.len(), "traces")?;
        }
        let slots = workspace.slots.get_or_insert_with(Slots::new);
        let samples = self.calcium.as_deref();
        Run {
            settings: &self.settings,
            path: self.path,
            samples,
            inputs,
            bound,
            outputs,
            traces,
        }
        .all(slots);
        Ok(())
    }
}

fn same_length(inputs: usize, others: usize, name: &'static str) -> Result<(), EngineError> {
    if inputs == others {
        Ok(())
    } else {
        Err(EngineError::Lengths {
            inputs,
            others,
            name,
        })
    }
}
