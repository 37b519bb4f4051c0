//! Reasons why a search for a passive state fails.

use cardiotwin_linalg::parallel::{PartitionError, RankFailure};

use super::farthest::Farthest;
use super::search_work::SearchWork;
use super::wall::WallError;
use crate::step::StepError;

/// Reasons why no passive state was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PassiveStateError {
    /// The wall could not be built.
    #[error("cannot build the wall")]
    Wall(#[from] WallError),
    /// The mesh cannot be partitioned among the ranks.
    #[error("cannot divide the mesh among the ranks")]
    Parts(#[from] PartitionError),
    /// The system starts no thread for a rank.
    #[error(transparent)]
    Rank(#[from] RankFailure),
    /// The watcher stopped the search.
    #[error("stopped")]
    Stopped,
    /// The search took more work than [`super::UnloadingSettings::most_work`].
    #[error(
        "no passive state found in {} Newton and {} linear iterations, with {trials} laws and {passes} passes; given up at \
         {pressure_kpa:.2} kPa", work.newton_iterations, work.krylov_iterations
    )]
    TooMuchWork {
        /// Whether the work of all laws was too much, rather than that of the last one.
        ends_the_search: bool,
        /// Work until then.
        work: SearchWork,
        /// Number of passive laws tried.
        trials: usize,
        /// Number of passes of the unloading.
        passes: usize,
        /// Pressure of the equilibrium that was sought last \[kPa\].
        pressure_kpa: f64,
        /// Node that the last pass missed most, if there was a pass.
        farthest: Option<Box<Farthest>>,
        /// Failure of the last equilibrium that was not found, if there was one.
        source: Option<Box<StepError>>,
    },
    /// The inflation did not reach its pressure.
    #[error("no equilibrium found beyond {reached_kpa:.4} of {wanted_kpa:.4} kPa")]
    Inflation {
        /// Pressure of the last equilibrium \[kPa\].
        reached_kpa: f64,
        /// Pressure to which the wall was to be inflated \[kPa\].
        wanted_kpa: f64,
        /// Failure of the smallest load step.
        source: StepError,
    },
    /// The search for the unloaded geometry did not converge.
    #[error(
        "no unloaded geometry found after {passes} passes: relative volume error {volume_error:.1e}, largest node \
         error {:.2} mm at ({:.1}, {:.1}, {:.1}) mm", farthest.distance_mm, farthest.at_mm[0], farthest.at_mm[1], farthest.at_mm[2]
    )]
    NotUnloaded {
        /// Number of passes of the unloading.
        passes: usize,
        /// Relative difference between the inflated volume and the volume of the image.
        volume_error: f64,
        /// Node that is farthest from its place in the image.
        farthest: Farthest,
    },
    /// No law meets the three points.
    #[error(
        "no stiffness and exponents give {wanted_ml:.2} mL at end-diastole and {wanted_unloaded_ml:.2} mL without \
         pressure: the closest give {found_ml:.2} and {found_unloaded_ml:.2} mL (NaN means no equilibrium)"
    )]
    NoLaw {
        /// Wanted end-diastolic volume \[mL\].
        wanted_ml: f64,
        /// Wanted unloaded volume \[mL\].
        wanted_unloaded_ml: f64,
        /// End-diastolic volume reached \[mL\].
        found_ml: f64,
        /// Unloaded volume reached \[mL\].
        found_unloaded_ml: f64,
    },
    /// The fit needs exponents, but the law has only a stiffness.
    #[error(
        "the {law} law of muscle has no exponents, which are needed to match two volumes (end-diastolic and \
         unloaded) or are changed by an effect; expected Guccione's or Holzapfel and Ogden's law"
    )]
    NoExponents {
        /// Name of the law.
        law: &'static str,
    },
    /// No stiffness in the range gives the wanted volume.
    #[error(
        "no stiffness gives a volume of {wanted_ml:.2} mL: {low_kpa:.3} kPa gives {at_low_ml:.2} mL, {high_kpa:.3} \
         kPa gives {at_high_ml:.2} mL (NaN means no equilibrium); the volumes and pressures of image and \
         end-diastole do not fit this law"
    )]
    NoStiffness {
        /// Lower end of the stiffness range \[kPa\].
        low_kpa: f64,
        /// Upper end of the stiffness range \[kPa\].
        high_kpa: f64,
        /// Volume that the stiffness has to give \[mL\].
        wanted_ml: f64,
        /// Volume at the lower end \[mL\].
        at_low_ml: f64,
        /// Volume at the upper end \[mL\].
        at_high_ml: f64,
    },
}

impl PassiveStateError {
    /// Whether no other way to an equilibrium with the same law is to be tried.
    #[must_use]
    pub fn ends_the_law(&self) -> bool {
        matches!(self, Self::Stopped | Self::TooMuchWork { .. })
    }

    /// Whether the search has to end, whatever else could be tried.
    #[must_use]
    pub fn ends_the_search(&self) -> bool {
        match self {
            Self::Stopped => true,
            Self::TooMuchWork {
                ends_the_search, ..
            } => *ends_the_search,
            _ => false,
        }
    }
}
