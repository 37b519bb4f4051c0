//! Environment of a task: everything that it gets besides its specification.

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

/// Default simulated time between two checkpoints of a beat \[ms\].
pub const CHECKPOINT_MS: f64 = 100.0;
/// Default wall time between two checkpoints. A beat that ends sooner leaves no checkpoint.
pub const CHECKPOINT_APART: Duration = Duration::from_secs(20);

/// Environment of one task.
#[derive(Debug)]
pub struct Context {
    /// Artefacts written by the task.
    pub artefacts: Artefacts,
    /// Number of threads; results do not depend on it.
    pub threads: u32,
    /// Ranks in other processes that compute a 3D beat together with this one, instead of threads.
    pub team: Option<Team>,
    /// Instruction set of the cell engine.
    pub instruction_set: InstructionSet,
    /// Log of the task's progress reports.
    pub progress: ProgressLog,
    /// Checkpoints of unfinished work.
    pub checkpoints: Checkpoints,
    /// Simulated time between two checkpoints of a beat \[ms\]; 0 for no checkpoints.
    pub checkpoint_ms: f64,
    /// Shortest wall time between two checkpoints.
    pub checkpoint_apart: Duration,
    /// Simulated time between frames of a series of VTU files \[ms\]; 0 for no series.
    pub vtu_every_ms: f64,
    /// Flag that asks the task to stop.
    pub stop: StopFlag,
    /// The attempt's `outcome.json`. While the task is at work, only a revocation creates it.
    pub closed: Option<PathBuf>,
}

impl Context {
    /// An environment without reports, checkpoints and interruption. Artefacts go to `directory`.
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

    /// Number of parts of a mesh, each computed by a thread: as many as asked for, or one per thread for 0.
    #[must_use]
    pub fn parts(&self, subdomains: u32) -> usize {
        let parts = if subdomains > 0 {
            subdomains
        } else {
            self.threads
        };
        parts.max(1) as usize
    }

    /// Checks whether the task should stop. Tasks call this between steps of a few seconds at most.
    ///
    /// # Errors
    /// [`TaskError::Cancelled`] when the stop flag is raised or the attempt was revoked.
    pub fn check_stop(&self) -> Result<(), TaskError> {
        if self.stop.is_raised() || self.closed.as_ref().is_some_and(|closed| closed.exists()) {
            return Err(TaskError::Cancelled);
        }
        Ok(())
    }
}

/// Files made by a task. Each is synced and hashed as it is written.
#[derive(Debug)]
pub struct Artefacts {
    directory: PathBuf,
    written: Vec<Artefact>,
}

impl Artefacts {
    /// Artefacts in `directory`, which must exist.
    #[must_use]
    pub fn in_directory(directory: &Path) -> Self {
        Self {
            directory: directory.to_owned(),
            written: Vec::new(),
        }
    }

    /// Directory of the artefacts.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Writes `content` to `file` and records it under the role `name`.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of the file system.
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

    /// Writes `file` piece by piece and records it under the role `name`.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of `write` or of the file system.
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

    /// Writes `content` to `file` atomically, for files that later tasks read, and records it under
    /// the role `name`.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of the file system.
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

    /// Takes the records of the files written so far.
    #[must_use]
    pub fn take(&mut self) -> Vec<Artefact> {
        std::mem::take(&mut self.written)
    }
}
