//! One RODAS step of every lane, each with its own time, step length and tolerance.

use crate::calcium::SampledCalcium;
use crate::input::{ConstantLanes, Constants};
use crate::lanes::{LANES, lanes};
use crate::model::{
    Eliminated, EliminatedLanes, KINK, Kinks, Slopes, State, StateLanes, linearise, rates,
};
use cardiotwin_models::cell0d::tableau::{A2, A3, A4, A5, C2, C3, C4, C5, C6, D, GAMMA, TIMES};
use cardiotwin_vector_math::{exp, fma, max, min};

/// Largest distance from the kink at which a step counts as ending on it.
pub const ON_KINK: f64 = 1e-6;
/// Length to which a step may grow \[ms\].
const LONGEST_STEP_MS: f64 = 100.0;
/// Share of a quantity's peak that its error is measured against where the quantity itself is small.
pub const PEAK_SHARE: f64 = 0.3;

lanes! {
    /// Time, calcium's two exponentials at that time, and the quantities that steer the step
    /// length.
    Clock, ClockLanes {
        /// Time within the beat \[ms\].
        t,
        /// Slower exponential of calcium, e^(−slow t).
        slow,
        /// Ratio of calcium's exponentials, e^(−gap t).
        fast,
        /// Step to try next \[ms\].
        h,
        /// Largest growth of the step allowed after acceptance: 1 after a refusal.
        growth,
        /// 1 while λ is below the kink of h, else 0.
        low,
        /// Tolerance of this beat.
        tolerance,
        /// 1 while the lane works, else 0.
        running,
    }
}

lanes! {
    /// Expected peaks times [`PEAK_SHARE`]: floors of the error weights.
    Floors, FloorLanes {
        /// Floor of CaTRPN.
        c,
        /// Floor of U.
        u,
        /// Floor of W.
        w,
        /// Floor of S.
        s,
        /// Floor of the active stress \[kPa\].
        sa,
    }
}

/// Outcomes of a step.
pub mod outcome {
    /// The lane is idle.
    pub const IDLE: f64 = 0.0;
    /// The step was accurate, and the lane advanced.
    pub const ACCEPTED: f64 = 1.0;
    /// Refused by the error estimate (or by a number that is not finite).
    pub const REFUSED: f64 = 2.0;
    /// Accurate, but the stretch went beyond the kink: to be repeated with a shorter step.
    pub const CROSSED: f64 = 3.0;
}

lanes! {
    /// Values that the scheduler reads after a step.
    Report, ReportLanes {
        /// One of the constants of [`outcome`].
        outcome,
        /// Time at the start of the step \[ms\].
        t,
        /// Length of the step that was tried \[ms\].
        h,
        /// Active stress at the start \[kPa\].
        sa,
        /// Rate of the active stress at the start \[kPa/ms\].
        dsa,
        /// Stretch at the start.
        l,
        /// Rate of the stretch at the start \[1/ms\].
        dl,
    }
}

/// Everything that the vector code touches.
#[derive(Debug, Clone)]
pub struct Lanes {
    /// Constants of the cells.
    pub constants: ConstantLanes,
    /// Present states of the cells.
    pub state: StateLanes,
    /// States at the end of the step tried last, whatever its outcome.
    pub candidate: StateLanes,
    /// Times and step lengths of the cells.
    pub clock: ClockLanes,
    /// Floors of the cells' error weights.
    pub floors: FloorLanes,
    /// Reports on the last step.
    pub report: ReportLanes,
    /// Memory between the phases of a step.
    pub scratch: Scratch,
}

lanes! {
    /// Values that the stages of a step share.
    Frame, FrameLanes {
        /// Length of the step \[ms\].
        h,
        /// Reciprocal of the step's length \[1/ms\].
        inv_h,
        /// Explicit time derivative of CaTRPN's rate times h.
        drift,
        /// Calcium at the start \[µM\].
        ca_1,
        /// Rate of calcium at the start \[µM/ms\].
        ca_rate,
        /// Calcium at stage 2 \[µM\].
        ca_2,
        /// Calcium at stage 3 \[µM\].
        ca_3,
        /// Calcium at stage 4 \[µM\].
        ca_4,
        /// Calcium at the end \[µM\].
        ca_end,
        /// e^(−slow t) at the end.
        slow_end,
        /// e^(−gap t) at the end.
        fast_end,
        /// dS_p/dλ at the start \[kPa\].
        passive_l,
    }
}

/// Memory between the phases of a step. A step is cut into phases, each a loop over all lanes, because the stages of one
/// lane wait for each other: the second vector's stage runs in the shadow of the first's.
#[derive(Debug, Clone)]
pub struct Scratch {
    frame: FrameLanes,
    matrix: EliminatedLanes,
    k: [StateLanes; 5],
}

impl Scratch {
    /// Scratch memory filled with zeros.
    pub fn new() -> Self {
        Self {
            frame: FrameLanes::filled(&Frame::default()),
            matrix: EliminatedLanes::filled(&Eliminated::default()),
            k: std::array::from_fn(|_| StateLanes::filled(&State::default())),
        }
    }
}

/// Calcium from its two exponentials.
#[inline(always)]
fn calcium<const FMA: bool>(p: &Constants, slow: f64, fast: f64, t: f64) -> f64 {
    fma::<FMA>(
        slow,
        fma::<FMA>(p.ca_limit_scale, t, p.ca_gap_scale * (1.0 - fast)),
        p.ca_res,
    )
}

/// Adds a stage's couplings `k · factor` to the seven rates (the residual has none).
#[inline(always)]
fn couple<const FMA: bool>(r: State, factor: f64, k: &State) -> State {
    State {
        l: r.l,
        ..r.plus::<FMA>(factor, k)
    }
}

/// Largest error in units of its weight.
#[inline(always)]
fn weighted_error<const FMA: bool>(
    e: &State,
    kinks: &Kinks,
    y: &State,
    floors: &Floors,
    sa: f64,
    passive_l: f64,
) -> f64 {
    let d = [
        y.c.abs() + floors.c,
        y.u.abs() + floors.u,
        y.w.abs() + floors.w,
        y.s.abs() + floors.s,
        // An error of λ counts as the stress that it is worth in the passive springs; relative to no less than 1e-5 of
        // stretch, below which nothing depends on it, and to no more than 0.05 in a cell that is all too soft.
        min(sa.abs() + floors.sa + 1e-5 * passive_l, 0.05 * passive_l),
    ];
    // One division for five ratios.
    let (d01, d34) = (d[0] * d[1], d[3] * d[4]);
    let d234 = d[2] * d34;
    let d012 = d01 * d[2];
    let n = [
        e.c.abs() * d[1] * d234,
        e.u.abs() * d[0] * d234,
        (e.w.abs() + kinks.w) * d01 * d34,
        (e.s.abs() + kinks.s) * d012 * d[4],
        fma::<FMA>(e.l.abs(), passive_l, kinks.stress) * d012 * d[3],
    ];
    let largest = max(max(max(n[0], n[1]), max(n[2], n[3])), n[4]);
    largest / (d012 * d34)
}

/// Calcium at the stages, then the rates, the matrix and stage 1 at the start.
#[inline(always)]
fn first_stage<const FMA: bool>(lanes: &mut Lanes, samples: Option<&SampledCalcium>) {
    let Lanes {
        constants,
        state,
        clock,
        scratch: Scratch { frame, matrix, k },
        report,
        ..
    } = lanes;
    for i in 0..LANES {
        let (p, clock) = (constants.get(i), clock.get(i));
        let t = clock.t;
        let left = p.cycle - t;
        // A step that nearly reaches the end is stretched to it.
        let h = if 1.05 * clock.h > left { left } else { clock.h };
        let inv_h = 1.0 / h;
        let (decay, close) = (-p.ca_slow * h, -p.ca_gap * h);
        let (slow_3, fast_3) = (exp::<FMA>(TIMES[2] * decay), exp::<FMA>(TIMES[2] * close));
        let (slow_4, fast_4) = (slow_3 * slow_3 * slow_3, fast_3 * fast_3 * fast_3);
        let (slow_2, fast_2) = (exp::<FMA>(TIMES[1] * decay), exp::<FMA>(TIMES[1] * close));
        let (slow_end, fast_end) = (
            clock.slow * exp::<FMA>(decay),
            clock.fast * exp::<FMA>(close),
        );
        frame.h[i] = h;
        frame.inv_h[i] = inv_h;
        frame.ca_2[i] = calcium::<FMA>(
            &p,
            clock.slow * slow_2,
            clock.fast * fast_2,
            fma::<FMA>(TIMES[1], h, t),
        );
        frame.ca_3[i] = calcium::<FMA>(
            &p,
            clock.slow * slow_3,
            clock.fast * fast_3,
            fma::<FMA>(TIMES[2], h, t),
        );
        frame.ca_4[i] = calcium::<FMA>(
            &p,
            clock.slow * slow_4,
            clock.fast * fast_4,
            fma::<FMA>(TIMES[3], h, t),
        );
        frame.ca_end[i] = calcium::<FMA>(&p, slow_end, fast_end, t + h);
        frame.slow_end[i] = slow_end;
        frame.fast_end[i] = fast_end;
        let ca = calcium::<FMA>(&p, clock.slow, clock.fast, t);
        let inner = fma::<FMA>(p.ca_gap_scale * p.ca_gap, clock.fast, p.ca_limit_scale);
        frame.ca_1[i] = ca;
        frame.ca_rate[i] = fma::<FMA>(clock.slow, inner, -p.ca_slow * (ca - p.ca_res));
    }
    if let Some(samples) = samples {
        for i in 0..LANES {
            let (t, h) = (clock.t[i], frame.h[i]);
            (frame.ca_1[i], frame.ca_rate[i]) = samples.at(t);
            frame.ca_2[i] = samples.at(t + TIMES[1] * h).0;
            frame.ca_3[i] = samples.at(t + TIMES[2] * h).0;
            frame.ca_4[i] = samples.at(t + TIMES[3] * h).0;
            frame.ca_end[i] = samples.at(t + h).0;
        }
    }
    for i in 0..LANES {
        let (p, x, clock) = (constants.get(i), state.get(i), clock.get(i));
        let shift = frame.inv_h[i] * (1.0 / GAMMA);
        let (m, f, Slopes { sa, dsa, dl }, f_t, passive_l) =
            linearise::<FMA>(&p, &x, frame.ca_1[i], frame.ca_rate[i], clock.low, shift);
        let drift = frame.h[i] * f_t;
        frame.drift[i] = drift;
        frame.passive_l[i] = passive_l;
        let r = State {
            c: fma::<FMA>(D[0], drift, f.c),
            ..f
        };
        k[0].set(i, &m.solve::<FMA>(&p, &r));
        matrix.set(i, &m);
        report.sa[i] = sa;
        report.dsa[i] = dsa;
        report.dl[i] = dl;
        report.l[i] = x.l;
        report.t[i] = clock.t;
        report.h[i] = frame.h[i];
    }
}

/// Stages 2 to 4: `A` are the arguments' and `g` the couplings' coefficients on the stages before.
#[inline(always)]
fn middle_stage<const FMA: bool, const BEFORE: usize>(
    lanes: &mut Lanes,
    a: [f64; BEFORE],
    g: [f64; BEFORE],
    d: f64,
    ca: impl Fn(&FrameLanes) -> &[f64; LANES],
) {
    let Lanes {
        constants,
        state,
        clock,
        scratch: Scratch { frame, matrix, k },
        ..
    } = lanes;
    let (before, now) = k.split_at_mut(BEFORE);
    let ca = ca(frame);
    for (i, &ca) in ca.iter().enumerate() {
        let p = constants.get(i);
        let inv_h = frame.inv_h[i];
        let mut y = state.get(i);
        for j in 0..BEFORE {
            y = y.plus::<FMA>(a[j], &before[j].get(i));
        }
        let mut r = rates::<FMA>(&p, &y, ca, clock.low[i]);
        r.c = fma::<FMA>(d, frame.drift[i], r.c);
        for j in 0..BEFORE {
            r = couple::<FMA>(r, g[j] * inv_h, &before[j].get(i));
        }
        now[0].set(i, &matrix.get(i).solve::<FMA>(&p, &r));
    }
}

/// Stages 5 and 6 stand at the end of the step; the error estimate is the last.
#[inline(always)]
fn fifth_stage<const FMA: bool>(lanes: &mut Lanes) {
    let Lanes {
        constants,
        state,
        clock,
        candidate,
        scratch: Scratch { frame, matrix, k },
        ..
    } = lanes;
    let (before, now) = k.split_at_mut(4);
    for i in 0..LANES {
        let p = constants.get(i);
        let inv_h = frame.inv_h[i];
        let mut y = state.get(i);
        for j in 0..4 {
            y = y.plus::<FMA>(A5[j], &before[j].get(i));
        }
        let mut r = rates::<FMA>(&p, &y, frame.ca_end[i], clock.low[i]);
        for j in 0..4 {
            r = couple::<FMA>(r, C5[j] * inv_h, &before[j].get(i));
        }
        let k5 = matrix.get(i).solve::<FMA>(&p, &r);
        now[0].set(i, &k5);
        candidate.set(i, &y.add(&k5));
    }
}

/// Stage 6, the error, and what follows from it.
#[inline(always)]
fn last_stage<const FMA: bool>(lanes: &mut Lanes) {
    let Lanes {
        constants,
        state,
        clock,
        candidate,
        floors,
        report,
        scratch: Scratch { frame, matrix, k },
    } = lanes;
    for i in 0..LANES {
        let p = constants.get(i);
        let (clock_now, inv_h) = (clock.get(i), frame.inv_h[i]);
        let low = clock_now.low;
        let y = candidate.get(i);
        let mut r = rates::<FMA>(&p, &y, frame.ca_end[i], low);
        for j in 0..5 {
            r = couple::<FMA>(r, C6[j] * inv_h, &k[j].get(i));
        }
        let k6 = matrix.get(i).solve::<FMA>(&p, &r);
        let x = state.get(i);
        let y = y.add(&k6);
        candidate.set(i, &y);

        let h = frame.h[i];
        let kinks = Kinks::between::<FMA>(&p, &x, &y, h);
        let error = weighted_error::<FMA>(
            &k6,
            &kinks,
            &y,
            &floors.get(i),
            report.sa[i],
            frame.passive_l[i],
        );
        let error = error / clock_now.tolerance;
        // A number that is not finite fails this comparison too.
        let accurate = error <= 1.0;
        let beyond = |l: f64| if low > 0.5 { l - KINK } else { KINK - l };
        // A lane that was turned a little early comes from beyond: only going further counts.
        let crossed = beyond(y.l) > max(beyond(x.l), ON_KINK);
        let outcome = if crossed {
            outcome::CROSSED
        } else {
            outcome::ACCEPTED
        };
        let outcome = if accurate { outcome } else { outcome::REFUSED };
        let outcome = if clock_now.running > 0.5 {
            outcome
        } else {
            outcome::IDLE
        };
        let commit = outcome == outcome::ACCEPTED;

        // The estimate is of order 4 in h: next step by its fourth root, between a fifth and the allowed growth.
        let bounded = max(if error < 1e8 { error } else { 1e8 }, 1e-8);
        let wanted = 0.9 / bounded.sqrt().sqrt();
        let factor = min(
            max(wanted, 0.2),
            if accurate { clock_now.growth } else { 1.0 },
        );
        let h_next = min(h * factor, LONGEST_STEP_MS);
        let next = Clock {
            t: if commit { clock_now.t + h } else { clock_now.t },
            slow: if commit {
                frame.slow_end[i]
            } else {
                clock_now.slow
            },
            fast: if commit {
                frame.fast_end[i]
            } else {
                clock_now.fast
            },
            // An idle lane keeps its step: it must not shrink until arithmetic becomes slow.
            h: if clock_now.running > 0.5 {
                h_next
            } else {
                clock_now.h
            },
            growth: if accurate { 5.0 } else { 1.0 },
            ..clock_now
        };
        state.set(i, &choose(commit, &y, &x));
        clock.set(i, &next);
        report.outcome[i] = outcome;
    }
}

#[inline(always)]
fn choose(take: bool, new: &State, old: &State) -> State {
    State {
        c: if take { new.c } else { old.c },
        u: if take { new.u } else { old.u },
        w: if take { new.w } else { old.w },
        s: if take { new.s } else { old.s },
        z_w: if take { new.z_w } else { old.z_w },
        z_s: if take { new.z_s } else { old.z_s },
        v: if take { new.v } else { old.v },
        l: if take { new.l } else { old.l },
    }
}

/// Tries one step in every lane, with Rice's calcium of each cell or the same samples for all.
#[inline(always)]
pub fn step<const FMA: bool>(lanes: &mut Lanes, samples: Option<&SampledCalcium>) {
    first_stage::<FMA>(lanes, samples);
    middle_stage::<FMA, 1>(lanes, A2, C2, D[1], |f| &f.ca_2);
    middle_stage::<FMA, 2>(lanes, A3, C3, D[2], |f| &f.ca_3);
    middle_stage::<FMA, 3>(lanes, A4, C4, D[3], |f| &f.ca_4);
    fifth_stage::<FMA>(lanes);
    last_stage::<FMA>(lanes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{CellInput, DEFAULT_PARAMETERS, NegativeKwu};
    use crate::model::active_stress;
    use crate::schedule::Slots;

    /// From rest through the upstroke: finely to 20 ms, past the transients of the start, then `n` steps to 45 ms.
    fn integrate(n: usize) -> (State, f64) {
        let mut parameters = DEFAULT_PARAMETERS;
        // A slow k_U: the default's stiffness hides the order at steps that are worth taking (3.3 at 0.5 ms, 3.5 at 0.25).
        (parameters[3], parameters[21]) = (0.03, 42.0);
        let p = CellInput::new(parameters, 1000.0, 1.1)
            .constants(NegativeKwu::Refuse)
            .unwrap();
        let mut lanes = Slots::new().into_lanes();
        lanes.constants = ConstantLanes::filled(&p);
        let l = 1.1;
        let rest = State {
            c: 0.07,
            u: 1e-4,
            w: 1e-4,
            s: 1e-4,
            z_w: -p.a * l,
            z_s: -p.a * l,
            v: 0.0,
            l,
        };
        let v = rest.v + active_stress::<true>(&p, &rest, 0.0) / p.a_p_k;
        lanes.state = StateLanes::filled(&State { v, ..rest });
        let clock = Clock {
            t: 0.0,
            slow: 1.0,
            fast: 1.0,
            h: 0.0,
            growth: 1.0,
            low: 0.0,
            tolerance: 1e30,
            running: 1.0,
        };
        lanes.clock = ClockLanes::filled(&clock);
        for h in std::iter::repeat_n(0.01, 2000).chain(std::iter::repeat_n(25.0 / n as f64, n)) {
            lanes.clock.h = [h; LANES];
            step::<true>(&mut lanes, None);
            assert!(lanes.report.outcome.iter().all(|&o| o == outcome::ACCEPTED));
        }
        assert!((lanes.clock.t[0] - 45.0).abs() < 1e-9);
        let x = lanes.state.get(0);
        (x, active_stress::<true>(&p, &x, 0.0))
    }

    #[test]
    fn fourth_order_in_states_and_stretch() {
        // Here the shortening cell meets no kink.
        let (exact, exact_sa) = integrate(4000);
        assert!(exact_sa > 0.1 && exact.l > 0.95 && exact.l < 1.0999);
        let error = |n: usize| {
            let x = integrate(n).0;
            let differences = [
                x.c - exact.c,
                x.u - exact.u,
                x.w - exact.w,
                x.s - exact.s,
                x.l - exact.l,
            ];
            differences.iter().fold(0.0, |m: f64, e| m.max(e.abs()))
        };
        let errors = [error(5), error(10), error(20)];
        let orders = [
            (errors[0] / errors[1]).log2(),
            (errors[1] / errors[2]).log2(),
        ];
        assert!(
            orders.iter().all(|o| (o - 4.0).abs() < 0.2),
            "errors {errors:?}, orders {orders:?}"
        );
    }
}
