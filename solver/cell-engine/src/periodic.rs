//! Whether a beat has returned to its start, and where to start the next one when it has not.

use crate::input::Constants;
use crate::model::{State, active_stress};
use crate::step::{Floors, PEAK_SHARE};
use crate::trace::Node;

/// Largest change between two states, in the norm of the error control.
pub fn change(p: &Constants, floors: &Floors, a: &State, b: &State, low: f64) -> f64 {
    let relative = |x: f64, y: f64, floor: f64| (y - x).abs() / (y.abs() + floor);
    let zeta = |x: f64, y: f64| (y - x + p.a * (b.l - a.l)).abs() / PEAK_SHARE;
    let stiffness = p.a_p * (p.b + 7.0) * p.inv_lambda_0;
    let stress = active_stress::<false>(p, b, low).abs() + floors.sa + 1e-5 * stiffness;
    let terms = [
        relative(a.c, b.c, floors.c),
        relative(a.u, b.u, floors.u),
        relative(a.w, b.w, floors.w),
        relative(a.s, b.s, floors.s),
        zeta(a.z_w, b.z_w),
        zeta(a.z_s, b.z_s),
        (b.l - a.l).abs() * stiffness / stress,
        p.a_p_k * (b.v - a.v).abs() / stress,
    ];
    // Not f64::max, which would pass over a NaN.
    terms
        .into_iter()
        .fold(0.0, |largest, x| if x <= largest { largest } else { x })
}

/// State from which to start the next beat. ζ relaxes at the known rates c over a beat, so its
/// remaining change is known too; C_V then closes the balance of stresses.
pub fn extrapolate(p: &Constants, start: &State, end: &State, low: f64) -> State {
    let ahead = |x: f64, y: f64, rate: f64| x + (y - x) / -(-rate * p.cycle).exp_m1().min(-1e-3);
    let mut next = State {
        z_w: ahead(start.z_w, end.z_w, p.c_w),
        z_s: ahead(start.z_s, end.z_s, p.c_s),
        ..*end
    };
    let strain = next.l * p.inv_lambda_0 - 1.0;
    let spring = p.a_p * (p.b * strain).exp_m1();
    next.v = strain + (active_stress::<false>(p, &next, low) + spring) / p.a_p_k;
    next
}

/// Whether the stress rises again after its maximum, by more than a thousandth of it.
pub fn oscillates(nodes: &[Node]) -> bool {
    let mut peak = 0;
    for (k, node) in nodes.iter().enumerate() {
        if node.sa > nodes[peak].sa {
            peak = k;
        }
    }
    let mut lowest = f64::INFINITY;
    nodes[peak..].iter().any(|node| {
        lowest = lowest.min(node.sa);
        node.sa > lowest + 1e-3 * nodes[peak].sa
    })
}
