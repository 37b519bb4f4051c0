//! Measures of a beat's motion from the ventricle's shapes over time.

use cardiotwin_vocabulary::motion::MotionMeasures;

use super::Shape;

/// Start times of a beat's phases \[ms\] from its beginning at end-diastole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phases {
    /// Start of ejection, the end of isovolumic contraction.
    pub ejection_ms: f64,
    /// End of ejection (end-systole), where isovolumic relaxation begins.
    pub end_systole_ms: f64,
    /// Start of filling; `None` if the beat ends before it.
    pub filling_ms: Option<f64>,
}

/// Shapes over a beat in the order of time, and extremes of the elements' volume ratios.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Sample index in the beat's traces, and the shape at that sample.
    shapes: Vec<(usize, Shape)>,
    /// Smallest and largest volume ratio of an element so far.
    volume_ratios: [f64; 2],
}

impl Series {
    /// Starts a series with the shape at end-diastole.
    #[must_use]
    pub fn new(begin: Shape) -> Self {
        Self {
            shapes: vec![(0, begin)],
            volume_ratios: [f64::INFINITY, f64::NEG_INFINITY],
        }
    }

    /// Appends the shape after a sample of the beat's traces.
    pub fn push(&mut self, sample: usize, shape: Shape) {
        self.shapes.push((sample, shape));
    }

    /// Widens the range of volume ratios by the smallest and the largest one at an instant.
    pub fn strained(&mut self, [least, most]: [f64; 2]) {
        self.volume_ratios = [
            self.volume_ratios[0].min(least),
            self.volume_ratios[1].max(most),
        ];
    }

    /// Sample index of the last shape.
    #[must_use]
    pub fn last_sample(&self) -> usize {
        self.shapes.last().map_or(0, |(sample, _)| *sample)
    }

    /// The series as an array of numbers.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        let shapes = self
            .shapes
            .iter()
            .flat_map(|(sample, shape)| [*sample as f64].into_iter().chain(shape.numbers()));
        self.volume_ratios.into_iter().chain(shapes).collect()
    }

    /// Restores a series from [`Self::numbers`]; `None` for an array of another layout.
    #[must_use]
    pub fn of_numbers(numbers: &[f64]) -> Option<Self> {
        let (volume_ratios, shapes) = numbers.split_first_chunk::<2>()?;
        let (shapes, rest) = shapes.as_chunks::<{ Shape::N + 1 }>();
        let shape = |[sample, shape @ ..]: &[f64; Shape::N + 1]| {
            (*sample as usize, Shape::of_numbers(*shape))
        };
        let shapes: Vec<_> = shapes.iter().map(shape).collect();
        (rest.is_empty() && !shapes.is_empty()).then_some(Self {
            shapes,
            volume_ratios: *volume_ratios,
        })
    }

    /// The shape at a time, interpolated linearly between samples and held constant beyond the ends.
    fn at(&self, time_ms: f64, sample_times_ms: &[f64]) -> Shape {
        let time = |k: usize| {
            sample_times_ms
                .get(self.shapes[k].0)
                .copied()
                .unwrap_or(f64::INFINITY)
        };
        let after = self.shapes.partition_point(|(sample, _)| {
            sample_times_ms
                .get(*sample)
                .is_some_and(|time| *time <= time_ms)
        });
        if after == 0 || after == self.shapes.len() {
            return self.shapes[after.saturating_sub(1)].1;
        }
        let share = (time_ms - time(after - 1)) / (time(after) - time(after - 1));
        let (from, to) = (
            self.shapes[after - 1].1.numbers(),
            self.shapes[after].1.numbers(),
        );
        Shape::of_numbers(std::array::from_fn(|i| from[i] + share * (to[i] - from[i])))
    }

    /// Computes the measures of the beat.
    ///
    /// - `sample_times_ms`: times of the samples of the beat's traces \[ms\]
    /// - `pressure_mmhg`: cavity pressure at these times
    #[must_use]
    pub fn measures(
        &self,
        phases: &Phases,
        sample_times_ms: &[f64],
        pressure_mmhg: &[f64],
    ) -> MotionMeasures {
        let at = |time_ms| self.at(time_ms, sample_times_ms);
        let (begin, systole) = (self.shapes[0].1, at(phases.end_systole_ms));
        let change = |now: f64, before: f64| 100.0 * (now / before - 1.0);
        let [peak_endo, peak_epi] = self.shapes.iter().fold([0.0f64; 2], |peak, (_, shape)| {
            let twist = shape.twist_deg();
            std::array::from_fn(|k| {
                if twist[k].abs() > peak[k].abs() {
                    twist[k]
                } else {
                    peak[k]
                }
            })
        });
        let undone = |filling_ms| systole.twist_deg()[1] - at(filling_ms).twist_deg()[1];
        // A ventricle that never twists has nothing to untwist.
        let untwisting = |filling_ms| {
            if peak_epi.abs() > 1e-9 {
                100.0 * undone(filling_ms) / peak_epi
            } else {
                0.0
            }
        };
        MotionMeasures {
            base_descent_mm: systole.base_mm - begin.base_mm,
            apex_rise_mm: begin.apex_mm - systole.apex_mm,
            epicardial_radius_change_percent: change(systole.radius_mm[1], begin.radius_mm[1]),
            shortening_percent: -change(systole.cavity_length_mm, begin.cavity_length_mm),
            wall_thickening_percent: change(systole.wall_mm(), begin.wall_mm()),
            twist_epi_deg: peak_epi,
            twist_endo_deg: peak_endo,
            isovolumic_lengthening_percent: change(
                at(phases.ejection_ms).cavity_length_mm,
                begin.cavity_length_mm,
            ),
            isovolumic_untwisting_percent: phases.filling_ms.map(untwisting),
            least_pressure_mmhg: pressure_mmhg.iter().copied().fold(f64::INFINITY, f64::min),
            least_volume_ratio: self.volume_ratios[0],
            largest_volume_ratio: self.volume_ratios[1],
        }
    }
}
