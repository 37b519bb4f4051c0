//! Measurements besides pressure and volume of one beat: further traces, times of valves, the width
//! of QRS, and a beat under a lower load.
//!
//! They have random numbers of their own, so that a case is the same with and without them.

use crate::circulation::{Beat, Heart};
use crate::hidden::Instruments;
use crate::measure::{Case, at, instruments_on};
use crate::plan::PlannedCase;
use crate::random::Random;

/// A kind of measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Measurement {
    /// Pressure of the aortic root by a catheter of its own.
    AorticPressure,
    /// Flow through the aortic valve by flow MRI.
    AorticFlow,
    /// Flow through the mitral valve by flow MRI.
    MitralFlow,
    /// Pressure of the left atrium by a catheter.
    AtrialPressure,
    /// Strain of the wall by speckle tracking.
    Strain,
    /// Times of the valves by echo.
    ValveTimes,
    /// Width of QRS.
    Qrs,
    /// A steady beat at a lower filling pressure.
    Loaded,
}

impl Measurement {
    /// All kinds with their names.
    pub const ALL: [(Self, &'static str); 8] = [
        (Self::AorticPressure, "aortic_pressure"),
        (Self::AorticFlow, "aortic_flow"),
        (Self::MitralFlow, "mitral_flow"),
        (Self::AtrialPressure, "atrial_pressure"),
        (Self::Strain, "strain"),
        (Self::ValveTimes, "valve_times"),
        (Self::Qrs, "qrs"),
        (Self::Loaded, "loaded"),
    ];

    /// Name of the kind.
    #[must_use]
    pub fn name(self) -> &'static str {
        let known = Self::ALL.iter().find(|(kind, _)| *kind == self);
        known.map_or("", |(_, name)| name)
    }

    /// Kind with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let known = Self::ALL.iter().find(|(_, known)| *known == name);
        known.map(|(kind, _)| *kind)
    }
}

/// A further trace with its stated noise.
#[derive(Debug, Clone, PartialEq)]
pub struct FurtherTrace {
    /// What was measured.
    pub kind: Measurement,
    /// Times of the samples \[ms\].
    pub time_ms: Vec<f64>,
    /// Values of the samples in mmHg, mL/s or %.
    pub value: Vec<f64>,
    /// Rms of the noise.
    pub rms: f64,
    /// Correlation time of the noise \[ms\].
    pub correlation_ms: f64,
}

/// Measured beat under a lower load.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedTraces {
    /// Pressure each millisecond \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Times of the frames \[ms\].
    pub frame_ms: Vec<f64>,
    /// Volume of each frame \[mL\].
    pub frame_ml: Vec<f64>,
}

/// Measurements besides those of a [`Case`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Further {
    /// Further traces.
    pub traces: Vec<FurtherTrace>,
    /// Opening and closure of the aortic, then of the mitral valve \[ms\], with one standard
    /// deviation.
    pub valve_times_ms: Option<([f64; 4], f64)>,
    /// Width of QRS with its standard deviation \[ms\].
    pub qrs_ms: Option<(f64, f64)>,
    /// A beat under a lower load.
    pub loaded: Option<LoadedTraces>,
}

/// Share of the filling pressure, and of the mean arterial pressure, that is left in the beat under a
/// lower load: a partial occlusion of the caval veins, with reflexes that hold the arterial pressure
/// up.
pub const LOWER: (f64, f64) = (0.55, 0.88);

impl Heart {
    /// The same heart with less venous return. The pressures come near their shares of [`LOWER`],
    /// since the loop adjusts filling and periphery to them.
    #[must_use]
    pub fn at_lower_load(&self) -> Self {
        let (atrium, arteries) = self.wanted;
        Self {
            wanted: (LOWER.0 * atrium, LOWER.1 * arteries),
            ..self.clone()
        }
    }
}

/// Beats of which further measurements are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Beats {
    /// The steady beat of the case.
    pub steady: Beat,
    /// The beat under a lower load, if it is wanted.
    pub lower: Option<Beat>,
    /// Artefacts of pressure and volume.
    pub instruments: Instruments,
    /// Delay of the late part of the wall \[ms\].
    pub late_ms: f64,
}

impl PlannedCase {
    /// The heart of a case with its instruments, as it was drawn.
    fn heart(&self, case: &Case) -> (Heart, Instruments) {
        let mut random = Random::new(self.seed(), 2 * case.n_refused as u64);
        let mut heart = self.hearts.draw(&mut random);
        let mut instruments = Instruments::default();
        for hidden in &case.hidden {
            hidden.add(&mut heart, &mut instruments);
        }
        (heart, instruments)
    }

    /// Beats of a case's heart; `None` if it does not settle under the lower load.
    #[must_use]
    pub fn beats(&self, case: &Case, wanted: &[Measurement]) -> Option<Beats> {
        let (heart, instruments) = self.heart(case);
        let lower = if wanted.contains(&Measurement::Loaded) {
            Some(heart.at_lower_load().beat()?)
        } else {
            None
        };
        Some(Beats {
            steady: heart.beat()?,
            lower,
            instruments,
            late_ms: heart.left.course.late.map_or(0.0, |(_, delay)| delay),
        })
    }

    /// Measures more of a case.
    ///
    /// - `beats`: of the case's heart
    #[must_use]
    pub fn further(&self, case: &Case, beats: &Beats, wanted: &[Measurement]) -> Further {
        let mut further = Further::default();
        for (kind, _) in Measurement::ALL {
            if !wanted.contains(&kind) {
                continue;
            }
            // The numbers of one kind do not depend on which others are wanted.
            let mut random = Random::new(self.seed(), 400_000 + kind as u64);
            match kind {
                Measurement::ValveTimes => {
                    let sd = 5.0;
                    let times = valve_times(&beats.steady);
                    let cycle = case.cycle_ms;
                    further.valve_times_ms = times
                        .map(|t| (t.map(|t| (t + sd * random.normal()).rem_euclid(cycle)), sd));
                }
                Measurement::Qrs => {
                    // Normal conduction takes 85 ms, more or less; the late part adds its delay.
                    let true_ms = random.between(73.0, 97.0) + beats.late_ms;
                    further.qrs_ms = Some((true_ms + 4.0 * random.normal(), 4.0));
                }
                Measurement::Loaded => {
                    further.loaded = (beats.lower.as_ref())
                        .map(|beat| loaded(beat, &beats.instruments, case, &mut random));
                }
                _ => further
                    .traces
                    .push(trace(kind, &beats.steady, case, self.noise, &mut random)),
            }
        }
        further
    }
}

impl Beat {
    /// A quantity each millisecond, without errors of measurement; empty for a kind that is no trace.
    ///
    /// - `wall_ml`: volume of the wall
    #[must_use]
    pub fn of(&self, kind: Measurement, wall_ml: f64) -> Vec<f64> {
        // The wall's middle is a sphere around cavity and half of the wall.
        let middle = |volume: &f64| (volume + 0.5 * wall_ml).cbrt();
        match kind {
            Measurement::AorticPressure => self.aortic_pressure.clone(),
            Measurement::AtrialPressure => self.atrial_pressure.clone(),
            Measurement::AorticFlow => self.aortic_flow.clone(),
            Measurement::MitralFlow => self.mitral_flow.clone(),
            Measurement::Strain => (self.volume.iter())
                .map(|v| 100.0 * (middle(v) / middle(&self.volume[0]) - 1.0))
                .collect(),
            Measurement::ValveTimes | Measurement::Qrs | Measurement::Loaded => Vec::new(),
        }
    }
}

/// Noise of a process with the given correlation from sample to sample.
fn coloured(n: usize, rms: f64, rho: f64, random: &mut Random) -> Vec<f64> {
    let mut state = random.normal();
    (0..n)
        .map(|_| {
            let value = rms * state;
            state = rho * state + (1.0 - rho * rho).sqrt() * random.normal();
            value
        })
        .collect()
}

/// A further trace of a beat with its noise, at `noise` times the usual level.
fn trace(
    kind: Measurement,
    beat: &Beat,
    case: &Case,
    noise: f64,
    random: &mut Random,
) -> FurtherTrace {
    let cycle = case.cycle_ms;
    let source = beat.of(kind, case.clean_side.wall_ml);
    let (usual_rms, factor_sd, offset_sd, frames) = match kind {
        Measurement::AorticPressure => (1.2, 0.0, 1.0, None),
        Measurement::AtrialPressure => (0.8, 0.0, 1.0, None),
        Measurement::AorticFlow => (12.0, 0.04, 0.0, Some((28.0, 40.0))),
        Measurement::MitralFlow => (15.0, 0.04, 0.0, Some((28.0, 40.0))),
        _ => (0.7, 0.15, 0.0, Some((40.0, 60.0))),
    };
    let rms = usual_rms * noise;
    let factor = 1.0 + factor_sd * random.normal();
    let offset = offset_sd * random.normal();
    let correlation_ms = random.between(8.0, 14.0);
    let n = match frames {
        None => cycle as usize,
        Some((low, high)) => random.between(low, high) as usize,
    };
    let step = cycle / n as f64;
    let time_ms: Vec<f64> = (0..n).map(|k| k as f64 * step).collect();
    let errors = coloured(n, rms, (-step / correlation_ms).exp(), random);
    let value = (time_ms.iter().zip(errors))
        .map(|(t, error)| factor * at(&source, *t) + offset + error)
        .collect();
    let mut off = |value: f64| value * (0.1 * random.normal()).exp();
    FurtherTrace {
        kind,
        time_ms,
        value,
        rms: off(rms),
        correlation_ms: off(correlation_ms),
    }
}

/// The traces of a beat under a lower load, with the case's noise.
fn loaded(
    beat: &Beat,
    instruments: &Instruments,
    case: &Case,
    random: &mut Random,
) -> LoadedTraces {
    let (pressure, volume) = instruments_on(beat, instruments);
    let stated = &case.stated;
    let rho = (-1.0 / stated.pressure_correlation_ms).exp();
    let errors = coloured(pressure.len(), stated.pressure_rms_mmhg, rho, random);
    let of_frames = coloured(case.frame_ms.len(), stated.volume_rms_ml, 0.2, random);
    LoadedTraces {
        pressure_mmhg: pressure.iter().zip(errors).map(|(p, e)| p + e).collect(),
        frame_ms: case.frame_ms.clone(),
        frame_ml: (case.frame_ms.iter().zip(of_frames))
            .map(|(t, e)| at(&volume, *t) + e)
            .collect(),
    }
}

/// Times at which the leaflets of aortic and mitral valve are half open: opening and closure of the
/// aortic, then of the mitral valve \[ms\]; `None` if a valve stays open or closed.
#[must_use]
pub fn valve_times(beat: &Beat) -> Option<[f64; 4]> {
    let n = beat.aortic_opening.len();
    let half = |v: &[f64], k: usize| v[k % n] >= 0.5;
    let (aortic, mitral) = (&beat.aortic_opening, &beat.mitral_opening);
    let rises = |v: &[f64], from: usize| (from..from + n).find(|k| !half(v, *k) && half(v, k + 1));
    let opening = rises(aortic, 0)?;
    let closure = (opening + 1..opening + n).find(|k| half(aortic, *k) && !half(aortic, k + 1))?;
    let filling = rises(mitral, closure.saturating_sub(40))?;
    let filled =
        (0..n).find(|k| half(mitral, opening + n - k) && !half(mitral, opening + n - k + 1))?;
    let within = |k: usize| (k % n) as f64 + 0.5;
    Some([
        within(opening),
        within(closure),
        within(filling),
        within(opening + n - filled),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Hearts, Plan};

    fn case() -> (PlannedCase, Case) {
        let planned = Plan::Singles.cases(1, 11, Hearts::Elastance).remove(0);
        let case = planned.make().expect("a plausible patient");
        (planned, case)
    }

    #[test]
    fn the_heart_is_that_of_the_case_and_kinds_do_not_disturb_one_another() {
        let (planned, case) = case();
        let all: Vec<Measurement> = Measurement::ALL.map(|(kind, _)| kind).to_vec();
        let beats = planned.beats(&case, &all).expect("both beats settle");
        let (pressure, _) = instruments_on(&beats.steady, &beats.instruments);
        assert_eq!(pressure, case.clean_pressure_mmhg);
        let whole = planned.further(&case, &beats, &all);
        let one = planned.further(&case, &beats, &[Measurement::MitralFlow]);
        assert_eq!(one.traces[0], whole.traces[2]);
        assert!(one.loaded.is_none() && one.qrs_ms.is_none());
        for (kind, name) in Measurement::ALL {
            assert_eq!(Measurement::named(name), Some(kind));
        }
    }

    #[test]
    fn valves_open_and_close_in_turn_and_less_blood_returns() {
        let (planned, case) = case();
        let beats = planned.beats(&case, &[Measurement::Loaded]).unwrap();
        let [opening, closure, filling, filled] = valve_times(&beats.steady).unwrap();
        let ordered = [filled, opening, closure, filling];
        assert!(ordered.windows(2).all(|w| w[0] < w[1]), "{ordered:?}");
        assert!((150.0..420.0).contains(&(closure - opening)), "{ordered:?}");
        let largest = |v: &[f64]| v.iter().copied().fold(f64::MIN, f64::max);
        let lower = beats.lower.unwrap();
        assert!(largest(&lower.volume) < 0.93 * largest(&beats.steady.volume));
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let ratio = mean(&lower.atrial_pressure) / mean(&beats.steady.atrial_pressure);
        assert!((ratio - LOWER.0).abs() < 0.03, "{ratio}");
    }
}
