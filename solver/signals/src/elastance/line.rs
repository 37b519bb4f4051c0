//! Lines through beats of one heart at different loads.

use super::beat::Beat;
use super::end_systole::{EndSystole, InterceptError, settle};
use super::regression::Line;

/// Least spread of the argument over the mean stroke volume: below it two loads are the same.
const LEAST_SPREAD: f64 = 0.01;

/// Reasons why beats do not determine a line.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LineError {
    /// A line needs two beats.
    #[error("a line needs at least 2 beats at different loads, but there are {n_beats}")]
    TooFewBeats {
        /// Beats that were given.
        n_beats: usize,
    },
    /// The beats hardly differ.
    #[error(
        "{argument} differs by {spread_ml} mL only, less than 1 % of the stroke volume: change the load more"
    )]
    SameLoad {
        /// Volume that hardly differs.
        argument: &'static str,
        /// Largest less smallest value \[mL\].
        spread_ml: f64,
    },
    /// The line does not rise.
    #[error(
        "{line} does not rise with the volume: its slope is {slope}; the beats differ in more than their load"
    )]
    NotRising {
        /// Name of the line.
        line: &'static str,
        /// Slope, mmHg/mL or mmHg.
        slope: f64,
    },
    /// The intercept cannot be used or found.
    #[error(transparent)]
    Intercept(#[from] InterceptError),
}

/// End-systolic pressure–volume relation of one heart, Pes = Ees (Ves − V0).
#[derive(Debug, Clone, PartialEq)]
pub struct EndSystolicLine {
    /// End-systolic elastance Ees \[mmHg/mL\].
    pub elastance_mmhg_per_ml: f64,
    /// Volume intercept V0 \[mL\].
    pub intercept_ml: f64,
    /// Standard errors of Ees \[mmHg/mL\] and V0 \[mL\]; none for two beats.
    pub standard_errors: Option<[f64; 2]>,
    /// End-systolic points, one per beat.
    pub points: Vec<EndSystole>,
}

impl EndSystolicLine {
    /// The line through the end-systolic points of two or more beats, which depend on V0 and are found with it.
    ///
    /// Source: Suga and Sagawa 1974, Circ Res 35:117, not read. Tests find Ees and V0 of 36 model hearts to 5 %. An
    /// internal resistance lowers Ees of weak hearts, which still eject when they are stiffest: by up to 8 % at
    /// 0.05 mmHg s/mL and 0.8 mmHg/mL.
    ///
    /// # Errors
    /// [`LineError`] when there are fewer than two beats, end-systolic volumes hardly differ, the line does not rise,
    /// or V0 lies inside a loop.
    pub fn through(beats: &[Beat]) -> Result<Self, LineError> {
        let beats: Vec<&Beat> = beats.iter().collect();
        let (points, intercept_ml, line) = settle(&beats, |points| {
            let points: Vec<_> = points
                .iter()
                .map(|p| [p.volume_ml, p.pressure_mmhg])
                .collect();
            let line = rising(
                &points,
                &beats,
                "the end-systolic volume",
                "the end-systolic line",
            )?;
            Ok::<_, LineError>((line.intercept, line))
        })?;
        Ok(Self {
            elastance_mmhg_per_ml: line.slope,
            intercept_ml,
            standard_errors: line.standard_errors,
            points,
        })
    }
}

/// Preload-recruitable stroke work of one heart, SW = Mw (EDV − Vw).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreloadRecruitableStrokeWork {
    /// Slope Mw \[mmHg\].
    pub slope_mmhg: f64,
    /// Volume intercept Vw \[mL\].
    pub intercept_ml: f64,
    /// Standard errors of Mw \[mmHg\] and Vw \[mL\]; none for two beats.
    pub standard_errors: Option<[f64; 2]>,
}

impl PreloadRecruitableStrokeWork {
    /// The line of stroke work on end-diastolic volume through two or more beats of different filling.
    ///
    /// Source: Glower et al. 1985, Circulation 71:994, SW = Mw (EDV − Vw), read in publications that cite it. A change of
    /// the arteries' resistance alone leaves the end-diastolic volume nearly as it is: change the filling.
    ///
    /// # Errors
    /// [`LineError`] when there are fewer than two beats, end-diastolic volumes hardly differ, or work does not rise.
    pub fn through(beats: &[Beat]) -> Result<Self, LineError> {
        let points: Vec<_> = beats
            .iter()
            .map(|beat| [beat.end_diastolic_volume_ml(), beat.stroke_work_mmhg_ml()])
            .collect();
        let beats: Vec<&Beat> = beats.iter().collect();
        let line = rising(&points, &beats, "the end-diastolic volume", "stroke work")?;
        Ok(Self {
            slope_mmhg: line.slope,
            intercept_ml: line.intercept,
            standard_errors: line.standard_errors,
        })
    }
}

/// A line that rises, through points that differ enough.
fn rising(
    points: &[[f64; 2]],
    beats: &[&Beat],
    argument: &'static str,
    line: &'static str,
) -> Result<Line, LineError> {
    if points.len() < 2 {
        return Err(LineError::TooFewBeats {
            n_beats: points.len(),
        });
    }
    let stroke_ml = beats
        .iter()
        .map(|beat| beat.stroke_volume_ml())
        .sum::<f64>()
        / beats.len() as f64;
    let (least, most) = points.iter().fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), point| (least.min(point[0]), most.max(point[0])),
    );
    let spread_ml = most - least;
    if spread_ml < LEAST_SPREAD * stroke_ml {
        return Err(LineError::SameLoad {
            argument,
            spread_ml,
        });
    }
    match Line::through(points) {
        Some(found) if found.slope > 0.0 => Ok(found),
        found => Err(LineError::NotRising {
            line,
            slope: found.map_or(0.0, |found| found.slope),
        }),
    }
}

#[cfg(test)]
#[path = "line_tests.rs"]
mod tests;
