//! Motion of the ventricle in the current beat: its shape at each sample of the traces, and the
//! measures computed from it.

use cardiotwin_mechanics::organ::motion::{Landmarks, Phases, Series, volume_ratios};
use cardiotwin_mesh::right_ventricle::left_alone;
use cardiotwin_mesh::{TetMesh, tags};
use cardiotwin_models::beat::BeatTraces;
use cardiotwin_schemas::biomarkers::TimePoints;
use cardiotwin_schemas::motion::MotionMeasures;

use super::shapes::Shapes;

/// Number of samples between two computations of all elements' volumes, which cost more than
/// everything else here.
const SAMPLES_PER_LOOK: usize = 5;

/// Parts of a mesh whose motion is measured.
#[derive(Debug)]
pub struct Followed {
    landmarks: Landmarks,
    tets: Vec<[u32; 4]>,
}

impl Followed {
    /// Landmarks and elements of a mesh; `None`, with a warning, if it has no left ventricle.
    #[must_use]
    pub fn of(mesh: &TetMesh) -> Option<Self> {
        match Landmarks::of(&left_alone(mesh, &[tags::LEFT_VENTRICLE])) {
            Ok(landmarks) => Some(Self {
                landmarks,
                tets: mesh.tets.clone(),
            }),
            Err(error) => {
                tracing::warn!("the ventricle's motion is not measured: {error}");
                None
            }
        }
    }

    /// Positions of the nodes at the beginning of the beat, and a series that begins there.
    fn at_the_beginning(&self, shapes: &Shapes, unloaded: &[f64]) -> (Vec<[f64; 3]>, Series) {
        let begin = positions(unloaded, &shapes.begin.u);
        let mut series = Series::new(self.landmarks.shape(&begin, &begin));
        series.strained(volume_ratios(
            &self.tets,
            unloaded.as_chunks::<3>().0,
            &begin,
        ));
        (begin, series)
    }
}

/// Motion in the current beat.
#[derive(Debug)]
pub struct Motion {
    followed: Followed,
    /// Number of the beat, from one.
    beat: usize,
    begin: Vec<[f64; 3]>,
    series: Series,
}

fn positions(unloaded: &[f64], u: &[f64]) -> Vec<[f64; 3]> {
    let x: Vec<f64> = unloaded.iter().zip(u).map(|(x, u)| x + u).collect();
    x.as_chunks::<3>().0.to_vec()
}

impl Motion {
    /// Starts with the beat that begins at the first of `shapes`.
    ///
    /// - `unloaded`: unloaded positions of the mesh's nodes \[mm\], three numbers per node; further
    ///   values are ignored
    #[must_use]
    pub fn begin(followed: Followed, shapes: &Shapes, unloaded: &[f64]) -> Self {
        let (begin, series) = followed.at_the_beginning(shapes, unloaded);
        Self {
            followed,
            beat: shapes.beat,
            begin,
            series,
        }
    }

    /// Continues from a checkpoint with these shapes; starts the beat again if its numbers are not
    /// usable.
    pub fn resume(&mut self, shapes: &Shapes, unloaded: &[f64], numbers: &[f64]) {
        let (begin, fresh) = self.followed.at_the_beginning(shapes, unloaded);
        (self.beat, self.begin, self.series) = (
            shapes.beat,
            begin,
            Series::of_numbers(numbers).unwrap_or(fresh),
        );
    }

    /// Numbers of the series, for a checkpoint.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        self.series.numbers()
    }

    /// Adds the latest of `shapes`, which must have been updated before. The first sample of a new
    /// beat discards the previous beat.
    pub fn observe(&mut self, shapes: &Shapes, unloaded: &[f64]) {
        if shapes.beat != self.beat {
            self.resume(shapes, unloaded, &[]);
        }
        let latest = shapes.latest();
        let x = positions(unloaded, &latest.u);
        if latest.sample / SAMPLES_PER_LOOK > self.series.last_sample() / SAMPLES_PER_LOOK {
            self.series.strained(volume_ratios(
                &self.followed.tets,
                unloaded.as_chunks::<3>().0,
                &x,
            ));
        }
        self.series.push(
            latest.sample,
            self.followed.landmarks.shape(&self.begin, &x),
        );
    }

    /// Measures of the beat; `None` if it has no ejection.
    #[must_use]
    pub fn measures(&self, times: &TimePoints, traces: &BeatTraces) -> Option<MotionMeasures> {
        let phases = Phases {
            ejection_ms: times.t4_ms?,
            end_systole_ms: times.t5_ms?,
            filling_ms: times.t6_ms,
        };
        Some(
            self.series
                .measures(&phases, &traces.time_ms, &traces.pressure_mmhg),
        )
    }
}
