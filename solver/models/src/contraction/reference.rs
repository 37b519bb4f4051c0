//! The length from which a cell's stretch is counted.

/// The length from which a cell's stretch is counted.
///
/// A sarcomere knows its slack length (1.8 to 1.9 µm; ter Keurs 1980, Circ Res 46:703) and works between 1.8 and 2.2 µm
/// (de Tombe 2010, J Mol Cell Cardiol 48:851); it does not know end-diastole.
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
