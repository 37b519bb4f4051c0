//! Parameters of the load with all that may be added to the three elements.

/// Positions in [`Values`]; the four of the three-element Windkessel first.
pub(super) mod at {
    pub const R1: usize = 0;
    pub const R2: usize = 1;
    pub const COMPLIANCE: usize = 2;
    pub const START: usize = 3;
    pub const OUTFLOW: usize = 4;
    pub const SERIES_INERTANCE: usize = 5;
    pub const PARALLEL_RATE: usize = 6;
    pub const JUNCTION_INERTANCE: usize = 7;
    pub const PROXIMAL_SHARE: usize = 8;
    pub const JUNCTION_RESISTANCE: usize = 9;
    pub const CREEP_SHARE: usize = 10;
    pub const CREEP_TIME: usize = 11;
    pub const LOSS: usize = 12;
    pub const STIFFENING: usize = 13;
    pub const LAG: usize = 14;
    pub const CATHETER_PERIOD: usize = 15;
    pub const CATHETER_DAMPING: usize = 16;
    pub const TRAVEL: usize = 17;
    /// How many there are.
    pub const N: usize = 18;
}

/// All parameters in s, mL, mmHg; zero is off for those of effects.
pub(super) type Values = [f64; at::N];

/// A parameter that an effect adds to the three elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Key in files, with the unit.
    pub name: &'static str,
    pub(super) position: usize,
    /// From the internal unit (s, mL, mmHg) to that of the name.
    pub(super) factor: f64,
    /// Plausible values in the internal unit; a fit stays inside.
    pub(super) range: (f64, f64),
    /// Where fits start, in the internal unit.
    pub(super) starts: &'static [f64],
    /// Size below which the effect is not named, in the internal unit; zero where the parameter says nothing of that.
    pub(super) smallest: f64,
}
