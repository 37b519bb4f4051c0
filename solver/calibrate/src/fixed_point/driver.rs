//! Pairs of parameter and biomarker in the update rule.

use cardiotwin_vocabulary::biomarkers::Biomarker;
use cardiotwin_vocabulary::step1::Step1Parameter;

/// Biomarker whose ratio drives the update of a parameter, and the exponent of measured/simulated
/// (Jung et al. 2022, eqs. 13 and 15).
#[must_use]
pub fn driver(parameter: Step1Parameter) -> (Biomarker, f64) {
    match parameter {
        Step1Parameter::SmaxRef => (Biomarker::PMax, 1.0),
        Step1Parameter::TauSrRef => (Biomarker::DpdtMax, -1.0),
        Step1Parameter::TauSd => (Biomarker::DpdtMin, -1.0),
        Step1Parameter::TCr => (Biomarker::Ptd90, 1.0),
        Step1Parameter::RAvF => (Biomarker::TauVd, 1.0),
        Step1Parameter::RMvF => (Biomarker::TauVr, 1.0),
    }
}
