//! Validated record of aortic flow and pressure, divided into beats.

use super::AfterloadError;

/// Smallest number of samples of either trace.
const FEWEST_SAMPLES: usize = 20;
/// Range of the flow over its largest value below which nothing is ejected.
const LEAST_SWING: f64 = 0.2;
/// Time after an upstroke during which no other one is detected \[s\].
const REFRACTORY_S: f64 = 0.2;

/// Flow and pressure on one clock, each with its own sampling.
///
/// The flow is linear between its samples, so that pressures at other times need no resampling.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub(super) flow_time_s: Vec<f64>,
    pub(super) flow: Vec<f64>,
    pub(super) pressure_time_s: Vec<f64>,
    pub(super) pressure: Vec<f64>,
    /// Times of the flow's upstrokes \[s\].
    pub(super) upstrokes_s: Vec<f64>,
    /// Median time between upstrokes, or the length of a record with one beat \[s\].
    pub(super) cycle_s: f64,
    n_dropped: usize,
}

impl Record {
    /// Creates a record of flow (mL/s) and pressure (mmHg) at times on one clock (ms). Pressure
    /// samples farther outside the time of the flow than its usual interval are dropped.
    ///
    /// # Errors
    /// [`AfterloadError`] if the traces are too short, not finite or not in order, contain no
    /// ejection, or hardly overlap in time.
    pub fn new(
        flow_time_ms: &[f64],
        flow_ml_per_s: &[f64],
        pressure_time_ms: &[f64],
        pressure_mmhg: &[f64],
    ) -> Result<Self, AfterloadError> {
        check("flow", flow_time_ms, flow_ml_per_s)?;
        check("pressure", pressure_time_ms, pressure_mmhg)?;
        let (first, last) = (flow_time_ms[0], flow_time_ms[flow_time_ms.len() - 1]);
        let reach = median(flow_time_ms.windows(2).map(|w| w[1] - w[0]));
        let inside = |t: f64| t >= first - reach && t <= last + reach;
        let kept: Vec<usize> = (0..pressure_time_ms.len())
            .filter(|i| inside(pressure_time_ms[*i]))
            .collect();
        if kept.len() < FEWEST_SAMPLES {
            return Err(AfterloadError::Overlap {
                n_samples: kept.len(),
                flow_ms: [first, last],
                pressure_ms: [
                    pressure_time_ms[0],
                    pressure_time_ms[pressure_time_ms.len() - 1],
                ],
            });
        }
        let highest = flow_ml_per_s
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        let lowest = flow_ml_per_s.iter().copied().fold(f64::INFINITY, f64::min);
        if highest <= 0.0 || highest - lowest < LEAST_SWING * highest {
            return Err(AfterloadError::NoEjection {
                lowest_ml_per_s: lowest,
                highest_ml_per_s: highest,
            });
        }
        // Times count from the first pressure sample, so that clocks that started long ago lose no
        // digits.
        let zero = pressure_time_ms[kept[0]];
        let seconds = |t: &f64| (t - zero) * 1e-3;
        let flow_time_s: Vec<f64> = flow_time_ms.iter().map(seconds).collect();
        let pressure_time_s: Vec<f64> = kept
            .iter()
            .map(|i| seconds(&pressure_time_ms[*i]))
            .collect();
        let upstrokes_s = upstrokes(&flow_time_s, flow_ml_per_s);
        let length = pressure_time_s[pressure_time_s.len() - 1] - pressure_time_s[0];
        let cycle_s = match upstrokes_s.len() {
            0 | 1 => length,
            _ => median(upstrokes_s.windows(2).map(|w| w[1] - w[0])),
        };
        Ok(Self {
            flow_time_s,
            flow: flow_ml_per_s.to_vec(),
            pressure: kept.iter().map(|i| pressure_mmhg[*i]).collect(),
            pressure_time_s,
            upstrokes_s,
            cycle_s,
            n_dropped: pressure_time_ms.len() - kept.len(),
        })
    }

    /// The same record, of which is known that it holds one cycle. A flow from a few frames may rise
    /// twice in one ejection, which would make two short beats of it.
    #[must_use]
    pub fn of_one_cycle(mut self, cycle_ms: f64) -> Self {
        self.upstrokes_s.truncate(1);
        self.cycle_s = 1e-3 * cycle_ms;
        self
    }

    /// Number of pressure samples in use.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.pressure.len()
    }

    /// Pressure samples in use: time since the first of them, ms, and pressure, mmHg.
    #[must_use]
    pub fn pressure_samples(&self) -> Vec<(f64, f64)> {
        std::iter::zip(&self.pressure_time_s, &self.pressure)
            .map(|(t, p)| (1e3 * t, *p))
            .collect()
    }

    /// Number of pressure samples dropped because no flow was measured at their time.
    #[must_use]
    pub fn n_dropped(&self) -> usize {
        self.n_dropped
    }

    /// Number of ejections in the record, at least one.
    #[must_use]
    pub fn n_beats(&self) -> usize {
        self.upstrokes_s.len().max(1)
    }

    /// Usual time between upstrokes, ms; the length of the record if it holds one beat.
    #[must_use]
    pub fn cycle_ms(&self) -> f64 {
        1e3 * self.cycle_s
    }

    /// Mean flow over the record, mL/s.
    #[must_use]
    pub fn mean_flow_ml_per_s(&self) -> f64 {
        let area: f64 = (1..self.flow.len())
            .map(|i| 0.5 * (self.flow[i] + self.flow[i - 1]) * self.flow_step(i))
            .sum();
        area / (self.flow_time_s[self.flow.len() - 1] - self.flow_time_s[0])
    }

    fn flow_step(&self, i: usize) -> f64 {
        self.flow_time_s[i] - self.flow_time_s[i - 1]
    }

    /// Highest minus lowest pressure, mmHg.
    #[must_use]
    pub fn pulse_pressure_mmhg(&self) -> f64 {
        let (low, high) = range(&self.pressure);
        high - low
    }

    /// Whether flow and pressure were sampled at the same times, to a microsecond.
    #[must_use]
    pub fn sampled_alike(&self) -> bool {
        self.flow.len() == self.pressure.len()
            && std::iter::zip(&self.flow_time_s, &self.pressure_time_s)
                .all(|(q, p)| (q - p).abs() < 1e-6)
    }

    /// Index of the beat at a time. Times before the second upstroke belong to beat 0.
    pub(super) fn beat_of(&self, time_s: f64) -> usize {
        self.upstrokes_s
            .partition_point(|onset| *onset <= time_s)
            .saturating_sub(1)
    }

    /// Time since the upstroke over the usual cycle, in [0, 1). Times before the first upstroke
    /// count back from it.
    pub(super) fn phase_of(&self, time_s: f64) -> f64 {
        let onset = self
            .upstrokes_s
            .get(self.beat_of(time_s))
            .copied()
            .unwrap_or(0.0);
        ((time_s - onset) / self.cycle_s).rem_euclid(1.0)
    }

    /// The same record with other pressures, one per pressure sample.
    pub(super) fn with_pressure(&self, pressure: Vec<f64>) -> Self {
        Self {
            pressure,
            ..self.clone()
        }
    }
}

fn check(trace: &'static str, time_ms: &[f64], values: &[f64]) -> Result<(), AfterloadError> {
    let (n_times, n_values) = (time_ms.len(), values.len());
    if n_times != n_values || n_times < FEWEST_SAMPLES {
        return Err(AfterloadError::Samples {
            trace,
            n_times,
            n_values,
        });
    }
    for idx in 0..n_times {
        let in_order = idx == 0 || time_ms[idx] > time_ms[idx - 1];
        if !(time_ms[idx].is_finite() && values[idx].is_finite() && in_order) {
            return Err(AfterloadError::Sample {
                trace,
                idx,
                time_ms: time_ms[idx],
                value: values[idx],
            });
        }
    }
    Ok(())
}

/// Times at which the flow rises through the midpoint between its median and its largest value.
fn upstrokes(time_s: &[f64], flow: &[f64]) -> Vec<f64> {
    let (base, top) = (median(flow.iter().copied()), range(flow).1);
    let level = base + 0.5 * (top - base);
    let rearm = base + 0.25 * (top - base);
    let (mut armed, mut found) = (flow[0] < level, Vec::<f64>::new());
    for i in 1..flow.len() {
        if armed && flow[i] >= level {
            let onset = time_s[i - 1]
                + (time_s[i] - time_s[i - 1]) * (level - flow[i - 1]) / (flow[i] - flow[i - 1]);
            if found.last().is_none_or(|last| onset - last > REFRACTORY_S) {
                found.push(onset);
            }
            armed = false;
        } else if flow[i] < rearm {
            armed = true;
        }
    }
    found
}

pub(super) fn range(values: &[f64]) -> (f64, f64) {
    values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(*v), high.max(*v))
        })
}

pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}
