//! The length from which a cell's stretch is counted.

/// The length from which a cell's stretch is counted.
///
/// A sarcomere knows its slack length (about 1.9 µm in rats, at most about 2.3 µm: abstract of PMC2269383, which cites ter
/// Keurs 1980, Circ Res 46:703, not read); it does not know end-diastole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StretchReference {
    /// Length at end-diastole, as in the paper: the stretch is one there.
    EndDiastole,
    /// Slack length of the sarcomere.
    Unloaded {
        /// Slack length over the length in the unloaded wall, dimensionless.
        slack: f64,
    },
}

impl StretchReference {
    /// The cell's stretch at end-diastole.
    ///
    /// - `end_diastolic`: stretch of end-diastole from the unloaded wall, dimensionless
    #[must_use]
    pub fn at_end_diastole(self, end_diastolic: f64) -> f64 {
        match self {
            Self::EndDiastole => 1.0,
            Self::Unloaded { slack } => end_diastolic / slack,
        }
    }

    /// Stretch, from the unloaded wall, of the configuration to which the model's stress belongs.
    ///
    /// - `end_diastolic`: as in [`Self::at_end_diastole`]
    #[must_use]
    pub fn stress_configuration(self, end_diastolic: f64) -> f64 {
        match self {
            Self::EndDiastole => end_diastolic,
            Self::Unloaded { .. } => 1.0,
        }
    }
}
