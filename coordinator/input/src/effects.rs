//! Checks of the effects that `model.toml` accepts for a patient: whether the catalogue has them,
//! and whether they can act in the ventricle that the settings choose.

use std::path::Path;

use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_mesh::tet_mesh::TetMesh;
use cardiotwin_models::effects::{EffectError, EffectSetting, InThreeDimensions, Kind};
use cardiotwin_schemas::muscle::MuscleLaw;
use cardiotwin_schemas::organ::EffectSpec;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_schemas::settings::{Fidelity, SolverSettings};
use cardiotwin_signals::Problem;

use super::document::Document;
use super::layers::position_of;
use super::report::Report;

/// Accepted effects with the file that lists them.
pub struct Accepted<'a> {
    /// Content of the file.
    pub overlay: &'a ModelOverlay,
    /// The file `model.toml`.
    pub document: &'a Document,
}

impl Accepted<'_> {
    /// Reports effects and corrections that the catalogue does not have, and effects that cannot act
    /// in the chosen ventricle.
    pub fn check(&self, patient: &str, solver: &SolverSettings, report: &mut Report) {
        let in_3d = solver.fidelity == Fidelity::FiniteElement;
        self.list("effects", Kind::Physiology, patient, report, |setting| {
            in_3d.then(|| refusal(setting, solver)).flatten()
        });
        self.list("corrections", Kind::Artefact, patient, report, |_| None);
    }

    /// Reports effects that need a part of the anatomy which the patient's own mesh does not mark.
    pub fn check_on_mesh(&self, patient: &str, mesh: &TetMesh, report: &mut Report) {
        let has_septum = Landmarks::of(mesh).is_some_and(|of| of.towards_septum(mesh).is_some());
        if has_septum {
            return;
        }
        for spec in &self.overlay.effects {
            let Ok(setting) = EffectSetting::named(&spec.name, &spec.parameters) else {
                continue;
            };
            if let InThreeDimensions::ActivationMap { .. } = setting.effect.in_3d
                && !setting.is_off()
            {
                let why = "it delays the side opposite the septum, and the patient's mesh has neither a surface `septum` nor a \
                           right ventricle: `cardiotwin mesh repair --septum x,y,z` marks the septum";
                self.add("effects", patient, &not_in_3d(&setting, why), report);
            }
        }
    }

    fn list(
        &self,
        key: &str,
        kind: Kind,
        patient: &str,
        report: &mut Report,
        refused: impl Fn(&EffectSetting) -> Option<EffectError>,
    ) {
        let specs: &[EffectSpec] = match kind {
            Kind::Physiology => &self.overlay.effects,
            Kind::Artefact => &self.overlay.corrections,
        };
        for (k, spec) in specs.iter().enumerate() {
            let setting = EffectSetting::named(&spec.name, &spec.parameters);
            let is_twice = specs[..k].iter().any(|other| other.name == spec.name);
            let error = match (setting, kind) {
                (Err(error), _) => Some(error),
                (Ok(setting), _) if is_twice => Some(EffectError::Twice {
                    effect: setting.effect.name,
                }),
                (Ok(setting), Kind::Physiology) => setting
                    .require_physiology()
                    .err()
                    .or_else(|| refused(&setting).filter(|_| !setting.is_off())),
                (Ok(setting), Kind::Artefact) => {
                    (setting.effect.kind != kind).then_some(EffectError::NoArtefact {
                        effect: setting.effect.name,
                    })
                }
            };
            if let Some(error) = error {
                self.add(key, patient, &error, report);
            }
        }
    }

    fn add(&self, key: &str, patient: &str, error: &EffectError, report: &mut Report) {
        let file: &Path = &self.document.file;
        let problem = Problem::error(
            file,
            error.to_string(),
            "effects that can act in this patient's model",
            "correct or remove the effect, or undo the acceptance with `cardiotwin discover --revert`",
        );
        let at = position_of(self.document, key);
        report.add(Some(patient), problem.at_key(key).at(at));
    }
}

/// Reason why one of the effects cannot act in the finite-element ventricle of these settings, if any.
#[must_use]
pub fn cannot_act_in_3d(effects: &[EffectSpec], solver: &SolverSettings) -> Option<String> {
    effects.iter().find_map(|spec| {
        match EffectSetting::named(&spec.name, &spec.parameters) {
            Err(error) => Some(error),
            Ok(setting) => refusal(&setting, solver).filter(|_| !setting.is_off()),
        }
        .map(|error| error.to_string())
    })
}

fn refusal(setting: &EffectSetting, solver: &SolverSettings) -> Option<EffectError> {
    let why = match setting.effect.in_3d {
        InThreeDimensions::Cannot { why } => why,
        InThreeDimensions::PassiveExponents { .. }
            if solver.finite_element.wall.muscle_law == MuscleLaw::NeoHookean =>
        {
            "it multiplies exponents, and the neo-Hookean muscle has none: set solver.finite_element.wall.muscle_law to \
             \"guccione\" or \"holzapfel-ogden\""
        }
        _ => return None,
    };
    Some(not_in_3d(setting, why))
}

fn not_in_3d(setting: &EffectSetting, why: &'static str) -> EffectError {
    EffectError::NotInThreeDimensions {
        effect: setting.effect.name,
        why,
    }
}

#[cfg(test)]
mod tests {
    use crate::Options;
    use crate::tests::{COHORT, Folder, PATIENT, only};

    const IN_3D: &str = "[solver]\nfidelity = \"finite-element\"\n";
    const NO_EXPONENTS: &str = "[solver.finite_element.wall]\nmuscle_law = \"neo-hookean\"\n";

    /// Problems of a patient for whom a list of effects is accepted.
    fn said(settings: &str, lists: &str) -> Vec<String> {
        let folder = Folder::new(&format!("{COHORT}{settings}"), &[("P1", PATIENT)]);
        let text = format!(
            "version = 1\npatient = \"P1\"\nwritten = \"2026-01-01T00:00:00.000Z\"\n[from]\n{lists}"
        );
        let path = folder.path().join("patients/P1/model.toml");
        std::fs::write(path, text).unwrap();
        let unaccepted = Options {
            unaccepted: true,
            ..Options::default()
        };
        assert_eq!(folder.load(&unaccepted).1, Vec::<String>::new());
        folder.load(&Options::default()).1
    }

    fn listed(key: &str, name: &str, parameters: &str) -> String {
        format!("[[{key}]]\nname = \"{name}\"\nparameters = {{ {parameters} }}\n")
    }

    #[test]
    fn what_the_catalogue_does_not_have_is_refused_with_its_place() {
        let kick = listed("effects", "atrial_kick", "amplitude_mmHg = 8.0");
        assert_eq!(said("", &kick), Vec::<String>::new());
        let wrong = [
            (
                listed("effects", "atrial_flutter", "rate = 2.0"),
                "atrial_flutter",
            ),
            (
                listed("effects", "atrial_kick", "lead_ms = 140.0"),
                "needs its strength",
            ),
            (
                listed("effects", "atrial_kick", "amplitude_mmHg = 90.0"),
                "between 0 and 25",
            ),
            (
                listed("effects", "pressure_offset", "offset_mmHg = 5.0"),
                "artefact of the measurement",
            ),
            (
                listed("corrections", "atrial_kick", "amplitude_mmHg = 8.0"),
                "effect of the heart",
            ),
            (format!("{kick}{kick}"), "listed twice"),
        ];
        for (lists, found) in wrong {
            only(
                &said("", &lists),
                &["model.toml:5", found, "discover --revert"],
            );
        }
    }

    #[test]
    fn what_cannot_act_in_3d_is_refused_where_the_ventricle_is_3d() {
        let stiff = listed("effects", "passive_stiffening", "exponent_factor = 3.0");
        let plain = listed("effects", "passive_stiffening", "exponent_factor = 1.0");
        assert_eq!(said(IN_3D, &stiff), Vec::<String>::new());
        let in_3d = format!("{IN_3D}{NO_EXPONENTS}");
        only(
            &said(&in_3d, &stiff),
            &[
                "model.toml:5",
                "passive_stiffening cannot act in a finite-element ventricle",
                "neo-Hookean muscle has none",
            ],
        );
        assert_eq!(said(&in_3d, &plain), Vec::<String>::new());
        let reduced = format!("[solver]\nfidelity = \"reduced\"\n{NO_EXPONENTS}");
        assert_eq!(said(&reduced, &stiff), Vec::<String>::new());
    }
}
