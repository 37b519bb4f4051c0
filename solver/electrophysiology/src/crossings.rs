//! Times of depolarisation and repolarisation at each point.

/// Times at which the potential crosses two levels in the latest beat, interpolated linearly
/// between steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Crossings {
    /// Time of the upstroke through [`Crossings::UP_MV`] \[ms\]; not-a-number if there was none.
    pub up_ms: Vec<f64>,
    /// Time of the fall through [`Crossings::DOWN_MV`] \[ms\]; not-a-number if there was none since
    /// the upstroke.
    pub down_ms: Vec<f64>,
}

impl Crossings {
    /// Level of the upstroke \[mV\].
    pub const UP_MV: f64 = -40.0;
    /// Level of the fall \[mV\], approximately 90 % repolarisation.
    pub const DOWN_MV: f64 = -70.0;

    /// State before any crossing, for `n` points.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self {
            up_ms: vec![f64::NAN; n],
            down_ms: vec![f64::NAN; n],
        }
    }

    /// Records the crossings in the step that ended at `t_ms`.
    pub(crate) fn note(&mut self, before_mv: &[f64], after_mv: &[f64], t_ms: f64, step_ms: f64) {
        for (i, (before, after)) in before_mv.iter().zip(after_mv).enumerate() {
            let at = |level: f64| t_ms - step_ms * (after - level) / (after - before);
            if *before < Self::UP_MV && *after >= Self::UP_MV {
                self.up_ms[i] = at(Self::UP_MV);
                self.down_ms[i] = f64::NAN;
            } else if *before > Self::DOWN_MV && *after <= Self::DOWN_MV && !self.up_ms[i].is_nan()
            {
                self.down_ms[i] = at(Self::DOWN_MV);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_are_interpolated_and_the_last_beat_counts() {
        let mut found = Crossings::new(2);
        found.note(&[-60.0, -60.0], &[-20.0, -65.0], 1.0, 0.5);
        assert_eq!(found.up_ms[0], 0.75);
        found.note(&[-69.0, -69.0], &[-71.0, -71.0], 2.0, 0.5);
        assert_eq!(found.down_ms[0], 1.75);
        assert!(
            found.up_ms[1].is_nan() && found.down_ms[1].is_nan(),
            "no fall without an upstroke"
        );
        found.note(&[-60.0, -80.0], &[-20.0, -80.0], 10.0, 0.5);
        assert!(found.up_ms[0] == 9.75 && found.down_ms[0].is_nan());
    }
}
