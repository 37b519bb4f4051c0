//! Random numbers that depend only on a seed, a purpose and a position.
//!
//! Each generation (and each candidate of the immediate mode) has its own generator. A state
//! therefore stores no generator, and a restart at any generation continues bit for bit.

use rand_pcg::Pcg64;

/// Purpose of random numbers; each has its own PCG stream.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Purpose {
    /// The first population, or a design of experiments.
    LatinHypercube = 1,
    /// The mutation scale of a generation.
    Dither = 2,
    /// Trials of a generation.
    Trials = 3,
    /// Normal deviates of a generation of the evolution strategy.
    Deviates = 6,
    /// Initial means of the runs of the evolution strategy.
    Starts = 7,
    /// Draws of a posterior.
    Posterior = 8,
    /// Starts of descents.
    Descents = 9,
}

/// The generator for a seed, a purpose and a position such as (generation, candidate).
pub(crate) fn generator(seed: u64, purpose: Purpose, position: [u64; 2]) -> Pcg64 {
    let low = mix(mix(seed) ^ position[0]);
    let high = mix(low ^ position[1].wrapping_mul(0x9E37_79B9_7F4A_7C15));
    Pcg64::new((u128::from(high) << 64) | u128::from(low), purpose as u128)
}

/// `SplitMix64` (Steele, Lea and Flood 2014), by which neighbouring seeds give unrelated states.
fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;
    use std::collections::HashSet;

    #[test]
    fn seeds_purposes_and_positions_are_unrelated() {
        let mut seen = HashSet::new();
        let mut sum = 0.0;
        for seed in 0..20 {
            for purpose in [Purpose::LatinHypercube, Purpose::Dither, Purpose::Trials] {
                for position in [[0, 0], [0, 1], [1, 0], [2, 0], [0, 2]] {
                    let u: f64 = generator(seed, purpose, position).random();
                    assert!(seen.insert(u.to_bits()));
                    sum += u;
                }
            }
        }
        // The mean of 300 uniform numbers is 0.5, with a standard error of 0.017.
        assert!((sum / 300.0 - 0.5).abs() < 0.06, "{}", sum / 300.0);
    }
}
