//! Units of length in files. A file of points does not say its unit, so whoever names the file says it.

use crate::vec3::{Vec3, scale};

/// The unit that a file's coordinates are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// µm, the unit of CARP files.
    Micrometre,
    /// mm.
    Millimetre,
    /// cm.
    Centimetre,
    /// m.
    Metre,
}

impl LengthUnit {
    /// Every unit.
    pub const ALL: [Self; 4] = [
        Self::Micrometre,
        Self::Millimetre,
        Self::Centimetre,
        Self::Metre,
    ];

    /// How many of this unit make one millimetre.
    #[must_use]
    pub fn per_mm(self) -> f64 {
        match self {
            Self::Micrometre => 1e3,
            Self::Millimetre => 1.0,
            Self::Centimetre => 0.1,
            Self::Metre => 1e-3,
        }
    }

    /// Its symbol, as settings write it.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Micrometre => "um",
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
        }
    }

    /// The unit with that symbol.
    #[must_use]
    pub fn from_symbol(symbol: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.symbol() == symbol)
    }

    pub(crate) fn to_mm(self, point: Vec3) -> Vec3 {
        match self {
            // a division by a whole number is exact where the multiplication by its inverse is not
            Self::Micrometre => point.map(|x| x / 1e3),
            Self::Millimetre => point,
            Self::Centimetre => scale(point, 10.0),
            Self::Metre => scale(point, 1e3),
        }
    }
}
