//! The right ventricle, where the mesh has one: passive tissue around a cavity of prescribed pressure.

use serde::{Deserialize, Serialize};

use super::triangles::Triangles;

/// Endocardium of the right ventricle, and the parts of the rim that carry the valves of each ventricle.
#[derive(Debug, Clone, PartialEq)]
pub struct RightVentricle {
    /// Right endocardium, including the right side of the septum.
    pub endocardium: Triangles,
    /// Node loops around its openings, as for the left ventricle; none if it is closed.
    pub openings: Vec<Vec<u32>>,
    /// Rim around the right ventricle's openings.
    pub ring: Triangles,
    /// Rim around the left ventricle's openings.
    pub left_ring: Triangles,
}

impl RightVentricle {
    pub(super) fn mapped(
        &self,
        surface: impl Fn(&Triangles) -> Triangles,
        node: impl Fn(&u32) -> u32,
    ) -> Self {
        Self {
            endocardium: surface(&self.endocardium),
            openings: self
                .openings
                .iter()
                .map(|nodes| nodes.iter().map(&node).collect())
                .collect(),
            ring: surface(&self.ring),
            left_ring: surface(&self.left_ring),
        }
    }
}

/// Pressure in the right ventricle, in the beat and in step 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RightPressure {
    /// Pressure over the beat.
    #[serde(flatten)]
    pub course: PressureCourse,
    /// Ratio of right to left ventricular pressure at end-diastole, at which step 0 loads both ventricles together.
    pub per_left: f64,
}

/// A periodic pressure, linear between its samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PressureCourse {
    /// Times of the samples from the beat's start \[ms\], ascending from zero.
    pub time_ms: Vec<f64>,
    /// Pressures at these times \[kPa\].
    #[serde(rename = "pressure_kpa")]
    pub kpa: Vec<f64>,
    /// Length of a beat \[ms\].
    pub cycle_ms: f64,
}

impl PressureCourse {
    /// A constant pressure \[kPa\].
    #[must_use]
    pub fn constant(kpa: f64) -> Self {
        Self {
            time_ms: vec![0.0],
            kpa: vec![kpa],
            cycle_ms: 1.0,
        }
    }

    /// Pressure at a time in any beat \[kPa\].
    ///
    /// # Panics
    /// For a course without samples.
    #[must_use]
    pub fn at(&self, time_ms: f64) -> f64 {
        let t = time_ms.rem_euclid(self.cycle_ms);
        let before = self
            .time_ms
            .partition_point(|sample| *sample <= t)
            .saturating_sub(1);
        let (t0, p0) = (self.time_ms[before], self.kpa[before]);
        // The course is periodic, so that the first sample follows the last.
        let next = before + 1;
        let t1 = self
            .time_ms
            .get(next)
            .copied()
            .unwrap_or(self.cycle_ms + self.time_ms[0]);
        let p1 = self.kpa.get(next).copied().unwrap_or(self.kpa[0]);
        if t1 > t0 {
            p0 + (p1 - p0) * (t - t0) / (t1 - t0)
        } else {
            p0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_course_is_straight_between_samples_and_comes_again() {
        let course = PressureCourse {
            time_ms: vec![0.0, 100.0, 400.0],
            kpa: vec![1.0, 3.0, 0.0],
            cycle_ms: 500.0,
        };
        for (t, p) in [
            (0.0, 1.0),
            (50.0, 2.0),
            (100.0, 3.0),
            (400.0, 0.0),
            (450.0, 0.5),
            (500.0, 1.0),
            (1050.0, 2.0),
        ] {
            assert!(
                (course.at(t) - p).abs() < 1e-12,
                "{p} at {t}: {}",
                course.at(t)
            );
        }
        assert!((course.at(-50.0) - 0.5).abs() < 1e-12);
        assert_eq!(PressureCourse::constant(0.7).at(123.4), 0.7);
    }
}
