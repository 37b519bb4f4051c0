//! Hidden effects of a case: effects of the catalogue in terms of this heart, and gaps outside the
//! catalogue.

use crate::activation::Course;
use crate::circulation::{AtrialContraction, Heart, Pericardium};
use crate::random::Random;
use crate::valve::Valve;
use serde::Serialize;
use std::collections::BTreeMap;

/// Effects of the catalogue in the order of its pages: name, smallest meaningful strength, and the
/// four levels at which cases are made. Two-sided effects get a random sign.
pub const NAMES: [(&str, f64, [f64; 4]); 16] = [
    ("atrial_kick", 2.0, [3.0, 6.0, 10.0, 15.0]),
    ("mitral_regurgitation", 0.04, [0.06, 0.12, 0.2, 0.32]),
    ("aortic_regurgitation", 0.02, [0.04, 0.08, 0.14, 0.24]),
    ("aortic_stenosis", 2e-5, [8e-5, 1.5e-4, 2.5e-4, 4e-4]),
    ("wave_reflection", 0.003, [0.005, 0.009, 0.014, 0.02]),
    ("delayed_relaxation", 20.0, [26.0, 35.0, 48.0, 65.0]),
    ("passive_stiffening", 0.5, [0.75, 1.3, 2.2, 3.5]),
    ("ventricular_septal_defect", 0.04, [0.06, 0.12, 0.2, 0.32]),
    ("pericardial_constraint", 2.0, [3.0, 5.0, 7.5, 10.0]),
    ("dyssynchrony", 20.0, [28.0, 45.0, 70.0, 100.0]),
    ("viscoelasticity", 0.003, [0.006, 0.011, 0.018, 0.03]),
    ("cross_fibre_stress", 0.1, [0.15, 0.2, 0.3, 0.4]),
    ("catheter_response", 33.0, [45.0, 60.0, 80.0, 105.0]),
    ("pv_misalignment", 8.0, [12.0, 20.0, 32.0, 48.0]),
    ("pressure_offset", 2.0, [3.0, 5.5, 9.0, 14.0]),
    ("volume_scaling", 0.04, [0.06, 0.1, 0.17, 0.26]),
];

/// Effects that pressure and volume of one ventricle show hardly or not at all.
pub const HARD: [&str; 3] = [
    "cross_fibre_stress",
    "wave_reflection",
    "pericardial_constraint",
];

/// Gaps outside the catalogue.
pub const OFF_CATALOGUE: [&str; 3] = [
    "shortening_deactivation",
    "septal_interaction",
    "after_contraction",
];

/// A hidden effect with its values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hidden {
    /// Name in the catalogue, or of a gap outside it.
    pub effect: &'static str,
    /// Strength in multiples of the smallest meaningful one; 0 outside the catalogue.
    pub strength: f64,
    /// Values of the effect's parameters in terms of this heart.
    pub physical: BTreeMap<&'static str, f64>,
}

/// Instruments between the heart and the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instruments {
    /// Catheter: natural period \[ms\], damping, lag \[ms\].
    pub catheter: Option<(f64, f64, f64)>,
    /// Delay of the volume \[ms\].
    pub volume_delay_ms: f64,
    /// Offset of the pressure \[mmHg\].
    pub offset_mmhg: f64,
    /// Factor of the volume.
    pub volume_factor: f64,
}

impl Default for Instruments {
    fn default() -> Self {
        Self {
            catheter: None,
            volume_delay_ms: 0.0,
            offset_mmhg: 0.0,
            volume_factor: 1.0,
        }
    }
}

/// Draws an effect at a level of [`NAMES`] (0 to 3), with its strength spread by 15 % and its other
/// values random.
///
/// # Panics
/// If the name is neither in the catalogue nor in [`OFF_CATALOGUE`].
#[must_use]
pub fn draw(name: &str, level: usize, random: &mut Random) -> Hidden {
    if let Some(effect) = OFF_CATALOGUE.into_iter().find(|n| *n == name) {
        let k = 0.7 + 0.3 * level as f64;
        let physical = match effect {
            "shortening_deactivation" => [
                ("per_mL", 0.006 * k),
                ("time_constant_s", random.between(0.08, 0.16)),
            ]
            .into(),
            "septal_interaction" => [("septal_share", 0.35 * k)].into(),
            _ => [
                ("height", 0.06 * k),
                ("after_fall_ms", random.between(60.0, 110.0)),
            ]
            .into(),
        };
        return Hidden {
            effect,
            strength: 0.0,
            physical,
        };
    }
    let (effect, smallest, levels) = NAMES
        .into_iter()
        .find(|(n, ..)| *n == name)
        .unwrap_or_else(|| panic!("there is no effect {name}"));
    let size = levels[level] * random.log_between(0.87, 1.15);
    let sign = random.sign();
    let physical: BTreeMap<&'static str, f64> = match effect {
        "atrial_kick" => [
            ("amplitude_mmHg", size),
            ("lead_ms", random.between(120.0, 185.0)),
            ("duration_ms", random.between(110.0, 160.0)),
        ]
        .into(),
        "mitral_regurgitation" | "aortic_regurgitation" | "ventricular_septal_defect" => {
            [("orifice_cm2", size)].into()
        }
        "aortic_stenosis" => [("loss_mmHg_s2_per_mL2", size)].into(),
        "wave_reflection" => [
            ("inertance_mmHg_s2_per_mL", size),
            ("proximal_share", random.between(0.15, 0.55)),
            ("resistance_mmHg_s_per_mL", random.between(0.01, 0.08)),
        ]
        .into(),
        "delayed_relaxation" => [("tau_ms", size)].into(),
        "passive_stiffening" => [("exponent_factor", 1.0 + size)].into(),
        "pericardial_constraint" => [
            ("pressure_mmHg", size),
            ("volume_scale", random.between(0.08, 0.4)),
        ]
        .into(),
        "dyssynchrony" => [
            ("delay_ms", size),
            ("late_share", random.between(0.25, 0.55)),
        ]
        .into(),
        "viscoelasticity" => [
            ("viscosity_mmHg_s_per_mL", size),
            ("relaxation_time_ms", random.between(5.0, 12.0)),
        ]
        .into(),
        "cross_fibre_stress" => [("cross_fibre_share", size)].into(),
        "catheter_response" => [
            ("natural_period_ms", size),
            ("damping", random.log_between(0.15, 0.9)),
            ("lag_ms", random.between(0.0, 6.0)),
        ]
        .into(),
        "pv_misalignment" => [("volume_delay_ms", sign * size)].into(),
        "pressure_offset" => [("offset_mmHg", sign * size)].into(),
        _ => [("volume_factor", 1.0 + sign * size)].into(),
    };
    Hidden {
        effect,
        strength: size / smallest,
        physical,
    }
}

impl Hidden {
    fn value(&self, key: &str) -> f64 {
        self.physical[key]
    }

    /// Adds an artefact to the instruments; an effect of the heart changes none of them.
    pub fn add_to(&self, instruments: &mut Instruments) {
        match self.effect {
            "catheter_response" => {
                let [period, damping, lag] =
                    ["natural_period_ms", "damping", "lag_ms"].map(|key| self.value(key));
                instruments.catheter = Some((period, damping, lag));
            }
            "pv_misalignment" => instruments.volume_delay_ms = self.value("volume_delay_ms"),
            "pressure_offset" => instruments.offset_mmhg = self.value("offset_mmHg"),
            "volume_scaling" => instruments.volume_factor = self.value("volume_factor"),
            _ => {}
        }
    }

    /// Adds the effect to a heart and its instruments.
    pub fn add(&self, heart: &mut Heart, instruments: &mut Instruments) {
        let reference_ml = heart.left.reference_ml;
        match self.effect {
            "atrial_kick" => {
                // Amplitude at the mean volume of the atrium. The actual amplitude is smaller,
                // because the atrium ejects blood in both directions.
                let duration = self.value("duration_ms");
                heart.atrial_contraction = Some(AtrialContraction {
                    elastance: self.value("amplitude_mmHg")
                        / (heart.atrial_compliance * heart.wanted.0),
                    lead_ms: self.value("lead_ms") - 0.5 * duration,
                    width_ms: 0.3 * duration,
                });
            }
            "mitral_regurgitation" => heart.mitral.leak_cm2 = self.value("orifice_cm2"),
            "aortic_regurgitation" => heart.aortic.leak_cm2 = self.value("orifice_cm2"),
            "ventricular_septal_defect" => heart.septal_defect_cm2 = self.value("orifice_cm2"),
            "aortic_stenosis" => {
                heart.aortic.open_cm2 = Valve::area_of_loss(self.value("loss_mmHg_s2_per_mL2"))
            }
            "wave_reflection" => {
                let total = heart.arterial_compliance.0 + heart.arterial_compliance.1;
                let share = self.value("proximal_share");
                heart.arterial_compliance = (share * total, (1.0 - share) * total);
                // The resistance between the two compartments moves in front of them, so that the
                // characteristic resistance does not change.
                heart.root_resistance += heart.arterial_link.0;
                heart.aortic.resistance += heart.arterial_link.0;
                heart.arterial_link = (
                    self.value("resistance_mmHg_s_per_mL"),
                    self.value("inertance_mmHg_s2_per_mL"),
                );
            }
            "delayed_relaxation" => heart.left.course.relaxation_ms = self.value("tau_ms"),
            "passive_stiffening" => {
                heart.left.passive_exponent *= self.value("exponent_factor");
                if let Some(wall) = &mut heart.left.sarcomeres {
                    wall.passive_exponent *= self.value("exponent_factor");
                }
            }
            "pericardial_constraint" => {
                let atrium_ml = heart.atrial_compliance * heart.wanted.0;
                heart.pericardium = Some(Pericardium {
                    pressure_mmhg: self.value("pressure_mmHg"),
                    volume_ml: 2.0 * reference_ml + atrium_ml,
                    scale_ml: 2.0 * reference_ml * self.value("volume_scale"),
                });
            }
            "dyssynchrony" => {
                heart.left.course.late = Some((self.value("late_share"), self.value("delay_ms")))
            }
            "viscoelasticity" => {
                let tau_s = 1e-3 * self.value("relaxation_time_ms");
                heart.left.maxwell = Some((self.value("viscosity_mmHg_s_per_mL") / tau_s, tau_s));
            }
            // An elastance has no directions: stress across the fibre acts as more pressure at the
            // same activation.
            "cross_fibre_stress" => heart.strengthen(1.0 + self.value("cross_fibre_share")),
            "catheter_response" | "pv_misalignment" | "pressure_offset" | "volume_scaling" => {
                self.add_to(instruments);
            }
            "shortening_deactivation" => {
                heart.left.deactivation =
                    Some((self.value("per_mL"), self.value("time_constant_s")));
                heart.strengthen(1.0 + 50.0 * self.value("per_mL"));
            }
            "septal_interaction" => heart.left.septal_share = self.value("septal_share"),
            _ => {
                let at = heart.left.twitch.half_fall_ms() + self.value("after_fall_ms");
                let course = Course {
                    after_contraction: Some((self.value("height"), at, 25.0)),
                    ..Course::default()
                };
                heart.left.course = course;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::circulation::Beat;
    use crate::measure::instruments_on;
    use crate::patient;

    fn rms(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    fn traces(heart: &Heart, instruments: &Instruments) -> (Beat, Vec<f64>, Vec<f64>) {
        let beat = heart.beat().expect("a steady beat");
        let (p, v) = instruments_on(&beat, instruments);
        (beat, p, v)
    }

    #[test]
    fn every_effect_moves_the_traces_and_more_of_it_moves_them_more() {
        for heart in [patient::draw, patient::draw_sarcomeres] {
            let plain = heart(&mut Random::new(3, 0));
            let (_, p0, v0) = traces(&plain, &Instruments::default());
            for name in NAMES
                .map(|(name, ..)| name)
                .into_iter()
                .chain(OFF_CATALOGUE)
            {
                let moved = [0, 3].map(|level| {
                    let (mut heart, mut instruments) = (plain.clone(), Instruments::default());
                    draw(name, level, &mut Random::new(5, 1)).add(&mut heart, &mut instruments);
                    let (_, p, v) = traces(&heart, &instruments);
                    rms(&p, &p0) + rms(&v, &v0)
                });
                assert!(
                    moved[0] > 0.02 && moved[1] > 1.1 * moved[0],
                    "{name}: {moved:?}"
                );
            }
        }
    }

    #[test]
    fn leaks_lose_what_their_orifice_says() {
        let mut heart = patient::draw(&mut Random::new(3, 0));
        draw("mitral_regurgitation", 2, &mut Random::new(5, 1))
            .add(&mut heart, &mut Instruments::default());
        let area = heart.mitral.leak_cm2;
        let beat = heart.beat().expect("a steady beat");
        let lost: f64 = beat.mitral_flow.iter().map(|q| (-q).max(0.0) * 1e-3).sum();
        let by_orifice: f64 = (beat.pressure.iter().zip(&beat.atrial_pressure))
            .map(|(l, a)| 50.0 * area * (l - a).max(0.0).sqrt() * 1e-3)
            .sum();
        assert!((lost / by_orifice - 1.0).abs() < 0.2, "{lost} {by_orifice}");
        let swing = |v: &[f64]| {
            v.iter().copied().fold(f64::MIN, f64::max) - v.iter().copied().fold(f64::MAX, f64::min)
        };
        assert!((swing(&beat.volume) - beat.forward_ml - lost).abs() < 4.0);
    }
}
