//! Clinical measurement of a beat: noisy traces and scalars, with stated noise levels.

use crate::circulation::Beat;
use crate::hidden::{Hidden, Instruments};
use crate::patient::Hearts;
use crate::random::Random;

/// Noise levels stated in the patient file; each has an error of about 10 %.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// Rms of the pressure noise \[mmHg\].
    pub pressure_rms_mmhg: f64,
    /// Correlation time of the pressure noise \[ms\].
    pub pressure_correlation_ms: f64,
    /// Rms of the noise of a volume frame \[mL\].
    pub volume_rms_ml: f64,
}

/// Scalars measured besides the traces, each as value and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Systolic and diastolic cuff pressure \[mmHg\].
    pub cuff: (f64, f64),
    /// Standard deviation of both cuff pressures \[mmHg\].
    pub cuff_sd: f64,
    /// Net forward volume of the aorta \[mL\].
    pub forward: (f64, f64),
    /// Volume of a whole-heart image \[mL\].
    pub whole_heart: (f64, f64),
    /// Time of the whole-heart image \[ms\].
    pub whole_heart_ms: f64,
    /// Volume of the wall \[mL\], 5 % uncertain.
    pub wall_ml: f64,
}

/// One test patient with its measured data.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Length of the cardiac cycle \[ms\].
    pub cycle_ms: f64,
    /// Measured pressure each millisecond \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Times of the frames \[ms\].
    pub frame_ms: Vec<f64>,
    /// Measured volume of each frame \[mL\].
    pub frame_ml: Vec<f64>,
    /// Pressure without noise each millisecond \[mmHg\], for judging the visibility of an effect.
    pub clean_pressure_mmhg: Vec<f64>,
    /// Volume of each frame without noise \[mL\].
    pub clean_frame_ml: Vec<f64>,
    /// Noise levels stated in the patient file.
    pub stated: Stated,
    /// Scalars measured besides the traces, with their noise.
    pub side: Side,
    /// The scalars without noise.
    pub clean_side: Side,
    /// Hidden effects of the case.
    pub hidden: Vec<Hidden>,
    /// Number of implausible hearts that were drawn before this one.
    pub n_refused: usize,
}

/// Number of hearts drawn before an effect is given up.
const TRIES: u64 = 60;

/// Pressure and volume traces after the instruments: a second-order catheter and an offset for the
/// pressure, delay and scaling for the volume.
#[must_use]
pub fn instruments_on(beat: &Beat, instruments: &Instruments) -> (Vec<f64>, Vec<f64>) {
    let n = beat.pressure.len();
    let mut pressure = beat.pressure.clone();
    if let Some((period, damping, lag)) = instruments.catheter {
        // Small steps over the lagged trace reach the periodic steady state after three beats.
        let w = std::f64::consts::TAU / period;
        let (mut y, mut slope) = (beat.pressure[0], 0.0);
        const STEPS: usize = 20;
        let dt = 1.0 / STEPS as f64;
        for k in 0..3 * n {
            pressure[k % n] = y;
            for j in 0..STEPS {
                let forced = at(&beat.pressure, (k % n) as f64 + j as f64 * dt - lag);
                slope += dt * (w * w * (forced - y) - 2.0 * damping * w * slope);
                y += dt * slope;
            }
        }
    }
    pressure
        .iter_mut()
        .for_each(|p| *p += instruments.offset_mmhg);
    let delay = instruments.volume_delay_ms;
    let volume = (0..n)
        .map(|i| instruments.volume_factor * at(&beat.volume, i as f64 - delay))
        .collect();
    (pressure, volume)
}

/// A periodic trace with samples each 1 ms, at any time.
pub(crate) fn at(trace: &[f64], t_ms: f64) -> f64 {
    let n = trace.len();
    let t = t_ms.rem_euclid(n as f64);
    let (i, f) = (t.floor() as usize % n, t.fract());
    trace[i] * (1.0 - f) + trace[(i + 1) % n] * f
}

impl Case {
    /// The case of a seed: a random patient of these hearts with these effects (name and level), and noise at
    /// `noise` times the usual level. `None` if no plausible patient with these effects was drawn.
    #[must_use]
    pub fn draw(hearts: Hearts, seed: u64, effects: &[(&str, usize)], noise: f64) -> Option<Self> {
        for attempt in 0..TRIES {
            let mut random = Random::new(seed, 2 * attempt);
            let mut heart = hearts.draw(&mut random);
            let mut instruments = Instruments::default();
            let hidden: Vec<Hidden> = effects
                .iter()
                .map(|(name, level)| crate::hidden::draw(name, *level, &mut random))
                .collect();
            hidden
                .iter()
                .for_each(|h| h.add(&mut heart, &mut instruments));
            if let Some(beat) = heart.beat().filter(|beat| hearts.refused(beat).is_none()) {
                let mut random = Random::new(seed, 2 * attempt + 1);
                let drawn_ml = heart.left.reference_ml * random.between(0.7, 1.0);
                let wall_ml = heart.left.sarcomeres.map_or(drawn_ml, |wall| wall.wall_ml);
                let traces = instruments_on(&beat, &instruments);
                let case = Self::observe(&beat, traces, wall_ml, noise, &mut random);
                return Some(Self {
                    hidden,
                    n_refused: attempt as usize,
                    ..case
                });
            }
        }
        None
    }
}

impl Case {
    /// Measures a beat from its traces after the instruments: frames, noise and scalars are added.
    /// The case has no hidden effects.
    #[must_use]
    pub fn observe(
        beat: &Beat,
        traces: (Vec<f64>, Vec<f64>),
        wall_ml: f64,
        noise: f64,
        random: &mut Random,
    ) -> Self {
        let (pressure, volume) = traces;
        let cycle_ms = pressure.len() as f64;
        let rms = noise * random.between(1.0, 1.5);
        let tau = random.between(8.0, 14.0);
        let volume_rms = noise * random.between(2.0, 3.0);
        let n_frames = random.between(25.0, 40.99) as usize;
        let frame_ms: Vec<f64> = (0..n_frames)
            .map(|k| k as f64 * cycle_ms / n_frames as f64)
            .collect();
        let clean_frame_ml: Vec<f64> = frame_ms.iter().map(|t| at(&volume, *t)).collect();
        let rho = (-1.0 / tau).exp();
        let mut state = random.normal();
        let noisy: Vec<f64> = pressure
            .iter()
            .map(|p| {
                let value = p + rms * state;
                state = rho * state + (1.0 - rho * rho).sqrt() * random.normal();
                value
            })
            .collect();
        // A moving average of neighbours gives a correlation of 0.2 (share a/(1 + a²) with a =
        // 0.209).
        let draws: Vec<f64> = (0..n_frames).map(|_| random.normal()).collect();
        let a = 0.209f64;
        let frame_ml = (0..n_frames)
            .map(|k| {
                let unit = (draws[k] + a * draws[(k + 1) % n_frames]) / (1.0 + a * a).sqrt();
                clean_frame_ml[k] + volume_rms * unit
            })
            .collect();
        let mut off = |value: f64| value * (0.1 * random.normal()).exp();
        let stated = Stated {
            pressure_rms_mmhg: off(rms),
            pressure_correlation_ms: off(tau),
            volume_rms_ml: off(volume_rms),
        };
        let range = |v: &[f64]| {
            v.iter()
                .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)))
        };
        let (diastolic, systolic) = range(&beat.aortic_pressure);
        let whole_heart_ms = (random.between(0.65, 0.82) * cycle_ms).round();
        let clean_side = Side {
            cuff: (systolic, diastolic),
            cuff_sd: 4.0,
            forward: (beat.forward_ml, 0.07 * beat.forward_ml),
            whole_heart: (at(&beat.volume, whole_heart_ms), 4.0),
            whole_heart_ms,
            wall_ml,
        };
        let (forward, forward_sd) = clean_side.forward;
        let side = Side {
            cuff: (
                systolic + 4.0 * random.normal(),
                diastolic + 4.0 * random.normal(),
            ),
            forward: (forward + forward_sd * random.normal(), forward_sd),
            whole_heart: (clean_side.whole_heart.0 + 4.0 * random.normal(), 4.0),
            wall_ml: clean_side.wall_ml * (1.0 + 0.05 * random.normal()),
            ..clean_side
        };
        Self {
            cycle_ms,
            pressure_mmhg: noisy,
            frame_ms,
            frame_ml,
            clean_pressure_mmhg: pressure,
            clean_frame_ml,
            stated,
            side,
            clean_side,
            hidden: Vec::new(),
            n_refused: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_is_the_same_for_the_same_seed_and_noise_is_as_stated() {
        let a = Case::draw(Hearts::Elastance, 11, &[], 1.0).unwrap();
        assert_eq!(a, Case::draw(Hearts::Elastance, 11, &[], 1.0).unwrap());
        assert_ne!(
            a.frame_ml,
            Case::draw(Hearts::Elastance, 12, &[], 1.0)
                .unwrap()
                .frame_ml
        );
        let rms = |x: &[f64], y: &[f64]| {
            (x.iter().zip(y).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
        };
        let mut ratios = (0.0, 0.0);
        for seed in 20..28 {
            let case = Case::draw(Hearts::Elastance, seed, &[], 1.0).unwrap();
            ratios.0 += rms(&case.pressure_mmhg, &case.clean_pressure_mmhg)
                / case.stated.pressure_rms_mmhg
                / 8.0;
            ratios.1 += rms(&case.frame_ml, &case.clean_frame_ml) / case.stated.volume_rms_ml / 8.0;
        }
        assert!(
            (ratios.0 - 1.0).abs() < 0.2 && (ratios.1 - 1.0).abs() < 0.2,
            "{ratios:?}"
        );
    }

    #[test]
    fn instruments_do_what_they_say() {
        let beat = Beat {
            pressure: (0..800)
                .map(|t| 60.0 + 50.0 * (std::f64::consts::TAU * f64::from(t) / 800.0).sin())
                .collect(),
            volume: (0..800).map(|t| 100.0 + f64::from(t % 400)).collect(),
            ..Beat::default()
        };
        let instruments = Instruments {
            catheter: Some((10.0, 0.7, 4.0)),
            volume_delay_ms: 20.0,
            offset_mmhg: 3.0,
            volume_factor: 1.1,
        };
        let (p, v) = instruments_on(&beat, &instruments);
        // A fast catheter only delays the trace, by the lag and 2 ζ/ω.
        let delay = 4.0 + 2.0 * 0.7 * 10.0 / std::f64::consts::TAU;
        assert!((p[300] - 3.0 - at(&beat.pressure, 300.0 - delay)).abs() < 0.1);
        assert!((v[120] - 1.1 * 200.0).abs() < 1e-9);
    }
}
