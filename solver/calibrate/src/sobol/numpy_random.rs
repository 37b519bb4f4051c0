//! `NumPy`'s default generator with an integer seed, which reproduces `SALib`'s scrambled points
//! and bootstrap resamples for the same seed.
//!
//! Source: O'Neill 2014, PCG XSL RR 128/64; Lemire 2019, ACM Trans. Model. Comput. Simul. 29:3
//! (bounded numbers without division); the seed is spread by `NumPy`'s `SeedSequence` (O'Neill
//! 2015, "Developing a `seed_seq` alternative"). Only
//! `numpy.random.default_rng(seed).integers(bound)` for bounds below 2³² is reproduced.

use rand::RngCore;
use rand_pcg::Pcg64;

/// Number of words of `SeedSequence`'s pool.
const POOL: usize = 4;
const XOR_SHIFT: u32 = 16;

/// `numpy.random.default_rng(seed)`, restricted to bounded integers.
#[derive(Debug, Clone)]
pub(super) struct NumpyRandom {
    pcg: Pcg64,
    /// Upper half of the last 64 bits. A 32-bit number uses the lower half first.
    upper_half: Option<u32>,
}

impl NumpyRandom {
    pub(super) fn new(seed: u64) -> Self {
        let words = seed_words(seed);
        let wide = |i: usize| u128::from(words[i]) | (u128::from(words[i + 1]) << 32);
        // The first two 64-bit words are the state, the next two the stream, high word first.
        Self {
            pcg: Pcg64::new((wide(0) << 64) | wide(2), (wide(4) << 64) | wide(6)),
            upper_half: None,
        }
    }

    fn next_u32(&mut self) -> u32 {
        if let Some(upper) = self.upper_half.take() {
            return upper;
        }
        let both = self.pcg.next_u64();
        self.upper_half = Some((both >> 32) as u32);
        both as u32
    }

    /// An integer from 0 to below `bound`, with equal probabilities.
    pub(super) fn below(&mut self, bound: u32) -> u32 {
        let mut product = u64::from(self.next_u32()) * u64::from(bound);
        if (product as u32) < bound {
            let threshold = bound.wrapping_neg() % bound;
            while (product as u32) < threshold {
                product = u64::from(self.next_u32()) * u64::from(bound);
            }
        }
        (product >> 32) as u32
    }

    /// A bit that is 0 or 1 with equal probability.
    pub(super) fn bit(&mut self) -> u32 {
        self.below(2)
    }
}

/// A hash whose multiplier changes with each call.
struct Hash {
    constant: u32,
    multiplier: u32,
}

impl Hash {
    fn of(&mut self, value: u32) -> u32 {
        let mixed = value ^ self.constant;
        self.constant = self.constant.wrapping_mul(self.multiplier);
        let mixed = mixed.wrapping_mul(self.constant);
        mixed ^ (mixed >> XOR_SHIFT)
    }
}

fn mix(x: u32, y: u32) -> u32 {
    let mixed = x
        .wrapping_mul(0xCA01_F9DD)
        .wrapping_sub(y.wrapping_mul(0x4973_F715));
    mixed ^ (mixed >> XOR_SHIFT)
}

/// Derives eight words from a seed.
fn seed_words(seed: u64) -> [u32; 8] {
    // A seed has at most two words, fewer than the pool, which is padded with zeros.
    let entropy = [seed as u32, (seed >> 32) as u32, 0, 0];
    let mut hash = Hash {
        constant: 0x43B0_D7E5,
        multiplier: 0x931E_8875,
    };
    let mut pool = entropy.map(|word| hash.of(word));
    for source in 0..POOL {
        for target in (0..POOL).filter(|target| *target != source) {
            pool[target] = mix(pool[target], hash.of(pool[source]));
        }
    }
    let mut hash = Hash {
        constant: 0x8B51_F9DD,
        multiplier: 0x58F3_8DED,
    };
    std::array::from_fn(|i| hash.of(pool[i % POOL]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `numpy.random.default_rng(seed).integers(bound, size=8)`, `NumPy` 2.4.6.
    #[test]
    fn numbers_are_those_of_numpy() {
        let draw = |seed, bound| {
            let mut random = NumpyRandom::new(seed);
            (0..8).map(|_| random.below(bound)).collect::<Vec<_>>()
        };
        assert_eq!(draw(0, 1024), [871, 652, 523, 276, 315, 41, 77, 16]);
        assert_eq!(draw(1, 1000), [473, 511, 755, 950, 34, 144, 822, 948]);
        assert_eq!(draw(20260101, 3), [1, 0, 1, 2, 0, 1, 1, 2]);
        assert_eq!(
            draw(1099511627793, 4000000000),
            [
                3296128163, 1350598681, 3148440408, 1056502744, 3105403195, 2102821684, 184582129,
                734195447
            ]
        );
    }

    #[test]
    fn bits_are_fair() {
        let mut random = NumpyRandom::new(7);
        let ones: u32 = (0..10_000).map(|_| random.bit()).sum();
        // Binomial: mean 5000, standard deviation 50.
        assert!((4800..5200).contains(&ones), "{ones}");
    }
}
