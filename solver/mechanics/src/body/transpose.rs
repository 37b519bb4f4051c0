//! Transposition of a batch's results from lanes to blocks of single elements.

use crate::element::BATCH;

/// Shuffle instructions of this processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shuffle {
    #[cfg(target_arch = "x86_64")]
    sse: Option<pulp::core_arch::x86::Sse>,
}

impl Shuffle {
    pub fn new() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            sse: pulp::core_arch::x86::Sse::try_new(),
        }
    }

    /// Transposes four numbers of eight lanes into eight lanes of four numbers.
    #[inline(always)]
    pub fn transposed(self, rows: [&[f32; BATCH]; 4]) -> [[f32; 4]; BATCH] {
        let mut out = [[0.0; 4]; BATCH];
        #[cfg(target_arch = "x86_64")]
        if let Some(sse) = self.sse {
            use pulp::cast;
            use std::arch::x86_64::__m128;
            for half in [0, 4] {
                let (r0, r1, r2, r3): (__m128, __m128, __m128, __m128) = (
                    cast([
                        rows[0][half],
                        rows[0][half + 1],
                        rows[0][half + 2],
                        rows[0][half + 3],
                    ]),
                    cast([
                        rows[1][half],
                        rows[1][half + 1],
                        rows[1][half + 2],
                        rows[1][half + 3],
                    ]),
                    cast([
                        rows[2][half],
                        rows[2][half + 1],
                        rows[2][half + 2],
                        rows[2][half + 3],
                    ]),
                    cast([
                        rows[3][half],
                        rows[3][half + 1],
                        rows[3][half + 2],
                        rows[3][half + 3],
                    ]),
                );
                let (low01, low23) = (sse._mm_unpacklo_ps(r0, r1), sse._mm_unpacklo_ps(r2, r3));
                let (high01, high23) = (sse._mm_unpackhi_ps(r0, r1), sse._mm_unpackhi_ps(r2, r3));
                out[half] = cast(sse._mm_movelh_ps(low01, low23));
                out[half + 1] = cast(sse._mm_movehl_ps(low23, low01));
                out[half + 2] = cast(sse._mm_movelh_ps(high01, high23));
                out[half + 3] = cast(sse._mm_movehl_ps(high23, high01));
            }
            return out;
        }
        for lane in 0..BATCH {
            for i in 0..4 {
                out[lane][i] = rows[i][lane];
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_become_rows() {
        let rows: [[f32; BATCH]; 4] =
            std::array::from_fn(|i| std::array::from_fn(|lane| (10 * lane + i) as f32));
        let got = Shuffle::new().transposed([&rows[0], &rows[1], &rows[2], &rows[3]]);
        for (lane, four) in got.iter().enumerate() {
            assert_eq!(*four, std::array::from_fn(|i| (10 * lane + i) as f32));
        }
    }
}
