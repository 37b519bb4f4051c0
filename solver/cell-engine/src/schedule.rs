//! Decisions on each lane between steps: nodes, kinks, ends of beats, periodicity, the next cell.
//!
//! ```text
//! input ─ refused ───────────────────────────────────────────► output
//!   └─ run-in (coarse, from static equilibrium) ─► beat ─┬─► periodic, hopeless, stuck
//!                                                  ▲     │
//!                                                  └─────┘ not yet periodic: slow modes extrapolated
//! ```

use crate::biomarkers::{CellReading, Penalty, calcium_penalty, of_segments};
use crate::calcium::{SampledCalcium, Transient};
use crate::dispatch::{Available, prepare_lanes, step_lanes};
use crate::input::{CellInput, ConstantLanes, Constants, DEFAULT_PARAMETERS, NegativeKwu, at};
use crate::job::{Job, Phase};
use crate::kink::{aim_at_kink, slopes, turn_at_kink};
use crate::lanes::LANES;
use crate::model::{KINK, State, StateLanes};
use crate::output::{CellOutput, CellStatus, CellTrace, CostBound};
use crate::periodic::{change, extrapolate, oscillates};
use crate::settings::EngineSettings;
use crate::start::{Prepared, StartTime, StartTimeLanes};
use crate::step::{
    Clock, ClockLanes, FloorLanes, Floors, Lanes, ON_KINK, Report, ReportLanes, Scratch, outcome,
};
use crate::trace::{Node, Segment, sample, segments};

/// A step this short \[ms\] means that the cell cannot be integrated.
const SHORTEST_STEP_MS: f64 = 1e-7;

/// Cells whose start is prepared and that wait for a lane.
#[derive(Debug, Clone)]
struct Waiting {
    constants: ConstantLanes,
    start: StartTimeLanes,
    prepared: Prepared,
    input: [usize; LANES],
    n: usize,
    next: usize,
}

/// Memory of a run.
#[derive(Debug, Clone)]
pub struct Slots {
    lanes: Lanes,
    jobs: [Job; LANES],
    waiting: Waiting,
    /// The beat that is being reported.
    segments: Vec<Segment>,
}

impl Slots {
    /// Lanes that hold a harmless cell each.
    pub fn new() -> Box<Self> {
        let cell = CellInput::new(DEFAULT_PARAMETERS, 1000.0, 1.0);
        let constants = cell.constants(NegativeKwu::Keep).unwrap_or_default();
        let clock = Clock {
            slow: 1.0,
            fast: 1.0,
            h: 1.0,
            growth: 1.0,
            tolerance: 1.0,
            ..Clock::default()
        };
        let floors = Floors {
            c: 1.0,
            u: 1.0,
            w: 1.0,
            s: 1.0,
            sa: 1.0,
        };
        let state = State {
            c: 0.1,
            l: 1.0,
            z_w: -constants.a,
            z_s: -constants.a,
            ..State::default()
        };
        Box::new(Self {
            lanes: Lanes {
                constants: ConstantLanes::filled(&constants),
                state: StateLanes::filled(&state),
                candidate: StateLanes::filled(&state),
                clock: ClockLanes::filled(&clock),
                floors: FloorLanes::filled(&floors),
                report: ReportLanes::filled(&Report::default()),
                scratch: Scratch::new(),
            },
            jobs: std::array::from_fn(|_| Job::default()),
            waiting: Waiting {
                constants: ConstantLanes::filled(&constants),
                start: StartTimeLanes::filled(&StartTime {
                    t: 0.0,
                    ca: constants.ca_res,
                }),
                prepared: Prepared {
                    state: StateLanes::filled(&state),
                    floors: FloorLanes::filled(&floors),
                },
                input: [0; LANES],
                n: 0,
                next: 0,
            },
            segments: Vec::new(),
        })
    }
}

#[cfg(test)]
impl Slots {
    /// The lanes alone, for tests of the step.
    pub fn into_lanes(self: Box<Self>) -> Lanes {
        self.lanes
    }
}

/// One call's worth of cells.
pub struct Run<'a> {
    pub settings: &'a EngineSettings,
    pub path: Available,
    pub samples: Option<&'a SampledCalcium>,
    pub inputs: &'a [CellInput],
    pub bound: Option<&'a CostBound<'a>>,
    pub outputs: &'a mut [CellOutput],
    pub traces: Option<&'a mut [CellTrace]>,
}

impl Run<'_> {
    /// Evaluates all inputs, each in the lane that becomes free first.
    pub fn all(mut self, slots: &mut Slots) {
        slots.waiting.n = 0;
        slots.waiting.next = 0;
        let mut taken = 0;
        let mut busy = 0;
        for i in 0..LANES {
            self.refill(slots, i, &mut taken);
            busy += usize::from(slots.jobs[i].phase != Phase::Idle);
        }
        while busy > 0 {
            step_lanes(self.path, &mut slots.lanes, self.samples);
            for i in 0..LANES {
                if slots.lanes.report.outcome[i] == outcome::IDLE || !self.advance(slots, i) {
                    continue;
                }
                self.refill(slots, i, &mut taken);
                busy -= usize::from(slots.jobs[i].phase == Phase::Idle);
            }
        }
    }

    /// Reacts to lane `i`'s step; true when its cell is finished.
    #[inline]
    fn advance(&mut self, slots: &mut Slots, i: usize) -> bool {
        let Slots { lanes, jobs, .. } = slots;
        let job = &mut jobs[i];
        job.tries += 1;
        let what = lanes.report.outcome[i];
        if what == outcome::ACCEPTED {
            job.steps += 1;
            if job.record {
                let r = &lanes.report;
                job.nodes.push(Node {
                    t: r.t[i],
                    sa: r.sa[i],
                    dsa: r.dsa[i],
                    l: r.l[i],
                    dl: r.dl[i],
                });
            }
            if (lanes.state.l[i] - KINK).abs() <= ON_KINK {
                turn_at_kink(lanes, job, i);
            }
            let left = lanes.constants.cycle[i] - lanes.clock.t[i];
            if left <= 1e-9 {
                return self.end_of_beat(slots, i);
            }
        } else {
            job.refused += 1;
            if what == outcome::CROSSED {
                aim_at_kink(lanes, job, i);
            }
        }
        let job = &slots.jobs[i];
        if slots.lanes.clock.h[i] < SHORTEST_STEP_MS || job.tries > self.settings.max_steps_per_beat
        {
            let t_ms = slots.lanes.clock.t[i];
            self.outputs[job.input] = CellOutput {
                status: CellStatus::Stuck { t_ms },
                steps: job.steps,
                steps_refused: job.refused,
                ..self.outputs[job.input]
            };
            return true;
        }
        false
    }

    /// The lane has reached the end of its cycle; true when its cell is finished.
    fn end_of_beat(&mut self, slots: &mut Slots, i: usize) -> bool {
        let Slots {
            lanes,
            jobs,
            segments,
            ..
        } = slots;
        let job = &mut jobs[i];
        let (p, x, low) = (
            lanes.constants.get(i),
            lanes.state.get(i),
            lanes.clock.low[i],
        );
        if job.record {
            job.nodes
                .push(Node::new(p.cycle, x.l, &slopes(&p, &x, low)));
        }
        let settings = self.settings;
        if job.phase == Phase::RunIn {
            if job.record && self.is_hopeless(job, &p, segments) {
                return true;
            }
            job.begin_beat(lanes, i, x);
            return false;
        }
        job.beats += 1;
        let change = change(&p, &lanes.floors.get(i), &job.start, &x, low);
        let sharp = settings.tolerance * settings.oscillation_tolerance;
        if job.tolerance > sharp && change <= 10.0 * job.tolerance && oscillates(&job.nodes) {
            job.tolerance = sharp;
        }
        let status = if change <= settings.tolerance && lanes.clock.tolerance[i] <= job.tolerance {
            CellStatus::Periodic
        } else if job.beats >= settings.max_beats || !x.is_finite() {
            CellStatus::NotPeriodic
        } else {
            if self.is_hopeless(job, &p, segments) {
                return true;
            }
            // Every fourth time: a cell that oscillates by itself does not settle under constant correction.
            let next = if job.beats % 4 == 1 {
                extrapolate(&p, &job.start, &x, low)
            } else {
                x
            };
            job.begin_beat(lanes, i, next);
            return false;
        };
        self.report(job, &p, status, change, segments);
        true
    }

    /// Biomarkers of the recorded beat into the output.
    fn report(
        &mut self,
        job: &Job,
        p: &Constants,
        status: CellStatus,
        change: f64,
        cut: &mut Vec<Segment>,
    ) {
        let n = (p.cycle + 1e-9).floor() as usize + 1;
        segments(&job.nodes, n, cut);
        let (reading, penalty) = of_segments(cut);
        let output = &mut self.outputs[job.input];
        let known = (output.reading, output.penalty);
        output.reading = CellReading {
            ctd50_ms: known.0.ctd50_ms,
            ctd90_ms: known.0.ctd90_ms,
            ..reading
        };
        output.penalty = Penalty {
            sa_res: penalty.sa_res,
            negative_stress: penalty.negative_stress,
            rise_after_peak: penalty.rise_after_peak,
            ..known.1
        };
        output.status = status;
        output.beats = job.beats;
        output.state_change = change;
        output.steps = job.steps;
        output.steps_refused = job.refused;
        if let Some(traces) = &mut self.traces {
            let transient = transient(self.samples, &self.inputs[job.input]);
            let trace = &mut traces[job.input];
            trace.sa_kpa.resize(n, 0.0);
            trace.lambda.resize(n, 0.0);
            sample(cut, &mut trace.sa_kpa, &mut trace.lambda);
            trace.calcium_um.clear();
            trace
                .calcium_um
                .extend((0..n).map(|k| transient.at(k as f64)));
        }
    }

    /// Whether the transient beat just recorded shows that the cell is of no use; the output is then filled.
    fn is_hopeless(&mut self, job: &Job, p: &Constants, cut: &mut Vec<Segment>) -> bool {
        let Some(bound) = self.bound else {
            return false;
        };
        let limit = bound.margin * bound.bounds[job.input];
        self.report(job, p, CellStatus::Hopeless, f64::INFINITY, cut);
        let output = &mut self.outputs[job.input];
        output.state_change = 0.0;
        bound
            .objective
            .cost(&output.reading.biomarkers, &output.penalty)
            > limit
    }

    /// Gives lane `i` the next cell, or leaves it idle.
    fn refill(&mut self, slots: &mut Slots, i: usize, taken: &mut usize) {
        if slots.waiting.next == slots.waiting.n {
            self.prepare(&mut slots.waiting, taken);
        }
        let Slots {
            lanes,
            jobs,
            waiting,
            ..
        } = slots;
        let job = &mut jobs[i];
        if waiting.next == waiting.n {
            job.phase = Phase::Idle;
            lanes.clock.running[i] = 0.0;
            lanes.clock.t[i] = 0.0;
            return;
        }
        let k = waiting.next;
        waiting.next += 1;
        let p = waiting.constants.get(k);
        let x = waiting.prepared.state.get(k);
        lanes.constants.set(i, &p);
        lanes.floors.set(i, &waiting.prepared.floors.get(k));
        job.input = waiting.input[k];
        job.beats = 0;
        job.steps = 0;
        job.refused = 0;
        job.tolerance = self.settings.tolerance;
        let t = waiting.start.t[k];
        if t >= p.cycle {
            job.begin_beat(lanes, i, x);
            return;
        }
        let tolerance = (self.settings.tolerance * self.settings.run_in_tolerance).min(0.1);
        job.begin(lanes, i, tolerance, x);
        job.phase = Phase::RunIn;
        job.record = self.bound.is_some();
        lanes.clock.t[i] = t;
        lanes.clock.slow[i] = (-p.ca_slow * t).exp();
        lanes.clock.fast[i] = (-p.ca_gap * t).exp();
    }

    /// Time within the cycle at which a cell's run-in starts. A bound is worth a whole beat: most
    /// cells of an optimiser end there.
    fn run_in_start(&self, p: &Constants, transient: &Transient<'_>) -> f64 {
        let t = p.cycle - self.settings.run_in_ms;
        let relaxed = transient.is_past(t);
        if self.settings.run_in_ms == 0.0 && self.bound.is_none() {
            p.cycle
        } else if relaxed && self.bound.is_none() {
            t
        } else {
            0.0
        }
    }

    /// Fills the waiting room with cells that pass their checks.
    fn prepare(&mut self, waiting: &mut Waiting, taken: &mut usize) {
        waiting.n = 0;
        waiting.next = 0;
        // Samples are looked through once, unless the cycle changes.
        let mut known: Option<(f64, Transient<'_>)> = None;
        while waiting.n < LANES && *taken < self.inputs.len() {
            let index = *taken;
            *taken += 1;
            let input = &self.inputs[index];
            let output = &mut self.outputs[index];
            *output = CellOutput::default();
            let mut p = match input.constants(self.settings.negative_kwu) {
                Ok(p) => p,
                Err(problem) => {
                    output.status = CellStatus::Refused(problem);
                    continue;
                }
            };
            let transient = match (self.samples, known) {
                (Some(_), Some((cycle, transient))) if cycle == p.cycle => transient,
                _ => transient(self.samples, input),
            };
            known = Some((p.cycle, transient));
            p.ca_max = transient.peak();
            output.reading.ctd50_ms = transient.ctd50_ms;
            output.reading.ctd90_ms = transient.ctd90_ms;
            output.penalty = calcium_penalty(transient.ctd50_ms, transient.ctd90_ms);
            output.negative_kwu = p.k_wu < 0.0;
            if self
                .bound
                .is_some_and(|b| output.penalty.total() > b.bounds[index])
            {
                output.status = CellStatus::Hopeless;
                continue;
            }
            let t = self.run_in_start(&p, &transient);
            // The state at the cycle's end is in equilibrium with the calcium there, not with that
            // of t = 0.
            let ca = transient.at(if t == 0.0 { p.cycle } else { t });
            waiting.constants.set(waiting.n, &p);
            waiting.start.set(waiting.n, &StartTime { t, ca });
            waiting.input[waiting.n] = index;
            waiting.n += 1;
        }
        if waiting.n > 0 {
            // The rest of the vector keeps the cells of an earlier round.
            prepare_lanes(
                self.path,
                &waiting.constants,
                &waiting.start,
                &mut waiting.prepared,
            );
        }
    }
}

fn transient<'a>(samples: Option<&'a SampledCalcium>, input: &CellInput) -> Transient<'a> {
    let p = &input.parameters;
    match samples {
        Some(samples) => samples.within(input.cycle_length_ms),
        None => Transient::rice(p[at::CA_RES], p[at::CA_MAX], p[at::TAU_CR], p[at::TAU_CD]),
    }
}
