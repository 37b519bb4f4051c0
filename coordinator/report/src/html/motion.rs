//! Table of the motion of a patient's finite-element ventricle, with normal ranges.

use cardiotwin_schemas::motion::{Against, MOTION, MotionMeasure, MotionMeasures};
use cardiotwin_schemas::record::PatientRecord;
use maud::{Markup, html};

use super::format::fixed;
use super::tables::scrolling;
use crate::results::{PatientView, Step};

/// The table; `None` without a finite-element beat.
#[must_use]
pub fn table(patient: &PatientRecord) -> Option<Markup> {
    let view = PatientView(patient);
    let mut steps = vec![(Step::Step1, "step 1"), (Step::Step2, "step 2")];
    if patient.step3.is_some() {
        steps.push((Step::Step3, "step 3"));
    }
    let beats: Vec<_> = steps
        .iter()
        .map(|(step, _)| view.beat(*step).and_then(|beat| beat.result.motion))
        .collect();
    if beats.iter().all(Option::is_none) {
        return None;
    }
    Some(scrolling(&html! {
        table {
            caption { "Motion" span.quiet { ", against the normal range" } }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" }
                @for (_, name) in &steps { th.num scope="col" { (name) } th scope="col" { "" } }
                th scope="col" { "normal" } th scope="col" { "source" }
            } }
            tbody {
                @for measure in &MOTION {
                    tr {
                        th scope="row" { (measure.name) }
                        td.unit { (measure.unit) }
                        @for beat in &beats { (value(measure, beat.as_ref())) }
                        td.num { (digits(measure, Some(measure.normal[0]))) " to " (digits(measure, Some(measure.normal[1]))) }
                        td.quiet { (measure.source) }
                    }
                }
            }
        }
    }))
}

fn digits(measure: &MotionMeasure, value: Option<f64>) -> String {
    fixed(value, if measure.unit == "1" { 2 } else { 1 })
}

/// Cells with the value and with words for its place next to the normal range, so that colour is not
/// needed.
fn value(measure: &MotionMeasure, motion: Option<&MotionMeasures>) -> Markup {
    let Some(motion) = motion else {
        return html! { td {} td {} };
    };
    let against = measure
        .against(motion)
        .filter(|against| *against != Against::Within);
    html! {
        td.num { (digits(measure, (measure.of)(motion))) }
        td.flag { @if let Some(against) = against { (against.as_str()) } }
    }
}
