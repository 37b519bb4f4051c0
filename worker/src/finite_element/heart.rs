//! `heart.json`: surface of the wall, cut open along the long axis, at the beginning of the last
//! beat, at the end of its ejection, and in frames over the beat.

use cardiotwin_mesh::cutaway::{Corner, Half, Plane, Side, cut};
use cardiotwin_mesh::decimate::decimate;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names, tags};
use cardiotwin_mesh::vec3::{
    Vec3, any_perpendicular, axpy, cross, distance, reject, scale, sub, unit,
};
use cardiotwin_models::beat::BeatTraces;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::heart::{
    HeartBeat, HeartPart, HeartState, HeartSurface, PackedValues, packed_points,
};

use super::shapes::{Shape, Shapes};

/// Approximate number of triangles of each half after decimation: four pictures then take less than
/// 150 kB together, and the frames less than 300 kB.
const TRIANGLES: usize = 850;
/// Distance of the plane from the axis, in edge lengths, chosen so that no node of a regular mesh
/// lies in the plane.
const BESIDE_THE_AXIS: f64 = 0.3;

/// The wall of a mesh, cut open and thinned out.
#[derive(Debug)]
pub struct Wall {
    view: View,
    /// Corners of the half behind the cut, followed by those of the half in front of it.
    corners: Vec<Corner>,
    /// Number of corners behind the cut.
    n_behind: usize,
    behind: Vec<HeartPart>,
    front: Vec<HeartPart>,
    triangles_before: usize,
    n_nodes: usize,
}

/// Active stress \[kPa\] and stretch of the nodes with nodal traces.
pub type Fields = [Vec<f64>; 2];

impl Wall {
    /// Cuts the mesh open; `None` if it has no cavity to look into.
    #[must_use]
    pub fn of(mesh: &TetMesh) -> Option<Self> {
        let view = View::of(mesh)?;
        let opposite = Plane {
            point: view.plane.point,
            normal: scale(view.plane.normal, -1.0),
        };
        let half = cut(mesh, &view.plane);
        let mut corners = Vec::new();
        let behind = parts(mesh, &half, TRIANGLES, |_| true, &mut corners);
        let n_behind = corners.len();
        let not_cut = |side| side != Side::Cut;
        let front_half = cut(mesh, &opposite);
        let front = parts(mesh, &front_half, TRIANGLES, not_cut, &mut corners);
        Some(Self {
            view,
            corners,
            n_behind,
            behind,
            front,
            triangles_before: half.triangles.len(),
            n_nodes: mesh.n_nodes(),
        })
    }

    /// Positions of the corners.
    ///
    /// - `unloaded`: unloaded positions of the mesh's nodes \[mm\], three numbers per node; further
    ///   values are ignored
    /// - `u`: displacement of the nodes \[mm\]
    #[must_use]
    pub fn places(&self, unloaded: &[f64], u: &[f64]) -> Vec<Vec3> {
        let at: Vec<f64> = unloaded.iter().zip(u).map(|(x, u)| x + u).collect();
        let at = at.as_chunks::<3>().0;
        self.corners.iter().map(|corner| corner.at(at)).collect()
    }

    /// Values at the corners. Between muscle and tissue without a value, the value of the muscle
    /// holds.
    ///
    /// - `nodes`: nodes with a value
    fn field(&self, nodes: &[u32], values: &[f64]) -> Vec<Option<f64>> {
        let mut all = vec![None; self.n_nodes];
        for (node, value) in nodes.iter().zip(values) {
            all[*node as usize] = Some(*value);
        }
        let at_corner = |corner: &Corner| {
            let (from, to) = (all[corner.from as usize], all[corner.to as usize]);
            let (from, to) = (from.or(to)?, to.or(from)?);
            Some(from + corner.share * (to - from))
        };
        self.corners.iter().map(at_corner).collect()
    }

    fn state(
        &self,
        beat: &Beat<'_>,
        name: &str,
        shape: &Shape,
        fields: &Fields,
    ) -> Option<HeartState> {
        let (traces, k) = (beat.traces, shape.sample);
        let rounded_field = |values: &[f64], scale: f64| -> Vec<Option<f64>> {
            let mut all = self.field(beat.nodes, values);
            all.truncate(self.n_behind);
            all.into_iter()
                .map(|value| value.map(|value| rounded(value, scale)))
                .collect()
        };
        let mut points = self.places(beat.unloaded, &shape.u);
        points.truncate(self.n_behind);
        let [stress, stretch] = fields;
        Some(HeartState {
            name: name.to_owned(),
            time_ms: *traces.time_ms.get(k)?,
            volume_ml: *traces.volume_ml.get(k)?,
            pressure_mmhg: *traces.pressure_mmhg.get(k)?,
            points_mm: points
                .into_iter()
                .map(|point| point.map(|x| rounded(x, 1e2)))
                .collect(),
            sa_kpa: rounded_field(stress, 1e2),
            lambda: rounded_field(stretch, 1e4),
        })
    }

    fn beat(&self, beat: &Beat<'_>, frames: &[Frame], fields: &[Fields]) -> Option<HeartBeat> {
        let of = |trace: &[f64], scale: f64| -> Option<Vec<f64>> {
            let value = |frame: &Frame| Some(rounded(*trace.get(frame.sample)?, scale));
            frames.iter().map(value).collect()
        };
        let values = |which: usize| {
            let of_frame = |fields: &Fields| self.field(beat.nodes, &fields[which]);
            PackedValues::of(&fields.iter().flat_map(of_frame).collect::<Vec<_>>())
        };
        let places: Vec<Vec<Vec3>> = frames.iter().map(|frame| frame.places.clone()).collect();
        let (origin_mm, step_mm, points) = packed_points(&places);
        Some(HeartBeat {
            time_ms: of(&beat.traces.time_ms, 1e3)?,
            volume_ml: of(&beat.traces.volume_ml, 1e2)?,
            pressure_mmhg: of(&beat.traces.pressure_mmhg, 1e2)?,
            origin_mm,
            step_mm,
            points,
            sa_kpa: values(0),
            lambda: values(1),
            front: self.front.clone(),
        })
    }

    /// The surface with its states and frames; `None` if the traces lack a sample that is drawn.
    ///
    /// - `fields`: active stress and stretch at a sample of the beat
    ///
    /// # Errors
    /// The error of `fields`.
    pub fn surface<E>(
        &self,
        beat: &Beat<'_>,
        shapes: &Shapes,
        frames: &[Frame],
        mut fields: impl FnMut(usize) -> Result<Fields, E>,
    ) -> Result<Option<HeartSurface>, E> {
        let (first, last) = (
            fields(shapes.begin.sample)?,
            fields(shapes.smallest.sample)?,
        );
        let of_frames: Vec<Fields> = frames
            .iter()
            .map(|frame| fields(frame.sample))
            .collect::<Result<_, E>>()?;
        let states = [
            self.state(beat, "end-diastole", &shapes.begin, &first),
            self.state(beat, "end-systole", &shapes.smallest, &last),
        ];
        let Some(states) = states.into_iter().collect() else {
            return Ok(None);
        };
        Ok(Some(HeartSurface {
            schema_version: formats::HEART.version,
            long_axis: self.view.long_axis.map(|x| rounded(x, 1e6)),
            towards_viewer: self.view.plane.normal.map(|x| rounded(x, 1e6)),
            triangles_before: self.triangles_before as u64,
            parts: self.behind.clone(),
            states,
            beat: (frames.len() > 1)
                .then(|| self.beat(beat, frames, &of_frames))
                .flatten(),
        }))
    }
}

/// A finished beat on the mesh of a wall.
#[derive(Debug)]
pub struct Beat<'a> {
    /// Unloaded positions of the mesh's nodes \[mm\], three numbers per node.
    pub unloaded: &'a [f64],
    /// Nodes with nodal traces.
    pub nodes: &'a [u32],
    /// Traces of the beat.
    pub traces: &'a BeatTraces,
}

/// Positions of a wall's corners at a sample of the beat's traces.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Index of the sample in the beat's traces.
    pub sample: usize,
    /// Position of each corner \[mm\].
    pub places: Vec<Vec3>,
}

/// Parts of a half after it was thinned out to about `target` triangles. Their corners are appended
/// to `corners`.
fn parts(
    mesh: &TetMesh,
    half: &Half,
    target: usize,
    is_wanted: impl Fn(Side) -> bool,
    corners: &mut Vec<Corner>,
) -> Vec<HeartPart> {
    let contracts = |tag: i32| tag == tags::LEFT_VENTRICLE;
    let mut names: Vec<(Side, bool)> = half
        .parts
        .iter()
        .map(|(side, tag)| (*side, contracts(*tag)))
        .collect();
    let labels = names.clone();
    names.sort_unstable();
    names.dedup();
    let label = |k: usize| names.binary_search(&labels[k]).unwrap_or_default() as u32;
    let labels: Vec<u32> = (0..half.triangles.len()).map(label).collect();
    let points: Vec<Vec3> = half.corners.iter().map(|c| c.at(&mesh.nodes_mm)).collect();
    let kept = decimate(&points, &half.triangles, &labels, target);

    // New numbers of the corners that remain, in the order of the triangles.
    let mut number = vec![u32::MAX; half.corners.len()];
    let mut parts: Vec<HeartPart> = names
        .iter()
        .map(|(side, contracts)| HeartPart {
            surface: name(mesh, *side),
            contracts: *contracts,
            triangles: Vec::new(),
        })
        .collect();
    for (k, triangle) in kept {
        let label = labels[k] as usize;
        if !is_wanted(names[label].0) {
            continue;
        }
        let renumbered = triangle.map(|corner| {
            let place = &mut number[corner as usize];
            if *place == u32::MAX {
                *place = corners.len() as u32;
                corners.push(half.corners[corner as usize]);
            }
            *place
        });
        parts[label].triangles.push(renumbered);
    }
    parts.retain(|part| !part.triangles.is_empty());
    parts
}

/// Text of the file.
///
/// # Panics
/// Never in practice: a surface is valid JSON.
#[must_use]
pub fn text(surface: &HeartSurface) -> String {
    serde_json::to_string(surface).expect("a surface is JSON")
}

fn name(mesh: &TetMesh, side: Side) -> String {
    match side {
        Side::Surface(k) => mesh.surfaces[k].name.clone(),
        Side::Unnamed => "unnamed".to_owned(),
        Side::Cut => "cut".to_owned(),
    }
}

/// Cutting plane and upward direction.
#[derive(Debug)]
struct View {
    long_axis: Vec3,
    plane: Plane,
}

impl View {
    /// The plane contains the long axis and the middle of the septum, which appears on the left.
    fn of(mesh: &TetMesh) -> Option<Self> {
        let middle = |name: &str| -> Option<Vec3> {
            let nodes = mesh.surface(name)?.nodes();
            let sum = nodes.iter().fold([0.0; 3], |sum, k| {
                axpy(sum, 1.0, mesh.nodes_mm[*k as usize])
            });
            (!nodes.is_empty()).then(|| scale(sum, 1.0 / nodes.len() as f64))
        };
        let base = middle(surface_names::RIM)?;
        let endocardium = mesh.surface(surface_names::ENDOCARDIUM)?.nodes();
        let far = |k: &u32| distance(mesh.nodes_mm[*k as usize], base);
        let apex = endocardium
            .into_iter()
            .max_by(|a, b| far(a).total_cmp(&far(b)))?;
        let apex = mesh.nodes_mm[apex as usize];
        let long_axis = unit(sub(base, apex))?;
        let septum =
            middle(surface_names::SEPTUM).or_else(|| middle(surface_names::RIGHT_VENTRICLE));
        let septum = septum.and_then(|s| unit(reject(sub(s, apex), long_axis)));
        let right = septum.map_or_else(|| any_perpendicular(long_axis), |s| scale(s, -1.0));
        let normal = cross(right, long_axis);
        let point = axpy(apex, BESIDE_THE_AXIS * mesh.mean_edge_mm(), normal);
        Some(Self {
            long_axis,
            plane: Plane { point, normal },
        })
    }
}

fn rounded(value: f64, scale: f64) -> f64 {
    // Adding zero turns a negative zero into a positive one.
    (value * scale).round() / scale + 0.0
}
