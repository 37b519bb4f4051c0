//! Adaptation of the cine's cycle to the catheter's. Systole and diastole are scaled separately,
//! because a faster heart rate shortens mainly diastole.

use cardiotwin_vocabulary::preparation::CycleStep;

/// Accepted factors between the systoles of two examinations.
const SYSTOLE: std::ops::RangeInclusive<f64> = 0.75..=1.33;

/// A map from the cine's times to the catheter's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reconciled {
    /// Cycle lengths of the cine and of the catheter \[ms\].
    pub cycle_lengths_ms: [f64; 2],
    /// End of systole on the cine's clock \[ms\].
    pub systole_end_ms: f64,
    /// Factor by which times in systole are stretched.
    pub systole_factor: f64,
    /// Factor by which times in diastole are stretched.
    pub diastole_factor: f64,
    /// Ratio of the ejection times if it was implausible, so that the ratio of the cycles was used
    /// instead.
    pub implausible: Option<f64>,
}

/// Scales systole and diastole of the cine to those of the catheter.
/// - `ejections_ms`: start and end of ejection, on the cine's clock and on the catheter's
#[must_use]
pub fn reconcile(
    cycle_lengths_ms: [f64; 2],
    ejections_ms: Option<[(f64, f64); 2]>,
    settings: CycleStep,
) -> Reconciled {
    let [from, to] = cycle_lengths_ms;
    let alike = to / from;
    let end = ejections_ms.map_or(0.0, |e| e[0].1.rem_euclid(from));
    let ratio = ejections_ms.map(|[cine, catheter]| (catheter.1 - catheter.0) / (cine.1 - cine.0));
    let (mut factor, mut implausible) = match (settings.systole_factor, ratio) {
        (Some(given), _) => (given, None),
        (None, Some(ratio)) if settings.enabled && SYSTOLE.contains(&ratio) => (ratio, None),
        (None, Some(ratio)) if settings.enabled => (alike, Some(ratio)),
        _ => (alike, None),
    };
    let mut diastole_factor = (to - factor * end) / (from - end);
    if !(settings.enabled || settings.systole_factor.is_some())
        || end <= 0.0
        || diastole_factor <= 0.1
    {
        if diastole_factor <= 0.1 {
            implausible = Some(factor);
        }
        (factor, diastole_factor) = (alike, alike);
    }
    Reconciled {
        cycle_lengths_ms,
        systole_end_ms: end,
        systole_factor: factor,
        diastole_factor,
        implausible,
    }
}

impl Reconciled {
    /// Converts a time on the cine's clock to the catheter's clock, before any lag is removed
    /// \[ms\].
    #[must_use]
    pub fn map(&self, time_ms: f64) -> f64 {
        let [from, to] = self.cycle_lengths_ms;
        let (turns, t) = (time_ms.div_euclid(from), time_ms.rem_euclid(from));
        let end = self.systole_end_ms;
        let here = if t <= end {
            self.systole_factor * t
        } else {
            self.systole_factor * end + self.diastole_factor * (t - end)
        };
        turns * to + here
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systole_and_diastole_are_scaled_apart_and_fill_the_cycle() {
        let r = reconcile(
            [900.0, 750.0],
            Some([(60.0, 350.0), (50.0, 325.0)]),
            CycleStep::default(),
        );
        assert!((r.systole_factor - 275.0 / 290.0).abs() < 1e-12);
        assert!(r.diastole_factor < r.systole_factor);
        assert!((r.map(350.0) - r.systole_factor * 350.0).abs() < 1e-9);
        assert!(
            (r.map(900.0) - 750.0).abs() < 1e-9
                && (r.map(1250.0) - 750.0 - r.map(350.0)).abs() < 1e-9
        );
        assert!((r.map(-100.0) - (r.map(800.0) - 750.0)).abs() < 1e-9);
    }

    #[test]
    fn off_scales_alike_and_nonsense_is_not_believed() {
        let off = reconcile(
            [900.0, 750.0],
            Some([(60.0, 350.0), (50.0, 325.0)]),
            CycleStep {
                enabled: false,
                systole_factor: None,
            },
        );
        assert!((off.map(450.0) - 375.0).abs() < 1e-9);
        let mad = reconcile(
            [900.0, 750.0],
            Some([(60.0, 150.0), (50.0, 325.0)]),
            CycleStep::default(),
        );
        assert!(mad.implausible.is_some() && (mad.systole_factor - 750.0 / 900.0).abs() < 1e-12);
    }
}
