//! Values in a member's record, by table and quantity.

use std::collections::BTreeMap;

use cardiotwin_report::results::{PatientView, Step};
use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::robustness::{RobustnessMember, TableKind};
use cardiotwin_schemas::status::PatientState;
use cardiotwin_schemas::step1::Step1Parameter;

use super::design::Member;

/// Biomarkers in the tables: the paper's five, and the two to which the valves are fitted.
pub const BIOMARKERS: [Biomarker; 7] = [
    Biomarker::PMax,
    Biomarker::DpdtMax,
    Biomarker::DpdtMin,
    Biomarker::Ptd90,
    Biomarker::Sv,
    Biomarker::TauVd,
    Biomarker::TauVr,
];

/// Summary of a member with the results so far.
pub fn summary(member: &Member, record: Option<&PatientRecord>) -> RobustnessMember {
    let fit = record.and_then(|r| r.cell_fit.as_ref()).map(|f| &f.result);
    let step1 = record.and_then(|r| r.step1.as_ref());
    RobustnessMember {
        id: member.plan.id.clone(),
        role: member.role,
        state: record.map_or(PatientState::Waiting, |r| r.status.state),
        failure: record
            .and_then(|r| r.failure.as_ref())
            .map(|f| f.message.clone()),
        inputs: member.inputs.clone(),
        step1: step1.map(ToString::to_string),
        step1_iterations: record.map_or(0, |r| r.iterations.len() as u32),
        step1_cost: step1.map(|s| s.cost),
        step2_cost: fit.map(|f| f.cost),
        step2_evaluations: fit.map(|f| f.evaluations),
        verification_cost: record.and_then(|r| r.verification_cost),
        values: record.map(values).unwrap_or_default(),
    }
}

fn values(record: &PatientRecord) -> BTreeMap<TableKind, BTreeMap<String, f64>> {
    let mut all = BTreeMap::new();
    // The best iterate is not a result before step 1 is over.
    if let Some(step1) = &record.step1 {
        let parameters = Step1Parameter::KEYS
            .iter()
            .map(|name| (*name).to_owned())
            .zip(step1.parameters.updated());
        all.insert(TableKind::Step1Parameters, parameters.collect());
        if let Some(simulated) = PatientView(record).simulated(Step::Step1) {
            all.insert(TableKind::Step1Biomarkers, biomarkers(simulated));
        }
    }
    if let Some(fit) = &record.cell_fit {
        let fitted = fit
            .result
            .parameters
            .iter()
            .map(|p| (p.name.clone(), p.value));
        all.insert(TableKind::Step2Parameters, fitted.collect());
    }
    if let Some(beat) = &record.verification {
        all.insert(
            TableKind::Step2Biomarkers,
            biomarkers(&beat.result.biomarkers),
        );
    }
    all
}

fn biomarkers(values: &Biomarkers) -> BTreeMap<String, f64> {
    BIOMARKERS
        .into_iter()
        .filter_map(|b| Some((b.key().to_owned(), values.get(b)?)))
        .collect()
}

/// Names of a table's quantities in their order.
pub fn names(table: TableKind, plan: &ResolvedPatient) -> Vec<String> {
    match table {
        TableKind::Step1Parameters => Step1Parameter::KEYS.map(str::to_owned).to_vec(),
        TableKind::Step2Parameters => plan.settings.step2.fitted(),
        TableKind::Step1Biomarkers | TableKind::Step2Biomarkers => {
            BIOMARKERS.iter().map(|b| b.key().to_owned()).collect()
        }
    }
}
