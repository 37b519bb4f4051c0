//! Settings of an external solver, and the parameters that it receives for a simulation.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;
use crate::input_file::InputFile;
use crate::loads::CirculationSpec;
use crate::one_fibre::{ActivationSpec, OneFibrePassive};
use crate::step1::ValveParameters;

/// Placeholders of a command besides the names of files: the parameters, the directory for results,
/// and the number of threads.
pub const COMMAND_PLACEHOLDERS: [&str; 3] = ["parameters", "out", "threads"];

/// Format of the file with the parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ParametersFormat {
    /// `parameters.toml`.
    #[default]
    Toml,
    /// `parameters.json`.
    Json,
}

impl ParametersFormat {
    /// Name of the parameters file.
    #[must_use]
    pub fn file(self) -> &'static str {
        match self {
            Self::Toml => "parameters.toml",
            Self::Json => "parameters.json",
        }
    }
}

/// Files in which the solver leaves its results, relative to its working directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalResults {
    /// Pressure and volume of the cavity over the last beat: columns `time_ms`, `pressure_mmHg` (or
    /// `pressure_kPa`), `volume_mL` and, if known, `aortic_pressure_mmHg`, `aortic_flow_mL_per_s`,
    /// `mitral_flow_mL_per_s`.
    pub traces: String,
    /// Active stress, stretch and, if the model has it, calcium of every node, in the format of our
    /// own solvers' `nodal.csv`.
    pub nodal: String,
    /// Files in openCARP's `.igb` format in place of `nodal`, by quantity: `Sa_kPa`, `lambda`,
    /// `Ca_uM`.
    pub igb: BTreeMap<String, String>,
    /// With `igb`: activation time of each node in ms, one number per line. If absent, all nodes
    /// are activated at the first activation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub activation: Option<String>,
    /// With `igb`: weight of each node in medians, one number per line; 0 for nodes that do not
    /// contract. If absent, all weights are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<String>,
}

impl Default for ExternalResults {
    fn default() -> Self {
        Self {
            traces: "traces.csv".into(),
            nodal: "nodal.csv".into(),
            igb: BTreeMap::new(),
            activation: None,
            weights: None,
        }
    }
}

/// Meaning of the exit codes other than 0. Codes that are not listed mean `numerics`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExitCodes {
    /// Exit codes for wrong data or settings. The simulation is not repeated unchanged.
    pub input: Vec<i32>,
    /// Exit codes for a failure of the machine or the site. The simulation is repeated.
    pub site: Vec<i32>,
    /// Exit codes for a diverged simulation.
    pub numerics: Vec<i32>,
    /// Exit codes for a defect of the solver. Nothing is repeated.
    pub bug: Vec<i32>,
}

impl ExitCodes {
    /// Failure class of an exit code other than 0.
    #[must_use]
    pub fn class_of(&self, code: i32) -> FailureClass {
        let listed = [
            (&self.input, FailureClass::Input),
            (&self.site, FailureClass::Site),
            (&self.bug, FailureClass::Bug),
            (&self.numerics, FailureClass::Numerics),
        ];
        listed
            .into_iter()
            .find(|(codes, _)| codes.contains(&code))
            .map_or(FailureClass::Numerics, |(_, class)| class)
    }
}

/// `[solver.external]`: settings of the solver with `fidelity = "external"`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalSettings {
    /// Program with arguments. `{parameters}` stands for the file with the parameters, `{out}` for
    /// the directory in which the solver runs and leaves its results, `{threads}` for the number of
    /// threads, `{NAME}` for a file of `files`; `{{` and `}}` for braces.
    pub command: Vec<String>,
    /// Files on which simulations depend, by the name that stands for them. Paths are relative to
    /// the patient's folder if the file exists there, otherwise to the folder of `cohort.toml`. If
    /// a file changes, simulations that used it are repeated.
    pub files: BTreeMap<String, String>,
    /// Files that are written for each simulation into the directory in which the solver runs: name
    /// of the file, and name in `files` of its template, in which `{KEY}` stands for a parameter
    /// (docs/external-solvers.md has the list). A file named `NAME@MODEL` (`par@land2017-rice`)
    /// takes precedence over `NAME` in simulations with that model of active stress.
    pub templates: BTreeMap<String, String>,
    /// Format of the file with the parameters.
    pub parameters: ParametersFormat,
    /// Files in which the solver leaves its results.
    pub results: ExternalResults,
    /// Meaning of the exit codes.
    pub exit_codes: ExitCodes,
}

/// An organ that an external solver simulates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalOrgan {
    /// Volumes, pressure and one-fibre law from step 0, which define the state at the beginning of
    /// a beat.
    pub passive: OneFibrePassive,
    /// Activation with the same distribution as in the reduced ventricle.
    pub activation: ActivationSpec,
    /// Command, templates, results and exit codes. `files` is empty here.
    pub settings: ExternalSettings,
    /// Files, identified by their content.
    pub files: Vec<InputFile>,
}

/// Model of the active stress and its parameters, by the names used in files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalContraction {
    /// `tanh`, `land2017-rice` or `land2017-trace`.
    pub model: String,
    /// All parameters of the model, including those at their default.
    pub parameters: BTreeMap<String, f64>,
    /// File with calcium from activation on for `land2017-trace`, columns `time_ms` and `Ca_uM`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium_file: Option<String>,
}

/// `parameters.toml` or `parameters.json`: input of an external solver for one simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalParameters {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// Largest time step, from the settings.
    pub time_step_ms: f64,
    /// Number of beats to simulate. The last one is reported.
    pub beats: u32,
    /// Parameters of the active stress.
    pub contraction: ExternalContraction,
    /// Parameters of the valves.
    pub valves: ValveParameters,
    /// State at the start of the beat, which is end-diastole, and the one-fibre law through it.
    pub start: OneFibrePassive,
    /// Activation of the wall.
    pub activation: ActivationSpec,
    /// Arterial load with its initial pressure, filling pressure and accepted effects.
    pub circulation: CirculationSpec,
}

/// An unknown placeholder, or a brace without its partner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PlaceholderError {
    /// `{NAME}` of an unknown name.
    Unknown {
        /// Name in the placeholder.
        name: String,
        /// Number of the line, from 1.
        line: usize,
    },
    /// A `{` without `}`, or a `}` without `{`.
    Brace {
        /// Number of the line, from 1.
        line: usize,
    },
}

impl std::fmt::Display for PlaceholderError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown { name, line } => write!(f, "line {line}: {{{name}}} stands for nothing"),
            Self::Brace { line } => {
                write!(
                    f,
                    "line {line}: a brace without its partner; write {{{{ or }}}} for a brace"
                )
            }
        }
    }
}

impl std::error::Error for PlaceholderError {}

/// Replaces each `{NAME}` in `text` by the result of `value_of`, and `{{` and `}}` by braces.
///
/// # Errors
/// [`PlaceholderError`] for the first unknown placeholder or brace without its partner.
pub fn expand(
    text: &str,
    value_of: impl Fn(&str) -> Option<String>,
) -> Result<String, PlaceholderError> {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let line = |rest: &str| 1 + text[..text.len() - rest.len()].matches('\n').count();
    while let Some(at) = rest.find(['{', '}']) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        if let Some(after) = rest.strip_prefix("{{").or_else(|| rest.strip_prefix("}}")) {
            out.push_str(&rest[..1]);
            rest = after;
            continue;
        }
        let inner = rest
            .strip_prefix('{')
            .and_then(|inner| inner.split_once('}'));
        let Some((name, after)) = inner.filter(|(name, _)| !name.contains(['{', '\n'])) else {
            return Err(PlaceholderError::Brace { line: line(rest) });
        };
        let value = value_of(name);
        out.push_str(&value.ok_or_else(|| PlaceholderError::Unknown {
            name: name.to_owned(),
            line: line(rest),
        })?);
        rest = after;
    }
    out.push_str(rest);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_replaced_and_doubled_braces_are_braces() {
        let value = |name: &str| (name == "t_CR_ms").then(|| "550".to_owned());
        assert_eq!(
            expand("a = {t_CR_ms}\n{{x}}", value),
            Ok("a = 550\n{x}".to_owned())
        );
        let unknown = PlaceholderError::Unknown {
            name: "t_CR".into(),
            line: 2,
        };
        assert_eq!(expand("a\nb = {t_CR}", value), Err(unknown));
        assert_eq!(
            expand("a = {t_CR_ms", value),
            Err(PlaceholderError::Brace { line: 1 })
        );
        assert_eq!(
            expand("\n\n}", value),
            Err(PlaceholderError::Brace { line: 3 })
        );
    }

    #[test]
    fn an_exit_code_that_is_not_listed_is_a_simulation_that_failed() {
        let codes = ExitCodes {
            site: vec![75, 124],
            ..ExitCodes::default()
        };
        assert_eq!(codes.class_of(75), FailureClass::Site);
        assert_eq!(codes.class_of(1), FailureClass::Numerics);
    }
}
