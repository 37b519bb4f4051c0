//! Provenance of a result: version, commit, processor, inputs and times.

use std::collections::BTreeMap;
use std::time::Instant;

use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::settings::InstructionSet;
use cardiotwin_schemas::task::{InputFile, OrganBeatSpec, TaskSpec};

use crate::engine::path_in_use;
use crate::{clock, process};

/// Version of the worker.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Commit that the worker was built from; `None` if built outside a checkout.
#[must_use]
pub fn commit() -> Option<&'static str> {
    Some(env!("CARDIOTWIN_COMMIT")).filter(|commit| !commit.is_empty())
}

/// Version and commit as one text.
pub const VERSION_TEXT: &str = env!("CARDIOTWIN_VERSION_TEXT");

/// Start of a task, from which its provenance is computed at the end.
#[derive(Debug)]
pub struct Beginning {
    started: String,
    instant: Instant,
}

impl Beginning {
    /// Records the current time as the start.
    #[must_use]
    pub fn now() -> Self {
        Self {
            started: clock::now(),
            instant: Instant::now(),
        }
    }

    /// Provenance of `task`; called at its end.
    #[must_use]
    pub fn provenance(
        &self,
        task: &TaskSpec,
        threads: u32,
        instruction_set: InstructionSet,
    ) -> Provenance {
        Provenance {
            version: VERSION.to_owned(),
            commit: commit().map(ToOwned::to_owned),
            inputs: inputs(task)
                .into_iter()
                .map(|file| (file.name.clone(), file.sha256.clone()))
                .collect(),
            seed: match task {
                TaskSpec::CellFit(spec) => Some(spec.seed),
                TaskSpec::Discover(spec) => Some(spec.seed),
                TaskSpec::Step1Proposal(spec) => Some(spec.seed),
                TaskSpec::Step3Proposal(spec) => Some(spec.seed),
                TaskSpec::Posterior(spec) => Some(spec.seed),
                TaskSpec::CellSweep(spec) => spec.design.scramble_seed,
                _ => None,
            },
            threads,
            ranks: 1,
            host: cardiotwin_protocol::process::host().to_owned(),
            arithmetic: match task {
                TaskSpec::CellFit(_) => {
                    format!("{}, {}", arithmetic(), path_in_use(instruction_set))
                }
                _ => arithmetic(),
            },
            started: self.started.clone(),
            wall_s: self.instant.elapsed().as_secs_f64(),
            cpu_s: process::cpu_s(),
            peak_memory_mb: process::peak_memory_mb(),
        }
    }
}

/// The files that a task reads.
#[must_use]
pub fn inputs(task: &TaskSpec) -> Vec<&InputFile> {
    match task {
        TaskSpec::PassiveState(spec) => spec.pressure.iter().chain(&spec.volume).collect(),
        TaskSpec::Targets(spec) => vec![&spec.nodal],
        TaskSpec::CellFit(spec) => spec.calcium.iter().collect(),
        TaskSpec::OrganBeat(spec) => calcium(spec),
        // Only figures of the mesh are used, and the specification holds them.
        TaskSpec::Step3Proposal(spec) => with_prior(&spec.beat, spec.prior.as_ref()),
        TaskSpec::Posterior(spec) => with_prior(&spec.beat, spec.prior.as_ref()),
        TaskSpec::Discover(spec) => spec.files(),
        TaskSpec::LearnLaw(spec) => spec.start.iter().collect(),
        TaskSpec::Step1Proposal(spec) => spec.prior.iter().collect(),
        TaskSpec::CellSweep(_) | TaskSpec::Noop(_) => Vec::new(),
    }
}

/// Calcium transient of a beat's cells and file of the law before the first beat.
fn with_prior<'a>(beat: &'a OrganBeatSpec, prior: Option<&'a InputFile>) -> Vec<&'a InputFile> {
    calcium(beat).into_iter().chain(prior).collect()
}

/// Calcium transient of a beat's cells, if it is an input file.
fn calcium(beat: &OrganBeatSpec) -> Vec<&InputFile> {
    match &beat.contraction {
        ContractionSpec::Land2017Trace { calcium, .. } => vec![calcium],
        ContractionSpec::Tanh { .. }
        | ContractionSpec::Land2017Rice { .. }
        | ContractionSpec::Catalogue { .. } => Vec::new(),
    }
}

/// Instruction set that the kernels were compiled for. Results are reproducible bit for bit only
/// within one instruction set.
fn arithmetic() -> String {
    let set: BTreeMap<&str, bool> = [
        ("avx2", cfg!(target_feature = "avx2")),
        ("fma", cfg!(target_feature = "fma")),
    ]
    .into();
    let extensions: Vec<&str> = set
        .into_iter()
        .filter_map(|(name, on)| on.then_some(name))
        .collect();
    match extensions.as_slice() {
        [] => format!("{} scalar", std::env::consts::ARCH),
        list => format!("{} {}", std::env::consts::ARCH, list.join(" ")),
    }
}
