//! Values of keys that earlier programs did not write.
//!
//! A program stores all settings of a plan and of a specification, so a key is absent only if the program did not know it.
//! The defaults of today would then describe a model that the old run never computed. The tables below hold the values that
//! match the old program.

use std::cell::RefCell;
use std::sync::OnceLock;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use serde_json::{Map, Value, json};

use crate::finite_element::AnatomySpec;
use crate::formats::keep_known;
use crate::settings::Settings;
use crate::shared::Shared;

/// Keys of the settings that every version has written.
const SETTINGS: [&str; 5] = ["solver", "step1", "step2", "verification", "executor"];

/// Keys of `solver` that every version has written.
const SOLVER: [&str; 8] = [
    "fidelity",
    "time_step_ms",
    "shortest_step_ms",
    "newton_iterations",
    "start",
    "activation",
    "finite_element",
    "beats",
];

/// Keys of a wall that every version has written.
const WALL: [&str; 13] = [
    "guccione_C_kPa",
    "b_f",
    "b_t",
    "b_fs",
    "kappa_kPa",
    "aorta_mu_kPa",
    "aorta_kappa_kPa",
    "density_g_per_mm3",
    "mass_damping_per_ms",
    "stiffness_damping_ms",
    "epicardial_spring_kPa_per_mm",
    "rim_spring_kPa_per_mm",
    "spectral_radius",
];

/// Adds settings of the time when the chain ended with the verification beat.
fn add_to_settings(settings: &mut Map<String, Value>) {
    if lacks(settings, &SETTINGS, "workflow") {
        settings.insert("workflow".into(), json!({ "until": "step2-verification" }));
        settings.insert("posterior".into(), json!({ "enabled": false }));
    }
    let Some(solver) = table(settings, "solver") else {
        return;
    };
    if lacks(solver, &SOLVER, "cell_stretch") {
        // The stretch of a cell was counted from its length at end-diastole.
        solver.insert("cell_stretch".into(), "end-diastole".into());
        solver.insert("slack_stretch".into(), 1.0.into());
    }
    if let Some(finite_element) = table(solver, "finite_element") {
        add_to_wall_beside_element(finite_element);
    }
}

/// Adds settings of the time when the wall had no pericardial dashpots, uniform supports and contraction, and active stress
/// along the fibre only.
fn add_to_wall_beside_element(holder: &mut Map<String, Value>) {
    let is_linear_nodal = holder.get("element").and_then(Value::as_str) == Some("linear-nodal");
    let Some(wall) = table(holder, "wall") else {
        return;
    };
    if !lacks(wall, &WALL, "active_convention") {
        return;
    }
    let meant = [
        ("muscle_law", json!("guccione")),
        ("active_convention", json!("per-squared-stretch")),
        ("cross_fibre_share", json!(0.0)),
        ("sheet_normal_share", json!(0.0)),
        ("epicardial_duration_share", json!(1.0)),
        ("epicardial_dashpot_kPa_ms_per_mm", json!(0.0)),
        ("epicardial_base_share", json!(1.0)),
        ("rim_dashpot_kPa_ms_per_mm", json!(0.0)),
    ];
    for (key, value) in meant {
        wall.insert(key.to_owned(), value);
    }
    if is_linear_nodal {
        wall.insert("pointwise_share".into(), 0.05.into());
    }
}

/// Whether a table is complete, as a program writes it, but lacks `key`.
fn lacks(table: &Map<String, Value>, always: &[&str], key: &str) -> bool {
    !table.contains_key(key) && always.iter().all(|always| table.contains_key(*always))
}

fn table<'a>(holder: &'a mut Map<String, Value>, key: &str) -> Option<&'a mut Map<String, Value>> {
    holder.get_mut(key).and_then(Value::as_object_mut)
}

thread_local! {
    /// Settings that were read last, as stored and as read. Thousands of patients of a cohort have
    /// the same ones.
    static LAST: RefCell<Option<(Box<RawValue>, Shared<Settings>)>> = const { RefCell::new(None) };
}

/// Reads stored settings. Keys of later programs are dropped.
pub(crate) fn settings<'de, D: Deserializer<'de>>(from: D) -> Result<Shared<Settings>, D::Error> {
    let stored = Box::<RawValue>::deserialize(from)?;
    let same = LAST.with_borrow(|last| {
        let (before, read) = last.as_ref()?;
        (before.get() == stored.get()).then(|| read.clone())
    });
    if let Some(read) = same {
        return Ok(read);
    }
    let value = serde_json::from_str(stored.get()).map_err(D::Error::custom)?;
    let read = Shared::from(meant_by(value).map_err(D::Error::custom)?);
    LAST.set(Some((stored, read.clone())));
    Ok(read)
}

fn meant_by(mut stored: Value) -> serde_json::Result<Settings> {
    static SCHEMA: OnceLock<Value> = OnceLock::new();
    let schema = SCHEMA.get_or_init(|| schemars::schema_for!(Settings).into());
    keep_known(&mut stored, schema);
    if let Some(table) = stored.as_object_mut() {
        add_to_settings(table);
    }
    Settings::deserialize(stored)
}

/// Reads the stored anatomy of step 0's finite-element ventricle. Keys of later programs are dropped.
pub(crate) fn anatomy<'de, D: Deserializer<'de>>(from: D) -> Result<Option<AnatomySpec>, D::Error> {
    static SCHEMA: OnceLock<Value> = OnceLock::new();
    let schema = SCHEMA.get_or_init(|| schemars::schema_for!(AnatomySpec).into());
    let mut stored = Value::deserialize(from)?;
    keep_known(&mut stored, schema);
    if let Some(table) = stored.as_object_mut() {
        add_to_wall_beside_element(table);
    }
    Option::<AnatomySpec>::deserialize(stored).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::PatientId;
    use crate::organ::StretchOrigin;
    use crate::outcome::{CellFitResult, TargetsResult};
    use crate::plan::{ResolvedPatient, Workflow};
    use crate::settings::{Fidelity, LastStep};
    use crate::task::{CellFitSpec, TaskSpec};

    /// Of step 2 as commit 531ec84 wrote it: it knew no stretch but the median trace's first.
    #[test]
    fn step_2_of_a_program_without_largest_stretches_is_read_with_stretch_1() {
        let biomarkers = json!({
            "Sa_max_kPa": 60.0, "dSadt_max_kPa_per_ms": 1.2, "STD30_ms": 180.0, "STD50_ms": 240.0, "STD90_ms": 330.0,
            "lambda_min": 0.85,
        });
        let targets = json!({ "lambda_0": 1.002, "targets": biomarkers, "n_nodes": 16, "has_calcium": false });
        let read: TargetsResult = serde_json::from_value(targets).unwrap();
        assert_eq!((read.lambda_0, read.lambda_max), (1.002, 1.0));
        let fit = json!({
            "parameters": [], "reached": biomarkers, "targets": biomarkers, "cost": 0.02, "cost_terms": {},
            "evaluations": 6000, "generations": 40, "converged": true, "unreachable_targets": [],
        });
        let read: CellFitResult = serde_json::from_value(fit).unwrap();
        assert_eq!(read.lambda_0, 1.0, "the verification beat began there");
        let spec = json!({
            "kind": "cell-fit", "cycle_length_ms": 800.0, "lambda_0": 1.002, "targets": biomarkers, "settings": {},
            "seed": 1, "fixed": {},
        });
        let TaskSpec::CellFit(read) = serde_json::from_value(spec).unwrap() else {
            panic!("another kind");
        };
        let CellFitSpec {
            lambda_0,
            lambda_max,
            ..
        } = *read;
        assert_eq!((lambda_0, lambda_max), (1.002, 1.0));
    }

    fn stored() -> Value {
        let mut plan = ResolvedPatient::without_data(PatientId("P".into()), Workflow::Personalise);
        plan.settings.solver.fidelity = Fidelity::FiniteElement;
        plan.step0 = plan.step0_spec();
        serde_json::to_value(plan).unwrap()
    }

    #[test]
    fn a_plan_of_today_is_read_as_it_was_written() {
        let plan: ResolvedPatient = serde_json::from_value(stored()).unwrap();
        assert_eq!(serde_json::to_value(plan).unwrap(), stored());
    }

    #[test]
    fn a_plan_of_an_earlier_program_says_what_that_program_did() {
        let mut plan = stored();
        let remove = |table: &mut Value, keys: &[&str]| {
            let table = table.as_object_mut().unwrap();
            keys.iter()
                .for_each(|key| assert!(table.remove(*key).is_some(), "{key}"));
        };
        let new_of_wall = [
            "muscle_law",
            "active_convention",
            "cross_fibre_share",
            "sheet_normal_share",
            "epicardial_duration_share",
            "epicardial_dashpot_kPa_ms_per_mm",
            "epicardial_base_share",
            "rim_dashpot_kPa_ms_per_mm",
            "holzapfel_ogden",
            "neo_hookean_mu_kPa",
        ];
        remove(&mut plan["settings"], &["workflow", "posterior", "step3"]);
        remove(
            &mut plan["settings"]["solver"],
            &["cell_stretch", "slack_stretch"],
        );
        remove(
            &mut plan["settings"]["solver"]["finite_element"]["wall"],
            &new_of_wall,
        );
        remove(&mut plan["step0"]["finite_element"]["wall"], &new_of_wall);
        let read: ResolvedPatient = serde_json::from_value(plan).unwrap();
        let settings = &read.settings;
        assert_eq!(settings.workflow.until, LastStep::Step2Verification);
        assert!(!settings.posterior.enabled);
        assert_eq!(settings.solver.cell_stretch, StretchOrigin::EndDiastole);
        for wall in [
            &settings.solver.finite_element.wall,
            &read.step0.finite_element.as_ref().unwrap().wall,
        ] {
            assert_eq!(wall.epicardial_dashpot_kpa_ms_per_mm, 0.0);
            assert_eq!(
                (wall.epicardial_base_share, wall.epicardial_duration_share),
                (1.0, 1.0)
            );
            assert_eq!(
                (wall.cross_fibre_share, wall.sheet_normal_share),
                (0.0, 0.0)
            );
            assert_eq!(wall.pointwise_share, Some(0.05));
        }
    }

    #[test]
    fn settings_of_a_later_program_are_read_without_what_is_new() {
        let mut plan = stored();
        plan["settings"]["solver"]["of_tomorrow"] = 1.into();
        plan["settings"]["tomorrow"] = json!({ "a": 1 });
        plan["settings"]["step1"]["bounds"]["Smax_ref_kPa"] = json!([1.0, 2.0]);
        let read: ResolvedPatient = serde_json::from_value(plan).unwrap();
        assert_eq!(read.settings.step1.bounds["Smax_ref_kPa"], [1.0, 2.0]);
    }
}
