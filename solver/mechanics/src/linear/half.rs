//! The tangent of linear elements in half precision: a product with it reads half as much as one with [`PackedTangent`].
//!
//! A solve leaves up to three tenths of its residual, so that a matrix off by 2⁻¹¹ costs no iterations of Newton's method. Entries have
//! ten bits of mantissa and five of exponent, as IEEE 754's binary16 has, and one scale for all of `K` and one for all of `G`;
//! what lies below the smallest normal number becomes zero. Sums are in single precision, which is finer than the entries.

use std::cell::RefCell;
use std::sync::Arc;

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{Operator, Pattern, prefetch};
use pulp::{Arch, Simd, WithSimd};

use super::packed::{PackedBlock, PackedTangent, PackedVolume, diagonal};

/// Three columns of `[K; gᵀ]`.
type HalfBlock = [[u16; 4]; 3];
/// An entry of `G`: three numbers and a zero.
type HalfVolume = [u16; 4];

/// Largest entry of `K`'s diagonal and of `G` after scaling. Other entries have room up to eight times as much.
const LARGEST: f32 = 8192.0;
/// Exponents of single precision less those of half precision.
const REBIAS: u32 = 112 << 23;
/// Largest finite number in half precision.
const MOST: u32 = 0x7bff;

/// Nearest number in half precision; the largest one beyond the range.
#[inline(always)]
fn encode(x: f32) -> u16 {
    let bits = x.to_bits();
    let magnitude = ((bits & 0x7fff_ffff) + 0x1000).saturating_sub(REBIAS) >> 13;
    let magnitude = if magnitude < 0x400 {
        0
    } else {
        magnitude.min(MOST)
    };
    (((bits >> 16) & 0x8000) | magnitude) as u16
}

/// The number in single precision, of a normal one or zero.
#[inline(always)]
fn decode(x: u16) -> f32 {
    // The sign is copied to the upper bits, of which only the first is one.
    let bits = ((i32::from(x as i16) << 13) as u32) & 0x8fff_e000;
    f32::from_bits(bits) * (1_u128 << 112) as f32
}

/// Conversion of four numbers to single precision.
trait Decode: Copy {
    fn four(self, x: &[u16; 4]) -> [f32; 4];
}

/// The conversion on any processor.
#[derive(Clone, Copy)]
struct Anywhere;

impl Decode for Anywhere {
    #[inline(always)]
    fn four(self, x: &[u16; 4]) -> [f32; 4] {
        x.map(decode)
    }
}

/// The conversion by one instruction.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct F16c;

#[cfg(target_arch = "x86_64")]
impl Decode for F16c {
    #[inline(always)]
    #[expect(
        unsafe_code,
        reason = "made only where the processor has the instruction"
    )]
    fn four(self, x: &[u16; 4]) -> [f32; 4] {
        use std::arch::x86_64::{__m128, _mm_cvtph_ps, _mm_cvtsi64_si128};
        // SAFETY: the value exists only behind the detection of F16C; both types are sixteen bytes.
        unsafe {
            let bits = std::mem::transmute::<[u16; 4], i64>(*x);
            std::mem::transmute::<__m128, [f32; 4]>(_mm_cvtph_ps(_mm_cvtsi64_si128(bits)))
        }
    }
}

/// `K + G D Gᵀ` in half precision, copied from a tangent in single precision.
#[derive(Debug)]
pub struct HalfTangent {
    pattern: Arc<Pattern>,
    blocks: Vec<HalfBlock>,
    volumes: Vec<HalfVolume>,
    /// Factors from stored entries of `K` and `G` to the tangent's.
    scales: [f64; 2],
    /// `D` \[kPa/mm³\].
    bulk: Vec<f64>,
    /// The vector of the last product, in single precision.
    x: RefCell<Vec<[f32; 3]>>,
    arch: Arch,
}

/// Power of two that brings the largest of `values` to [`LARGEST`].
fn scale(values: impl Iterator<Item = f32>) -> f32 {
    let largest = values.fold(0.0_f32, |most, x| most.max(x.abs()));
    if largest > 0.0 && largest.is_finite() {
        (LARGEST / largest)
            .log2()
            .floor()
            .clamp(-100.0, 100.0)
            .exp2()
    } else {
        1.0
    }
}

impl HalfTangent {
    /// Room for a tangent with the entries of `pattern`.
    #[must_use]
    pub fn zeros(pattern: Arc<Pattern>) -> Self {
        let n = pattern.column.len();
        Self {
            pattern,
            blocks: vec![[[0; 4]; 3]; n],
            volumes: vec![[0; 4]; n],
            scales: [1.0; 2],
            bulk: vec![],
            x: RefCell::default(),
            arch: Arch::new(),
        }
    }

    /// Bytes that a product reads and writes, for `n_local` nodes.
    #[must_use]
    pub fn bytes_of_product(&self, n_local: usize) -> usize {
        let n = self.pattern.n_rows();
        let first = size_of::<HalfBlock>() + size_of::<u32>();
        // The vector in double precision, its copy twice, and the result.
        let vectors = n_local * 3 * (8 + 2 * 4) + n * 4 * 8;
        let second = if self.bulk.is_empty() {
            0
        } else {
            let entry = size_of::<HalfVolume>() + size_of::<u32>();
            // Volumes and their weights, pressures in both precisions, and the result twice.
            entry * self.blocks.len() + n * (3 * 8 + 2 * 4 + 2 * 3 * 8)
        };
        self.blocks.len() * first + vectors + second
    }

    /// Takes over the numbers of a tangent with the same pattern.
    pub fn copy_from(&mut self, tangent: &PackedTangent) {
        let diagonal = (0..self.pattern.n_rows()).flat_map(|row| {
            let slot = self.pattern.slot(row as u32, row as u32);
            let block = tangent.blocks.get(slot as usize).map(|PackedBlock(b)| *b);
            block.map(|b| [b[0][0], b[1][1], b[2][2]])
        });
        let of_k = scale(diagonal.flatten());
        let of_g = scale(tangent.volumes.iter().flat_map(|PackedVolume(g)| *g));
        self.scales = [of_k, of_g].map(|k| 1.0 / f64::from(k));
        self.bulk.clear();
        self.bulk.extend_from_slice(&tangent.bulk);
        self.arch.dispatch(Rounding {
            from: tangent,
            blocks: &mut self.blocks,
            volumes: &mut self.volumes,
            scales: [of_k, of_k, of_k, of_g],
        });
    }
}

struct Rounding<'a> {
    from: &'a PackedTangent,
    blocks: &'a mut [HalfBlock],
    volumes: &'a mut [HalfVolume],
    /// Factors of a column's four numbers.
    scales: [f32; 4],
}

impl WithSimd for Rounding<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let scales = self.scales;
        for (to, PackedBlock(from)) in self.blocks.iter_mut().zip(&self.from.blocks) {
            for (to, from) in to.iter_mut().zip(from) {
                for i in 0..4 {
                    to[i] = encode(scales[i] * from[i]);
                }
            }
        }
        for (to, PackedVolume(from)) in self.volumes.iter_mut().zip(&self.from.volumes) {
            for i in 0..4 {
                to[i] = encode(scales[3] * from[i]);
            }
        }
    }
}

/// `y = K x`, `p = Gᵀ x`.
#[inline(always)]
fn rows(
    matrix: &HalfTangent,
    x: &[[f32; 3]],
    (y, p): (&mut [[f64; 3]], &mut [f64]),
    decode: impl Decode,
) {
    let starts = &matrix.pattern.row_start;
    let [of_k, of_g] = matrix.scales;
    for (row, (y, p)) in y.iter_mut().zip(p).enumerate() {
        let range = starts[row] as usize..starts[row + 1] as usize;
        prefetch(&matrix.blocks, &range);
        let mut sums = [[0.0_f32; 4]; 3];
        for (block, column) in matrix.blocks[range.clone()]
            .iter()
            .zip(&matrix.pattern.column[range])
        {
            let v = &x[*column as usize];
            for j in 0..3 {
                let k = decode.four(&block[j]);
                for i in 0..4 {
                    sums[j][i] += k[i] * v[j];
                }
            }
        }
        let mut sum = [0.0_f32; 4];
        for i in 0..4 {
            sum[i] = sums[0][i] + sums[1][i] + sums[2][i];
        }
        let [a, b, c, volume] = sum.map(f64::from);
        *y = [of_k * a, of_k * b, of_k * c];
        *p = of_g * volume;
    }
}

/// `y += G p`.
#[inline(always)]
fn pressures(matrix: &HalfTangent, p: &[f32], y: &mut [[f64; 3]], decode: impl Decode) {
    let starts = &matrix.pattern.row_start;
    let of_g = matrix.scales[1];
    for (row, y) in y.iter_mut().enumerate() {
        let range = starts[row] as usize..starts[row + 1] as usize;
        prefetch(&matrix.volumes, &range);
        let mut sum = [0.0_f32; 4];
        for (g, column) in matrix.volumes[range.clone()]
            .iter()
            .zip(&matrix.pattern.column[range])
        {
            let (g, p) = (decode.four(g), p[*column as usize]);
            for i in 0..4 {
                sum[i] += g[i] * p;
            }
        }
        for i in 0..3 {
            y[i] += of_g * f64::from(sum[i]);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod f16c {
    use super::{F16c, HalfTangent};

    #[target_feature(enable = "avx,f16c")]
    pub fn rows(matrix: &HalfTangent, x: &[[f32; 3]], to: (&mut [[f64; 3]], &mut [f64])) {
        super::rows(matrix, x, to, F16c);
    }

    #[target_feature(enable = "avx,f16c")]
    pub fn pressures(matrix: &HalfTangent, p: &[f32], y: &mut [[f64; 3]]) {
        super::pressures(matrix, p, y, F16c);
    }
}

impl HalfTangent {
    /// `y = K x`, `p = Gᵀ x`.
    #[cfg_attr(
        target_arch = "x86_64",
        expect(unsafe_code, reason = "a kernel for this processor")
    )]
    fn rows(&self, x: &[[f32; 3]], to: (&mut [[f64; 3]], &mut [f64])) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("f16c") {
            // SAFETY: processors with F16C have AVX; F16C is detected here.
            return unsafe { f16c::rows(self, x, to) };
        }
        rows(self, x, to, Anywhere);
    }

    /// `y += G p`.
    #[cfg_attr(
        target_arch = "x86_64",
        expect(unsafe_code, reason = "a kernel for this processor")
    )]
    fn pressures(&self, p: &[f32], y: &mut [[f64; 3]]) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("f16c") {
            // SAFETY: processors with F16C have AVX; F16C is detected here.
            return unsafe { f16c::pressures(self, p, y) };
        }
        pressures(self, p, y, Anywhere);
    }
}

impl Operator for HalfTangent {
    fn n_rows(&self) -> usize {
        self.pattern.n_rows()
    }

    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f64], y: &mut [f64]) {
        space.update(x);
        let n = self.pattern.n_rows();
        let (x, y) = (x.as_chunks::<3>().0, &mut y.as_chunks_mut::<3>().0[..n]);
        let mut single = self.x.borrow_mut();
        single.clear();
        single.extend(x.iter().map(|x| x.map(|x| x as f32)));
        let mut p = vec![0.0; n.max(self.bulk.len())];
        self.rows(&single, (&mut *y, &mut p[..n]));
        if self.bulk.is_empty() {
            return;
        }
        for (p, d) in p.iter_mut().zip(&self.bulk) {
            *p *= d;
        }
        space.comm.update_ghosts(space.layout, 1, &mut p);
        let p: Vec<f32> = p.iter().map(|p| *p as f32).collect();
        self.pressures(&p, y);
    }

    fn diagonal(&self, row: usize) -> [f64; 9] {
        let [of_k, of_g] = self.scales;
        diagonal(
            (&self.pattern, &self.bulk),
            row,
            |slot, i, j| of_k * f64::from(decode(self.blocks[slot][j][i])),
            |slot, i| of_g * f64::from(decode(self.volumes[slot][i])),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal numbers and zero.
    fn all() -> impl Iterator<Item = u16> {
        (0..=u16::MAX).filter(|x| {
            let magnitude = u32::from(x & 0x7fff);
            *x == 0 || (0x400..=MOST).contains(&magnitude)
        })
    }

    #[test]
    fn half_precision_keeps_eleven_bits() {
        for x in all() {
            assert_eq!(encode(decode(x)), x);
        }
        assert_eq!(decode(encode(1.0)), 1.0);
        assert_eq!(decode(encode(-65_504.0)), -65_504.0);
        assert_eq!(
            decode(encode(1e9)),
            65_504.0,
            "the largest one beyond the range"
        );
        assert_eq!(
            decode(encode(1e-6)),
            0.0,
            "below the smallest normal number"
        );
        for k in -13..16 {
            for part in 0..1000 {
                let x = (1.0 + part as f32 / 1000.0) * f32::exp2(k as f32);
                let off = (decode(encode(x)) - x).abs();
                assert!(
                    x > 65_504.0 || off <= x * f32::exp2(-11.0),
                    "{x} off by {off}"
                );
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_instruction_converts_as_any_processor_does() {
        if std::arch::is_x86_feature_detected!("f16c") {
            for x in all() {
                let four = [x, x ^ 0x8000, 0, x];
                assert_eq!(F16c.four(&four), Anywhere.four(&four));
            }
        }
    }

    #[test]
    fn scales_are_powers_of_two_that_leave_room() {
        assert_eq!(scale([3.0, -8192.0].into_iter()), 1.0);
        assert_eq!(scale([0.1].into_iter()), 65_536.0);
        assert_eq!(scale([0.0].into_iter()), 1.0);
        assert_eq!(scale([f32::INFINITY].into_iter()), 1.0);
    }
}
