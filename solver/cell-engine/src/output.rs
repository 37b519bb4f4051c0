//! Output of an evaluation, and the cost of the paper's fit.

use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{CellReading, Penalty};
use crate::input_problem::InputProblem;

/// Ending of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum CellStatus {
    /// In its periodic state: the state returns over the reported beat to within the tolerance.
    #[default]
    Periodic,
    /// Not periodic after the allowed number of beats; the last beat is reported.
    NotPeriodic,
    /// Given up because its cost cannot come below the bound. The output then holds the transient
    /// beat that showed it or, with no beat at all, calcium's durations.
    Hopeless,
    /// A step became too short, or too many steps were needed; nothing else is reported.
    Stuck {
        /// Time in the beat \[ms\].
        t_ms: f64,
    },
    /// Refused before any step; nothing else is reported.
    Refused(InputProblem),
}

/// Result of one evaluation. Without a beat all numbers but those of calcium are zero; none is ever NaN.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CellOutput {
    /// Ending of the evaluation.
    pub status: CellStatus,
    /// Reading of the reported beat on the 1 ms grid.
    pub reading: CellReading,
    /// Penalty terms of the reported beat on the 1 ms grid.
    pub penalty: Penalty,
    /// Beats at full accuracy, the reported one included.
    pub beats: u32,
    /// Change of the state over the reported beat, relative to the state's peaks and in the norm of the error control.
    pub state_change: f64,
    /// Number of accepted steps, all beats together.
    pub steps: u32,
    /// Number of refused steps, all beats together.
    pub steps_refused: u32,
    /// Whether k_WU is negative.
    pub negative_kwu: bool,
}

impl CellOutput {
    /// Whether the biomarkers are those of a periodic beat.
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        self.status == CellStatus::Periodic
    }
}

/// A beat on the grid 0, 1, … ms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CellTrace {
    /// Active stress at each time \[kPa\].
    pub sa_kpa: Vec<f64>,
    /// Stretch at each time, relative to the slack length.
    pub lambda: Vec<f64>,
    /// Calcium at each time \[µM\].
    pub calcium_um: Vec<f64>,
}

/// Targets and weights of the paper's cost, eqs. 18 and 19.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Objective {
    /// Biomarkers that the cell should have.
    pub targets: CellBiomarkers,
    /// Weights of the squared relative differences, in the order of the biomarkers.
    pub weights: [f64; 6],
}

impl Objective {
    /// The paper's weights: 5, 1, 5, 1, 1 and 100.
    #[must_use]
    pub fn new(targets: CellBiomarkers) -> Self {
        Self {
            targets,
            weights: [5.0, 1.0, 5.0, 1.0, 1.0, 100.0],
        }
    }

    /// Cost of a beat, Σ w ((target − value)/target)² + penalty.
    #[must_use]
    pub fn cost(&self, biomarkers: &CellBiomarkers, penalty: &Penalty) -> f64 {
        let misfit: f64 = biomarkers
            .values()
            .iter()
            .zip(&self.targets.values())
            .zip(&self.weights)
            .map(|((value, target), weight)| weight * ((target - value) / target).powi(2))
            .sum();
        misfit + penalty.total()
    }
}

/// Costs above which an optimiser has no use for a cell.
#[derive(Debug, Clone, Copy)]
pub struct CostBound<'a> {
    /// Cost that a beat is given, with its targets.
    pub objective: &'a Objective,
    /// One bound for each input.
    pub bounds: &'a [f64],
    /// Factor on the bound above which a transient beat gives a cell up, because the periodic
    /// beat's cost may be somewhat lower. A factor of 2 is on the safe side.
    pub margin: f64,
}
