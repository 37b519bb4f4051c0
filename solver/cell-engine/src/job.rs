//! The cell in one lane, and the start of its beats.

use crate::model::{KINK, State};
use crate::step::{Clock, Lanes};
use crate::trace::Node;

/// First step of a beat and of the run-in \[ms\].
const FIRST_STEP_MS: f64 = 0.5;

/// What a lane does.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Phase {
    #[default]
    Idle,
    RunIn,
    Beat,
}

/// The cell in one lane.
#[derive(Debug, Clone, Default)]
pub struct Job {
    pub phase: Phase,
    pub input: usize,
    /// Whether the steps leave nodes.
    pub record: bool,
    pub tolerance: f64,
    pub start: State,
    /// Step to continue with behind the kink that the present step is aimed at; 0 when there is none.
    pub resume_h: f64,
    pub tries: u32,
    pub beats: u32,
    pub steps: u32,
    pub refused: u32,
    /// The beat so far.
    pub nodes: Vec<Node>,
}

impl Job {
    /// Starts integrating at t = 0 from `x`.
    pub fn begin(&mut self, lanes: &mut Lanes, i: usize, tolerance: f64, x: State) {
        self.start = x;
        self.resume_h = 0.0;
        self.tries = 0;
        self.nodes.clear();
        lanes.state.set(i, &x);
        lanes.clock.set(
            i,
            &Clock {
                t: 0.0,
                slow: 1.0,
                fast: 1.0,
                h: FIRST_STEP_MS,
                growth: 5.0,
                low: if x.l < KINK { 1.0 } else { 0.0 },
                tolerance,
                running: 1.0,
            },
        );
    }

    /// Starts a recorded beat.
    pub fn begin_beat(&mut self, lanes: &mut Lanes, i: usize, x: State) {
        self.begin(lanes, i, self.tolerance, x);
        self.phase = Phase::Beat;
        self.record = true;
    }
}
