//! Step 0: the unloaded geometry behind an image, and its inflation.
//!
//! The unloaded geometry is found by backward displacement (Sellier 2011, Comput Methods Appl Mech Eng 200:2325): the
//! difference between the image and the inflated geometry is added to the nodes until it vanishes. Every inflation after the
//! first starts from the previous equilibrium and needs no load steps.

use std::ops::ControlFlow;

use cardiotwin_linalg::parallel::{Communicator, VectorLayout};

use super::farthest::Farthest;
use super::passive_state_error::PassiveStateError;
use super::piece::Piece;
use super::rigid::rigid_motion;
use super::search::{Place, Search};
use super::wall::{WallParameters, displacement};
use crate::dynamics::{Candidate, Dynamics, State};
use crate::step::{Closure, Passive, Solver, StepError, StepReport, StepSettings, step_watched};
use crate::time_integration::Motion;

/// A time step so long that inertia and damping vanish \[ms\].
const FOREVER_MS: f64 = 1e7;

/// Largest distance of a node from its image at which the pressure may take its next load step towards the image's \[mm\].
const NEAR_MM: f64 = 0.5;
/// Share of the backward displacement below which the search gives up.
const SMALLEST_SHARE: f64 = 0.1;
/// Maximum number of steps of a relaxation.
const MOST_RELAXATIONS: usize = 60;

/// A wall with its unloaded geometry, in equilibrium under a pressure.
#[derive(Debug)]
pub struct PassiveState {
    /// The wall on its supports.
    pub dynamics: Dynamics,
    /// Stiffness of the passive law ([`crate::material::Law::stiffness_kpa`]) \[kPa\].
    pub stiffness_kpa: f64,
    /// Displacement from the unloaded geometry \[mm\], three numbers a node.
    pub u: Vec<f64>,
    /// Pressure in the left cavity \[kPa\].
    pub pressure_kpa: f64,
    /// Newton iterations so far.
    pub newton_iterations: usize,
    /// Passes of the unloading so far.
    pub passes: usize,
    /// Rest position of the supports relative to the image \[mm\], a rigid motion; it lets them balance the load's resultant.
    anchor: Vec<f64>,
    /// Ratio of right to left ventricular pressure.
    right_per_left: f64,
    solver: Solver,
}

impl PassiveState {
    /// Takes the image as unloaded. Collective, as are all further methods.
    ///
    /// # Errors
    /// [`PassiveStateError::Wall`] for bad parameters or surfaces.
    pub fn unloaded_image(
        piece: &Piece<'_>,
        wall: &WallParameters,
    ) -> Result<Self, PassiveStateError> {
        let nodes = &piece.anatomy.nodes;
        Self::at(piece, wall, nodes, vec![0.0; 3 * nodes.len()])
    }

    pub(super) fn at(
        piece: &Piece<'_>,
        wall: &WallParameters,
        unloaded: &[[f64; 3]],
        anchor: Vec<f64>,
    ) -> Result<Self, PassiveStateError> {
        let comm = Box::new(piece.comm.clone());
        let dynamics =
            wall.assemble_static(&piece.anatomy, unloaded, &anchor, &piece.part, comm)?;
        let (u, solver) = (vec![0.0; 3 * unloaded.len()], Solver::new());
        let stiffness_kpa = wall.muscle.stiffness_kpa();
        let right_per_left = wall
            .right_pressure
            .as_ref()
            .map_or(0.0, |right| right.per_left);
        let (pressure_kpa, newton_iterations, passes) = (0.0, 0, 0);
        Ok(Self {
            dynamics,
            stiffness_kpa,
            u,
            pressure_kpa,
            newton_iterations,
            passes,
            anchor,
            right_per_left,
            solver,
        })
    }

    /// Rest position of the supports relative to the image \[mm\], three numbers a node.
    #[must_use]
    pub fn anchor(&self) -> &[f64] {
        &self.anchor
    }

    /// Continues from another state: adds its work counts and takes over its factorisation.
    pub(super) fn after(mut self, before: &mut Self) -> Self {
        self.solver.take_over(&mut before.solver);
        Self {
            newton_iterations: before.newton_iterations,
            passes: before.passes,
            ..self
        }
    }

    /// Volume of the left cavity \[mm³\].
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        self.dynamics.cavity_volume(&self.u)
    }

    /// Volume of the left cavity in the unloaded geometry \[mm³\].
    #[must_use]
    pub fn unloaded_volume_mm3(&self) -> f64 {
        self.dynamics.cavity_volume(&vec![0.0; self.u.len()])
    }

    /// Unloaded node positions \[mm\].
    #[must_use]
    pub fn unloaded(&self) -> &[[f64; 3]] {
        self.dynamics.body.reference().as_chunks::<3>().0
    }

    /// Place in the search of an equilibrium at `pressure_kpa`.
    fn place(&self, pressure_kpa: f64) -> Place {
        Place {
            passes: self.passes,
            pressure_kpa,
        }
    }

    /// Solves for equilibrium at `pressure_kpa` from `guess` in a single step. The outer error ends the search.
    fn settle(
        &mut self,
        guess: Vec<f64>,
        pressure_kpa: f64,
        search: &mut Search<'_>,
    ) -> Result<Result<(), StepError>, PassiveStateError> {
        self.settle_within(FOREVER_MS, guess, pressure_kpa, search)
    }

    /// Solves a time step of `dt_ms` from rest at `guess`, without damping. The outer error ends the search.
    fn settle_within(
        &mut self,
        dt_ms: f64,
        guess: Vec<f64>,
        pressure_kpa: f64,
        search: &mut Search<'_>,
    ) -> Result<Result<(), StepError>, PassiveStateError> {
        let n = guess.len();
        let newton = search.settings.newton;
        let now = State {
            motion: Motion::at_rest(guess.clone()),
            force: vec![0.0; n],
            pressure_kpa,
        };
        let mut candidate = Candidate {
            motion: Motion {
                u: guess,
                ..Motion::default()
            },
            ..Candidate::default()
        };
        let newton = StepSettings {
            least_pressure_kpa: newton.least_pressure_kpa.min(pressure_kpa.abs()).max(1e-3),
            ..newton
        };
        for given in &mut self.dynamics.given_cavities {
            given.pressure_kpa = self.right_per_left * pressure_kpa;
        }
        let mut closure = Closure::Pressure(pressure_kpa);
        let place = self.place(pressure_kpa);
        let (mut counted, mut ended) = (StepReport::default(), None);
        let mut watch = |report: &StepReport| match search.iterate(
            &*self.dynamics.comm,
            place,
            report,
            &mut counted,
        ) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                ended = Some(error);
                ControlFlow::Break(())
            }
        };
        let found = step_watched(
            &self.dynamics,
            (&now, dt_ms),
            &mut candidate,
            &mut Passive,
            &mut closure,
            &mut self.solver,
            &newton,
            &mut watch,
        );
        if let Some(error) = ended {
            return Err(error);
        }
        match found {
            Ok((_, report)) => {
                search.count(&report, &mut counted);
                self.newton_iterations += report.iterations;
                self.u = candidate.motion.u;
                self.pressure_kpa = pressure_kpa;
                Ok(Ok(()))
            }
            Err(error) => {
                if let StepError::Linear { iterations, .. } = error {
                    search.work.krylov_iterations += iterations;
                }
                search.failed = Some(error.clone());
                Ok(Err(error))
            }
        }
    }

    /// Relaxes the wall to equilibrium at `pressure_kpa` by time steps with mass, stopped after each. This is the last resort
    /// where Newton's method alone fails: each step lowers the energy, however far the equilibrium is.
    fn relax(
        &mut self,
        pressure_kpa: f64,
        search: &mut Search<'_>,
    ) -> Result<(), PassiveStateError> {
        let mut dt_ms = 2.0;
        let mut last = None;
        for _ in 0..MOST_RELAXATIONS {
            search.go_on(&*self.dynamics.comm, self.place(pressure_kpa))?;
            match self.settle_within(dt_ms, self.u.clone(), pressure_kpa, search)? {
                Ok(()) if dt_ms >= FOREVER_MS => return Ok(()),
                Ok(()) if dt_ms > 1e3 => dt_ms = FOREVER_MS,
                Ok(()) => dt_ms *= 2.0,
                Err(_) if dt_ms >= FOREVER_MS => dt_ms = 100.0,
                Err(error) => {
                    dt_ms *= 0.25;
                    last = Some(error);
                }
            }
        }
        let source = last.unwrap_or(StepError::NotFinite {
            what: "the relaxation",
        });
        Err(PassiveStateError::Inflation {
            reached_kpa: self.pressure_kpa,
            wanted_kpa: pressure_kpa,
            source,
        })
    }

    /// Inflates (or deflates) to `pressure_kpa` in steps that are halved on failure and grow after success.
    ///
    /// # Errors
    /// [`PassiveStateError::Inflation`]; the state is then the last equilibrium.
    pub fn inflate(
        &mut self,
        pressure_kpa: f64,
        search: &mut Search<'_>,
    ) -> Result<(), PassiveStateError> {
        let settings = search.settings;
        let (start, wanted) = (self.pressure_kpa, pressure_kpa);
        let mut reached = 0.0;
        let mut load = settings.first_load;
        let mut before: Option<(f64, Vec<f64>)> = None;
        while reached < 1.0 {
            let target = if reached + load > 1.0 - 1e-9 {
                1.0
            } else {
                reached + load
            };
            let p = start + target * (wanted - start);
            let ahead = before
                .as_ref()
                .map(|(l, u)| ((target - reached) / (reached - l), u));
            let guess = match ahead {
                Some((ratio, last)) => self
                    .u
                    .iter()
                    .zip(last)
                    .map(|(u, b)| u + ratio * (u - b))
                    .collect(),
                None => self.u.clone(),
            };
            search.go_on(&*self.dynamics.comm, self.place(p))?;
            let here = self.u.clone();
            match self.settle(guess, p, search)? {
                Ok(()) => {
                    before = Some((reached, here));
                    reached = target;
                    load *= 1.5;
                }
                Err(source) => {
                    load = 0.5 * (target - reached);
                    before = None;
                    if load < settings.smallest_load {
                        match self.relax(p, search) {
                            Ok(()) => {}
                            Err(error) if error.ends_the_law() => return Err(error),
                            Err(_) => {
                                return Err(PassiveStateError::Inflation {
                                    reached_kpa: self.pressure_kpa,
                                    wanted_kpa: wanted,
                                    source,
                                });
                            }
                        }
                        (reached, load) = (target, settings.first_load);
                    }
                }
            }
        }
        Ok(())
    }

    /// Inflates to `pressure_kpa` at once from the `expected` positions, or in steps if that fails.
    ///
    /// - `expected`: node positions, three numbers a node \[mm\]
    ///
    /// # Errors
    /// [`PassiveStateError::Inflation`]; the state is then the last equilibrium.
    pub(super) fn inflate_towards(
        &mut self,
        pressure_kpa: f64,
        expected: Option<&[f64]>,
        search: &mut Search<'_>,
    ) -> Result<(), PassiveStateError> {
        if let Some(expected) = expected {
            search.go_on(&*self.dynamics.comm, self.place(pressure_kpa))?;
            let guess = expected
                .iter()
                .zip(self.dynamics.body.reference())
                .map(|(x, r)| x - r)
                .collect();
            if self.settle(guess, pressure_kpa, search)?.is_ok() {
                return Ok(());
            }
        }
        self.inflate(pressure_kpa, search)
    }

    /// Current node positions \[mm\], three numbers a node.
    pub(super) fn positions(&self) -> Vec<f64> {
        self.dynamics
            .body
            .reference()
            .iter()
            .zip(&self.u)
            .map(|(x, u)| x + u)
            .collect()
    }

    /// Finds the unloaded geometry that `pressure_kpa` inflates to the image; the state ends in that equilibrium. It starts
    /// from a geometry found before, else from the image under a growing pressure, in steps that are halved on failure.
    ///
    /// # Errors
    /// [`PassiveStateError`] when the smallest pressure step fails or the passes do not converge.
    pub fn unload(
        &mut self,
        piece: &Piece<'_>,
        wall: &WallParameters,
        pressure_kpa: f64,
        search: &mut Search<'_>,
    ) -> Result<(), PassiveStateError> {
        if self.passes > 0 {
            let mut again =
                Self::at(piece, wall, self.unloaded(), self.anchor.clone())?.after(self);
            match again.meet_image(piece, wall, pressure_kpa, [true, false], search) {
                Ok(()) => {
                    *self = again;
                    return Ok(());
                }
                Err(error) if error.ends_the_law() => return Err(error),
                Err(_) => {}
            }
        }
        *self = Self::unloaded_image(piece, wall)?.after(self);
        let (mut reached, mut load) = (0.0, search.settings.first_load);
        let mut before: Option<(f64, Vec<[f64; 3]>)> = None;
        while reached < 1.0 {
            let target = if reached + load > 1.0 - 1e-9 {
                1.0
            } else {
                reached + load
            };
            let mut start = self.unloaded().to_vec();
            if let Some((load, nodes)) = &before {
                let ratio = (target - reached) / (reached - load);
                for (x, b) in start.iter_mut().zip(nodes) {
                    (0..3).for_each(|i| x[i] += ratio * (x[i] - b[i]));
                }
            }
            let patient = load < search.settings.first_load;
            let attempt = Self::at(piece, wall, &start, self.anchor.clone()).and_then(|next| {
                let mut next = next.after(self);
                next.meet_image(
                    piece,
                    wall,
                    target * pressure_kpa,
                    [target == 1.0, patient],
                    search,
                )?;
                Ok(next)
            });
            match attempt {
                Ok(next) => {
                    before = Some((reached, self.unloaded().to_vec()));
                    *self = next;
                    reached = target;
                    load *= 1.5;
                }
                Err(error) => {
                    load = 0.5 * (target - reached);
                    before = None;
                    if load < search.settings.smallest_load || error.ends_the_law() {
                        return Err(error);
                    }
                }
            }
        }
        Ok(())
    }

    /// Runs passes of backward displacement at one pressure.
    ///
    /// - `tight`: iterates until the image is met; otherwise runs a single pass, or, with `patient`, until it is nearly met
    /// - `patient`: also relaxes the wall where Newton's method finds no equilibrium
    fn meet_image(
        &mut self,
        piece: &Piece<'_>,
        wall: &WallParameters,
        pressure_kpa: f64,
        [tight, patient]: [bool; 2],
        search: &mut Search<'_>,
    ) -> Result<(), PassiveStateError> {
        let settings = search.settings;
        let flat_image = piece.anatomy.nodes.as_flattened();
        let image_volume = self
            .dynamics
            .cavity_volume(&displacement(&piece.anatomy.nodes, self.unloaded()));
        let mut last_mm = f64::INFINITY;
        let mut mixing = Mixing::default();
        for pass in 1.. {
            search.go_on(&*self.dynamics.comm, self.place(pressure_kpa))?;
            let guess = displacement(&piece.anatomy.nodes, self.unloaded());
            match self.settle(guess.clone(), pressure_kpa, search)? {
                Ok(()) => {}
                Err(_) if patient => {
                    self.u = guess;
                    self.relax(pressure_kpa, search)?;
                }
                Err(source) => {
                    let wanted_kpa = pressure_kpa;
                    return Err(PassiveStateError::Inflation {
                        reached_kpa: 0.0,
                        wanted_kpa,
                        source,
                    });
                }
            }
            self.passes += 1;
            let miss: Vec<f64> = (self
                .dynamics
                .body
                .reference()
                .iter()
                .zip(&self.u)
                .zip(flat_image))
            .map(|((x, u), image)| x + u - image)
            .collect();
            let volume_error = (self.volume_mm3() - image_volume).abs() / image_volume;
            let farthest = farthest(&*self.dynamics.comm, &miss, &piece.anatomy.nodes);
            search.farthest = Some(farthest);
            let distance_mm = farthest.distance_mm;
            if tight
                && volume_error <= settings.volume_tolerance
                && distance_mm <= settings.distance_tolerance_mm
            {
                return Ok(());
            }
            let not_unloaded = PassiveStateError::NotUnloaded {
                passes: pass,
                volume_error,
                farthest,
            };
            if pass as f64 >= settings.max_passes as f64 / mixing.share {
                return Err(not_unloaded);
            }
            if distance_mm > 1.5 * last_mm {
                let Some(unloaded) = mixing.nearer() else {
                    return Err(not_unloaded);
                };
                *self = Self::at(
                    piece,
                    wall,
                    unloaded.as_chunks::<3>().0,
                    self.anchor.clone(),
                )?
                .after(self);
                continue;
            }
            last_mm = distance_mm;
            // A load with a resultant shifts the heart on its supports: the supports follow, and the unloaded geometry stays.
            let rigid = rigid_motion(self.dynamics.space(), &piece.anatomy.nodes, &miss);
            let strain: Vec<f64> = miss
                .iter()
                .zip(&rigid)
                .map(|(miss, rigid)| miss - rigid)
                .collect();
            let moved = mixing.next(
                self.dynamics.space(),
                self.dynamics.body.reference(),
                strain,
            );
            let anchor = self
                .anchor
                .iter()
                .zip(&rigid)
                .map(|(anchor, rigid)| anchor - rigid)
                .collect();
            *self = Self::at(piece, wall, moved.as_chunks::<3>().0, anchor)?.after(self);
            if !tight && (!patient || distance_mm <= NEAR_MM) {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// The node of the image whose distance is largest. Collective.
///
/// - `miss`: distances of the nodes from their places in the image, three numbers a node \[mm\]
fn farthest(comm: &dyn Communicator, miss: &[f64], image: &[[f64; 3]]) -> Farthest {
    let mut own = (0.0, [f64::NEG_INFINITY; 3]);
    for (miss, node) in miss.as_chunks::<3>().0.iter().zip(image) {
        let length = miss.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > own.0 {
            own = (length, *node);
        }
    }
    let mut largest = [own.0];
    comm.max(&mut largest);
    let [distance_mm] = largest;
    // The rank that has this node tells its place.
    let mut at_mm = if own.0 == distance_mm {
        own.1
    } else {
        [f64::NEG_INFINITY; 3]
    };
    comm.max(&mut at_mm);
    Farthest { distance_mm, at_mm }
}

/// Anderson mixing of depth one for the backward displacement: from the second pass on, the step length follows from how the
/// last change altered the error. In a soft heart at high pressure the step is too long; the last change is then halved.
#[derive(Debug)]
struct Mixing {
    /// Last error, and the change of geometry that followed it.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Unloaded nodes with the smallest error, and this error \[mm\].
    nearest: Option<(Vec<f64>, Vec<f64>)>,
    /// Share of the computed change that is applied.
    share: f64,
}

impl Default for Mixing {
    fn default() -> Self {
        Self {
            last: None,
            nearest: None,
            share: 1.0,
        }
    }
}

impl Mixing {
    /// Next unloaded nodes after `unloaded`, whose inflated geometry misses the image by `miss` \[mm\]. Collective.
    fn next(&mut self, space: VectorLayout<'_>, unloaded: &[f64], miss: Vec<f64>) -> Vec<f64> {
        let mut change: Vec<f64> = miss.iter().map(|m| -m).collect();
        if let Some((before, moved)) = &self.last {
            let mut sums = [0.0; 2];
            for (m, b) in miss.iter().zip(before).take(space.n_owned()) {
                sums[0] += m * (m - b);
                sums[1] += (m - b) * (m - b);
            }
            space.comm.sum(&mut sums);
            let [along, square] = sums;
            // Limits the extrapolation to twice the last change: beyond it the iteration is no contraction.
            let mixed = if square > 0.0 {
                (along / square).clamp(-2.0, 1.0)
            } else {
                0.0
            };
            for ((c, moved), (m, b)) in change.iter_mut().zip(moved).zip(miss.iter().zip(before)) {
                *c -= mixed * (moved - (m - b));
            }
        }
        change.iter_mut().for_each(|c| *c *= self.share);
        let next = unloaded.iter().zip(&change).map(|(x, c)| x + c).collect();
        self.nearest = Some((unloaded.to_vec(), miss.clone()));
        self.last = Some((miss, change));
        next
    }

    /// Moves back towards the best unloaded nodes after a step with a much larger error; `None` once steps are too small.
    fn nearer(&mut self) -> Option<Vec<f64>> {
        if self.share <= SMALLEST_SHARE {
            return None;
        }
        self.share *= 0.5;
        self.last = None;
        let (unloaded, miss) = self.nearest.as_ref()?;
        Some(
            unloaded
                .iter()
                .zip(miss)
                .map(|(x, m)| x - self.share * m)
                .collect(),
        )
    }
}
