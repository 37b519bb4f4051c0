//! Start of a cell, in static equilibrium with the calcium of the time at which it starts; and the
//! expected size of its states, which is their equilibrium at peak calcium.

use crate::input::{ConstantLanes, Constants};
use crate::lanes::{LANES, lanes};
use crate::model::{KINK, State, StateLanes, overlap};
use crate::step::{FloorLanes, Floors, PEAK_SHARE};
use cardiotwin_models::contraction::land2017::equations::LEAST_OCCUPANCY;
use cardiotwin_vector_math::{Lane, Number as _, exp, fma, max, min};

/// Steps of the bracketing root search. The start needs to be near, not exact: C_V closes the balance.
const SEARCH_STEPS: usize = 10;

/// Smallest floor of an error weight: a cell whose stress stays below some 1e-15 kPa is inert, and products of weights
/// must not vanish.
const INERT: f64 = 1e-18;

lanes! {
    /// Values that the preparation reads next to the constants.
    StartTime, StartTimeLanes {
        /// Time within the beat at which the cell starts \[ms\].
        t,
        /// Calcium at that time \[µM\].
        ca,
    }
}

/// Results of the preparation.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// States in static equilibrium, from which the cells start.
    pub state: StateLanes,
    /// Floors of the error weights, from the states at peak calcium.
    pub floors: FloorLanes,
}

/// CaTRPN, U, W, S in equilibrium with calcium at a fixed stretch, ζ = 0, C_V = C; and the unbalanced stress.
#[inline(always)]
fn isometric<const FMA: bool>(p: &Constants, ca: f64, l: f64) -> (State, f64, f64) {
    let (land, one) = (p.land(), Lane::<FMA>(1.0));
    let Lane(bound) = land.binding(Lane::<FMA>(ca).ln_ratio(Lane(p.ca50::<FMA>(l))));
    let c = bound / (1.0 + bound);
    let (_, Lane(power)) = land.blocking(Lane::<FMA>(max(c, LEAST_OCCUPANCY)).ln_ratio(one));
    let w_per_u = p.k_uw / (p.k_wu + p.k_ws);
    let s_per_u = w_per_u * p.k_ws / p.k_su;
    let blocked_per_u = p.k_b / (p.k_u * power * power);
    let u = 1.0 / (1.0 + w_per_u + s_per_u + blocked_per_u);
    let strain = fma::<FMA>(l, p.inv_lambda_0, -1.0);
    let s = s_per_u * u;
    let low = if l < KINK { 1.0 } else { 0.0 };
    let stress = overlap::<FMA>(p, l, low) * p.s_scale * s;
    let spring = p.a_p * (exp::<FMA>(p.b * strain) - 1.0);
    (
        State {
            c,
            u,
            w: w_per_u * u,
            s,
            z_w: -p.a * l,
            z_s: -p.a * l,
            v: strain,
            l,
        },
        stress,
        spring,
    )
}

lanes! {
    /// A bracket of the root and the function at its ends.
    Bracket, BracketLanes {
        /// Stretch at the lower end.
        low,
        /// Stretch at the upper end.
        high,
        /// Unbalanced stress at the lower end \[kPa\], not positive.
        f_low,
        /// Unbalanced stress at the upper end \[kPa\], positive.
        f_high,
        /// Side of the last point: −1 or 1.
        last,
    }
}

impl Bracket {
    /// Where nothing overlaps, the unbalanced stress is not positive; at λ₀ it is the active stress.
    #[inline(always)]
    fn new<const FMA: bool>(p: &Constants, ca: f64) -> Self {
        let beta = max(p.beta_0, 1e-3);
        let bare = if beta > 1.0 / 0.13 {
            1.0 - 1.0 / beta
        } else {
            0.5 * (1.87 - 1.0 / beta)
        };
        let low = min(max(bare, 0.1 * p.lambda_0), p.lambda_0);
        let (_, stress, spring) = isometric::<FMA>(p, ca, low);
        let f_low = min(stress + spring, 0.0);
        let (_, stress, spring) = isometric::<FMA>(p, ca, p.lambda_0);
        Self {
            low,
            high: p.lambda_0,
            f_low,
            f_high: max(stress + spring, 1e-300),
            last: 0.0,
        }
    }

    /// Stretch at which the secant meets zero, within the bracket.
    #[inline(always)]
    fn secant(&self) -> f64 {
        let x = self.low + (self.high - self.low) * (self.f_low / (self.f_low - self.f_high));
        min(max(x, self.low), self.high)
    }

    /// One step of Anderson and Björck: a secant that scales an end which stays for the second time, so that both move.
    #[inline(always)]
    fn narrowed<const FMA: bool>(&self, p: &Constants, ca: f64) -> Self {
        let x = self.secant();
        let (_, stress, spring) = isometric::<FMA>(p, ca, x);
        let f = stress + spring;
        let above = f > 0.0;
        let side = if above { 1.0 } else { -1.0 };
        let shrink = 1.0 - f / if above { self.f_high } else { self.f_low };
        let shrink = if shrink > 0.0 { shrink } else { 0.5 };
        let shrink = if side == self.last { shrink } else { 1.0 };
        Self {
            low: if above { self.low } else { x },
            high: if above { x } else { self.high },
            f_low: if above { self.f_low * shrink } else { f },
            f_high: if above { f } else { self.f_high * shrink },
            last: side,
        }
    }
}

/// Static equilibrium of every lane at calcium `ca`: the sum of active and elastic stress grows with λ.
#[inline(always)]
fn equilibria<const FMA: bool>(constants: &ConstantLanes, ca: &[f64; LANES]) -> BracketLanes {
    let mut brackets = BracketLanes::filled(&Bracket::default());
    for (i, &ca) in ca.iter().enumerate() {
        brackets.set(i, &Bracket::new::<FMA>(&constants.get(i), ca));
    }
    for _ in 0..SEARCH_STEPS {
        for (i, &ca) in ca.iter().enumerate() {
            let narrowed = brackets.get(i).narrowed::<FMA>(&constants.get(i), ca);
            brackets.set(i, &narrowed);
        }
    }
    brackets
}

/// Computes the starting state and the error floors of every lane.
#[inline(always)]
pub fn prepare<const FMA: bool>(
    constants: &ConstantLanes,
    start: &StartTimeLanes,
    prepared: &mut Prepared,
) {
    let rest = equilibria::<FMA>(constants, &start.ca);
    let peak = equilibria::<FMA>(constants, &constants.ca_max);
    for i in 0..LANES {
        let p = constants.get(i);
        let (state, stress, spring) = isometric::<FMA>(&p, start.ca[i], rest.get(i).secant());
        // C_V closes what the search has left open.
        let v = fma::<FMA>(state.l, p.inv_lambda_0, -1.0) + (stress + spring) / p.a_p_k;
        prepared.state.set(i, &State { v, ..state });
        let (peak, stress, _) = isometric::<FMA>(&p, p.ca_max, peak.get(i).secant());
        let floors = Floors {
            c: max(PEAK_SHARE * peak.c, INERT),
            u: max(PEAK_SHARE * peak.u, INERT),
            w: max(PEAK_SHARE * peak.w, INERT),
            s: max(PEAK_SHARE * peak.s, INERT),
            sa: max(PEAK_SHARE * stress, INERT),
        };
        prepared.floors.set(i, &floors);
    }
}
