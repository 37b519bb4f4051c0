//! The labels of a folder of cases, `labels.json`.

use crate::folder;
use crate::visibility::Visibility;
use cardiotwin_validation::{Case, PlannedCase};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The file `labels.json`, which is rewritten with each case.
pub struct Labels {
    path: PathBuf,
    all: Value,
}

impl Labels {
    /// Reads the labels of a folder, or starts with none.
    ///
    /// - `model`: name of the model that makes the cases
    pub fn open(folder: &Path, model: &str, seed: u64) -> Result<Self, String> {
        folder::open(
            folder,
            &format!("Cases with hidden effects, made by {model}"),
        )?;
        let path = folder.join("labels.json");
        let fresh = json!({
            "description": format!(
                "hidden effects of each case, made by {model}, seed {seed}; strength in multiples of the smallest meaningful \
                 one; visibility.delta_chi2: fall of the misfit on noise-free data when the right effects are added to the fitted \
                 model, in units of the case's own noise; left_chi2: what they leave"
            ),
            "cases": {}
        });
        let all: Value = match std::fs::read_to_string(&path) {
            Ok(text) => {
                serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?
            }
            Err(_) => fresh.clone(),
        };
        if all["description"] != fresh["description"] {
            return Err(format!(
                "{}: made by another model or seed; take another folder",
                path.display()
            ));
        }
        Ok(Self { path, all })
    }

    /// Whether a case has been entered.
    pub fn has(&self, id: &str) -> bool {
        self.all["cases"].get(id).is_some()
    }

    /// Whether a case has been entered without its visibility.
    pub fn lacks_visibility(&self, id: &str) -> bool {
        self.has(id) && self.all["cases"][id].get("visibility").is_none()
    }

    /// Enters a case and writes the file.
    pub fn add(&mut self, planned: &PlannedCase, case: &Case, off: bool) -> Result<(), String> {
        let named: Vec<Value> = if off {
            Vec::new()
        } else {
            case.hidden.iter().map(|h| json!(h)).collect()
        };
        let mut label = json!({ "effects": named, "noise": planned.noise, "seed": planned.seed() });
        if off {
            label["off_catalogue"] = true.into();
            label["gap"] = json!(case.hidden);
        }
        if planned.hard {
            label["hard"] = true.into();
        }
        self.all["cases"][&planned.id] = label;
        self.write()
    }

    /// Enters the visibility of a case and writes the file.
    pub fn see(&mut self, id: &str, seen: &Visibility) -> Result<(), String> {
        let label = &mut self.all["cases"][id];
        let nothing = label["effects"].as_array().is_none_or(Vec::is_empty);
        label["visibility"] = json!({
            "delta_chi2": round(seen.delta_chi2),
            "left_chi2": round(seen.left_chi2),
            "band": seen.band(nothing),
        });
        self.write()
    }

    fn write(&self) -> Result<(), String> {
        let text = serde_json::to_string_pretty(&self.all).map_err(|e| e.to_string())?;
        folder::put(&self.path, &(text + "\n"))
    }
}

fn round(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}
