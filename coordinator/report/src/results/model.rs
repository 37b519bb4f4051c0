//! The model behind a patient's results, in words.

use cardiotwin_schemas::finite_element::ElementKind;
use cardiotwin_schemas::muscle::MuscleLaw;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::{CalciumSource, Fidelity};

use super::discovery::words::UNCONFIRMED;

/// The model behind a patient's results.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Model {
    /// Organ that was simulated, with its elements.
    pub organ: String,
    /// Law of the relaxed wall.
    pub passive_law: &'static str,
    /// Contraction model of step 1.
    pub contraction_step1: &'static str,
    /// Contraction model of step 2.
    pub contraction_step2: &'static str,
    /// Names of the accepted effects, separated by commas; empty for none.
    pub effects: String,
    /// Number of the mesh's nodes; `None` for an organ without a mesh or before step 0.
    pub nodes: Option<u64>,
}

impl Model {
    /// The model of a patient's settings and of its mesh.
    #[must_use]
    pub fn of(patient: &PatientRecord) -> Self {
        let settings = &patient.plan.settings;
        let solver = &settings.solver;
        let (organ, passive_law) = match solver.fidelity {
            Fidelity::Reduced => (
                format!(
                    "one-fibre ventricle of {} activation groups",
                    solver.activation.groups
                ),
                "one-fibre exponential",
            ),
            Fidelity::FiniteElement => (
                format!(
                    "3D finite-element ventricle of {} tetrahedra",
                    match solver.finite_element.element {
                        ElementKind::LinearNodal => "linear",
                        ElementKind::LinearPointwise => "linear pointwise",
                        ElementKind::QuadraticNodal => "quadratic",
                    }
                ),
                match solver.finite_element.wall.muscle_law {
                    MuscleLaw::Guccione => "Guccione",
                    MuscleLaw::HolzapfelOgden => "Holzapfel-Ogden",
                    MuscleLaw::NeoHookean => "neo-Hookean",
                },
            ),
            Fidelity::External => ("external solver".to_owned(), "of the external solver"),
        };
        let nodes = patient
            .step0
            .as_ref()
            .and_then(|step0| match &step0.result.organ {
                OrganSpec::FiniteElement(organ) => Some(organ.figures.nodes),
                OrganSpec::Reduced { .. } | OrganSpec::External(_) => None,
            });
        let effects: Vec<String> = patient
            .plan
            .effects
            .iter()
            .map(|effect| effect.name.replace('_', " "))
            .collect();
        Self {
            organ,
            passive_law,
            contraction_step1: "Tanh",
            contraction_step2: match settings.step2.calcium {
                CalciumSource::Rice => "Land 2017 with Rice's calcium",
                CalciumSource::MedianTrace => "Land 2017 with a given calcium trace",
            },
            effects: match (effects.is_empty(), patient.plan.is_unconfirmed) {
                (false, true) => format!("{}{UNCONFIRMED}", effects.join(", ")),
                _ => effects.join(", "),
            },
            nodes,
        }
    }

    /// The model in one line, without the number of nodes.
    #[must_use]
    pub fn words(&self) -> String {
        let Self {
            organ,
            passive_law,
            contraction_step1,
            contraction_step2,
            effects,
            ..
        } = self;
        let effects = if effects.is_empty() { "none" } else { effects };
        format!(
            "{organ}; passive law {passive_law}; contraction {contraction_step1} in step 1, {contraction_step2} in step 2; effects: {effects}"
        )
    }
}

/// Models of a cohort in words, each with the patients that have it, the commonest first.
#[must_use]
pub fn models(patients: &[PatientRecord]) -> Vec<(String, Vec<&PatientRecord>)> {
    let mut found: Vec<(String, Vec<&PatientRecord>)> = Vec::new();
    for patient in patients {
        let words = Model::of(patient).words();
        match found.iter_mut().find(|(known, _)| *known == words) {
            Some((_, of)) => of.push(patient),
            None => found.push((words, vec![patient])),
        }
    }
    found.sort_by_key(|(_, of)| std::cmp::Reverse(of.len()));
    found
}

/// Least and largest number of nodes of the patients' meshes.
#[must_use]
pub fn nodes(patients: &[&PatientRecord]) -> Option<(u64, u64)> {
    let all = || patients.iter().filter_map(|p| Model::of(p).nodes);
    Some((all().min()?, all().max()?))
}
