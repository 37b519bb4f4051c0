//! Settings of the cell engine.

use cardiotwin_cell_engine::{EngineSettings, SimdPath};
use cardiotwin_schemas::settings::InstructionSet;

/// Engine settings for the requested instruction set.
#[must_use]
pub fn settings_for(instruction_set: InstructionSet) -> EngineSettings {
    let path = match instruction_set {
        InstructionSet::Auto => None,
        InstructionSet::Portable => Some(SimdPath::Portable),
        InstructionSet::Avx2 => Some(SimdPath::Avx2),
        InstructionSet::Avx512 => Some(SimdPath::Avx512),
    };
    EngineSettings {
        path,
        ..EngineSettings::default()
    }
}

/// Name, for the provenance, of the instruction set in use.
#[must_use]
pub fn path_in_use(instruction_set: InstructionSet) -> &'static str {
    match settings_for(instruction_set)
        .path
        .unwrap_or_else(SimdPath::best)
    {
        SimdPath::Portable => "portable lanes",
        SimdPath::Avx2 => "avx2 lanes",
        SimdPath::Avx512 => "avx512 lanes",
    }
}
