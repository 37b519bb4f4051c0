//! What a search for missing effects says of a patient.

use crate::findings::{EffectClass, Findings, RankedEffect, Unexplained};

/// Probability up to which chance does not explain the best candidate's evidence.
pub const BY_CHANCE: f64 = 0.05;
/// Probability from which a candidate is likelier than everything else together.
const LIKELY: f64 = 0.5;

/// What a search says of a patient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict<'a> {
    /// Effects are named.
    Named,
    /// One effect of a class is missing, but the data do not tell which.
    OneOf(&'a EffectClass),
    /// No effect explains the gap between model and data.
    Unexplained(&'a Unexplained),
    /// A candidate is better than chance or likely, but none is named.
    Undecided,
    /// Nothing suggests an effect, but a gap remains.
    Gap(&'a Unexplained),
    /// The base model follows the data.
    Nothing,
}

impl Findings {
    /// What the search says. "Nothing" excludes a probable candidate and a gap.
    #[must_use]
    pub fn verdict(&self) -> Verdict<'_> {
        if !self.none {
            return Verdict::Named;
        }
        if let Some(class) = self.classes.first() {
            return Verdict::OneOf(class);
        }
        if let Some(gap) = &self.unexplained {
            return Verdict::Unexplained(gap);
        }
        if self.p_value < BY_CHANCE || self.likely().is_some() {
            return Verdict::Undecided;
        }
        self.remaining
            .as_ref()
            .map_or(Verdict::Nothing, Verdict::Gap)
    }

    /// The first candidate, if it is likelier than everything else together.
    #[must_use]
    pub fn likely(&self) -> Option<&RankedEffect> {
        let first = self.effects.first();
        first.filter(|effect| effect.probability > LIKELY)
    }

    /// The class of an accepted effect, if the data do not decide within it.
    #[must_use]
    pub fn class_of(&self, effect: &str) -> Option<&EffectClass> {
        (self.classes.iter()).find(|class| class.effects.iter().any(|name| name == effect))
    }
}
