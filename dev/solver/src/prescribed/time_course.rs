//! Prescribed values over time.

use serde::Deserialize;

/// A value as a function of time.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TimeCourse {
    /// Zero before time zero, then constant.
    Constant {
        /// Value from time zero on \[kPa\].
        #[serde(rename = "value_kPa")]
        value_kpa: f64,
    },
    /// Linear from zero to a value, then constant.
    Ramp {
        /// Value at the end of the line \[kPa\].
        #[serde(rename = "value_kPa")]
        value_kpa: f64,
        /// Time at which the line ends \[s\].
        until_s: f64,
    },
    /// Linear between points, constant before the first and after the last.
    Table {
        /// Times of the points, ascending \[s\].
        t_s: Vec<f64>,
        /// Values at the points \[kPa\].
        #[serde(rename = "value_kPa")]
        value_kpa: Vec<f64>,
    },
    /// `τ' = −|a| τ + σ₀ max(a, 0)`, `a = rise·f + fall·(1 − f)`, `f = S⁺(t − t_on) S⁻(t − t_off)`, `S±(x) = (1 ±
    /// tanh(x/γ))/2`, with `τ(0) = 0`.
    ///
    /// Source: active stress of Aróstica et al. 2025, Comput Methods Appl Mech Eng 435:117485.
    Activation {
        /// Contractility σ₀, which the stress approaches while activated \[kPa\].
        #[serde(rename = "contractility_kPa")]
        contractility_kpa: f64,
        /// Rate at which the stress rises while activated \[1/s\].
        rise_per_s: f64,
        /// Rate at which it falls otherwise \[1/s\]; negative.
        fall_per_s: f64,
        /// Start of the activation t_on \[s\].
        on_s: f64,
        /// End of the activation t_off \[s\].
        off_s: f64,
        /// Width γ of the switches \[s\].
        switch_s: f64,
    },
    /// `p' = −|b| p + σ_mid max(b, 0) + σ_pre g`, `b = a + α_pre g + α_mid`, with `a` as in [`Self::Activation`], `g = S⁻(t −
    /// t_off)` and `p(0) = 0`.
    ///
    /// Source: cavity pressure of Aróstica et al. 2025.
    ChamberPressure {
        /// Systolic pressure σ_mid \[kPa\].
        #[serde(rename = "systolic_kPa")]
        systolic_kpa: f64,
        /// Rate σ_pre at which the pressure rises in filling \[kPa/s\].
        #[serde(rename = "filling_kPa_per_s")]
        filling_kpa_per_s: f64,
        /// Rate α_pre, which is added during filling \[1/s\].
        filling_per_s: f64,
        /// Rate α_mid, which is added at all times \[1/s\].
        middle_per_s: f64,
        /// Rate of the activation while activated \[1/s\].
        rise_per_s: f64,
        /// Rate of the activation otherwise \[1/s\]; negative.
        fall_per_s: f64,
        /// Start of the activation t_on \[s\].
        on_s: f64,
        /// End of the activation t_off \[s\].
        off_s: f64,
        /// Width γ of the switches \[s\].
        switch_s: f64,
    },
}

/// A parameter of a time course is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} = {value}, expected {expected}")]
pub struct TimeCourseError {
    /// Name of the parameter.
    pub name: &'static str,
    /// Value of the parameter.
    pub value: f64,
    /// Range of admissible values, in words.
    pub expected: &'static str,
}

/// Spacing of the stored values \[ms\], between which a cubic matches values and slopes.
const SPACING_MS: f64 = 0.25;

/// Integration steps between two stored values.
const SUBSTEPS: usize = 10;

/// A time course that can be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    kind: TimeCourse,
    /// Values and slopes \[kPa, kPa/ms\] every [`SPACING_MS`]; empty for a closed form.
    samples: Vec<(f64, f64)>,
}

impl TimeCourse {
    /// A course that is zero at all times.
    pub const ZERO: Self = Self::Constant { value_kpa: 0.0 };

    fn check(&self) -> Result<(), TimeCourseError> {
        let unless = |ok: bool, name, value, expected| {
            if ok {
                Ok(())
            } else {
                Err(TimeCourseError {
                    name,
                    value,
                    expected,
                })
            }
        };
        let finite = |name, value: f64| unless(value.is_finite(), name, value, "a finite number");
        let positive = |name, value: f64| {
            unless(
                value > 0.0 && value.is_finite(),
                name,
                value,
                "more than zero",
            )
        };
        match self {
            Self::Constant { value_kpa } => finite("value_kPa", *value_kpa),
            Self::Ramp { value_kpa, until_s } => {
                finite("value_kPa", *value_kpa)?;
                positive("until_s", *until_s)
            }
            Self::Table { t_s, value_kpa } => {
                unless(!t_s.is_empty(), "length of t_s", 0.0, "one or more times")?;
                let (n, m) = (t_s.len(), value_kpa.len());
                unless(
                    n == m,
                    "length of value_kPa",
                    m as f64,
                    "as many values as t_s has times",
                )?;
                for (k, t) in t_s.iter().enumerate() {
                    unless(
                        t.is_finite() && (k == 0 || *t > t_s[k - 1]),
                        "t_s",
                        *t,
                        "finite times, each after the one before",
                    )?;
                    finite("value_kPa", value_kpa[k])?;
                }
                Ok(())
            }
            Self::Activation {
                contractility_kpa,
                rise_per_s,
                fall_per_s,
                on_s,
                off_s,
                switch_s,
            } => {
                finite("contractility_kPa", *contractility_kpa)?;
                finite("rise_per_s", *rise_per_s)?;
                finite("fall_per_s", *fall_per_s)?;
                finite("on_s", *on_s)?;
                unless(off_s > on_s, "off_s", *off_s, "a time after on_s")?;
                positive("switch_s", *switch_s)
            }
            Self::ChamberPressure {
                systolic_kpa,
                filling_kpa_per_s,
                filling_per_s,
                middle_per_s,
                rise_per_s,
                fall_per_s,
                on_s,
                off_s,
                switch_s,
            } => {
                finite("systolic_kPa", *systolic_kpa)?;
                finite("filling_kPa_per_s", *filling_kpa_per_s)?;
                finite("filling_per_s", *filling_per_s)?;
                finite("middle_per_s", *middle_per_s)?;
                finite("rise_per_s", *rise_per_s)?;
                finite("fall_per_s", *fall_per_s)?;
                finite("on_s", *on_s)?;
                unless(off_s > on_s, "off_s", *off_s, "a time after on_s")?;
                positive("switch_s", *switch_s)
            }
        }
    }

    /// Right-hand side of the differential equation at `t` \[s\], in kPa/s; `None` for a closed form.
    fn slope(&self, t: f64, y: f64) -> Option<f64> {
        let up = |x: f64, width: f64| 0.5 * (1.0 + (x / width).tanh());
        match *self {
            Self::Activation {
                contractility_kpa,
                rise_per_s,
                fall_per_s,
                on_s,
                off_s,
                switch_s,
            } => {
                let f = up(t - on_s, switch_s) * up(off_s - t, switch_s);
                let a = rise_per_s * f + fall_per_s * (1.0 - f);
                Some(-a.abs() * y + contractility_kpa * a.max(0.0))
            }
            Self::ChamberPressure {
                systolic_kpa,
                filling_kpa_per_s,
                filling_per_s,
                middle_per_s,
                rise_per_s,
                fall_per_s,
                on_s,
                off_s,
                switch_s,
            } => {
                let g = up(off_s - t, switch_s);
                let f = up(t - on_s, switch_s) * g;
                let b = rise_per_s * f + fall_per_s * (1.0 - f) + filling_per_s * g + middle_per_s;
                Some(-b.abs() * y + systolic_kpa * b.max(0.0) + filling_kpa_per_s * g)
            }
            _ => None,
        }
    }
}

impl Course {
    /// Prepares `kind` for times from zero to `end_ms`.
    ///
    /// # Errors
    /// [`TimeCourseError`] for a parameter out of range.
    pub fn new(kind: TimeCourse, end_ms: f64) -> Result<Self, TimeCourseError> {
        kind.check()?;
        let mut samples = vec![];
        if let Some(first) = kind.slope(0.0, 0.0) {
            let h = SPACING_MS * 1e-3 / SUBSTEPS as f64;
            let slope = |t: f64, y: f64| kind.slope(t, y).unwrap_or(0.0);
            let mut y = 0.0;
            samples.push((y, first * 1e-3));
            for k in 0..(end_ms / SPACING_MS).ceil() as usize + 1 {
                for part in 0..SUBSTEPS {
                    // Fourth-order Runge–Kutta steps are short because |a| has a kink.
                    let t = (k * SUBSTEPS + part) as f64 * h;
                    let k1 = slope(t, y);
                    let k2 = slope(t + 0.5 * h, y + 0.5 * h * k1);
                    let k3 = slope(t + 0.5 * h, y + 0.5 * h * k2);
                    let k4 = slope(t + h, y + h * k3);
                    y += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
                }
                samples.push((y, slope((k + 1) as f64 * SPACING_MS * 1e-3, y) * 1e-3));
            }
        }
        Ok(Self { kind, samples })
    }

    /// Value \[kPa\] at `t_ms`.
    #[must_use]
    pub fn at(&self, t_ms: f64) -> f64 {
        match &self.kind {
            TimeCourse::Constant { value_kpa } => *value_kpa,
            TimeCourse::Ramp { value_kpa, until_s } => {
                value_kpa * (t_ms * 1e-3 / until_s).clamp(0.0, 1.0)
            }
            TimeCourse::Table { t_s, value_kpa } => {
                let t = t_ms * 1e-3;
                let next = t_s.partition_point(|x| *x <= t);
                if next == 0 {
                    value_kpa[0]
                } else if next == t_s.len() {
                    value_kpa[next - 1]
                } else {
                    let share = (t - t_s[next - 1]) / (t_s[next] - t_s[next - 1]);
                    value_kpa[next - 1] + share * (value_kpa[next] - value_kpa[next - 1])
                }
            }
            _ => {
                let at = (t_ms / SPACING_MS).clamp(0.0, (self.samples.len() - 1) as f64);
                let k = (at.floor() as usize).min(self.samples.len() - 2);
                let s = at - k as f64;
                let ((y0, m0), (y1, m1)) = (self.samples[k], self.samples[k + 1]);
                let (m0, m1) = (m0 * SPACING_MS, m1 * SPACING_MS);
                let (s2, s3) = (s * s, s * s * s);
                (2.0 * s3 - 3.0 * s2 + 1.0) * y0
                    + (s3 - 2.0 * s2 + s) * m0
                    + (3.0 * s2 - 2.0 * s3) * y1
                    + (s3 - s2) * m1
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The constants of the monoventricular benchmark.
    fn activation() -> TimeCourse {
        TimeCourse::Activation {
            contractility_kpa: 150.0,
            rise_per_s: 5.0,
            fall_per_s: -30.0,
            on_s: 0.16,
            off_s: 0.484,
            switch_s: 0.005,
        }
    }

    fn pressure() -> TimeCourse {
        TimeCourse::ChamberPressure {
            systolic_kpa: 16.0,
            filling_kpa_per_s: 7.0,
            filling_per_s: 5.0,
            middle_per_s: 1.0,
            rise_per_s: 5.0,
            fall_per_s: -30.0,
            on_s: 0.17,
            off_s: 0.484,
            switch_s: 0.005,
        }
    }

    #[test]
    fn active_stress_and_pressure_of_the_benchmark_of_2025_have_its_values() {
        // Values in Pa from an independent integration at tolerance 1e-9.
        let tau = Course::new(activation(), 1000.0).expect("constants");
        for (t, want) in [
            (200.0, 22_703.3),
            (300.0, 72_790.7),
            (400.0, 103_170.2),
            (500.0, 75_741.5),
            (600.0, 3_771.5),
        ] {
            assert!(
                (tau.at(t) * 1e3 - want).abs() < 0.1,
                "{t}: {} {want}",
                tau.at(t)
            );
        }
        let p = Course::new(pressure(), 1000.0).expect("constants");
        for (t, want) in [
            (100.0, 265.21),
            (200.0, 4262.03),
            (300.0, 12_517.3),
            (400.0, 15_265.2),
            (600.0, 590.65),
        ] {
            assert!(
                (p.at(t) * 1e3 - want).abs() < 0.1,
                "{t}: {} {want}",
                p.at(t)
            );
        }
        let peak = (0..10_000)
            .map(|k| tau.at(0.1 * f64::from(k)))
            .fold(0.0, f64::max);
        assert!((peak - 118.106).abs() < 1e-3, "{peak}");
    }

    #[test]
    fn tables_and_ramps_are_straight_and_end_flat() {
        let table = TimeCourse::Table {
            t_s: vec![0.1, 0.2],
            value_kpa: vec![1.0, 3.0],
        };
        let table = Course::new(table, 1000.0).expect("a table");
        assert_eq!(
            [50.0, 100.0, 150.0, 300.0].map(|t| (table.at(t) * 1e9).round() / 1e9),
            [1.0, 1.0, 2.0, 3.0]
        );
        let ramp = Course::new(
            TimeCourse::Ramp {
                value_kpa: 4.0,
                until_s: 0.5,
            },
            1000.0,
        )
        .expect("a ramp");
        assert_eq!([0.0, 250.0, 900.0].map(|t| ramp.at(t)), [0.0, 2.0, 4.0]);
        let bad = Course::new(
            TimeCourse::Table {
                t_s: vec![0.2, 0.1],
                value_kpa: vec![1.0, 3.0],
            },
            1.0,
        );
        assert_eq!(
            bad.expect_err("times fall").to_string(),
            "t_s = 0.1, expected finite times, each after the one before"
        );
    }
}
