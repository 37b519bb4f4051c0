//! A left ventricle of sarcomeres in a spherical wall, after the CircAdapt model.
//!
//! Geometry: a sphere of the wall's volume V_w around the cavity. The fibre strain follows from the
//! midwall's area A and the dimensionless curvature z = 3 V_w/(2 A r) as ε = ½ ln A − z²/12 −
//! 0.019 z⁴ (Lumens et al. 2009, Ann Biomed Eng 37:2234), and the pressure from virtual work, p dV =
//! σ V_w dε. Sarcomere: a contractile element in series with an elastic one, whose contractility
//! rises and decays with time constants that depend on its length (ibid., appendix). All states are
//! stepped explicitly.

use crate::activation::{Course, LATE_GROUPS};
use std::f64::consts::PI;

/// Pressure of 1 kPa \[mmHg\].
const KPA: f64 = 7.500_62;
/// Length of the sarcomere at zero strain \[µm\].
const REFERENCE_UM: f64 = 2.0;
/// Length of the contractile element without stress \[µm\].
const LEAST_UM: f64 = 1.51;
/// Length of the series elastic element in isometric contraction \[µm\].
const SERIES_UM: f64 = 0.04;
/// Contractility at rest.
const REST: f64 = 0.02;
/// Largest number of groups of the wall with a delay of their own: the first is not late.
pub const N_GROUPS: usize = 1 + LATE_GROUPS.len();

/// State of the sarcomeres of one group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sarcomere {
    /// Length of the contractile element \[µm\].
    pub length_um: f64,
    /// Contractility, dimensionless.
    pub contractility: f64,
}

impl Default for Sarcomere {
    fn default() -> Self {
        Self {
            length_um: REFERENCE_UM,
            contractility: REST,
        }
    }
}

/// Parameters of the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sarcomeres {
    /// Volume of the wall \[mL\].
    pub wall_ml: f64,
    /// Cavity volume at which the sarcomeres have their length [`Self::length_um`] \[mL\].
    pub reference_ml: f64,
    /// Length of the sarcomeres at the reference volume \[µm\].
    pub length_um: f64,
    /// Active stress of full contractility per length of the contractile element \[kPa/µm\].
    pub active_kpa: f64,
    /// Passive pressure at the reference volume \[mmHg\].
    pub passive_mmhg: f64,
    /// Exponent of the passive stress in the stretch.
    pub passive_exponent: f64,
    /// Stretch without passive stress, as a share of the stretch at the reference volume.
    pub unloaded_stretch: f64,
    /// Time constants of rise and decay \[ms\].
    pub times_ms: (f64, f64),
    /// Scale of the contraction's duration \[ms\].
    pub duration_ms: f64,
    /// Shortening velocity without load \[µm/s\].
    pub velocity_um_per_s: f64,
}

/// Fibre strain, and the factor from fibre stress \[kPa\] to cavity pressure \[mmHg\].
struct Shape {
    strain: f64,
    pressure_per_stress: f64,
}

/// A wall with its activation, and with all that no step changes.
#[derive(Debug)]
pub struct Wall<'a> {
    of: &'a Sarcomeres,
    course: &'a Course,
    /// Share of the wall and delay \[ms\] of each group; only the first without a late wall.
    groups: Vec<(f64, f64)>,
    /// Strain of the geometry at the reference volume less that of the sarcomeres.
    strain_offset: f64,
    /// Passive stress at the reference volume \[kPa\], divided by the law's value there.
    passive_kpa: f64,
}

impl Sarcomeres {
    /// The wall with an activation.
    #[must_use]
    pub fn wall<'a>(&'a self, course: &'a Course) -> Wall<'a> {
        let groups = match course.late {
            None => vec![(1.0, 0.0)],
            Some((late, delay_ms)) => {
                let share = late / LATE_GROUPS.len() as f64;
                let of_late = LATE_GROUPS.iter().map(|k| (share, k * delay_ms));
                std::iter::once((1.0 - late, 0.0)).chain(of_late).collect()
            }
        };
        let at_reference = (self.length_um / REFERENCE_UM).ln();
        let mut wall = Wall {
            of: self,
            course,
            groups,
            strain_offset: 0.0,
            passive_kpa: 1.0,
        };
        let reference = wall.shape(self.reference_ml);
        wall.strain_offset = reference.strain - at_reference;
        let stress = self.passive_mmhg / reference.pressure_per_stress;
        wall.passive_kpa = stress / wall.passive(at_reference);
        wall
    }
}

impl Wall<'_> {
    fn shape(&self, cavity_ml: f64) -> Shape {
        let wall_ml = self.of.wall_ml;
        // Volume inside the midwall, mL, its area, cm², and the dimensionless curvature.
        let volume = cavity_ml.max(1.0) + 0.5 * wall_ml;
        let radius = (0.75 * volume / PI).cbrt();
        let area = 4.0 * PI * radius * radius;
        let z = 1.5 * wall_ml / (area * radius);
        // With A ∝ V^⅔ and z ∝ 1/V: dε/dV = (½ + z²/4 + 0.114 z⁴) 2/(3 V).
        let strain_per_ml = (0.5 + 0.25 * z * z + 0.114 * z.powi(4)) * 2.0 / (3.0 * volume);
        Shape {
            strain: 0.5 * area.ln() - z * z / 12.0 - 0.019 * z.powi(4) - self.strain_offset,
            pressure_per_stress: KPA * wall_ml * strain_per_ml,
        }
    }

    /// Passive stress at a fibre strain \[kPa\].
    fn passive(&self, strain: f64) -> f64 {
        let stretch = strain.exp() * REFERENCE_UM / self.of.length_um;
        let law = (stretch / self.of.unloaded_stretch).powf(self.of.passive_exponent) - 1.0;
        self.passive_kpa * law
    }

    /// Active stress of a group \[kPa\] at a sarcomere length \[µm\].
    fn active(&self, state: &Sarcomere, length_um: f64) -> f64 {
        let stretch = (length_um - state.length_um) / SERIES_UM;
        let overlap = (state.length_um - LEAST_UM).max(0.0);
        self.of.active_kpa * state.contractility * overlap * stretch
    }

    /// Cavity pressure of the wall \[mmHg\].
    ///
    /// - `strength`: factor of the active stress
    #[must_use]
    pub fn pressure(&self, cavity_ml: f64, states: &[Sarcomere; N_GROUPS], strength: f64) -> f64 {
        let shape = self.shape(cavity_ml);
        let length_um = REFERENCE_UM * shape.strain.exp();
        let active: f64 = std::iter::zip(states, &self.groups)
            .map(|(state, (share, _))| share * self.active(state, length_um))
            .sum();
        shape.pressure_per_stress * (self.passive(shape.strain) + strength * active)
    }

    /// States after a step.
    ///
    /// - `since_ms`: time since the onset of the early wall
    #[must_use]
    pub fn step(
        &self,
        states: &[Sarcomere; N_GROUPS],
        cavity_ml: f64,
        (since_ms, cycle_ms): (f64, f64),
        dt_s: f64,
    ) -> [Sarcomere; N_GROUPS] {
        let length_um = REFERENCE_UM * self.shape(cavity_ml).strain.exp();
        let (rise_ms, decay_ms) = self.of.times_ms;
        let mut after = *states;
        for (state, (_, delay_ms)) in after.iter_mut().zip(&self.groups) {
            let t = (since_ms - delay_ms).rem_euclid(cycle_ms);
            let length = state.length_um;
            let x = (t / rise_ms).min(8.0);
            let rise = 0.02 * x.powi(3) * (8.0 - x).powi(2) * (-x).exp();
            let again = self
                .course
                .after_contraction
                .map_or(0.0, |(height, at, width)| {
                    height * (-((t - at) / width).powi(2)).exp() * 10.0
                });
            let filled = (4.0 * (length - LEAST_UM).max(0.0).powi(2)).tanh();
            let duration = self.of.duration_ms * (0.29 + 0.3 * length);
            let falls = 1.0 / (1.0 + ((duration - t) / decay_ms).exp());
            let per_ms = (filled * (rise + again)) / rise_ms
                + falls * (REST - state.contractility) / decay_ms.max(self.course.relaxation_ms);
            state.contractility = (state.contractility + 1e3 * dt_s * per_ms).max(0.0);
            let velocity = self.of.velocity_um_per_s * ((length_um - length) / SERIES_UM - 1.0);
            state.length_um = (length + dt_s * velocity).max(LEAST_UM);
        }
        after
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Sarcomeres {
        Sarcomeres {
            wall_ml: 110.0,
            reference_ml: 130.0,
            length_um: 2.15,
            active_kpa: 120.0,
            passive_mmhg: 9.0,
            passive_exponent: 12.0,
            unloaded_stretch: 0.82,
            times_ms: (48.0, 32.0),
            duration_ms: 425.0,
            velocity_um_per_s: 7.0,
        }
    }

    /// Work of the fibres equals work of the cavity: dW = σ V_w dε = p dV.
    #[test]
    fn pressure_does_the_work_of_the_fibres() {
        let (parameters, course) = (wall(), Course::default());
        let wall = parameters.wall(&course);
        for cavity in [40.0, 80.0, 130.0, 180.0] {
            let (below, here, above) = (
                wall.shape(cavity - 0.01),
                wall.shape(cavity),
                wall.shape(cavity + 0.01),
            );
            let by_strain = KPA * parameters.wall_ml * (above.strain - below.strain) / 0.02;
            let ratio = by_strain / here.pressure_per_stress;
            assert!((ratio - 1.0).abs() < 1e-6, "{cavity}: {ratio}");
        }
    }

    /// Held at its volume, the wall contracts to some 200 mmHg and relaxes.
    #[test]
    fn an_isovolumic_twitch_rises_and_falls() {
        let (parameters, course) = (wall(), Course::default());
        let wall = parameters.wall(&course);
        let mut groups = [Sarcomere::default(); N_GROUPS];
        let mut pressures = Vec::new();
        for step in 0..4 * 4000 {
            let t = f64::from(step % 4000) * 0.2;
            groups = wall.step(&groups, 130.0, (t, 800.0), 2e-4);
            if step >= 3 * 4000 {
                pressures.push(wall.pressure(130.0, &groups, 1.0));
            }
        }
        let peak = pressures.iter().copied().fold(f64::MIN, f64::max);
        let at = pressures.iter().position(|p| *p == peak).unwrap() as f64 * 0.2;
        let least = pressures.iter().copied().fold(f64::MAX, f64::min);
        assert!((120.0..400.0).contains(&peak), "{peak}");
        assert!((100.0..350.0).contains(&at), "{at}");
        assert!((2.0..30.0).contains(&least), "{least}");
    }
}
