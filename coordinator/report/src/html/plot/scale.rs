//! Scales of axes: conversion from data to fractions of the axis, and ticks at round numbers.

/// A linear or logarithmic axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    lo: f64,
    hi: f64,
    log: bool,
}

impl Scale {
    /// A scale that covers `values` with a little room, from zero on if `from_zero`. `None` without
    /// a finite value.
    #[must_use]
    pub fn linear(values: impl IntoIterator<Item = f64>, from_zero: bool) -> Option<Self> {
        let (mut lo, mut hi) = extent(values)?;
        if from_zero {
            (lo, hi) = (lo.min(0.0), hi.max(0.0));
        }
        if hi - lo < 1e-9 * hi.abs().max(1e-9) {
            let room = if hi == 0.0 { 1.0 } else { 0.1 * hi.abs() };
            (lo, hi) = (lo - room, hi + room);
        }
        let room = 0.05 * (hi - lo);
        let below = if from_zero && lo == 0.0 { 0.0 } else { room };
        Some(Self {
            lo: lo - below,
            hi: hi + room,
            log: false,
        })
    }

    /// A scale exactly from `lo` to `hi`, for example an axis of time that ends with the beat.
    #[must_use]
    pub fn exact(lo: f64, hi: f64) -> Self {
        Self {
            lo,
            hi: if hi > lo { hi } else { lo + 1.0 },
            log: false,
        }
    }

    /// A logarithmic scale over the positive `values`, at least a factor `least` wide. `None`
    /// without a positive value.
    #[must_use]
    pub fn log(values: impl IntoIterator<Item = f64>, least: f64) -> Option<Self> {
        let (mut lo, mut hi) = extent(values.into_iter().filter(|v| *v > 0.0))?;
        if hi / lo < least {
            let middle = (lo * hi).sqrt();
            (lo, hi) = (middle / least.sqrt(), middle * least.sqrt());
        }
        let room = (hi / lo).powf(0.06);
        Some(Self {
            lo: lo / room,
            hi: hi * room,
            log: true,
        })
    }

    /// Position on the axis, between 0 and 1 inside it; `None` if the value has no position, such
    /// as 0 on a logarithmic axis.
    #[must_use]
    pub fn fraction(&self, value: f64) -> Option<f64> {
        let fraction = if self.log {
            (value / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        };
        fraction.is_finite().then_some(fraction)
    }

    /// First and last value, and whether the axis is logarithmic, from which values are read off
    /// the plot.
    #[must_use]
    pub fn ends(&self) -> (f64, f64, bool) {
        (self.lo, self.hi, self.log)
    }

    /// About `wanted` round numbers inside the axis, with their labels.
    #[must_use]
    pub fn ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        let values = if self.log {
            self.log_ticks(wanted)
        } else {
            linear_ticks(self.lo, self.hi, wanted)
        };
        let step = values
            .windows(2)
            .map(|w| w[1] - w[0])
            .fold(f64::INFINITY, f64::min);
        let step = if self.log || !step.is_finite() {
            None
        } else {
            Some(step)
        };
        values
            .into_iter()
            .map(|v| (v, tick_label(v, step)))
            .collect()
    }

    fn log_ticks(&self, wanted: usize) -> Vec<f64> {
        let decades = (self.hi / self.lo).log10();
        if decades < 0.4 {
            return linear_ticks(self.lo, self.hi, wanted);
        }
        let steps: &[f64] = match decades {
            d if d < 1.1 && wanted >= 5 => &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
            d if d < 2.2 => &[1.0, 2.0, 5.0],
            d if d < 3.2 => &[1.0, 3.0],
            _ => &[1.0],
        };
        let first = self.lo.log10().floor() as i32;
        let last = self.hi.log10().ceil() as i32;
        let every = ((f64::from(last - first) / wanted as f64).ceil() as i32).max(1);
        (first..=last)
            .filter(|e| e.rem_euclid(every) == 0)
            .flat_map(|e| steps.iter().map(move |s| s * 10f64.powi(e)))
            .filter(|v| *v >= self.lo * (1.0 - 1e-9) && *v <= self.hi * (1.0 + 1e-9))
            .collect()
    }
}

fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let found = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
            (lo.min(v), hi.max(v))
        });
    (found.0 <= found.1).then_some(found)
}

fn linear_ticks(lo: f64, hi: f64, wanted: usize) -> Vec<f64> {
    let raw = (hi - lo) / wanted.max(1) as f64;
    let magnitude = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .map(|s| s * magnitude)
        .into_iter()
        .find(|s| *s >= raw * 0.999)
        .unwrap_or(raw);
    let first = (lo / step - 1e-9).ceil() as i64;
    let last = (hi / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn tick_label(value: f64, step: Option<f64>) -> String {
    let smallest = step.unwrap_or(value.abs());
    let text = if value == 0.0 {
        "0".to_owned()
    } else if value.abs() >= 1e5 || smallest < 1e-4 {
        format!("{value:e}")
    } else {
        // The label has as many decimals as the step needs: two for 0.25, one for 0.5.
        let decimals = (0..6).find(|d| {
            let scaled = smallest * 10f64.powi(*d);
            (scaled - scaled.round()).abs() < 1e-6 * scaled.max(1.0)
        });
        format!("{value:.*}", decimals.unwrap_or(4) as usize)
    };
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, n: usize) -> Vec<String> {
        scale.ticks(n).into_iter().map(|t| t.1).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            labels(Scale::exact(0.0, 659.0), 5),
            ["0", "200", "400", "600"]
        );
        assert_eq!(labels(Scale::exact(0.8, 1.02), 4), ["0.8", "0.9", "1.0"]);
        assert_eq!(
            labels(Scale::exact(-0.5, 0.5), 4),
            ["\u{2212}0.50", "\u{2212}0.25", "0", "0.25", "0.50"]
        );
    }

    #[test]
    fn logarithmic_ticks_thin_out_with_the_decades() {
        assert_eq!(
            labels(Scale::log([0.02, 1.9], 2.0).unwrap(), 5),
            ["0.03", "0.1", "0.3", "1"]
        );
        assert_eq!(
            labels(Scale::log([0.05, 1.1], 2.0).unwrap(), 5),
            ["0.05", "0.1", "0.2", "0.5", "1"]
        );
        assert_eq!(
            Scale::log([1e-6, 1e3], 2.0)
                .unwrap()
                .ticks(5)
                .iter()
                .map(|t| t.0.log10().round())
                .collect::<Vec<_>>(),
            [-6.0, -3.0, 0.0, 3.0]
        );
        assert!(labels(Scale::log([1.0], 2.0).unwrap(), 4).len() >= 3);
    }

    #[test]
    fn an_axis_contains_its_data_even_when_all_are_equal() {
        for values in [vec![5.0], vec![0.0, 0.0], vec![-3.0, 12.0]] {
            let scale = Scale::linear(values.clone(), false).unwrap();
            assert!(
                values
                    .iter()
                    .all(|v| (0.0..=1.0).contains(&scale.fraction(*v).unwrap()))
            );
        }
        assert_eq!(Scale::linear([f64::NAN], true), None);
        assert_eq!(Scale::log([0.0, -1.0], 2.0), None);
    }
}
