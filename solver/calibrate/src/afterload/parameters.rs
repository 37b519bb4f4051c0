//! Parameters of the load: the three elements and all additions.

/// Indices into [`Values`]; the four of the three-element Windkessel come first.
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
    /// Number of parameters of the load.
    pub const N: usize = 18;
}

/// All parameters in s, mL and mmHg; zero turns an effect off.
pub(super) type Values = [f64; at::N];

/// A parameter that an effect adds to the three elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Key in files, which names the unit.
    pub name: &'static str,
    pub(super) position: usize,
    /// Factor from the internal unit (s, mL, mmHg) to the unit of the name.
    pub(super) factor: f64,
    /// Plausible range in the internal unit; a fit stays inside.
    pub(super) range: (f64, f64),
    /// Starting values of fits, in the internal unit.
    pub(super) starts: &'static [f64],
    /// Magnitude below which the effect is not named, in the internal unit; zero for a parameter
    /// that does not decide this.
    pub(super) smallest: f64,
}
