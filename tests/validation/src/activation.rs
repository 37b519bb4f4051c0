//! Activation of a chamber: the rise is a Hill function of the time since onset, the fall a cosine.
//!
//! The rise is g/(1 + g), g = (t/τ)^m, as in Stergiopulos, Meister and Westerhof 1996 (Am J Physiol
//! 270:H2050). Their second Hill function has a tail like slow muscle. The fall here is ½ (1 +
//! cos(π (t − t_f)/T_f))^q, a cosine as in Regazzoni et al. 2022 (J Comput Phys 457:111083). It
//! ends, so that a heart without missing effects relaxes without a tail.

use std::f64::consts::PI;

/// A twitch, scaled to a peak of one.
#[derive(Debug, Clone, PartialEq)]
pub struct Twitch {
    /// Time constant \[ms\] and exponent of the rise.
    rise: (f64, f64),
    /// Start \[ms\], duration \[ms\] and exponent of the fall.
    fall: (f64, f64, f64),
    scale: f64,
}

impl Twitch {
    /// Creates a twitch from time constant \[ms\] and exponent of the rise, and start \[ms\],
    /// duration
    /// [ms\] and exponent of the fall.
    #[must_use]
    pub fn new(rise: (f64, f64), fall: (f64, f64, f64)) -> Self {
        let mut twitch = Self {
            rise,
            fall,
            scale: 1.0,
        };
        let peak = (0..2000)
            .map(|t| twitch.at(f64::from(t)))
            .fold(0.0, f64::max);
        twitch.scale = 1.0 / peak;
        twitch
    }

    /// The twitch of a heart whose systole lasts this many times as long: rise and middle of the fall
    /// move, and the fall keeps its duration.
    #[must_use]
    pub fn paced(&self, systole: f64) -> Self {
        let (begin, duration, exponent) = self.fall;
        let middle = systole * (begin + 0.5 * duration);
        let rise = (systole * self.rise.0, self.rise.1);
        Self::new(rise, (middle - 0.5 * duration, duration, exponent))
    }

    /// Value at a time since onset \[ms\].
    #[must_use]
    pub fn at(&self, t_ms: f64) -> f64 {
        let (begin, duration, exponent) = self.fall;
        if t_ms <= 0.0 || t_ms >= begin + duration {
            return 0.0;
        }
        let g = (t_ms / self.rise.0).powf(self.rise.1);
        let x = ((t_ms - begin) / duration).max(0.0);
        self.scale * g / (1.0 + g) * (0.5 * (1.0 + (PI * x).cos())).powf(exponent)
    }

    /// Time at which the fall is half done \[ms\].
    #[must_use]
    pub fn half_fall_ms(&self) -> f64 {
        self.fall.0 + 0.5 * self.fall.1
    }
}

/// Modifications of the activation of the left ventricle over one cycle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Course {
    /// Smallest time constant of the fall \[ms\]; 0 leaves the fall unchanged.
    pub relaxation_ms: f64,
    /// Share of the wall that is late, and the mean of its delay \[ms\].
    pub late: Option<(f64, f64)>,
    /// A second, small contraction: height, time since onset \[ms\], width \[ms\].
    pub after_contraction: Option<(f64, f64, f64)>,
}

/// Delays of the groups in the late part of the wall, relative to its mean delay.
pub const LATE_GROUPS: [f64; 5] = [0.7, 0.85, 1.0, 1.15, 1.3];

impl Course {
    /// Periodic values at the start of each of `n` steps over a cycle; the onset is `onset_ms`
    /// after time zero.
    #[must_use]
    pub fn table(&self, twitch: &Twitch, onset_ms: f64, cycle_ms: f64, n: usize) -> Vec<f64> {
        let step = cycle_ms / n as f64;
        let whole = |since: f64| {
            let mut e = twitch.at(since);
            if let Some((share, delay)) = self.late {
                let late: f64 = LATE_GROUPS
                    .iter()
                    .map(|k| twitch.at(since - k * delay))
                    .sum::<f64>();
                e = (1.0 - share) * e + share * late / LATE_GROUPS.len() as f64;
            }
            if let Some((height, at, width)) = self.after_contraction {
                e += height * (-((since - at) / width).powi(2)).exp();
            }
            e
        };
        // The tail of the previous beat is still present.
        let at = |i: usize| {
            let since = i as f64 * step - onset_ms;
            whole(since) + whole(since + cycle_ms)
        };
        let forced: Vec<f64> = (0..n).map(at).collect();
        if self.relaxation_ms <= 0.0 {
            return forced;
        }
        // The activation falls towards the twitch no faster than its time constant allows.
        let mut own = forced.clone();
        let mut e = forced[n - 1];
        for i in (0..3).flat_map(|_| 0..n) {
            let followed =
                forced[i] + (e - forced[i]).max(0.0) * (-step / self.relaxation_ms).exp();
            e = followed.max(forced[i]);
            own[i] = e;
        }
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn twitch() -> Twitch {
        Twitch::new((150.0, 1.8), (270.0, 150.0, 1.0))
    }

    #[test]
    fn a_twitch_peaks_at_one_and_is_gone_before_the_next() {
        let table = Course::default().table(&twitch(), 20.0, 850.0, 4250);
        let peak = table.iter().copied().fold(0.0, f64::max);
        assert!(
            (peak - 1.0).abs() < 2e-3 && table[0] < 1e-3 && table[3500] < 1e-3,
            "{peak} {}",
            table[3500]
        );
    }

    #[test]
    fn slow_relaxation_leaves_the_rise_and_gives_an_exponential_tail() {
        let plain = Course::default().table(&twitch(), 20.0, 850.0, 4250);
        let slow = Course {
            relaxation_ms: 50.0,
            ..Course::default()
        }
        .table(&twitch(), 20.0, 850.0, 4250);
        assert_eq!(plain[500..1000], slow[500..1000]);
        // Two times 60 ms apart, late in the tail.
        assert!(
            (slow[3000] / slow[2700] - (-60.0f64 / 50.0).exp()).abs() < 0.01,
            "{}",
            slow[3000] / slow[2700]
        );
    }

    #[test]
    fn a_late_part_delays_rise_and_fall() {
        let plain = Course::default().table(&twitch(), 20.0, 850.0, 4250);
        let split = Course {
            late: Some((0.4, 60.0)),
            ..Course::default()
        }
        .table(&twitch(), 20.0, 850.0, 4250);
        assert!(split[600] < plain[600] && split[2100] > plain[2100]);
    }
}
