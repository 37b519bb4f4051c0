//! `heart.json`: surface of the wall, cut open along the long axis, at the beginning of the last
//! beat and at the end of its ejection.

use cardiotwin_mesh::cutaway::{Half, Plane, Side, cut};
use cardiotwin_mesh::decimate::decimate;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names, tags};
use cardiotwin_mesh::vec3::{
    Vec3, any_perpendicular, axpy, cross, distance, reject, scale, sub, unit,
};
use cardiotwin_models::beat::BeatTraces;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::heart::{HeartPart, HeartState, HeartSurface};

use super::shapes::{Shape, Shapes};

/// Approximate number of triangles after decimation: four pictures then take less than 150 kB
/// together.
const TRIANGLES: usize = 850;
/// Distance of the plane from the axis, in edge lengths, chosen so that no node of a regular mesh
/// lies in the plane.
const BESIDE_THE_AXIS: f64 = 0.3;

/// Mesh that the shapes belong to.
#[derive(Debug)]
pub struct Organ<'a> {
    /// The mesh in the configuration of the image.
    pub mesh: &'a TetMesh,
    /// Unloaded positions of its nodes \[mm\], three numbers per node.
    pub unloaded: &'a [f64],
    /// Nodes with nodal traces.
    pub nodes: &'a [u32],
}

/// Active stress \[kPa\] and stretch of the nodes with nodal traces.
pub type Fields = [Vec<f64>; 2];

/// Cuts the mesh open; `None` if it has no cavity to look into.
///
/// - `fields`: active stress and stretch at the two shapes
#[must_use]
pub fn surface(
    organ: &Organ<'_>,
    shapes: &Shapes,
    traces: &BeatTraces,
    fields: &[Fields; 2],
) -> Option<HeartSurface> {
    let mesh = organ.mesh;
    let view = View::of(mesh)?;
    let half = cut(mesh, &view.plane);
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
    let kept = decimate(&points, &half.triangles, &labels, TRIANGLES);

    // New numbers of the corners that remain, in the order of the triangles.
    let mut number = vec![u32::MAX; half.corners.len()];
    let mut corners = Vec::new();
    let mut parts: Vec<HeartPart> = names
        .iter()
        .map(|(side, contracts)| HeartPart {
            surface: name(mesh, *side),
            contracts: *contracts,
            triangles: Vec::new(),
        })
        .collect();
    for (k, triangle) in kept {
        let renumbered = triangle.map(|corner| {
            let place = &mut number[corner as usize];
            if *place == u32::MAX {
                *place = corners.len() as u32;
                corners.push(corner as usize);
            }
            *place
        });
        parts[labels[k] as usize].triangles.push(renumbered);
    }
    parts.retain(|part| !part.triangles.is_empty());
    let state = |name, shape, fields| state(organ, &half, &corners, traces, (name, shape, fields));
    Some(HeartSurface {
        schema_version: formats::HEART.version,
        long_axis: view.long_axis.map(|x| rounded(x, 1e6)),
        towards_viewer: view.plane.normal.map(|x| rounded(x, 1e6)),
        triangles_before: half.triangles.len() as u64,
        parts,
        states: vec![
            state("end-diastole", &shapes.begin, &fields[0])?,
            state("end-systole", &shapes.smallest, &fields[1])?,
        ],
    })
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

fn state(
    organ: &Organ<'_>,
    half: &Half,
    corners: &[usize],
    traces: &BeatTraces,
    (name, shape, [stress, stretch]): (&str, &Shape, &Fields),
) -> Option<HeartState> {
    let k = shape.sample;
    let at: Vec<f64> = organ
        .unloaded
        .iter()
        .zip(&shape.u)
        .map(|(x, u)| x + u)
        .collect();
    let at = at.as_chunks::<3>().0;
    let field = |values: &[f64], scale: f64| -> Option<Vec<Option<f64>>> {
        let mut all = vec![None; organ.mesh.n_nodes()];
        for (node, value) in organ.nodes.iter().zip(values) {
            all[*node as usize] = Some(*value);
        }
        let at_corner = |corner: &usize| {
            let corner = half.corners[*corner];
            let (from, to) = (all[corner.from as usize], all[corner.to as usize]);
            // Between muscle and tissue without a value, the value of the muscle holds.
            let (from, to) = (from.or(to)?, to.or(from)?);
            Some(rounded(from + corner.share * (to - from), scale))
        };
        Some(corners.iter().map(at_corner).collect())
    };
    Some(HeartState {
        name: name.to_owned(),
        time_ms: *traces.time_ms.get(k)?,
        volume_ml: *traces.volume_ml.get(k)?,
        pressure_mmhg: *traces.pressure_mmhg.get(k)?,
        points_mm: corners
            .iter()
            .map(|c| half.corners[*c].at(at).map(|x| rounded(x, 1e2)))
            .collect(),
        sa_kpa: field(stress, 1e2)?,
        lambda: field(stretch, 1e4)?,
    })
}

fn rounded(value: f64, scale: f64) -> f64 {
    // Adding zero turns a negative zero into a positive one.
    (value * scale).round() / scale + 0.0
}
