//! Settings of the integration.

use serde::{Deserialize, Serialize};

use crate::dispatch::SimdPath;
use crate::input::NegativeKwu;

/// Settings of the integration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EngineSettings {
    /// Instruction set; `None` takes the best one of this processor.
    pub path: Option<SimdPath>,
    /// Bound of each step's error relative to the quantity (and to a share of its peak where it is small); also of the
    /// state's change over a beat that counts as periodic.
    pub tolerance: f64,
    /// Treatment of cells with k_WU < 0.
    pub negative_kwu: NegativeKwu,
    /// Beats at full accuracy before a cell counts as not periodic.
    pub max_beats: u32,
    /// Steps in a beat, refused ones included, before a cell counts as stuck.
    pub max_steps_per_beat: u32,
    /// Length \[ms\] of the coarse run-in from static equilibrium to the first beat at full accuracy; a whole cycle where
    /// calcium has not come down by half at its start.
    pub run_in_ms: f64,
    /// Tolerance of the run-in, in units of `tolerance`.
    pub run_in_tolerance: f64,
    /// Tolerance, in units of `tolerance`, of the last beats of cells whose stress rises again after its maximum:
    /// stretch-driven oscillations magnify errors. 1 leaves them as they are.
    pub oscillation_tolerance: f64,
}

impl Default for EngineSettings {
    fn default() -> Self {
        Self {
            path: None,
            tolerance: 1e-4,
            negative_kwu: NegativeKwu::default(),
            max_beats: 50,
            max_steps_per_beat: 20_000,
            run_in_ms: 500.0,
            run_in_tolerance: 5.0,
            oscillation_tolerance: 0.1,
        }
    }
}
