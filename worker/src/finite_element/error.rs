//! Errors of the finite-element ventricle.

use std::path::PathBuf;

use cardiotwin_electrophysiology::ElectrophysiologyError;
use cardiotwin_mechanics::organ::{AnatomyError, Farthest, PassiveStateError};
use cardiotwin_mesh::eikonal::EikonalError;
use cardiotwin_mesh::ellipsoid::EllipsoidError;
use cardiotwin_mesh::laplace::LaplaceError;
use cardiotwin_mesh::quality::mean_ratio;
use cardiotwin_mesh::tet_mesh::TetMesh;
use cardiotwin_schemas::failure::FailureClass;

use super::arrays::ArraysError;

/// Reasons why a finite-element ventricle could not be made or read.
#[derive(Debug, thiserror::Error)]
pub enum FiniteElementError {
    /// No mesh could be generated.
    #[error("cannot generate the mesh")]
    Mesh(#[from] EllipsoidError),
    /// The patient's own mesh is not usable.
    #[error("the patient's mesh: {found}")]
    OwnMesh {
        /// Description of the problem, with the remedy.
        found: String,
    },
    /// The fibres could not be computed.
    #[error("cannot compute the fibres")]
    Fibres(#[from] LaplaceError),
    /// The activation times could not be computed.
    #[error("cannot compute the activation")]
    Activation(#[from] EikonalError),
    /// The extracellular potentials could not be computed.
    #[error("cannot compute the transmembrane potentials")]
    Potentials(#[source] ElectrophysiologyError),
    /// The mesh has no usable anatomy.
    #[error("cannot determine the anatomy")]
    Anatomy(#[from] AnatomyError),
    /// The stiffness or the unloaded geometry could not be found.
    #[error("cannot determine the passive state of the finite-element ventricle")]
    PassiveState(#[from] PassiveStateError),
    /// The search for the passive state was given up.
    #[error(
        "step 0 found no passive state within its bound of work; {}the mesh's flattest tetrahedron, at ({:.1}, {:.1}, {:.1}) mm, has \
         a mean ratio of {mean_ratio:.3} (1 is regular, 0 is flat)", missed(source), at_mm[0], at_mm[1], at_mm[2]
    )]
    TooMuchWork {
        /// Smallest mean ratio of an element.
        mean_ratio: f64,
        /// Centroid of this element.
        at_mm: [f64; 3],
        /// Work of the search and its last failure.
        source: Box<PassiveStateError>,
    },
    /// A file of a ventricle is not usable.
    #[error("cannot use {file}")]
    File {
        /// Path of the file.
        file: PathBuf,
        /// Problem with its content.
        source: ArraysError,
    },
    /// A stored ventricle lacks an effect of the patient.
    #[error(
        "the ventricle was made with an exponent factor of {found}, but the patient's effects need {expected}"
    )]
    Exponents {
        /// Factor in the file.
        found: f64,
        /// Factor of the effects.
        expected: f64,
    },
    /// A stiffness of Guccione's law is given, but the muscle has another law.
    #[error(
        "passive.guccione_C_kPa is given, but solver.finite_element.wall.muscle_law is {law}, expected Guccione"
    )]
    StiffnessOfAnotherLaw {
        /// Name of the law that the muscle has.
        law: &'static str,
    },
    /// Springs are given for a surface that the mesh does not have.
    #[error("solver.finite_element.wall.surface.{name}: the mesh has no surface of this name, expected one of {}", found.join(", "))]
    SprungSurface {
        /// Name of the surface.
        name: String,
        /// Names of the mesh's surfaces.
        found: Vec<String>,
    },
    /// The right ventricle cannot be loaded together with the left one.
    #[error(
        "the right ventricle has {right_mmhg:.2} mmHg at end-diastole, but the left one {left_mmhg:.2}, expected an end-diastolic \
         pressure above zero: step 0 raises both together"
    )]
    RightPressure {
        /// End-diastolic pressure of the left ventricle.
        left_mmhg: f64,
        /// Pressure of the right ventricle at the same time.
        right_mmhg: f64,
    },
    /// A passive law is given for a tag that no passive tissue of the mesh has.
    #[error(
        "solver.finite_element.wall.passive.{tag}: the mesh has no passive tissue with this tag, expected one of {}",
        listed(passive)
    )]
    PassiveTag {
        /// Tag for which the passive law is given.
        tag: i32,
        /// Tags of the mesh's passive tissue.
        passive: Vec<i32>,
    },
}

/// The place in the image that a search missed most, in words.
fn missed(error: &PassiveStateError) -> String {
    let PassiveStateError::TooMuchWork {
        farthest: Some(farthest),
        ..
    } = error
    else {
        return String::new();
    };
    let Farthest {
        distance_mm,
        at_mm: [x, y, z],
    } = **farthest;
    format!(
        "the unloaded wall misses the image most at ({x:.1}, {y:.1}, {z:.1}) mm, by {distance_mm:.2} mm; "
    )
}

fn listed(tags: &[i32]) -> String {
    if tags.is_empty() {
        return "none: all of it contracts".to_owned();
    }
    tags.iter()
        .map(i32::to_string)
        .collect::<Vec<_>>()
        .join(", ")
}

impl FiniteElementError {
    /// A search on `mesh` that was given up.
    pub(crate) fn too_much_work(mesh: &TetMesh, source: PassiveStateError) -> Self {
        let ratio = |e: &usize| mean_ratio(mesh.corners(*e));
        let flattest = (0..mesh.n_tets()).min_by(|a, b| ratio(a).total_cmp(&ratio(b)));
        Self::TooMuchWork {
            mean_ratio: flattest.as_ref().map_or(f64::NAN, ratio),
            at_mm: flattest.map_or([f64::NAN; 3], |e| mesh.centroid_mm(e)),
            source: Box::new(source),
        }
    }

    /// Failure class of the error.
    #[must_use]
    pub fn class(&self) -> FailureClass {
        match self {
            Self::Mesh(_)
            | Self::OwnMesh { .. }
            | Self::StiffnessOfAnotherLaw { .. }
            | Self::PassiveTag { .. }
            | Self::SprungSurface { .. }
            | Self::RightPressure { .. }
            | Self::PassiveState(PassiveStateError::NoExponents { .. }) => FailureClass::Input,
            // If a volume could not be computed, the patient's data are not at fault.
            Self::PassiveState(PassiveStateError::NoStiffness {
                at_low_ml,
                at_high_ml,
                ..
            }) if at_low_ml.is_finite() && at_high_ml.is_finite() => FailureClass::Input,
            Self::Fibres(_)
            | Self::Activation(_)
            | Self::Potentials(_)
            | Self::Anatomy(_)
            | Self::PassiveState(_)
            | Self::TooMuchWork { .. } => FailureClass::Numerics,
            Self::File { .. } => FailureClass::Site,
            Self::Exponents { .. } => FailureClass::Bug,
        }
    }

    /// Advice on how to correct the error.
    #[must_use]
    pub fn remedy(&self) -> Option<&'static str> {
        match self {
            Self::Mesh(_) => Some(
                "use more nodes (solver.finite_element.mesh_nodes), or correct wall and cavity volume",
            ),
            Self::PassiveState(PassiveStateError::NoStiffness { .. }) => Some(
                "correct the volumes and pressures of diastasis and end-diastole, or give passive.guccione_C_kPa",
            ),
            Self::PassiveState(PassiveStateError::NoExponents { .. }) => Some(
                "set solver.finite_element.wall.muscle_law to \"guccione\" or \"holzapfel-ogden\"",
            ),
            Self::StiffnessOfAnotherLaw { .. } => {
                Some("leave passive.guccione_C_kPa away: step 0 fits the stiffness of any law")
            }
            Self::PassiveTag { .. } => Some("correct the tag, or leave the entry away"),
            Self::SprungSurface { .. } => Some("correct the name, or leave the entry away"),
            Self::RightPressure { .. } => Some(
                "correct measured.end_diastolic_pressure_mmHg, or the pressure of anatomy.mesh.right_ventricle",
            ),
            Self::PassiveState(_) => Some("use another mesh size, or give passive.guccione_C_kPa"),
            Self::TooMuchWork { .. } => Some(
                "make thin tissue of valves and aortic root passive (`cardiotwin mesh repair --passive-above`), remesh a mesh with flat tetrahedra (`cardiotwin mesh remesh`), correct wall, volumes and pressures, or give passive.guccione_C_kPa",
            ),
            Self::OwnMesh { .. } => Some(
                "mend the mesh or [anatomy.mesh] of patient.toml; `cardiotwin check` tells what is missing",
            ),
            Self::File { .. } => Some("run step 0 again: `cardiotwin rerun PATIENT --from step0`"),
            Self::Potentials(_) => {
                Some("set solver.finite_element.ep = \"eikonal\": nothing else needs potentials")
            }
            Self::Fibres(_) | Self::Activation(_) | Self::Anatomy(_) | Self::Exponents { .. } => {
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_volumes_that_were_found_blame_the_patients_data() {
        let class = |at_high_ml| {
            let error = PassiveStateError::NoStiffness {
                low_kpa: 0.1,
                high_kpa: 10.0,
                wanted_ml: 80.0,
                at_low_ml: 60.0,
                at_high_ml,
            };
            FiniteElementError::PassiveState(error).class()
        };
        assert_eq!(
            (class(70.0), class(f64::NAN)),
            (FailureClass::Input, FailureClass::Numerics)
        );
    }

    #[test]
    fn a_search_without_end_names_the_flattest_tetrahedron() {
        let mesh = TetMesh {
            nodes_mm: vec![
                [0.0; 3],
                [4.0, 0.0, 0.0],
                [0.0, 4.0, 0.0],
                [0.0, 0.0, 4.0],
                [0.0, 0.0, -0.04],
            ],
            tets: vec![[0, 1, 2, 3], [0, 2, 1, 4]],
            tags: vec![1, 1],
            ..TetMesh::default()
        };
        let error = FiniteElementError::too_much_work(&mesh, PassiveStateError::Stopped);
        assert_eq!(error.class(), FailureClass::Numerics);
        let text = error.to_string();
        assert!(
            text.contains("(1.0, 1.0, -0.0) mm") && text.contains("mean ratio of 0.0"),
            "{text}"
        );
        assert!(
            error
                .remedy()
                .is_some_and(|remedy| remedy.contains("mesh remesh"))
        );
    }
}
