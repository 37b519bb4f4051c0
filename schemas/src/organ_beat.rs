//! Input of one simulation of the organ.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::NoiseWindows;
use crate::finite_element::EquationSettings;
use crate::organ::{
    BeatCount, CellStretch, CirculationSpec, ContractionSpec, OrganSpec, VALVE_PARAMETERS,
    ValveParameters,
};

/// Input of one simulation of the organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OrganBeatSpec {
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// Largest time step.
    pub time_step_ms: f64,
    /// Shortest time step. If such a step fails, the simulation has diverged.
    pub shortest_step_ms: f64,
    /// Number of Newton iterations after which a step fails.
    pub newton_iterations: u32,
    /// Organ with its passive state.
    pub organ: OrganSpec,
    /// Arterial load, filling pressure and effects.
    pub circulation: CirculationSpec,
    /// Resistances of the valves.
    pub valves: ValveParameters,
    /// Model of the active stress.
    pub contraction: ContractionSpec,
    /// Definition of the stretch in the cells.
    #[serde(default)]
    pub cell_stretch: CellStretch,
    /// Number of beats.
    pub beats: BeatCount,
    /// Measured end-diastolic volume, for the biomarker `end_of_beat_gap`.
    #[serde(rename = "measured_end_diastolic_volume_mL")]
    pub measured_end_diastolic_volume_ml: Option<f64>,
    /// Windows over which biomarkers of the traces are read, as for the measured traces.
    #[serde(default, skip_serializing_if = "NoiseWindows::are_none")]
    pub noise_windows: NoiseWindows,
    /// Settings of the solution of the finite-element ventricle's equations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finite_element: Option<EquationSettings>,
}

impl OrganBeatSpec {
    /// The same beat with other parameters of the cell and of the valves, by name; absent
    /// parameters do not change.
    #[must_use]
    pub fn with_parameters(&self, parameters: &BTreeMap<String, f64>) -> Self {
        let mut beat = self.clone();
        beat.valves = beat.valves.with(parameters);
        if let ContractionSpec::Land2017Rice {
            parameters: cell, ..
        }
        | ContractionSpec::Land2017Trace {
            parameters: cell, ..
        } = &mut beat.contraction
        {
            let of_cell = parameters
                .iter()
                .filter(|(name, _)| !VALVE_PARAMETERS.contains(&name.as_str()));
            cell.extend(of_cell.map(|(name, value)| (name.clone(), *value)));
        }
        beat
    }
}
