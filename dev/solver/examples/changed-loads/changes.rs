//! Changes of hearts and twins.

use cardiotwin_validation::circulation::{Beat, Rest};

/// Cycle at rest \[ms\]: 70 beats a minute.
pub const CYCLE_MS: usize = 857;

/// A change of a heart, and of its twin.
pub struct Change {
    /// Name.
    pub name: &'static str,
    /// Name of the scenario of the twin: of two changes of hearts that are the same of a twin, the first.
    pub scenario: &'static str,
    /// The twin's quantity.
    pub quantity: &'static str,
    /// The new value, in the syntax of `--set`.
    pub amount: &'static str,
    /// Value after the change over the one before.
    pub factor: f64,
    /// Whether discrepancies are learnt from this size of the change.
    pub is_learnt: bool,
    /// The heart's steady beat after the change.
    pub of_heart: fn(&Rest) -> Option<Beat>,
}

const RESISTANCE: &str = "peripheral_resistance_mmHg_s_per_mL";
const COMPLIANCE: &str = "compliance_mL_per_mmHg";
const FILLING: &str = "left_atrial_pressure_mmHg";
const STRENGTH: &str = "Smax_ref_kPa";
const CYCLE: &str = "cycle_length_ms";
const AORTIC_VALVE: &str = "R_AV_f_mmHg_s_per_mL";

fn resistance(rest: &Rest, factor: f64) -> Option<Beat> {
    rest.changed(|heart| heart.peripheral_resistance *= factor)
}

fn compliance(rest: &Rest, factor: f64) -> Option<Beat> {
    rest.changed(|heart| {
        heart.arterial_compliance.0 *= factor;
        heart.arterial_compliance.1 *= factor;
    })
}

fn strength(rest: &Rest, factor: f64) -> Option<Beat> {
    rest.changed(|heart| heart.strengthen(factor))
}

fn aortic_valve(rest: &Rest, factor: f64) -> Option<Beat> {
    rest.changed(|heart| heart.aortic.resistance *= factor)
}

const fn change(
    (name, quantity): (&'static str, &'static str),
    (amount, factor): (&'static str, f64),
    of_heart: fn(&Rest) -> Option<Beat>,
) -> Change {
    Change {
        name,
        scenario: name,
        quantity,
        amount,
        factor,
        is_learnt: true,
        of_heart,
    }
}

const fn other_size(change: Change) -> Change {
    Change {
        is_learnt: false,
        ..change
    }
}

/// `rate` and `rate-alone` are the same change of a twin: of the hearts, systole shortens in the former by the square
/// root of the cycle, and keeps its length in the latter.
pub const CHANGES: [Change; 13] = [
    change(("periphery", RESISTANCE), ("-25%", 0.75), |rest| {
        resistance(rest, 0.75)
    }),
    change(("compliance", COMPLIANCE), ("-25%", 0.75), |rest| {
        compliance(rest, 0.75)
    }),
    change(("filling", FILLING), ("+20%", 1.2), |rest| rest.filled(1.2)),
    change(("contractility", STRENGTH), ("+20%", 1.2), |rest| {
        strength(rest, 1.2)
    }),
    change(("rate", CYCLE), ("600", 600.0 / CYCLE_MS as f64), |rest| {
        rest.changed(|heart| heart.pace(600))
    }),
    Change {
        scenario: "rate",
        ..change(
            ("rate-alone", CYCLE),
            ("600", 600.0 / CYCLE_MS as f64),
            |rest| rest.changed(|heart| heart.cycle_ms = 600),
        )
    },
    change(("aortic-valve", AORTIC_VALVE), ("+200%", 3.0), |rest| {
        aortic_valve(rest, 3.0)
    }),
    other_size(change(
        ("more-periphery", RESISTANCE),
        ("+25%", 1.25),
        |rest| resistance(rest, 1.25),
    )),
    other_size(change(
        ("more-compliance", COMPLIANCE),
        ("+25%", 1.25),
        |rest| compliance(rest, 1.25),
    )),
    other_size(change(("less-filling", FILLING), ("-15%", 0.85), |rest| {
        rest.filled(0.85)
    })),
    other_size(change(
        ("less-contractility", STRENGTH),
        ("-15%", 0.85),
        |rest| strength(rest, 0.85),
    )),
    other_size(change(
        ("slower", CYCLE),
        ("1000", 1000.0 / CYCLE_MS as f64),
        |rest| rest.changed(|heart| heart.pace(1000)),
    )),
    other_size(change(
        ("less-aortic-valve", AORTIC_VALVE),
        ("+50%", 1.5),
        |rest| aortic_valve(rest, 1.5),
    )),
];
