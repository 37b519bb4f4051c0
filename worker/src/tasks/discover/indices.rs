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
    let stroke = largest - least;
    let base = |name: &str| base.get(name).copied().unwrap_or(f64::NAN);
    [
        ("filling_pressure_mmHg", base("left_atrial_pressure_mmHg")),
        // As of the measured beat, where it begins. The volume is largest later, when the pressure has
        // risen: the mitral valve closes in the middle of the rise.
        (
            "end_diastolic_pressure_mmHg",
            pressure.first().copied().unwrap_or(f64::NAN),
        ),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_diastolic_pressure_is_that_of_the_beats_begin() {
        // The volume grows until the middle of the pressure's rise, as with a slow mitral valve.
        let at = |k: usize| k as f64;
        let beat = Prediction {
            step_ms: 1.0,
            true_volume_ml: (0..400)
                .map(|k| 120.0 - (at(k) - 40.0).abs() * 0.1)
                .collect(),
            true_pressure_mmhg: (0..400).map(|k| 8.9 + 0.7 * at(k.min(60))).collect(),
            ..Prediction::default()
        };
        let found = of(&beat, &BTreeMap::new());
        let value = |name: &str| found.iter().find(|(n, _)| *n == name).unwrap().1;
        assert_eq!(value("end_diastolic_pressure_mmHg"), 8.9);
        assert_eq!(value("end_diastolic_volume_mL"), 120.0);
    }
}
