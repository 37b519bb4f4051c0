//! Lag between pressure and volume: ejection starts when the aortic valve opens and ends when it
//! closes.

use cardiotwin_vocabulary::preparation::SynchroniseStep;

/// Lag between pressure and volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Delay of the volume after the pressure \[ms\]. If the lag is removed, the volume is moved
    /// forward by this time.
    pub ms: f64,
    /// Lags of the aortic valve's opening and closure \[ms\]; `None` if one of the signals has no
    /// events.
    pub by_events_ms: Option<[f64; 2]>,
    /// Whether the lag was removed.
    pub removed: bool,
}

/// Lag of ejection after the valve's events, on the catheter's clock.
/// - `ejection_ms`: start and end of ejection from the volume, whose cycle must already be adapted
/// - `valve_ms`: opening and closure of the valve from the pressure
#[must_use]
pub fn lag(
    ejection_ms: Option<(f64, f64)>,
    valve_ms: Option<(f64, f64)>,
    cycle_length_ms: f64,
    settings: SynchroniseStep,
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
    /// Time that is subtracted from the volume's times \[ms\].
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
                SynchroniseStep::default(),
            )
        };
        assert_eq!(of((100.0, 366.0)).ms, 38.0);
        assert_eq!(
            of((-760.0 + 20.0, 320.0 - 800.0)).by_events_ms,
            Some([0.0, -10.0])
        );
        let given = SynchroniseStep {
            enabled: true,
            lag_ms: Some(-5.0),
        };
        assert_eq!(lag(None, None, 800.0, given).taken_ms(), -5.0);
        let off = SynchroniseStep {
            enabled: false,
            lag_ms: None,
        };
        assert_eq!(
            lag(Some((100.0, 370.0)), Some((60.0, 330.0)), 800.0, off).taken_ms(),
            0.0
        );
        assert_eq!(
            lag(None, None, 800.0, SynchroniseStep::default()).taken_ms(),
            0.0
        );
    }
}
