//! Checkpoints of a beat. One file holds the states of ventricle, circulation, contraction, solver
//! and traces; a beat restarted from it continues as if it had not been interrupted.
//!
//! The file is `checkpoint/beat.bin` in the attempt's directory. It is written to a temporary file
//! and renamed. Nodal traces have files of their own ([`super::rows`]); the traces in the
//! checkpoint determine how many of their rows are valid.

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

/// Name of the file in the attempt's folder of checkpoints.
pub const FILE: &str = "beat.bin";

/// State of a beat between two output intervals.
#[derive(Debug, Clone, PartialEq)]
pub struct BeatCheckpoint {
    /// Progress of the run, with its traces.
    pub progress: RunProgress,
    /// State of the circulation.
    pub circulation: CirculationState,
    /// State of the ventricle, including the data that its solver carries from step to step.
    pub ventricle: VentricleSnapshot,
    /// Counts of steps and iterations so far.
    pub work: VentricleWork,
    /// Shapes of the ventricle in the beat so far.
    pub shapes: Shapes,
    /// Motion in the beat so far ([`super::motion::Motion::numbers`]); empty if motion is not
    /// measured.
    pub motion: Vec<f64>,
    /// Frames of the beat so far ([`super::frames::Frames::numbers`]); empty if there are none, as in
    /// checkpoints of earlier programs.
    pub frames: Vec<f64>,
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

/// Reasons why a beat cannot continue from a checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file is not a checkpoint, is truncated or damaged, or has another format.
    #[error(transparent)]
    File(#[from] ArraysError),
    /// The checkpoint belongs to another task.
    #[error("the file belongs to task {found}, expected {expected}")]
    Foreign {
        /// Key of the task whose beat the checkpoint holds.
        found: String,
        /// Key of the task that is being computed.
        expected: String,
    },
}

impl BeatCheckpoint {
    /// Encodes the checkpoint; `task` is the key of the current task.
    ///
    /// # Panics
    /// Never in practice: the content other than arrays is valid JSON.
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
            .with("frames", self.frames.as_slice())
            .to_bytes()
    }

    /// Decodes the output of [`Self::to_bytes`] for the same task.
    ///
    /// # Errors
    /// [`CheckpointError`] for any other content.
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
            frames: arrays.take("frames").unwrap_or_default(),
        })
    }

    /// The first usable checkpoint among `files`, with its path. Unusable ones are logged and
    /// skipped.
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

/// Decides when a checkpoint is due: after an interval of simulated time, but not before enough
/// wall time has passed since the last one that a checkpoint saves more time than it costs.
#[derive(Debug, Clone, Copy)]
pub struct Due {
    every_ms: f64,
    least: Duration,
    last_ms: f64,
    last: Instant,
}

impl Due {
    /// A checkpoint every `every_ms` of simulated time from `now_ms` on, at least `least` of wall
    /// time apart; no checkpoints if `every_ms` is 0.
    #[must_use]
    pub fn new(every_ms: f64, least: Duration, now_ms: f64) -> Self {
        Self {
            every_ms,
            least,
            last_ms: now_ms,
            last: Instant::now(),
        }
    }

    /// Whether a checkpoint is due. If so, it counts as written.
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
