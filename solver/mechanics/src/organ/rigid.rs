//! The rigid part of a displacement.

use nalgebra::{Matrix6, Vector6};

use cardiotwin_linalg::parallel::VectorLayout;

/// The infinitesimal rigid motion closest to a nodal displacement in the mean square \[mm\], three numbers a node. Collective.
pub(super) fn rigid_motion(
    space: VectorLayout<'_>,
    nodes: &[[f64; 3]],
    displacement: &[f64],
) -> Vec<f64> {
    let n_owned = space.n_owned() / 3;
    let mut centre = [0.0; 4];
    for x in &nodes[..n_owned] {
        (0..3).for_each(|i| centre[i] += x[i]);
        centre[3] += 1.0;
    }
    space.comm.sum(&mut centre);
    let arm = |x: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|i| x[i] - centre[i] / centre[3]) };
    // Three translations, then three rotations about axes through the centre.
    let modes = |[x, y, z]: [f64; 3]| -> [[f64; 6]; 3] {
        [
            [1.0, 0.0, 0.0, 0.0, z, -y],
            [0.0, 1.0, 0.0, -z, 0.0, x],
            [0.0, 0.0, 1.0, y, -x, 0.0],
        ]
    };
    let mut sums = [0.0; 42];
    for (x, u) in nodes[..n_owned].iter().zip(displacement.as_chunks::<3>().0) {
        for (row, u) in modes(arm(x)).iter().zip(u) {
            for i in 0..6 {
                (0..6).for_each(|j| sums[6 * i + j] += row[i] * row[j]);
                sums[36 + i] += row[i] * u;
            }
        }
    }
    space.comm.sum(&mut sums);
    let (normal, right) = (
        Matrix6::from_row_slice(&sums[..36]),
        Vector6::from_row_slice(&sums[36..]),
    );
    let Some(motion) = normal.cholesky().map(|factor| factor.solve(&right)) else {
        return vec![0.0; displacement.len()];
    };
    let moved =
        |x: &[f64; 3]| modes(arm(x)).map(|row| (0..6).map(|j| row[j] * motion[j]).sum::<f64>());
    nodes.iter().flat_map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_linalg::parallel::{Layout, SingleProcess};

    #[test]
    fn a_rigid_motion_is_found_and_a_stretch_has_none() {
        let nodes: Vec<[f64; 3]> = (0..27)
            .map(|k| [k % 3, k / 3 % 3, k / 9].map(|c| f64::from(c) + 5.0))
            .collect();
        let layout = Layout::whole(nodes.len());
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let turned = |x: &[f64; 3]| [1.0 - 0.1 * x[1], 0.1 * x[0], 2.0];
        let rigid: Vec<f64> = nodes.iter().flat_map(turned).collect();
        let stretch: Vec<f64> = nodes
            .iter()
            .flat_map(|x| [x[0] - 6.0, 6.0 - x[1], 0.0])
            .collect();
        let both: Vec<f64> = rigid.iter().zip(&stretch).map(|(a, b)| a + b).collect();
        for (found, wanted) in rigid_motion(space, &nodes, &both).iter().zip(&rigid) {
            assert!((found - wanted).abs() < 1e-12, "{found} for {wanted}");
        }
    }
}
