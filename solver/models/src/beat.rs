//! One beat or several of a ventricle with its circulation, on a grid of output times, with traces and checks.

mod samples;

use crate::circulation::left_heart::{AORTA, AORTIC_VALVE, LEFT_ATRIUM, MITRAL_VALVE};
use crate::circulation::{Circulation, CirculationState};
use crate::step_control::{Activation, StepControl, StepEnd, StepHistory};
use crate::ventricle::{Ventricle, VentricleError, VentricleSnapshot};
use cardiotwin_units::{Ml, Mmhg, Ms};
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::ops::ControlFlow;

/// Change of pressure below which filling is slow \[mmHg/ms\].
const SLOW_MMHG_PER_MS: f64 = 0.1;
/// Share of the largest change of volume that is back in late filling, where every biomarker's window is over.
const RECOVERED: f64 = 0.8;
/// Share of the largest change of volume that may flow in during one step of late filling.
const INFLOW: f64 = 0.004;

/// Longest controlled step of isovolumic contraction \[ms\]. The wall swings with periods of 10 to 20 ms, which are part of the
/// largest rate of pressure, and the time integration damps them: with steps of 1 ms that rate is up to 2 % too small.
const SWING_STEP_MS: f64 = 0.5;

/// Weight of a step's first flow in its mean flow where steps are controlled: the trapezoidal rule.
const SECOND_ORDER: f64 = 0.5;

/// Number of beats of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Beats {
    /// A fixed number of beats.
    Exactly(usize),
    /// Until volume and arterial pressure return at the beat's start.
    UntilPeriodic {
        /// Number of beats after which the run ends in any case.
        limit: usize,
        /// Largest change of the volume from beat to beat.
        volume: Ml,
        /// Largest change of any compartment's pressure from beat to beat.
        pressure: Mmhg,
    },
}

/// Settings of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BeatSettings {
    /// Cycle length, after which every node is activated again.
    pub cycle_length: Ms,
    /// Number of beats, or the condition that ends the run.
    pub beats: Beats,
    /// Time step and output interval.
    pub step: Ms,
    /// Longest step of late filling: after ejection, with the mitral valve open and four fifths of the volume back, as long as
    /// pressure changes slowly and little flows in during a step. Nothing shorter than two output intervals has an effect;
    /// samples in between are linear.
    pub diastolic_step: Ms,
    /// Control of longer steps in all of the beat, in place of `diastolic_step`, with a circulation of second order; `None`
    /// for steps of one length.
    pub control: Option<StepControl>,
    /// Shortest step that failures may cut to.
    pub shortest_step: Ms,
    /// Whether to record stress, calcium and stretch of every node.
    pub record_nodes: bool,
}

impl BeatSettings {
    /// One beat at 1 ms steps, cut down to 1/64 ms on failure, without nodal traces.
    #[must_use]
    pub fn one_beat(cycle_length: Ms) -> Self {
        Self {
            cycle_length,
            beats: Beats::Exactly(1),
            step: Ms(1.0),
            diastolic_step: Ms(0.0),
            control: None,
            shortest_step: Ms(1.0 / 64.0),
            record_nodes: false,
        }
    }
}

/// Traces of the last beat, sampled at its start, at every output interval and at its end.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BeatTraces {
    /// Time in the beat \[ms\].
    pub time_ms: Vec<f64>,
    /// Pressure in the left ventricle \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Volume of the left ventricle's cavity \[mL\].
    pub volume_ml: Vec<f64>,
    /// Pressure at the aortic root, behind the valve \[mmHg\].
    pub aortic_pressure_mmhg: Vec<f64>,
    /// Pressure in the left atrium \[mmHg\].
    pub left_atrial_pressure_mmhg: Vec<f64>,
    /// Flow through the aortic valve \[mL/s\], positive out of the ventricle.
    pub aortic_flow_ml_per_s: Vec<f64>,
    /// Flow through the mitral valve \[mL/s\], positive into the ventricle.
    pub mitral_flow_ml_per_s: Vec<f64>,
    /// Net flow into the ventricle \[mL/s\] through all paths.
    pub net_inflow_ml_per_s: Vec<f64>,
    /// Whether the aortic valve is open.
    pub aortic_open: Vec<bool>,
    /// Whether the mitral valve is open.
    pub mitral_open: Vec<bool>,
    /// Traces of every node; `None` unless the settings ask for them.
    pub nodes: Option<NodalTraces>,
}

/// Traces of every node, time after time: value `k` of node `i` is at `k · n_nodes + i`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NodalTraces {
    /// Number of nodes: groups of the reduced ventricle, or nodes of the mesh.
    pub n_nodes: usize,
    /// Activation time of each node \[ms\].
    pub activation_ms: Vec<f64>,
    /// Weight of each node; they sum to one.
    pub weights: Vec<f64>,
    /// Active stress along the fibre \[kPa\].
    pub sa_kpa: Vec<f64>,
    /// Calcium \[µM\], zero where the model has none.
    pub ca_um: Vec<f64>,
    /// Fibre stretch from end-diastole.
    pub lambda: Vec<f64>,
}

/// A named condition of success with its value (SPEC section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeatCheck {
    /// Name of the condition.
    pub name: String,
    /// Whether the condition holds.
    pub passed: bool,
    /// Value that was compared.
    pub value: f64,
    /// Range of values that meet the condition, in words.
    pub expected: String,
}

impl BeatCheck {
    /// A check that was made.
    #[must_use]
    pub fn new(name: &str, passed: bool, value: f64, expected: &str) -> Self {
        Self {
            name: name.to_owned(),
            passed,
            value,
            expected: expected.to_owned(),
        }
    }
}

/// A run that reached the end of its last beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeatResult {
    /// Traces of the last beat.
    pub traces: BeatTraces,
    /// Number of beats that were run.
    pub n_beats: usize,
    /// Change of the volume at the beat's start over the last beat \[mL\].
    pub volume_change_ml: f64,
    /// Largest change of a compartment's pressure over the last beat \[mmHg\].
    pub pressure_change_mmhg: f64,
    /// Whether the run is periodic to the settings' tolerance; `None` when a number of beats was asked for.
    pub periodic: Option<bool>,
    /// Conditions of success with their values.
    pub checks: Vec<BeatCheck>,
    /// Numbers of steps and iterations.
    pub work: BeatWork,
}

/// Work of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct BeatWork {
    /// Number of committed steps.
    pub n_steps: usize,
    /// Number of steps that failed and were cut.
    pub n_cut: usize,
    /// Number of Newton iterations in the committed steps.
    pub n_iterations: usize,
}

impl BeatResult {
    /// Whether every check holds.
    #[must_use]
    pub fn succeeded(&self) -> bool {
        self.checks.iter().all(|check| check.passed)
    }
}

/// The state from which a run could be taken up again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// State of the ventricle's wall, cavity and cells.
    pub ventricle: VentricleSnapshot,
    /// Pressures and states of the circulation.
    pub circulation: CirculationState,
}

/// Ending of a run. Divergence is an ending with data, not an error.
#[derive(Debug, Clone, PartialEq)]
pub enum BeatOutcome {
    /// The end of the last cycle was reached; the checks tell whether the run is a success.
    Finished(Box<BeatResult>),
    /// No step could be taken from `last_good`, not even the shortest.
    Diverged {
        /// Time of the last good state, from the start of the run.
        t: Ms,
        /// Last good state, from which no step could be taken.
        last_good: Box<RunState>,
        /// Failure of the shortest step.
        reason: VentricleError,
        /// Traces of the beat up to the last good state.
        traces: Box<BeatTraces>,
        /// Numbers of steps and iterations.
        work: BeatWork,
    },
}

/// Positions of what the traces record, looked up once.
struct Probes {
    aorta: Option<usize>,
    atrium: Option<usize>,
    aortic_valve: Option<usize>,
    mitral_valve: Option<usize>,
}

impl Probes {
    fn new(circulation: &Circulation) -> Self {
        Self {
            aorta: circulation.compartment_idx(AORTA),
            atrium: circulation.compartment_idx(LEFT_ATRIUM),
            aortic_valve: circulation.path_idx(AORTIC_VALVE),
            mitral_valve: circulation.path_idx(MITRAL_VALVE),
        }
    }
}

impl BeatTraces {
    /// Whether volume and pressure of the cavity stay where those of a heart can be (SPEC section 5).
    #[must_use]
    pub fn plausible(&self) -> [BeatCheck; 3] {
        let smallest = |trace: &[f64]| trace.iter().copied().fold(f64::INFINITY, f64::min);
        let (v_low, p_low) = (smallest(&self.volume_ml), smallest(&self.pressure_mmhg));
        let p_high = self
            .pressure_mmhg
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        [
            BeatCheck::new("volume_positive_ml", v_low > 0.0, v_low, "above 0 mL"),
            BeatCheck::new(
                "pressure_not_below_mmhg",
                p_low >= -30.0,
                p_low,
                "-30 mmHg or more",
            ),
            BeatCheck::new(
                "pressure_not_above_mmhg",
                p_high <= 400.0,
                p_high,
                "400 mmHg or less",
            ),
        ]
    }

    fn clear(&mut self, n: usize, nodes: Option<NodalTraces>) {
        *self = Self {
            nodes,
            ..Self::default()
        };
        for trace in [
            &mut self.time_ms,
            &mut self.pressure_mmhg,
            &mut self.volume_ml,
            &mut self.aortic_pressure_mmhg,
            &mut self.left_atrial_pressure_mmhg,
            &mut self.aortic_flow_ml_per_s,
            &mut self.mitral_flow_ml_per_s,
            &mut self.net_inflow_ml_per_s,
        ] {
            trace.reserve(n);
        }
    }

    /// Whether pressure rises at the last sample while both valves are closed. The wall then swings freely, see [`SWING_STEP_MS`].
    fn is_isovolumic_contraction(&self) -> bool {
        let is_closed = |valve: &[bool]| valve.last() == Some(&false);
        let rises = match &self.pressure_mmhg[..] {
            [.., before, last] => last >= before,
            _ => true,
        };
        rises && is_closed(&self.aortic_open) && is_closed(&self.mitral_open)
    }

    /// Longest step \[ms\] that late filling allows after the last sample; zero outside of it.
    fn late_filling_step_ms(&self) -> f64 {
        let n = self.time_ms.len();
        let (Some(true), Some(false)) = (self.mitral_open.last(), self.aortic_open.last()) else {
            return 0.0;
        };
        let ([.., before, last], Some(inflow)) =
            (&self.pressure_mmhg[..], self.net_inflow_ml_per_s.last())
        else {
            return 0.0;
        };
        let rate = (last - before) / (self.time_ms[n - 1] - self.time_ms[n - 2]);
        let extremes = |(low, high): (f64, f64), v: &f64| (v.min(low), v.max(high));
        let (low, high) = self
            .volume_ml
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), extremes);
        let recovered = self.volume_ml[n - 1] - low;
        let is_late = rate.abs() <= SLOW_MMHG_PER_MS
            && recovered >= RECOVERED * (high - low)
            && self.aortic_open.contains(&true);
        if is_late {
            1e3 * INFLOW * (high - low) / inflow.abs().max(f64::MIN_POSITIVE)
        } else {
            0.0
        }
    }

    fn record<V: Ventricle + ?Sized>(
        &mut self,
        time_ms: f64,
        ventricle: &V,
        circulation: &Circulation,
        probes: &Probes,
    ) {
        let pressure = |idx: Option<usize>| idx.map_or(0.0, |i| circulation.pressure(i).0);
        let flow = |idx: Option<usize>| idx.map_or(0.0, |i| circulation.flow(i).0);
        let open = |idx: Option<usize>| idx.is_some_and(|i| circulation.is_open(i));
        self.time_ms.push(time_ms);
        self.pressure_mmhg.push(ventricle.pressure().0);
        self.volume_ml.push(ventricle.volume().0);
        self.aortic_pressure_mmhg.push(pressure(probes.aorta));
        self.left_atrial_pressure_mmhg.push(pressure(probes.atrium));
        self.aortic_flow_ml_per_s.push(flow(probes.aortic_valve));
        self.mitral_flow_ml_per_s.push(flow(probes.mitral_valve));
        self.net_inflow_ml_per_s.push(circulation.net_inflow().0);
        self.aortic_open.push(open(probes.aortic_valve));
        self.mitral_open.push(open(probes.mitral_valve));
        if let Some(nodes) = &mut self.nodes {
            let first = nodes.sa_kpa.len();
            let grown = first + nodes.n_nodes;
            for trace in [&mut nodes.sa_kpa, &mut nodes.ca_um, &mut nodes.lambda] {
                trace.resize(grown, 0.0);
            }
            ventricle.active_stress_kpa(&mut nodes.sa_kpa[first..]);
            ventricle.calcium_um(&mut nodes.ca_um[first..]);
            ventricle.stretch(&mut nodes.lambda[first..]);
        }
    }
}

/// Position of a run between two output intervals. With the states of ventricle and circulation, it
/// is all that the run needs to continue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunProgress {
    /// Number of the beat, from one.
    pub n_beats: usize,
    /// Output intervals of this beat that are over.
    pub intervals: usize,
    /// Length of the next step \[ms\].
    pub next_step_ms: f64,
    /// Last steps, from which controlled steps follow; empty without control.
    #[serde(default)]
    pub steps: StepHistory,
    /// Time at the beat's start \[ms\].
    pub beat_start_ms: f64,
    /// Volume at the beat's start \[mL\].
    pub start_volume_ml: f64,
    /// Circulation at the beat's start.
    pub start_circulation: CirculationState,
    /// Volume that had come in before the beat's start \[mL\].
    pub start_volume_in_ml: f64,
    /// Numbers of steps and iterations so far.
    pub work: BeatWork,
    /// Traces of the beat so far.
    pub traces: BeatTraces,
}

/// State of a run that its observer sees after an output interval, the last one of those that a
/// step covers.
#[derive(Debug)]
pub struct Observed<'a, V: ?Sized> {
    /// Position of the run.
    pub progress: &'a RunProgress,
    /// Ventricle, whose committed state the observer must not change.
    pub ventricle: &'a mut V,
    /// Circulation with its committed pressures and flows.
    pub circulation: &'a Circulation,
}

impl<V: Ventricle + ?Sized> Observed<'_, V> {
    /// Time of the last committed step \[ms\].
    #[must_use]
    pub fn ventricle_time_ms(&self) -> f64 {
        self.ventricle.time().0
    }
}

/// Runs beats from the present state of both sides. The step is cut by half on failure and doubled after a success, and
/// always ends on the output grid.
pub fn run_beats(
    ventricle: &mut dyn Ventricle,
    circulation: &mut Circulation,
    settings: &BeatSettings,
) -> BeatOutcome {
    match run_observed(ventricle, circulation, settings, None, |_| {
        ControlFlow::<Infallible>::Continue(())
    }) {
        ControlFlow::Continue(outcome) => outcome,
        ControlFlow::Break(never) => match never {},
    }
}

/// As [`run_beats`], from the start or from where an earlier run stood, whose states both sides then have. `observe` is
/// called after every output interval; what it breaks with ends the run.
pub fn run_observed<V: Ventricle + ?Sized, B>(
    ventricle: &mut V,
    circulation: &mut Circulation,
    settings: &BeatSettings,
    from: Option<RunProgress>,
    mut observe: impl FnMut(Observed<'_, V>) -> ControlFlow<B>,
) -> ControlFlow<B, BeatOutcome> {
    let probes = Probes::new(circulation);
    let length = settings.cycle_length.0;
    // A last interval shorter than a thousandth of a step is round-off of the cycle length.
    let n_intervals = (length / settings.step.0 - 1e-3).ceil().max(1.0) as usize;
    let (limit, tolerance) = match settings.beats {
        Beats::Exactly(n) => (n.max(1), None),
        Beats::UntilPeriodic {
            limit,
            volume,
            pressure,
        } => (limit.max(1), Some((volume.0, pressure.0))),
    };
    let begun =
        |(n_beats, next_step_ms, steps), work, ventricle: &mut V, circulation: &Circulation| {
            let mut progress = RunProgress {
                n_beats,
                intervals: 0,
                next_step_ms,
                steps,
                beat_start_ms: ventricle.time().0,
                start_volume_ml: ventricle.volume().0,
                start_circulation: circulation.snapshot(),
                start_volume_in_ml: circulation.net_volume_in().0,
                work,
                traces: BeatTraces::default(),
            };
            let nodes = settings
                .record_nodes
                .then(|| empty_nodes(ventricle, n_intervals + 1));
            progress.traces.clear(n_intervals + 1, nodes);
            progress.traces.record(0.0, ventricle, circulation, &probes);
            progress
        };
    if settings.control.is_some() {
        circulation.set_start_weight(SECOND_ORDER);
    }
    let mut now = from.unwrap_or_else(|| {
        let mut steps = StepHistory::default();
        if let Some(control) = &settings.control {
            circulation.begin_flows(ventricle.pressure());
            steps.keep(control, end_of(ventricle), (1, settings.step.0));
        }
        let first = (1, settings.step.0, steps);
        begun(first, BeatWork::default(), ventricle, circulation)
    });
    let activation = Activation::of(ventricle.activation_times_ms(), settings.cycle_length);
    let grid_of = |interval: usize| {
        if interval == n_intervals {
            length
        } else {
            interval as f64 * settings.step.0
        }
    };
    loop {
        while now.intervals < n_intervals {
            let mut stride = if settings.control.is_some() {
                now.steps.next_intervals(n_intervals - now.intervals)
            } else if settings.diastolic_step.0 > settings.step.0 {
                let longest = now.traces.late_filling_step_ms();
                let longest = longest.min(settings.diastolic_step.0);
                (longest / settings.step.0 + 1e-9).floor().max(1.0) as usize
            } else {
                1
            };
            let (mut is_taken, mut shortened) = (false, None);
            if let Some(control) = &settings.control {
                let begin_ms = grid_of(now.intervals);
                if now.traces.is_isovolumic_contraction() {
                    stride = 1;
                    let n_steps = (settings.step.0 / SWING_STEP_MS - 1e-9).ceil().max(1.0);
                    shortened = Some(settings.step.0 / n_steps);
                }
                while stride > 1 && activation.is_within(begin_ms, grid_of(now.intervals + stride))
                {
                    stride /= 2;
                }
                while stride > 1 && !is_taken {
                    let end_ms = now.beat_start_ms + grid_of(now.intervals + stride);
                    is_taken = try_long(
                        ventricle,
                        circulation,
                        end_ms,
                        (control, &now.steps, settings.step.0),
                        &mut now.work,
                    );
                    if !is_taken {
                        stride /= 2;
                    }
                }
            }
            let interval = (now.intervals + stride).min(n_intervals);
            let grid = grid_of(interval);
            let end = now.beat_start_ms + grid;
            let (next_step, work) = (&mut now.next_step_ms, &mut now.work);
            // Kept to the output interval otherwise, to the bit.
            let longest = if interval - now.intervals > 1 && !is_taken {
                end - ventricle.time().0
            } else {
                shortened.unwrap_or(settings.step.0)
            };
            *next_step = if longest > settings.step.0 {
                longest
            } else {
                next_step.min(longest)
            };
            let advanced = advance(
                ventricle,
                circulation,
                end,
                (longest, settings),
                next_step,
                work,
            );
            if let Err(reason) = advanced {
                ventricle.roll_back();
                circulation.roll_back();
                let last_good = RunState {
                    ventricle: ventricle.snapshot(),
                    circulation: circulation.snapshot(),
                };
                let (last_good, traces) = (Box::new(last_good), Box::new(now.traces));
                let (t, work) = (ventricle.time(), now.work);
                return ControlFlow::Continue(BeatOutcome::Diverged {
                    t,
                    last_good,
                    reason,
                    traces,
                    work,
                });
            }
            let mut before = None;
            if let Some(control) = &settings.control {
                let intervals = interval - now.intervals;
                let covered = (intervals, settings.step.0);
                before = now.steps.last_intervals(settings.step.0);
                now.steps.keep(control, end_of(ventricle), covered);
            }
            now.traces.record(grid, ventricle, circulation, &probes);
            let skipped = (now.intervals + 1..interval)
                .map(|k| k as f64 * settings.step.0)
                .collect::<Vec<_>>();
            now.traces.fill_in(&skipped, before);
            now.intervals = interval;
            observe(Observed {
                progress: &now,
                ventricle,
                circulation,
            })?;
        }
        let volume_change_ml = ventricle.volume().0 - now.start_volume_ml;
        let after = circulation.snapshot();
        let pressure_change_mmhg = (after
            .pressures_mmhg
            .iter()
            .zip(&now.start_circulation.pressures_mmhg))
        .fold(0.0, |largest: f64, (a, b)| largest.max((a - b).abs()));
        let periodic =
            tolerance.map(|(v, p)| volume_change_ml.abs() <= v && pressure_change_mmhg <= p);
        if now.n_beats >= limit || periodic == Some(true) {
            let imbalance =
                volume_change_ml - (circulation.net_volume_in().0 - now.start_volume_in_ml);
            let RunProgress {
                n_beats,
                work,
                traces,
                ..
            } = now;
            let checks = checks(&traces, imbalance, length);
            let result = BeatResult {
                traces,
                n_beats,
                volume_change_ml,
                pressure_change_mmhg,
                periodic,
                checks,
                work,
            };
            return ControlFlow::Continue(BeatOutcome::Finished(Box::new(result)));
        }
        let next = (now.n_beats + 1, now.next_step_ms, now.steps);
        now = begun(next, now.work, ventricle, circulation);
    }
}

fn empty_nodes<V: Ventricle + ?Sized>(ventricle: &V, n_samples: usize) -> NodalTraces {
    let n_nodes = ventricle.activation_times_ms().len();
    let reserve = || Vec::with_capacity(n_nodes * n_samples);
    NodalTraces {
        n_nodes,
        activation_ms: ventricle.activation_times_ms().to_vec(),
        weights: ventricle.node_weights().to_vec(),
        sa_kpa: reserve(),
        ca_um: reserve(),
        lambda: reserve(),
    }
}

/// State of the cavity at the end of the last committed step.
fn end_of<V: Ventricle + ?Sized>(ventricle: &V) -> StepEnd {
    StepEnd {
        time_ms: ventricle.time().0,
        pressure_mmhg: ventricle.pressure().0,
        volume_ml: ventricle.volume().0,
    }
}

/// Tries one step to `end_ms` and commits it if it is accurate enough; says whether it is taken.
fn try_long<V: Ventricle + ?Sized>(
    ventricle: &mut V,
    circulation: &mut Circulation,
    end_ms: f64,
    (control, steps, interval_ms): (&StepControl, &StepHistory, f64),
    work: &mut BeatWork,
) -> bool {
    // Components keep what depends on the step's length, which is not the difference of two times to the bit.
    let length_ms = end_ms - ventricle.time().0;
    let whole_ms = (length_ms / interval_ms).round() * interval_ms;
    let length_ms = if (length_ms - whole_ms).abs() <= 1e-9 * interval_ms {
        whole_ms
    } else {
        length_ms
    };
    let tried = ventricle.try_step(circulation, Ms(length_ms)).ok();
    let accepted = tried.filter(|tried| {
        let end = StepEnd {
            time_ms: end_ms,
            pressure_mmhg: tried.pressure.0,
            volume_ml: tried.volume.0,
        };
        steps.accepts(control, end)
    });
    if let Some(tried) = accepted {
        ventricle.commit();
        circulation.commit();
        work.n_steps += 1;
        work.n_iterations += tried.iterations;
        return true;
    }
    ventricle.roll_back();
    circulation.roll_back();
    work.n_cut += 1;
    false
}

/// Steps until `end_ms`, of `longest_ms` at most.
fn advance<V: Ventricle + ?Sized>(
    ventricle: &mut V,
    circulation: &mut Circulation,
    end_ms: f64,
    (longest_ms, settings): (f64, &BeatSettings),
    next_step: &mut f64,
    work: &mut BeatWork,
) -> Result<(), VentricleError> {
    loop {
        let left = end_ms - ventricle.time().0;
        if left <= 1e-9 * settings.step.0 {
            return Ok(());
        }
        // The grid's own step, not the difference of two times: components keep what depends on the step's length.
        let own = [settings.step.0, longest_ms]
            .into_iter()
            .find(|own| (left - own).abs() <= 1e-9 * settings.step.0);
        let left = own.unwrap_or(left);
        let dt = if *next_step >= 0.999_999 * left {
            left
        } else {
            *next_step
        };
        match ventricle.try_step(circulation, Ms(dt)) {
            Ok(tried) => {
                ventricle.commit();
                circulation.commit();
                work.n_steps += 1;
                work.n_iterations += tried.iterations;
                *next_step = (2.0 * next_step.max(dt)).min(longest_ms);
            }
            Err(reason) => {
                ventricle.roll_back();
                circulation.roll_back();
                work.n_cut += 1;
                *next_step = 0.5 * dt;
                if *next_step < settings.shortest_step.0 {
                    return Err(reason);
                }
            }
        }
    }
}

/// Success of a beat (SPEC section 5).
fn checks(traces: &BeatTraces, imbalance_ml: f64, cycle_length_ms: f64) -> Vec<BeatCheck> {
    // An opening and a closing inside the beat; a valve may also begin the beat open.
    let moves = |open: &[bool]| {
        let opened = open.iter().any(|o| *o);
        let closed = open.windows(2).any(|w| w[0] && !w[1]) || (opened && open.iter().any(|o| !*o));
        opened && closed
    };
    let share =
        |open: &[bool]| open.iter().filter(|o| **o).count() as f64 / open.len().max(1) as f64;
    let end = traces.time_ms.last().copied().unwrap_or(0.0);
    let finite = [
        &traces.pressure_mmhg,
        &traces.volume_ml,
        &traces.aortic_pressure_mmhg,
        &traces.net_inflow_ml_per_s,
    ]
    .iter()
    .all(|trace| trace.iter().all(|x| x.is_finite()));
    let mut checks = vec![
        BeatCheck::new(
            "cycle_end_reached",
            (end - cycle_length_ms).abs() < 1e-6,
            end,
            "the cycle length in ms",
        ),
        BeatCheck::new("states_finite", finite, f64::from(u8::from(finite)), "1"),
        BeatCheck::new(
            "aortic_valve_opened_and_closed",
            moves(&traces.aortic_open),
            share(&traces.aortic_open),
            "share of the beat it is open, between 0 and 1",
        ),
        BeatCheck::new(
            "mitral_valve_opened_and_closed",
            moves(&traces.mitral_open),
            share(&traces.mitral_open),
            "share of the beat it is open, between 0 and 1",
        ),
        BeatCheck::new(
            "volume_balance_ml",
            imbalance_ml.abs() <= 0.1,
            imbalance_ml,
            "-0.1 to 0.1 mL",
        ),
    ];
    checks.extend(traces.plausible());
    checks
}
