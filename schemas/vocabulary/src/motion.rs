//! Measures of the motion of a simulated ventricle.
//!
//! `cardiotwin_mechanics::organ::motion` measures it on a finite-element ventricle. The long axis
//! points from the middle of the rim to the endocardial apex. The middle, apical and basal levels
//! lie at 50, 25 and 75 % of it from the apex. End-diastole is the beginning of the beat and
//! end-systole the smallest volume (t5). Isovolumic contraction ends at t4, isovolumic relaxation
//! at t6.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Motion of a finite-element ventricle in a beat. Percentages refer to end-diastole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct MotionMeasures {
    /// Mean displacement of the rim towards the apex, from end-diastole to end-systole.
    pub base_descent_mm: f64,
    /// Displacement of the epicardial apex towards the base, from end-diastole to end-systole.
    pub apex_rise_mm: f64,
    /// Change of the mean epicardial radius at the middle level.
    pub epicardial_radius_change_percent: f64,
    /// Shortening of the cavity between the endocardial apex and the middle of the rim.
    pub shortening_percent: f64,
    /// Thickening of the wall at the middle level, where the thickness is the mean epicardial minus
    /// the mean endocardial radius.
    pub wall_thickening_percent: f64,
    /// Largest difference between apical and basal rotation of the epicardium, counter-clockwise as
    /// seen from the apex.
    pub twist_epi_deg: f64,
    /// Largest difference between apical and basal rotation of the endocardium, counter-clockwise
    /// as seen from the apex.
    pub twist_endo_deg: f64,
    /// Change of the cavity's length over isovolumic contraction.
    pub isovolumic_lengthening_percent: f64,
    /// Share of the largest epicardial twist that is undone during isovolumic relaxation; absent if
    /// filling did not begin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isovolumic_untwisting_percent: Option<f64>,
    /// Smallest cavity pressure.
    #[serde(rename = "least_pressure_mmHg")]
    pub least_pressure_mmhg: f64,
    /// Smallest ratio of an element's volume to its unloaded volume, sampled every 5 ms.
    pub least_volume_ratio: f64,
    /// Largest ratio of an element's volume to its unloaded volume, sampled every 5 ms.
    pub largest_volume_ratio: f64,
}
