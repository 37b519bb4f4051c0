//! Assembly of the tangent in single precision.

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{Entries, NO_SLOT, Pattern};

use super::assembled::{Assembled, Sink};
use super::packed::{PackedBlock, PackedTangent, PackedVolume, Rows};

impl Assembled for PackedTangent {
    fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    fn entries(&self) -> Option<&dyn Entries> {
        Some(self)
    }

    fn clear(&mut self, bulk: &mut dyn Iterator<Item = f64>) {
        self.blocks.fill(PackedBlock([[0.0; 4]; 3]));
        self.volumes.fill(PackedVolume([0.0; 4]));
        self.bulk.clear();
        self.bulk.extend(bulk);
    }

    fn vertex_volumes(&self, space: VectorLayout<'_>, x: &mut [f64]) -> Vec<f64> {
        if self.bulk.is_empty() {
            return vec![];
        }
        space.update(x);
        let n = self.pattern.n_rows();
        let (mut p, mut y) = (vec![0.0; n.max(self.bulk.len())], vec![[0.0; 3]; n]);
        self.arch
            .dispatch(Rows(self, x.as_chunks::<3>().0, &mut y, &mut p[..n]));
        space.comm.update_ghosts(space.layout, 1, &mut p);
        p
    }

    fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3] {
        let PackedBlock(b) = &self.blocks[slot];
        std::array::from_fn(|i| std::array::from_fn(|j| b[j][i]))
    }

    fn sink(&mut self) -> Sink<'_> {
        Sink::Packed(self)
    }

    fn add_block(&mut self, slot: u32, block: &[f64; 9]) {
        if slot != NO_SLOT {
            let PackedBlock(to) = &mut self.blocks[slot as usize];
            for i in 0..3 {
                for j in 0..3 {
                    to[j][i] += block[3 * i + j] as f32;
                }
            }
        }
    }

    fn constrain(&mut self, fixed: &[[bool; 3]], scale: f64) {
        for row in 0..self.pattern.n_rows() {
            for k in self.pattern.row(row) {
                let column = self.pattern.column[k] as usize;
                let (fr, fc) = (fixed[row], fixed[column]);
                if !fr.contains(&true) && !fc.contains(&true) {
                    continue;
                }
                let (PackedBlock(block), PackedVolume(g)) =
                    (&mut self.blocks[k], &mut self.volumes[k]);
                for j in 0..3 {
                    for i in 0..3 {
                        if fr[i] || fc[j] {
                            block[j][i] = if row == column && i == j {
                                scale as f32
                            } else {
                                0.0
                            };
                        }
                    }
                    if fc[j] {
                        block[j][3] = 0.0;
                    }
                    if fr[j] {
                        g[j] = 0.0;
                    }
                }
            }
        }
    }

    fn mean_diagonal(&self, space: VectorLayout<'_>) -> f64 {
        let n = self.pattern.n_rows();
        let mut sums = [0.0, n as f64];
        for row in 0..n {
            let slot = self.pattern.slot(row as u32, row as u32);
            if slot != NO_SLOT {
                let PackedBlock(block) = &self.blocks[slot as usize];
                sums[0] += (0..3)
                    .map(|i| f64::from(block[i][i].abs()) / 3.0)
                    .sum::<f64>();
            }
        }
        space.comm.sum(&mut sums);
        (sums[0] / sums[1].max(1.0)).max(f64::MIN_POSITIVE)
    }
}

impl Entries for PackedTangent {
    fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    fn stiffness(&self, slot: usize) -> [[f64; 3]; 3] {
        self.stiffness_block(slot).map(|row| row.map(f64::from))
    }

    fn volume_of_row(&self, slot: usize) -> [f64; 3] {
        self.blocks[slot].0.map(|column| f64::from(column[3]))
    }

    fn volume_of_column(&self, slot: usize) -> [f64; 3] {
        let PackedVolume([x, y, z, _]) = self.volumes[slot];
        [x, y, z].map(f64::from)
    }

    fn bulk(&self) -> &[f64] {
        &self.bulk
    }
}
