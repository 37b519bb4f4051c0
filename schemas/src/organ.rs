//! Parameters of the organ models that pass between processes. `docs/models.md` has the equations.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::external::ExternalOrgan;
use crate::finite_element::FiniteElementOrgan;
use crate::input_file::InputFile;

pub use crate::loads::{CirculationSpec, ClosedLoopSpec, EffectSpec, LoopFilling, LoopRest};
pub use crate::one_fibre::{ActivationSpec, OneFibrePassive};
pub use cardiotwin_vocabulary::cell::{
    CELL_DEFAULTS, CELL_PARAMETERS, RICE_PARAMETERS, cell_default,
};
pub use cardiotwin_vocabulary::circulation::{
    LoopContents, OPEN_CIRCUIT_EFFECTS, WindkesselParameters,
};
pub use cardiotwin_vocabulary::step1::{
    Step1Parameters, TanhParameters, VALVE_PARAMETERS, ValveParameters,
};

/// Model of the active stress. The parameters of Land's and Rice's models have the names of Tables
/// A2 and A4; absent parameters keep their default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "model", rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum ContractionSpec {
    /// Phenomenological model of step 1.
    Tanh {
        /// Parameters of the model.
        parameters: TanhParameters,
    },
    /// Land 2017 driven by Rice's calcium transient, for the verification beat.
    Land2017Rice {
        /// Parameters that differ from the defaults, by the paper's names.
        parameters: BTreeMap<String, f64>,
        /// Stretch at which the cell's periodic beat begins.
        #[serde(default = "crate::absent::one")]
        lambda_0: f64,
    },
    /// Land 2017 driven by a given calcium transient, for the verification beat.
    Land2017Trace {
        /// Parameters that differ from the defaults, by the paper's names.
        parameters: BTreeMap<String, f64>,
        /// Stretch at which the cell's periodic beat begins.
        #[serde(default = "crate::absent::one")]
        lambda_0: f64,
        /// File with calcium from activation on, columns `time_ms` and `Ca_uM`.
        calcium: InputFile,
    },
    /// Another model of the catalogue, driven by the time since activation, by the calcium of its
    /// own cell, or by Rice's default transient.
    Catalogue {
        /// Name in the catalogue, for example `bestel-clement-sorine` or `tor-ord-land`.
        name: String,
        /// Parameters that differ from the defaults. The keys carry their units.
        #[serde(default)]
        parameters: BTreeMap<String, f64>,
    },
}

impl ContractionSpec {
    /// Parameters of the cell of step 2 that differ from their defaults; `None` for every other
    /// model.
    #[must_use]
    pub fn cell_parameters(&self) -> Option<&BTreeMap<String, f64>> {
        match self {
            Self::Tanh { .. } | Self::Catalogue { .. } => None,
            Self::Land2017Rice { parameters, .. } | Self::Land2017Trace { parameters, .. } => {
                Some(parameters)
            }
        }
    }
}

/// Length at which the stretch of a cell is 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StretchOrigin {
    /// Slack length of the cell, which follows from the unloaded wall.
    Unloaded,
    /// Length at end-diastole (the paper's choice).
    EndDiastole,
}

/// Definition of the stretch in the cells of the organ.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellStretch {
    /// Length at which the stretch is 1.
    pub origin: StretchOrigin,
    /// Ratio of the slack length to the length in the unloaded wall. It has no effect with
    /// `end-diastole`.
    pub slack_stretch: f64,
}

impl Default for CellStretch {
    fn default() -> Self {
        Self {
            origin: StretchOrigin::EndDiastole,
            slack_stretch: 1.0,
        }
    }
}

/// Whether this is a parameter of the cell or of the valves in an organ with a cell.
#[must_use]
pub fn is_parameter(name: &str) -> bool {
    // The passive stress belongs to a 0D cell; the organ has its own.
    name != "a_p_kPa" && (CELL_PARAMETERS.contains(&name) || VALVE_PARAMETERS.contains(&name))
}

/// Organ of a simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "fidelity", rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum OrganSpec {
    /// Reduced one-fibre ventricle.
    Reduced {
        /// Passive state of the ventricle.
        passive: OneFibrePassive,
        /// Activation of the ventricle.
        activation: ActivationSpec,
    },
    /// 3D finite-element ventricle.
    FiniteElement(Box<FiniteElementOrgan>),
    /// Organ of an external solver.
    External(Box<ExternalOrgan>),
}

/// Number of beats of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "mode", rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum BeatCount {
    /// Exactly `n` beats; the last one is reported. A single beat never counts as
    /// periodic.
    Fixed {
        /// Number of beats.
        n: u32,
    },
    /// Beats until start and end of a beat agree, at most `max`.
    Periodic {
        /// Largest number of beats.
        max: u32,
        /// Largest change of pressure (mmHg) and volume (mL) over a beat.
        tolerance: f64,
    },
}
