//! Fibre directions at nodes in a message.

use cardiotwin_mesh::fibres::FibreAngles;
use cardiotwin_mesh::node_fibres::WallPoint;
use cardiotwin_mesh::{Frame, NodeFibres};

use cardiotwin_linalg::parallel::{MessageReader, MessageWriter};

/// Numbers of a [`WallPoint`].
pub const WALL_WIDTH: usize = 7;

/// Numbers of a direction of the wall.
#[must_use]
pub fn wall_numbers(wall: &WallPoint) -> [f64; WALL_WIDTH] {
    let WallPoint { out, up, depth } = wall;
    [out[0], out[1], out[2], up[0], up[1], up[2], *depth]
}

/// The direction of the wall with these numbers.
#[must_use]
pub fn wall_of([a, b, c, d, e, f, depth]: [f64; WALL_WIDTH]) -> WallPoint {
    WallPoint {
        out: [a, b, c],
        up: [d, e, f],
        depth,
    }
}

/// Angles of the rule as numbers.
#[must_use]
pub fn angle_numbers(a: &FibreAngles) -> [f64; 4] {
    [
        a.alpha_endo_deg,
        a.alpha_epi_deg,
        a.beta_endo_deg,
        a.beta_epi_deg,
    ]
}

/// Angles of the rule; `None` for another count of numbers.
#[must_use]
pub fn angles_of(numbers: &[f64]) -> Option<FibreAngles> {
    let [alpha_endo_deg, alpha_epi_deg, beta_endo_deg, beta_epi_deg] = *numbers else {
        return None;
    };
    Some(FibreAngles {
        alpha_endo_deg,
        alpha_epi_deg,
        beta_endo_deg,
        beta_epi_deg,
    })
}

/// Adds a field to a message.
pub fn pack(fibres: &NodeFibres, to: &mut MessageWriter) {
    let axes = |f: &Frame| [f.fibre, f.sheet, f.normal];
    match fibres {
        NodeFibres::PerElement => to.numbers(&[]).numbers(&[]),
        NodeFibres::Frames(frames) => to.numbers(&[]).numbers(
            frames
                .iter()
                .map(axes)
                .collect::<Vec<_>>()
                .as_flattened()
                .as_flattened(),
        ),
        NodeFibres::Rule { walls, angles } => {
            let values: Vec<_> = walls.iter().map(wall_numbers).collect();
            to.numbers(&angle_numbers(angles))
                .numbers(values.as_flattened())
        }
    };
}

/// Reads what [`pack`] wrote.
pub fn unpack(from: &mut MessageReader<'_>) -> NodeFibres {
    let (angles, values) = (angles_of(from.numbers()), from.numbers());
    match angles {
        Some(angles) => {
            let walls = values
                .as_chunks::<WALL_WIDTH>()
                .0
                .iter()
                .map(|w| wall_of(*w))
                .collect();
            NodeFibres::Rule { walls, angles }
        }
        None if values.is_empty() => NodeFibres::PerElement,
        None => {
            let frame = |[fibre, sheet, normal]: &[[f64; 3]; 3]| Frame {
                fibre: *fibre,
                sheet: *sheet,
                normal: *normal,
            };
            NodeFibres::Frames(
                values
                    .as_chunks::<3>()
                    .0
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .map(frame)
                    .collect(),
            )
        }
    }
}
