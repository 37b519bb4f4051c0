//! Checkpoints of a beat: every state of ventricle, circulation, contraction, solver and traces in one file, from which
//! the beat goes on as if it had not been interrupted.
//!
//! The file is `checkpoint/beat.bin` in the attempt's directory, written to a temporary file and renamed. Nodal traces lie beside
//! it ([`super::rows`]); the checkpoint's traces say how many rows of them count.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardiotwin_mechanics::organ::VentricleWork;
use cardiotwin_models::beat::RunProgress;
use cardiotwin_models::circulation::CirculationState;
use cardiotwin_models::ventricle::VentricleSnapshot;
use cardiotwin_schemas::formats::BEAT_CHECKPOINT;
use serde::{Deserialize, Serialize};

use super::arrays::{Arrays, ArraysError};
use super::shapes::Shapes;

/// File in the attempt's folder of checkpoints.
pub const FILE: &str = "beat.bin";

/// A beat between two output intervals.
#[derive(Debug, Clone, PartialEq)]
pub struct BeatCheckpoint {
    /// Where the run stands.
    pub progress: RunProgress,
    /// Circulation.
    pub circulation: CirculationState,
    /// Ventricle, with what its solver keeps from step to step.
    pub ventricle: VentricleSnapshot,
    /// Work so far.
    pub work: VentricleWork,
    /// Shapes of the beat so far.
    pub shapes: Shapes,
    /// Motion so far ([`super::motion::Motion::numbers`]); empty where it is not measured.
    pub motion: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
struct About {
    task: String,
    snapshot: String,
    progress: RunProgress,
    circulation: CirculationState,
    work: [usize; 4],
    shapes: Shapes,
}

/// Why a checkpoint is not gone on from.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// It is no checkpoint, truncated, damaged or of another format.
    #[error(transparent)]
    File(#[from] ArraysError),
    /// It belongs to another task.
    #[error("it belongs to task {found}, not to {expected}")]
    Foreign {
        /// Its task.
        found: String,
        /// The task in hand.
        expected: String,
    },
}

impl BeatCheckpoint {
    /// The file's bytes; `task` is the key of the task in hand.
    ///
    /// # Panics
    /// Never: what stands beside the arrays is JSON.
    #[must_use]
    pub fn to_bytes(&self, task: &str) -> Vec<u8> {
        let VentricleWork {
            steps,
            newton_iterations,
            krylov_iterations,
            factorisations,
        } = self.work;
        let about = About {
            task: task.to_owned(),
            snapshot: self.ventricle.kind.clone(),
            progress: self.progress.clone(),
            circulation: self.circulation.clone(),
            work: [steps, newton_iterations, krylov_iterations, factorisations],
            shapes: self.shapes.clone(),
        };
        let about = serde_json::to_value(&about).expect("plain fields are JSON");
        Arrays::new(&BEAT_CHECKPOINT.kind(), about)
            .with("ventricle", self.ventricle.values.as_slice())
            .with("u_begin_mm", self.shapes.begin.u.as_slice())
            .with("u_smallest_mm", self.shapes.smallest.u.as_slice())
            .with("motion", self.motion.as_slice())
            .to_bytes()
    }

    /// Reads what [`Self::to_bytes`] wrote for the same task.
    ///
    /// # Errors
    /// [`CheckpointError`] for anything else.
    pub fn from_bytes(bytes: &[u8], task: &str) -> Result<Self, CheckpointError> {
        let mut arrays = Arrays::from_bytes(bytes, &BEAT_CHECKPOINT.kind())?;
        let about: About =
            serde_json::from_value(arrays.about.take()).map_err(ArraysError::Header)?;
        if about.task != task {
            return Err(CheckpointError::Foreign {
                found: about.task,
                expected: task.to_owned(),
            });
        }
        let mut shapes = about.shapes;
        shapes.begin.u = arrays.take("u_begin_mm")?;
        shapes.smallest.u = arrays.take("u_smallest_mm")?;
        let [steps, newton_iterations, krylov_iterations, factorisations] = about.work;
        Ok(Self {
            progress: about.progress,
            circulation: about.circulation,
            ventricle: VentricleSnapshot {
                kind: about.snapshot,
                values: arrays.take("ventricle")?,
            },
            work: VentricleWork {
                steps,
                newton_iterations,
                krylov_iterations,
                factorisations,
            },
            shapes,
            motion: arrays.take("motion")?,
        })
    }

    /// The first of `files` that can be gone on from, and which it is. Those that cannot be are told and left aside.
    #[must_use]
    pub fn first_of(files: &[PathBuf], task: &str) -> Option<(Self, PathBuf)> {
        files
            .iter()
            .find_map(|file| Some((Self::read(file, task)?, file.clone())))
    }

    fn read(file: &Path, task: &str) -> Option<Self> {
        let bytes = std::fs::read(file).ok()?;
        match Self::from_bytes(&bytes, task) {
            Ok(checkpoint) => Some(checkpoint),
            Err(error) => {
                tracing::warn!("checkpoint {} is left aside: {error}", file.display());
                None
            }
        }
    }
}

/// When a checkpoint is due: after so much simulated time, but not so soon after the last that writing costs more than it
/// saves.
#[derive(Debug, Clone, Copy)]
pub struct Due {
    every_ms: f64,
    least: Duration,
    last_ms: f64,
    last: Instant,
}

impl Due {
    /// Every `every_ms` of simulated time from `now_ms` on, `least` of real time apart; never for zero.
    #[must_use]
    pub fn new(every_ms: f64, least: Duration, now_ms: f64) -> Self {
        Self {
            every_ms,
            least,
            last_ms: now_ms,
            last: Instant::now(),
        }
    }

    /// Whether one is due; then it counts as written.
    pub fn at(&mut self, now_ms: f64) -> bool {
        let due = self.every_ms > 0.0
            && now_ms - self.last_ms >= self.every_ms - 1e-6
            && self.last.elapsed() >= self.least;
        if due {
            (self.last_ms, self.last) = (now_ms, Instant::now());
        }
        due
    }
}
