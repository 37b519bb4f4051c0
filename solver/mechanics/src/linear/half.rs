//! The tangent of linear elements in half precision: a product with it reads half as much as one with [`PackedTangent`].
//!
//! A solve leaves up to three tenths of its residual, so that a matrix off by 2⁻¹¹ costs no iterations of Newton's method. Entries
//! are IEEE 754's binary16, ten bits of mantissa and five of exponent, with one scale for all of `K` and one for all of `G`.
//! Vectors and sums are in single precision, which is finer than the entries.

use std::cell::RefCell;
use std::sync::Arc;

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{Operator, Pattern, prefetch};

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
const MOST: f32 = 65_504.0;
/// Smallest normal number in half precision.
const LEAST: f32 = 6.103_515_6e-5;

/// Nearest number in half precision, of two equally near ones the even one; the largest one beyond the range.
#[inline(always)]
fn encode(x: f32) -> u16 {
    let x = x.clamp(-MOST, MOST);
    let (sign, size) = (x.to_bits() >> 16 & 0x8000, x.abs());
    let magnitude = if size < LEAST {
        // Half of the smallest number's bit is the last one of a half.
        (size + 0.5).to_bits() - 0.5_f32.to_bits()
    } else {
        let odd = size.to_bits() >> 13 & 1;
        (size.to_bits() - REBIAS + 0xfff + odd) >> 13
    };
    (sign | magnitude) as u16
}

/// The number in single precision, of a finite one.
#[inline(always)]
fn decode(x: u16) -> f32 {
    // The sign is copied to the upper bits, of which only the first is one.
    let bits = ((i32::from(x as i16) << 13) as u32) & 0x8fff_e000;
    f32::from_bits(bits) * (1_u128 << 112) as f32
}

/// Conversions of four numbers.
trait Convert: Copy {
    fn to_single(self, x: &[u16; 4]) -> [f32; 4];
    fn to_half(self, x: [f32; 4]) -> [u16; 4];
}

/// The conversions on any processor.
#[derive(Clone, Copy)]
struct Anywhere;

impl Convert for Anywhere {
    #[inline(always)]
    fn to_single(self, x: &[u16; 4]) -> [f32; 4] {
        x.map(decode)
    }

    #[inline(always)]
    fn to_half(self, x: [f32; 4]) -> [u16; 4] {
        x.map(encode)
    }
}

/// The conversions by one instruction each.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct F16c;

#[cfg(target_arch = "x86_64")]
#[expect(
    unsafe_code,
    reason = "made only where the processor has the instructions"
)]
impl Convert for F16c {
    #[inline(always)]
    fn to_single(self, x: &[u16; 4]) -> [f32; 4] {
        use std::arch::x86_64::{__m128, _mm_cvtph_ps, _mm_cvtsi64_si128};
        // SAFETY: the value exists only behind the detection of F16C; both types are sixteen bytes.
        unsafe {
            let bits = std::mem::transmute::<[u16; 4], i64>(*x);
            std::mem::transmute::<__m128, [f32; 4]>(_mm_cvtph_ps(_mm_cvtsi64_si128(bits)))
        }
    }

    #[inline(always)]
    fn to_half(self, x: [f32; 4]) -> [u16; 4] {
        use std::arch::x86_64::{
            __m128, _MM_FROUND_TO_NEAREST_INT, _mm_cvtps_ph, _mm_cvtsi128_si64,
        };
        let x = x.map(|x| x.clamp(-MOST, MOST));
        // SAFETY: as above; the lower eight bytes are the four numbers.
        unsafe {
            let halves = _mm_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(std::mem::transmute::<
                [f32; 4],
                __m128,
            >(x));
            std::mem::transmute::<i64, [u16; 4]>(_mm_cvtsi128_si64(halves))
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
    /// `D`, per volume of stored entries of `G`: ranks exchange pressures, and each has a scale of its own.
    weights: Vec<f32>,
    /// Pressures of the last product.
    pressures: RefCell<Vec<f32>>,
}

/// The largest absolute value, in lanes that vector code compares side by side.
fn largest<const N: usize>(entries: impl Iterator<Item = [f32; N]>) -> f32 {
    let mut most = [0.0_f32; N];
    for entry in entries {
        for (most, x) in most.iter_mut().zip(entry) {
            let size = x.abs();
            *most = if size > *most { size } else { *most };
        }
    }
    most.into_iter().fold(0.0, f32::max)
}

/// Power of two that brings the largest of `entries` to [`LARGEST`].
fn scale<const N: usize>(entries: impl Iterator<Item = [f32; N]>) -> f32 {
    let largest = largest(entries);
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
            weights: vec![],
            pressures: RefCell::default(),
        }
    }

    /// Bytes that a product reads and writes, for `n_local` nodes.
    #[must_use]
    pub fn bytes_of_product(&self, n_local: usize) -> usize {
        let n = self.pattern.n_rows();
        let first = size_of::<HalfBlock>() + size_of::<u32>();
        // The vector, and the result, which is brought from memory before it is written.
        let vectors = n_local * 3 * 4 + n * 3 * 2 * 4;
        let second = if self.weights.is_empty() {
            0
        } else {
            let entry = size_of::<HalfVolume>() + size_of::<u32>();
            // Weights, pressures thrice, and the result twice.
            entry * self.blocks.len() + n * (4 + 3 * 4 + 2 * 3 * 4)
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
        let of_k = scale(diagonal);
        let of_g = scale(tangent.volumes.iter().map(|PackedVolume(g)| *g));
        self.scales = [of_k, of_g].map(|k| 1.0 / f64::from(k));
        let of_volume = self.scales[1];
        self.weights.clear();
        self.weights
            .extend(tangent.bulk.iter().map(|d| (of_volume * d) as f32));
        self.round(tangent, [of_k, of_k, of_k, of_g]);
    }
}

/// Rounds all entries.
///
/// - `scales`: factors of a column's four numbers
#[inline(always)]
fn round(
    from: &PackedTangent,
    (blocks, volumes): (&mut [HalfBlock], &mut [HalfVolume]),
    scales: [f32; 4],
    convert: impl Convert,
) {
    let times = |x: &[f32; 4], by: [f32; 4]| std::array::from_fn(|i| by[i] * x[i]);
    for (to, PackedBlock(from)) in blocks.iter_mut().zip(&from.blocks) {
        for (to, from) in to.iter_mut().zip(from) {
            *to = convert.to_half(times(from, scales));
        }
    }
    for (to, PackedVolume(from)) in volumes.iter_mut().zip(&from.volumes) {
        *to = convert.to_half(times(from, [scales[3]; 4]));
    }
}

/// `y = K x`, `p = D Gᵀ x`.
#[inline(always)]
fn rows(
    matrix: &HalfTangent,
    x: &[[f32; 3]],
    (y, p): (&mut [[f32; 3]], &mut [f32]),
    convert: impl Convert,
) {
    let starts = &matrix.pattern.row_start;
    let of_k = matrix.scales[0] as f32;
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
                let k = convert.to_single(&block[j]);
                for i in 0..4 {
                    sums[j][i] += k[i] * v[j];
                }
            }
        }
        let mut sum = [0.0_f32; 4];
        for i in 0..4 {
            sum[i] = sums[0][i] + sums[1][i] + sums[2][i];
        }
        let [a, b, c, volume] = sum;
        *y = [of_k * a, of_k * b, of_k * c];
        *p = matrix
            .weights
            .get(row)
            .map_or(0.0, |weight| weight * volume);
    }
}

/// `y += G p`.
#[inline(always)]
fn pressures(matrix: &HalfTangent, p: &[f32], y: &mut [[f32; 3]], convert: impl Convert) {
    let starts = &matrix.pattern.row_start;
    let of_g = matrix.scales[1] as f32;
    for (row, y) in y.iter_mut().enumerate() {
        let range = starts[row] as usize..starts[row + 1] as usize;
        prefetch(&matrix.volumes, &range);
        let mut sum = [0.0_f32; 4];
        for (g, column) in matrix.volumes[range.clone()]
            .iter()
            .zip(&matrix.pattern.column[range])
        {
            let (g, p) = (convert.to_single(g), p[*column as usize]);
            for i in 0..4 {
                sum[i] += g[i] * p;
            }
        }
        for i in 0..3 {
            y[i] += of_g * sum[i];
        }
    }
}

/// The kernels for processors with F16C.
#[cfg(target_arch = "x86_64")]
mod f16c {
    use super::{F16c, HalfBlock, HalfTangent, HalfVolume, PackedTangent};

    #[target_feature(enable = "avx,f16c")]
    pub fn round(
        from: &PackedTangent,
        to: (&mut [HalfBlock], &mut [HalfVolume]),
        scales: [f32; 4],
    ) {
        super::round(from, to, scales, F16c);
    }

    #[target_feature(enable = "avx,f16c")]
    pub fn rows(matrix: &HalfTangent, x: &[[f32; 3]], to: (&mut [[f32; 3]], &mut [f32])) {
        super::rows(matrix, x, to, F16c);
    }

    #[target_feature(enable = "avx,f16c")]
    pub fn pressures(matrix: &HalfTangent, p: &[f32], y: &mut [[f32; 3]]) {
        super::pressures(matrix, p, y, F16c);
    }
}

#[cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "kernels for this processor")
)]
impl HalfTangent {
    fn round(&mut self, from: &PackedTangent, scales: [f32; 4]) {
        let to = (&mut self.blocks[..], &mut self.volumes[..]);
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("f16c") {
            // SAFETY: processors with F16C have AVX; F16C is detected here.
            return unsafe { f16c::round(from, to, scales) };
        }
        round(from, to, scales, Anywhere);
    }

    /// `y = K x`, `p = D Gᵀ x`.
    fn rows(&self, x: &[[f32; 3]], to: (&mut [[f32; 3]], &mut [f32])) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("f16c") {
            // SAFETY: as above.
            return unsafe { f16c::rows(self, x, to) };
        }
        rows(self, x, to, Anywhere);
    }

    /// `y += G p`.
    fn add_pressures(&self, p: &[f32], y: &mut [[f32; 3]]) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("f16c") {
            // SAFETY: as above.
            return unsafe { f16c::pressures(self, p, y) };
        }
        pressures(self, p, y, Anywhere);
    }
}

impl HalfTangent {
    /// `y = A x` for an `x` whose ghosts are up to date. Collective.
    fn product(&self, space: VectorLayout<'_>, x: &[f32], y: &mut [f32]) {
        let n = self.pattern.n_rows();
        let (x, y) = (x.as_chunks::<3>().0, &mut y.as_chunks_mut::<3>().0[..n]);
        let mut p = self.pressures.borrow_mut();
        p.resize(n.max(self.weights.len()), 0.0);
        self.rows(x, (&mut *y, &mut p[..n]));
        if self.weights.is_empty() {
            return;
        }
        space.comm.update_ghosts_single(space.layout, 1, &mut p);
        self.add_pressures(&p, y);
    }
}

impl Operator<f32> for HalfTangent {
    fn n_rows(&self) -> usize {
        self.pattern.n_rows()
    }

    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f32], y: &mut [f32]) {
        space.update_single(x);
        self.product(space, x, y);
    }

    fn diagonal(&self, row: usize) -> [f64; 9] {
        let [of_k, of_g] = self.scales;
        let weight = |vertex: usize| self.weights.get(vertex).copied().unwrap_or(0.0);
        diagonal(
            &self.pattern,
            row,
            |slot, i, j| of_k * f64::from(decode(self.blocks[slot][j][i])),
            |slot, i| of_g * f64::from(decode(self.volumes[slot][i])),
            |vertex| f64::from(weight(vertex)) / of_g,
        )
    }
}

/// The same product for vectors in double precision, which are rounded.
impl Operator for HalfTangent {
    fn n_rows(&self) -> usize {
        self.pattern.n_rows()
    }

    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f64], y: &mut [f64]) {
        space.update(x);
        let single: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        let mut product = vec![0.0_f32; y.len()];
        self.product(space, &single, &mut product);
        for (y, product) in y.iter_mut().zip(product) {
            *y = f64::from(product);
        }
    }

    fn diagonal(&self, row: usize) -> [f64; 9] {
        Operator::<f32>::diagonal(self, row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All finite numbers.
    fn all() -> impl Iterator<Item = u16> {
        (0..=u16::MAX).filter(|x| x & 0x7fff <= 0x7bff)
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
            decode(encode(2.5e-8)),
            0.0,
            "below half the smallest number"
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

    /// Two ranks with a node each, whose entries differ a thousandfold in size, and with them the ranks' scales.
    #[test]
    fn ranks_with_scales_of_their_own_exchange_pressures() {
        use cardiotwin_linalg::parallel::{
            Communicator as _, Layout, Neighbour, ThreadSettings, on_threads,
        };
        let largest_error = on_threads(2, ThreadSettings::default(), |comm| {
            let size = [1.0, 1000.0][comm.rank()];
            let layout = Layout {
                n_owned: 1,
                n_local: 2,
                neighbours: vec![Neighbour {
                    rank: 1 - comm.rank(),
                    send: vec![0],
                    receive: vec![1],
                }],
            };
            let space = VectorLayout {
                comm: &comm,
                layout: &layout,
            };
            let pattern = Arc::new(Pattern {
                row_start: vec![0, 2],
                column: vec![0, 1],
            });
            let mut tangent = PackedTangent::zeros(pattern.clone());
            let entry = |k: usize| (size * (k as f64).cos()) as f32;
            let (blocks, volumes) = tangent.entries_mut();
            for (slot, PackedBlock(block)) in blocks.iter_mut().enumerate() {
                *block =
                    std::array::from_fn(|j| std::array::from_fn(|i| entry(12 * slot + 4 * j + i)));
            }
            for (slot, PackedVolume(g)) in volumes.iter_mut().enumerate() {
                *g = [entry(slot), entry(slot + 5), entry(slot + 7), 0.0];
            }
            tangent.bulk = vec![2.0, 2.0];
            let mut half = HalfTangent::zeros(pattern);
            half.copy_from(&tangent);
            let mut x: Vec<f64> = (0..6)
                .map(|k| f64::from(k + comm.rank() as i32).sin())
                .collect();
            let [mut want, mut got] = [vec![0.0; 6], vec![0.0; 6]];
            tangent.multiply(space, &mut x, &mut want);
            Operator::<f64>::multiply(&half, space, &mut x, &mut got);
            let scale = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            (0..3).fold(0.0_f64, |m, i| m.max((want[i] - got[i]).abs() / scale))
        });
        for error in largest_error.expect("no rank fails") {
            assert!(error < 2e-3, "{error}");
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_instruction_converts_as_any_processor_does() {
        if std::arch::is_x86_feature_detected!("f16c") {
            for x in all() {
                let four = [x, x ^ 0x8000, 0, x];
                assert_eq!(F16c.to_single(&four), Anywhere.to_single(&four));
            }
            for x in 0..0x0100_0000_u32 {
                // Every exponent, with the bits that rounding looks at.
                let x = f32::from_bits(x << 8 | u32::from(x % 3 == 0));
                let four = [x, -x, 1.5 * x, 0.0];
                if !x.is_nan() {
                    assert_eq!(F16c.to_half(four), Anywhere.to_half(four), "{x}");
                }
            }
        }
    }

    #[test]
    fn scales_are_powers_of_two_that_leave_room() {
        let of = |entries: &[[f32; 2]]| scale(entries.iter().copied());
        assert_eq!(of(&[[3.0, -8192.0], [1.0, 0.0]]), 1.0);
        assert_eq!(of(&[[0.0, 0.1]]), 65_536.0);
        assert_eq!(of(&[[0.0; 2]]), 1.0);
        assert_eq!(of(&[[f32::INFINITY, 1.0]]), 1.0);
    }
}
