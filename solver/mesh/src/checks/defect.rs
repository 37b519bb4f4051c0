//! Defects of a mesh, with what was found and where, what was expected, and the remedy.

use cardiotwin_units::Ml;

use super::limits::{DEGENERATE, EXTENT_MM, POOR_WARNING};
use crate::vec3::Vec3;

/// Number of places that a message lists; machine-readable output lists all of them.
const NAMED: usize = 5;

/// Whether computations with the defect are possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// No computation is possible.
    Error,
    /// Computations are possible, at a cost that the remedy states.
    Warning,
}

/// A part of a mesh, numbered from zero as in its file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Item {
    /// A tetrahedron by its index.
    Element(usize),
    /// A node by its index.
    Node(u32),
    /// An edge by its two nodes.
    Edge([u32; 2]),
    /// A triangle by its three nodes.
    Triangle([u32; 3]),
    /// A connected piece of the mesh, with its number of elements.
    Piece(usize),
    /// An opening of a surface, with its number of nodes.
    Opening(usize),
    /// A position without a numbered part.
    Spot,
}

/// Place of a defect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Part of the mesh with the defect.
    pub item: Item,
    /// Centre of the part \[mm\].
    pub at_mm: Vec3,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.item {
            Item::Element(e) => write!(f, "element {e}")?,
            Item::Node(n) => write!(f, "node {n}")?,
            Item::Edge([a, b]) => write!(f, "edge {a}–{b}")?,
            Item::Triangle([a, b, c]) => write!(f, "triangle {a}–{b}–{c}")?,
            Item::Piece(n) => write!(f, "{n} elements around")?,
            Item::Opening(n) => write!(f, "{n} nodes around")?,
            Item::Spot => {}
        }
        let [x, y, z] = self.at_mm;
        let space = if matches!(self.item, Item::Spot) {
            ""
        } else {
            " "
        };
        write!(f, "{space}({x:.2}, {y:.2}, {z:.2}) mm")
    }
}

/// Reasons why the triangles of a surface do not form a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tangle {
    /// More than two triangles share an edge.
    Branched,
    /// Two neighbours have normals to different sides.
    Inconsistent,
    /// The border touches itself.
    Pinched,
}

/// A defect of a mesh; [`Defect::severity`] is its severity.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    missing_docs,
    reason = "`found` of each variant says in words what its values are"
)]
pub enum Defect {
    Empty,
    Length {
        what: &'static str,
        found: usize,
        expected: usize,
    },
    NodeOutOfRange {
        element: usize,
        node: u32,
        n_nodes: usize,
    },
    NotFinite {
        nodes: Vec<u32>,
    },
    Inverted {
        of: usize,
        worst_mm3: f64,
        places: Vec<Place>,
    },
    Degenerate {
        worst: f64,
        places: Vec<Place>,
    },
    Poor {
        of: usize,
        worst: f64,
        places: Vec<Place>,
    },
    Unreferenced {
        places: Vec<Place>,
    },
    Doubled {
        places: Vec<Place>,
    },
    Overlap {
        places: Vec<Place>,
    },
    Unconnected {
        largest: usize,
        places: Vec<Place>,
    },
    Touching {
        places: Vec<Place>,
    },
    NoTag {
        tag: i32,
        found: Vec<(i32, usize)>,
    },
    Size {
        extent_mm: f64,
        likely: Option<&'static str>,
    },
    NoSurface {
        names: Vec<String>,
        found: Vec<String>,
        why_not_found: Option<String>,
    },
    Tangled {
        name: String,
        how: Tangle,
        places: Vec<Place>,
    },
    OffBoundary {
        name: String,
        of: usize,
        places: Vec<Place>,
    },
    Inward {
        name: String,
        of: usize,
        places: Vec<Place>,
    },
    TwoSurfaces {
        first: String,
        second: String,
        places: Vec<Place>,
    },
    Hole {
        places: Vec<Place>,
    },
    NoFurther {
        name: String,
        key: &'static str,
        found: Vec<String>,
    },
    NotRight {
        name: String,
    },
    RightOverlap {
        first: String,
        second: String,
        places: Vec<Place>,
    },
    RightHole {
        name: String,
        places: Vec<Place>,
    },
    Closed {
        volume: Ml,
        places: Vec<Place>,
    },
    Cavity {
        found: Ml,
        measured: Ml,
        tolerance: f64,
    },
    Wall {
        found: Ml,
        stated: Ml,
        tolerance: f64,
    },
    NoFibres,
    FibreLength {
        of: usize,
        worst: f64,
        places: Vec<Place>,
    },
    /// Most contracting elements have fibres of one direction, as a placeholder has.
    OneDirection {
        n: usize,
        of: usize,
    },
    /// Fibres of neighbours differ as random directions do.
    Unordered {
        mean_cosine: f64,
    },
    /// The rule makes the fibres, although the file has directions under names that no reader knows.
    UnreadDirections {
        names: Vec<String>,
    },
    Site {
        site: usize,
        distance_mm: f64,
        place: Place,
    },
    NoStart,
    Times {
        found: String,
        expected: String,
        places: Vec<Place>,
    },
}

impl Defect {
    /// Stable name of the defect, for machines.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Empty => "no-elements",
            Self::Length { .. } => "length",
            Self::NodeOutOfRange { .. } => "node-out-of-range",
            Self::NotFinite { .. } => "not-finite",
            Self::Inverted { .. } => "turned-elements",
            Self::Degenerate { .. } => "flat-elements",
            Self::Poor { .. } => "badly-shaped-elements",
            Self::Unreferenced { .. } => "unused-nodes",
            Self::Doubled { .. } => "doubled-nodes",
            Self::Overlap { .. } => "overlap",
            Self::Unconnected { .. } => "loose-pieces",
            Self::Touching { .. } => "touching-edges",
            Self::NoTag { .. } => "no-such-tag",
            Self::Size { .. } => "size",
            Self::NoSurface { .. } => "no-surface",
            Self::Tangled {
                how: Tangle::Branched,
                ..
            } => "branched-surface",
            Self::Tangled {
                how: Tangle::Inconsistent,
                ..
            } => "turned-triangles",
            Self::Tangled {
                how: Tangle::Pinched,
                ..
            } => "pinched-surface",
            Self::OffBoundary { .. } => "foreign-triangles",
            Self::Inward { .. } => "inward-surface",
            Self::TwoSurfaces { .. } => "shared-triangles",
            Self::Hole { .. } => "hole",
            Self::NoFurther { .. } => "no-such-surface",
            Self::NotRight { .. } => "no-right-ventricle",
            Self::RightOverlap { .. } => "right-ventricle-overlap",
            Self::RightHole { .. } => "right-ventricle-hole",
            Self::Closed { .. } => "closed-endocardium",
            Self::Cavity { .. } => "cavity-volume",
            Self::Wall { .. } => "wall-volume",
            Self::NoFibres => "no-fibres",
            Self::FibreLength { .. } => "fibre-length",
            Self::OneDirection { .. } => "fibres-of-one-direction",
            Self::Unordered { .. } => "fibres-without-order",
            Self::UnreadDirections { .. } => "unread-directions",
            Self::Site { .. } => "activation-site",
            Self::NoStart => "no-activation",
            Self::Times { .. } => "activation-times",
        }
    }

    /// Whether computations with the defect are possible.
    #[must_use]
    pub fn severity(&self) -> Severity {
        match self {
            Self::Poor { .. }
            | Self::Unreferenced { .. }
            | Self::Touching { .. }
            | Self::OneDirection { .. }
            | Self::Unordered { .. }
            | Self::UnreadDirections { .. }
            | Self::Wall { .. } => Severity::Warning,
            _ => Severity::Error,
        }
    }

    /// All places, the worst first if the defect has a measure.
    #[must_use]
    pub fn places(&self) -> &[Place] {
        match self {
            Self::Inverted { places, .. }
            | Self::Degenerate { places, .. }
            | Self::Poor { places, .. }
            | Self::Unreferenced { places }
            | Self::Doubled { places }
            | Self::Overlap { places }
            | Self::Unconnected { places, .. }
            | Self::Touching { places }
            | Self::Tangled { places, .. }
            | Self::OffBoundary { places, .. }
            | Self::Inward { places, .. }
            | Self::TwoSurfaces { places, .. }
            | Self::Hole { places }
            | Self::RightOverlap { places, .. }
            | Self::RightHole { places, .. }
            | Self::Closed { places, .. }
            | Self::FibreLength { places, .. }
            | Self::Times { places, .. } => places,
            Self::Site { place, .. } => std::slice::from_ref(place),
            _ => &[],
        }
    }

    /// Description of the finding without its places.
    fn subject(&self) -> String {
        let n = self.places().len();
        match self {
            Self::Empty => "no elements".to_owned(),
            Self::Length { what, found, .. } => format!("{found} {what}"),
            Self::NodeOutOfRange {
                element,
                node,
                n_nodes,
            } => {
                format!("element {element} with node {node}, though the mesh has {n_nodes} nodes")
            }
            Self::NotFinite { nodes } => {
                let named: Vec<String> = nodes.iter().take(NAMED).map(u32::to_string).collect();
                format!(
                    "{} with coordinates that are no numbers: {}",
                    nodes_of(nodes.len()),
                    named.join(", ")
                )
            }
            Self::Inverted { of, worst_mm3, .. } => {
                format!(
                    "{n} of {of} elements turned inside out, the worst with {worst_mm3:.3e} mm³"
                )
            }
            Self::Degenerate { worst, .. } => {
                format!(
                    "{} without volume, the worst with a mean ratio of {worst:.1e}",
                    elements_of(n)
                )
            }
            Self::Poor { of, worst, .. } => {
                format!(
                    "{n} of {of} elements badly shaped, the worst with a mean ratio of {worst:.3}"
                )
            }
            Self::Unreferenced { .. } => format!("{} that no element has", nodes_of(n)),
            Self::Doubled { .. } => format!("{} at the place of another one", nodes_of(n)),
            Self::Overlap { .. } => format!("{n} faces that belong to more than two elements"),
            Self::Unconnected { largest, .. } => {
                format!(
                    "{n} loose pieces beside the largest, which has {}",
                    elements_of(*largest)
                )
            }
            Self::Touching { .. } => {
                format!(
                    "{n} edges at which tissue touches itself: four boundary triangles meet there"
                )
            }
            Self::NoTag { tag, found } => {
                let all: Vec<String> = found
                    .iter()
                    .map(|(tag, n)| format!("{tag} ({})", elements_of(*n)))
                    .collect();
                format!(
                    "no element with the tag {tag}; tags there are {}",
                    all.join(", ")
                )
            }
            Self::Size { extent_mm, .. } => format!("a mesh {extent_mm:.3e} mm across"),
            Self::NoSurface {
                names,
                found,
                why_not_found,
            } => {
                let there = if found.is_empty() {
                    "none".to_owned()
                } else {
                    found.join(", ")
                };
                let why = why_not_found.as_ref().map_or(String::new(), |why| {
                    format!("; looked for on the mesh: {why}")
                });
                format!(
                    "no surface named {}; surfaces there are: {there}{why}",
                    names.join(", ")
                )
            }
            Self::Tangled {
                name,
                how: Tangle::Branched,
                ..
            } => {
                format!("{n} edges of surface {name} with more than two triangles")
            }
            Self::Tangled {
                name,
                how: Tangle::Inconsistent,
                ..
            } => {
                format!(
                    "{n} edges of surface {name} whose two triangles are turned against each other"
                )
            }
            Self::Tangled {
                name,
                how: Tangle::Pinched,
                ..
            } => {
                format!("{n} nodes where the border of surface {name} touches itself")
            }
            Self::OffBoundary { name, of, .. } => {
                format!(
                    "{n} of {of} triangles of surface {name} that are no boundary faces of the mesh"
                )
            }
            Self::Inward { name, of, .. } => {
                format!("{n} of {of} triangles of surface {name} with normals into the tissue")
            }
            Self::TwoSurfaces { first, second, .. } => {
                format!("{n} triangles in both surfaces {first} and {second}")
            }
            Self::Hole { .. } => {
                format!("{n} openings of the endocardium that the rim does not border")
            }
            Self::NoFurther { name, found, .. } => {
                let there = if found.is_empty() {
                    "none".to_owned()
                } else {
                    found.join(", ")
                };
                format!("no surface named {name}; surfaces there are: {there}")
            }
            Self::NotRight { name } => {
                format!("the surface {name}, which is not the right ventricle's")
            }
            Self::RightOverlap { first, second, .. } => {
                format!("{n} triangles in both surfaces {first} and {second}")
            }
            Self::RightHole { name, .. } => {
                format!("{n} openings of surface {name} that the rim does not border")
            }
            Self::Closed { volume, .. } => format!("a closed endocardium around {volume:.1}"),
            Self::Cavity { found, .. } => format!("a cavity of {found:.1}"),
            Self::Wall { found, .. } => format!("contracting tissue of {found:.1}"),
            Self::NoFibres => "no fibres".to_owned(),
            Self::FibreLength { of, worst, .. } => {
                format!(
                    "{n} of {of} contracting elements without a unit fibre, the worst of length {worst}"
                )
            }
            Self::OneDirection { n, of } if n == of => {
                format!("fibres of one direction in all {of} contracting elements")
            }
            Self::OneDirection { n, of } => {
                format!("fibres of one direction in {n} of {of} contracting elements")
            }
            Self::Unordered { mean_cosine } => {
                format!(
                    "fibres of neighbours with a mean cosine of {mean_cosine:.2}, as random ones have"
                )
            }
            Self::UnreadDirections { names } => {
                let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
                format!("no fibres, and directions named {}", names.join(", "))
            }
            Self::Site {
                site, distance_mm, ..
            } => {
                format!(
                    "activation site {} {distance_mm:.1} mm away from contracting tissue",
                    site + 1
                )
            }
            Self::NoStart => "neither activation times nor activation sites".to_owned(),
            Self::Times { found, .. } => found.clone(),
        }
    }

    /// Description of the finding with its places, limited to the first few.
    #[must_use]
    pub fn found(&self) -> String {
        let (subject, places) = (self.subject(), self.places());
        if places.is_empty() {
            return subject;
        }
        let named: Vec<String> = places.iter().take(NAMED).map(Place::to_string).collect();
        let more = match places.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!("; and {more} more"),
        };
        format!("{subject}: {}{more}", named.join("; "))
    }

    /// Description of the expected state.
    #[must_use]
    pub fn expected(&self) -> String {
        match self {
            Self::Empty => "tetrahedra".to_owned(),
            Self::Length { expected, .. } => format!("{expected}, one for each element"),
            Self::NodeOutOfRange { .. } => "nodes that are there, numbered from 0".to_owned(),
            Self::NotFinite { .. } => "finite numbers".to_owned(),
            Self::Inverted { .. } => "positive volumes".to_owned(),
            Self::Degenerate { .. } => format!("a mean ratio of at least {DEGENERATE} (1 for a regular tetrahedron)"),
            Self::Poor { .. } => format!("a mean ratio of {POOR_WARNING} or more (1 for a regular tetrahedron)"),
            Self::Unreferenced { .. } => "nodes of elements alone".to_owned(),
            Self::Doubled { .. } => "one node at a place".to_owned(),
            Self::Overlap { .. } => "faces of one or two elements".to_owned(),
            Self::Unconnected { .. } => "one piece".to_owned(),
            Self::Touching { .. } => "two boundary triangles at each edge of the boundary".to_owned(),
            Self::NoTag { .. } => "one element or more with each tag of left_ventricle".to_owned(),
            Self::Size { .. } => {
                format!("{:.0} to {:.0} mm for a left ventricle", EXTENT_MM.start(), EXTENT_MM.end())
            }
            Self::NoSurface { .. } => "endocardium, epicardium and rim".to_owned(),
            Self::Tangled { how: Tangle::Pinched, .. } => "a border that passes each node once".to_owned(),
            Self::Tangled { .. } => "two triangles at an edge, turned alike".to_owned(),
            Self::OffBoundary { .. } => "faces of one element each".to_owned(),
            Self::Inward { .. } => "normals out of the tissue".to_owned(),
            Self::TwoSurfaces { .. } => "each triangle in one surface".to_owned(),
            Self::Hole { .. } => "an opening at the base alone, with the rim around it".to_owned(),
            Self::NoFurther { .. } => "the name of a surface of the mesh".to_owned(),
            Self::NotRight { .. } => "the inner wall of the right ventricle".to_owned(),
            Self::RightOverlap { .. } => "each triangle in one surface".to_owned(),
            Self::RightHole { .. } => {
                "a right ventricle that is closed, or open at the base with the rim around the opening".to_owned()
            }
            Self::Closed { .. } => "an opening at the base, with the rim around it".to_owned(),
            Self::Cavity { measured, tolerance, .. } => {
                format!("the {measured:.1} that were measured, within {:.0} %", tolerance * 100.0)
            }
            Self::Wall { stated, tolerance, .. } => {
                format!("the {stated:.1} of anatomy.wall_volume_mL, within {:.0} %", tolerance * 100.0)
            }
            Self::NoFibres => "a fibre for each contracting element".to_owned(),
            Self::FibreLength { .. } => "a length of 1".to_owned(),
            Self::OneDirection { .. } => "fibres that turn around the cavity".to_owned(),
            Self::Unordered { .. } => "fibres that change little from an element to the next".to_owned(),
            Self::UnreadDirections { .. } => {
                "fibres named fibre or fiber; the rule makes them instead".to_owned()
            }
            Self::Site { .. } => "a place in contracting tissue".to_owned(),
            Self::NoStart => "one of them".to_owned(),
            Self::Times { expected, .. } => expected.clone(),
        }
    }

    /// Description of the remedy.
    #[must_use]
    pub fn remedy(&self) -> String {
        const REPAIR: &str = "`cardiotwin mesh repair`";
        match self {
            Self::Empty => "name a volume mesh, not a surface".to_owned(),
            Self::Length { what, .. } => format!("write the {what} of this very mesh again"),
            Self::NodeOutOfRange { .. } => "write points and elements of the same mesh again".to_owned(),
            Self::NotFinite { .. } => "write the mesh again with the program that made it".to_owned(),
            Self::Inverted { .. } => format!("{REPAIR} turns them over"),
            Self::Degenerate { .. } => {
                format!("{REPAIR} moves or merges nodes there; `cardiotwin mesh remesh` where that is not enough")
            }
            Self::Poor { .. } => {
                format!(
                    "{REPAIR} smooths them, `cardiotwin mesh remesh` meshes anew; else steps are short and results poor there"
                )
            }
            Self::Unreferenced { .. } | Self::Doubled { .. } => format!("{REPAIR} mends them"),
            Self::Overlap { .. } => format!("{REPAIR} removes doubled elements; else mesh again"),
            Self::Unconnected { .. } => {
                format!("{REPAIR} merges doubled nodes; with --keep-largest it removes the loose pieces")
            }
            Self::Touching { .. } => format!("{REPAIR} parts the tissue there"),
            Self::NoTag { .. } => "name the contracting tissue's tags in anatomy.mesh.left_ventricle".to_owned(),
            Self::Size { likely: Some(unit), .. } => {
                format!("the coordinates look like {unit}: set anatomy.mesh.unit = \"{unit}\"")
            }
            Self::Size { likely: None, .. } => "set anatomy.mesh.unit to the coordinates' unit".to_owned(),
            Self::NoSurface { found, .. } if !found.is_empty() => {
                format!("{REPAIR} --surface NEW=OLD gives a surface its name, --rim-plane finds all three at a plane")
            }
            Self::NoSurface { .. } => {
                format!("{REPAIR} --rim-plane x,y,z,nx,ny,nz finds them at the base's plane; or give them as files")
            }
            Self::Tangled { how: Tangle::Branched, .. } => {
                format!(
                    "{REPAIR} parts tissue that touches itself; a surface that branches by itself is found anew with --find-surfaces"
                )
            }
            Self::Tangled { .. } | Self::OffBoundary { .. } | Self::Inward { .. } | Self::TwoSurfaces { .. } => {
                format!("{REPAIR} turns triangles outward; --find-surfaces finds the surfaces anew on this mesh")
            }
            Self::Hole { .. } => format!("{REPAIR} --find-surfaces finds the missing triangles"),
            Self::NoFurther { key, .. } => {
                format!("correct the name in {key}, or give the surface: CARP stem.NAME.surf, VTU triangles with a field NAME")
            }
            Self::NotRight { .. } => {
                "name the surface of the right ventricle's endocardium in anatomy.mesh.right_ventricle.surface".to_owned()
            }
            Self::RightOverlap { .. } => {
                "take them out of one of the two: endocardium is the left ventricle's inner wall alone, epicardium the outer wall of \
                 both, the right side of the septum is the right ventricle's"
                    .to_owned()
            }
            Self::RightHole { .. } => {
                "add the missing triangles to the surface, or the cut through the wall there to the rim".to_owned()
            }
            Self::Closed { .. } => {
                format!(
                    "{REPAIR} --remove-tags TAG takes tagged valve plugs out, --cut-plane x,y,z,nx,ny,nz cuts the base open"
                )
            }
            Self::Cavity { found, measured, .. } => {
                let lengths = (measured.0 / found.0).cbrt();
                if (0.95..1.05).contains(&lengths) {
                    "is it the image of that state, and of that patient? correct the volume or the mesh".to_owned()
                } else {
                    format!(
                        "correct unit, state or rim; all lengths times {lengths:.3} would give that volume (`cardiotwin mesh repair --scale {lengths:.3}`)"
                    )
                }
            }
            Self::Wall { .. } => "correct the volume, or the tags of left_ventricle".to_owned(),
            Self::NoFibres => {
                "give a .lon file or fields fibre and sheet, or set anatomy.mesh.fibres = \"rule\"".to_owned()
            }
            Self::FibreLength { .. } => {
                "give each contracting element its fibre, or set anatomy.mesh.fibres = \"rule\"".to_owned()
            }
            Self::OneDirection { .. } => {
                "these look like a placeholder: give the real fibres, or set anatomy.mesh.fibres = \"rule\"".to_owned()
            }
            Self::Unordered { .. } => {
                "give the fibres in the order of the elements, or set anatomy.mesh.fibres = \"rule\"".to_owned()
            }
            Self::UnreadDirections { .. } => {
                "rename the array with the fibres to fibre, or set anatomy.mesh.fibres = \"rule\" if there are none".to_owned()
            }
            Self::Site { place, .. } => {
                let [x, y, z] = place.at_mm;
                format!("the nearest node of contracting tissue is at ({x:.2}, {y:.2}, {z:.2}) mm; sites are in mm")
            }
            Self::NoStart => "give anatomy.mesh.activation_sites_mm or activation_times_ms".to_owned(),
            Self::Times { .. } => "write one number a node in the mesh's order, in ms".to_owned(),
        }
    }
}

impl std::fmt::Display for Defect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "found {}, expected {}; {}",
            self.found(),
            self.expected(),
            self.remedy()
        )
    }
}

fn elements_of(n: usize) -> String {
    if n == 1 {
        "1 element".to_owned()
    } else {
        format!("{n} elements")
    }
}

fn nodes_of(n: usize) -> String {
    if n == 1 {
        "1 node".to_owned()
    } else {
        format!("{n} nodes")
    }
}
