//! One rank of a ventricle: its part of the wall, and its execution of rank 0's commands.
//!
//! Rank 0 holds the circulation and talks to the calling program; the other ranks wait for its commands. Every operation here
//! is collective: rank 0 broadcasts a [`Command`], and all ranks execute it.

use std::sync::Arc;

use cardiotwin_linalg::parallel::{Communicator, Counted, Part, Traffic, VectorLayout};
use cardiotwin_models::effects::FibreViscosity;
use cardiotwin_models::ventricle::{VentricleError, steps_before_the_beat};
use serde::{Serialize, Serializer};

use super::contraction::{NodeAverage, PointContraction, SharedModel};
use super::end_diastole::EndDiastole;
use super::kernels::{Bench, Kernel};
use super::right_ventricle::PressureCourse;
use super::share::Share;
use super::wall::{WallError, WallParameters};
use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State};
use crate::newton::Smallest;
use crate::step::{Closure, PointStress as _, Solver, StepError, StepReport, StepSettings, step};

#[derive(Debug, Clone)]
pub(super) struct Setup {
    pub wall: WallParameters,
    pub contraction: SharedModel,
    pub cycle_length_ms: f64,
    pub viscosity: Option<FibreViscosity>,
    pub settings: StepSettings,
}

/// Nodal or point values that rank 0 collects or distributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Values {
    /// Displacement, velocity, acceleration, forces and each vector of the solver's memory have three numbers a node.
    Displacement,
    Velocity,
    Acceleration,
    Force,
    /// A vector of the solver's memory: on request the one of this number; any number appends one.
    Memory(usize),
    /// Each rank's levels of rigid motions.
    Levels,
    /// Contraction states, stretch, stress and calcium have one or more numbers a point.
    Cells,
    PointStretch,
    PointStress,
    PointCalcium,
    /// Means of stretch, stress and calcium have one number a muscle node and are only collected.
    Stretch,
    Stress,
    Calcium,
}

impl Values {
    /// All but the solver's memory.
    const FIXED: [Self; 12] = [
        Self::Displacement,
        Self::Velocity,
        Self::Acceleration,
        Self::Force,
        Self::Levels,
        Self::Cells,
        Self::PointStretch,
        Self::PointStress,
        Self::PointCalcium,
        Self::Stretch,
        Self::Stress,
        Self::Calcium,
    ];

    fn encoded(self) -> f64 {
        let fixed = Self::FIXED.iter().position(|v| *v == self);
        let number = match self {
            Self::Memory(k) => Self::FIXED.len() + k,
            _ => fixed.unwrap_or_default(),
        };
        number as f64
    }

    fn decoded(number: f64) -> Self {
        let number = number as usize;
        Self::FIXED
            .get(number)
            .copied()
            .unwrap_or_else(|| Self::Memory(number - Self::FIXED.len()))
    }

    /// Position in the list of point states, if these values belong to points.
    pub fn of_points(self) -> Option<usize> {
        [
            Self::Cells,
            Self::PointStretch,
            Self::PointStress,
            Self::PointCalcium,
        ]
        .iter()
        .position(|v| *v == self)
    }

    /// Position in the list of means, if these values are means at muscle nodes.
    fn of_muscle(self) -> Option<usize> {
        [Self::Stretch, Self::Stress, Self::Calcium]
            .iter()
            .position(|v| *v == self)
    }

    pub fn places(self) -> Places {
        match self {
            _ if self.of_points().is_some() => Places::Points,
            _ if self.of_muscle().is_some() => Places::Muscle,
            _ => Places::Nodes,
        }
    }
}

/// Mesh entities to which values belong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Places {
    Nodes,
    Points,
    Muscle,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Command {
    Stop,
    /// Tries a step to `end_ms`.
    Try {
        end_ms: f64,
        dt_ms: f64,
        pressure_kpa: f64,
    },
    Commit,
    RollBack,
    /// Discards the solver's memory and continues from a state whose values follow.
    Resume {
        pressure_kpa: f64,
    },
    /// Discards the solver's memory.
    Forget,
    Collect(Values),
    HandOut(Values),
    Volume,
    /// Runs a kernel for measurements.
    Run(Kernel),
    /// Counts the bytes of a conjugate-gradient iteration.
    KrylovBytes,
    Figures,
}

impl Command {
    fn encoded(self) -> [f64; 4] {
        match self {
            Self::Stop => [0.0; 4],
            Self::Try {
                end_ms,
                dt_ms,
                pressure_kpa,
            } => [1.0, end_ms, dt_ms, pressure_kpa],
            Self::Commit => [2.0, 0.0, 0.0, 0.0],
            Self::RollBack => [3.0, 0.0, 0.0, 0.0],
            Self::Resume { pressure_kpa } => [4.0, pressure_kpa, 0.0, 0.0],
            Self::Forget => [5.0, 0.0, 0.0, 0.0],
            Self::Collect(values) => [6.0, values.encoded(), 0.0, 0.0],
            Self::HandOut(values) => [7.0, values.encoded(), 0.0, 0.0],
            Self::Volume => [8.0, 0.0, 0.0, 0.0],
            Self::Run(kernel) => {
                let [kernel, n] = kernel.encoded();
                [9.0, kernel, n, 0.0]
            }
            Self::KrylovBytes => [10.0, 0.0, 0.0, 0.0],
            Self::Figures => [11.0, 0.0, 0.0, 0.0],
        }
    }

    fn decoded([code, a, b, c]: [f64; 4]) -> Self {
        match code as u32 {
            1 => Self::Try {
                end_ms: a,
                dt_ms: b,
                pressure_kpa: c,
            },
            2 => Self::Commit,
            3 => Self::RollBack,
            4 => Self::Resume { pressure_kpa: a },
            5 => Self::Forget,
            6 => Self::Collect(Values::decoded(a)),
            7 => Self::HandOut(Values::decoded(a)),
            8 => Self::Volume,
            9 => Self::Run(Kernel::decoded([a, b])),
            10 => Self::KrylovBytes,
            11 => Self::Figures,
            _ => Self::Stop,
        }
    }
}

/// Size of a rank's part and its communication so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct RankFigures {
    /// Nodes owned by the rank.
    pub nodes: u64,
    /// Nodes of other ranks that the rank holds.
    pub ghosts: u64,
    /// Elements computed by the rank.
    pub elements: u64,
    /// Ranks with which it exchanges halos.
    pub neighbours: u64,
    /// Halo messages that the rank has sent.
    pub halo_messages: u64,
    /// Bytes in these messages; serialised in MB.
    #[serde(rename = "halo_MB", serialize_with = "megabytes")]
    pub halo_bytes: u64,
    /// Reductions and broadcasts, all together.
    pub reductions: u64,
}

fn megabytes<S: Serializer>(bytes: &u64, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(1e-6 * *bytes as f64)
}

impl RankFigures {
    /// The same size, with the communication since `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        Self {
            halo_messages: self.halo_messages - before.halo_messages,
            halo_bytes: self.halo_bytes - before.halo_bytes,
            reductions: self.reductions - before.reductions,
            ..*self
        }
    }
}

/// One rank's part of the ventricle.
#[derive(Debug)]
pub(super) struct OrganRank {
    pub part: Part,
    pub dynamics: Dynamics,
    pub average: NodeAverage,
    pub now: State,
    contraction: PointContraction,
    /// Pressure in the right ventricle over a beat.
    right: Option<PressureCourse>,
    /// Whether this rank is responsible for each point's element.
    speaks_for: Vec<bool>,
    pub settings: StepSettings,
    solver: Solver,
    trial: Option<State>,
    bench: Option<Bench>,
    traffic: Arc<Traffic>,
}

impl OrganRank {
    /// Builds a rank's part at end-diastole, at rest at time zero. Collective.
    ///
    /// # Errors
    /// [`VentricleError`] where the wall cannot be supported, the contraction model fails or the solver does not run on several
    /// ranks.
    pub fn new(
        setup: &Setup,
        share: Share<'_>,
        comm: Box<dyn Communicator>,
    ) -> Result<Self, VentricleError> {
        let failed = |error: &dyn std::error::Error| VentricleError::NoMotion {
            t_ms: 0.0,
            dt_ms: 0.0,
            reason: chain(error),
        };
        let Share {
            part,
            anatomy,
            end_diastole,
            activation_ms,
        } = share;
        if comm.n_ranks() > 1 && !setup.settings.linear.is_parallel() {
            let (name, value, expected) =
                ("ranks", comm.n_ranks() as f64, "1 with this linear solver");
            return Err(VentricleError::Parameter {
                name,
                value,
                expected,
            });
        }
        let traffic = Arc::new(Traffic::default());
        let comm = Box::new(Counted::new(comm, Arc::clone(&traffic)));
        let EndDiastole {
            unloaded,
            anchor,
            u,
            pressure_kpa,
        } = end_diastole;
        let made = setup
            .wall
            .assemble_static(&anatomy, &unloaded, &anchor, &part, comm);
        let mut dynamics = made.map_err(|e: WallError| failed(&e))?;
        setup
            .wall
            .support(&anatomy, &mut dynamics, &u)
            .map_err(|e: WallError| failed(&e))?;
        let right = setup
            .wall
            .right_pressure
            .as_ref()
            .map(|right| right.course.clone());
        load_right(&mut dynamics, right.as_ref(), 0.0);
        let mut deformation = Deformation::default();
        dynamics
            .body
            .deform(&u, dynamics.comm.as_ref(), &mut deformation);
        let mut points = PointContraction::new(
            &setup.contraction,
            setup.cycle_length_ms,
            &setup.wall,
            &anatomy,
            &dynamics.body,
            &activation_ms,
            &deformation,
        )
        .with_viscosity(setup.viscosity);
        // All ranks take the same steps.
        let mut latest = [-points.earliest_activation_ms()];
        dynamics.comm.max(&mut latest);
        let earliest_ms = -latest[0];
        points.begin(earliest_ms);
        let mut active = vec![];
        let mut step = |end_ms, dt_ms| {
            points.begin_step(end_ms);
            let evaluated = points.evaluate(dt_ms, &deformation, &mut active);
            evaluated.map_err(|source| VentricleError::Contraction {
                t_ms: end_ms,
                source,
            })?;
            points.commit();
            Ok::<(), VentricleError>(())
        };
        // Points activated before time zero contract at their end-diastolic length until then.
        steps_before_the_beat(earliest_ms).try_for_each(|(end_ms, dt_ms)| step(end_ms, dt_ms))?;
        // A step of vanishing length at constant stretch gives the stress at time zero.
        step(0.0, 1e-6)?;
        let mut now = dynamics
            .start(u, active, pressure_kpa)
            .map_err(|s| failed(&inverted(s)))?;
        // The residual of step 0's solution is not a load: the beat starts without acceleration.
        now.motion.a.fill(0.0);
        let average = points.node_average(&anatomy, &dynamics.body, dynamics.comm.as_ref());
        let speaks_for = points
            .elements(&dynamics.body)
            .map(|e| part.speaks_for[e as usize])
            .collect();
        Ok(Self {
            part,
            average,
            now,
            contraction: points,
            right,
            speaks_for,
            settings: setup.settings,
            solver: Solver::new(),
            trial: None,
            bench: None,
            traffic,
            dynamics,
        })
    }

    pub fn comm(&self) -> &dyn Communicator {
        self.dynamics.comm.as_ref()
    }

    /// Broadcasts a command to the other ranks; rank 0 calls this before it executes the command itself.
    pub fn tell(&self, command: Command) {
        if self.comm().n_ranks() > 1 {
            self.comm().command(&mut command.encoded());
        }
    }

    /// Executes rank 0's commands until it sends [`Command::Stop`]; for the other ranks.
    pub fn serve(mut self) {
        loop {
            let mut word = [0.0; 4];
            self.comm().command(&mut word);
            match Command::decoded(word) {
                Command::Stop => return,
                Command::Try {
                    end_ms,
                    dt_ms,
                    pressure_kpa,
                } => {
                    // The error is the same on rank 0, which reports it.
                    let _ =
                        self.try_step([end_ms, dt_ms, pressure_kpa], &mut Closure::BalanceOfRank0);
                }
                Command::Commit => self.commit(),
                Command::RollBack => self.roll_back(),
                Command::Resume { pressure_kpa } => self.resume(pressure_kpa),
                Command::Forget => self.solver.forget(),
                Command::Collect(values) => drop(self.collect(values)),
                Command::HandOut(values) => self.take(values, vec![]),
                // The results are rank 0's.
                Command::Volume => _ = self.volume_mm3(),
                Command::Run(kernel) => _ = self.run(kernel),
                Command::KrylovBytes => _ = self.krylov_bytes(),
                Command::Figures => _ = self.figures(),
            }
        }
    }

    /// Tries a step; returns its cost, and the cavity volume \[mm³\] and pressure \[kPa\] at its end.
    ///
    /// # Errors
    /// [`StepError`], on all ranks.
    pub fn try_step(
        &mut self,
        [end_ms, dt_ms, pressure_kpa]: [f64; 3],
        closure: &mut Closure<'_>,
    ) -> Result<(StepReport, f64, f64), StepError> {
        self.trial = None;
        self.contraction.begin_step(end_ms);
        load_right(&mut self.dynamics, self.right.as_ref(), end_ms);
        let mut candidate = Candidate {
            pressure_kpa,
            ..Candidate::default()
        };
        if self.settings.extrapolate {
            self.dynamics
                .scheme
                .predict(dt_ms, &self.now.motion, &mut candidate.motion.u);
        } else {
            candidate.motion.u.clone_from(&self.now.motion.u);
        }
        let (force, report) = step(
            &self.dynamics,
            &self.now,
            dt_ms,
            &mut candidate,
            &mut self.contraction,
            closure,
            &mut self.solver,
            &self.settings,
        )?;
        let volume_mm3 = self.dynamics.cavity_volume(&candidate.motion.u);
        let pressure_kpa = candidate.pressure_kpa;
        self.trial = Some(State {
            motion: candidate.motion,
            force,
            pressure_kpa,
        });
        Ok((report, volume_mm3, pressure_kpa))
    }

    /// Committed cavity volume \[mm³\].
    pub fn volume_mm3(&self) -> f64 {
        self.dynamics.cavity_volume(&self.now.motion.u)
    }

    pub fn commit(&mut self) {
        if let Some(trial) = self.trial.take() {
            self.now = trial;
            self.contraction.commit();
        }
    }

    pub fn roll_back(&mut self) {
        self.trial = None;
    }

    pub fn forget(&mut self) {
        self.solver.forget();
    }

    pub fn resume(&mut self, pressure_kpa: f64) {
        self.now.pressure_kpa = pressure_kpa;
        self.trial = None;
        self.solver.forget();
    }

    /// Mesh number of each point's element, and whether this rank is responsible for it.
    pub fn points(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let elements = self
            .contraction
            .elements(&self.dynamics.body)
            .map(|e| self.part.elements[e as usize]);
        elements.zip(self.speaks_for.iter().copied())
    }

    /// Number of vectors in the solver's memory.
    pub fn n_memories(&self) -> usize {
        self.solver.n_memories()
    }

    /// Collects the values of each rank's own nodes and points on rank 0; `None` elsewhere.
    pub fn collect(&self, values: Values) -> Option<Vec<Vec<f64>>> {
        let n_owned = 3 * self.part.layout.n_owned;
        let State { motion, force, .. } = &self.now;
        let nodes = |all: &[f64]| self.comm().gather(&all[..n_owned.min(all.len())]);
        match values {
            Values::Displacement => nodes(&motion.u),
            Values::Velocity => nodes(&motion.v),
            Values::Acceleration => nodes(&motion.a),
            Values::Force => nodes(force),
            Values::Levels => self.comm().gather(&self.solver.levels()),
            Values::Memory(k) => nodes(&self.solver.memory(k)),
            _ => match (values.of_points(), values.of_muscle()) {
                (Some(k), _) => {
                    let (width, all) = self.contraction.states()[k];
                    let spoken = all
                        .chunks_exact(width.max(1))
                        .zip(&self.speaks_for)
                        .filter(|(_, speaks)| **speaks);
                    self.comm().gather(
                        &spoken
                            .flat_map(|(values, _)| values)
                            .copied()
                            .collect::<Vec<f64>>(),
                    )
                }
                (None, k) => {
                    let mut out = vec![0.0; self.average.nodes.len()];
                    self.average.apply(
                        self.contraction.committed()[k.unwrap_or_default()],
                        &mut out,
                    );
                    self.comm().gather(&out)
                }
            },
        }
    }

    /// Receives this rank's values from rank 0, for owned nodes and all points held.
    pub fn take(&mut self, values: Values, parts: Vec<Vec<f64>>) {
        let own = self.comm().scatter(parts);
        if values == Values::Levels {
            self.solver.take_levels(&self.dynamics, &own);
            return;
        }
        if let Some(k) = values.of_points() {
            *self.contraction.states_mut()[k] = own;
            return;
        }
        let mut all = own;
        all.resize(3 * self.part.layout.n_local, 0.0);
        VectorLayout {
            comm: self.dynamics.comm.as_ref(),
            layout: &self.part.layout,
        }
        .update(&mut all);
        let State { motion, force, .. } = &mut self.now;
        match values {
            Values::Displacement => motion.u = all,
            Values::Velocity => motion.v = all,
            Values::Acceleration => motion.a = all,
            Values::Force => *force = all,
            _ => self.solver.remember(&all),
        }
    }

    /// Runs a kernel at the committed displacement under a constant active stress, then waits for all ranks. `None` for
    /// elements without a tangent in single precision. Collective.
    pub fn run(&mut self, kernel: Kernel) -> Option<()> {
        let new_bench = || Bench::new(&self.dynamics, &self.now);
        let mut bench = self.bench.take().map_or_else(new_bench, Some)?;
        bench.run(kernel, &self.dynamics, &self.now);
        self.bench = Some(bench);
        Some(())
    }

    /// Bytes that one conjugate-gradient iteration moves through memory on all ranks, if caches keep nothing between passes.
    /// Collective.
    pub fn krylov_bytes(&self) -> f64 {
        let per_product = self
            .bench
            .as_ref()
            .map_or(0, |bench| bench.bytes_of_product(self.part.layout.n_local));
        // Reads and writes of directions, solution, residual and preconditioned residual in the solver's loops, plus inverse
        // blocks, in single precision.
        let per_node = 3 * 4 * (3 + 2 + 6 + 2 + 2) + 6 * 4;
        let mut bytes = [(per_product + per_node * self.part.layout.n_owned) as f64];
        self.dynamics.comm.sum(&mut bytes);
        bytes[0]
    }

    /// Collects the figures of all ranks on rank 0.
    pub fn figures(&self) -> Vec<RankFigures> {
        let layout = &self.part.layout;
        let own = [
            layout.n_owned,
            layout.n_local - layout.n_owned,
            self.part.elements.len(),
            layout.neighbours.len(),
        ];
        let counts = self.traffic.counts();
        let own: Vec<f64> = own.into_iter().map(|n| n as f64).chain(counts).collect();
        let all = self.comm().gather(&own).unwrap_or_default();
        let figures = |f: &Vec<f64>| RankFigures {
            nodes: f[0] as u64,
            ghosts: f[1] as u64,
            elements: f[2] as u64,
            neighbours: f[3] as u64,
            halo_messages: f[4] as u64,
            halo_bytes: f[5] as u64,
            reductions: f[6] as u64,
        };
        all.iter().map(figures).collect()
    }

    /// Numbers per point of each point state.
    pub fn widths(&self) -> [usize; 4] {
        self.contraction.states().map(|(width, _)| width)
    }
}

fn load_right(dynamics: &mut Dynamics, course: Option<&PressureCourse>, time_ms: f64) {
    for (given, course) in dynamics.given_cavities.iter_mut().zip(course) {
        given.pressure_kpa = course.at(time_ms);
    }
}

fn inverted(s: Smallest) -> StepError {
    StepError::Inverted {
        element: s.element,
        volume_ratio: s.volume_ratio,
    }
}

pub(super) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text += &format!(": {inner}");
        source = inner.source();
    }
    text
}
