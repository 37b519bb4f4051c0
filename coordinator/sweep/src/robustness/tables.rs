//! Tables 3 to 10 of a sweep: spread of the results over samples, and over seeds alone.

use std::collections::HashMap;

use cardiotwin_calibrate::fixed_point::driver;
use cardiotwin_calibrate::robustness::{self as statistics, Spread};
use cardiotwin_report::results::PatientView;
use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::robustness::{
    Amplification, MemberRole, Moments, PaperSpread, PatientRobustness, QuantitySpread,
    RobustnessMember, RobustnessResult, RobustnessSpec, RobustnessTable, TableKind, TargetError,
    Uncertainty,
};
use cardiotwin_schemas::step1::Step1Parameter;

use super::conditions;
use super::design::{DesignError, Member, STEP2_PREFIX, guess_centres, members, original_of};
use super::paper::PAPER;
use super::values::{names, summary};

/// Name of the input that stands for all inputs together.
const ALL_INPUTS: &str = "all inputs";

/// Results of a sweep from the current record of its run.
///
/// - `patients`: plans of the cohort's patients, some of which the specification names
/// - `record`: record of the sweep's run
///
/// # Errors
/// [`DesignError`] if the members cannot be made from the plans.
pub fn result(
    spec: &RobustnessSpec,
    patients: &[ResolvedPatient],
    record: &RunRecord,
) -> Result<RobustnessResult, DesignError> {
    let records: HashMap<&PatientId, &PatientRecord> =
        record.patients.iter().map(|p| (&p.plan.id, p)).collect();
    let named = spec
        .patients
        .iter()
        .filter_map(|id| patients.iter().find(|p| p.id == *id));
    let patients = named.map(|plan| {
        let members = members(plan, spec)?;
        Ok(of_patient(spec, plan, &members, &records))
    });
    Ok(RobustnessResult {
        schema_version: formats::ROBUSTNESS.version,
        version: record.version.clone(),
        cohort: record.cohort.clone(),
        spec: spec.clone(),
        patients: patients.collect::<Result<_, _>>()?,
    })
}

/// Plans of the sweep's patients from the record of its run. Each original has the plan of its
/// patient under another id.
#[must_use]
pub fn patients(spec: &RobustnessSpec, record: &RunRecord) -> Vec<ResolvedPatient> {
    let original = |id: &PatientId| {
        let name = original_of(id);
        let found = record.patients.iter().find(|p| p.plan.id == name)?;
        Some(ResolvedPatient {
            id: id.clone(),
            ..found.plan.clone()
        })
    };
    spec.patients.iter().filter_map(original).collect()
}

fn of_patient(
    spec: &RobustnessSpec,
    plan: &ResolvedPatient,
    members: &[Member],
    records: &HashMap<&PatientId, &PatientRecord>,
) -> PatientRobustness {
    let summaries = members
        .iter()
        .map(|m| summary(m, records.get(&m.plan.id).copied()))
        .collect();
    let original = members
        .first()
        .and_then(|m| records.get(&m.plan.id).copied());
    of_members(
        spec,
        plan,
        summaries,
        original.map(|record| *PatientView(record).measured()),
    )
}

/// Data of one patient from which the tables are made.
struct Known<'a> {
    spec: &'a RobustnessSpec,
    patient: &'a PatientId,
    members: Vec<RobustnessMember>,
    measured: Option<Biomarkers>,
    inputs: Vec<QuantitySpread>,
}

/// Tables of one patient.
///
/// - `members`: the members, the original first
/// - `measured`: measured values of the original; `None` before its step 0 is done
pub(super) fn of_members(
    spec: &RobustnessSpec,
    plan: &ResolvedPatient,
    members: Vec<RobustnessMember>,
    measured: Option<Biomarkers>,
) -> PatientRobustness {
    let mut known = Known {
        spec,
        patient: &plan.id,
        members,
        measured,
        inputs: Vec::new(),
    };
    known.inputs = known.input_spreads(plan);
    let tables = known.tables(MemberRole::Sample, plan);
    let seed_tables = known.tables(MemberRole::Seed, plan);
    let target_errors = known.target_errors();
    let conditions = conditions::of(spec.over, &tables, &target_errors, &known.members);
    PatientRobustness {
        patient: plan.id.clone(),
        inputs: known.inputs,
        tables,
        seed_tables,
        target_errors,
        conditions,
        members: known.members,
    }
}

impl Known<'_> {
    fn of_role(&self, role: MemberRole) -> impl Iterator<Item = &RobustnessMember> {
        self.members.iter().filter(move |m| m.role == role)
    }

    fn original_value(&self, table: TableKind, name: &str) -> Option<f64> {
        value(self.members.first()?, table, name)
    }

    /// Measured value of a perturbed biomarker; `None` before the original's step 0 is done.
    fn measured(&self, name: &str) -> Option<f64> {
        self.measured?.get(Biomarker::named(name)?)
    }

    /// Spread of the varied inputs over the samples whose step 1 is over.
    fn input_spreads(&self, plan: &ResolvedPatient) -> Vec<QuantitySpread> {
        let samples: Vec<&RobustnessMember> = self.of_role(MemberRole::Sample).collect();
        let Some(first) = samples.first() else {
            return Vec::new();
        };
        let centres = centres(self.spec.over, plan, first);
        let spreads = centres.into_iter().filter_map(|(name, centre)| {
            // A perturbed biomarker is given in its own unit if its measured value is known.
            let scale = match self.spec.over {
                Uncertainty::Data => self.measured(&name).unwrap_or(1.0),
                Uncertainty::Guess => 1.0,
            };
            let over = |m: &&&RobustnessMember| m.values.contains_key(&TableKind::Step1Parameters);
            let values: Vec<f64> = samples
                .iter()
                .filter(over)
                .filter_map(|m| Some(scale * m.inputs.get(&name)?))
                .collect();
            spread(name, scale * centre, &values)
        });
        spreads.collect()
    }

    fn tables(&self, role: MemberRole, plan: &ResolvedPatient) -> Vec<RobustnessTable> {
        // Step 1 does not depend on step 2's seed.
        let of_role = TableKind::ALL.into_iter().filter(|t| {
            role != MemberRole::Seed
                || matches!(t, TableKind::Step2Parameters | TableKind::Step2Biomarkers)
        });
        let tables = of_role.filter_map(|table| {
            let quantities = names(table, plan).into_iter().filter_map(|name| {
                let of = |m: &RobustnessMember| value(m, table, &name).unwrap_or(f64::NAN);
                let values: Vec<f64> = self.of_role(role).map(of).collect();
                let mut found = spread(name.clone(), self.original_value(table, &name)?, &values)?;
                if role == MemberRole::Sample {
                    found.amplification = self.amplification(table, &found);
                    found.paper = self.printed(table, &name);
                }
                Some(found)
            });
            let quantities: Vec<QuantitySpread> = quantities.collect();
            let paper_table = table.paper(self.spec.over);
            (!quantities.is_empty()).then_some(RobustnessTable {
                table,
                paper_table,
                quantities,
            })
        });
        tables.collect()
    }

    fn printed(&self, table: TableKind, name: &str) -> Option<PaperSpread> {
        let own = PAPER.patient == self.patient.as_str();
        own.then(|| PAPER.column(table.paper(self.spec.over), name).cloned())
            .flatten()
    }

    /// Spread of a quantity divided by the spread of the corresponding input, or by the spread of
    /// all inputs if none corresponds.
    fn amplification(&self, table: TableKind, found: &QuantitySpread) -> Option<Amplification> {
        let partner = partner(self.spec.over, table, &found.name);
        let own = partner.and_then(|name| self.inputs.iter().find(|i| i.name == name));
        let (input, input_spread) = match own {
            Some(input) => (input.name.clone(), input.spread?),
            None => (
                ALL_INPUTS.to_owned(),
                root_mean_square(self.inputs.iter().filter_map(|i| i.spread))?,
            ),
        };
        let ratio = found.spread? / input_spread;
        ratio.is_finite().then_some(Amplification {
            input,
            input_spread,
            ratio,
        })
    }

    /// Errors of fitted biomarkers to perturbed and to measured values.
    fn target_errors(&self) -> Vec<TargetError> {
        if self.spec.over != Uncertainty::Data {
            return Vec::new();
        }
        let tables = [TableKind::Step1Biomarkers, TableKind::Step2Biomarkers];
        let errors = tables.into_iter().flat_map(|table| {
            Biomarker::COST_KEYS.into_iter().filter_map(move |name| {
                let measured = self.measured(name)?;
                let original =
                    statistics::relative_error(self.original_value(table, name)?, measured);
                let pairs: Vec<(&RobustnessMember, (f64, f64))> = self
                    .of_role(MemberRole::Sample)
                    .filter_map(|m| {
                        Some((m, (value(m, table, name)?, measured * m.inputs.get(name)?)))
                    })
                    .collect();
                let limit = original + conditions::ALLOWANCE;
                let misses = |value, target| statistics::relative_error(value, target) > limit;
                let beyond = pairs
                    .iter()
                    .filter(|(_, (value, target))| misses(*value, *target));
                let beyond = beyond.map(|(member, _)| member.id.clone()).collect();
                let (values, targets): (Vec<f64>, Vec<f64>) =
                    pairs.into_iter().map(|pair| pair.1).unzip();
                let to_measured =
                    statistics::errors_to_targets(&values, &vec![measured; values.len()])?;
                Some(TargetError {
                    table,
                    biomarker: name.to_owned(),
                    original,
                    to_perturbed: moments(statistics::errors_to_targets(&values, &targets)?),
                    to_measured: moments(to_measured),
                    beyond,
                })
            })
        });
        errors.collect()
    }
}

fn value(member: &RobustnessMember, table: TableKind, name: &str) -> Option<f64> {
    member
        .values
        .get(&table)?
        .get(name)
        .copied()
        .filter(|v| v.is_finite())
}

/// Values around which the inputs of the samples lie, in the tables' order.
fn centres(
    over: Uncertainty,
    plan: &ResolvedPatient,
    sample: &RobustnessMember,
) -> Vec<(String, f64)> {
    match over {
        Uncertainty::Data => {
            let given = Biomarker::COST_KEYS
                .into_iter()
                .filter(|name| sample.inputs.contains_key(*name));
            given.map(|name| (name.to_owned(), 1.0)).collect()
        }
        // The samples exist, so that the guesses around which they lie exist, too.
        Uncertainty::Guess => guess_centres(plan).unwrap_or_default(),
    }
}

/// The input on which a result depends most directly. The fixed point updates each parameter by one
/// biomarker.
fn partner(over: Uncertainty, table: TableKind, name: &str) -> Option<String> {
    match (over, table) {
        (Uncertainty::Data, TableKind::Step1Parameters) => {
            Step1Parameter::named(name).map(|parameter| driver(parameter).0.key().to_owned())
        }
        (Uncertainty::Data, _) => Some(name.to_owned()),
        (Uncertainty::Guess, TableKind::Step1Parameters) => Some(name.to_owned()),
        (Uncertainty::Guess, TableKind::Step2Parameters) => Some(format!("{STEP2_PREFIX}{name}")),
        (Uncertainty::Guess, TableKind::Step1Biomarkers | TableKind::Step2Biomarkers) => None,
    }
}

fn spread(name: String, original: f64, values: &[f64]) -> Option<QuantitySpread> {
    let found = Spread::of(original, values)?;
    Some(QuantitySpread {
        name,
        original,
        n: found.n_samples as u32,
        n_missing: found.n_missing as u32,
        values: moments(found.values),
        relative_differences: found.relative_differences.map(moments),
        spread: found.relative_spread,
        amplification: None,
        paper: None,
    })
}

fn moments(found: Moments) -> Moments {
    Moments {
        // The standard deviation of equal values is the rounding error of their mean, which stands
        // for zero.
        standard_deviation: found.standard_deviation.map(|sd| {
            if sd < 1e-14 * found.mean.abs() {
                0.0
            } else {
                sd
            }
        }),
        ..found
    }
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let squares: Vec<f64> = values.map(|v| v * v).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
