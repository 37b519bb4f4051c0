//! Communication between the parts of a mesh, so that the code for fibres and activation is the
//! same for a whole mesh and for its parts.

/// A part of a partitioned mesh. The first nodes are owned by the part; the rest (ghosts) belong to
/// other parts. It holds all elements around its own nodes, and every triangle of a surface that
/// touches one of them. Collective methods must be called by all parts in the same order.
pub trait Joint {
    /// Number of nodes that the part owns.
    fn n_owned(&self) -> usize;

    /// Number of a node in the whole mesh.
    fn node(&self, node: usize) -> u32;

    /// Number of an element in the whole mesh.
    fn element(&self, e: usize) -> u32;

    /// Whether this part counts an element. Exactly one of the parts that hold the element does.
    fn speaks_for(&self, e: usize) -> bool;

    /// Updates ghosts with their owners' values, one for each node. Collective.
    fn update(&self, values: &mut [f64]);

    /// Replaces each value by its sum over all parts. Collective.
    fn sum(&self, values: &mut [f64]);

    /// Replaces each value by its maximum over all parts; not-a-number if it is so on any part.
    /// Collective.
    fn max(&self, values: &mut [f64]);
}

/// The whole mesh as the only part, with its number of nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alone(pub usize);

impl Joint for Alone {
    fn n_owned(&self) -> usize {
        self.0
    }

    fn node(&self, node: usize) -> u32 {
        node as u32
    }

    fn element(&self, e: usize) -> u32 {
        e as u32
    }

    fn speaks_for(&self, _: usize) -> bool {
        true
    }

    fn update(&self, _: &mut [f64]) {}

    fn sum(&self, _: &mut [f64]) {}

    fn max(&self, _: &mut [f64]) {}
}

/// Whether `here` is true on any part. Collective.
pub(crate) fn any(joint: &dyn Joint, here: bool) -> bool {
    let mut flag = [f64::from(u8::from(here))];
    joint.max(&mut flag);
    flag[0] > 0.0
}

/// Smallest number over all parts. Collective.
pub(crate) fn first(joint: &dyn Joint, here: Option<u32>) -> Option<u32> {
    let mut least = [here.map_or(f64::NEG_INFINITY, |number| -f64::from(number))];
    joint.max(&mut least);
    least[0].is_finite().then_some(-least[0] as u32)
}

/// Distance and number of the nearest candidate over all parts; among equally near ones, the lowest
/// number. Collective.
pub(crate) fn nearest(
    joint: &dyn Joint,
    candidates: impl Iterator<Item = (f64, u32)>,
) -> (f64, Option<u32>) {
    let here = candidates.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut least = [here.map_or(f64::NEG_INFINITY, |(distance, _)| -distance)];
    joint.max(&mut least);
    let number = here
        .filter(|(distance, _)| *distance == -least[0])
        .map(|(_, number)| number);
    (-least[0], first(joint, number))
}

/// Flags of all held nodes, from those of the owned nodes. Collective.
pub(crate) fn flags(joint: &dyn Joint, own: &[bool]) -> Vec<bool> {
    let mut values: Vec<f64> = own.iter().map(|flag| f64::from(u8::from(*flag))).collect();
    joint.update(&mut values);
    values.into_iter().map(|value| value > 0.0).collect()
}

/// Bits that one fold of a sum keeps, and the binary logarithm of the largest number of summands.
const FOLD_BITS: i32 = 26;
/// A sum is zero if all its values are smaller than this.
const TINY: f64 = 1e-250;

/// Sums over all parts that do not depend on the order of summation, bit for bit, and therefore not
/// on the partition. They accept at most 2²⁶ values. Collective.
///
/// Each value is split into multiples of three units, 26 bits apart and equal on all parts, whose
/// sums are exact. Bits below 2⁻⁷⁸ of the largest value are dropped. Source: Demmel and Nguyen
/// 2013, "Fast reproducible floating-point summation", IEEE Symp. Computer Arithmetic 21, 163.
pub(crate) fn sums<I: Iterator<Item = f64> + Clone, const N: usize>(
    joint: &dyn Joint,
    values: [I; N],
) -> [f64; N] {
    let larger = |m: f64, x: f64| {
        if m.is_nan() || x.abs() <= m {
            m
        } else {
            x.abs()
        }
    };
    let mut largest: [f64; N] = std::array::from_fn(|i| values[i].clone().fold(0.0, larger));
    joint.max(&mut largest);
    let mut folds = [[0.0; 3]; N];
    for ((values, largest), folds) in values.into_iter().zip(largest).zip(&mut folds) {
        if largest < TINY {
            continue;
        }
        // A power of two above the largest value. It is not-a-number if the largest value is not
        // finite.
        let top = 2.0 * f64::from_bits(largest.to_bits() & (0x7ff << 52));
        let top = if largest.is_finite() { top } else { f64::NAN };
        // Adding and subtracting the rounder rounds a number to a multiple of the unit.
        let rounder: [f64; 3] =
            std::array::from_fn(|k| 1.5 * top * 2.0_f64.powi(52 - FOLD_BITS * (k as i32 + 1)));
        for value in values {
            let mut rest = value;
            for (fold, rounder) in folds.iter_mut().zip(rounder) {
                let part = (rest + rounder) - rounder;
                *fold += part;
                rest -= part;
            }
        }
    }
    joint.sum(folds.as_flattened_mut());
    folds.map(|[high, middle, low]| high + (middle + low))
}

/// Scalar products over owned nodes, reproducible like [`sums`].
pub(crate) fn dots<const N: usize>(joint: &dyn Joint, pairs: [(&[f64], &[f64]); N]) -> [f64; N] {
    let n = joint.n_owned();
    sums(
        joint,
        pairs.map(|(a, b)| a[..n].iter().zip(&b[..n]).map(|(a, b)| a * b)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_depend_on_no_order_and_are_those_of_more_digits(
            mut values in prop::collection::vec((-1.0..1.0f64, -20..20i32), 1..200),
            by in 0..200usize,
        ) {
            let as_numbers = |v: &[(f64, i32)]| v.iter().map(|(m, e)| m * 2.0_f64.powi(*e)).collect::<Vec<f64>>();
            let sum = |v: &[f64]| sums(&Alone(v.len()), [v.iter().copied()])[0];
            let numbers = as_numbers(&values);
            // Compared with Neumaier's compensated sum.
            let (mut total, mut lost) = (0.0_f64, 0.0_f64);
            for x in &numbers {
                let next = total + x;
                lost += if total.abs() >= x.abs() { (total - next) + x } else { (x - next) + total };
                total = next;
            }
            let largest = numbers.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            prop_assert!((sum(&numbers) - (total + lost)).abs() <= 1e-15 * largest.max(total.abs()));
            let n = values.len();
            values.rotate_left(by % n);
            prop_assert_eq!(sum(&numbers).to_bits(), sum(&as_numbers(&values)).to_bits());
            values.reverse();
            prop_assert_eq!(sum(&numbers).to_bits(), sum(&as_numbers(&values)).to_bits());
        }
    }

    #[test]
    fn what_is_no_number_stays_visible() {
        assert!(sums(&Alone(2), [[1.0, f64::NAN, 2.0].into_iter()])[0].is_nan());
        assert!(sums(&Alone(2), [[1.0, f64::INFINITY].into_iter()])[0].is_nan());
        assert_eq!(
            sums(&Alone(2), [[0.0, 0.0].into_iter(), [1.5, -4.0].into_iter()]),
            [0.0, -2.5]
        );
    }
}
