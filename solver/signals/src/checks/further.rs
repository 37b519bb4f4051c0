//! Are further traces those of their quantity, in the unit that the header names, over the cycle?

use super::coverage;
use super::measured::{Source, extremes};
use crate::Problem;
use cardiotwin_units::Ms;
use cardiotwin_vocabulary::measurements::FurtherQuantity;

/// Bounds of the largest and of the smallest value that a quantity can have, wide enough for any
/// heart: they find a wrong unit, sign or file.
struct Bounds {
    largest: std::ops::RangeInclusive<f64>,
    smallest: std::ops::RangeInclusive<f64>,
    expected: &'static str,
    remedy: &'static str,
}

impl Bounds {
    fn of(quantity: FurtherQuantity) -> Self {
        match quantity {
            FurtherQuantity::AorticPressure => Self {
                largest: 30.0..=350.0,
                smallest: 5.0..=250.0,
                expected: "5 to 350 mmHg in an aorta",
                remedy: "is it in mmHg, and the aorta's rather than the ventricle's? correct or convert the values",
            },
            FurtherQuantity::AorticFlow | FurtherQuantity::MitralFlow => Self {
                largest: 50.0..=3000.0,
                smallest: -1500.0..=100.0,
                expected: "a flow with its peak, 50 to 3000 mL/s, in its forward direction",
                remedy: "is it in mL/s, forward positive? convert L/min (times 16.7), or turn the sign",
            },
            FurtherQuantity::AtrialPressure => Self {
                largest: 0.0..=80.0,
                smallest: -20.0..=60.0,
                expected: "-20 to 80 mmHg in a left atrium",
                remedy: "is it in mmHg, and the atrium's rather than the ventricle's? correct or convert the values",
            },
            FurtherQuantity::Strain => Self {
                largest: -5.0..=40.0,
                smallest: -60.0..=-1.5,
                expected: "a wall that shortens by 1.5 to 60 %",
                remedy: "give percent, negative where the wall is shorter; a fraction is to be multiplied by 100",
            },
        }
    }
}

/// All problems of a further trace, errors first.
#[must_use]
pub fn check_further(which: FurtherQuantity, source: Source, cycle_length: Ms) -> Vec<Problem> {
    let mut problems = Vec::new();
    match which {
        FurtherQuantity::AorticPressure | FurtherQuantity::AtrialPressure => {
            coverage::of_pressure(source, cycle_length.0, &mut problems);
        }
        _ => coverage::of_frames(source, cycle_length.0, &mut problems),
    }
    let (most, least) = extremes(source.trace);
    let bounds = Bounds::of(which);
    if !(bounds.largest.contains(&most) && bounds.smallest.contains(&least)) {
        let quantity = source.trace.quantity();
        let problem = Problem::error(
            source.file,
            format!("values of {least:.1} to {most:.1} {}", quantity.unit()),
            bounds.expected,
            bounds.remedy,
        );
        problems.push(problem.at_key(quantity.column()));
    }
    problems.sort_by_key(|p| p.severity);
    problems
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quantity, Trace};
    use std::path::Path;

    fn said(
        which: FurtherQuantity,
        quantity: Quantity,
        value: impl Fn(f64) -> f64,
    ) -> Vec<Problem> {
        let trace = Trace::uniform(
            quantity,
            20.0,
            (0..40).map(|i| value(f64::from(i))).collect(),
        )
        .unwrap();
        let source = Source {
            file: Path::new("x.csv"),
            trace: &trace,
        };
        check_further(which, source, Ms(800.0))
    }

    #[test]
    fn wrong_units_and_signs_are_named_and_sound_traces_are_not() {
        let hump = |i: f64| (std::f64::consts::PI * i / 40.0).sin();
        let flow = |scale: f64| {
            said(FurtherQuantity::AorticFlow, Quantity::Flow, move |i| {
                scale * hump(i)
            })
        };
        assert!(flow(400.0).is_empty());
        // L/min, and a sign that is turned.
        assert!(flow(24.0)[0].remedy.contains("L/min") && flow(-400.0)[0].remedy.contains("sign"));
        let strain = |scale: f64| {
            said(FurtherQuantity::Strain, Quantity::Strain, move |i| {
                scale * hump(i)
            })
        };
        assert!(strain(-18.0).is_empty());
        assert!(strain(-0.18)[0].remedy.contains("fraction") && strain(18.0)[0].is_error());
        let short = said(FurtherQuantity::AtrialPressure, Quantity::Pressure, |i| {
            8.0 + hump(i)
        });
        // 40 samples are few for a pressure, but no error.
        assert!(short.iter().all(|problem| !problem.is_error()), "{short:?}");
        let ventricle = said(FurtherQuantity::AtrialPressure, Quantity::Pressure, |i| {
            120.0 * hump(i)
        });
        assert!(ventricle[0].is_error() && ventricle[0].found.contains("120.0 mmHg"));
    }

    #[test]
    fn a_trace_of_another_cycle_is_named() {
        let trace = Trace::uniform(Quantity::Flow, 20.0, vec![200.0; 60]).unwrap();
        let source = Source {
            file: Path::new("x.csv"),
            trace: &trace,
        };
        let said = check_further(FurtherQuantity::AorticFlow, source, Ms(800.0));
        assert!(
            said[0].is_error() && said[0].expected.contains("800"),
            "{said:?}"
        );
    }
}
