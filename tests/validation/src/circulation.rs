//! Closed loop of the circulation: left ventricle, aorta and arteries, veins, right ventricle,
//! lungs and left atrium.

use crate::activation::{Course, Twitch};
use crate::sarcomere::{N_GROUPS, Sarcomere, Sarcomeres, Wall};
use crate::valve::{Valve, ValveState};

/// Flow through an orifice of 1 cm² under 1 mmHg \[mL/s\]: √(2/ρ).
const ORIFICE: f64 = 50.154;
/// Number of time steps per recorded sample of 1 ms.
const STEPS_PER_MS: usize = 5;
/// Number of beats after which an unsteady heart is given up.
const BEATS: usize = 400;
/// Number of beats during which loads are adjusted towards their targets.
const CONTROLLED: usize = 300;

/// Parameters of the left ventricle.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftVentricle {
    /// Volume near end-diastole to which the shares refer \[mL\].
    pub reference_ml: f64,
    /// Isovolumic peak pressure at the reference volume \[mmHg\].
    pub peak_mmhg: f64,
    /// Volume without active pressure, as a share of the reference.
    pub dead_share: f64,
    /// Volume above the dead volume at which the curved end-systolic relation would peak, as a
    /// share of the reference.
    pub curve_share: f64,
    /// Loss of active pressure with outflow \[s/mL\] (Shroff, Janicki and Weber 1985, Am J Physiol
    /// 249:H358).
    pub rate_loss: f64,
    /// Lasting loss of active pressure by shortening: per volume \[1/mL\] and time constant \[s\].
    pub deactivation: Option<(f64, f64)>,
    /// Passive pressure at the reference volume \[mmHg\].
    pub passive_mmhg: f64,
    /// Volume without passive pressure, as a share of the reference.
    pub unloaded_share: f64,
    /// Exponent of the passive law per reference volume.
    pub passive_exponent: f64,
    /// Maxwell element parallel to the wall: stiffness \[mmHg/mL\] and time constant \[s\].
    pub maxwell: Option<(f64, f64)>,
    /// Share of the right ventricle's pressure that the septum transmits.
    pub septal_share: f64,
    /// Twitch of the wall.
    pub twitch: Twitch,
    /// Modifications of the activation.
    pub course: Course,
    /// Sarcomeres of a spherical wall, in the place of the elastance: peak, dead share, curve,
    /// loss with outflow, passive law and twitch then count no more.
    pub sarcomeres: Option<Sarcomeres>,
}

impl LeftVentricle {
    /// Isovolumic peak pressure at a volume \[mmHg\].
    fn active(&self, volume: f64) -> f64 {
        let shape = |v: f64| {
            let x = v - self.dead_share;
            x * (1.0 - x / (2.0 * self.curve_share))
        };
        (self.peak_mmhg * shape(volume / self.reference_ml) / shape(1.0)).max(0.0)
    }

    /// Passive pressure at a volume \[mmHg\].
    fn passive(&self, volume: f64) -> f64 {
        let law = |v: f64| (self.passive_exponent * (v - self.unloaded_share)).exp() - 1.0;
        self.passive_mmhg * law(volume / self.reference_ml) / law(1.0)
    }
}

/// A contraction of the left atrium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtrialContraction {
    /// Elastance added at the peak of the contraction \[mmHg/mL\].
    pub elastance: f64,
    /// Time from the middle of the contraction to the onset of the ventricle \[ms\].
    pub lead_ms: f64,
    /// Half-width of the contraction \[ms\].
    pub width_ms: f64,
}

/// Pericardium around all chambers, with pressure p exp((V − V₀)/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pericardium {
    /// Scale p of the pressure \[mmHg\].
    pub pressure_mmhg: f64,
    /// Volume V₀ of all chambers \[mL\].
    pub volume_ml: f64,
    /// Scale s of the volume \[mL\].
    pub scale_ml: f64,
}

/// All parameters of one heart and circulation. Pressures are in mmHg, volumes in mL and
/// resistances in mmHg s/mL.
#[derive(Debug, Clone, PartialEq)]
pub struct Heart {
    /// Cycle length \[ms\], an integer.
    pub cycle_ms: usize,
    /// Onset of the ventricles' activation \[ms\].
    pub onset_ms: f64,
    /// Parameters of the left ventricle.
    pub left: LeftVentricle,
    /// Right ventricle: largest and smallest elastance \[mmHg/mL\].
    pub right: (f64, f64),
    /// Compliance of the left atrium \[mL/mmHg\].
    pub atrial_compliance: f64,
    /// Contraction of the left atrium; `None` in a heart without missing effects.
    pub atrial_contraction: Option<AtrialContraction>,
    /// Pericardium; `None` in a heart without missing effects.
    pub pericardium: Option<Pericardium>,
    /// Valve from the left atrium to the left ventricle.
    pub mitral: Valve,
    /// Valve from the left ventricle to the aorta.
    pub aortic: Valve,
    /// Valve from the systemic veins to the right ventricle.
    pub tricuspid: Valve,
    /// Valve from the right ventricle to the arteries of the lungs.
    pub pulmonary: Valve,
    /// Hole between the ventricles \[cm²\].
    pub septal_defect_cm2: f64,
    /// Resistance between valve and aortic root.
    pub root_resistance: f64,
    /// Compliance of the root and of the arteries \[mL/mmHg\].
    pub arterial_compliance: (f64, f64),
    /// Resistance and inertance \[mmHg s²/mL\] between root and arteries.
    pub arterial_link: (f64, f64),
    /// Resistance of the periphery, which is adjusted until the mean arterial pressure meets its
    /// target.
    pub peripheral_resistance: f64,
    /// Compliance of the systemic veins \[mL/mmHg\].
    pub venous_compliance: f64,
    /// Compliance of the pulmonary arteries and veins \[mL/mmHg\].
    pub lung_compliance: (f64, f64),
    /// Resistance of the lungs, and resistance from their veins into the atrium.
    pub lung_resistance: (f64, f64),
    /// Target mean pressures of the left atrium and of the arteries \[mmHg\].
    pub wanted: (f64, f64),
}

/// One steady beat, sampled every 1 ms.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Beat {
    /// Pressure of the left ventricle \[mmHg\].
    pub pressure: Vec<f64>,
    /// Volume of the left ventricle \[mL\].
    pub volume: Vec<f64>,
    /// Pressure of the aortic root \[mmHg\].
    pub aortic_pressure: Vec<f64>,
    /// Pressure of the left atrium \[mmHg\].
    pub atrial_pressure: Vec<f64>,
    /// Flow through the aortic valve \[mL/s\].
    pub aortic_flow: Vec<f64>,
    /// Flow through the mitral valve \[mL/s\].
    pub mitral_flow: Vec<f64>,
    /// Opening of the aortic leaflets, 0 to 1.
    pub aortic_opening: Vec<f64>,
    /// Opening of the mitral leaflets, 0 to 1.
    pub mitral_opening: Vec<f64>,
    /// Net volume into the aorta \[mL\].
    pub forward_ml: f64,
    /// Largest change of a state over the beat (mL, or mL/s over 100), which measures the distance
    /// from a steady beat.
    pub drift: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct State {
    left: f64,
    right: f64,
    atrium: f64,
    root: f64,
    arteries: f64,
    veins: f64,
    lung_arteries: f64,
    lung_veins: f64,
    link_flow: f64,
    maxwell: f64,
    deactivation: f64,
    sarcomeres: [Sarcomere; N_GROUPS],
    valves: [ValveState; 4],
}

/// Pressures of the compartments in a state \[mmHg\].
struct Pressures {
    left: f64,
    right: f64,
    atrium: f64,
    root: f64,
    arteries: f64,
    veins: f64,
    lung_arteries: f64,
    lung_veins: f64,
}

impl Heart {
    /// Multiplies the active pressure or stress of the left ventricle.
    pub fn strengthen(&mut self, factor: f64) {
        self.left.peak_mmhg *= factor;
        if let Some(wall) = &mut self.left.sarcomeres {
            wall.active_kpa *= factor;
        }
    }

    /// Paces the heart. Its systole changes by the square root of the cycle, as in hearts that are drawn
    /// with other rates (Bazett).
    pub fn pace(&mut self, cycle_ms: usize) {
        let systole = (cycle_ms as f64 / self.cycle_ms as f64).sqrt();
        self.cycle_ms = cycle_ms;
        self.left.twitch = self.left.twitch.paced(systole);
        if let Some(wall) = &mut self.left.sarcomeres {
            wall.times_ms.0 *= systole;
            wall.duration_ms *= systole;
        }
    }

    fn start(&self) -> State {
        let (p_la, p_art) = self.wanted;
        State {
            left: self.left.reference_ml,
            right: self.left.reference_ml,
            atrium: p_la * self.atrial_compliance,
            root: p_art * self.arterial_compliance.0,
            arteries: p_art * self.arterial_compliance.1,
            veins: 5.0 * self.venous_compliance,
            lung_arteries: 15.0 * self.lung_compliance.0,
            lung_veins: (p_la + 1.0) * self.lung_compliance.1,
            link_flow: 0.0,
            maxwell: 0.0,
            deactivation: 0.0,
            sarcomeres: [Sarcomere::default(); N_GROUPS],
            valves: [ValveState::default(); 4],
        }
    }

    fn pressures(
        &self,
        s: &State,
        sarcomeres: Option<&Wall<'_>>,
        left_activation: f64,
        right_activation: f64,
        atrial: f64,
    ) -> Pressures {
        let around = self.pericardium.map_or(0.0, |p| {
            p.pressure_mmhg * ((s.left + s.right + s.atrium - p.volume_ml) / p.scale_ml).exp()
        });
        let out = (s.valves[1].flow - s.valves[0].flow).max(0.0);
        let right =
            around + (self.right.1 + (self.right.0 - self.right.1) * right_activation) * s.right;
        let kept = (1.0 - s.deactivation).max(0.0);
        let wall = match sarcomeres {
            Some(wall) => wall.pressure(s.left, &s.sarcomeres, kept),
            None => {
                let strength = (1.0 - self.left.rate_loss * out).max(0.0) * kept;
                self.left.passive(s.left) + left_activation * strength * self.left.active(s.left)
            }
        };
        let left = around + wall + s.maxwell + self.left.septal_share * (right - around);
        let added = self
            .atrial_contraction
            .map_or(0.0, |a| a.elastance * atrial);
        Pressures {
            left,
            right,
            atrium: around + s.atrium * (1.0 / self.atrial_compliance + added),
            root: s.root / self.arterial_compliance.0,
            arteries: s.arteries / self.arterial_compliance.1,
            veins: s.veins / self.venous_compliance,
            lung_arteries: s.lung_arteries / self.lung_compliance.0,
            lung_veins: s.lung_veins / self.lung_compliance.1,
        }
    }

    /// One time step: flows from the pressures at its start, volumes from the flows at its end.
    ///
    /// - `since_ms`: time since the onset of the ventricles
    fn step(
        &self,
        s: &State,
        p: &Pressures,
        sarcomeres: Option<&Wall<'_>>,
        (since_ms, dt): (f64, f64),
        resistance: f64,
    ) -> State {
        let valves = [
            self.mitral.step(s.valves[0], p.atrium - p.left, dt),
            self.aortic.step(s.valves[1], p.left - p.root, dt),
            self.tricuspid.step(s.valves[2], p.veins - p.right, dt),
            self.pulmonary
                .step(s.valves[3], p.right - p.lung_arteries, dt),
        ];
        let [mitral, aortic, tricuspid, pulmonary] = valves.map(|v| v.flow);
        let (link_r, link_l) = self.arterial_link;
        let k = dt / link_l;
        let link = (s.link_flow + k * (p.root - p.arteries)) / (1.0 + k * link_r);
        let shunt = if self.septal_defect_cm2 > 0.0 {
            let difference = p.left - p.right;
            ORIFICE * self.septal_defect_cm2 * difference.signum() * difference.abs().sqrt()
        } else {
            0.0
        };
        let periphery = (p.arteries - p.veins) / resistance;
        let lung = (p.lung_arteries - p.lung_veins) / self.lung_resistance.0;
        let return_flow = (p.lung_veins - p.atrium) / self.lung_resistance.1;
        let rate = mitral - aortic - shunt;
        State {
            left: s.left + dt * rate,
            right: s.right + dt * (tricuspid + shunt - pulmonary),
            atrium: s.atrium + dt * (return_flow - mitral),
            root: s.root + dt * (aortic - link),
            arteries: s.arteries + dt * (link - periphery),
            veins: s.veins + dt * (periphery - tricuspid),
            lung_arteries: s.lung_arteries + dt * (pulmonary - lung),
            lung_veins: s.lung_veins + dt * (lung - return_flow),
            link_flow: link,
            maxwell: self.left.maxwell.map_or(0.0, |(stiffness, tau)| {
                (s.maxwell + dt * stiffness * rate) / (1.0 + dt / tau)
            }),
            deactivation: self.left.deactivation.map_or(0.0, |(per_ml, tau)| {
                (s.deactivation + dt * per_ml * (-rate).max(0.0)) / (1.0 + dt / tau)
            }),
            sarcomeres: sarcomeres.map_or(s.sarcomeres, |wall| {
                let at = (since_ms, self.cycle_ms as f64);
                wall.step(&s.sarcomeres, s.left, at, dt)
            }),
            valves,
        }
    }

    /// The steady beat; `None` if the loop does not settle.
    ///
    /// The volume of the pulmonary veins and the peripheral resistance are adjusted until the mean
    /// pressures meet their targets.
    #[must_use]
    pub fn beat(&self) -> Option<Beat> {
        self.rest().map(|rest| rest.beat)
    }

    /// The steady beat of [`Self::beat`] with all that a change of the heart starts from.
    #[must_use]
    pub fn rest(&self) -> Option<Rest> {
        let mut state = self.start();
        let mut resistance = self.peripheral_resistance;
        let timing = Timing::of(self);
        for beat_idx in 0..BEATS {
            let (after, beat) = self.next(&timing, state, resistance)?;
            state = after;
            let (atrium, artery) = (mean(&beat.atrial_pressure), mean(&beat.aortic_pressure));
            let rest = |state| Rest {
                heart: Self {
                    peripheral_resistance: resistance,
                    ..self.clone()
                },
                state,
                beat: beat.clone(),
            };
            if beat_idx < CONTROLLED {
                let off = ((self.wanted.0 - atrium) / self.wanted.0)
                    .abs()
                    .max((self.wanted.1 / artery).ln().abs());
                if beat_idx > 20 && beat.drift < 0.02 && off < 5e-3 {
                    return Some(rest(state));
                }
                state.lung_veins += (1.5 * (self.wanted.0 - atrium)).clamp(-20.0, 20.0);
                resistance *= (self.wanted.1 / artery).powf(0.3).clamp(0.8, 1.25);
            } else if beat.drift < 0.02 {
                return Some(rest(state));
            }
        }
        None
    }

    /// One beat from a state: the state after it, and its samples; `None` if the ventricle collapses.
    fn next(&self, timing: &Timing, begun: State, resistance: f64) -> Option<(State, Beat)> {
        let n = self.cycle_ms * STEPS_PER_MS;
        let dt = 1e-3 / STEPS_PER_MS as f64;
        let wall = self.left.sarcomeres.as_ref();
        let wall = wall.map(|wall| wall.wall(&self.left.course));
        let mut state = begun;
        let mut beat = Beat::default();
        for i in 0..n {
            let (left, right, atrial) = (timing.left[i], timing.right[i], timing.atrial[i]);
            let p = self.pressures(&state, wall.as_ref(), left, right, atrial);
            if i % STEPS_PER_MS == 0 {
                beat.pressure.push(p.left);
                beat.volume.push(state.left);
                beat.aortic_pressure
                    .push(p.root + self.root_resistance * state.valves[1].flow);
                beat.atrial_pressure.push(p.atrium);
                beat.aortic_flow.push(state.valves[1].flow);
                beat.mitral_flow.push(state.valves[0].flow);
                beat.aortic_opening.push(state.valves[1].opening);
                beat.mitral_opening.push(state.valves[0].opening);
            }
            let since_ms = i as f64 / STEPS_PER_MS as f64 - self.onset_ms;
            state = self.step(&state, &p, wall.as_ref(), (since_ms, dt), resistance);
            beat.forward_ml += dt * state.valves[1].flow;
        }
        if !state.left.is_finite() || state.left < 5.0 {
            return None;
        }
        beat.drift = drift(&begun, &state);
        Some((state, beat))
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Activations over the steps of a cycle.
struct Timing {
    left: Vec<f64>,
    right: Vec<f64>,
    atrial: Vec<f64>,
}

impl Timing {
    fn of(heart: &Heart) -> Self {
        let n = heart.cycle_ms * STEPS_PER_MS;
        let cycle = heart.cycle_ms as f64;
        let (left, onset) = (&heart.left, heart.onset_ms);
        let atrial = |i: usize| {
            let Some(a) = heart.atrial_contraction else {
                return 0.0;
            };
            let t = i as f64 / STEPS_PER_MS as f64;
            let from_middle = (t - onset + a.lead_ms + 0.5 * cycle).rem_euclid(cycle) - 0.5 * cycle;
            (-(from_middle / a.width_ms).powi(2)).exp()
        };
        Self {
            left: left.course.table(&left.twitch, onset, cycle, n),
            right: Course::default().table(&left.twitch, onset + 5.0, cycle, n),
            atrial: (0..n).map(atrial).collect(),
        }
    }
}

/// A steady heart, from which changes of the heart start.
#[derive(Debug, Clone)]
pub struct Rest {
    /// The heart with the peripheral resistance that was found.
    pub heart: Heart,
    /// Its steady beat.
    pub beat: Beat,
    state: State,
}

impl Rest {
    /// The steady beat after a change of the heart with the same blood: nothing is adjusted. `None` if
    /// the loop does not settle.
    #[must_use]
    pub fn changed(&self, change: impl FnOnce(&mut Heart)) -> Option<Beat> {
        let mut heart = self.heart.clone();
        change(&mut heart);
        self.settled(&heart, |_| 0.0)
    }

    /// The steady beat with so much blood that the mean atrial pressure is this many times that of rest.
    #[must_use]
    pub fn filled(&self, share: f64) -> Option<Beat> {
        let wanted = share * mean(&self.beat.atrial_pressure);
        self.settled(&self.heart, |beat| wanted - mean(&beat.atrial_pressure))
    }

    /// - `missing`: what a beat's mean atrial pressure lacks \[mmHg\]
    fn settled(&self, heart: &Heart, missing: impl Fn(&Beat) -> f64) -> Option<Beat> {
        /// Largest change of a state over a steady beat, and of the atrial pressure from its target.
        const STEADY: f64 = 1e-3;
        let timing = Timing::of(heart);
        let mut state = self.state;
        for _ in 0..4 * BEATS {
            let (after, beat) = heart.next(&timing, state, heart.peripheral_resistance)?;
            state = after;
            let missing_mmhg = missing(&beat);
            if beat.drift < STEADY && missing_mmhg.abs() < STEADY {
                return Some(beat);
            }
            state.lung_veins += (1.5 * missing_mmhg).clamp(-20.0, 20.0);
        }
        None
    }
}

fn drift(a: &State, b: &State) -> f64 {
    let volumes = |s: &State| {
        [
            s.left,
            s.right,
            s.atrium,
            s.root,
            s.arteries,
            s.veins,
            s.lung_arteries,
            s.lung_veins,
        ]
    };
    let by_volume = volumes(a)
        .into_iter()
        .zip(volumes(b))
        .map(|(x, y)| (x - y).abs());
    let by_flow = a
        .valves
        .iter()
        .zip(&b.valves)
        .map(|(x, y)| 0.01 * (x.flow - y.flow).abs());
    by_volume.chain(by_flow).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patient::Hearts;
    use crate::random::Random;

    fn blood(state: &State) -> f64 {
        [
            state.left,
            state.right,
            state.atrium,
            state.root,
            state.arteries,
            state.veins,
            state.lung_arteries,
            state.lung_veins,
        ]
        .iter()
        .sum()
    }

    fn stroke(beat: &Beat) -> f64 {
        let (low, high) = beat
            .volume
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), v| (v.min(l), v.max(h)));
        high - low
    }

    #[test]
    fn a_change_keeps_the_blood_and_the_output_follows_it() {
        for hearts in [Hearts::Elastance, Hearts::Sarcomeres] {
            let rest = hearts.draw(&mut Random::new(3, 0)).rest().expect("steady");
            let (timing, begun) = (Timing::of(&rest.heart), rest.state);
            let (after, _) = rest
                .heart
                .next(&timing, begun, rest.heart.peripheral_resistance)
                .expect("a beat");
            assert!((blood(&after) - blood(&begun)).abs() < 1e-8);
            let same = rest.changed(|_| {}).expect("steady");
            assert!((stroke(&same) / stroke(&rest.beat) - 1.0).abs() < 0.01);
            let dilated = rest.changed(|heart| heart.peripheral_resistance *= 0.75);
            let dilated = dilated.expect("steady");
            assert!(stroke(&dilated) > stroke(&same));
            // More blood flows, so that the pressure falls by less than the resistance.
            let share = mean(&dilated.aortic_pressure) / mean(&same.aortic_pressure);
            assert!((0.75..1.0).contains(&share), "{share}");
            let filled = rest.filled(1.2).expect("steady");
            let share = mean(&filled.atrial_pressure) / mean(&rest.beat.atrial_pressure);
            assert!((share - 1.2).abs() < 1e-3 && stroke(&filled) > stroke(&same));
        }
    }

    #[test]
    fn a_faster_heart_has_a_shorter_systole() {
        let mut heart = Hearts::Sarcomeres.draw(&mut Random::new(3, 0));
        heart.pace(900);
        let slow = heart.clone();
        heart.pace(625);
        let share = (625.0f64 / 900.0).sqrt();
        let half = |heart: &Heart| heart.left.twitch.half_fall_ms();
        assert!((half(&heart) / half(&slow) - share).abs() < 1e-9);
        let wall = |heart: &Heart| heart.left.sarcomeres.expect("a wall").duration_ms;
        assert!((wall(&heart) / wall(&slow) - share).abs() < 1e-9);
        heart.pace(900);
        assert!((half(&heart) / half(&slow) - 1.0).abs() < 1e-9);
    }
}
