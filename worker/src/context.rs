//! What a task is given beside its specification.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::outcome::Artefact;
use cardiotwin_schemas::settings::InstructionSet;
use cardiotwin_schemas::task::InputFile;

use crate::checkpoint::Checkpoints;
use crate::error::TaskError;
use crate::files;
use crate::progress::ProgressLog;
use crate::stop::StopFlag;
use crate::team::Team;

/// Simulated time between two checkpoints of a beat where nothing else is asked for \[ms\].
pub const CHECKPOINT_MS: f64 = 100.0;
/// A beat that is over sooner leaves no checkpoint.
pub const CHECKPOINT_APART: Duration = Duration::from_secs(20);

/// The surroundings of one task.
#[derive(Debug)]
pub struct Context {
    /// Where artefacts go.
    pub artefacts: Artefacts,
    /// Threads that may be used; results do not depend on it.
    pub threads: u32,
    /// Ranks of other processes that help with a beat in 3D, instead of threads.
    pub team: Option<Team>,
    /// Instructions of the cell engine.
    pub instruction_set: InstructionSet,
    /// Where reports go.
    pub progress: ProgressLog,
    /// Where work in hand is kept.
    pub checkpoints: Checkpoints,
    /// Simulated time between two checkpoints of a beat \[ms\], 0 for none.
    pub checkpoint_ms: f64,
    /// Real time between two of them at least.
    pub checkpoint_apart: Duration,
    /// Simulated time between frames of a series of VTU files \[ms\], 0 for no series.
    pub vtu_every_ms: f64,
    /// Whether to stop.
    pub stop: StopFlag,
    /// The attempt's `outcome.json`: while the task is at work, only a revocation creates it.
    pub closed: Option<PathBuf>,
}

impl Context {
    /// A context in which nothing is reported, kept or interrupted; artefacts go to `directory`.
    #[must_use]
    pub fn plain(directory: &Path, threads: u32) -> Self {
        Self {
            artefacts: Artefacts::in_directory(directory),
            threads,
            team: None,
            instruction_set: InstructionSet::Auto,
            progress: ProgressLog::silent(),
            checkpoints: Checkpoints::none(),
            checkpoint_ms: CHECKPOINT_MS,
            checkpoint_apart: CHECKPOINT_APART,
            vtu_every_ms: 0.0,
            stop: StopFlag::default(),
            closed: None,
        }
    }

    /// Looks whether the work should be left: to be called between steps of at most a few seconds.
    ///
    /// # Errors
    /// [`TaskError::Cancelled`] when stopping was asked for or the attempt was revoked.
    pub fn check_stop(&self) -> Result<(), TaskError> {
        if self.stop.is_raised() || self.closed.as_ref().is_some_and(|closed| closed.exists()) {
            return Err(TaskError::Cancelled);
        }
        Ok(())
    }
}

/// Files made by a task, each on disk and hashed as soon as it is written.
#[derive(Debug)]
pub struct Artefacts {
    directory: PathBuf,
    written: Vec<Artefact>,
}

impl Artefacts {
    /// Files go to `directory`, which exists.
    #[must_use]
    pub fn in_directory(directory: &Path) -> Self {
        Self {
            directory: directory.to_owned(),
            written: Vec::new(),
        }
    }

    /// Where files go.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Writes `file` with `content` in the role `name`.
    ///
    /// # Errors
    /// [`TaskError::Write`] when the file system refuses.
    pub fn write(&mut self, name: &str, file: &str, content: &str) -> Result<(), TaskError> {
        let path = self.directory.join(file);
        files::write_synced(&path, content.as_bytes())
            .map_err(|source| TaskError::Write { file: path, source })?;
        self.written.push(Artefact {
            name: name.to_owned(),
            file: file.to_owned(),
            sha256: sha256_hex(content.as_bytes()),
            bytes: content.len() as u64,
        });
        Ok(())
    }

    /// Writes `file` in the role `name` piece by piece.
    ///
    /// # Errors
    /// [`TaskError::Write`] when `write` or the file system refuses.
    pub fn write_pieces(
        &mut self,
        name: &str,
        file: &str,
        write: impl FnOnce(&mut files::Hashed) -> io::Result<()>,
    ) -> Result<(), TaskError> {
        let path = self.directory.join(file);
        let written = files::Hashed::create(&path).and_then(|mut out| {
            write(&mut out)?;
            out.finish()
        });
        let (sha256, bytes) = written.map_err(|source| TaskError::Write { file: path, source })?;
        self.written.push(Artefact {
            name: name.to_owned(),
            file: file.to_owned(),
            sha256,
            bytes,
        });
        Ok(())
    }

    /// Writes `file` with `content` in the role `name`, whole or not at all: for what later tasks read.
    ///
    /// # Errors
    /// [`TaskError::Write`] when the file system refuses.
    pub fn write_bytes(
        &mut self,
        name: &str,
        file: &str,
        content: &[u8],
    ) -> Result<InputFile, TaskError> {
        let path = self.directory.join(file);
        files::write_atomic(&path, content).map_err(|source| TaskError::Write {
            file: path.clone(),
            source,
        })?;
        let sha256 = sha256_hex(content);
        let (name, file, bytes) = (name.to_owned(), file.to_owned(), content.len() as u64);
        self.written.push(Artefact {
            name: name.clone(),
            file,
            sha256: sha256.clone(),
            bytes,
        });
        let path = std::path::absolute(&path).unwrap_or(path);
        Ok(InputFile { name, path, sha256 })
    }

    /// What was written so far.
    #[must_use]
    pub fn take(&mut self) -> Vec<Artefact> {
        std::mem::take(&mut self.written)
    }
}
