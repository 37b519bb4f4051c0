//! A heart whose elastance is known: time-varying elastance between an atrium of constant pressure and a Windkessel.
//!
//! P = E(t) (V − V0) − R Q, with E(t) of Stergiopulos et al. 1996, Am J Physiol 270:H2050: two Hill functions.

use super::beat::Beat;
use crate::{Continuation, Quantity, Trace};
use cardiotwin_units::Ms;

/// Cycle length \[ms\].
pub(super) const CYCLE_MS: f64 = 800.0;
const STEPS_PER_MS: usize = 10;
const N_BEATS: usize = 12;

/// Parameters of the heart and its loads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Heart {
    /// Largest elastance Ees \[mmHg/mL\].
    pub(super) elastance_mmhg_per_ml: f64,
    /// Diastolic elastance \[mmHg/mL\].
    pub(super) diastolic_mmhg_per_ml: f64,
    /// Intercept V0 \[mL\].
    pub(super) intercept_ml: f64,
    /// Internal resistance R \[mmHg s/mL\].
    pub(super) internal_mmhg_s_per_ml: f64,
    /// Time of the largest elastance, about \[ms\].
    pub(super) peak_ms: f64,
    /// Pressure of the atrium \[mmHg\].
    pub(super) filling_mmhg: f64,
    /// Peripheral resistance \[mmHg s/mL\].
    pub(super) peripheral_mmhg_s_per_ml: f64,
    /// Arterial compliance \[mL/mmHg\].
    pub(super) compliance_ml_per_mmhg: f64,
}

impl Default for Heart {
    fn default() -> Self {
        Self {
            elastance_mmhg_per_ml: 2.3,
            diastolic_mmhg_per_ml: 0.08,
            intercept_ml: 12.0,
            internal_mmhg_s_per_ml: 0.0,
            peak_ms: 300.0,
            filling_mmhg: 9.0,
            peripheral_mmhg_s_per_ml: 1.1,
            compliance_ml_per_mmhg: 1.3,
        }
    }
}

/// Arterial pressures of the last beat \[mmHg\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Arterial {
    pub(super) systolic_mmhg: f64,
    pub(super) diastolic_mmhg: f64,
}

impl Heart {
    /// Normalised elastance, 0 to 1.
    fn activation(&self, time_ms: f64) -> f64 {
        let rise = (time_ms / (0.708 * self.peak_ms)).powf(1.32);
        let fall = (time_ms / (1.187 * self.peak_ms)).powf(21.9);
        rise / (1.0 + rise) / (1.0 + fall)
    }

    /// Elastance in a cycle, every step \[mmHg/mL\].
    fn elastance(&self) -> Vec<f64> {
        let n = CYCLE_MS as usize * STEPS_PER_MS;
        let shape: Vec<f64> = (0..n)
            .map(|k| self.activation(k as f64 / STEPS_PER_MS as f64))
            .collect();
        let most = shape.iter().copied().fold(0.0, f64::max);
        let range = self.elastance_mmhg_per_ml - self.diastolic_mmhg_per_ml;
        shape
            .iter()
            .map(|e| self.diastolic_mmhg_per_ml + range * e / most)
            .collect()
    }

    /// Time of the largest elastance \[ms\].
    pub(super) fn stiffest_ms(&self) -> f64 {
        let elastance = self.elastance();
        let stiffest = (0..elastance.len()).fold(0, |best, k| {
            if elastance[k] > elastance[best] {
                k
            } else {
                best
            }
        });
        stiffest as f64 / STEPS_PER_MS as f64
    }

    /// Pressure and volume of the last of many beats, every millisecond from the onset of activation.
    pub(super) fn traces(&self) -> (Trace, Trace) {
        let (pressure, volume, _) = self.run();
        (pressure, volume)
    }

    /// Its beat.
    pub(super) fn beat(&self) -> Beat {
        let (pressure, volume, _) = self.run();
        Beat::of(&pressure, &volume, Continuation::periodic(Ms(CYCLE_MS))).unwrap()
    }

    /// Its arterial pressures.
    pub(super) fn arterial(&self) -> Arterial {
        self.run().2
    }

    fn run(&self) -> (Trace, Trace, Arterial) {
        let (mitral, aortic, characteristic) = (0.01, 0.005, 0.04);
        let step_s = 1e-3 / STEPS_PER_MS as f64;
        let elastance = self.elastance();
        let (mut volume, mut windkessel) = (self.intercept_ml + 100.0, 80.0);
        let (mut pressures, mut volumes, mut aorta) = (vec![], vec![], vec![]);
        for beat in 0..N_BEATS {
            for (k, e) in elastance.iter().enumerate() {
                let isovolumic = e * (volume - self.intercept_ml);
                let inflow = ((self.filling_mmhg - isovolumic) / mitral).max(0.0);
                let outflow = ((isovolumic - windkessel)
                    / (aortic + characteristic + self.internal_mmhg_s_per_ml))
                    .max(0.0);
                if beat + 1 == N_BEATS && k % STEPS_PER_MS == 0 {
                    pressures.push(isovolumic - self.internal_mmhg_s_per_ml * outflow);
                    volumes.push(volume);
                    aorta.push(windkessel + characteristic * outflow);
                }
                volume += (inflow - outflow) * step_s;
                windkessel += (outflow - windkessel / self.peripheral_mmhg_s_per_ml)
                    / self.compliance_ml_per_mmhg
                    * step_s;
            }
        }
        let arterial = Arterial {
            systolic_mmhg: aorta.iter().copied().fold(0.0, f64::max),
            diastolic_mmhg: aorta.iter().copied().fold(f64::INFINITY, f64::min),
        };
        (
            Trace::uniform(Quantity::Pressure, 1.0, pressures).unwrap(),
            Trace::uniform(Quantity::Volume, 1.0, volumes).unwrap(),
            arterial,
        )
    }
}

/// Hearts from failing to strong, small to large, with soft and stiff arteries: true Ees 0.8 to 4 mmHg/mL.
pub(super) fn hearts() -> Vec<Heart> {
    let mut hearts = vec![];
    for elastance in [0.8, 1.5, 2.3, 4.0] {
        for intercept in [-10.0, 12.0, 30.0] {
            for (peripheral, compliance) in [(0.8, 1.6), (1.1, 1.3), (1.5, 0.9)] {
                hearts.push(Heart {
                    elastance_mmhg_per_ml: elastance,
                    intercept_ml: intercept,
                    peripheral_mmhg_s_per_ml: peripheral,
                    compliance_ml_per_mmhg: compliance,
                    ..Heart::default()
                });
            }
        }
    }
    hearts
}
