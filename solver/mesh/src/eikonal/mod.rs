//! Activation times from the anisotropic eikonal equation, sqrt(∇t · V ∇t) = 1, with V the tensor
//! of squared speeds.
//!
//! The arrival time at a corner of an element is the minimum, over the opposite face, of the
//! arrival time on the face plus the travel time with the element's own speeds. Linear fields, that
//! is, plane waves, are exact. Corners are visited in the order of their times, and again if a
//! later visit makes them earlier, until nothing changes. The result is the fixed point, whatever
//! the numbering. In parallel, each part settles its own nodes up to a time, receives the times of
//! its neighbours' nodes, and continues, until no part has changes.
//!
//! Sources: Fu, Kirby, Whitaker 2013, "Fast iterative method for the eikonal equation on
//! tetrahedral domains", SIAM J. Sci. Comput. 35, C473, for the update; the specification of the
//! model in `docs/models.md`.

mod update;

use crate::adjacency::Adjacency;
use crate::joint::{Alone, Joint, any, first, flags, nearest};
use crate::tet_mesh::{EDGES, Frame, TetMesh, surface_names, tags};
use crate::vec3::{Vec3, distance, dot, norm, sub};
use cardiotwin_units::Ms;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Conduction speeds \[mm/ms\] (= m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Speeds {
    /// Speed along the fibre.
    pub fibre: f64,
    /// Speed across the fibre, in the sheet.
    pub sheet: f64,
    /// Speed across the sheet.
    pub normal: f64,
}

impl Default for Speeds {
    /// 0.6 along the fibre, 0.3 across it. These values are our assumption.
    fn default() -> Self {
        Self {
            fibre: 0.6,
            sheet: 0.3,
            normal: 0.3,
        }
    }
}

/// Speed in the endocardial sheet \[mm/ms\]. With this speed, a generated ventricle is activated in
/// 40 to 60 ms from its three fascicles. The value is our assumption.
pub const ENDOCARDIAL_SPEED: f64 = 4.0;

/// Site at which activation begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Position. The nearest conducting node is always activated.
    pub at_mm: Vec3,
    /// Radius within which all conducting nodes are activated with the travel time from the site in
    /// its own tissue. An exact ball around a point keeps the point's singularity out of the error.
    pub radius_mm: f64,
    /// Time at which the site is activated.
    pub time: Ms,
}

/// Conducting tissue and activation sites.
#[derive(Debug, Clone, PartialEq)]
pub struct Conduction {
    /// Conduction speeds in the wall.
    pub speeds: Speeds,
    /// Conduction speed \[mm/ms\] in a thin sheet on the endocardium, which represents the Purkinje
    /// fibres; `None` for no sheet. The sheet has no thickness, so that its effect does not depend
    /// on the mesh.
    pub endocardial_speed: Option<f64>,
    /// Tags of conducting tissue.
    pub tags: Vec<i32>,
    /// Sites at which activation begins.
    pub sites: Vec<Site>,
}

impl Conduction {
    /// Sinus rhythm of a left ventricle, with the assumed speeds in the wall and along the
    /// endocardium.
    #[must_use]
    pub fn of_left_ventricle(sites: &[Site]) -> Self {
        Self {
            speeds: Speeds::default(),
            endocardial_speed: Some(ENDOCARDIAL_SPEED),
            tags: vec![tags::LEFT_VENTRICLE],
            sites: sites.to_vec(),
        }
    }
}

/// Reasons why activation times cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EikonalError {
    /// No activation site is given.
    #[error("eikonal: no activation site, expected at least one")]
    NoSite,
    /// A speed is not positive.
    #[error("eikonal: the {which} speed is {found} mm/ms, expected a positive number")]
    Speed {
        /// Name of the speed.
        which: &'static str,
        /// Value of the speed \[mm/ms\].
        found: f64,
    },
    /// No element has a conducting tag.
    #[error("eikonal: no element has one of the conducting tags {tags:?}")]
    NoTissue {
        /// Tags that conduct.
        tags: Vec<i32>,
    },
    /// A conducting element has no fibre direction.
    #[error("eikonal: element {element} conducts, but has no fibre; compute fibres first")]
    NoFibre {
        /// Index of the element.
        element: usize,
    },
    /// A site is too far from conducting tissue.
    #[error(
        "eikonal: site {site} lies {away_mm:.1} mm from the next conducting node, expected at most {most_mm:.1} mm: \
         check its unit"
    )]
    FarSite {
        /// Index of the site, from zero.
        site: usize,
        /// Distance to the nearest conducting node \[mm\].
        away_mm: f64,
        /// Largest accepted distance \[mm\].
        most_mm: f64,
    },
    /// Some conducting nodes are not connected to a site.
    #[error(
        "eikonal: {n} conducting nodes are not reached, the first is node {node}; expected connected tissue"
    )]
    Unreached {
        /// Number of these nodes.
        n: usize,
        /// Index of the first of them.
        node: usize,
    },
}

/// Largest accepted distance of a site from the tissue, in mean edge lengths.
const FAR_EDGES: f64 = 5.0;
/// Relative change below which a time counts as unchanged.
const SAME: f64 = 1e-13;

/// Activation time of each node \[ms\]; infinite at nodes without a conducting element.
///
/// # Errors
/// [`EikonalError`] for invalid speeds, sites or tissue.
pub fn activation_ms(mesh: &TetMesh, conduction: &Conduction) -> Result<Vec<f64>, EikonalError> {
    activation_of_part(mesh, &Alone(mesh.n_nodes()), conduction)
}

/// [`activation_ms`] of the nodes of a part. Collective.
///
/// # Errors
/// [`EikonalError`], the same on all parts, with numbers of the whole mesh.
pub fn activation_of_part(
    mesh: &TetMesh,
    joint: &dyn Joint,
    conduction: &Conduction,
) -> Result<Vec<f64>, EikonalError> {
    let front = Front::new(mesh, joint, conduction)?;
    let mut times = front.start()?;
    front.run(&mut times);
    let missed: Vec<usize> = (0..joint.n_owned())
        .filter(|node| front.conducts[*node] && times[*node].is_infinite())
        .collect();
    let mut n = [missed.len() as f64];
    joint.sum(&mut n);
    match first(joint, missed.iter().map(|node| joint.node(*node)).min()) {
        Some(node) => Err(EikonalError::Unreached {
            n: n[0] as usize,
            node: node as usize,
        }),
        None => Ok(times),
    }
}

struct Front<'a> {
    mesh: &'a TetMesh,
    joint: &'a dyn Joint,
    conduction: &'a Conduction,
    /// Nodes of conducting elements.
    conducts: Vec<bool>,
    /// Conducting elements, and those around each node.
    tets: Vec<u32>,
    around: Adjacency,
    /// Triangles of the sheet, and those around each node.
    triangles: Vec<[u32; 3]>,
    sheet_around: Vec<Vec<u32>>,
}

impl<'a> Front<'a> {
    fn new(
        mesh: &'a TetMesh,
        joint: &'a dyn Joint,
        conduction: &'a Conduction,
    ) -> Result<Self, EikonalError> {
        let Conduction {
            speeds,
            endocardial_speed,
            tags,
            sites,
        } = conduction;
        if sites.is_empty() {
            return Err(EikonalError::NoSite);
        }
        let named = [
            ("fibre", speeds.fibre),
            ("sheet", speeds.sheet),
            ("normal", speeds.normal),
        ];
        for (which, found) in named
            .into_iter()
            .chain(endocardial_speed.map(|speed| ("endocardial", speed)))
        {
            if !(found > 0.0 && found.is_finite()) {
                return Err(EikonalError::Speed { which, found });
            }
        }
        let tets: Vec<u32> = (0..mesh.n_tets())
            .filter(|e| tags.contains(&mesh.tags[*e]))
            .map(|e| e as u32)
            .collect();
        if !any(joint, !tets.is_empty()) {
            return Err(EikonalError::NoTissue { tags: tags.clone() });
        }
        let lacks = |e: &u32| {
            mesh.frames
                .get(*e as usize)
                .is_none_or(|frame| norm(frame.fibre) < 0.5)
        };
        let bare = tets
            .iter()
            .filter(|e| lacks(e))
            .map(|e| joint.element(*e as usize))
            .min();
        if let Some(element) = first(joint, bare) {
            return Err(EikonalError::NoFibre {
                element: element as usize,
            });
        }
        let mut conducts = vec![false; mesh.n_nodes()];
        let corners: Vec<[u32; 4]> = tets.iter().map(|e| mesh.tets[*e as usize]).collect();
        for node in corners.iter().flatten() {
            conducts[*node as usize] = true;
        }
        let conducts = flags(joint, &conducts);
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        if endocardial_speed.is_some() {
            let endocardium = mesh
                .surface(surface_names::ENDOCARDIUM)
                .map_or(&[][..], |s| &s.triangles);
            triangles.extend(
                endocardium
                    .iter()
                    .filter(|t| t.iter().all(|node| conducts[*node as usize])),
            );
        }
        let mut sheet_around = vec![
            Vec::new();
            if triangles.is_empty() {
                0
            } else {
                mesh.n_nodes()
            }
        ];
        for (i, triangle) in triangles.iter().enumerate() {
            for node in triangle {
                sheet_around[*node as usize].push(i as u32);
            }
        }
        let around = Adjacency::node_to_tets(mesh.n_nodes(), &corners);
        Ok(Self {
            mesh,
            joint,
            conduction,
            conducts,
            tets,
            around,
            triangles,
            sheet_around,
        })
    }

    /// Travel time of a displacement in the tissue of an element.
    fn travel_ms(&self, frame: &Frame, displacement: Vec3) -> f64 {
        norm(slowness(frame, &self.conduction.speeds, displacement))
    }

    /// Mean edge length over all parts \[mm\].
    fn mean_edge_mm(&self) -> f64 {
        let own = (0..self.mesh.n_tets()).filter(|e| self.joint.speaks_for(*e));
        let lengths: Vec<f64> = own
            .flat_map(|e| {
                let x = self.mesh.corners(e);
                EDGES.map(|[i, j]| distance(x[i], x[j]))
            })
            .collect();
        let mut sums = [lengths.iter().sum::<f64>(), lengths.len() as f64];
        self.joint.sum(&mut sums);
        sums[0] / sums[1].max(1.0)
    }

    /// Frame of an element of the whole mesh. All parts that hold the element have the same frame.
    fn frame_of(&self, element: u32) -> Frame {
        let here = self
            .tets
            .iter()
            .find(|e| self.joint.element(**e as usize) == element);
        let mut axes = [f64::NEG_INFINITY; 9];
        if let Some(Frame {
            fibre,
            sheet,
            normal,
        }) = here.map(|e| &self.mesh.frames[*e as usize])
        {
            axes.copy_from_slice([*fibre, *sheet, *normal].as_flattened());
        }
        self.joint.max(&mut axes);
        let [fibre, sheet, normal] =
            std::array::from_fn(|k| std::array::from_fn(|i| axes[3 * k + i]));
        Frame {
            fibre,
            sheet,
            normal,
        }
    }

    /// Times at the sites; infinite at all other nodes.
    fn start(&self) -> Result<Vec<f64>, EikonalError> {
        let joint = self.joint;
        let mut times = vec![f64::INFINITY; self.mesh.n_nodes()];
        let most_mm = FAR_EDGES * self.mean_edge_mm();
        for (i, site) in self.conduction.sites.iter().enumerate() {
            let away = |node: usize| distance(self.mesh.nodes_mm[node], site.at_mm);
            let own = (0..joint.n_owned()).filter(|node| self.conducts[*node]);
            let (away_mm, nearest_node) =
                nearest(joint, own.map(|node| (away(node), joint.node(node))));
            if away_mm.is_nan() || away_mm > most_mm.max(site.radius_mm) {
                return Err(EikonalError::FarSite {
                    site: i,
                    away_mm,
                    most_mm,
                });
            }
            let off = |e: usize| distance(self.mesh.centroid_mm(e), site.at_mm);
            let tets = self.tets.iter().map(|e| *e as usize);
            let (_, element) = nearest(joint, tets.map(|e| (off(e), joint.element(e))));
            let frame = self.frame_of(element.unwrap_or(0));
            let chosen = |node: &usize| {
                Some(joint.node(*node)) == nearest_node || away(*node) <= site.radius_mm
            };
            for node in (0..self.mesh.n_nodes())
                .filter(|node| self.conducts[*node])
                .filter(chosen)
            {
                let time =
                    site.time.0 + self.travel_ms(&frame, sub(self.mesh.nodes_mm[node], site.at_mm));
                times[node] = times[node].min(time);
            }
        }
        Ok(times)
    }

    /// Runs until no part has changes. Parts advance together, one window of time after the other.
    /// Ghost times are therefore late by at most one window, and little work is repeated.
    fn run(&self, times: &mut [f64]) {
        let n_owned = self.joint.n_owned();
        let window_ms = self.mean_edge_mm() / self.conduction.speeds.fibre;
        let entry = |node: usize, times: &[f64]| Reverse((Time(times[node]), node as u32));
        let reached = (0..times.len()).filter(|node| times[*node].is_finite());
        let mut waiting: BinaryHeap<_> = reached.map(|node| entry(node, times)).collect();
        loop {
            let mut earliest = [waiting
                .peek()
                .map_or(f64::NEG_INFINITY, |Reverse((Time(time), _))| -time)];
            self.joint.max(&mut earliest);
            if earliest[0] == f64::NEG_INFINITY {
                return;
            }
            self.settle(times, &mut waiting, window_ms - earliest[0]);
            let before = times[n_owned..].to_vec();
            self.joint.update(times);
            let news = (n_owned..times.len()).filter(|node| times[*node] < before[*node - n_owned]);
            waiting.extend(news.map(|node| entry(node, times)));
        }
    }

    /// Propagates times up to `end_ms` to own nodes.
    fn settle(
        &self,
        times: &mut [f64],
        waiting: &mut BinaryHeap<Reverse<(Time, u32)>>,
        end_ms: f64,
    ) {
        let n_owned = self.joint.n_owned();
        while waiting
            .peek()
            .is_some_and(|Reverse((Time(time), _))| *time <= end_ms)
        {
            let Some(Reverse((Time(time), node))) = waiting.pop() else {
                break;
            };
            if time > times[node as usize] {
                continue; // the node has become earlier since
            }
            let mut better = |corner: u32, arrival: f64, times: &mut [f64]| {
                let old = times[corner as usize];
                if arrival < old && (old.is_infinite() || old - arrival > SAME * old.abs().max(1.0))
                {
                    times[corner as usize] = arrival;
                    waiting.push(Reverse((Time(arrival), corner)));
                }
            };
            for i in self.around.row(node as usize) {
                let e = self.tets[*i as usize] as usize;
                let tet = self.mesh.tets[e];
                for k in (0..4).filter(|k| tet[*k] != node && (tet[*k] as usize) < n_owned) {
                    let arrival = self.arrival_in_tet(e, k, times);
                    better(tet[k], arrival, times);
                }
            }
            if let Some(sheet) = self.sheet_around.get(node as usize) {
                for i in sheet {
                    let triangle = self.triangles[*i as usize];
                    for k in
                        (0..3).filter(|k| triangle[*k] != node && (triangle[*k] as usize) < n_owned)
                    {
                        let arrival = self.arrival_in_sheet(triangle, k, times);
                        better(triangle[k], arrival, times);
                    }
                }
            }
        }
    }

    fn arrival_in_tet(&self, e: usize, corner: usize, times: &[f64]) -> f64 {
        let tet = self.mesh.tets[e];
        let frame = &self.mesh.frames[e];
        let x = self.mesh.nodes_mm[tet[corner] as usize];
        let others: [u32; 3] = std::array::from_fn(|i| tet[(corner + 1 + i) % 4]);
        let rays = others.map(|n| {
            slowness(
                frame,
                &self.conduction.speeds,
                sub(self.mesh.nodes_mm[n as usize], x),
            )
        });
        update::arrival(&rays, &others.map(|n| times[n as usize]))
    }

    fn arrival_in_sheet(&self, triangle: [u32; 3], corner: usize, times: &[f64]) -> f64 {
        let speed = self.conduction.endocardial_speed.unwrap_or(f64::NAN);
        let x = self.mesh.nodes_mm[triangle[corner] as usize];
        let others = [triangle[(corner + 1) % 3], triangle[(corner + 2) % 3]];
        let rays = others.map(|n| sub(self.mesh.nodes_mm[n as usize], x).map(|d| d / speed));
        update::arrival(&rays, &others.map(|n| times[n as usize]))
    }
}

/// Travel time of a displacement \[ms\], as a vector: its components along the three directions,
/// each divided by its speed.
fn slowness(frame: &Frame, speeds: &Speeds, displacement: Vec3) -> Vec3 {
    [
        dot(displacement, frame.fibre) / speeds.fibre,
        dot(displacement, frame.sheet) / speeds.sheet,
        dot(displacement, frame.normal) / speeds.normal,
    ]
}

/// A time with a total order.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Time(f64);

impl Eq for Time {}

impl PartialOrd for Time {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Time {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

#[cfg(test)]
mod tests;
