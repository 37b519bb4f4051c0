//! Newtypes for quantities that cross crate boundaries, and the project's only unit conversions.
//!
//! The solver uses the coherent units mm, ms, mg, kPa, mN and µM internally. At its interfaces
//! (files, command line, circulation), pressure is in mmHg, volume in mL and flow in mL/s. All
//! conversions are defined in this crate.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kilopascal to millimetre of mercury: 1 kPa = 7.50062 mmHg.
pub const MMHG_PER_KPA: f64 = 7.500_616_827_041_698;

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $unit:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize, JsonSchema)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// The unit's symbol, as printed in tables and messages.
            pub const UNIT: &'static str = $unit;
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Display::fmt(&self.0, f)?;
                f.write_str(concat!(" ", $unit))
            }
        }

        impl std::ops::Add for $name {
            type Output = Self;
            fn add(self, rhs: Self) -> Self {
                Self(self.0 + rhs.0)
            }
        }

        impl std::ops::Sub for $name {
            type Output = Self;
            fn sub(self, rhs: Self) -> Self {
                Self(self.0 - rhs.0)
            }
        }

        impl std::ops::Mul<f64> for $name {
            type Output = Self;
            fn mul(self, rhs: f64) -> Self {
                Self(self.0 * rhs)
            }
        }

        impl std::ops::Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }
    };
}

quantity!(
    /// Time in milliseconds.
    Ms, "ms"
);
quantity!(
    /// Stress or pressure in kilopascal.
    Kpa, "kPa"
);
quantity!(
    /// Pressure in millimetres of mercury.
    Mmhg, "mmHg"
);
quantity!(
    /// Volume in millilitres.
    Ml, "mL"
);
quantity!(
    /// Flow in millilitres per second.
    MlPerS, "mL/s"
);
quantity!(
    /// Flow resistance in mmHg·s/mL.
    MmhgSPerMl, "mmHg s/mL"
);
quantity!(
    /// Compliance in mL/mmHg.
    MlPerMmhg, "mL/mmHg"
);
quantity!(
    /// Concentration in micromolar.
    MicroMolar, "uM"
);
quantity!(
    /// Fibre stretch, dimensionless: current over reference length.
    Stretch, ""
);

impl From<Kpa> for Mmhg {
    fn from(p: Kpa) -> Self {
        Self(p.0 * MMHG_PER_KPA)
    }
}

impl From<Mmhg> for Kpa {
    fn from(p: Mmhg) -> Self {
        Self(p.0 / MMHG_PER_KPA)
    }
}

impl MlPerS {
    /// Volume that a constant flow moves in `dt`.
    #[must_use]
    pub fn over(self, dt: Ms) -> Ml {
        Ml(self.0 * dt.0 * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_kilopascal_is_seven_and_a_half_mmhg() {
        assert!((Mmhg::from(Kpa(1.0)).0 - 7.50062).abs() < 1e-5);
        assert!((Kpa::from(Mmhg::from(Kpa(13.7))).0 - 13.7).abs() < 1e-12);
    }

    #[test]
    fn flow_over_time_is_volume() {
        assert!((MlPerS(400.0).over(Ms(5.0)).0 - 2.0).abs() < 1e-12);
    }

    #[test]
    fn display_names_the_unit() {
        assert_eq!(format!("{:.1}", Mmhg(12.34)), "12.3 mmHg");
    }
}
