//! Properties of the model that effects need when they are added.

use crate::circulation::LeftHeart;
use cardiotwin_units::Ms;

/// Properties of the model that effects need when they are added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// Circulation and cycle length of the base model.
    pub heart: LeftHeart,
    /// Time from the start of the beat to the first activation of the wall.
    pub onset: Ms,
}

impl Surroundings {
    /// Cycle length of the base model.
    #[must_use]
    pub fn cycle_length(&self) -> Ms {
        self.heart.cycle_length
    }
}
