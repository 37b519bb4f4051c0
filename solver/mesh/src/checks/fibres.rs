//! Fibres that are missing, are no directions, or have no order.

use super::places::at_element;
use super::{Defect, Expected};
use crate::adjacency::Adjacency;
use crate::tet_mesh::TetMesh;
use crate::vec3::{Vec3, dot, norm, unit};

/// Largest accepted deviation of a fibre's length from one.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Cosine of the angle up to which a fibre has the usual direction (26°): a placeholder with noise or a
/// little bent is one too. The fibres of a ventricle turn by more than 90°.
const ALIKE: f64 = 0.9;
/// Share of fibres in the usual direction from which they are a placeholder. A ventricle has up to 0.3.
const PLACEHOLDER: f64 = 0.5;
/// Mean cosine between fibres of elements with a common face below which the fibres have no order. It
/// is 0.5 for random directions, 0.64 for random ones in the plane of the wall, and above 0.9 on a
/// ventricle of three elements across the wall.
const ORDERED: f64 = 0.75;
/// Fewest pairs of neighbours of which a mean is taken.
const FEWEST_PAIRS: usize = 20;

pub(super) fn check(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) {
    if !expected.fibres {
        return;
    }
    if mesh.frames.is_empty() {
        found.push(Defect::NoFibres);
        return;
    }
    let contracts = |e: &usize| {
        expected.muscle_tags.is_empty() || expected.muscle_tags.contains(&mesh.tags[*e])
    };
    let contracting: Vec<usize> = (0..mesh.n_tets()).filter(contracts).collect();
    let mut wrong: Vec<(usize, f64)> = (contracting.iter())
        .map(|e| (*e, norm(mesh.frames[*e].fibre)))
        .filter(|(_, length)| length.is_nan() || (length - 1.0).abs() > UNIT_TOLERANCE)
        .collect();
    found.extend(one_direction(mesh, &contracting).or_else(|| unordered(mesh, &contracting)));
    wrong.sort_by(|a, b| (b.1 - 1.0).abs().total_cmp(&(a.1 - 1.0).abs()));
    if let Some((_, worst)) = wrong.first().copied() {
        let of = contracting.len();
        let places = wrong.iter().map(|(e, _)| at_element(mesh, *e)).collect();
        found.push(Defect::FibreLength { of, worst, places });
    }
}

/// A warning where neighbours' fibres differ as random ones do, for example in another order of elements.
fn unordered(mesh: &TetMesh, contracting: &[usize]) -> Option<Defect> {
    let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let contracts: Vec<bool> = {
        let mut all = vec![false; mesh.n_tets()];
        contracting.iter().for_each(|e| all[*e] = true);
        all
    };
    let has_common_face = |a: usize, b: usize| {
        let shared = mesh.tets[a].iter().filter(|n| mesh.tets[b].contains(n));
        shared.count() == 3
    };
    let (mut n_pairs, mut sum) = (0, 0.0);
    for e in contracting.iter().copied() {
        // Three of four nodes are those of a face, so one of the first two is among them. Where both are, the
        // pair counts twice, which hardly moves the mean.
        let near = mesh.tets[e][..2]
            .iter()
            .flat_map(|node| around.row(*node as usize));
        for other in near.map(|other| *other as usize) {
            if other <= e || !contracts[other] || !has_common_face(e, other) {
                continue;
            }
            if let [Some(a), Some(b)] = [e, other].map(|e| unit(mesh.frames[e].fibre)) {
                n_pairs += 1;
                sum += dot(a, b).abs();
            }
        }
    }
    let mean_cosine = sum / f64::from(n_pairs.max(1));
    (n_pairs as usize >= FEWEST_PAIRS && mean_cosine < ORDERED)
        .then_some(Defect::Unordered { mean_cosine })
}

/// A warning where most fibres of the contracting elements have one direction.
fn one_direction(mesh: &TetMesh, contracting: &[usize]) -> Option<Defect> {
    let fibres = || contracting.iter().map(|e| mesh.frames[*e].fibre);
    let usual = usual_direction(fibres())?;
    let alike = |fibre: &Vec3| dot(*fibre, usual).abs() > ALIKE * norm(*fibre);
    let of = contracting.len();
    let n = fibres().filter(alike).count();
    (of > 1 && n as f64 > PLACEHOLDER * of as f64).then_some(Defect::OneDirection { n, of })
}

/// Steps of the power iteration for the usual direction.
const POWER_STEPS: usize = 30;

/// The direction along which most fibres lie, whatever their signs: the first principal axis. `None` without
/// fibres.
fn usual_direction(fibres: impl Iterator<Item = Vec3>) -> Option<Vec3> {
    let mut moments = [[0.0; 3]; 3];
    for fibre in fibres {
        let square = dot(fibre, fibre);
        if square > 0.0 && square.is_finite() {
            for (row, a) in moments.iter_mut().zip(fibre) {
                row.iter_mut()
                    .zip(fibre)
                    .for_each(|(m, b)| *m += a * b / square);
            }
        }
    }
    // The column with the largest diagonal is not perpendicular to the axis.
    let first = (0..3).max_by(|a, b| moments[*a][*a].total_cmp(&moments[*b][*b]))?;
    let mut axis = unit(moments[first])?;
    for _ in 0..POWER_STEPS {
        axis = unit(moments.map(|row| dot(row, axis)))?;
    }
    Some(axis)
}
