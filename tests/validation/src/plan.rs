//! Cases of a set, balanced over effects, levels and noise, so that detection can be plotted
//! against each.

use crate::hidden::{HARD, NAMES, OFF_CATALOGUE};
use crate::measure::Case;
use crate::patient::Hearts;
use crate::random::Random;

/// Sets of cases, by content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plan {
    /// Cases without missing effects.
    Nulls,
    /// Cases with one effect of the catalogue.
    Singles,
    /// Cases with two effects of the catalogue.
    Doubles,
    /// Cases with a gap outside the catalogue.
    OffCatalogue,
    /// Extreme hearts with up to three effects and any noise: does the search always answer?
    Extremes,
}

/// A case to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedCase {
    /// Name of the case.
    pub id: String,
    /// Effects with their levels.
    pub effects: Vec<(&'static str, usize)>,
    /// Factor of the usual noise.
    pub noise: f64,
    /// Whether the data can hardly resolve the effects.
    pub hard: bool,
    /// Kind of its heart.
    pub hearts: Hearts,
    seed: u64,
}

/// Pairs that occur together in patients or are difficult to distinguish.
const PAIRS: [[&str; 2]; 10] = [
    ["atrial_kick", "mitral_regurgitation"],
    ["atrial_kick", "delayed_relaxation"],
    ["dyssynchrony", "mitral_regurgitation"],
    ["aortic_stenosis", "delayed_relaxation"],
    ["atrial_kick", "pressure_offset"],
    ["atrial_kick", "catheter_response"],
    ["mitral_regurgitation", "pv_misalignment"],
    ["delayed_relaxation", "pressure_offset"],
    ["aortic_regurgitation", "catheter_response"],
    ["dyssynchrony", "pv_misalignment"],
];

/// Factors of the usual noise, used in turn.
const NOISE: [f64; 3] = [1.0, 0.5, 2.0];

impl Plan {
    /// The first `n` cases of the set with this seed. Singles go through all effects at one level
    /// before the next level, with each noise in turn. Any beginning of the list is therefore
    /// balanced, and 192 cases contain each combination once.
    #[must_use]
    pub fn cases(self, n: usize, seed: u64, hearts: Hearts) -> Vec<PlannedCase> {
        let (prefix, stream) = match self {
            Self::Nulls => ("null", 1),
            Self::Singles => ("single", 2),
            Self::Doubles => ("double", 3),
            Self::OffCatalogue => ("off", 4),
            Self::Extremes => ("extreme", 5),
        };
        (0..n)
            .map(|i| {
                let (effects, noise) = match self {
                    Self::Nulls => (Vec::new(), 1.0),
                    Self::Singles => {
                        let round = i / NAMES.len();
                        // Middle levels come first.
                        let level = [2, 1, 3, 0][round % 4];
                        (
                            vec![(NAMES[i % NAMES.len()].0, level)],
                            NOISE[(i % NAMES.len() + round + round / 12) % NOISE.len()],
                        )
                    }
                    Self::Doubles => {
                        let level = 2 + i / PAIRS.len() % 2;
                        (
                            PAIRS[i % PAIRS.len()].map(|name| (name, level)).to_vec(),
                            1.0,
                        )
                    }
                    Self::OffCatalogue => {
                        let k = OFF_CATALOGUE.len();
                        (vec![(OFF_CATALOGUE[i % k], 1 + i / k % 3)], 1.0)
                    }
                    Self::Extremes => extreme(&mut Random::new(seed, 500_000 + i as u64)),
                };
                let hard = effects.iter().any(|(name, _)| HARD.contains(name));
                let seed = seed
                    .wrapping_mul(1_000_003)
                    .wrapping_add(stream * 100_000 + i as u64);
                PlannedCase {
                    id: format!("{prefix}-{:03}", i + 1),
                    effects,
                    noise,
                    hard,
                    hearts: match self {
                        Self::Extremes => Hearts::Extreme,
                        _ => hearts,
                    },
                    seed,
                }
            })
            .collect()
    }

    /// Whether the hidden gap lies outside the catalogue.
    #[must_use]
    pub fn is_off_catalogue(self) -> bool {
        self == Self::OffCatalogue
    }
}

/// Effects and noise of an extreme case.
fn extreme(random: &mut Random) -> (Vec<(&'static str, usize)>, f64) {
    let n = random.between(0.0, 4.0) as usize;
    let mut effects: Vec<(&'static str, usize)> = Vec::new();
    while effects.len() < n {
        let name = NAMES[random.between(0.0, NAMES.len() as f64) as usize].0;
        if effects.iter().all(|(other, _)| *other != name) {
            effects.push((name, random.between(0.0, 4.0) as usize));
        }
    }
    (effects, random.log_between(0.2, 4.0))
}

impl PlannedCase {
    /// Generates the case; `None` if no plausible patient has these effects.
    #[must_use]
    pub fn make(&self) -> Option<Case> {
        Case::draw(self.hearts, self.seed, &self.effects, self.noise)
    }

    /// Seed of the case, its only source of randomness.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn beginnings_are_balanced_and_seeds_differ() {
        let singles = Plan::Singles.cases(192, 7, Hearts::Elastance);
        let of = |name: &str| singles.iter().filter(|c| c.effects[0].0 == name).count();
        assert!(NAMES.iter().all(|(name, ..)| of(name) == 12));
        let kinds: BTreeSet<_> = singles
            .iter()
            .map(|c| (&c.effects, (10.0 * c.noise) as u8))
            .collect();
        assert_eq!(kinds.len(), 192);
        let first: BTreeSet<_> = singles[..16].iter().map(|c| c.effects[0].0).collect();
        assert_eq!(first.len(), 16);
        let all = [
            Plan::Nulls,
            Plan::Singles,
            Plan::Doubles,
            Plan::OffCatalogue,
        ];
        let seeds: BTreeSet<u64> = all
            .iter()
            .flat_map(|p| [1, 2].map(|s| p.cases(50, s, Hearts::Elastance)))
            .flatten()
            .map(|c| c.seed())
            .collect();
        assert_eq!(seeds.len(), 400);
    }
}
