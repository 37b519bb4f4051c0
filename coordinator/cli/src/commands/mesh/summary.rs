//! Figures and defects of a mesh, as text and as JSON.

use std::collections::BTreeMap;

use cardiotwin_mesh::checks::{Defect, Item, Severity};
use cardiotwin_mesh::intake::Intake;
use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_mesh::quality::Quality;
use cardiotwin_mesh::tet_mesh::surface_names;
use cardiotwin_mesh::vec3::Vec3;
use cardiotwin_mesh::{Cavity, TetMesh};
use serde::Serialize;

use crate::talk::count;

/// Sizes, quality, tags, surfaces, cavity and landmarks of a mesh.
#[derive(Debug, Serialize)]
pub struct Figures {
    nodes: usize,
    elements: usize,
    #[serde(rename = "mean_edge_mm")]
    mean_edge: f64,
    worst_mean_ratio: f64,
    mean_mean_ratio: f64,
    tags: Vec<Tag>,
    surfaces: Vec<NamedSurface>,
    surfaces_found: bool,
    fibres: bool,
    #[serde(rename = "cavity_mL", skip_serializing_if = "Option::is_none")]
    cavity: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    landmarks: Option<Marks>,
}

#[derive(Debug, Serialize)]
struct Tag {
    tag: i32,
    elements: usize,
    #[serde(rename = "volume_mL")]
    volume: f64,
}

#[derive(Debug, Serialize)]
struct NamedSurface {
    name: String,
    triangles: usize,
}

#[derive(Debug, Serialize)]
struct Marks {
    base_mm: Vec3,
    apex_mm: Vec3,
    axis: Vec3,
    long_axis_mm: f64,
    usual_activation_sites_mm: Vec<Vec3>,
}

/// A defect as it is written to JSON.
#[derive(Debug, Serialize)]
pub struct Told {
    name: &'static str,
    severity: &'static str,
    found: String,
    expected: String,
    remedy: String,
    places: Vec<Where>,
}

#[derive(Debug, Serialize)]
struct Where {
    #[serde(skip_serializing_if = "Option::is_none")]
    element: Option<usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    nodes: Vec<u32>,
    at_mm: Vec3,
}

impl Told {
    /// The defect with all its places.
    pub fn of(defect: &Defect) -> Self {
        let place = |place: &cardiotwin_mesh::checks::Place| {
            let (element, nodes) = match place.item {
                Item::Element(e) => (Some(e), vec![]),
                Item::Node(n) => (None, vec![n]),
                Item::Edge(nodes) => (None, nodes.to_vec()),
                Item::Triangle(nodes) => (None, nodes.to_vec()),
                Item::Piece(_) | Item::Opening(_) | Item::Spot => (None, vec![]),
            };
            Where {
                element,
                nodes,
                at_mm: place.at_mm,
            }
        };
        Self {
            name: defect.name(),
            severity: if defect.severity() == Severity::Error {
                "error"
            } else {
                "warning"
            },
            found: defect.found(),
            expected: defect.expected(),
            remedy: defect.remedy(),
            places: defect.places().iter().map(place).collect(),
        }
    }
}

impl Figures {
    /// Figures of a checked mesh. If its elements cannot be evaluated, the figures that depend on
    /// them are empty.
    pub fn of(intake: &Intake) -> Self {
        let mesh = &intake.mesh;
        let readable = |defect: &Defect| {
            !matches!(
                defect.name(),
                "no-elements" | "length" | "node-out-of-range" | "not-finite"
            )
        };
        let sound = intake.defects.iter().all(readable);
        let quality = if sound {
            Quality::of(mesh)
        } else {
            Quality::of(&TetMesh::default())
        };
        let mut tags: BTreeMap<i32, (usize, f64)> = BTreeMap::new();
        for (e, tag) in mesh.tags.iter().enumerate().filter(|_| sound) {
            let sum = tags.entry(*tag).or_default();
            *sum = (sum.0 + 1, sum.1 + mesh.volume_mm3(e) * 1e-3);
        }
        let cavity = mesh
            .surface(surface_names::ENDOCARDIUM)
            .filter(|_| sound)
            .and_then(|s| Cavity::behind(&s.triangles).ok())
            .map(|cavity| cavity.volume(&mesh.nodes_mm).0);
        let marks = Landmarks::of(mesh).filter(|_| sound).map(|marks| Marks {
            base_mm: marks.base_mm,
            apex_mm: marks.apex_mm,
            axis: marks.axis,
            long_axis_mm: marks.apex_height_mm,
            usual_activation_sites_mm: marks.usual_sites_mm(mesh),
        });
        let surfaces = mesh.surfaces.iter().map(|s| NamedSurface {
            name: s.name.clone(),
            triangles: s.triangles.len(),
        });
        Self {
            nodes: mesh.n_nodes(),
            elements: mesh.n_tets(),
            mean_edge: quality.mean_edge_mm,
            worst_mean_ratio: quality.min,
            mean_mean_ratio: quality.mean,
            tags: tags
                .into_iter()
                .map(|(tag, (elements, volume))| Tag {
                    tag,
                    elements,
                    volume,
                })
                .collect(),
            surfaces: surfaces.collect(),
            surfaces_found: intake.surfaces_found,
            fibres: !mesh.frames.is_empty(),
            cavity,
            landmarks: marks,
        }
    }

    /// Text with one line per figure.
    pub fn text(&self) -> String {
        let place = |x: &Vec3| format!("({:.1}, {:.1}, {:.1})", x[0], x[1], x[2]);
        let mut text = format!(
            "mesh      {}, {}, mean edge {:.2} mm, mean ratio {:.2} on average, {:.3} at worst\n",
            count(self.nodes, "node"),
            count(self.elements, "tetrahedron").replace("tetrahedrons", "tetrahedra"),
            self.mean_edge,
            self.mean_mean_ratio,
            self.worst_mean_ratio
        );
        for Tag {
            tag,
            elements,
            volume,
        } in &self.tags
        {
            text += &format!(
                "tag {tag:<5} {}, {volume:.1} mL\n",
                count(*elements, "element")
            );
        }
        let surfaces: Vec<String> = self
            .surfaces
            .iter()
            .map(|s| format!("{} ({})", s.name, s.triangles))
            .collect();
        let found = if self.surfaces_found {
            ", found on the mesh"
        } else {
            ""
        };
        let surfaces = if surfaces.is_empty() {
            "none".to_owned()
        } else {
            surfaces.join(", ")
        };
        text += &format!("surfaces  {surfaces}{found}\n");
        text += &format!(
            "fibres    {}\n",
            if self.fibres {
                "one for each element"
            } else {
                "none"
            }
        );
        if let Some(cavity) = self.cavity {
            text += &format!("cavity    {cavity:.1} mL\n");
        }
        if let Some(marks) = &self.landmarks {
            let (base, apex) = (place(&marks.base_mm), place(&marks.apex_mm));
            text += &format!(
                "base      {base} mm, apex {apex} mm, {:.1} mm apart along the axis\n",
                marks.long_axis_mm
            );
            let sites: Vec<String> = marks.usual_activation_sites_mm.iter().map(place).collect();
            text += &format!(
                "sites     {} mm: usual sites of first activation\n",
                sites.join(", ")
            );
        }
        text
    }
}
