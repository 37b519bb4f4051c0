//! The periodic beat of a reduced ventricle, found quickly and at fixed steps: what a fit to traces calls thousands of times.
//!
//! The state at the beat's start is a fixed point of "one beat later". Plain repetition forgets it with the time constant
//! of the arterial load, a third to a half a beat; Anderson's acceleration (Anderson 1965; Walker and Ni 2011, SIAM J Numer
//! Anal 49:1715) needs few beats, and a search that starts from the orbit of neighbouring parameters takes over that
//! search's secants too. Steps are fixed, so that the result is a piecewise smooth function of all parameters to within the
//! tolerance: differences of two runs are usable as derivatives.

mod acceleration;
pub mod base;
mod filling;

pub use base::{BASE_PARAMETERS, BaseParameter, FitSubject};
pub use filling::{Filling, blood_volume};

use crate::circulation::left_heart::{AORTA, AORTIC_VALVE, LEFT_ATRIUM, MITRAL_VALVE};
use crate::effects::{Assembled, PeriodicTraces};
use crate::ventricle::{Ventricle, VentricleError};
use acceleration::Acceleration;
use cardiotwin_units::Ms;
use filling::Control;

/// Settings of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeriodicSettings {
    /// Steps of a cycle, which are also the samples.
    pub steps: usize,
    /// Largest change of a state (mL, mmHg, mL/s, kPa) over a beat that counts as periodic.
    pub tolerance: f64,
    /// Beats after which to stop.
    pub limit: usize,
}

impl PeriodicSettings {
    /// Steps of at most `step`, tolerance 1e-5, up to 40 beats.
    #[must_use]
    pub fn with_step(cycle_length: Ms, step: Ms) -> Self {
        Self {
            steps: (cycle_length.0 / step.0).ceil().max(1.0) as usize,
            tolerance: 1e-5,
            limit: 40,
        }
    }
}

/// A periodic state and how beats near it answer to changes of it: where a later search begins.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Orbit {
    state: Vec<f64>,
    acceleration: Acceleration,
}

/// A beat of the heart, not yet measured.
#[derive(Debug, Clone, PartialEq)]
pub struct PeriodicBeat {
    /// Pressure and volume of the cavity.
    pub heart: PeriodicTraces,
    /// Aortic pressure \[mmHg\] at the same times.
    pub aortic_pressure_mmhg: Vec<f64>,
    /// Flow through the aortic valve \[mL/s\] at the same times, positive out of the ventricle.
    pub aortic_flow_ml_per_s: Vec<f64>,
    /// Net volume through the aortic root in a cycle \[mL\]: through the valve less what leaks back.
    pub forward_volume_ml: f64,
    /// Flow through the mitral valve \[mL/s\] at the same times, positive into the ventricle, less
    /// what leaks back.
    pub mitral_flow_ml_per_s: Vec<f64>,
    /// Pressure of the left atrium \[mmHg\] at the same times.
    pub atrial_pressure_mmhg: Vec<f64>,
    /// Start of a later search, with its secants.
    pub orbit: Orbit,
    /// Largest change of a state over this beat.
    pub change: f64,
    /// Whether that change is within the tolerance.
    pub periodic: bool,
    /// Number of beats that the search ran.
    pub n_beats: usize,
}

impl PeriodicBeat {
    /// Traces with the model's artefacts of measurement.
    #[must_use]
    pub fn measured(&self, model: &Assembled) -> PeriodicTraces {
        let mut traces = self.heart.clone();
        model.measurement.apply(&mut traces);
        traces
    }
}

/// Finds the periodic beat of a model.
///
/// - `near`: orbit of neighbouring parameters with the same effects; one of another shape is not used
///
/// # Errors
/// [`VentricleError`] when a step has no solution; steps are not cut, so that they stay comparable.
pub fn find(
    model: &mut Assembled,
    cycle_length: Ms,
    settings: &PeriodicSettings,
    near: Option<&Orbit>,
) -> Result<PeriodicBeat, VentricleError> {
    search(model, cycle_length, settings, near, None)
}

/// Finds the periodic beat of a closed loop together with its blood volume. The model is then at the
/// beginning of a beat.
///
/// # Errors
/// [`VentricleError`] when a step has no solution, or [`VentricleError::Parameter`] for an open
/// circuit, which has no blood volume.
pub fn find_filled(
    model: &mut Assembled,
    cycle_length: Ms,
    settings: &PeriodicSettings,
    filling: Filling,
) -> Result<PeriodicBeat, VentricleError> {
    let n_ventricle = model.ventricle.beat_state().count();
    let control = Control::new(filling, model, n_ventricle).ok_or(VentricleError::Parameter {
        name: "compartments of a closed loop",
        value: 0.0,
        expected: "there, for a blood volume",
    })?;
    search(model, cycle_length, settings, None, Some(control))
}

impl Assembled {
    /// Begins a beat at time zero from the state of an orbit of this model. Steps are solved as in any
    /// beat.
    pub fn begin_orbit(&mut self, orbit: &Orbit) {
        let n_ventricle = self.ventricle.beat_state().count();
        self.ventricle.begin_beat(&orbit.state[..n_ventricle]);
        self.circulation.begin_beat(&orbit.state[n_ventricle..]);
    }
}

fn search(
    model: &mut Assembled,
    cycle_length: Ms,
    settings: &PeriodicSettings,
    near: Option<&Orbit>,
    control: Option<Control>,
) -> Result<PeriodicBeat, VentricleError> {
    let n_ventricle = model.ventricle.beat_state().count();
    let mut x: Vec<f64> = model
        .ventricle
        .beat_state()
        .chain(model.circulation.beat_state())
        .collect();
    let start = x[0];
    // Steps no more exact than the beat is asked to be: half an iteration a step less. Plain ones,
    // with which the search for missing effects was evaluated: its marginal decisions follow the
    // last digits.
    model
        .ventricle
        .solve_plainly((0.01 * settings.tolerance).clamp(1e-8, 1e-6));
    let mut acceleration = Acceleration::default();
    if let Some(orbit) = near.filter(|orbit| orbit.state.len() == x.len()) {
        x.copy_from_slice(&orbit.state);
        acceleration = orbit.acceleration.clone();
    }
    let mut beat = Recorder::new(model, settings.steps, cycle_length);
    let mut residual = vec![0.0; x.len()];
    let mut n_beats = 0;
    loop {
        n_beats += 1;
        model.ventricle.begin_beat(&x[..n_ventricle]);
        model.circulation.begin_beat(&x[n_ventricle..]);
        if let Some(control) = &control {
            control.keep(model, &mut x, n_ventricle);
        }
        beat.run(model)?;
        let end = model
            .ventricle
            .beat_state()
            .chain(model.circulation.beat_state());
        let mut change = 0.0f64;
        for ((r, end), begin) in residual.iter_mut().zip(end).zip(&x) {
            *r = end - begin;
            change = change.max(r.abs());
        }
        let missing = control.as_ref().map(|control| {
            let (volume, atrium) = (&beat.heart.volume_ml, &beat.atrial_pressure_mmhg);
            (control.veins, control.missing(volume, atrium))
        });
        if let Some((veins, missing)) = missing {
            residual[veins] += missing.blood_ml;
            change = change.max(missing.of_target.abs());
        }
        let periodic = change <= settings.tolerance;
        if periodic || n_beats >= settings.limit.max(1) {
            acceleration.begin_elsewhere();
            return Ok(beat.finish(
                Orbit {
                    state: x,
                    acceleration,
                },
                change,
                periodic,
                n_beats,
            ));
        }
        acceleration.advance(&mut x, &residual);
        // A secant across a kink may point anywhere: then one plain beat.
        if !(x[0] > 0.1 * start && x[0] < 3.0 * start && x.iter().all(|v| v.is_finite())) {
            let end = model
                .ventricle
                .beat_state()
                .chain(model.circulation.beat_state());
            x.iter_mut().zip(end).for_each(|(x, end)| *x = end);
            if let Some((veins, missing)) = missing {
                x[veins] += missing.blood_ml;
            }
            acceleration = Acceleration::default();
        }
    }
}

/// Samples of the beat that is being run.
struct Recorder {
    heart: PeriodicTraces,
    aortic_pressure_mmhg: Vec<f64>,
    aortic_flow_ml_per_s: Vec<f64>,
    mitral_flow_ml_per_s: Vec<f64>,
    atrial_pressure_mmhg: Vec<f64>,
    aorta: Option<usize>,
    atrium: Option<usize>,
    aortic_valve: Option<usize>,
    mitral_valve: Option<usize>,
    /// Paths that carry blood back from the aorta.
    aortic_leaks: Vec<usize>,
    /// Paths that carry blood back to the atrium.
    mitral_leaks: Vec<usize>,
    steps: usize,
}

impl Recorder {
    fn new(model: &Assembled, steps: usize, cycle_length: Ms) -> Self {
        let heart = PeriodicTraces {
            cycle_length_ms: cycle_length.0,
            pressure_mmhg: vec![0.0; steps],
            volume_ml: vec![0.0; steps],
        };
        let circulation = &model.circulation;
        Self {
            heart,
            aortic_pressure_mmhg: vec![0.0; steps],
            aortic_flow_ml_per_s: vec![0.0; steps],
            mitral_flow_ml_per_s: vec![0.0; steps],
            atrial_pressure_mmhg: vec![0.0; steps],
            atrium: circulation.compartment_idx(LEFT_ATRIUM),
            aorta: circulation.compartment_idx(AORTA),
            aortic_valve: circulation.path_idx(AORTIC_VALVE),
            mitral_valve: circulation.path_idx(MITRAL_VALVE),
            aortic_leaks: circulation.paths_back_from(AORTA),
            mitral_leaks: circulation.paths_out_to(LEFT_ATRIUM),
            steps,
        }
    }

    /// One beat from the present state; sample 0 is its end, which is the next one's start.
    fn run(&mut self, model: &mut Assembled) -> Result<(), VentricleError> {
        let dt = Ms(self.heart.cycle_length_ms / self.steps as f64);
        let (ventricle, circulation) = (&mut model.ventricle, &mut model.circulation);
        for step in 1..=self.steps {
            ventricle.try_step(circulation, dt)?;
            ventricle.commit();
            circulation.commit();
            let i = step % self.steps;
            self.heart.pressure_mmhg[i] = ventricle.pressure().0;
            self.heart.volume_ml[i] = ventricle.volume().0;
            self.aortic_pressure_mmhg[i] =
                self.aorta.map_or(0.0, |idx| circulation.pressure(idx).0);
            self.aortic_flow_ml_per_s[i] =
                self.aortic_valve.map_or(0.0, |idx| circulation.flow(idx).0)
                    - self
                        .aortic_leaks
                        .iter()
                        .map(|idx| circulation.flow(*idx).0)
                        .sum::<f64>();
            self.mitral_flow_ml_per_s[i] =
                self.mitral_valve.map_or(0.0, |idx| circulation.flow(idx).0)
                    - self
                        .mitral_leaks
                        .iter()
                        .map(|idx| circulation.flow(*idx).0)
                        .sum::<f64>();
            self.atrial_pressure_mmhg[i] =
                self.atrium.map_or(0.0, |idx| circulation.pressure(idx).0);
        }
        Ok(())
    }

    fn finish(self, orbit: Orbit, change: f64, periodic: bool, n_beats: usize) -> PeriodicBeat {
        let dt_s = self.heart.spacing_ms() * 1e-3;
        PeriodicBeat {
            forward_volume_ml: self.aortic_flow_ml_per_s.iter().sum::<f64>() * dt_s,
            heart: self.heart,
            aortic_pressure_mmhg: self.aortic_pressure_mmhg,
            aortic_flow_ml_per_s: self.aortic_flow_ml_per_s,
            mitral_flow_ml_per_s: self.mitral_flow_ml_per_s,
            atrial_pressure_mmhg: self.atrial_pressure_mmhg,
            orbit,
            change,
            periodic,
            n_beats,
        }
    }
}

#[cfg(test)]
mod tests;
