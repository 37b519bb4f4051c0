//! The wall's surface for the report's picture, read from an artefact of step 1.

use std::path::PathBuf;

use cardiotwin_schemas::formats::{FormatError, HEART};
use cardiotwin_schemas::heart::{HeartBeat, HeartPart, HeartSurface};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::record::{PatientRecord, TaskRecord};

use super::comparison::PatientView;

/// Errors in reading a surface.
#[derive(Debug, thiserror::Error)]
pub enum HeartError {
    /// The file is absent or unreadable.
    #[error("cannot read {file}: {source}")]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is not a surface, or of a later version.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Triangles of the surface name corners that do not exist.
    #[error("{file} is not a surface of a heart: {what}")]
    Content {
        /// Path of the file.
        file: PathBuf,
        /// Description of the problem.
        what: String,
    },
}

/// A surface and the simulation from which it is.
#[derive(Debug, Clone, PartialEq)]
pub struct HeartFile {
    /// Description of the simulation.
    pub name: String,
    /// The surface. The corners of its triangles exist in every state.
    pub heart: HeartSurface,
}

impl HeartFile {
    /// The surface of the twin's beat, or of step 1's result before there is a twin; `None` if neither
    /// left a surface.
    ///
    /// # Errors
    /// [`HeartError`] with the file.
    pub fn read(patient: &PatientRecord) -> Result<Option<Self>, HeartError> {
        let Some((name, run)) = Self::beat(patient) else {
            return Ok(None);
        };
        let Some(file) = run.artefact("heart") else {
            return Ok(None);
        };
        let bytes = match std::fs::read(&file) {
            Ok(bytes) => bytes,
            Err(source) => return Err(HeartError::Read { file, source }),
        };
        let heart: HeartSurface = HEART.read(&file.display(), &bytes)?;
        match wrong(&heart) {
            Some(what) => Err(HeartError::Content { file, what }),
            None => Ok(Some(Self { name, heart })),
        }
    }

    /// The beat whose surface is shown, in words: the twin's, or the result of step 1 where the twin's
    /// beat left none; `None` if no beat left a surface.
    #[must_use]
    pub fn beat(patient: &PatientRecord) -> Option<(String, &TaskRecord<OrganBeatResult>)> {
        let view = PatientView(patient);
        let of_step3 = view.step3_beat().map(|run| {
            let number = patient.step3.as_ref().map_or(0, |s| s.best_iteration);
            (format!("the twin: step 3, beat {number}"), run)
        });
        let verification = || {
            let name = "the twin: step 2's verification beat".to_owned();
            patient.verification.as_ref().map(|run| (name, run))
        };
        let of_step1 = view.best_iteration().and_then(|i| {
            let name = format!("step 1, iteration {}", i.number);
            Some((name, i.run.as_ref()?))
        });
        let twin = of_step3.or_else(verification);
        let all = twin.into_iter().chain(of_step1);
        let mut left = all.filter(|(_, run)| run.artefact("heart").is_some());
        left.next()
    }
}

fn wrong(heart: &HeartSurface) -> Option<String> {
    if heart.states.len() != 2 {
        return Some(format!("{} states, expected 2", heart.states.len()));
    }
    let n = heart.states[0].points_mm.len();
    let even = |s: &cardiotwin_schemas::heart::HeartState| {
        [s.points_mm.len(), s.sa_kpa.len(), s.lambda.len()] == [n; 3]
    };
    if !heart.states.iter().all(even) {
        return Some(format!("a state that does not have {n} corners"));
    }
    let beyond = |parts: &[HeartPart], n: usize| {
        let corners = parts.iter().flat_map(|part| part.triangles.as_flattened());
        corners
            .max()
            .filter(|last| **last as usize >= n)
            .map(|last| format!("corner {last} of {n}"))
    };
    let of_beat = |beat: &HeartBeat| {
        let Some(frames) = beat.frames_mm() else {
            return Some("frames whose points cannot be read".to_owned());
        };
        let (n_frames, n_corners) = (frames.len(), frames[0].len());
        let counts = [&beat.volume_ml, &beat.pressure_mmhg].map(Vec::len);
        let values = [&beat.sa_kpa, &beat.lambda].map(|all| all.values().map(|all| all.len()));
        if counts != [n_frames; 2] || values != [Some(n_frames * n_corners); 2] || n_corners < n {
            return Some(format!(
                "{n_frames} frames of {n_corners} corners without a value for each"
            ));
        }
        beyond(&beat.front, n_corners)
    };
    beyond(&heart.parts, n).or_else(|| heart.beat.as_ref().and_then(of_beat))
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::heart::{HeartState, PackedValues, packed_points};

    use super::*;

    #[test]
    fn numbers_that_point_nowhere_are_refused() {
        let state = HeartState {
            name: "end-diastole".into(),
            time_ms: 0.0,
            volume_ml: 1.0,
            pressure_mmhg: 1.0,
            points_mm: vec![[0.0; 3]; 3],
            sa_kpa: vec![None; 3],
            lambda: vec![None; 3],
        };
        let part = HeartPart {
            surface: "cut".into(),
            contracts: true,
            triangles: vec![[0, 1, 2]],
        };
        let good = HeartSurface {
            schema_version: HEART.version,
            long_axis: [0.0, 0.0, 1.0],
            towards_viewer: [0.0, -1.0, 0.0],
            triangles_before: 1,
            parts: vec![part],
            states: vec![state.clone(), state],
            beat: None,
        };
        assert_eq!(wrong(&good), None);
        let mut bad = good.clone();
        bad.parts[0].triangles[0][2] = 3;
        assert_eq!(wrong(&bad).unwrap(), "corner 3 of 3");
        bad = good.clone();
        bad.states[1].lambda.pop();
        assert!(wrong(&bad).unwrap().contains("does not have 3"));
        let (origin_mm, step_mm, points) = packed_points(&[vec![[0.0; 3]; 3], vec![[1.0; 3]; 3]]);
        let values = PackedValues::of(&[Some(1.0); 6]);
        bad = good.clone();
        bad.beat = Some(HeartBeat {
            time_ms: vec![0.0, 400.0],
            volume_ml: vec![1.0; 2],
            pressure_mmhg: vec![1.0; 2],
            origin_mm,
            step_mm,
            points,
            sa_kpa: values.clone(),
            lambda: values,
            front: vec![],
        });
        assert_eq!(wrong(&bad), None);
        let beat = bad.beat.as_mut().unwrap();
        beat.front.clone_from(&good.parts);
        beat.front[0].triangles[0][0] = 4;
        assert_eq!(wrong(&bad).unwrap(), "corner 4 of 3");
        bad.beat.as_mut().unwrap().lambda = PackedValues::of(&[None; 5]);
        assert!(wrong(&bad).unwrap().contains("2 frames of 3 corners"));
        bad.beat.as_mut().unwrap().points.push('*');
        assert!(wrong(&bad).unwrap().contains("cannot be read"));
        bad = good.clone();
        bad.schema_version += 1;
        let later = serde_json::to_vec(&bad).unwrap();
        let error = HEART.read::<HeartSurface>(&"heart.json", &later);
        assert!(matches!(
            error,
            Err(FormatError::Newer {
                found: 2,
                known: 1,
                ..
            })
        ));
        bad = good;
        bad.states.pop();
        assert!(wrong(&bad).is_some());
    }
}
