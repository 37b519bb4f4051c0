//! What assembly asks of a tangent, whatever its storage.

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{CondensedMatrix, Entries, NO_SLOT, Operator, Pattern};

use super::PackedTangent;

/// Where elements put their stiffness.
#[derive(Debug)]
pub enum Sink<'a> {
    /// In double precision, for factorisations and tight solves.
    Full(&'a mut CondensedMatrix),
    /// In single precision, for the Krylov solvers of time steps.
    Packed(&'a mut PackedTangent),
}

/// A tangent that is put together from elements, surfaces and masses.
pub trait Assembled: Operator {
    /// Where its blocks are.
    fn pattern(&self) -> &Pattern;

    /// Sets all entries to zero, and the vertices' bulk stiffness \[kPa/mm³\], one a vertex.
    fn clear(&mut self, bulk: &mut dyn Iterator<Item = f64>);

    /// A block of the stiffness alone, row-major.
    fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3];

    /// Entries for levels of rigid motions, in a storage that has them.
    fn entries(&self) -> Option<&dyn Entries> {
        None
    }

    /// `Gᵀ x`, the change of the vertices' volumes \[mm³\], ghosts up to date; empty without nodal volume change. Brings
    /// ghosts of `x` up to date first. Collective.
    fn vertex_volumes(&self, space: VectorLayout<'_>, x: &mut [f64]) -> Vec<f64>;

    /// For the elements' stiffness.
    fn sink(&mut self) -> Sink<'_>;

    /// Adds a block to the stiffness; does nothing at [`NO_SLOT`].
    fn add_block(&mut self, slot: u32, block: &[f64; 9]);

    /// Makes the rows and columns of fixed components those of the identity, times `scale`.
    ///
    /// - `fixed`: for each node which components are fixed
    fn constrain(&mut self, fixed: &[[bool; 3]], scale: f64);

    /// Mean of the absolute values on the stiffness's diagonal: a scale. Collective.
    fn mean_diagonal(&self, space: VectorLayout<'_>) -> f64;

    /// Adds `k` to the diagonal of a row.
    fn add_to_diagonal(&mut self, row: usize, k: f64) {
        let slot = self.pattern().slot(row as u32, row as u32);
        self.add_block(slot, &[k, 0.0, 0.0, 0.0, k, 0.0, 0.0, 0.0, k]);
    }
}

impl Assembled for CondensedMatrix {
    fn pattern(&self) -> &Pattern {
        &self.stiffness.pattern
    }

    fn clear(&mut self, bulk: &mut dyn Iterator<Item = f64>) {
        self.stiffness.blocks.fill([0.0; 9]);
        if let Some(coupling) = &mut self.coupling {
            coupling.blocks.fill([0.0; 3]);
        }
        self.bulk.clear();
        self.bulk.extend(bulk);
    }

    fn vertex_volumes(&self, space: VectorLayout<'_>, x: &mut [f64]) -> Vec<f64> {
        space.update(x);
        let mut p = vec![0.0; self.bulk.len()];
        if let Some(coupling) = &self.coupling {
            coupling.multiply_transposed(x, &mut p);
            if p.len() == space.layout.n_local {
                space.comm.update_ghosts(space.layout, 1, &mut p);
            }
        }
        p
    }

    fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3] {
        Self::stiffness_block(self, slot)
    }

    fn sink(&mut self) -> Sink<'_> {
        Sink::Full(self)
    }

    fn mean_diagonal(&self, space: VectorLayout<'_>) -> f64 {
        let n = self.stiffness.pattern.n_rows();
        let mut sums = [0.0, n as f64];
        for row in 0..n {
            let d = self.stiffness.diagonal(row);
            sums[0] += (d[0].abs() + d[4].abs() + d[8].abs()) / 3.0;
        }
        space.comm.sum(&mut sums);
        (sums[0] / sums[1].max(1.0)).max(f64::MIN_POSITIVE)
    }

    fn constrain(&mut self, fixed: &[[bool; 3]], scale: f64) {
        let pattern = self.stiffness.pattern.clone();
        for row in 0..pattern.n_rows() {
            for k in pattern.row(row) {
                let column = pattern.column[k] as usize;
                let (fr, fc) = (fixed[row], fixed[column]);
                if !fr.contains(&true) && !fc.contains(&true) {
                    continue;
                }
                let block = &mut self.stiffness.blocks[k];
                for i in 0..3 {
                    for j in 0..3 {
                        if fr[i] || fc[j] {
                            block[3 * i + j] = if row == column && i == j { scale } else { 0.0 };
                        }
                    }
                }
            }
        }
        if let Some(coupling) = &mut self.coupling {
            for row in (0..pattern.n_rows()).filter(|r| fixed[*r].contains(&true)) {
                for k in coupling.pattern.row(row) {
                    for i in 0..3 {
                        if fixed[row][i] {
                            coupling.blocks[k][i] = 0.0;
                        }
                    }
                }
            }
        }
    }

    fn add_block(&mut self, slot: u32, block: &[f64; 9]) {
        if slot != NO_SLOT {
            for (to, from) in self.stiffness.blocks[slot as usize].iter_mut().zip(block) {
                *to += from;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cardiotwin_linalg::parallel::{Layout, SingleProcess};
    use cardiotwin_linalg::{BlockCsr, Coupling};

    use super::*;

    #[test]
    fn fixed_components_keep_their_value() {
        let elements: Vec<[u32; 4]> = (0..5).map(|k| [k, k + 1, k + 2, k + 3]).collect();
        let pattern = Arc::new(Pattern::of_elements(
            8,
            elements.iter().map(|e| (&e[..], &e[..])),
        ));
        let mut a = CondensedMatrix {
            stiffness: BlockCsr::zeros(pattern.clone()),
            coupling: Some(Coupling::zeros(pattern)),
            bulk: vec![2.0; 8],
        };
        for (k, block) in a.stiffness.blocks.iter_mut().enumerate() {
            *block = std::array::from_fn(|i| ((9 * k + i) as f64).sin());
        }
        for (k, block) in a
            .coupling
            .iter_mut()
            .flat_map(|g| &mut g.blocks)
            .enumerate()
        {
            *block = std::array::from_fn(|i| ((3 * k + i) as f64).cos());
        }
        let mut fixed = vec![[false; 3]; 8];
        fixed[5] = [true, false, true];
        a.constrain(&fixed, 7.0);
        let layout = Layout::whole(8);
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let mut x: Vec<f64> = (0..24).map(|k| (f64::from(k) * 0.7).sin()).collect();
        let mut y = vec![0.0; 24];
        a.multiply(space, &mut x, &mut y);
        assert!((y[15] - 7.0 * x[15]).abs() < 1e-14 && (y[17] - 7.0 * x[17]).abs() < 1e-14);
        let before = y.clone();
        x[15] += 1.0;
        a.multiply(space, &mut x, &mut y);
        assert!(
            before
                .iter()
                .zip(&y)
                .enumerate()
                .all(|(k, (b, y))| k == 15 || b == y),
            "no other row sees a fixed component"
        );
    }
}
