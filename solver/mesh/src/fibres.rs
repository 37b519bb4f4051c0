//! Rule-based fibre directions of the left ventricle, from the solutions of Laplace problems.
//!
//! Source: Bayer, Blake, Plank, Trayanova 2012, "A novel rule-based algorithm for assigning
//! myocardial fiber orientation to computational heart models", Ann. Biomed. Eng. 40, 2243,
//! restricted to a left ventricle. Without the field of the right ventricle, both angles are linear
//! in the transmural field.

use crate::frame::Frame;
use crate::joint::{Alone, Joint, any, sums};
use crate::laplace::{self, LaplaceError};
use crate::node_fibres::{NodeFibres, WallPoint};
use crate::tet_mesh::{TetMesh, shape_gradients, surface_names, tags};
use crate::vec3::{Vec3, add, axpy, norm, reject, scale, unit};

pub use crate::frame::turned;
pub use cardiotwin_vocabulary::fibres::FibreAngles;

/// Definition of the direction from apex to base.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Longitudinal {
    /// The gradient of ψ with Δψ = const and ψ prescribed at the base only. It points to the base
    /// everywhere and vanishes only at the apex. This definition needs no apical node, and it does
    /// not depend on the mesh as the other one does, because a point carries no flux in three
    /// dimensions.
    #[default]
    FromBase,
    /// As in Bayer 2012: Δψ = 0 between this node (ψ = 0) and the base (ψ = 1).
    FromApexNode(u32),
}

/// Fields from which the rule computes directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Fields {
    /// 0 at the endocardium, 1 at the epicardium and on the right side of the septum; one value per
    /// node, not-a-number outside the muscle.
    pub depth: Vec<f64>,
    /// Increases from apex to base, with an arbitrary scale; not-a-number outside the muscle.
    pub longitudinal: Vec<f64>,
}

/// Computes depth and longitudinal field on the elements of muscle. The base is the border of the
/// muscle with the rim or with other tissue, except for the right ventricle's wall
/// ([`tags::BESIDE`]).
///
/// # Errors
/// [`LaplaceError`] if a surface is missing or the solver fails.
pub fn fields(
    mesh: &TetMesh,
    muscle_tags: &[i32],
    rule: Longitudinal,
) -> Result<Fields, LaplaceError> {
    fields_of_part(mesh, &Alone(mesh.n_nodes()), muscle_tags, rule)
}

/// [`fields`] at the nodes of a part, the same bit for bit for any partition. The apex is a node of
/// the whole mesh. Collective.
///
/// # Errors
/// Same as for [`fields`], on all parts.
pub fn fields_of_part(
    mesh: &TetMesh,
    joint: &dyn Joint,
    muscle_tags: &[i32],
    rule: Longitudinal,
) -> Result<Fields, LaplaceError> {
    let muscle = |e: usize| muscle_tags.contains(&mesh.tags[e]);
    let depth = depth_of_part(mesh, joint, muscle_tags)?;
    let mut in_muscle = vec![false; mesh.n_nodes()];
    let mut elsewhere = vec![false; mesh.n_nodes()];
    for (e, tet) in mesh
        .tets
        .iter()
        .enumerate()
        .filter(|(e, _)| !is_beside(mesh, *e))
    {
        for node in tet {
            (if muscle(e) {
                &mut in_muscle
            } else {
                &mut elsewhere
            })[*node as usize] = true;
        }
    }
    for node in mesh
        .surface(surface_names::RIM)
        .map(|rim| rim.nodes())
        .unwrap_or_default()
    {
        elsewhere[node as usize] = true;
    }
    let mut fixed: Vec<Option<f64>> = (0..mesh.n_nodes())
        .map(|node| (in_muscle[node] && elsewhere[node]).then_some(1.0))
        .collect();
    if !any(joint, fixed[..joint.n_owned()].iter().any(Option::is_some)) {
        return Err(LaplaceError::Floating {
            field: "longitudinal field",
            expected: "rim, or other tissue at the base",
        });
    }
    let source = match rule {
        Longitudinal::FromBase => -1.0,
        Longitudinal::FromApexNode(node) => {
            for own in (0..joint.n_owned()).filter(|own| joint.node(*own) == node) {
                fixed[own] = Some(0.0);
            }
            0.0
        }
    };
    let longitudinal = laplace::solve("longitudinal field", mesh, joint, &muscle, &fixed, source)?;
    Ok(Fields {
        depth,
        longitudinal,
    })
}

/// Whether an element belongs to the right ventricle's wall.
fn is_beside(mesh: &TetMesh, e: usize) -> bool {
    mesh.tags[e] >= tags::BESIDE && mesh.surface(surface_names::RIGHT_VENTRICLE).is_some()
}

/// The transmural field alone: 0 at the endocardium, 1 at epicardium and septum and at the border
/// with the right ventricle's wall.
///
/// # Errors
/// [`LaplaceError`] if one of the surfaces is missing or the solver fails.
pub fn depth(mesh: &TetMesh, muscle_tags: &[i32]) -> Result<Vec<f64>, LaplaceError> {
    depth_of_part(mesh, &Alone(mesh.n_nodes()), muscle_tags)
}

fn depth_of_part(
    mesh: &TetMesh,
    joint: &dyn Joint,
    muscle_tags: &[i32],
) -> Result<Vec<f64>, LaplaceError> {
    let mut fixed = vec![None; mesh.n_nodes()];
    for (_, tet) in mesh
        .tets
        .iter()
        .enumerate()
        .filter(|(e, _)| is_beside(mesh, *e))
    {
        tet.iter()
            .for_each(|node| fixed[*node as usize] = Some(1.0));
    }
    let walls = [
        (surface_names::EPICARDIUM, 1.0),
        (surface_names::SEPTUM, 1.0),
        (surface_names::RIGHT_VENTRICLE, 1.0),
        (surface_names::ENDOCARDIUM, 0.0),
    ];
    let needed = [surface_names::EPICARDIUM, surface_names::ENDOCARDIUM];
    for (name, value) in walls {
        let nodes = mesh
            .surface(name)
            .map(|surface| surface.nodes())
            .unwrap_or_default();
        if !any(joint, !nodes.is_empty()) && needed.contains(&name) {
            return Err(LaplaceError::Floating {
                field: "transmural field",
                expected: "endocardium and epicardium",
            });
        }
        for node in nodes {
            fixed[node as usize] = Some(value);
        }
    }
    laplace::solve(
        "transmural field",
        mesh,
        joint,
        &|e| muscle_tags.contains(&mesh.tags[e]),
        &fixed,
        0.0,
    )
}

/// Makes fibres by the rule on a mesh with surfaces: directions at nodes, and one frame for each
/// element of muscle.
///
/// # Errors
/// Same as for [`fields`].
pub fn make(
    mesh: &mut TetMesh,
    muscle_tags: &[i32],
    angles: &FibreAngles,
) -> Result<(), LaplaceError> {
    let fields = fields(mesh, muscle_tags, Longitudinal::FromBase)?;
    mesh.fibres = rule(mesh, muscle_tags, &fields, angles);
    mesh.frames = frames_at_centroids(mesh, muscle_tags);
    Ok(())
}

/// Frames of the elements of muscle at their centroids, from the mesh's nodal directions; zeros in
/// other elements.
#[must_use]
pub fn frames_at_centroids(mesh: &TetMesh, muscle_tags: &[i32]) -> Vec<Frame> {
    let none = Frame {
        fibre: [0.0; 3],
        sheet: [0.0; 3],
        normal: [0.0; 3],
    };
    let frame = |(tet, tag): (&[u32; 4], &i32)| match muscle_tags.contains(tag) {
        true => mesh.fibres.frame(tet, &[0.25; 4]).unwrap_or(none),
        false => none,
    };
    mesh.tets.iter().zip(&mesh.tags).map(frame).collect()
}

/// Frames of the elements by the rule, at their centroids; zeros in elements other than muscle.
#[must_use]
pub fn frames(
    mesh: &TetMesh,
    muscle_tags: &[i32],
    fields: &Fields,
    angles: &FibreAngles,
) -> Vec<Frame> {
    let fibres = rule(mesh, muscle_tags, fields, angles);
    frames_at_centroids(
        &TetMesh {
            fibres,
            ..mesh.clone()
        },
        muscle_tags,
    )
}

/// Nodal directions by the rule.
#[must_use]
pub fn rule(
    mesh: &TetMesh,
    muscle_tags: &[i32],
    fields: &Fields,
    angles: &FibreAngles,
) -> NodeFibres {
    rule_of_part(mesh, &Alone(mesh.n_nodes()), muscle_tags, fields, angles)
}

/// [`rule`] at the nodes of a part, the same bit for bit for any partition. Collective.
///
/// Gradients are constant in linear elements. A node takes the mean over the elements of muscle
/// around it, weighted by their volumes. If a gradient vanishes (the longitudinal one does at the
/// apex, by symmetry), it is taken from the neighbours.
#[must_use]
pub fn rule_of_part(
    mesh: &TetMesh,
    joint: &dyn Joint,
    muscle_tags: &[i32],
    fields: &Fields,
    angles: &FibreAngles,
) -> NodeFibres {
    let muscle = |e: usize| muscle_tags.contains(&mesh.tags[e]);
    let transmural = directions(mesh, joint, &fields.depth, &muscle);
    let longitudinal = directions(mesh, joint, &fields.longitudinal, &muscle);
    // Only owned nodes, because the owner of a node holds all its elements.
    let around = crate::adjacency::Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let mut values: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; mesh.n_nodes()]);
    for node in 0..joint.n_owned() {
        let (mut out, mut up, mut volume) = ([0.0; 3], [0.0; 3], 0.0);
        for e in around
            .row(node)
            .iter()
            .map(|e| *e as usize)
            .filter(|e| muscle(*e))
        {
            let share = mesh.volume_mm3(e);
            let across = unit(transmural[e]).unwrap_or([0.0; 3]);
            out = axpy(out, share, across);
            up = axpy(
                up,
                share,
                unit(reject(longitudinal[e], across)).unwrap_or([0.0; 3]),
            );
            volume += share;
        }
        if volume > 0.0 {
            let mean = [scale(out, 1.0 / volume), scale(up, 1.0 / volume)];
            values
                .iter_mut()
                .zip(mean.as_flattened())
                .for_each(|(values, own)| values[node] = *own);
        }
    }
    values.iter_mut().for_each(|values| joint.update(values));
    let wall = |node: usize| {
        let at = |first: usize| std::array::from_fn(|i| values[first + i][node]);
        let depth = fields.depth[node];
        WallPoint {
            out: at(0),
            up: at(3),
            depth: if depth.is_finite() { depth } else { 0.0 },
        }
    };
    NodeFibres::Rule {
        walls: (0..mesh.n_nodes()).map(wall).collect(),
        angles: *angles,
    }
}

/// Gradient of a nodal field in each element. If it nearly vanishes, it is replaced by the mean
/// over neighbours where it does not.
fn directions(
    mesh: &TetMesh,
    joint: &dyn Joint,
    field: &[f64],
    within: &dyn Fn(usize) -> bool,
) -> Vec<Vec3> {
    let mut found: Vec<Vec3> = (0..mesh.n_tets())
        .map(|e| {
            if !within(e) {
                return [0.0; 3];
            }
            let (gradients, _) = shape_gradients(mesh.corners(e));
            (0..4).fold([0.0; 3], |sum, i| {
                axpy(sum, field[mesh.tets[e][i] as usize], gradients[i])
            })
        })
        .collect();
    let counted = || {
        (0..mesh.n_tets())
            .filter(|e| within(*e) && joint.speaks_for(*e))
            .collect::<Vec<usize>>()
    };
    let lengths: Vec<f64> = counted().into_iter().map(|e| norm(found[e])).collect();
    let ones = vec![1.0; lengths.len()];
    let [length, n] = sums(joint, [lengths.iter().copied(), ones.iter().copied()]);
    let typical = length / n.max(1.0);
    let vanishes = |gradient: Vec3| norm(gradient).is_nan() || norm(gradient) < 1e-6 * typical;
    let vanishing: Vec<usize> = (0..mesh.n_tets())
        .filter(|e| within(*e) && vanishes(found[*e]))
        .collect();
    if !any(joint, !vanishing.is_empty()) {
        return found;
    }
    // Only owned nodes, because the owner of a node holds all its elements.
    let around = crate::adjacency::Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let mut at_nodes: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; mesh.n_nodes()]);
    for node in 0..joint.n_owned() {
        let gradients = around.row(node).iter().map(|e| found[*e as usize]);
        let sum = gradients
            .filter(|gradient| norm(*gradient) >= 1e-6 * typical)
            .fold([0.0; 3], add);
        at_nodes
            .iter_mut()
            .zip(sum)
            .for_each(|(values, own)| values[node] = own);
    }
    at_nodes.iter_mut().for_each(|values| joint.update(values));
    for e in vanishing {
        let of = |node: u32| std::array::from_fn(|i| at_nodes[i][node as usize]);
        found[e] = mesh.tets[e]
            .iter()
            .fold([0.0; 3], |sum, node| add(sum, of(*node)));
    }
    found
}

#[cfg(test)]
mod tests;
