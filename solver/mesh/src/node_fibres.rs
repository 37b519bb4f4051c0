//! Fibre directions given at nodes, evaluated at any point of an element.
//!
//! Fibres turn by 120° across the wall. With one direction per element, the field is a staircase;
//! with nodal directions, each integration point has its own direction.

use crate::frame::{Frame, turned};
use crate::vec3::{Vec3, any_perpendicular, axpy, cross, dot, reject, scale, unit};
use cardiotwin_vocabulary::fibres::FibreAngles;

/// Directions of the wall at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallPoint {
    /// Transmural direction, from the endocardium outwards.
    pub out: Vec3,
    /// Longitudinal direction, from apex to base. Its length is less than one if the directions
    /// around the node disagree, and zero at the apex, so that an interpolated direction there
    /// comes from the neighbouring nodes.
    pub up: Vec3,
    /// Transmural depth, 0 at the endocardium and 1 at the epicardium; 0 outside the muscle.
    pub depth: f64,
}

/// A field of fibre directions with values at nodes.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum NodeFibres {
    /// No directions at nodes; the mesh has directions per element only.
    #[default]
    PerElement,
    /// Fibre, sheet and normal at each node.
    Frames(Vec<Frame>),
    /// Directions of the wall at each node, and the angles by which the rule turns them.
    Rule {
        /// Directions and depth at each node.
        walls: Vec<WallPoint>,
        /// Angles of the rule.
        angles: FibreAngles,
    },
}

impl NodeFibres {
    /// Whether there are directions at nodes.
    #[must_use]
    pub fn at_nodes(&self) -> bool {
        !matches!(self, Self::PerElement)
    }

    /// Number of nodes with directions; `None` if directions are per element.
    #[must_use]
    pub fn n_nodes(&self) -> Option<usize> {
        match self {
            Self::PerElement => None,
            Self::Frames(frames) => Some(frames.len()),
            Self::Rule { walls, .. } => Some(walls.len()),
        }
    }

    /// Frame at the point with barycentric coordinates `l` of the element with corners `tet`;
    /// `None` if directions are per element, or if no node of the element has one.
    ///
    /// Frames are interpolated on the rotation group to first order. The axes of all corners get
    /// the sign of the nearest corner's, because a fibre has no sign; then they are summed and
    /// orthonormalised. The rule interpolates the directions of the wall and the depth and turns
    /// them at the point, which is correct even in a wall of one element.
    #[must_use]
    pub fn frame(&self, tet: &[u32; 4], l: &[f64; 4]) -> Option<Frame> {
        match self {
            Self::PerElement => None,
            Self::Frames(frames) => interpolated(tet.map(|node| frames[node as usize]), l),
            Self::Rule { walls, angles } => {
                let corners = tet.map(|node| walls[node as usize]);
                let sum = |of: &dyn Fn(&WallPoint) -> Vec3| {
                    corners
                        .iter()
                        .zip(l)
                        .fold([0.0; 3], |sum, (corner, share)| {
                            axpy(sum, *share, of(corner))
                        })
                };
                let depth: f64 = corners
                    .iter()
                    .zip(l)
                    .map(|(corner, share)| share * corner.depth)
                    .sum();
                Some(turned_wall(sum(&|c| c.out), sum(&|c| c.up), depth, angles))
            }
        }
    }

    /// The field on renumbered nodes; `nodes` gives the old numbers in the new order.
    #[must_use]
    pub fn at(&self, nodes: impl Iterator<Item = usize>) -> Self {
        match self {
            Self::PerElement => Self::PerElement,
            Self::Frames(frames) => Self::Frames(nodes.map(|node| frames[node]).collect()),
            Self::Rule { walls, angles } => Self::Rule {
                walls: nodes.map(|node| walls[node]).collect(),
                angles: *angles,
            },
        }
    }

    /// The field with additional nodes at the midpoints of edges.
    #[must_use]
    pub fn with_middles(&self, edges: impl Iterator<Item = [u32; 2]>) -> Self {
        let half = [0.5, 0.5, 0.0, 0.0];
        match self {
            Self::PerElement => Self::PerElement,
            Self::Frames(frames) => {
                let middle = |[a, b]: [u32; 2]| {
                    self.frame(&[a, b, a, b], &half)
                        .unwrap_or(frames[a as usize])
                };
                Self::Frames(frames.iter().copied().chain(edges.map(middle)).collect())
            }
            Self::Rule { walls, angles } => {
                let middle = |[a, b]: [u32; 2]| {
                    let (a, b) = (walls[a as usize], walls[b as usize]);
                    let mean = |a: Vec3, b: Vec3| scale(axpy(a, 1.0, b), 0.5);
                    WallPoint {
                        out: mean(a.out, b.out),
                        up: mean(a.up, b.up),
                        depth: 0.5 * (a.depth + b.depth),
                    }
                };
                Self::Rule {
                    walls: walls.iter().copied().chain(edges.map(middle)).collect(),
                    angles: *angles,
                }
            }
        }
    }
}

/// Fibre, sheet and normal for directions of the wall, which may have any length.
fn turned_wall(out: Vec3, up: Vec3, depth: f64, angles: &FibreAngles) -> Frame {
    let out = unit(out).unwrap_or([0.0, 0.0, 1.0]);
    let up = unit(reject(up, out)).unwrap_or_else(|| any_perpendicular(out));
    let around = cross(up, out);
    let between = |endo: f64, epi: f64| (endo + (epi - endo) * depth).to_radians();
    let alpha = between(angles.alpha_endo_deg, angles.alpha_epi_deg);
    turned(
        around,
        up,
        out,
        alpha,
        between(angles.beta_endo_deg, angles.beta_epi_deg),
    )
}

fn interpolated(corners: [Frame; 4], l: &[f64; 4]) -> Option<Frame> {
    let given = |k: &usize| dot(corners[*k].fibre, corners[*k].fibre) > 0.25;
    let nearest = (0..4)
        .filter(given)
        .max_by(|a, b| l[*a].total_cmp(&l[*b]))?;
    let mean = |axis: &dyn Fn(&Frame) -> Vec3| {
        let like = axis(&corners[nearest]);
        corners
            .iter()
            .zip(l)
            .fold([0.0; 3], |sum, (corner, share)| {
                let own = axis(corner);
                axpy(sum, if dot(own, like) < 0.0 { -share } else { *share }, own)
            })
    };
    let fibre = unit(mean(&|f| f.fibre))?;
    let sheet = unit(reject(mean(&|f| f.sheet), fibre)).unwrap_or_else(|| any_perpendicular(fibre));
    Some(Frame {
        fibre,
        sheet,
        normal: cross(fibre, sheet),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TET: [u32; 4] = [0, 1, 2, 3];

    fn along(angle_deg: f64) -> Frame {
        turned(
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            angle_deg.to_radians(),
            0.0,
        )
    }

    #[test]
    fn frames_at_nodes_turn_the_short_way_whatever_their_signs() {
        let mut frames = vec![along(10.0); 4];
        let opposite = along(30.0);
        frames[1] = Frame {
            fibre: scale(opposite.fibre, -1.0),
            sheet: scale(opposite.sheet, -1.0),
            ..opposite
        };
        let field = NodeFibres::Frames(frames);
        let middle = field.frame(&TET, &[0.5, 0.5, 0.0, 0.0]).expect("a frame");
        assert!(
            ((middle.fibre[1] / middle.fibre[0]).atan().to_degrees() - 20.0).abs() < 1e-9,
            "{middle:?}"
        );
        let corner = field.frame(&TET, &[0.0, 1.0, 0.0, 0.0]).expect("a frame");
        assert!((dot(corner.fibre, opposite.fibre).abs() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_rule_turns_a_fibre_through_zero_in_a_wall_of_one_element() {
        let wall = |depth| WallPoint {
            out: [0.0, 0.0, 1.0],
            up: [0.0, 1.0, 0.0],
            depth,
        };
        let angles = FibreAngles {
            beta_endo_deg: 0.0,
            beta_epi_deg: 0.0,
            ..FibreAngles::default()
        };
        let field = NodeFibres::Rule {
            walls: vec![wall(0.0), wall(0.0), wall(0.0), wall(1.0)],
            angles,
        };
        for (share, angle_deg) in [(0.0, 60.0), (0.5, 0.0), (0.75, -30.0), (1.0, -60.0)] {
            let rest = (1.0 - share) / 3.0;
            let frame = field
                .frame(&TET, &[rest, rest, rest, share])
                .expect("a frame");
            // The circumferential direction is up × out.
            let found = frame.fibre[1].atan2(frame.fibre[0]).to_degrees();
            assert!((found - angle_deg).abs() < 1e-9, "{found} for {angle_deg}");
        }
    }

    #[test]
    fn nodes_in_another_order_and_middles_keep_the_field() {
        let wall = |depth| WallPoint {
            out: [0.0, 0.0, 1.0],
            up: [0.0, 1.0, 0.0],
            depth,
        };
        let field = NodeFibres::Rule {
            walls: vec![wall(0.0), wall(0.2), wall(0.4), wall(1.0)],
            angles: FibreAngles::default(),
        };
        let reversed = field.at([3, 2, 1, 0].into_iter());
        let l = [0.1, 0.2, 0.3, 0.4];
        assert_eq!(field.frame(&TET, &l), reversed.frame(&[3, 2, 1, 0], &l));
        let more = field.with_middles([[0, 3]].into_iter());
        assert_eq!(
            more.frame(&[4, 4, 4, 4], &[1.0, 0.0, 0.0, 0.0]),
            field.frame(&TET, &[0.5, 0.0, 0.0, 0.5])
        );
    }
}
