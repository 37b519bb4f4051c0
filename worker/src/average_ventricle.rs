//! A ventricle in the middle of the bundled cohort, for measurements and first trials without a
//! patient.

use cardiotwin_schemas::biomarkers::NoiseWindows;
use cardiotwin_schemas::organ::{
    ActivationSpec, BeatCount, CellStretch, CirculationSpec, ContractionSpec, OneFibrePassive,
    OrganSpec, TanhParameters, ValveParameters, WindkesselParameters,
};
use cardiotwin_schemas::task::OrganBeatSpec;

/// Cycle length of the average ventricle \[ms\].
pub const CYCLE_MS: f64 = 800.0;

/// One beat of the average one-fibre ventricle with Tanh at 1 ms steps, with its passive state and
/// activation.
#[must_use]
pub fn average_ventricle() -> (OrganBeatSpec, OneFibrePassive, ActivationSpec) {
    let passive = OneFibrePassive {
        wall_volume_ml: 97.5,
        unloaded_volume_ml: 71.0,
        end_diastolic_volume_ml: 130.0,
        end_diastolic_pressure_mmhg: 9.0,
        stiffness_kpa: 0.3,
        exponent: 9.24,
    };
    let afterload = WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: 0.055,
        peripheral_resistance_mmhg_s_per_ml: 0.85,
        compliance_ml_per_mmhg: 1.5,
    };
    let activation = ActivationSpec {
        spread_ms: 40.0,
        groups: 16,
        onset_ms: 0.0,
    };
    let spec = OrganBeatSpec {
        cycle_length_ms: CYCLE_MS,
        time_step_ms: 1.0,
        shortest_step_ms: 1.0 / 64.0,
        newton_iterations: 60,
        organ: OrganSpec::Reduced {
            passive,
            activation,
        },
        circulation: CirculationSpec {
            afterload,
            initial_windkessel_pressure_mmhg: 70.0,
            left_atrial_pressure_mmhg: 7.0,
            effects: Vec::new(),
            closed: None,
        },
        valves: ValveParameters::default(),
        contraction: ContractionSpec::Tanh {
            parameters: TanhParameters::default(),
        },
        cell_stretch: CellStretch::default(),
        beats: BeatCount::Fixed { n: 1 },
        measured_end_diastolic_volume_ml: None,
        noise_windows: NoiseWindows::default(),
        finite_element: None,
    };
    (spec, passive, activation)
}
