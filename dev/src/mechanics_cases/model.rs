//! Mesh, tissues, fibres, supports and loads of a benchmark file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_dev_solver::prescribed::{
    Course, EllipsoidFibres, Problem, SurfaceSupport, TimeCourse,
};
use cardiotwin_mechanics::element::batch::Frame;
use cardiotwin_mechanics::organ::ElementKind;
use cardiotwin_mesh::fibres::{FibreAngles, Longitudinal, fields, rule};
use cardiotwin_mesh::files;
use cardiotwin_mesh::joint::Alone;
use cardiotwin_mesh::refine::halve_edges;
use cardiotwin_mesh::tet_mesh::{shape_gradients, surface_names};
use cardiotwin_mesh::{LengthUnit, TetMesh, laplace};

use cardiotwin_worker::error::chain;

use super::error::CaseError;
use super::file::{CaseFile, DepthTable, FibreTable};
use super::names;

/// Positions of mid-edge nodes, by the vertices of their edge.
type Middles = BTreeMap<(u32, u32), [f64; 3]>;

/// Largest number of times that the mesh's edges can be halved.
const MOST_HALVINGS: u32 = 4;

/// Fibre frame at a point of an element.
type FrameAt = Box<dyn Fn(usize, [f64; 3]) -> Frame>;

/// A benchmark with its mesh in memory.
pub struct Model<'a> {
    file: &'a Path,
    parsed: &'a CaseFile,
    /// Mesh of the body, with its tags and surfaces.
    pub mesh: TetMesh,
    frame: FrameAt,
    middles: Middles,
    middle: Box<dyn Fn(u32, u32) -> Option<[f64; 3]>>,
}

impl std::fmt::Debug for Model<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model")
            .field("file", &self.file)
            .field("curved_edges", &self.middles.len())
            .finish_non_exhaustive()
    }
}

impl<'a> Model<'a> {
    /// Reads the mesh and makes the fibres.
    ///
    /// # Errors
    /// [`CaseError`] with the key at fault.
    pub fn read(file: &'a Path, parsed: &'a CaseFile) -> Result<Self, CaseError> {
        let mesh = read_mesh(file, parsed)?;
        let frame = fibres(file, parsed, &mesh)?;
        let middles = curved(file, parsed, &mesh)?;
        let places = middles.clone();
        let middle = Box::new(move |a: u32, b: u32| places.get(&(a.min(b), a.max(b))).copied());
        Ok(Self {
            file,
            parsed,
            mesh,
            frame,
            middles,
            middle,
        })
    }

    /// The file's problem on elements of `kind`.
    ///
    /// # Errors
    /// [`CaseError`] with the key at fault.
    pub fn problem(&self, kind: ElementKind) -> Result<Problem<'_>, CaseError> {
        let (file, parsed) = (self.file, self.parsed);
        let end_ms = names::end_ms(&parsed.time);
        let course = |key: String, table: &TimeCourse| {
            Course::new(table.clone(), end_ms).map_err(|e| {
                CaseError::key(
                    file,
                    format!("{key}.{}", e.name),
                    e.value.to_string(),
                    e.expected,
                )
            })
        };
        let triangles = |key: String, name: &str| surface(file, &self.mesh, &key, name);
        let mut supports = vec![];
        for (k, s) in parsed.support.iter().enumerate() {
            let key = |name: &str| format!("support[{k}].{name}");
            for (name, value) in [
                ("spring_kPa_per_mm", s.spring_kpa_per_mm),
                ("dashpot_kPa_ms_per_mm", s.dashpot_kpa_ms_per_mm),
            ] {
                if !(value >= 0.0 && value.is_finite()) {
                    return Err(CaseError::key(
                        file,
                        key(name),
                        value.to_string(),
                        "zero or more, and finite",
                    ));
                }
            }
            supports.push(SurfaceSupport {
                triangles: triangles(key("surface"), &s.surface)?,
                direction: s.direction,
                spring: s.spring_kpa_per_mm,
                dashpot: s.dashpot_kpa_ms_per_mm,
            });
        }
        let mut fixed = vec![];
        for (k, f) in parsed.fixed.iter().enumerate() {
            let mut components = [false; 3];
            f.components
                .iter()
                .for_each(|a| components[names::axis(*a)] = true);
            fixed.push((
                triangles(format!("fixed[{k}].surface"), &f.surface)?,
                components,
            ));
        }
        let mut pressures = vec![];
        for (k, p) in parsed.pressure.iter().enumerate() {
            let surface = triangles(format!("pressure[{k}].surface"), &p.surface)?;
            pressures.push((surface, course(format!("pressure[{k}].course"), &p.course)?));
        }
        let active = parsed.active_stress.clone().unwrap_or(TimeCourse::ZERO);
        let mut cavities = vec![];
        for (k, c) in parsed.cavity.iter().enumerate() {
            let mut all = vec![];
            for name in &c.surfaces {
                all.extend(triangles(format!("cavity[{k}].surfaces"), name)?);
            }
            cavities.push(all);
        }
        Ok(Problem {
            mesh: &self.mesh,
            kind,
            middle: &self.middle,
            tissues: parsed.tissue.iter().map(names::tissue).collect(),
            viscosity_kpa_ms: parsed.tissue.iter().map(|t| t.viscosity_kpa_ms).collect(),
            tissue_of: self.tissue_of()?,
            frame: &self.frame,
            supports,
            fixed,
            pressures,
            active: course("active_stress".to_owned(), &active)?,
            cavities,
            probes: parsed.probe.iter().map(|p| p.at_mm).collect(),
        })
    }

    fn tissue_of(&self) -> Result<Vec<usize>, CaseError> {
        let tissues = &self.parsed.tissue;
        (self.mesh.tags.iter())
            .map(|tag| {
                (tissues
                    .iter()
                    .position(|t| t.tags.is_empty() || t.tags.contains(tag)))
                .ok_or_else(|| {
                    let found = format!("an element with tag {tag}, which no tissue names");
                    CaseError::key(
                        self.file,
                        "tissue",
                        found,
                        "a tissue for each tag of the mesh, or one without tags",
                    )
                })
            })
            .collect()
    }
}

fn read_mesh(file: &Path, parsed: &CaseFile) -> Result<TetMesh, CaseError> {
    let unit = LengthUnit::from_symbol(&parsed.mesh.unit).ok_or_else(|| {
        let known: Vec<&str> = LengthUnit::ALL.iter().map(|u| u.symbol()).collect();
        CaseError::key(
            file,
            "mesh.unit",
            format!("{:?}", parsed.mesh.unit),
            format!("one of {}", known.join(", ")),
        )
    })?;
    let path: PathBuf = file
        .parent()
        .unwrap_or(Path::new(""))
        .join(&parsed.mesh.file);
    let mesh = files::read(&path, unit);
    let mut mesh = mesh.map_err(|source| CaseError::Mesh {
        file: file.to_owned(),
        source,
    })?;
    if parsed.mesh.refine > MOST_HALVINGS {
        let expected = format!("at most {MOST_HALVINGS}: each makes eight elements of one");
        return Err(CaseError::key(
            file,
            "mesh.refine",
            parsed.mesh.refine.to_string(),
            expected,
        ));
    }
    if parsed.mesh.refine > 0 && parsed.mesh.curved.is_some() {
        let found = format!("{}, with mesh.curved", parsed.mesh.refine);
        return Err(CaseError::key(
            file,
            "mesh.refine",
            found,
            "one of the two: refined facets stay flat",
        ));
    }
    for _ in 0..parsed.mesh.refine {
        mesh = halve_edges(&mesh);
    }
    Ok(mesh)
}

fn surface(file: &Path, mesh: &TetMesh, key: &str, name: &str) -> Result<Vec<[u32; 3]>, CaseError> {
    mesh.surface(name)
        .map(|s| s.triangles.clone())
        .ok_or_else(|| {
            let known: Vec<&str> = mesh.surfaces.iter().map(|s| s.name.as_str()).collect();
            let expected = format!(
                "a surface of the mesh: {}",
                if known.is_empty() {
                    "it has none".to_owned()
                } else {
                    known.join(", ")
                }
            );
            CaseError::key(file, key, format!("{name:?}"), expected)
        })
}

/// Fibre, sheet and normal as an orthonormal frame; `None` if fibre and sheet do not span a plane.
fn orthonormal(fibre: [f64; 3], sheet: [f64; 3]) -> Option<Frame> {
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let unit = |a: [f64; 3]| {
        let n = dot(a, a).sqrt();
        (n > 1e-9).then(|| a.map(|x| x / n))
    };
    let f = unit(fibre)?;
    let along = dot(f, sheet);
    let s = unit(std::array::from_fn(|i| sheet[i] - along * f[i]))?;
    let n = [
        f[1] * s[2] - f[2] * s[1],
        f[2] * s[0] - f[0] * s[2],
        f[0] * s[1] - f[1] * s[0],
    ];
    Some(std::array::from_fn(|i| [f[i], s[i], n[i]]))
}

/// Barycentric coordinates of a point in an element.
fn barycentric(mesh: &TetMesh, e: usize, x: [f64; 3]) -> [f64; 4] {
    let corners = mesh.corners(e);
    let (gradients, _) = shape_gradients(corners);
    std::array::from_fn(|k| {
        1.0 + (0..3)
            .map(|i| gradients[k][i] * (x[i] - corners[k][i]))
            .sum::<f64>()
    })
}

/// Fibre frame at a point of an element, interpolated from the directions at its nodes.
fn frame_at(mesh: &TetMesh, e: usize, x: [f64; 3]) -> Option<Frame> {
    let frame = mesh.fibres.frame(&mesh.tets[e], &barycentric(mesh, e, x))?;
    orthonormal(frame.fibre, frame.sheet)
}

const AXES: Frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn fibres(file: &Path, parsed: &CaseFile, mesh: &TetMesh) -> Result<FrameAt, CaseError> {
    match &parsed.fibres {
        FibreTable::FromMesh => {
            if mesh.frames.len() != mesh.n_tets() {
                let found = format!("{} fibres in the mesh", mesh.frames.len());
                let expected = format!(
                    "{}, one for each element: add them, or give another rule",
                    mesh.n_tets()
                );
                return Err(CaseError::key(file, "fibres.rule", found, expected));
            }
            let frames: Vec<Frame> = mesh
                .frames
                .iter()
                .map(|f| orthonormal(f.fibre, f.sheet).unwrap_or(AXES))
                .collect();
            if !mesh.fibres.at_nodes() {
                return Ok(Box::new(move |e, _| frames[e]));
            }
            let mesh = mesh.clone();
            Ok(Box::new(move |e, x| {
                frame_at(&mesh, e, x).unwrap_or(frames[e])
            }))
        }
        FibreTable::Constant { fibre, sheet } => {
            let frame = orthonormal(*fibre, *sheet).ok_or_else(|| {
                let found = format!("{fibre:?} and {sheet:?}");
                CaseError::key(
                    file,
                    "fibres.fibre, fibres.sheet",
                    found,
                    "two directions that are not parallel",
                )
            })?;
            Ok(Box::new(move |_, _| frame))
        }
        FibreTable::Ellipsoid {
            axis,
            short_mm,
            long_mm,
            alpha_deg,
            depth,
        } => {
            for (key, pair) in [("short_mm", short_mm), ("long_mm", long_mm)] {
                if !(pair[0] > 0.0 && pair[1] > pair[0]) {
                    let expected = "two half-axes, the endocardium's first and smaller";
                    return Err(CaseError::key(
                        file,
                        format!("fibres.{key}"),
                        format!("{pair:?}"),
                        expected,
                    ));
                }
            }
            let rule = EllipsoidFibres {
                axis: names::axis(*axis),
                short_mm: *short_mm,
                long_mm: *long_mm,
                alpha_deg: *alpha_deg,
            };
            match depth {
                DepthTable::Geometry => Ok(Box::new(move |_, x| rule.frame(x, rule.depth(x)))),
                DepthTable::Laplace {
                    endocardium,
                    epicardium,
                } => {
                    let depth = laplace_depth(file, mesh, endocardium, epicardium)?;
                    let mesh = mesh.clone();
                    Ok(Box::new(move |e, x| {
                        let shares = barycentric(&mesh, e, x);
                        rule.frame(
                            x,
                            (0..4)
                                .map(|k| shares[k] * depth[mesh.tets[e][k] as usize])
                                .sum(),
                        )
                    }))
                }
            }
        }
        FibreTable::LaplaceDirichlet {
            endocardium,
            epicardium,
            base,
            alpha_deg,
            beta_deg,
        } => {
            let mut named = mesh.clone();
            named.surfaces.clear();
            for (key, theirs, ours) in [
                ("endocardium", endocardium, surface_names::ENDOCARDIUM),
                ("epicardium", epicardium, surface_names::EPICARDIUM),
                ("base", base, surface_names::RIM),
            ] {
                let triangles = surface(file, mesh, &format!("fibres.{key}"), theirs)?;
                named.surfaces.push(cardiotwin_mesh::Surface {
                    name: ours.to_owned(),
                    triangles,
                });
            }
            let mut tags = mesh.tags.clone();
            tags.sort_unstable();
            tags.dedup();
            let angles = FibreAngles {
                alpha_endo_deg: alpha_deg[0],
                alpha_epi_deg: alpha_deg[1],
                beta_endo_deg: beta_deg[0],
                beta_epi_deg: beta_deg[1],
            };
            let found = fields(&named, &tags, Longitudinal::FromBase).map_err(|e| {
                CaseError::key(file, "fibres", chain(&e), "fields that can be solved for")
            })?;
            named.fibres = rule(&named, &tags, &found, &angles);
            Ok(Box::new(move |e, x| frame_at(&named, e, x).unwrap_or(AXES)))
        }
    }
}

/// Transmural depth: 0 at the nodes of the surfaces `endo`, 1 at those of `epi`, harmonic in
/// between.
fn laplace_depth(
    file: &Path,
    mesh: &TetMesh,
    endo: &[String],
    epi: &[String],
) -> Result<Vec<f64>, CaseError> {
    let mut given = vec![None; mesh.n_nodes()];
    for (key, names, value) in [("endocardium", endo, 0.0), ("epicardium", epi, 1.0)] {
        for name in names {
            for node in surface(file, mesh, &format!("fibres.depth.{key}"), name)?
                .into_iter()
                .flatten()
            {
                given[node as usize] = Some(value);
            }
        }
    }
    laplace::solve(
        "depth",
        mesh,
        &Alone(mesh.n_nodes()),
        &|_| true,
        &given,
        0.0,
    )
    .map_err(|e| {
        CaseError::key(
            file,
            "fibres.depth",
            chain(&e),
            "a field that can be solved for",
        )
    })
}

/// Midpoints of the named surfaces' edges, moved onto their ellipsoids along the ray from the
/// origin.
fn curved(file: &Path, parsed: &CaseFile, mesh: &TetMesh) -> Result<Middles, CaseError> {
    let mut middles = Middles::new();
    let Some(table) = &parsed.mesh.curved else {
        return Ok(middles);
    };
    let axis = names::axis(table.axis);
    for (k, s) in table.surface.iter().enumerate() {
        for (name, value) in [("short_mm", s.short_mm), ("long_mm", s.long_mm)] {
            if !(value > 0.0 && value.is_finite()) {
                let key = format!("mesh.curved.surface[{k}].{name}");
                return Err(CaseError::key(
                    file,
                    key,
                    value.to_string(),
                    "more than zero",
                ));
            }
        }
        for t in surface(
            file,
            mesh,
            &format!("mesh.curved.surface[{k}].name"),
            &s.name,
        )? {
            for (a, b) in cardiotwin_mesh::surface::edges(t) {
                let (p, q) = (mesh.nodes_mm[a as usize], mesh.nodes_mm[b as usize]);
                let m: [f64; 3] = std::array::from_fn(|i| 0.5 * (p[i] + q[i]));
                let level: f64 = (0..3)
                    .map(|i| (m[i] / if i == axis { s.long_mm } else { s.short_mm }).powi(2))
                    .sum::<f64>()
                    .sqrt();
                middles.insert((a.min(b), a.max(b)), m.map(|x| x / level));
            }
        }
    }
    Ok(middles)
}
