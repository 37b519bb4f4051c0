//! A file of the input with the hash of its content.

use std::path::{Path, PathBuf};

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::Problem;

use super::report::Report;

/// A file with its hash. A file that cannot be read becomes a problem in `report`.
pub(super) fn hash(
    name: &str,
    path: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<InputFile> {
    hash_and_read(name, path, patient, report).map(|(file, _)| file)
}

/// A file with its hash, and its content. A file that cannot be read becomes a problem in `report`.
pub(super) fn hash_and_read(
    name: &str,
    path: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<(InputFile, Vec<u8>)> {
    let read = || -> std::io::Result<(PathBuf, Vec<u8>)> {
        Ok((
            path.canonicalize()?,
            input_files::read(path, MaxBytes::MESH)?,
        ))
    };
    match read() {
        Ok((absolute, bytes)) => {
            let file = InputFile {
                name: name.to_owned(),
                path: absolute,
                sha256: sha256_hex(&bytes),
            };
            Some((file, bytes))
        }
        Err(error) => {
            let found = format!("no readable file ({error})");
            let problem = Problem::error(
                path,
                found,
                "a file",
                "check its name in patient.toml and its permissions",
            );
            report.add(Some(patient), problem);
            None
        }
    }
}
