//! The finite-element implementation of the ventricle interface, on one rank or several.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

use cardiotwin_linalg::parallel::{
    Communicator, Crew, Part, SingleProcess, ThreadRank, ThreadSettings, crew,
};
use cardiotwin_models::circulation::{Circulation, CirculationError};
use cardiotwin_models::effects::FibreViscosity;
use cardiotwin_models::ventricle::{
    CavityPressureTerm, GroupContraction, TriedStep, Ventricle, VentricleError, VentricleSnapshot,
};
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};

use super::anatomy::Anatomy;
use super::contraction::SharedModel;
use super::end_diastole::EndDiastole;
use super::kernels::Kernel;
use super::numbering::GlobalNumbering;
use super::piece;
use super::rank::{Command, OrganRank, RankFigures, Setup, Values, chain};
use super::share::Share;
use super::wall::WallParameters;
use crate::dynamics::Dynamics;
use crate::step::{Closure, StepError, StepReport, StepSettings};

const KIND: &str = "finite-element 3";
/// Numbers of a snapshot before its values.
const N_SCALARS: usize = 6;
/// Values of a snapshot after its scalars, in this order; the vectors of the solver's memory follow, then each rank's levels
/// with their length.
const IN_SNAPSHOTS: [Values; 8] = [
    Values::Displacement,
    Values::Velocity,
    Values::Acceleration,
    Values::Force,
    Values::Cells,
    Values::PointStretch,
    Values::PointStress,
    Values::PointCalcium,
];

/// Definition of a finite-element ventricle.
#[derive(Debug)]
pub struct VentricleParts<'a> {
    /// Geometry, fibres and surfaces of the mesh.
    pub anatomy: &'a Anatomy,
    /// The wall, with the fitted passive law.
    pub wall: &'a WallParameters,
    /// Unloaded geometry and displacement at end-diastole, from which the beat starts.
    pub end_diastole: EndDiastole,
    /// Contraction model of all points.
    pub contraction: GroupContraction,
    /// Activation time of each vertex of the mesh \[ms\].
    pub activation_ms: &'a [f64],
    /// Cycle length, the period of each point's activation.
    pub cycle_length: Ms,
    /// Additional terms of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    /// Viscous stress along the fibre.
    pub viscosity: Option<FibreViscosity>,
    /// Settings of the time steps.
    pub settings: StepSettings,
}

/// Definition that a rank other than 0 needs of its own; the rest comes from rank 0.
#[derive(Debug)]
pub struct RankParts<'a> {
    /// The wall, with the fitted passive law.
    pub wall: &'a WallParameters,
    /// Contraction model of all points.
    pub contraction: GroupContraction,
    /// Cycle length, the period of each point's activation.
    pub cycle_length: Ms,
    /// Viscous stress along the fibre.
    pub viscosity: Option<FibreViscosity>,
    /// Settings of the time steps.
    pub settings: StepSettings,
}

/// Work of all steps so far, including failed ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VentricleWork {
    /// Number of steps tried.
    pub steps: usize,
    /// Number of Newton iterations.
    pub newton_iterations: usize,
    /// Number of Krylov iterations for both right-hand sides.
    pub krylov_iterations: usize,
    /// Number of factorisations of the tangent.
    pub factorisations: usize,
}

/// The 3D ventricle on rank 0, which commands the other ranks.
#[derive(Debug)]
pub struct FiniteElementVentricle {
    rank: OrganRank,
    census: GlobalNumbering,
    node_activation_ms: Vec<f64>,
    unloaded: Vec<f64>,
    pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
    time_ms: f64,
    volume_mm3: f64,
    /// Cavity pressure that the circulation sees, the wall's plus the additional terms' \[kPa\].
    cavity_kpa: f64,
    /// Rate of change of the wall's pressure over the last step \[kPa/ms\].
    rate_kpa_per_ms: f64,
    trial: Option<Trial>,
    work: VentricleWork,
    /// Whether the ranks are inside an operation and cannot receive commands.
    busy: AtomicBool,
    /// Threads of the other ranks, if the ranks are threads.
    crew: Option<Crew>,
}

#[derive(Debug)]
struct Trial {
    time_ms: f64,
    dt_ms: f64,
    wall_kpa: f64,
    volume_mm3: f64,
    cavity_kpa: f64,
}

/// Checks the definition before any rank is built.
fn checked(parts: &VentricleParts<'_>) -> Result<(), VentricleError> {
    let VentricleParts {
        anatomy,
        activation_ms,
        cycle_length,
        ..
    } = parts;
    let parameter = |name, value, expected| {
        Err(VentricleError::Parameter {
            name,
            value,
            expected,
        })
    };
    if activation_ms.len() != anatomy.n_vertices {
        return parameter(
            "activation times",
            activation_ms.len() as f64,
            "as many as the mesh has nodes",
        );
    }
    let mut of_muscle = vec![false; anatomy.n_vertices];
    for (corners, _) in anatomy
        .corners
        .iter()
        .zip(&anatomy.contracts)
        .filter(|(_, c)| **c)
    {
        corners.iter().for_each(|n| of_muscle[*n as usize] = true);
    }
    let latest = (0..anatomy.n_vertices)
        .filter(|n| of_muscle[*n])
        .map(|n| activation_ms[n])
        .fold(0.0, f64::max);
    if !latest.is_finite() {
        return parameter(
            "latest activation time",
            latest,
            "finite in all contracting tissue",
        );
    }
    if !(cycle_length.0 > latest && cycle_length.0.is_finite()) {
        return parameter(
            "cycle length",
            cycle_length.0,
            "longer than the latest activation time",
        );
    }
    Ok(())
}

fn parts_of(anatomy: &Anatomy, n_ranks: usize) -> Result<Vec<Part>, VentricleError> {
    if n_ranks > 1 && anatomy.nodes.len() != anatomy.n_vertices {
        let (name, value, expected) = ("ranks", n_ranks as f64, "1 with quadratic elements");
        return Err(VentricleError::Parameter {
            name,
            value,
            expected,
        });
    }
    piece::parts_of(anatomy, n_ranks).map_err(|error| VentricleError::NoMotion {
        t_ms: 0.0,
        dt_ms: 0.0,
        reason: chain(&error),
    })
}

impl FiniteElementVentricle {
    /// Builds a ventricle at end-diastole, at rest at time zero, on the calling thread.
    ///
    /// # Errors
    /// [`VentricleError::Parameter`] for a cycle that ends before the last activation, or activation times that do not match
    /// the mesh; [`VentricleError::NoMotion`] where the wall cannot be supported.
    pub fn new(parts: VentricleParts<'_>) -> Result<Self, VentricleError> {
        Self::on_threads(parts, 1, ThreadSettings::default())
    }

    /// Builds the ventricle on several threads, each with a part of the mesh; for linear elements and the solver
    /// [`crate::newton::LinearSolver::BlockJacobi`] only.
    ///
    /// A rank that panics or does not respond in time ends all ranks: the next operation then unwinds with the failure's text
    /// ([`cardiotwin_linalg::parallel::RankFailure`]).
    ///
    /// # Errors
    /// As for [`Self::new`]; [`VentricleError::Parameter`] for elements or a solver that do not run on several ranks.
    pub fn on_threads(
        parts: VentricleParts<'_>,
        n_ranks: usize,
        settings: ThreadSettings,
    ) -> Result<Self, VentricleError> {
        checked(&parts)?;
        let (setup, rest) = taken(parts);
        let mut of_ranks = parts_of(rest.anatomy, n_ranks)?.into_iter();
        let mut share =
            |part| Share::of(part, rest.anatomy, &rest.end_diastole, rest.activation_ms);
        let first = of_ranks.next().map(&mut share);
        let failed = |error: &dyn std::error::Error| VentricleError::NoMotion {
            t_ms: 0.0,
            dt_ms: 0.0,
            reason: chain(error),
        };
        let Some(first) = first else {
            unreachable!("there is a rank 0")
        };
        if n_ranks <= 1 {
            let rank = OrganRank::new(&setup, first, Box::new(SingleProcess))?;
            return Ok(Self::led_by(rank, rest, None));
        }
        let mut others = of_ranks
            .map(|part| share(part).into_owned())
            .collect::<Vec<_>>()
            .into_iter();
        let (comm, crew) = crew(n_ranks, settings, |_| {
            let (setup, share) = (setup.clone(), others.next());
            move |comm: ThreadRank| {
                let Some(share) = share else { return };
                match OrganRank::new(&setup, share, Box::new(comm)) {
                    Ok(rank) => {
                        GlobalNumbering::take(&rank);
                        rank.serve();
                    }
                    Err(error) => resume_unwind(Box::new(chain(&error))),
                }
            }
        })
        .map_err(|error| failed(&error))?;
        let made = catch_unwind(AssertUnwindSafe(|| {
            OrganRank::new(&setup, first, Box::new(comm))
        }));
        match made {
            Ok(rank) => Ok(Self::led_by(rank?, rest, Some(crew))),
            Err(payload) => match crew.failure() {
                Some(failure) => Err(failed(&failure)),
                None => resume_unwind(payload),
            },
        }
    }

    /// Checks, without building it, whether a ventricle can be built of these parts on `n_ranks` ranks; finds the errors that
    /// all ranks would find.
    ///
    /// # Errors
    /// As for [`Self::on_threads`].
    pub fn check(parts: &VentricleParts<'_>, n_ranks: usize) -> Result<(), VentricleError> {
        checked(parts)?;
        parts_of(parts.anatomy, n_ranks).map(|_| ())
    }

    /// Builds rank 0 of the ranks joined by `comm`. The other ranks call [`Self::serve`] and receive their part of the mesh
    /// from here, so that none of them ever holds all of it. Collective.
    ///
    /// # Errors
    /// As for [`Self::on_threads`], on all ranks or on this one alone: the launcher of the ranks has to end the others.
    pub fn lead(
        parts: VentricleParts<'_>,
        comm: Box<dyn Communicator>,
    ) -> Result<Self, VentricleError> {
        checked(&parts)?;
        let (setup, rest) = taken(parts);
        let mut of_ranks = parts_of(rest.anatomy, comm.n_ranks())?.into_iter();
        let share = |part| Share::of(part, rest.anatomy, &rest.end_diastole, rest.activation_ms);
        let own = of_ranks.next().map(share);
        let Some(own) = own else {
            unreachable!("there is a rank 0")
        };
        comm.scatter(
            std::iter::once(vec![])
                .chain(of_ranks.map(|part| share(part).message()))
                .collect(),
        );
        Ok(Self::led_by(OrganRank::new(&setup, own, comm)?, rest, None))
    }

    /// Runs any other rank: executes rank 0's commands until its ventricle is dropped.
    ///
    /// # Errors
    /// As for [`Self::lead`].
    pub fn serve(parts: RankParts<'_>, comm: Box<dyn Communicator>) -> Result<(), VentricleError> {
        let setup = parts.into();
        let share = Share::from_message(&comm.scatter(vec![]));
        let rank = OrganRank::new(&setup, share, comm)?;
        GlobalNumbering::take(&rank);
        rank.serve();
        Ok(())
    }

    fn led_by(rank: OrganRank, rest: Rest<'_>, crew: Option<Crew>) -> Self {
        let census = GlobalNumbering::take(&rank);
        let node_activation_ms = census
            .muscle_nodes
            .iter()
            .map(|n| rest.activation_ms[*n as usize])
            .collect();
        let unloaded = rest.end_diastole.unloaded.as_flattened().to_vec();
        let terms = rest.pressure_terms;
        let mut ventricle = Self {
            census,
            node_activation_ms,
            unloaded,
            time_ms: 0.0,
            volume_mm3: 0.0,
            cavity_kpa: rank.now.pressure_kpa,
            pressure_terms: terms,
            rate_kpa_per_ms: 0.0,
            trial: None,
            work: VentricleWork::default(),
            busy: AtomicBool::new(false),
            crew,
            rank,
        };
        ventricle.volume_mm3 = ventricle.do_with(Command::Volume, |rank| rank.volume_mm3());
        let volume_ml = 1e-3 * ventricle.volume_mm3;
        ventricle.cavity_kpa += ventricle
            .pressure_terms
            .iter()
            .map(|t| t.pressure(volume_ml, 0.0).0 / MMHG_PER_KPA)
            .sum::<f64>();
        ventricle
    }

    /// Sends a command to all ranks, and executes it on rank 0.
    fn do_with<T>(&mut self, command: Command, own: impl FnOnce(&mut OrganRank) -> T) -> T {
        self.busy.store(true, Ordering::Relaxed);
        self.rank.tell(command);
        let out = own(&mut self.rank);
        self.busy.store(false, Ordering::Relaxed);
        out
    }

    fn of_each_rank(&self, values: Values) -> Vec<Vec<f64>> {
        self.busy.store(true, Ordering::Relaxed);
        self.rank.tell(Command::Collect(values));
        let of_ranks = self.rank.collect(values).unwrap_or_default();
        self.busy.store(false, Ordering::Relaxed);
        of_ranks
    }

    fn collected(&self, values: Values) -> Vec<f64> {
        let of_ranks = self.of_each_rank(values);
        self.census.merged(values.places(), &of_ranks)
    }

    fn hand_out(&mut self, values: Values, all: &[f64]) {
        let parts = self.census.split(values.places(), all);
        self.do_with(Command::HandOut(values), |rank| rank.take(values, parts));
    }

    /// Number of ranks that compute the ventricle.
    #[must_use]
    pub fn n_ranks(&self) -> usize {
        self.rank.comm().n_ranks()
    }

    /// Work of all steps so far.
    #[must_use]
    pub fn work(&self) -> VentricleWork {
        self.work
    }

    /// Committed displacement from the unloaded geometry \[mm\], three numbers a node.
    #[must_use]
    pub fn displacement_mm(&self) -> Vec<f64> {
        self.collected(Values::Displacement)
    }

    /// Unloaded node positions \[mm\], three numbers a node.
    #[must_use]
    pub fn unloaded_mm(&self) -> &[f64] {
        &self.unloaded
    }

    /// The part of the moving wall that rank 0 holds: the whole wall if there is only one rank.
    #[must_use]
    pub fn dynamics(&self) -> &Dynamics {
        &self.rank.dynamics
    }

    /// Runs a kernel on all ranks, for measurements; `false` for elements without this kernel.
    pub fn run(&mut self, kernel: Kernel) -> bool {
        self.do_with(Command::Run(kernel), |rank| rank.run(kernel))
            .is_some()
    }

    /// Bytes that an iteration of [`Kernel::Krylov`] moves through memory; run that kernel first.
    pub fn krylov_bytes(&mut self) -> f64 {
        self.do_with(Command::KrylovBytes, |rank| rank.krylov_bytes())
    }

    /// Size of each rank's part and its communication so far.
    pub fn of_ranks(&mut self) -> Vec<RankFigures> {
        self.do_with(Command::Figures, |rank| rank.figures())
    }

    /// Nodes (vertices of the mesh) of the nodal traces.
    #[must_use]
    pub fn nodes(&self) -> &[u32] {
        &self.census.muscle_nodes
    }

    /// Discards the solver's memory that a snapshot omits (a factorisation). Called before a checkpoint, it makes a restarted
    /// beat equal the uninterrupted one to the bit with a direct solver, too.
    pub fn forget_solver(&mut self) {
        self.do_with(Command::Forget, OrganRank::forget);
    }
}

impl Drop for FiniteElementVentricle {
    fn drop(&mut self) {
        // Threads end with their crew; other ranks need a command, if they are listening.
        if self.crew.is_none() && !self.busy.load(Ordering::Relaxed) && !std::thread::panicking() {
            self.rank.tell(Command::Stop);
        }
    }
}

/// Parts of the definition that stay on rank 0 or are partitioned.
struct Rest<'a> {
    anatomy: &'a Anatomy,
    end_diastole: EndDiastole,
    activation_ms: &'a [f64],
    pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
}

fn taken(parts: VentricleParts<'_>) -> (Setup, Rest<'_>) {
    let VentricleParts {
        anatomy,
        wall,
        end_diastole,
        contraction,
        activation_ms,
        cycle_length,
        ..
    } = parts;
    let VentricleParts {
        pressure_terms,
        viscosity,
        settings,
        ..
    } = parts;
    let setup = RankParts {
        wall,
        contraction,
        cycle_length,
        viscosity,
        settings,
    }
    .into();
    (
        setup,
        Rest {
            anatomy,
            end_diastole,
            activation_ms,
            pressure_terms,
        },
    )
}

impl From<RankParts<'_>> for Setup {
    fn from(parts: RankParts<'_>) -> Self {
        Self {
            wall: parts.wall.clone(),
            contraction: SharedModel::new(parts.contraction),
            cycle_length_ms: parts.cycle_length.0,
            viscosity: parts.viscosity,
            settings: parts.settings,
        }
    }
}

/// The numbers of each rank, each list with its length before it; `None` where lengths and numbers do not agree.
fn levels_of_ranks(mut rest: &[f64]) -> Option<Vec<Vec<f64>>> {
    let mut levels = vec![];
    while let Some((n, others)) = rest.split_first() {
        let (own, others) = others.split_at_checked(*n as usize)?;
        levels.push(own.to_vec());
        rest = others;
    }
    Some(levels)
}

/// Cavity pressure \[kPa\], remaining volume \[mm³\] and the volume's slope for a wall pressure, from the circulation.
fn balance(
    circulation: &mut Circulation,
    terms: &[Box<dyn CavityPressureTerm>],
    start_mm3: f64,
    dt_ms: f64,
    wall_kpa: f64,
) -> Result<(f64, f64, f64), CirculationError> {
    let mut cavity = wall_kpa;
    for iteration in 0.. {
        let flow = circulation.try_step(Mmhg(cavity * MMHG_PER_KPA), Ms(dt_ms))?;
        // A flow in mL/s times ms is a volume in mm³.
        let volume = start_mm3 + dt_ms * flow.inflow_ml_per_s;
        let slope = dt_ms * flow.slope_ml_per_s_per_mmhg * MMHG_PER_KPA;
        if terms.is_empty() {
            return Ok((cavity, volume, slope));
        }
        let (mut added, mut added_slope) = (0.0, 0.0);
        for term in terms {
            let (p, by_volume, by_rate) = term.pressure(volume * 1e-3, flow.inflow_ml_per_s);
            added += p / MMHG_PER_KPA;
            added_slope += (by_volume * 1e-3 + by_rate / dt_ms) / MMHG_PER_KPA;
        }
        // p − p_wall − added(W(p)) grows with p, since W falls with p and the added pressure grows with volume.
        let gain = 1.0 - added_slope * slope;
        let change = (cavity - wall_kpa - added) / gain;
        if change.abs() <= 1e-12 * (1.0 + cavity.abs()) || iteration >= 50 || !change.is_finite() {
            return Ok((cavity, volume, slope / gain));
        }
        cavity -= change;
    }
    unreachable!("the loop returns")
}

impl Ventricle for FiniteElementVentricle {
    fn time(&self) -> Ms {
        Ms(self.time_ms)
    }

    fn volume(&self) -> Ml {
        Ml(self.volume_mm3 * 1e-3)
    }

    fn pressure(&self) -> Mmhg {
        Mmhg(self.cavity_kpa * MMHG_PER_KPA)
    }

    fn try_step(
        &mut self,
        circulation: &mut Circulation,
        dt: Ms,
    ) -> Result<TriedStep, VentricleError> {
        self.trial = None;
        if !(dt.0 > 0.0 && dt.0.is_finite()) {
            return Err(VentricleError::Parameter {
                name: "time step",
                value: dt.0,
                expected: "positive",
            });
        }
        let dt_ms = dt.0;
        let end_ms = self.time_ms + dt_ms;
        let rate_kpa_per_ms = if self.rank.settings.extrapolate {
            self.rate_kpa_per_ms
        } else {
            0.0
        };
        let pressure_kpa = self.rank.now.pressure_kpa + dt_ms * rate_kpa_per_ms;
        let mut cavity_kpa = self.cavity_kpa;
        self.work.steps += 1;
        self.busy.store(true, Ordering::Relaxed);
        self.rank.tell(Command::Try {
            end_ms,
            dt_ms,
            pressure_kpa,
        });
        let (start, terms) = (self.volume_mm3, &self.pressure_terms);
        let mut volume_for = |wall_kpa: f64| {
            let (cavity, volume, slope) = balance(circulation, terms, start, dt_ms, wall_kpa)?;
            cavity_kpa = cavity;
            Ok((volume, slope))
        };
        let result = self.rank.try_step(
            [end_ms, dt_ms, pressure_kpa],
            &mut Closure::Balance(&mut volume_for),
        );
        self.busy.store(false, Ordering::Relaxed);
        let (report, volume_mm3, wall_kpa) = result.map_err(|error| match error {
            StepError::Contraction(source) => VentricleError::Contraction {
                t_ms: end_ms,
                source,
            },
            StepError::Circulation(source) => VentricleError::Circulation(source),
            other => VentricleError::NoMotion {
                t_ms: end_ms,
                dt_ms,
                reason: chain(&other),
            },
        })?;
        let StepReport {
            iterations,
            krylov_iterations,
            factorisations,
            volume_residual_mm3,
            ..
        } = report;
        self.work.newton_iterations += iterations;
        self.work.krylov_iterations += krylov_iterations;
        self.work.factorisations += factorisations;
        // The volume changes by exactly the flow through the valves, so that the residual does not accumulate.
        let volume_mm3 = volume_mm3 - volume_residual_mm3;
        self.trial = Some(Trial {
            time_ms: end_ms,
            dt_ms,
            wall_kpa,
            volume_mm3,
            cavity_kpa,
        });
        Ok(TriedStep {
            pressure: Mmhg(cavity_kpa * MMHG_PER_KPA),
            volume: Ml(volume_mm3 * 1e-3),
            iterations,
        })
    }

    fn commit(&mut self) {
        if let Some(trial) = self.trial.take() {
            self.rate_kpa_per_ms = (trial.wall_kpa - self.rank.now.pressure_kpa) / trial.dt_ms;
            self.time_ms = trial.time_ms;
            self.volume_mm3 = trial.volume_mm3;
            self.cavity_kpa = trial.cavity_kpa;
            self.do_with(Command::Commit, OrganRank::commit);
        }
    }

    fn roll_back(&mut self) {
        self.trial = None;
        self.do_with(Command::RollBack, OrganRank::roll_back);
    }

    fn activation_times_ms(&self) -> &[f64] {
        &self.node_activation_ms
    }

    fn node_weights(&self) -> &[f64] {
        &self.census.weights
    }

    fn active_stress_kpa(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.collected(Values::Stress));
    }

    fn calcium_um(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.collected(Values::Calcium));
    }

    fn stretch(&self, out: &mut [f64]) {
        out.copy_from_slice(&self.collected(Values::Stretch));
    }

    fn snapshot(&self) -> VentricleSnapshot {
        let pressure_kpa = self.rank.now.pressure_kpa;
        let mut values = vec![
            self.time_ms,
            self.volume_mm3,
            self.cavity_kpa,
            self.rate_kpa_per_ms,
            pressure_kpa,
            self.rank.n_memories() as f64,
        ];
        let memory = (0..self.rank.n_memories()).map(Values::Memory);
        for part in IN_SNAPSHOTS.into_iter().chain(memory) {
            values.extend(self.collected(part));
        }
        for levels in self.of_each_rank(Values::Levels) {
            values.push(levels.len() as f64);
            values.extend(levels);
        }
        VentricleSnapshot {
            kind: KIND.to_owned(),
            values,
        }
    }

    fn restore(&mut self, snapshot: &VentricleSnapshot) -> Result<(), VentricleError> {
        let widths = self.rank.widths();
        let parts: Vec<(Values, usize)> = (IN_SNAPSHOTS.into_iter())
            .map(|part| {
                (
                    part,
                    self.census
                        .n_values(part.places(), part.of_points().map_or(3, |k| widths[k])),
                )
            })
            .collect();
        let n_memories = snapshot.values.get(5).map_or(0, |n| *n as usize);
        let expected_values = N_SCALARS
            + parts.iter().map(|(_, n)| n).sum::<usize>()
            + n_memories.saturating_mul(self.unloaded.len());
        let levels = snapshot
            .values
            .get(expected_values..)
            .and_then(levels_of_ranks);
        let Some(levels) = levels.filter(|_| snapshot.kind == KIND) else {
            return Err(VentricleError::ForeignSnapshot {
                found: snapshot.kind.clone(),
                found_values: snapshot.values.len(),
                expected: KIND,
                expected_values,
            });
        };
        let (scalars, mut rest) = snapshot.values.split_at(N_SCALARS);
        self.time_ms = scalars[0];
        self.volume_mm3 = scalars[1];
        self.cavity_kpa = scalars[2];
        self.rate_kpa_per_ms = scalars[3];
        self.trial = None;
        let pressure_kpa = scalars[4];
        self.do_with(Command::Resume { pressure_kpa }, |rank| {
            rank.resume(pressure_kpa)
        });
        for (part, n) in parts {
            let (own, others) = rest.split_at(n);
            rest = others;
            self.hand_out(part, own);
        }
        let memory = &rest[..n_memories * self.unloaded.len()];
        for (k, vector) in memory.chunks_exact(self.unloaded.len()).enumerate() {
            self.hand_out(Values::Memory(k), vector);
        }
        // Levels belong to a partition; another number of ranks makes its own.
        if levels.len() == self.n_ranks() {
            self.do_with(Command::HandOut(Values::Levels), |rank| {
                rank.take(Values::Levels, levels);
            });
        }
        Ok(())
    }
}
