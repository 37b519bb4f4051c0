//! Estimate of the disk space that the remaining work takes: bytes and inodes of attempts, from the
//! measured attempts of this run, or else from those of the bundled cohort.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::Fidelity;
use cardiotwin_workflow::task::Task;
use serde::Serialize;

use super::expect::rest;
use crate::EngineError;
use crate::books::{ATTEMPTS, Books};
use crate::mesh_size;

/// Number of measured attempts of a kind that suffices for a mean.
const ENOUGH: usize = 20;
/// Nodal traces of a beat in 3D with calcium, bytes per node of the mesh and ms of the cycle: three numbers
/// of some ten characters a ms. 03-CoA with 500 nodes and 917 ms: 30.3; without calcium, in step 1: 15.8.
const BYTES_PER_NODE_AND_MS: f64 = 31.0;
/// `ventricle.bin` and the other files of step 0, bytes per node.
const STEP0_BYTES_PER_NODE: f64 = 490.0;
/// Attempts of 03-CoA on the reduced ventricle, by kind: bytes, and number of files and folders.
const GUESSED: [(&str, f64, f64); 8] = [
    ("passive-state", 8_000.0, 7.0),
    ("organ-beat", 590_000.0, 9.0),
    ("step1-proposal", 9_000.0, 5.0),
    ("step3-proposal", 12_000.0, 5.0),
    ("posterior", 80_000.0, 5.0),
    ("targets", 90_000.0, 7.0),
    ("cell-fit", 320_000.0, 10.0),
    ("noop", 2_000.0, 5.0),
];
/// Size of an attempt of any other kind: bytes, and number of files and folders.
const OTHER: (f64, f64) = (1_000_000.0, 8.0);

/// Disk space that the remaining tasks are expected to take.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct DiskNeed {
    /// Sum of the expected sizes of their files, in bytes.
    pub bytes: f64,
    /// Number of files and folders.
    pub inodes: f64,
    /// Kinds of tasks whose attempts were measured in this run.
    pub measured: Vec<String>,
    /// Kinds of tasks whose size is a guess.
    pub guessed: Vec<String>,
    /// Free space on the file system of the attempts, bytes; `None` if the file system does not
    /// report it.
    pub free_bytes: Option<u64>,
    /// Free inodes there; `None` if the file system allocates inodes on demand.
    pub free_inodes: Option<u64>,
}

impl DiskNeed {
    /// Estimate for the given patients, by their indices in `books.patients()`.
    ///
    /// # Errors
    /// [`EngineError::Plan`] if a stored plan cannot be read.
    pub fn of(books: &Books, patients: impl Iterator<Item = usize>) -> Result<Self, EngineError> {
        let measured = measured(books);
        let mut room = Self::default();
        for i in patients {
            let plan = books.plan(i)?;
            for (kind, n) in rest(plan, &books.patient(i).chain)
                .into_iter()
                .filter(|(_, n)| *n > 0)
            {
                let (bytes, inodes) = measured
                    .get(kind)
                    .copied()
                    .unwrap_or_else(|| guess(kind, plan));
                room.bytes += n as f64 * bytes;
                room.inodes += n as f64 * inodes;
                let basis = if measured.contains_key(kind) {
                    &mut room.measured
                } else {
                    &mut room.guessed
                };
                if !basis.iter().any(|known| known == kind) {
                    basis.push(kind.to_owned());
                }
            }
        }
        let attempts = books.run_dir().join(ATTEMPTS);
        let place = attempts
            .ancestors()
            .find(|folder| folder.is_dir())
            .unwrap_or(Path::new("/"));
        if let Ok(told) = rustix::fs::statvfs(place) {
            room.free_bytes = Some(told.f_bavail * told.f_frsize);
            room.free_inodes = (told.f_files > 0).then_some(told.f_favail);
        }
        Ok(room)
    }

    /// The estimate in words, with a warning if bytes or inodes run short.
    #[must_use]
    pub fn words(&self) -> String {
        let basis = match (self.measured.is_empty(), self.guessed.is_empty()) {
            (_, true) => "estimated from this run's attempts".to_owned(),
            (true, false) => "a guess from the bundled cohort".to_owned(),
            (false, false) => format!(
                "estimated from this run's attempts, guessed for {}",
                self.guessed.join(", ")
            ),
        };
        let inodes = self.inodes;
        let need = in_words(self.bytes);
        let mut words = format!("disk: about {need} and {inodes:.0} inodes to come ({basis})");
        if self.free_bytes.is_some_and(|free| self.bytes > free as f64) {
            let free = in_words(self.free_bytes.unwrap_or(0) as f64);
            words.push_str(&format!("; only {free} are free"));
        }
        if self
            .free_inodes
            .is_some_and(|free| self.inodes > free as f64)
        {
            words.push_str(&format!(
                "; only {} inodes are free",
                self.free_inodes.unwrap_or(0)
            ));
        }
        words
    }
}

/// Mean bytes and inodes of this run's published attempts, by kind.
fn measured(books: &Books) -> BTreeMap<String, (f64, f64)> {
    let mut seen: BTreeMap<String, (usize, f64, f64)> = BTreeMap::new();
    for (key, task) in books.tasks() {
        let Task::Published { generation } = task.state else {
            continue;
        };
        let entry = seen.entry(task.kind.clone()).or_default();
        if entry.0 < ENOUGH
            && let Some((bytes, inodes)) = size(&books.directory(&AttemptId {
                task: key.clone(),
                generation,
            }))
        {
            *entry = (entry.0 + 1, entry.1 + bytes, entry.2 + inodes);
        }
    }
    let means = seen.into_iter().filter(|(_, (n, ..))| *n > 0);
    means
        .map(|(kind, (n, bytes, inodes))| (kind, (bytes / n as f64, inodes / n as f64)))
        .collect()
}

/// Bytes and inodes of a folder with everything in it; `None` if it does not exist (any more).
fn size(folder: &Path) -> Option<(f64, f64)> {
    let (mut bytes, mut inodes) = (0.0, 1.0);
    for entry in fs::read_dir(folder).ok()?.flatten() {
        let Ok(metadata) = entry.metadata() else {
            continue;
        };
        if metadata.is_dir() {
            let (below, count) = size(&entry.path())?;
            (bytes, inodes) = (bytes + below, inodes + count);
        } else {
            (bytes, inodes) = (bytes + metadata.len() as f64, inodes + 1.0);
        }
    }
    Some((bytes, inodes))
}

fn guess(kind: &str, plan: &ResolvedPatient) -> (f64, f64) {
    let known = GUESSED
        .iter()
        .find(|(known, ..)| *known == kind)
        .map(|(_, bytes, inodes)| (*bytes, *inodes));
    let (bytes, inodes) = known.unwrap_or(OTHER);
    let in_3d = plan.settings.solver.fidelity == Fidelity::FiniteElement;
    match kind {
        "organ-beat" if in_3d => {
            let node_ms = f64::from(mesh_size::nodes(plan)) * plan.step0.cycle_length_ms;
            (node_ms * BYTES_PER_NODE_AND_MS, inodes)
        }
        "passive-state" if in_3d => (
            f64::from(mesh_size::nodes(plan)) * STEP0_BYTES_PER_NODE,
            inodes,
        ),
        _ => (bytes, inodes),
    }
}

/// Bytes in MB, and from a gigabyte on in GB.
fn in_words(bytes: f64) -> String {
    if bytes < 1e9 {
        format!("{:.1} MB", 1e-6 * bytes)
    } else {
        format!("{:.1} GB", 1e-9 * bytes)
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_store::Writer;
    use cardiotwin_store::clock;

    use super::*;
    use crate::tests::{Bench, personalised};

    async fn room(bench: &Bench, plans: &[ResolvedPatient]) -> DiskNeed {
        let loaded = Writer::look(bench.path()).await.unwrap();
        let mut books = Books::new(bench.path(), loaded, clock::now_ms()).unwrap();
        crate::decider::Decider::default()
            .take_up(&mut books, plans, &[], &[])
            .unwrap();
        DiskNeed::of(&books, 0..books.patients().len()).unwrap()
    }

    #[tokio::test]
    async fn what_this_run_left_is_measured_and_the_rest_guessed() {
        let first = personalised("P1", 8.0);
        let bench = Bench::new(vec![first.clone()]);
        bench.leaves_files();
        let guess = room(&bench, std::slice::from_ref(&first)).await;
        assert!(
            guess.measured.is_empty() && guess.words().contains("a guess"),
            "{}",
            guess.words()
        );
        bench.run().await;
        let over = room(&bench, std::slice::from_ref(&first)).await;
        assert_eq!(
            (over.bytes, over.inodes),
            (0.0, 0.0),
            "nothing is left to do"
        );
        let both = room(&bench, &[first, personalised("P2", 9.0)]).await;
        // The first patient's fitted cell left step 3 nothing to do.
        assert!(
            both.guessed == ["step3-proposal"] && both.measured.contains(&"organ-beat".to_owned()),
            "{both:?}"
        );
        // Each attempt leaves 6 files and 4 folders, its own included. Three proposals of step 3
        // are guessed.
        let tasks = (both.inodes - 3.0 * 5.0) / 10.0;
        assert!(
            tasks.fract() == 0.0 && (5.0..20.0).contains(&tasks),
            "{} inodes",
            both.inodes
        );
        let mut fine = personalised("P3", 8.0);
        fine.settings.solver.fidelity = Fidelity::FiniteElement;
        fine.settings.solver.finite_element.mesh_nodes = 64_000;
        let fine = room(&Bench::new(vec![]), &[fine]).await;
        assert!(
            fine.bytes > 2e9 && fine.bytes > 1000.0 * guess.bytes.min(1e7),
            "{} bytes in 3D",
            fine.bytes
        );
    }
}
