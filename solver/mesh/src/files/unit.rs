//! Units of length in files. Files of points do not contain their unit, so that the caller has to
//! specify it.

use crate::vec3::{Vec3, scale};

/// Unit of a file's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Micrometre, the unit of CARP files.
    Micrometre,
    /// Millimetre, the unit of the program's own meshes.
    Millimetre,
    /// Centimetre, in which a heart measures about ten.
    Centimetre,
    /// Metre, the SI unit.
    Metre,
}

impl LengthUnit {
    /// All units, from the smallest to the largest.
    pub const ALL: [Self; 4] = [
        Self::Micrometre,
        Self::Millimetre,
        Self::Centimetre,
        Self::Metre,
    ];

    /// Number of units in one millimetre.
    #[must_use]
    pub fn per_mm(self) -> f64 {
        match self {
            Self::Micrometre => 1e3,
            Self::Millimetre => 1.0,
            Self::Centimetre => 0.1,
            Self::Metre => 1e-3,
        }
    }

    /// Symbol of the unit, as it is written in settings.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Micrometre => "um",
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
        }
    }

    /// The unit with a symbol.
    #[must_use]
    pub fn from_symbol(symbol: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.symbol() == symbol)
    }

    pub(crate) fn to_mm(self, point: Vec3) -> Vec3 {
        match self {
            // Division by a whole number is exact, but multiplication by its inverse is not.
            Self::Micrometre => point.map(|x| x / 1e3),
            Self::Millimetre => point,
            Self::Centimetre => scale(point, 10.0),
            Self::Metre => scale(point, 1e3),
        }
    }
}
