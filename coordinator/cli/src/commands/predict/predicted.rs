//! An index of a twin with its prediction.

use serde::Serialize;

use super::known::Known;

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
