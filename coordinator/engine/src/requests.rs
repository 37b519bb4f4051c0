//! Requests of other processes to a running coordinator: files in `requests/`, placed by rename,
//! applied at the next tick, removed after the commit. A request that is applied twice has no
//! second effect.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use cardiotwin_protocol::files;
use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::formats::REQUEST;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_store::clock;
use cardiotwin_workflow::patient::Stage;
use serde::{Deserialize, Serialize};

use super::books::Books;
use super::decider::Decider;
use super::{EngineError, EngineEvent};

const FOLDER: &str = "requests";

/// A change requested by a person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// Change settings from a stage on.
    Rerun {
        /// Patient whose settings change.
        patient: PatientId,
        /// First stage to which the settings apply.
        from: Stage,
        /// Settings that override all other layers.
        overrides: Box<SettingsLayer>,
    },
    /// Try the failed tasks again.
    Retry {
        /// Patient whose tasks failed.
        patient: PatientId,
    },
    /// Cancel a patient, or the whole run.
    Cancel {
        /// Patient to cancel; `None` means all.
        patient: Option<PatientId>,
    },
}

/// Places a request where the running coordinator finds it.
pub fn put(run_dir: &Path, request: &Request) -> Result<(), EngineError> {
    let folder = run_dir.join(FOLDER);
    let file = |what, path: &Path| {
        let path = path.to_owned();
        move |source| EngineError::File { what, path, source }
    };
    fs::create_dir_all(&folder).map_err(file("create", &folder))?;
    // Names sort by time; process id and number keep the requests of one millisecond apart.
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let (now_ms, pid) = (clock::now_ms(), std::process::id());
    let name = format!("{now_ms:015}-{pid}-{number:06}");
    let path = folder.join(format!("{name}.json"));
    let text = serde_json::to_vec(request).expect("a request is JSON");
    files::replace(&path, &text).map_err(file("write", &path))
}

/// A request's file, and its content or the reason why it cannot be read.
pub type Pending = (PathBuf, Result<Request, String>);

/// All pending requests, in the order in which they were made.
pub fn pending(run_dir: &Path) -> Result<Vec<Pending>, EngineError> {
    let folder = run_dir.join(FOLDER);
    let entries = match fs::read_dir(&folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => {
            return Err(EngineError::File {
                what: "list",
                path: folder,
                source,
            });
        }
    };
    let mut paths: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == "json"))
        .collect();
    paths.sort();
    Ok(paths
        .into_iter()
        .map(|path| {
            let read = fs::read(&path).map_err(|e| e.to_string());
            let request = read.and_then(|bytes| {
                let request = REQUEST.read(&path.display(), &bytes);
                request.map_err(|error| error.in_full())
            });
            (path, request)
        })
        .collect())
}

/// Applies pending requests. Returns events, and the files to remove after the commit.
pub fn apply(
    books: &mut Books,
    decider: &mut Decider,
    pending: Vec<Pending>,
) -> Result<(Vec<EngineEvent>, Vec<PathBuf>), EngineError> {
    let (mut told, mut paths) = (Vec::new(), Vec::new());
    for (path, request) in pending {
        let text = match request {
            Ok(request) => match decider.request(books, &request) {
                Ok(changes) => changes.join("; "),
                Err(EngineError::Request { message }) => format!("request refused: {message}"),
                Err(other) => return Err(other),
            },
            Err(error) => format!("{} cannot be read: {error}", path.display()),
        };
        told.push(EngineEvent::Request { text });
        paths.push(path);
    }
    Ok((told, paths))
}

/// Removes the files of requests that were applied.
pub fn remove(paths: &[PathBuf]) -> Result<(), EngineError> {
    for path in paths {
        match fs::remove_file(path) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(source) => {
                return Err(EngineError::File {
                    what: "remove",
                    path: path.clone(),
                    source,
                });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_request_is_read_as_it_was_written() {
        let golden: serde_json::Value =
            serde_json::from_str(include_str!("golden/requests.json")).unwrap();
        let read: Vec<Request> = serde_json::from_value(golden.clone()).unwrap();
        assert_eq!(serde_json::to_value(&read).unwrap(), golden);
        assert!(matches!(
            read[..],
            [
                Request::Rerun { .. },
                Request::Retry { .. },
                Request::Cancel { .. },
                Request::Cancel { patient: None }
            ]
        ));
    }

    #[test]
    fn requests_of_one_moment_are_all_kept_in_their_order() {
        let run = tempfile::tempdir().unwrap();
        let asked: Vec<Request> = (0..200)
            .map(|n| Request::Retry {
                patient: PatientId(format!("P{n}")),
            })
            .collect();
        asked.iter().for_each(|one| put(run.path(), one).unwrap());
        let found: Vec<Request> = pending(run.path())
            .unwrap()
            .into_iter()
            .map(|(_, request)| request.unwrap())
            .collect();
        assert_eq!(found, asked);
    }

    #[test]
    fn a_request_that_asks_for_more_than_is_known_is_refused() {
        let run = tempfile::tempdir().unwrap();
        fs::create_dir(run.path().join(FOLDER)).unwrap();
        let text = r#"{"request":"retry","patient":"P1","of_tomorrow":1}"#;
        fs::write(run.path().join(FOLDER).join("1.json"), text).unwrap();
        let error = pending(run.path()).unwrap().remove(0).1.unwrap_err();
        assert!(error.contains("unknown field `of_tomorrow`"), "{error}");
    }
}
