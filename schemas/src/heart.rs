//! The file `heart.json`: the wall of a finite-element ventricle, cut open, at instants of its last
//! beat. It is meant for pictures.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Surface of the half of the wall behind a plane through the long axis, in several states, with
/// fewer triangles than the mesh.
///
/// The cut goes through the same tissue in each state. Positions are rounded to 0.01 mm, stress to
/// 0.01 kPa, stretch to 0.0001.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct HeartSurface {
    /// Format version.
    pub schema_version: u32,
    /// Unit vector from apex to base.
    pub long_axis: [f64; 3],
    /// Unit vector out of the cut, towards the viewer.
    pub towards_viewer: [f64; 3],
    /// Number of triangles of this surface before it was simplified.
    pub triangles_before: u64,
    /// Parts of the surface. The normals of their triangles point out of the tissue.
    pub parts: Vec<HeartPart>,
    /// End-diastole first, then end-systole, which is the smallest volume of the last beat to
    /// within half a percent of the stroke volume.
    pub states: Vec<HeartState>,
}

/// A part of the surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct HeartPart {
    /// Name of the surface in the mesh, or `cut`.
    pub surface: String,
    /// Whether the tissue contracts; the aortic root does not.
    pub contracts: bool,
    /// Indices of each triangle's corners, from 0.
    pub triangles: Vec<[u32; 3]>,
}

/// State at one instant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct HeartState {
    /// `end-diastole` or `end-systole`.
    pub name: String,
    /// Time in the beat.
    pub time_ms: f64,
    /// Cavity volume.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Cavity pressure.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: f64,
    /// Positions of the corners.
    pub points_mm: Vec<[f64; 3]>,
    /// Active stress at the corners; absent where the tissue does not contract.
    #[serde(rename = "Sa_kPa")]
    pub sa_kpa: Vec<Option<f64>>,
    /// Fibre stretch from end-diastole at the corners; absent where the tissue does not contract.
    pub lambda: Vec<Option<f64>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heart_survives_json_and_unknown_keys_are_refused() {
        let state = HeartState {
            name: "end-diastole".into(),
            time_ms: 0.0,
            volume_ml: 120.5,
            pressure_mmhg: 7.0,
            points_mm: vec![[0.0, 1.25, -3.5]],
            sa_kpa: vec![None],
            lambda: vec![Some(1.0)],
        };
        let part = HeartPart {
            surface: "cut".into(),
            contracts: true,
            triangles: vec![[0, 0, 0]],
        };
        let heart = HeartSurface {
            schema_version: crate::formats::HEART.version,
            long_axis: [0.0, 0.0, 1.0],
            towards_viewer: [0.0, -1.0, 0.0],
            triangles_before: 1,
            parts: vec![part],
            states: vec![state],
        };
        let text = serde_json::to_string(&heart).unwrap();
        assert!(
            text.contains("\"Sa_kPa\":[null]") && text.contains("\"volume_mL\":120.5"),
            "{text}"
        );
        assert_eq!(serde_json::from_str::<HeartSurface>(&text).unwrap(), heart);
        assert!(
            serde_json::from_str::<HeartSurface>(&text.replace("\"lambda\"", "\"stretch\""))
                .is_err()
        );
    }
}
