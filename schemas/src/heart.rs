//! The file `heart.json`: the wall of a finite-element ventricle, cut open, at instants of its last
//! beat. It is meant for pictures, and its frames for a picture that moves.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
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
    /// Version of this file's format.
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
    /// Frames over the last beat; absent in files of earlier programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beat: Option<HeartBeat>,
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
    /// Volume of the ventricle's cavity.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Pressure in the ventricle's cavity.
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

/// Frames of the surface at even times of a beat, both of its ends included.
///
/// The corners of a frame are those of a state, followed by those of the half in front of the cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct HeartBeat {
    /// Time of each frame in the beat.
    pub time_ms: Vec<f64>,
    /// Cavity volume in each frame.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Vec<f64>,
    /// Cavity pressure in each frame.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Vec<f64>,
    /// Position that the numbers in `points` count from.
    pub origin_mm: [f64; 3],
    /// Length of one count.
    pub step_mm: f64,
    /// Positions in steps from the origin: signed integers of 16 bits in little endian and base64,
    /// x, y and z of each corner, frame after frame.
    pub points: String,
    /// Active stress at the corners of each frame.
    #[serde(rename = "Sa_kPa")]
    pub sa_kpa: PackedValues,
    /// Fibre stretch from end-diastole at the corners of each frame.
    pub lambda: PackedValues,
    /// Parts of the half in front of the cut, without the cut.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub front: Vec<HeartPart>,
}

/// Values of a quantity at the corners of all frames, frame after frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PackedValues {
    /// Value of byte 0.
    pub least: f64,
    /// Value of byte 254.
    pub most: f64,
    /// A byte for each value, in base64; 255 where the tissue does not contract.
    pub values: String,
}

/// Byte of a missing value.
const ABSENT: u8 = u8::MAX;

/// Numbers in steps from an origin, packed as in [`HeartBeat`]: origin, length of a step, text.
///
/// - `frames_mm`: positions of the corners in each frame
#[must_use]
pub fn packed_points(frames_mm: &[Vec<[f64; 3]>]) -> ([f64; 3], f64, String) {
    let all = || frames_mm.iter().flatten();
    let end = |i: usize, worse: fn(f64, f64) -> f64, from: f64| {
        all().fold(from, |end, point| worse(end, point[i]))
    };
    let lows: [f64; 3] = std::array::from_fn(|i| end(i, f64::min, f64::INFINITY));
    let highs: [f64; 3] = std::array::from_fn(|i| end(i, f64::max, f64::NEG_INFINITY));
    // Whole micrometres keep the file's text short.
    let middle = |i: usize| ((lows[i] + highs[i]) * 500.0).round() / 1000.0;
    let origin: [f64; 3] = if all().next().is_some() {
        std::array::from_fn(middle)
    } else {
        [0.0; 3]
    };
    let reach = all().fold(0.0_f64, |reach, point| {
        (0..3).fold(reach, |reach, i| reach.max((point[i] - origin[i]).abs()))
    });
    let step = (reach / f64::from(i16::MAX)).max(1e-6);
    let bytes: Vec<u8> = all()
        .flat_map(|point| std::array::from_fn::<f64, 3, _>(|i| (point[i] - origin[i]) / step))
        .flat_map(|count| (count.round() as i16).to_le_bytes())
        .collect();
    (origin, step, STANDARD.encode(bytes))
}

impl PackedValues {
    /// Packs the values of all frames.
    #[must_use]
    pub fn of(values: &[Option<f64>]) -> Self {
        let present = || values.iter().flatten().copied();
        let (least, most) = present().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| {
            (lo.min(x), hi.max(x))
        });
        let (least, most) = if least <= most {
            (least, most)
        } else {
            (0.0, 0.0)
        };
        let width = if most > least { most - least } else { 1.0 };
        let byte = |value: &Option<f64>| {
            value.map_or(ABSENT, |x| {
                ((x - least) / width * f64::from(ABSENT - 1)).round() as u8
            })
        };
        Self {
            least,
            most,
            values: STANDARD.encode(values.iter().map(byte).collect::<Vec<u8>>()),
        }
    }

    /// The values, frame after frame; `None` if the text is not base64.
    #[must_use]
    pub fn values(&self) -> Option<Vec<Option<f64>>> {
        let value = |byte: u8| {
            let share = f64::from(byte) / f64::from(ABSENT - 1);
            (byte != ABSENT).then_some(self.least + (self.most - self.least) * share)
        };
        let bytes = STANDARD.decode(&self.values).ok()?;
        Some(bytes.into_iter().map(value).collect())
    }
}

impl HeartBeat {
    /// Positions of the corners in each frame; `None` if the text is not base64, or not a whole
    /// number of corners for each frame.
    #[must_use]
    pub fn frames_mm(&self) -> Option<Vec<Vec<[f64; 3]>>> {
        let bytes = STANDARD.decode(&self.points).ok()?;
        let n_frames = self.time_ms.len();
        if n_frames == 0 || bytes.is_empty() || bytes.len() % (6 * n_frames) != 0 {
            return None;
        }
        let place = |corner: &[u8]| {
            std::array::from_fn(|i| {
                let count = i16::from_le_bytes([corner[2 * i], corner[2 * i + 1]]);
                self.origin_mm[i] + self.step_mm * f64::from(count)
            })
        };
        let frames = bytes.chunks_exact(bytes.len() / n_frames);
        Some(
            frames
                .map(|frame| frame.chunks_exact(6).map(place).collect())
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_frames_keep_their_values() {
        let frames = vec![
            vec![[-60.0, 10.0, 0.0], [60.0, 12.5, -80.0]],
            vec![[-50.0, 11.0, 1.0], [55.0, 12.0, -75.25]],
        ];
        let (origin_mm, step_mm, points) = packed_points(&frames);
        assert!(step_mm < 0.002, "{step_mm}");
        let stress = [Some(0.0), None, Some(47.3), Some(12.0)];
        let sa_kpa = PackedValues::of(&stress);
        for (found, given) in std::iter::zip(sa_kpa.values().unwrap(), stress) {
            assert_eq!(found.is_some(), given.is_some());
            assert!((found.unwrap_or(0.0) - given.unwrap_or(0.0)).abs() <= 47.3 / 500.0);
        }
        let even = PackedValues::of(&[Some(1.0), Some(1.0)]);
        assert_eq!(even.values().unwrap(), [Some(1.0), Some(1.0)]);
        let beat = HeartBeat {
            time_ms: vec![0.0, 400.0],
            volume_ml: vec![120.0, 60.0],
            pressure_mmhg: vec![8.0, 90.0],
            origin_mm,
            step_mm,
            points,
            lambda: sa_kpa.clone(),
            sa_kpa,
            front: vec![],
        };
        let found = beat.frames_mm().unwrap();
        for (found, given) in std::iter::zip(found.iter().flatten(), frames.iter().flatten()) {
            assert!((0..3).all(|i| (found[i] - given[i]).abs() <= 0.5 * step_mm + 1e-12));
        }
        let cut_short = HeartBeat {
            points: beat.points[4..].to_owned(),
            ..beat
        };
        assert_eq!(cut_short.frames_mm(), None);
    }

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
            beat: None,
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
