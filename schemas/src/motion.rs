//! Normal ranges of the motion of a simulated ventricle.
//!
//! The measures are defined in [`cardiotwin_vocabulary::motion`].

pub use cardiotwin_vocabulary::motion::MotionMeasures;

/// A measure of motion with its normal range.
#[derive(Debug, Clone, Copy)]
pub struct MotionMeasure {
    /// Key in files, with unit.
    pub key: &'static str,
    /// Name of the measure in reports.
    pub name: &'static str,
    /// Unit of the measure in reports.
    pub unit: &'static str,
    /// Normal range, in the unit.
    pub normal: [f64; 2],
    /// Source of the normal range, for readers. It begins with [`READ`] where the bounds were read in
    /// the source, and with [`OURS`] where they are our own.
    pub source: &'static str,
    /// Value of a beat; `None` if the beat does not have it.
    pub of: fn(&MotionMeasures) -> Option<f64>,
}

/// Position of a value relative to its normal range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// The value lies below the range.
    Below,
    /// The value lies in the range.
    Within,
    /// The value lies above the range.
    Above,
}

impl Against {
    /// Word for this result in reports.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Below => "below",
            Self::Within => "normal",
            Self::Above => "above",
        }
    }
}

impl MotionMeasure {
    /// Compares a beat with the normal range; `None` if the beat does not have the measure. NaN
    /// counts as outside the range.
    #[must_use]
    pub fn against(&self, motion: &MotionMeasures) -> Option<Against> {
        let value = (self.of)(motion)?;
        Some(match self.normal {
            [lower, _] if value < lower => Against::Below,
            [_, upper] if value <= upper => Against::Within,
            _ => Against::Above,
        })
    }
}

/// Beginning of a source in which the bounds were read (in its abstract).
pub const READ: &str = "read in";
/// Beginning of a source for bounds of our own.
pub const OURS: &str = "our bounds";

/// All measures with their normal ranges, in the order of tables.
///
/// The abstracts of Yingchoncharoen et al. and of Carlsson et al. were read on 2026-11-29. The former
/// gives the range of the means of 24 studies of healthy people, which is narrower than the range of
/// healthy people. All other numbers are quoted from memory of reviews and are not confirmed.
pub const MOTION: [MotionMeasure; 12] = [
    MotionMeasure {
        key: "base_descent_mm",
        name: "base down",
        unit: "mm",
        normal: [12.0, 15.0],
        source: "our bounds, of the mitral annulus's excursion; Hu et al. 2013, Eur. Heart J. Cardiovasc. Imaging 14:205, was not read",
        of: |m| Some(m.base_descent_mm),
    },
    MotionMeasure {
        key: "apex_rise_mm",
        name: "apex up",
        unit: "mm",
        normal: [-3.0, 3.0],
        source: "our bounds: the apex is about still; Rogers et al. 1991, Circulation 84:721, was not read",
        of: |m| Some(m.apex_rise_mm),
    },
    MotionMeasure {
        key: "epicardial_radius_change_percent",
        name: "epicardial radius",
        unit: "%",
        normal: [-11.0, -4.0],
        source: "our bounds, from the whole heart's volume, which varies by 8.2 % (standard error 0.8): Carlsson et al. 2004, Am. J. Physiol. 287:H243",
        of: |m| Some(m.epicardial_radius_change_percent),
    },
    MotionMeasure {
        key: "shortening_percent",
        name: "cavity shortening",
        unit: "%",
        normal: [15.9, 22.1],
        source: "read in Yingchoncharoen et al. 2013, J. Am. Soc. Echocardiogr. 26:185: means of global longitudinal strain in studies of healthy people",
        of: |m| Some(m.shortening_percent),
    },
    MotionMeasure {
        key: "wall_thickening_percent",
        name: "wall thickening",
        unit: "%",
        normal: [35.1, 59.0],
        source: "read in Yingchoncharoen et al. 2013, J. Am. Soc. Echocardiogr. 26:185: means of global radial strain in studies of healthy people",
        of: |m| Some(m.wall_thickening_percent),
    },
    MotionMeasure {
        key: "twist_epi_deg",
        name: "twist, epicardium",
        unit: "°",
        normal: [8.0, 20.0],
        source: "our bounds; Taber et al. 1996, J. Biomech. 29:745, Lorenz et al. 2000, J. Cardiovasc. Magn. Reson. 2:97, and Stöhr et al. 2016, Am. J. Physiol. 311:H633, were not read",
        of: |m| Some(m.twist_epi_deg),
    },
    MotionMeasure {
        key: "twist_endo_deg",
        name: "twist, endocardium",
        unit: "°",
        normal: [8.0, 25.0],
        source: "our bounds, larger than the epicardium's; Buchalter et al. 1990, Circulation 81:1236, was not read",
        of: |m| Some(m.twist_endo_deg),
    },
    MotionMeasure {
        key: "isovolumic_lengthening_percent",
        name: "isovolumic lengthening",
        unit: "%",
        normal: [-5.0, 2.0],
        source: "our bounds: about none",
        of: |m| Some(m.isovolumic_lengthening_percent),
    },
    MotionMeasure {
        key: "isovolumic_untwisting_percent",
        name: "isovolumic untwisting",
        unit: "%",
        normal: [20.0, 60.0],
        source: "our bounds, around 40 % of the twist; Rademakers et al. 1992, Circulation 85:1572, was not read",
        of: |m| m.isovolumic_untwisting_percent,
    },
    MotionMeasure {
        key: "least_pressure_mmHg",
        name: "least pressure",
        unit: "mmHg",
        normal: [-1.5, 6.0],
        source: "our bounds: little suction at rest",
        of: |m| Some(m.least_pressure_mmhg),
    },
    MotionMeasure {
        key: "least_volume_ratio",
        name: "smallest element volume",
        unit: "1",
        normal: [0.85, 1.0],
        source: "our bounds, on 8,000 nodes or more: blood moved out of the wall is a few percent of it",
        of: |m| Some(m.least_volume_ratio),
    },
    MotionMeasure {
        key: "largest_volume_ratio",
        name: "largest element volume",
        unit: "1",
        normal: [1.0, 1.15],
        source: "our bounds, as of the smallest",
        of: |m| Some(m.largest_volume_ratio),
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_measure_is_in_the_table_once_under_its_own_key() {
        let distinct = MotionMeasures {
            base_descent_mm: 1.0,
            apex_rise_mm: 2.0,
            epicardial_radius_change_percent: 3.0,
            shortening_percent: 4.0,
            wall_thickening_percent: 5.0,
            twist_epi_deg: 6.0,
            twist_endo_deg: 7.0,
            isovolumic_lengthening_percent: 8.0,
            isovolumic_untwisting_percent: Some(9.0),
            least_pressure_mmhg: 10.0,
            least_volume_ratio: 11.0,
            largest_volume_ratio: 12.0,
        };
        let written = serde_json::to_value(distinct).unwrap();
        assert_eq!(written.as_object().unwrap().len(), MOTION.len());
        for measure in MOTION {
            assert_eq!(
                written[measure.key].as_f64(),
                (measure.of)(&distinct),
                "{}",
                measure.key
            );
            assert!(measure.normal[0] < measure.normal[1], "{}", measure.key);
            assert!(
                measure.source.starts_with(READ) || measure.source.starts_with(OURS),
                "{}",
                measure.source
            );
        }
    }

    #[test]
    fn a_value_stands_against_its_range() {
        let base = MOTION[0];
        let against = |base_descent_mm| {
            base.against(&MotionMeasures {
                base_descent_mm,
                ..Default::default()
            })
            .unwrap()
        };
        assert_eq!(
            [11.9, 12.0, 15.0, 15.1].map(against),
            [
                Against::Below,
                Against::Within,
                Against::Within,
                Against::Above
            ]
        );
        assert_eq!(against(f64::NAN), Against::Above);
    }
}
