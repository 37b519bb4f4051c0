//! Internal resistance: pressure that a ventricle loses to its own ejection.
//!
//! Beats of one heart at different loads pass through the same activation. At a time t of ejection each has
//! P = E(t) (V − V0) − loss. Two beats eliminate E(t), and what is left determines the loss.

use super::beat::Beat;

/// Least contrast between two beats, dimensionless: the part of a beat's flow that is not the other's, scaled.
const LEAST_CONTRAST: f64 = 0.01;

/// Reasons why beats do not determine an internal resistance.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ResistanceError {
    /// It takes two beats.
    #[error(
        "an internal resistance needs at least 2 beats at different loads, but there are {n_beats}"
    )]
    TooFewBeats {
        /// Beats that were given.
        n_beats: usize,
    },
    /// No two beats eject at the same time.
    #[error("no two of the beats eject at the same time")]
    NoCommonEjection,
    /// Flows of the beats are alike.
    #[error(
        "flows of the beats differ by {contrast} of themselves only: they do not separate resistance from elastance"
    )]
    SameFlow {
        /// Root mean square of the difference, over that of the flow; dimensionless.
        contrast: f64,
    },
}

/// Loss of pressure by ejection, in two forms. Flow Q out of the ventricle is −dV/dt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InternalResistance {
    /// Constant resistance R of P = E(t) (V − V0) − R Q \[mmHg s/mL\].
    pub resistance_mmhg_s_per_ml: f64,
    /// Factor K of P = E(t) (V − V0) (1 − K Q) \[s/mL\]: the resistance is K times the isovolumic pressure.
    pub loss_s_per_ml: f64,
    /// Samples of common ejection that were used, over all pairs of beats.
    pub n_samples: usize,
}

impl InternalResistance {
    /// Resistance of two or more beats of one heart whose activation begins at the same time.
    ///
    /// - `intercept_ml`: V0 of the heart \[mL\], for instance of [`super::EndSystolicLine`]. An error of V0 enters the
    ///   resistance: a wrong V0 makes the beats' elastances differ.
    ///
    /// Least squares of P₁W₂ − P₂W₁ + R (Q₁W₂ − Q₂W₁) = 0 with W = V − V0, over all pairs of beats and the time in which
    /// both eject. The form with K has P₁W₂ (1 − K Q₂) = P₂W₁ (1 − K Q₁).
    ///
    /// Source: abstract of "Source parameters of the left ventricle related to the physiological characteristics of the
    /// cardiac muscle": the pressure drop from the instantaneous isovolumic pressure at the ejection flow; in
    /// experiments the resistance is linear in the isovolumic pressure. The estimate from pairs is ours.
    ///
    /// Where loops of two beats are scaled copies, as after a change of filling in a linear model, they hold no
    /// resistance: change the resistance of the arteries too.
    ///
    /// # Errors
    /// [`ResistanceError`] when there are fewer than two beats, they do not eject together, or their flows are alike.
    pub fn of(beats: &[Beat], intercept_ml: f64) -> Result<Self, ResistanceError> {
        if beats.len() < 2 {
            return Err(ResistanceError::TooFewBeats {
                n_beats: beats.len(),
            });
        }
        let mut sums = Sums::default();
        for (i, first) in beats.iter().enumerate() {
            for second in &beats[i + 1..] {
                sums.add(first, second, intercept_ml);
            }
        }
        if sums.n_samples == 0 {
            return Err(ResistanceError::NoCommonEjection);
        }
        let contrast = (sums.bb / sums.flow).sqrt();
        if contrast.is_nan() || contrast < LEAST_CONTRAST {
            return Err(ResistanceError::SameFlow { contrast });
        }
        Ok(Self {
            resistance_mmhg_s_per_ml: -sums.ab / sums.bb,
            loss_s_per_ml: sums.ac / sums.cc,
            n_samples: sums.n_samples,
        })
    }
}

/// Sums of the two least-squares problems.
#[derive(Default)]
struct Sums {
    ab: f64,
    bb: f64,
    ac: f64,
    cc: f64,
    flow: f64,
    n_samples: usize,
}

impl Sums {
    fn add(&mut self, first: &Beat, second: &Beat, intercept_ml: f64) {
        let both = [first, second];
        let [t1, t2] = both.map(Beat::systolic_times);
        let begins = t1.ejection_begins_ms.max(t2.ejection_begins_ms);
        let ends = t1.ejection_ends_ms.min(t2.ejection_ends_ms);
        let volume = both.map(Beat::volume);
        let together = |i: &isize| (volume[0].time(*i) - volume[1].time(*i)).abs() < 1e-6;
        for i in volume[0].inside(begins, ends).filter(together) {
            let at = |k: usize| {
                let flow = volume[k].slope(i).map(|slope| -1e3 * slope);
                let pressure = both[k].pressure().value(i);
                flow.map(|flow| (pressure, volume[k].value(i) - intercept_ml, flow))
            };
            let (Some((p1, w1, q1)), Some((p2, w2, q2))) = (at(0), at(1)) else {
                continue;
            };
            let a = p1 * w2 - p2 * w1;
            let b = q1 * w2 - q2 * w1;
            let c = p1 * w2 * q2 - p2 * w1 * q1;
            self.ab += a * b;
            self.bb += b * b;
            self.ac += a * c;
            self.cc += c * c;
            self.flow += (q1 * w2).powi(2);
            self.n_samples += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::line::EndSystolicLine;
    use super::super::model_heart::Heart;
    use super::*;

    fn loads(heart: Heart) -> [Beat; 2] {
        let less = Heart {
            filling_mmhg: 0.8 * heart.filling_mmhg,
            peripheral_mmhg_s_per_ml: 0.7 * heart.peripheral_mmhg_s_per_ml,
            ..heart
        };
        [heart.beat(), less.beat()]
    }

    #[test]
    fn a_resistance_inside_the_ventricle_is_found_with_the_true_intercept() {
        for resistance in [0.0, 0.03, 0.06] {
            let heart = Heart {
                internal_mmhg_s_per_ml: resistance,
                ..Heart::default()
            };
            let found = InternalResistance::of(&loads(heart), heart.intercept_ml).unwrap();
            let error = found.resistance_mmhg_s_per_ml - resistance;
            assert!(error.abs() < 2e-3, "{resistance}: {found:?}");
        }
    }

    #[test]
    fn and_with_the_intercept_of_two_loads() {
        let heart = Heart {
            internal_mmhg_s_per_ml: 0.05,
            ..Heart::default()
        };
        let beats = loads(heart);
        let line = EndSystolicLine::through(&beats).unwrap();
        let found = InternalResistance::of(&beats, line.intercept_ml).unwrap();
        assert!(
            (found.resistance_mmhg_s_per_ml / 0.05 - 1.0).abs() < 0.2,
            "{found:?} {line:?}"
        );
    }

    #[test]
    fn equal_beats_are_refused() {
        let beat = Heart::default().beat();
        assert_eq!(
            InternalResistance::of(std::slice::from_ref(&beat), 10.0),
            Err(ResistanceError::TooFewBeats { n_beats: 1 })
        );
        assert!(matches!(
            InternalResistance::of(&[beat.clone(), beat], 10.0),
            Err(ResistanceError::SameFlow { .. })
        ));
    }
}
