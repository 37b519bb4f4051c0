//! Inflow of recent steps, from which a step's first candidate is extrapolated.

/// Number of inflows that are kept.
const KEPT: usize = 4;

/// Net inflow \[mL/s\] of the last steps of one length.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct RecentInflow {
    /// Length of these steps \[ms\].
    dt_ms: f64,
    /// Number of known inflows.
    n: usize,
    /// Inflows, the newest first.
    inflow: [f64; KEPT],
}

impl RecentInflow {
    /// Number of values in snapshots.
    pub(super) const VALUES: usize = 2 + KEPT;

    /// Adds a step's inflow \[mL/s\]. Earlier steps of another length are forgotten.
    pub(super) fn push(&mut self, inflow_ml_per_s: f64, dt_ms: f64) {
        if dt_ms != self.dt_ms {
            *self = Self {
                dt_ms,
                ..Self::default()
            };
        }
        self.inflow.copy_within(..KEPT - 1, 1);
        self.inflow[0] = inflow_ml_per_s;
        self.n = (self.n + 1).min(KEPT);
    }

    /// Length of the last steps \[ms\]; 0 before the first one.
    pub(super) fn step_ms(&self) -> f64 {
        self.dt_ms
    }

    /// Inflow \[mL/s\] of the last step.
    pub(super) fn last(&self) -> f64 {
        self.inflow[0]
    }

    /// Inflow \[mL/s\] of a next step: constant, linear or quadratic in time, whichever would have
    /// come nearest to the last inflow.
    pub(super) fn extrapolated(&self, dt_ms: f64) -> f64 {
        let [q0, q1, q2, q3] = self.inflow;
        if dt_ms != self.dt_ms {
            return q0;
        }
        let candidates = [
            (q0 - q1, q0),
            (q0 - 2.0 * q1 + q2, 2.0 * q0 - q1),
            (q0 - 3.0 * (q1 - q2) - q3, 3.0 * (q0 - q1) + q2),
        ];
        let known = self.n.saturating_sub(1).min(candidates.len());
        let mut best = (f64::INFINITY, q0);
        for (error, next) in candidates.into_iter().take(known) {
            if error.abs() < best.0 {
                best = (error.abs(), next);
            }
        }
        best.1
    }

    /// Values for a snapshot.
    pub(super) fn to_values(self) -> [f64; Self::VALUES] {
        let [q0, q1, q2, q3] = self.inflow;
        [self.dt_ms, self.n as f64, q0, q1, q2, q3]
    }

    /// From [`Self::VALUES`] values of a snapshot.
    pub(super) fn of_values(values: &[f64]) -> Self {
        let mut inflow = [0.0; KEPT];
        inflow.copy_from_slice(&values[2..]);
        Self {
            dt_ms: values[0],
            n: (values[1] as usize).min(KEPT),
            inflow,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(inflow: impl IntoIterator<Item = f64>) -> RecentInflow {
        let mut recent = RecentInflow::default();
        inflow.into_iter().for_each(|q| recent.push(q, 1.0));
        recent
    }

    #[test]
    fn a_parabola_goes_on() {
        let at = |t: f64| 3.0 - 2.0 * t + 0.5 * t * t;
        let recent = after((0..6).map(|t| at(f64::from(t))));
        assert!((recent.extrapolated(1.0) - at(6.0)).abs() < 1e-12);
    }

    #[test]
    fn a_jump_is_not_extrapolated() {
        assert_eq!(after([0.0, 0.0, 0.0, 0.0, 80.0]).extrapolated(1.0), 80.0);
        assert_eq!(RecentInflow::default().extrapolated(1.0), 0.0);
    }

    #[test]
    fn steps_of_another_length_count_only_as_the_last_inflow() {
        let mut recent = after([0.0, 10.0, 20.0, 30.0]);
        assert_eq!(recent.extrapolated(1.0), 40.0);
        assert_eq!(recent.extrapolated(0.5), 30.0);
        recent.push(35.0, 0.5);
        assert_eq!(recent.extrapolated(0.5), 35.0);
        assert_eq!(RecentInflow::of_values(&recent.to_values()), recent);
    }
}
