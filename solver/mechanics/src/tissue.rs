//! Fibres and activation times of a mesh on one rank or several, each with a part of it.
//!
//! Rank 0 has the mesh, sends the other ranks their parts ([`TissueJob::lead`], [`serve`]) and
//! collects their results; threads take their parts themselves ([`TissueJob::on_threads`]). Fibres
//! are the same to the bit on any number of ranks ([`cardiotwin_mesh::joint`]), times to round-off,
//! 1e-10 ms.

use cardiotwin_linalg::parallel::{
    Communicator, MessageReader, MessageWriter, Part, PartitionError, RankFailure, SingleProcess,
    ThreadSettings, on_threads, owners,
};
use cardiotwin_mesh::eikonal::{Conduction, EikonalError, Site, Speeds, activation_of_part};
use cardiotwin_mesh::fibres::{
    FibreAngles, Longitudinal, fields_of_part, frames_at_centroids, rule_of_part,
};
use cardiotwin_mesh::joint::Joint;
use cardiotwin_mesh::laplace::LaplaceError;
use cardiotwin_mesh::surface::Surface;
use cardiotwin_mesh::{Frame, NodeFibres, TetMesh};
use cardiotwin_units::Ms;

use crate::fibre_message::{self, WALL_WIDTH, angle_numbers, angles_of, wall_numbers, wall_of};

/// Meshes of fewer nodes stay on one rank.
pub const FEWEST_NODES: usize = 3000;

/// Reasons why a mesh has no fibres or no activation times.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TissueError {
    /// The fields of the fibre rule cannot be computed.
    #[error(transparent)]
    Fibres(#[from] LaplaceError),
    /// The activation times cannot be computed.
    #[error(transparent)]
    Activation(#[from] EikonalError),
    /// The mesh cannot be cut into parts.
    #[error(transparent)]
    Partition(#[from] PartitionError),
    /// The system starts no thread for a rank.
    #[error(transparent)]
    Rank(#[from] RankFailure),
}

/// Fibres and activation times to compute for a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct TissueJob {
    /// Tags of the elements that are muscle.
    pub muscle: Vec<i32>,
    /// Angles of the fibres; none where the mesh has frames.
    pub fibres: Option<FibreAngles>,
    /// How activation spreads; none where no times are wanted.
    pub conduction: Option<Conduction>,
}

/// Fibres and activation times of the whole mesh; empty on all ranks but rank 0.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tissue {
    /// Fibre directions at nodes, where fibres were wanted.
    pub fibres: NodeFibres,
    /// Activation times of nodes \[ms\], where they were wanted; infinite at nodes that do not conduct.
    pub activation_ms: Vec<f64>,
}

/// A rank's part of a mesh: nodes, elements and surfaces in the rank's numbers.
struct Piece<'a> {
    mesh: TetMesh,
    part: Part,
    comm: &'a dyn Communicator,
}

impl Joint for Piece<'_> {
    fn n_owned(&self) -> usize {
        self.part.layout.n_owned
    }

    fn node(&self, node: usize) -> u32 {
        self.part.nodes[node]
    }

    fn element(&self, e: usize) -> u32 {
        self.part.elements[e]
    }

    fn speaks_for(&self, e: usize) -> bool {
        self.part.speaks_for[e]
    }

    fn update(&self, values: &mut [f64]) {
        self.comm.update_ghosts(&self.part.layout, 1, values);
    }

    fn sum(&self, values: &mut [f64]) {
        self.comm.sum(values);
    }

    fn max(&self, values: &mut [f64]) {
        self.comm.max(values);
    }
}

/// Part of a mesh that a rank computes, see [`Joint`].
fn part_of(mesh: &TetMesh, part: &Part) -> TetMesh {
    if part.layout.neighbours.is_empty() {
        return mesh.clone();
    }
    let elements = || part.elements.iter().map(|e| *e as usize);
    // Corners of elements that are computed are held.
    let here = |node: u32| part.local(node).unwrap_or(u32::MAX);
    let surface = |surface: &Surface| {
        let touched = surface
            .triangles
            .iter()
            .filter(|t| t.iter().any(|node| part.owned(*node).is_some()));
        let held = touched.filter(|t| t.iter().all(|node| part.local(*node).is_some()));
        Surface {
            name: surface.name.clone(),
            triangles: held.map(|t| t.map(here)).collect(),
        }
    };
    TetMesh {
        nodes_mm: part.take(1, &mesh.nodes_mm),
        tets: elements().map(|e| mesh.tets[e].map(here)).collect(),
        tags: elements().map(|e| mesh.tags[e]).collect(),
        frames: if mesh.frames.is_empty() {
            vec![]
        } else {
            elements().map(|e| mesh.frames[e]).collect()
        },
        fibres: mesh.fibres.at(part.nodes.iter().map(|node| *node as usize)),
        surfaces: mesh.surfaces.iter().map(surface).collect(),
    }
}

fn parts_of(mesh: &TetMesh, n_ranks: usize) -> Result<Vec<Part>, PartitionError> {
    let owners = owners(mesh.n_nodes(), &mesh.tets, n_ranks)?;
    Ok((0..n_ranks)
        .map(|rank| Part::of(rank, &owners, &mesh.tets))
        .collect())
}

fn numbers(frame: &Frame) -> [[f64; 3]; 3] {
    [frame.fibre, frame.sheet, frame.normal]
}

fn frame([fibre, sheet, normal]: [[f64; 3]; 3]) -> Frame {
    Frame {
        fibre,
        sheet,
        normal,
    }
}

/// Tags are whole numbers of 32 bits, exact among numbers.
fn pack_tags(tags: &[i32], to: &mut MessageWriter) {
    to.numbers(&tags.iter().map(|tag| f64::from(*tag)).collect::<Vec<f64>>());
}

fn unpack_tags(from: &mut MessageReader<'_>) -> Vec<i32> {
    from.numbers().iter().map(|tag| *tag as i32).collect()
}

fn pack_mesh(mesh: &TetMesh, to: &mut MessageWriter) {
    to.numbers(mesh.nodes_mm.as_flattened())
        .indices(mesh.tets.as_flattened());
    pack_tags(&mesh.tags, to);
    to.numbers(
        mesh.frames
            .iter()
            .map(numbers)
            .collect::<Vec<_>>()
            .as_flattened()
            .as_flattened(),
    );
    fibre_message::pack(&mesh.fibres, to);
    to.indices(&[mesh.surfaces.len() as u32]);
    for Surface { name, triangles } in &mesh.surfaces {
        to.indices(&name.bytes().map(u32::from).collect::<Vec<u32>>())
            .indices(triangles.as_flattened());
    }
}

fn unpack_mesh(from: &mut MessageReader<'_>) -> TetMesh {
    let nodes_mm = from.numbers().as_chunks().0.to_vec();
    let tets = from.indices().as_chunks().0.to_vec();
    let tags = unpack_tags(from);
    let frames = from
        .numbers()
        .as_chunks::<3>()
        .0
        .as_chunks::<3>()
        .0
        .iter()
        .map(|axes| frame(*axes))
        .collect();
    let fibres = fibre_message::unpack(from);
    let n_surfaces = from.indices()[0];
    let mut surface = |_| {
        let name: Vec<u8> = from.indices().into_iter().map(|byte| byte as u8).collect();
        let triangles = from.indices().as_chunks().0.to_vec();
        Surface {
            name: String::from_utf8_lossy(&name).into_owned(),
            triangles,
        }
    };
    let surfaces = (0..n_surfaces).map(&mut surface).collect();
    TetMesh {
        nodes_mm,
        tets,
        tags,
        frames,
        fibres,
        surfaces,
    }
}

impl TissueJob {
    fn pack(&self, to: &mut MessageWriter) {
        pack_tags(&self.muscle, to);
        to.numbers(
            self.fibres
                .as_ref()
                .map(angle_numbers)
                .as_ref()
                .map_or(&[], |angles| &angles[..]),
        );
        to.flags(&[self.conduction.is_some()]);
        if let Some(Conduction {
            speeds,
            endocardial_speed,
            tags,
            sites,
        }) = &self.conduction
        {
            to.numbers(&[speeds.fibre, speeds.sheet, speeds.normal]);
            to.numbers(endocardial_speed.as_slice());
            pack_tags(tags, to);
            let site = |s: &Site| [s.at_mm[0], s.at_mm[1], s.at_mm[2], s.radius_mm, s.time.0];
            to.numbers(sites.iter().map(site).collect::<Vec<_>>().as_flattened());
        }
    }

    fn unpack(from: &mut MessageReader<'_>) -> Self {
        let muscle = unpack_tags(from);
        let fibres = angles_of(from.numbers());
        let conduction = from.flags()[0].then(|| {
            let speeds = from.numbers();
            let speeds = Speeds {
                fibre: speeds[0],
                sheet: speeds[1],
                normal: speeds[2],
            };
            let endocardial_speed = from.numbers().first().copied();
            let tags = unpack_tags(from);
            let site = |s: &[f64; 5]| Site {
                at_mm: [s[0], s[1], s[2]],
                radius_mm: s[3],
                time: Ms(s[4]),
            };
            let sites = from.numbers().as_chunks().0.iter().map(site).collect();
            Conduction {
                speeds,
                endocardial_speed,
                tags,
                sites,
            }
        });
        Self {
            muscle,
            fibres,
            conduction,
        }
    }

    /// A rank's part. Collective.
    fn run(&self, mut piece: Piece<'_>, fibres_done: &dyn Fn()) -> Result<Tissue, TissueError> {
        let places: Vec<f64> = piece
            .part
            .owned_nodes()
            .iter()
            .map(|node| f64::from(*node))
            .collect();
        let mut fibres = NodeFibres::PerElement;
        if let Some(angles) = &self.fibres {
            let fields = fields_of_part(&piece.mesh, &piece, &self.muscle, Longitudinal::FromBase)?;
            piece.mesh.fibres = rule_of_part(&piece.mesh, &piece, &self.muscle, &fields, angles);
            piece.mesh.frames = frames_at_centroids(&piece.mesh, &self.muscle);
            let NodeFibres::Rule { walls, .. } = &piece.mesh.fibres else {
                unreachable!("the rule's")
            };
            let own: Vec<_> = walls[..places.len()].iter().map(wall_numbers).collect();
            let walls = merged::<WALL_WIDTH>(piece.comm, &places, own.as_flattened());
            fibres = NodeFibres::Rule {
                walls: walls.into_iter().map(wall_of).collect(),
                angles: *angles,
            };
        }
        fibres_done();
        let mut activation_ms = vec![];
        if let Some(conduction) = &self.conduction {
            let times = activation_of_part(&piece.mesh, &piece, conduction)?;
            activation_ms =
                merged::<1>(piece.comm, &places, &times[..places.len()]).into_flattened();
        }
        Ok(Tissue {
            fibres,
            activation_ms,
        })
    }

    /// On several threads, each with a part; on the calling one for a mesh of few nodes. `fibres_done` is called once fibres are.
    ///
    /// # Errors
    /// [`TissueError`].
    pub fn on_threads(
        &self,
        mesh: &TetMesh,
        n_threads: usize,
        settings: ThreadSettings,
        fibres_done: &(dyn Fn() + Sync),
    ) -> Result<Tissue, TissueError> {
        if n_threads <= 1 || mesh.n_nodes() < FEWEST_NODES {
            let part = Part::whole(mesh.n_nodes(), mesh.n_tets());
            return self.run(
                Piece {
                    mesh: mesh.clone(),
                    part,
                    comm: &SingleProcess,
                },
                fibres_done,
            );
        }
        let parts = parts_of(mesh, n_threads)?;
        let found = on_threads(n_threads, settings, |comm| {
            let part = parts[comm.rank()].clone();
            let piece = Piece {
                mesh: part_of(mesh, &part),
                part,
                comm: &comm,
            };
            self.run(piece, &|| {
                if comm.rank() == 0 {
                    fibres_done()
                }
            })
        })?;
        found
            .into_iter()
            .next()
            .unwrap_or_else(|| unreachable!("there is a rank 0"))
    }

    /// Rank 0 of ranks that call [`serve`]: `begin` is called once the mesh is cut, to call them. Collective from there on.
    ///
    /// # Errors
    /// [`TissueError`], on all ranks but for a mesh that cannot be cut.
    pub fn lead<S>(
        &self,
        mesh: &TetMesh,
        comm: &dyn Communicator,
        begin: impl FnOnce() -> S,
        fibres_done: &dyn Fn(),
    ) -> Result<Tissue, TissueError> {
        let parts = parts_of(mesh, comm.n_ranks())?;
        let _session = begin();
        let message = |part: &Part| {
            let mut message = MessageWriter::default();
            self.pack(&mut message);
            part.pack(&mut message);
            pack_mesh(&part_of(mesh, part), &mut message);
            message.numbers
        };
        comm.scatter(
            parts
                .iter()
                .enumerate()
                .map(|(k, part)| if k == 0 { vec![] } else { message(part) })
                .collect(),
        );
        let Some(part) = parts.into_iter().next() else {
            unreachable!("there is a rank 0")
        };
        self.run(
            Piece {
                mesh: part_of(mesh, &part),
                part,
                comm,
            },
            fibres_done,
        )
    }
}

/// Any other rank's part of what [`TissueJob::lead`] does on rank 0, which says what went wrong. Collective.
pub fn serve(comm: &dyn Communicator) {
    let numbers = comm.scatter(vec![]);
    let mut from = MessageReader::new(&numbers);
    let job = TissueJob::unpack(&mut from);
    let part = Part::unpack(&mut from);
    let mesh = unpack_mesh(&mut from);
    drop(numbers);
    let _ = job.run(Piece { mesh, part, comm }, &|| {});
}

/// Values of all ranks in the order of their places in the whole mesh, on rank 0; nothing elsewhere. Collective.
fn merged<const WIDTH: usize>(
    comm: &dyn Communicator,
    places: &[f64],
    values: &[f64],
) -> Vec<[f64; WIDTH]> {
    let of_ranks = (comm.gather(places), comm.gather(values));
    let (Some(places), Some(values)) = of_ranks else {
        return vec![];
    };
    let mut all = vec![[0.0; WIDTH]; places.iter().map(Vec::len).sum()];
    for (places, values) in places.iter().zip(&values) {
        for (place, value) in places.iter().zip(values.as_chunks::<WIDTH>().0) {
            all[*place as usize] = *value;
        }
    }
    all
}
