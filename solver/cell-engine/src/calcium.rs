//! Calcium: Rice's transient, or samples that are the same for every cell.

use cardiotwin_models::calcium::Rice2008Shape;

use crate::input_problem::InputProblem;

/// Relative difference of Rice's rates below which their limit is taken: its error is then below 1e-9.
pub(crate) const EQUAL_RATES: f64 = 1e-5;

/// A measured or simulated transient in the place of Rice's, the same for every cell: step 2's median trace. Samples at a
/// constant interval from activation on, joined by cubic Hermite pieces with central-difference slopes, held at the ends.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledCalcium {
    interval_ms: f64,
    samples_um: Vec<f64>,
}

impl SampledCalcium {
    /// Takes samples \[µM\] at 0, `interval_ms`, 2 `interval_ms`, … after activation.
    ///
    /// # Errors
    /// [`InputProblem::Range`] for fewer than three samples, a bad interval, or a sample that is not positive.
    pub fn new(interval_ms: f64, samples_um: Vec<f64>) -> Result<Self, InputProblem> {
        let range = |name, value, expected| {
            Err(InputProblem::Range {
                name,
                value,
                expected,
            })
        };
        if !(1e-3..=1e3).contains(&interval_ms) {
            return range(
                "interval_ms of the calcium samples",
                interval_ms,
                "0.001 to 1000",
            );
        }
        if samples_um.len() < 3 {
            return range(
                "number of calcium samples",
                samples_um.len() as f64,
                "3 or more",
            );
        }
        match samples_um.iter().find(|x| !(1e-9..1e9).contains(*x)) {
            Some(&value) => range("a calcium sample", value, "1e-9 to 1e9 uM"),
            None => Ok(Self {
                interval_ms,
                samples_um,
            }),
        }
    }

    /// Value \[µM\] and rate \[µM/ms\] at time `t` after activation.
    #[must_use]
    pub fn at(&self, t_ms: f64) -> (f64, f64) {
        let s = &self.samples_um;
        let last = s.len() - 1;
        let position = t_ms / self.interval_ms;
        if position < 0.0 {
            return (s[0], 0.0);
        }
        if position >= last as f64 {
            return (s[last], 0.0);
        }
        let k = position as usize;
        let x = position - k as f64;
        let slope = |k: usize| match k {
            0 => s[1] - s[0],
            k if k == last => s[last] - s[last - 1],
            k => 0.5 * (s[k + 1] - s[k - 1]),
        };
        let (a, b, d0, d1) = (s[k], s[k + 1], slope(k), slope(k + 1));
        let (c2, c3) = (3.0 * (b - a) - 2.0 * d0 - d1, 2.0 * (a - b) + d0 + d1);
        (
            a + x * (d0 + x * (c2 + x * c3)),
            (d0 + x * (2.0 * c2 + x * 3.0 * c3)) / self.interval_ms,
        )
    }

    /// Transient of these samples within a cycle, with the durations that its grid shows.
    pub(crate) fn within(&self, cycle_ms: f64) -> Transient<'_> {
        let grid = |k: usize| self.at(k as f64).0;
        let end = cycle_ms as usize;
        let first = grid(0);
        let peak = (0..=end).fold(0, |best, k| if grid(k) > grid(best) { k } else { best });
        let amplitude = grid(peak) - first;
        let decay_time = |fraction: f64| {
            let level = first + (1.0 - fraction) * amplitude;
            let down = (peak..end).find(|&k| grid(k) >= level && grid(k + 1) < level);
            down.map_or(end as f64, |k| {
                k as f64 + (grid(k) - level) / (grid(k) - grid(k + 1))
            })
        };
        Transient {
            source: Source::Samples(self),
            rest: first,
            amplitude,
            peak_ms: peak as f64,
            ctd50_ms: decay_time(0.5),
            ctd90_ms: decay_time(0.9),
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Source<'a> {
    Rice(Rice2008Shape),
    Samples(&'a SampledCalcium),
}

/// The calcium of one cell outside of the lanes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transient<'a> {
    source: Source<'a>,
    rest: f64,
    amplitude: f64,
    peak_ms: f64,
    /// Time from activation to 50 % decay \[ms\].
    pub ctd50_ms: f64,
    /// Time from activation to 90 % decay \[ms\].
    pub ctd90_ms: f64,
}

impl Transient<'_> {
    /// Rice's transient; its durations are those of the analytic curve, not cut at the cycle's end.
    pub fn rice(rest: f64, peak: f64, tau_cr_ms: f64, tau_cd_ms: f64) -> Self {
        let shape = Rice2008Shape::new(tau_cr_ms, tau_cd_ms, EQUAL_RATES);
        // Every checked pair of time constants has a decay; otherwise the durations stand out as not a number.
        let decay = |fraction| shape.decay_time(fraction).map_or(f64::NAN, |time| time.0);
        let (ctd50_ms, ctd90_ms) = (decay(0.5), decay(0.9));
        let source = Source::Rice(shape);
        Self {
            source,
            rest,
            amplitude: peak - rest,
            peak_ms: shape.peak_ms,
            ctd50_ms,
            ctd90_ms,
        }
    }

    /// Calcium \[µM\] at time `t` after activation.
    pub fn at(&self, t: f64) -> f64 {
        match self.source {
            Source::Rice(shape) => self.rest + self.amplitude * shape.value(t),
            Source::Samples(samples) => samples.at(t).0,
        }
    }

    /// Largest value of the transient \[µM\].
    pub fn peak(&self) -> f64 {
        self.rest + self.amplitude
    }

    /// Whether calcium has come down by half or more at time `t`.
    pub fn is_past(&self, t: f64) -> bool {
        t > self.peak_ms && self.at(t) < self.rest + 0.5 * self.amplitude
    }
}
