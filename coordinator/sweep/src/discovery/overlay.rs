//! `model.toml` next to `patient.toml`: versions of the effects accepted for a patient.
//! `patient.toml` and traces stay as they are.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::discover::DiscoverCase;
use cardiotwin_schemas::overlay::{Acceptance, AcceptedEvidence, ModelOverlay};

use cardiotwin_report::results::atomic;

/// Name of the file that holds the current version.
const FILE: &str = "model.toml";
/// First lines of the file.
const HEAD: &str = "# Written by `cardiotwin discover --accept`; the next `cardiotwin run` \
                    personalises with it, and `cardiotwin discover --revert`\n\
                    # undoes it. Measured data are never changed. Older versions: model.vN.toml\n";

/// Errors in accepting or reverting a version.
#[derive(Debug, thiserror::Error)]
pub enum OverlayError {
    /// A file cannot be read or written.
    #[error("cannot {what} {path}")]
    File {
        /// Verb of the operation, as in "cannot read".
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The file is not an overlay.
    #[error("{path} is not a valid patient model: correct it, or move it aside")]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Position and reason of the parser's error.
        source: Box<toml::de::Error>,
    },
    /// No acceptance is current that could be undone.
    #[error("{path} was not written by `discover --accept`: nothing to revert")]
    NothingAccepted {
        /// Path of the file.
        path: PathBuf,
    },
}

/// Effect of an operation on the current version.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// A new version with this number is current.
    Written(u32),
    /// The current version, with this number, comes from the same search already.
    Same(u32),
    /// No version is current any more, and the patient is as measured.
    Removed,
    /// The search accepted nothing, so there is nothing to write.
    Nothing,
}

/// Writes the accepted effects of a search as the patient's next version.
///
/// - `now`: UTC, RFC 3339
///
/// # Errors
/// [`OverlayError`] if the folder cannot be written or its file is not an overlay.
pub fn accept(folder: &Path, case: &DiscoverCase, now: &str) -> Result<Change, OverlayError> {
    let found = &case.found;
    if found.findings.none {
        return Ok(Change::Nothing);
    }
    let current = current(folder)?;
    if let Some(current) = &current
        && current.from == from(case)
        && current.accepted.is_some()
    {
        return Ok(Change::Same(current.version));
    }
    let before = current.as_ref().map(|current| current.version);
    let overlay = ModelOverlay {
        version: kept_versions(folder).max(before.unwrap_or(0)) + 1,
        written: now.to_owned(),
        ..proposed(case, before)
    };
    keep(folder, current.as_ref())?;
    write(folder, &overlay)
}

/// The model with the accepted effects of a search, as the first version of the patient's file.
///
/// - `before`: version that is current so far
#[must_use]
pub fn proposed(case: &DiscoverCase, before: Option<u32>) -> ModelOverlay {
    let found = &case.found;
    let evidence = found
        .findings
        .effects
        .iter()
        .filter(|effect| found.findings.accepted.contains(&effect.name));
    ModelOverlay {
        version: 1,
        patient: case.case.clone(),
        written: String::new(),
        from: from(case),
        afterload: Some(found.model.afterload),
        left_atrial_pressure_mmhg: Some(found.model.left_atrial_pressure_mmhg),
        passive: Some(found.model.passive),
        tanh: None,
        valves: None,
        cell: Default::default(),
        effects: found.model.effects.clone(),
        corrections: found.model.corrections.clone(),
        accepted: Some(Acceptance {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            before,
            seed: found.seed,
            threshold: found.findings.threshold,
            p_value: found.findings.p_value,
            gap_before: found.findings.gap_before,
            gap_after: found.findings.gap_after,
            gap_heldout_before: found.findings.gap_heldout_before,
            gap_heldout_after: found.findings.gap_heldout_after,
            settings: found.settings.clone(),
            data: found.data.clone(),
            evidence: evidence
                .map(|effect| AcceptedEvidence {
                    name: effect.name.clone(),
                    probability: effect.probability,
                    delta_bic: effect.delta_bic,
                    log_evidence: effect.log_evidence,
                    interval: effect.interval.clone(),
                })
                .collect(),
        }),
    }
}

fn from(case: &DiscoverCase) -> BTreeMap<String, String> {
    [("discover".to_owned(), case.task.clone())].into()
}

/// Undoes the last acceptance. The version before it becomes current again, under a new number.
///
/// # Errors
/// [`OverlayError::NothingAccepted`] if no acceptance is current, and the errors of [`accept`].
pub fn revert(folder: &Path, now: &str) -> Result<Change, OverlayError> {
    let path = folder.join(FILE);
    let current = current(folder)?;
    let Some((overlay, acceptance)) =
        current.and_then(|c| c.accepted.clone().map(|accepted| (c, accepted)))
    else {
        return Err(OverlayError::NothingAccepted { path });
    };
    keep(folder, Some(&overlay))?;
    let Some(before) = acceptance.before else {
        std::fs::remove_file(&path).map_err(|source| OverlayError::File {
            what: "remove",
            path,
            source,
        })?;
        return Ok(Change::Removed);
    };
    let earlier = read(&folder.join(format!("model.v{before}.toml")))?;
    let earlier = earlier.ok_or_else(|| OverlayError::File {
        what: "read",
        path: folder.join(format!("model.v{before}.toml")),
        source: io::ErrorKind::NotFound.into(),
    })?;
    let version = kept_versions(folder).max(overlay.version) + 1;
    write(
        folder,
        &ModelOverlay {
            version,
            written: now.to_owned(),
            ..earlier
        },
    )
}

fn current(folder: &Path) -> Result<Option<ModelOverlay>, OverlayError> {
    read(&folder.join(FILE))
}

fn read(path: &Path) -> Result<Option<ModelOverlay>, OverlayError> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(OverlayError::File {
                what: "read",
                path: path.to_owned(),
                source,
            });
        }
    };
    let overlay = toml::from_str(&text).map_err(|source| OverlayError::Format {
        path: path.to_owned(),
        source: Box::new(source),
    })?;
    Ok(Some(overlay))
}

/// Copies the current version to its own name, byte for byte.
fn keep(folder: &Path, current: Option<&ModelOverlay>) -> Result<(), OverlayError> {
    let Some(current) = current else {
        return Ok(());
    };
    let (from, to) = (
        folder.join(FILE),
        folder.join(format!("model.v{}.toml", current.version)),
    );
    let bytes = std::fs::read(&from).map_err(|source| OverlayError::File {
        what: "read",
        path: from,
        source,
    })?;
    atomic::write(&to, |out| out.write_all(&bytes)).map_err(|source| OverlayError::File {
        what: "write",
        path: to,
        source,
    })
}

fn write(folder: &Path, overlay: &ModelOverlay) -> Result<Change, OverlayError> {
    let path = folder.join(FILE);
    let failed = |source| OverlayError::File {
        what: "write",
        path: path.clone(),
        source,
    };
    let text = toml::to_string(overlay)
        .map_err(|error| failed(io::Error::new(io::ErrorKind::InvalidData, error)))?;
    atomic::write(&path, |out| {
        out.write_all(format!("{HEAD}{text}").as_bytes())
    })
    .map_err(failed)?;
    Ok(Change::Written(overlay.version))
}

/// Highest N of the files `model.vN.toml`; 0 without any.
fn kept_versions(folder: &Path) -> u32 {
    let number = |name: &str| {
        name.strip_prefix("model.v")?
            .strip_suffix(".toml")?
            .parse::<u32>()
            .ok()
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| number(&entry.file_name().to_string_lossy()))
        .max()
        .unwrap_or(0)
}

#[cfg(test)]
mod tests;
