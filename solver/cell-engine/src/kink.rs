//! Steps that end on the kink of h at λ = 0.87, where dλ/dt jumps.

use crate::input::Constants;
use crate::job::Job;
use crate::model::{KINK, Slopes, State, linearise};
use crate::step::Lanes;
use crate::trace::Node;

/// A kink nearer than this \[ms\] is passed where the lane stands.
const SHORTEST_AIM_MS: f64 = 1e-3;

/// Stress, stretch rates at a state, for a single lane.
pub fn slopes(p: &Constants, x: &State, low: f64) -> Slopes {
    // None of the three depends on calcium.
    linearise::<false>(p, x, p.ca_res, 0.0, low, 1.0).2
}

/// The lane stands on the kink: when it is about to leave its side, the other side's slope of h takes over.
pub fn turn_at_kink(lanes: &mut Lanes, job: &mut Job, i: usize) {
    let (p, x, low) = (
        lanes.constants.get(i),
        lanes.state.get(i),
        lanes.clock.low[i],
    );
    let here = slopes(&p, &x, low);
    if (low > 0.5) == (here.dl > 0.0) {
        turn(lanes, job, i, Node::new(lanes.clock.t[i], x.l, &here));
    }
}

/// Changes sides; `node` ends the old side's curve.
fn turn(lanes: &mut Lanes, job: &mut Job, i: usize, node: Node) {
    if job.record {
        job.nodes.push(node);
    }
    lanes.clock.low[i] = 1.0 - lanes.clock.low[i];
    lanes.clock.growth[i] = 1.0;
    if job.resume_h > 0.0 {
        lanes.clock.h[i] = job.resume_h;
        job.resume_h = 0.0;
    }
}

/// The lane's accurate step went across the kink: the next try ends where its cubic meets it.
pub fn aim_at_kink(lanes: &mut Lanes, job: &mut Job, i: usize) {
    let (p, y, low) = (
        lanes.constants.get(i),
        lanes.candidate.get(i),
        lanes.clock.low[i],
    );
    let r = lanes.report.get(i);
    let (d0, d1) = (r.h * r.dl, r.h * slopes(&p, &y, low).dl);
    let (c2, c3) = (
        3.0 * (y.l - r.l) - 2.0 * d0 - d1,
        d0 + d1 - 2.0 * (y.l - r.l),
    );
    let sign = if low > 0.5 { 1.0 } else { -1.0 };
    let beyond = |s: f64| sign * (r.l + s * (d0 + s * (c2 + s * c3)) - KINK);
    let (mut before, mut after) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (before + after);
        if beyond(middle) > 0.0 {
            after = middle;
        } else {
            before = middle;
        }
    }
    if job.resume_h == 0.0 {
        job.resume_h = r.h;
    }
    if before * r.h < SHORTEST_AIM_MS {
        // The kink is here, to within what the residual of the balance moves λ by in a step of any length.
        turn(
            lanes,
            job,
            i,
            Node {
                t: r.t,
                sa: r.sa,
                dsa: r.dsa,
                l: r.l,
                dl: r.dl,
            },
        );
    } else {
        lanes.clock.h[i] = before * r.h;
    }
}
