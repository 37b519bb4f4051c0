//! The lag between pressure and volume: ejection begins when the aortic valve opens and ends when it closes.

/// How both are synchronised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SynchroniseSettings {
    /// Whether a lag is taken out.
    pub enabled: bool,
    /// The lag, ms; none takes it from the events.
    pub lag_ms: Option<f64>,
}

impl Default for SynchroniseSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            lag_ms: None,
        }
    }
}

/// A lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// By so much the volume came after the pressure, ms; it was moved forward by this.
    pub ms: f64,
    /// Lag by the opening and by the closure of the aortic valve, ms; none where one of both has no events.
    pub by_events_ms: Option<[f64; 2]>,
    /// Whether it was taken out.
    pub removed: bool,
}

/// The lag of ejection, on the catheter's clock, after the valve's events.
/// - `ejection_ms`: begin and end from the volume, its cycle reconciled already
/// - `valve_ms`: opening and closure from the pressure
#[must_use]
pub fn lag(
    ejection_ms: Option<(f64, f64)>,
    valve_ms: Option<(f64, f64)>,
    cycle_length_ms: f64,
    settings: SynchroniseSettings,
) -> Lag {
    let near =
        |t: f64| (t + 0.5 * cycle_length_ms).rem_euclid(cycle_length_ms) - 0.5 * cycle_length_ms;
    let by_events_ms = ejection_ms
        .zip(valve_ms)
        .map(|(volume, valve)| [near(volume.0 - valve.0), near(volume.1 - valve.1)]);
    let seen = by_events_ms.map(|[opening, closure]| 0.5 * (opening + closure));
    let ms = settings.lag_ms.or(seen).unwrap_or(0.0);
    let removed = settings.enabled && (settings.lag_ms.is_some() || seen.is_some());
    Lag {
        ms,
        by_events_ms,
        removed,
    }
}

impl Lag {
    /// What is taken off the volume's times, ms.
    #[must_use]
    pub fn taken_ms(&self) -> f64 {
        if self.removed { self.ms } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_is_that_of_both_events_around_the_cycles_end() {
        let of = |ejection| {
            lag(
                Some(ejection),
                Some((60.0, 330.0)),
                800.0,
                SynchroniseSettings::default(),
            )
        };
        assert_eq!(of((100.0, 366.0)).ms, 38.0);
        assert_eq!(
            of((-760.0 + 20.0, 320.0 - 800.0)).by_events_ms,
            Some([0.0, -10.0])
        );
        let given = SynchroniseSettings {
            enabled: true,
            lag_ms: Some(-5.0),
        };
        assert_eq!(lag(None, None, 800.0, given).taken_ms(), -5.0);
        let off = SynchroniseSettings {
            enabled: false,
            lag_ms: None,
        };
        assert_eq!(
            lag(Some((100.0, 370.0)), Some((60.0, 330.0)), 800.0, off).taken_ms(),
            0.0
        );
        assert_eq!(
            lag(None, None, 800.0, SynchroniseSettings::default()).taken_ms(),
            0.0
        );
    }
}
