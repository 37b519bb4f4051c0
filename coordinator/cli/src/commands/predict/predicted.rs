//! An index of a twin with its prediction.

use serde::Serialize;

/// What a prediction knows of the change of an index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// Its size, as the band says: the band has one direction.
    Size,
    /// Its direction only: the band has both, but the predicted one was right on hearts of other formulations.
    Direction,
    /// Neither.
    Neither,
}

impl Known {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Size => "size",
            Self::Direction => "direction only",
            Self::Neither => "neither",
        }
    }

    /// Mark behind a value.
    pub fn mark(self) -> &'static str {
        match self {
            Self::Size => "",
            Self::Direction => " ~",
            Self::Neither => " ?",
        }
    }
}

/// An index of the twin and its prediction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Predicted {
    /// Name of the index, with its unit.
    pub name: &'static str,
    /// Value in the twin's own beat.
    pub twin: Option<f64>,
    /// (after − before) / before of the periodic states; of the end-systolic volume the change that follows
    /// from those of the end-diastolic volume and of the stroke.
    pub relative_change: Option<f64>,
    /// The twin's value with `relative_change` applied.
    pub predicted: Option<f64>,
    /// 90 % band around `predicted`: `band_within_model`, and the discrepancy between formulations where it was learnt.
    pub band: Option<[f64; 2]>,
    /// 5th and 95th percentile of the changes of draws of the twin's posterior, moved so that `predicted`
    /// is their median; `None` without enough draws.
    pub band_within_model: Option<[f64; 2]>,
    /// What the prediction knows of the change; `None` where the discrepancy was not learnt.
    pub known: Option<Known>,
    /// Value in the periodic state of the simulated ventricle before the change.
    pub simulated_before: Option<f64>,
    /// Value in the periodic state of the simulated ventricle after the change.
    pub simulated_after: Option<f64>,
}
