//! Random hearts within physiological ranges.

use crate::activation::{Course, Twitch};
use crate::circulation::{Beat, Heart, LeftVentricle};
use crate::random::Random;
use crate::sarcomere::Sarcomeres;
use crate::valve::Valve;

/// Kinds of hearts that cases are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hearts {
    /// Patients whose left ventricle is a time-varying elastance.
    Elastance,
    /// Patients whose left ventricle has sarcomeres in a spherical wall.
    Sarcomeres,
    /// Elastances far beyond the range of patients.
    Extreme,
}

impl Hearts {
    /// Draws a heart of this kind.
    #[must_use]
    pub fn draw(self, random: &mut Random) -> Heart {
        match self {
            Self::Elastance => draw(random),
            Self::Sarcomeres => draw_sarcomeres(random),
            Self::Extreme => draw_extreme(random),
        }
    }

    /// Reason why a beat of such a heart makes no case; `None` if it does.
    #[must_use]
    pub fn refused(self, beat: &Beat) -> Option<String> {
        match self {
            Self::Elastance | Self::Sarcomeres => implausible(beat),
            Self::Extreme => refused(beat),
        }
    }
}

/// Draws a heart without missing effects: no effect of the catalogue reaches its smallest
/// meaningful strength.
#[must_use]
pub fn draw(random: &mut Random) -> Heart {
    let cycle_ms = random.between(620.0, 1180.0).round();
    // With a higher heart rate, systole shortens less than diastole (Bazett).
    let systole = (cycle_ms / 850.0).sqrt();
    let reference_ml = random.between(105.0, 185.0);
    let atrium = random.between(7.0, 14.0);
    let compliance = random.log_between(0.9, 2.4);
    let root = random.between(0.03, 0.1);
    let wanted = (atrium, random.between(80.0, 106.0));
    let rise = (
        random.between(100.0, 170.0) * systole,
        random.between(1.3, 2.0),
    );
    let fall_ms = random.between(110.0, 165.0);
    let middle_ms = random.between(325.0, 385.0) * systole;
    let fall = (
        middle_ms - 0.5 * fall_ms,
        fall_ms,
        random.between(0.6, 0.95),
    );
    let unloaded_share = random.between(0.28, 0.45);
    let passive_power = random.between(1.8, 3.0);
    let left = LeftVentricle {
        reference_ml,
        peak_mmhg: random.between(190.0, 290.0),
        dead_share: random.between(-0.1, 0.12),
        curve_share: random.between(1.4, 2.6),
        rate_loss: random.between(4e-4, 9e-4),
        deactivation: None,
        passive_mmhg: atrium * random.between(0.85, 1.15),
        unloaded_share,
        passive_exponent: passive_power / (1.0 - unloaded_share),
        maxwell: None,
        septal_share: 0.0,
        twitch: Twitch::new(rise, fall),
        course: Course::default(),
        sarcomeres: None,
    };
    let valve = |open_cm2: f64, resistance: f64| Valve {
        open_cm2,
        leak_cm2: 0.0,
        length_cm: 1.5,
        resistance,
        opening: 80.0,
        closing: 120.0,
    };
    let root_resistance = random.between(0.005, 0.02);
    Heart {
        cycle_ms: cycle_ms as usize,
        onset_ms: random.between(8.0, 40.0),
        left,
        right: (random.between(0.5, 0.8), random.between(0.03, 0.06)),
        atrial_compliance: random.between(18.0, 30.0),
        atrial_contraction: None,
        pericardium: None,
        mitral: valve(random.between(5.0, 7.5), random.between(0.006, 0.018)),
        aortic: valve(
            random.between(5.6, 7.5),
            root_resistance + random.between(0.002, 0.006),
        ),
        tricuspid: valve(8.0, 0.005),
        pulmonary: valve(7.0, 0.005),
        septal_defect_cm2: 0.0,
        root_resistance,
        arterial_compliance: (root * compliance, (1.0 - root) * compliance),
        arterial_link: (random.between(0.03, 0.06), random.between(2e-4, 1e-3)),
        peripheral_resistance: 1.0,
        venous_compliance: 60.0,
        lung_compliance: (5.0, random.between(15.0, 25.0)),
        lung_resistance: (0.07, random.between(0.03, 0.05)),
        wanted,
    }
}

/// Draws a heart without missing effects whose left ventricle has sarcomeres in a spherical wall;
/// circulation, atrium and right ventricle are those of [`draw`].
#[must_use]
pub fn draw_sarcomeres(random: &mut Random) -> Heart {
    let mut heart = draw(random);
    let systole = (heart.cycle_ms as f64 / 850.0).sqrt();
    let reference_ml = heart.left.reference_ml;
    let unloaded_stretch = random.between(0.8, 0.88);
    heart.left.sarcomeres = Some(Sarcomeres {
        wall_ml: reference_ml * random.between(0.7, 1.0),
        reference_ml,
        length_um: random.between(2.08, 2.25),
        active_kpa: random.between(110.0, 180.0),
        passive_mmhg: heart.left.passive_mmhg,
        passive_exponent: random.between(7.0, 15.0),
        unloaded_stretch,
        // A slower decay is the catalogue's delayed relaxation.
        times_ms: (
            random.between(38.0, 55.0) * systole,
            random.between(12.0, 18.0),
        ),
        duration_ms: random.between(360.0, 440.0) * systole,
        velocity_um_per_s: random.between(6.0, 9.0),
    });
    heart
}

/// Draws a heart that no clinic may ever see: the properties of [`draw`], each far beyond the range
/// of patients.
#[must_use]
pub fn draw_extreme(random: &mut Random) -> Heart {
    let mut heart = draw(random);
    let mut times = |value: &mut f64, low: f64, high: f64| *value *= random.log_between(low, high);
    let mut cycle = heart.cycle_ms as f64;
    times(&mut cycle, 0.75, 1.4);
    heart.cycle_ms = cycle.round() as usize;
    times(&mut heart.left.reference_ml, 0.3, 2.5);
    times(&mut heart.left.peak_mmhg, 0.4, 1.8);
    times(&mut heart.left.rate_loss, 0.2, 4.0);
    times(&mut heart.left.passive_mmhg, 0.4, 2.5);
    times(&mut heart.left.passive_exponent, 0.5, 2.0);
    times(&mut heart.atrial_compliance, 0.4, 2.5);
    times(&mut heart.mitral.resistance, 0.3, 5.0);
    times(&mut heart.aortic.resistance, 0.3, 5.0);
    times(&mut heart.arterial_compliance.0, 0.3, 3.0);
    times(&mut heart.arterial_compliance.1, 0.3, 3.0);
    times(&mut heart.wanted.0, 0.3, 2.5);
    times(&mut heart.wanted.1, 0.6, 1.5);
    heart
}

fn range(values: &[f64]) -> (f64, f64) {
    values
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)))
}

/// The first of some values that is outside of its bounds, in words.
fn outside<const N: usize>(checks: [(&str, f64, f64, f64); N]) -> Option<String> {
    checks
        .iter()
        .find(|(_, value, low, high)| !(low..=high).contains(&value))
        .map(|(name, value, low, high)| format!("{name} is {value:.2}, not {low} to {high}"))
}

/// Reason why a beat is not measured at all: the program's own checks refuse its traces.
#[must_use]
pub fn refused(beat: &Beat) -> Option<String> {
    let (least, peak) = range(&beat.pressure);
    let (end_systolic, end_diastolic) = range(&beat.volume);
    let ejected = 1.0 - end_systolic / end_diastolic;
    outside([
        ("peak pressure", peak, 60.0, 330.0),
        ("least pressure over the peak", least / peak, -0.1, 0.3),
        ("end-diastolic volume", end_diastolic, 6.0, 800.0),
        ("ejection fraction", ejected, 0.08, 0.88),
    ])
}

/// Reason why a beat cannot be that of a patient; `None` if it is plausible.
#[must_use]
pub fn implausible(beat: &Beat) -> Option<String> {
    let (least_p, peak) = range(&beat.pressure);
    let (end_systolic, end_diastolic) = range(&beat.volume);
    let slope = beat
        .pressure
        .windows(2)
        .map(|w| w[1] - w[0])
        .fold(0.0, f64::max);
    let pulse = range(&beat.aortic_pressure);
    let ejected = 1.0 - end_systolic / end_diastolic;
    outside([
        ("peak pressure", peak, 90.0, 230.0),
        ("least pressure", least_p, -4.0, 18.0),
        ("pressure at time zero", beat.pressure[0], 2.0, 28.0),
        ("largest dP/dt in mmHg/ms", slope, 0.9, 4.0),
        ("end-diastolic volume", end_diastolic, 85.0, 230.0),
        ("stroke volume", end_diastolic - end_systolic, 42.0, 135.0),
        ("net forward volume", beat.forward_ml, 30.0, 120.0),
        ("ejection fraction", ejected, 0.32, 0.78),
        ("pulse pressure", pulse.1 - pulse.0, 22.0, 95.0),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn most_hearts_are_patients_and_their_blood_goes_round() {
        for draw in [draw, draw_sarcomeres] {
            let mut n_good = 0;
            let mut reasons = Vec::new();
            for seed in 0..12 {
                let heart = draw(&mut Random::new(seed, 0));
                let Some(beat) = heart.beat() else { continue };
                let ejected = beat.forward_ml;
                let filled = beat.mitral_flow.iter().sum::<f64>() * 1e-3;
                assert!((filled - ejected).abs() < 0.5, "{filled} {ejected}");
                let reason = implausible(&beat);
                n_good += usize::from(reason.is_none());
                reasons.extend(reason);
            }
            assert!(n_good >= 6, "{n_good} of 12: {reasons:?}");
        }
    }
}
