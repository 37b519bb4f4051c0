//! Three-element Windkessel fitted to two or three cuff pressures, with a given flow.
//!
//! The pressure is `R (s Q + (1 − s) y)`, where R = R1 + R2, s = R1/R and y is the periodic
//! solution of `τ dy/dt = Q − y` with τ = R2 C. Systolic, diastolic and mean pressure determine R,
//! τ and s. Without the mean, s takes its usual value, and the uncertainty of that value enters the
//! other results.

use cardiotwin_vocabulary::circulation::CuffPressures;

use super::AfterloadError;

/// R1 over R2 if no measurement separates them, our value. In 18 people without heart disease it is
/// 4.1 % (47 over 1137 dyn s/cm⁵: Murgo et al. 1980, Circulation 62:105, abstract).
pub const USUAL_SHARE: f64 = 0.06;
/// Standard deviation of that share.
const SHARE_SD: f64 = 0.02;
/// Range of shares in the search.
const SHARES: (f64, f64) = (0.005, 0.35);
/// Range of time constants in the search, ms.
const TAU_MS: (f64, f64) = (50.0, 50_000.0);
/// Standard deviation of a cuff pressure if none is stated, mmHg.
pub const CUFF_SD_MMHG: f64 = 4.0;
/// Relative standard deviation of the magnitude of the flow.
const FLOW_SD: f64 = 0.08;

/// Three-element Windkessel that reproduces the cuff pressures.
#[derive(Debug, Clone, PartialEq)]
pub struct CuffFit {
    /// R1, R2 (mmHg s/mL), C (mL/mmHg), R2 C (s).
    pub values: [f64; 4],
    /// Standard deviations of `values`, due to the cuff, the magnitude of the flow and, if it was
    /// assumed, R1's share.
    pub sd: [f64; 4],
    /// Whether R1 is the usual share of R2, because no mean pressure was given or none of the
    /// shares in the search fits it.
    pub assumed_share: bool,
    /// Pressure of the load at the samples of the flow, mmHg.
    pub pressure_mmhg: Vec<f64>,
    /// Mean flow over the beat \[mL/s\].
    pub mean_flow_ml_per_s: f64,
}

/// Finds the three elements that reproduce the cuff pressures.
///
/// - `flow_ml_per_s`: one cycle of flow out of the heart, samples `step_ms` apart
/// - `cuff`: its standard deviation is [`CUFF_SD_MMHG`] if it states none
///
/// # Errors
/// [`AfterloadError`] if the flow does not eject, the pressures are out of order, or no load has
/// these pressures with this flow. Verified by `a_cuff_gives_back_the_load_it_was_taken_from`.
pub fn fit_cuff(
    flow_ml_per_s: &[f64],
    step_ms: f64,
    cuff: CuffPressures,
) -> Result<CuffFit, AfterloadError> {
    let in_order = cuff.diastolic_mmhg > 0.0
        && cuff.systolic_mmhg > cuff.diastolic_mmhg
        && cuff.systolic_mmhg.is_finite();
    let between = cuff
        .mean_mmhg
        .is_none_or(|mean| mean > cuff.diastolic_mmhg && mean < cuff.systolic_mmhg);
    if !in_order || !between {
        return Err(AfterloadError::Cuff {
            systolic_mmhg: cuff.systolic_mmhg,
            diastolic_mmhg: cuff.diastolic_mmhg,
            mean_mmhg: cuff.mean_mmhg,
        });
    }
    let n = flow_ml_per_s.len();
    let mean_flow = flow_ml_per_s.iter().sum::<f64>() / n.max(1) as f64;
    let highest = flow_ml_per_s
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    if n < 8 || !(mean_flow > 0.0 && highest > 2.0 * mean_flow) {
        let lowest = flow_ml_per_s.iter().copied().fold(f64::INFINITY, f64::min);
        return Err(AfterloadError::NoEjection {
            lowest_ml_per_s: lowest,
            highest_ml_per_s: highest,
        });
    }
    let problem = Problem {
        flow: flow_ml_per_s,
        step_ms,
        mean_flow,
    };
    let refused = || AfterloadError::NoLoad {
        systolic_mmhg: cuff.systolic_mmhg,
        diastolic_mmhg: cuff.diastolic_mmhg,
    };
    let with_mean = cuff
        .mean_mmhg
        .and_then(|mean| problem.with_mean(cuff.systolic_mmhg, cuff.diastolic_mmhg, mean));
    let assumed_share = with_mean.is_none();
    let usual = USUAL_SHARE / (1.0 + USUAL_SHARE);
    let solve =
        |systolic: f64, diastolic: f64, mean: Option<f64>, share: f64| -> Option<[f64; 3]> {
            match mean.filter(|_| !assumed_share) {
                Some(mean) => problem.with_mean(systolic, diastolic, mean),
                None => problem.with_share(systolic, diastolic, share),
            }
        };
    let (systolic, diastolic, mean) = (cuff.systolic_mmhg, cuff.diastolic_mmhg, cuff.mean_mmhg);
    let best = solve(systolic, diastolic, mean, usual).ok_or_else(refused)?;
    let values = elements(best);
    let sd_mmhg = cuff.sd_mmhg.unwrap_or(CUFF_SD_MMHG);
    // Half a standard deviation to either side keeps the pressures in order in almost all cases.
    let h = 0.5;
    let moved = |d: [f64; 4]| {
        let share = usual + d[3] * SHARE_SD;
        let mean = mean.map(|m| m + d[2] * sd_mmhg);
        solve(
            systolic + d[0] * sd_mmhg,
            diastolic + d[1] * sd_mmhg,
            mean,
            share,
        )
        .map(elements)
    };
    let mut variance = [0.0; 4];
    let n_uncertain = if assumed_share {
        [true, true, false, true]
    } else {
        [true, true, true, false]
    };
    for k in (0..4).filter(|k| n_uncertain[*k]) {
        let (mut up, mut down) = ([0.0; 4], [0.0; 4]);
        (up[k], down[k]) = (h, -h);
        let up = moved(up).unwrap_or(values);
        let down = moved(down).unwrap_or(values);
        (0..4).for_each(|i| variance[i] += ((up[i] - down[i]) / (2.0 * h)).powi(2));
    }
    // A larger flow divides both resistances and multiplies the compliance; their product does not
    // change.
    (0..3).for_each(|i| variance[i] += (FLOW_SD * values[i]).powi(2));
    Ok(CuffFit {
        values,
        sd: variance.map(f64::sqrt),
        assumed_share,
        pressure_mmhg: problem.pressure(best),
        mean_flow_ml_per_s: mean_flow,
    })
}

/// Converts R, s and τ in ms to R1, R2, C and τ in s.
fn elements([total, share, tau_ms]: [f64; 3]) -> [f64; 4] {
    let (r1, r2) = (share * total, (1.0 - share) * total);
    [r1, r2, tau_ms * 1e-3 / r2, tau_ms * 1e-3]
}

struct Problem<'a> {
    flow: &'a [f64],
    step_ms: f64,
    mean_flow: f64,
}

impl Problem<'_> {
    /// Periodic solution of `τ dy/dt = Q − y` for a flow that is constant over each step.
    fn response(&self, tau_ms: f64) -> Vec<f64> {
        let decay = (-self.step_ms / tau_ms).exp();
        let run = |start: f64| -> Vec<f64> {
            let mut y = start;
            self.flow
                .iter()
                .map(|q| {
                    y = decay * y + (1.0 - decay) * q;
                    y
                })
                .collect()
        };
        let from_zero = run(0.0)[self.flow.len() - 1];
        run(from_zero / (1.0 - decay.powi(self.flow.len() as i32)))
    }

    fn pressure(&self, [total, share, tau_ms]: [f64; 3]) -> Vec<f64> {
        self.flow
            .iter()
            .zip(self.response(tau_ms))
            .map(|(q, y)| total * (share * q + (1.0 - share) * y))
            .collect()
    }

    fn extremes(&self, share: f64, tau_ms: f64) -> (f64, f64) {
        let p = self.pressure([1.0, share, tau_ms]);
        p.iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| {
                (l.min(*p), h.max(*p))
            })
    }

    /// R and τ for a given share. The ratio of highest to lowest pressure falls with τ.
    fn with_share(&self, systolic: f64, diastolic: f64, share: f64) -> Option<[f64; 3]> {
        let wanted = systolic / diastolic;
        let ratio = |log_tau: f64| {
            let (low, high) = self.extremes(share, log_tau.exp());
            if low > 0.0 { high / low } else { f64::INFINITY }
        };
        let tau_ms = bisect(TAU_MS.0.ln(), TAU_MS.1.ln(), |x| wanted - ratio(x))?.exp();
        Some([diastolic / self.extremes(share, tau_ms).0, share, tau_ms])
    }

    /// R from the mean pressure, then the share at which the τ of the diastolic pressure also gives
    /// the systolic one.
    fn with_mean(&self, systolic: f64, diastolic: f64, mean: f64) -> Option<[f64; 3]> {
        let total = mean / self.mean_flow;
        let tau_of = |share: f64| {
            bisect(TAU_MS.0.ln(), TAU_MS.1.ln(), |x| {
                total * self.extremes(share, x.exp()).0 - diastolic
            })
            .map(f64::exp)
        };
        let missed = |share: f64| {
            let tau_ms = tau_of(share).unwrap_or(TAU_MS.1);
            total * self.extremes(share, tau_ms).1 - systolic
        };
        let share = bisect(SHARES.0, SHARES.1, missed)?;
        Some([total, share, tau_of(share)?])
    }
}

/// Root of a rising function; `None` if it does not change its sign.
fn bisect(low: f64, high: f64, f: impl Fn(f64) -> f64) -> Option<f64> {
    let (mut low, mut high) = (low, high);
    if !(f(low) <= 0.0 && f(high) >= 0.0) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if f(middle) <= 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow() -> Vec<f64> {
        (0..800)
            .map(|t| {
                let x = (f64::from(t) - 60.0) / 280.0;
                if (0.0..1.0).contains(&x) {
                    1500.0 * x.powf(0.9) * (1.0 - x).powf(1.6)
                } else {
                    0.0
                }
            })
            .collect()
    }

    fn cuff_of(three: [f64; 3]) -> CuffPressures {
        let flow = flow();
        let mean_flow = flow.iter().sum::<f64>() / 800.0;
        let p = Problem {
            flow: &flow,
            step_ms: 1.0,
            mean_flow,
        }
        .pressure(three);
        let (low, high) = p
            .iter()
            .fold((f64::MAX, 0.0_f64), |(l, h), p| (l.min(*p), h.max(*p)));
        let mean = p.iter().sum::<f64>() / 800.0;
        CuffPressures {
            systolic_mmhg: high,
            diastolic_mmhg: low,
            mean_mmhg: Some(mean),
            sd_mmhg: Some(3.0),
        }
    }

    #[test]
    fn a_cuff_gives_back_the_load_it_was_taken_from() {
        for (r1, r2, c) in [(0.05, 0.9, 1.6), (0.12, 1.4, 0.9), (0.03, 0.7, 2.4)] {
            let cuff = cuff_of([r1 + r2, r1 / (r1 + r2), 1e3 * r2 * c]);
            let fit = fit_cuff(&flow(), 1.0, cuff).unwrap();
            assert!(!fit.assumed_share);
            for (found, made) in fit.values.iter().zip([r1, r2, c, r2 * c]) {
                assert!((found / made - 1.0).abs() < 1e-3, "{:?}", fit.values);
            }
            assert!(
                fit.sd
                    .iter()
                    .zip(fit.values)
                    .all(|(sd, v)| *sd > 0.0 && *sd < 1.5 * v),
                "{fit:?}"
            );
        }
    }

    #[test]
    fn without_a_mean_the_share_is_the_usual_one() {
        let share = USUAL_SHARE / (1.0 + USUAL_SHARE);
        let cuff = CuffPressures {
            mean_mmhg: None,
            ..cuff_of([1.0, share, 1400.0])
        };
        let fit = fit_cuff(&flow(), 1.0, cuff).unwrap();
        assert!(fit.assumed_share);
        assert!(
            (fit.values[1] - (1.0 - share)).abs() < 1e-4 && (fit.values[3] - 1.4).abs() < 1e-3,
            "{fit:?}"
        );
        let (low, high) = fit
            .pressure_mmhg
            .iter()
            .fold((f64::MAX, 0.0_f64), |(l, h), p| (l.min(*p), h.max(*p)));
        assert!(
            (low - cuff.diastolic_mmhg).abs() < 1e-3 && (high - cuff.systolic_mmhg).abs() < 1e-3
        );
    }

    #[test]
    fn nonsense_is_refused() {
        let cuff = |systolic_mmhg, diastolic_mmhg, mean_mmhg| CuffPressures {
            systolic_mmhg,
            diastolic_mmhg,
            mean_mmhg,
            sd_mmhg: None,
        };
        assert!(matches!(
            fit_cuff(&flow(), 1.0, cuff(60.0, 70.0, None)),
            Err(AfterloadError::Cuff { .. })
        ));
        assert!(matches!(
            fit_cuff(&flow(), 1.0, cuff(120.0, 70.0, Some(130.0))),
            Err(AfterloadError::Cuff { .. })
        ));
        assert!(matches!(
            fit_cuff(&[5.0; 800], 1.0, cuff(120.0, 70.0, None)),
            Err(AfterloadError::NoEjection { .. })
        ));
        assert!(matches!(
            fit_cuff(&flow(), 1.0, cuff(70.2, 70.0, None)),
            Err(AfterloadError::NoLoad { .. })
        ));
    }
}
