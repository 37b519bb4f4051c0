//! Conversion between the solver's biomarkers and those of the schemas.

use cardiotwin_schemas::biomarkers::{self, Biomarkers, TimePoints};
use cardiotwin_signals::{BiomarkerSet, Flag, NoiseWindows};
use cardiotwin_units::{Ml, Mmhg, Ms};

/// Converts the solver's biomarkers to the schema's values and time points.
#[must_use]
pub fn to_schema(set: &BiomarkerSet) -> (Biomarkers, TimePoints) {
    let mmhg = |value: Option<Mmhg>| value.map(|value| value.0);
    let ml = |value: Option<Ml>| value.map(|value| value.0);
    let ms = |value: Option<Ms>| value.map(|value| value.0);
    let biomarkers = Biomarkers {
        p_max_mmhg: mmhg(set.p_max),
        dpdt_max_mmhg_per_ms: set.dpdt_max_mmhg_per_ms,
        dpdt_min_mmhg_per_ms: set.dpdt_min_mmhg_per_ms,
        ptd90_ms: ms(set.ptd90),
        sv_ml: ml(set.sv),
        tau_vd_ms: ms(set.tau_vd),
        tau_vr_ms: ms(set.tau_vr),
        edv_ml: ml(set.edv),
        esv_ml: ml(set.esv),
        edp_mmhg: mmhg(set.edp),
        end_of_beat_gap_ml: ml(set.end_of_beat_gap),
    };
    let times = &set.time_points;
    let time_points = TimePoints {
        t1_ms: ms(times.t1),
        t2_ms: ms(times.t2),
        t3_ms: ms(times.t3),
        t4_ms: ms(times.t4),
        t5_ms: ms(times.t5),
        t6_ms: ms(times.t6),
        t7_ms: ms(times.t7),
    };
    (biomarkers, time_points)
}

/// Converts the windows of noisy traces to the schema.
#[must_use]
pub fn windows_to_schema(windows: NoiseWindows) -> biomarkers::NoiseWindows {
    let ms = |window: Option<Ms>| window.map(|window| window.0);
    biomarkers::NoiseWindows {
        pressure_ms: ms(windows.pressure),
        volume_ms: ms(windows.volume),
    }
}

/// Converts the windows of noisy traces to the solver.
#[must_use]
pub fn windows_to_solver(windows: biomarkers::NoiseWindows) -> NoiseWindows {
    NoiseWindows {
        pressure: windows.pressure_ms.map(Ms),
        volume: windows.volume_ms.map(Ms),
    }
}

/// Describes the flags of a set in words.
#[must_use]
pub fn remarks(set: &BiomarkerSet) -> Vec<String> {
    set.flags
        .iter()
        .map(|flag| words(*flag).to_owned())
        .collect()
}

fn words(flag: Flag) -> &'static str {
    match flag {
        Flag::PressureRiseNotReached => {
            "pressure is above its 10 % level when its upstroke begins: t1 is the upstroke's foot, extended downwards"
        }
        Flag::PressureRiseBeforeBeat => {
            "the 10 % level lies below the pressure at time zero: t1 lies before the beat"
        }
        Flag::PressureFallNotReached => {
            "pressure does not fall to its 10 % level: t3 is the end of the beat"
        }
        Flag::NoPressurePulse => "pressure has no pulse: no rates before and after a peak",
        Flag::NoEjection => "volume does not vary",
        Flag::EjectionTooShort => "ejection has too few samples for tau_VD",
        Flag::FillingNotRecovered => {
            "volume does not recover to 80 % of the stroke volume: tau_VR is fitted to the volume recovered"
        }
        Flag::FillingTooShort => "filling has too few samples for tau_VR",
    }
}
