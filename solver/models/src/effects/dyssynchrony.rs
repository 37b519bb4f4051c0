//! Dyssynchrony: late contraction of part of the wall.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::ventricle::ActivationGroups;
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of dyssynchrony.
pub const EFFECT: Effect = Effect {
    name: "dyssynchrony",
    kind: Kind::Physiology,
    meaning: "Part of the wall is activated late, as with a bundle branch block.",
    equation: "a share f of every activation group is activated a delay D later",
    source: "Our values. Prinzen, Vernooy and Auricchio 2013, Circulation 128:2407, and Kerckhoffs et al. 2003, Ann Biomed Eng 31:536 (activation in models), were not read",
    parameters: &[
        Parameter {
            name: "delay_ms",
            unit: "ms",
            meaning: "delay D of the late part",
            range: (0.0, 150.0),
            off: Some(0.0),
            smallest: 20.0,
            typical: 60.0,
            prior_scale: 35.0,
            role: Role::Strength,
        },
        Parameter {
            name: "late_share",
            unit: "1",
            meaning: "share f of the wall that is late",
            range: (0.15, 0.65),
            off: None,
            smallest: 0.0,
            typical: 0.4,
            prior_scale: 0.15,
            role: Role::Shape,
        },
    ],
    signature: "isovolumic contraction and relaxation both prolonged: shoulders in dP/dt, lower extremes on both sides",
    marks: &[
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::Pressure,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::PressureRate,
            sign: Sign::Down,
        },
    ],
    confused_with: &["delayed_relaxation", "catheter_response"],
    separated_by: &[
        Measurement::Qrs.words(),
        Measurement::ValveTimes.words(),
        "an activation map",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::ActivationMap {
        how: "activation times of the lateral share `late_share` of the wall gain `delay_ms`",
    },
    hidden_because: None,
    remedy: None,
    action: Action::Wall(add),
};

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    let (delay_ms, share) = (values[0], values[1]);
    let (times, weights) = (parts.groups.times_ms(), parts.groups.weights());
    let late_times = times.iter().map(|t| t + delay_ms);
    let all_times = times.iter().copied().chain(late_times).collect();
    let all_weights = weights
        .iter()
        .map(|w| (1.0 - share) * w)
        .chain(weights.iter().map(|w| share * w))
        .collect();
    parts.groups = ActivationGroups::new(all_times, all_weights)?;
    Ok(parts)
}
