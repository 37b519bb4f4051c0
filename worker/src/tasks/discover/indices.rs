//! Indices of the patient's heart and vessels in the fitted models, before and after the accepted
//! effects.

use std::collections::BTreeMap;

use cardiotwin_discover::forward::Prediction;
use cardiotwin_schemas::discover::IndexChange;
use cardiotwin_signals::pressure_volume_loop::stroke_work_mj;

/// Indices of both beats with their base values.
pub fn indices(beats: [&Prediction; 2], bases: [&BTreeMap<String, f64>; 2]) -> Vec<IndexChange> {
    let [before, after] = [0, 1].map(|i| of(beats[i], bases[i]));
    (before.into_iter().zip(after))
        .map(|((name, before), (_, after))| IndexChange {
            name: name.to_owned(),
            before,
            after,
        })
        .collect()
}

fn of(beat: &Prediction, base: &BTreeMap<String, f64>) -> [(&'static str, f64); 10] {
    let (pressure, volume) = (&beat.true_pressure_mmhg, &beat.true_volume_ml);
    let greatest = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
    let (largest, least) = (
        greatest(volume),
        volume.iter().copied().fold(f64::MAX, f64::min),
    );
    let end_of_filling = volume.iter().position(|v| *v == largest).unwrap_or(0);
    let stroke = largest - least;
    let base = |name: &str| base.get(name).copied().unwrap_or(f64::NAN);
    [
        ("filling_pressure_mmHg", base("left_atrial_pressure_mmHg")),
        ("end_diastolic_pressure_mmHg", pressure[end_of_filling]),
        ("end_diastolic_volume_mL", largest),
        ("ejection_fraction", stroke / largest),
        ("forward_stroke_volume_mL", beat.forward_stroke_volume_ml),
        (
            "regurgitant_fraction",
            (1.0 - beat.forward_stroke_volume_ml / stroke).max(0.0),
        ),
        (
            "pressure_drop_to_aorta_mmHg",
            greatest(pressure) - beat.systolic_mmhg,
        ),
        (
            "stroke_work_mJ",
            stroke_work_mj(volume, pressure).unwrap_or(f64::NAN),
        ),
        ("peak_active_stress_kPa", base("Smax_ref_kPa")),
        (
            "peripheral_resistance_mmHg_s_per_mL",
            base("peripheral_resistance_mmHg_s_per_mL"),
        ),
    ]
}
