//! One rank's part of an anatomy in step 0.

use std::borrow::Cow;
use std::sync::Arc;

use cardiotwin_linalg::parallel::{
    Communicator, MessageReader, MessageWriter, Part, PartitionError, SingleProcess, owners,
};

use super::anatomy::{Anatomy, LongAxis, Tets, Triangles};
use super::right_ventricle::RightVentricle;
use crate::element::kernel::VolumeChange;
use crate::fibre_message;

/// A rank's part of an anatomy, and its connection to the other ranks.
#[derive(Debug, Clone)]
pub struct Piece<'a> {
    /// Nodes, elements and surfaces in the rank's own numbering, see [`Anatomy::part`].
    pub anatomy: Cow<'a, Anatomy>,
    /// Their numbers in the whole mesh.
    pub part: Part,
    /// Communicator of the ranks.
    pub comm: Arc<dyn Communicator>,
}

impl<'a> Piece<'a> {
    /// A whole anatomy on one rank.
    #[must_use]
    pub fn whole(anatomy: &'a Anatomy) -> Self {
        let part = Part::whole(anatomy.nodes.len(), anatomy.corners.len());
        Self {
            anatomy: Cow::Borrowed(anatomy),
            part,
            comm: Arc::new(SingleProcess),
        }
    }

    /// One rank's part of an anatomy.
    #[must_use]
    pub fn of(anatomy: &'a Anatomy, part: Part, comm: Arc<dyn Communicator>) -> Self {
        Self {
            anatomy: anatomy.part(&part),
            part,
            comm,
        }
    }

    /// Rank 0's part; sends the other ranks their `parts` ([`Self::received`]), so that none of them ever holds the mesh.
    /// Collective.
    #[must_use]
    pub fn sent(anatomy: &'a Anatomy, parts: Vec<Part>, comm: Arc<dyn Communicator>) -> Self {
        let message = |part: &Part| {
            let mut message = MessageWriter::default();
            part.pack(&mut message);
            pack(&anatomy.part(part), &mut message);
            message.numbers
        };
        comm.scatter(
            parts
                .iter()
                .enumerate()
                .map(|(k, part)| if k == 0 { vec![] } else { message(part) })
                .collect(),
        );
        let Some(own) = parts.into_iter().next() else {
            unreachable!("there is a rank 0")
        };
        Self::of(anatomy, own, comm)
    }

    /// Receives another rank's part from rank 0. Collective.
    #[must_use]
    pub fn received(comm: Arc<dyn Communicator>) -> Piece<'static> {
        let numbers = comm.scatter(vec![]);
        let mut from = MessageReader::new(&numbers);
        let part = Part::unpack(&mut from);
        Piece {
            anatomy: Cow::Owned(unpack(&mut from)),
            part,
            comm,
        }
    }

    /// Gathers nodal values of all ranks, `width` a node, into those of the whole mesh on rank 0; `None` elsewhere. Collective.
    #[must_use]
    pub fn gathered(&self, width: usize, values: &[f64]) -> Option<Vec<f64>> {
        let owned: Vec<f64> = self
            .part
            .owned_nodes()
            .iter()
            .map(|node| f64::from(*node))
            .collect();
        let (numbers, of_ranks) = (
            self.comm.gather(&owned),
            self.comm.gather(&values[..width * owned.len()]),
        );
        let (numbers, of_ranks) = (numbers?, of_ranks?);
        let mut all = vec![0.0; of_ranks.iter().map(Vec::len).sum()];
        for (node, values) in numbers
            .iter()
            .zip(&of_ranks)
            .flat_map(|(n, v)| n.iter().zip(v.chunks_exact(width)))
        {
            all[*node as usize * width..][..width].copy_from_slice(values);
        }
        Some(all)
    }
}

/// Partitions a mesh of linear elements among ranks.
///
/// # Errors
/// [`PartitionError`] where the mesh cannot be partitioned.
pub fn parts_of(anatomy: &Anatomy, n_ranks: usize) -> Result<Vec<Part>, PartitionError> {
    if n_ranks <= 1 {
        return Ok(vec![Part::whole(
            anatomy.nodes.len(),
            anatomy.corners.len(),
        )]);
    }
    let owners = owners(anatomy.n_vertices, &anatomy.corners, n_ranks)?;
    Ok((0..n_ranks)
        .map(|rank| Part::of(rank, &owners, &anatomy.corners))
        .collect())
}

/// Appends an anatomy of linear elements to a message.
///
/// # Panics
/// For quadratic elements, which are never partitioned.
pub(super) fn pack(anatomy: &Anatomy, to: &mut MessageWriter) {
    let triangles = |surface: &Triangles| match surface {
        Triangles::Linear(triangles) => triangles.clone(),
        Triangles::Quadratic(_) => unreachable!("quadratic elements stay on one rank"),
    };
    to.numbers(anatomy.nodes.as_flattened())
        .indices(anatomy.corners.as_flattened());
    to.numbers(&match anatomy.volume {
        VolumeChange::Pointwise => vec![],
        VolumeChange::Nodal { pointwise_share } => vec![pointwise_share],
    });
    // Signed tags travel as bits, since the message's indices are unsigned.
    to.indices(
        &anatomy
            .tags
            .iter()
            .map(|tag| tag.cast_unsigned())
            .collect::<Vec<u32>>(),
    );
    to.flags(&anatomy.contracts)
        .numbers(anatomy.frames.as_flattened().as_flattened());
    fibre_message::pack(&anatomy.fibres, to);
    to.numbers(&anatomy.depth);
    for surface in [&anatomy.endocardium, &anatomy.epicardium, &anatomy.rim]
        .into_iter()
        .chain(&anatomy.septum)
    {
        to.indices(triangles(surface).as_flattened());
    }
    if anatomy.septum.is_none() {
        to.indices(&[]);
    }
    to.numbers(&anatomy.axis.apex_mm)
        .numbers(&anatomy.axis.base_mm);
    to.flags(&[anatomy.septum.is_some()])
        .indices(&[anatomy.openings.len() as u32]);
    anatomy
        .openings
        .iter()
        .for_each(|nodes| _ = to.indices(nodes));
    to.flags(&[anatomy.right.is_some()]);
    if let Some(right) = &anatomy.right {
        for surface in [&right.endocardium, &right.ring, &right.left_ring] {
            to.indices(triangles(surface).as_flattened());
        }
        to.indices(&[right.openings.len() as u32]);
        right
            .openings
            .iter()
            .for_each(|nodes| _ = to.indices(nodes));
    }
    to.indices(&[anatomy.further.len() as u32]);
    for (name, surface) in &anatomy.further {
        to.indices(&name.bytes().map(u32::from).collect::<Vec<u32>>())
            .indices(triangles(surface).as_flattened());
    }
}

/// Reads an anatomy that [`pack`] wrote.
pub(super) fn unpack(from: &mut MessageReader<'_>) -> Anatomy {
    let nodes = from.numbers().as_chunks().0.to_vec();
    let tets: Vec<[u32; 4]> = from.indices().as_chunks().0.to_vec();
    let volume = match from.numbers() {
        [pointwise_share] => VolumeChange::Nodal {
            pointwise_share: *pointwise_share,
        },
        _ => VolumeChange::Pointwise,
    };
    let tags = from.indices().into_iter().map(u32::cast_signed).collect();
    let (contracts, frames) = (
        from.flags(),
        from.numbers()
            .as_chunks::<3>()
            .0
            .as_chunks::<3>()
            .0
            .to_vec(),
    );
    let (fibres, depth) = (fibre_message::unpack(from), from.numbers().to_vec());
    let triangles =
        |from: &mut MessageReader<'_>| Triangles::Linear(from.indices().as_chunks().0.to_vec());
    let [endocardium, epicardium, rim, septum] = std::array::from_fn(|_| triangles(from));
    let mut point = || {
        let x = from.numbers();
        [x[0], x[1], x[2]]
    };
    let axis = LongAxis {
        apex_mm: point(),
        base_mm: point(),
    };
    let septum = from.flags()[0].then_some(septum);
    let openings =
        |from: &mut MessageReader<'_>| (0..from.indices()[0]).map(|_| from.indices()).collect();
    let own_openings = openings(from);
    let right = from.flags()[0].then(|| {
        let [endocardium, ring, left_ring] = std::array::from_fn(|_| triangles(from));
        RightVentricle {
            endocardium,
            openings: openings(from),
            ring,
            left_ring,
        }
    });
    let further = (0..from.indices()[0])
        .map(|_| {
            let name: Vec<u8> = from.indices().into_iter().map(|byte| byte as u8).collect();
            (String::from_utf8_lossy(&name).into_owned(), triangles(from))
        })
        .collect();
    Anatomy {
        n_vertices: nodes.len(),
        nodes,
        tets: Tets::Linear(tets.clone()),
        corners: tets,
        volume,
        contracts,
        tags,
        frames,
        fibres,
        depth,
        endocardium,
        epicardium,
        septum,
        rim,
        right,
        further,
        axis,
        openings: own_openings,
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
    use cardiotwin_mesh::fibres::{FibreAngles, make};
    use cardiotwin_mesh::tags;
    use cardiotwin_units::Ml;

    use super::super::anatomy::ElementKind;
    use super::*;
    use cardiotwin_linalg::parallel::{ThreadSettings, on_threads};

    #[test]
    fn a_piece_arrives_as_it_was_cut_and_pieces_make_up_the_whole() {
        let mut mesh = generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), 600))
            .expect("a mesh")
            .mesh;
        make(&mut mesh, &[tags::LEFT_VENTRICLE], &FibreAngles::default()).expect("fields");
        for kind in [ElementKind::LINEAR_NODAL, ElementKind::LINEAR_POINTWISE] {
            let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], kind).expect("an anatomy");
            let parts = parts_of(&anatomy, 3).expect("a cut");
            let whole = on_threads(3, ThreadSettings::default(), |comm| {
                let (rank, comm): (usize, Arc<dyn Communicator>) = (comm.rank(), Arc::new(comm));
                let piece = match rank {
                    0 => Piece::sent(&anatomy, parts.clone(), comm),
                    _ => Piece::received(comm),
                };
                assert_eq!(piece.part, parts[rank]);
                assert_eq!(*piece.anatomy, *anatomy.part(&parts[rank]));
                piece.gathered(3, piece.anatomy.nodes.as_flattened())
            })
            .expect("no rank fails");
            assert_eq!(
                whole,
                [Some(anatomy.nodes.as_flattened().to_vec()), None, None]
            );
        }
    }
}
