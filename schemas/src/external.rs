//! A solver that is not ours: settings, what a simulation is asked for, and the parameters that it is handed.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;
use crate::organ::{ActivationSpec, CirculationSpec, OneFibrePassive, ValveParameters};
use crate::task::InputFile;

/// Placeholders of a command beside the names of files: the parameters, the folder for results, threads.
pub const COMMAND_PLACEHOLDERS: [&str; 3] = ["parameters", "out", "threads"];

/// How the parameters are written.
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
    /// The file's name.
    #[must_use]
    pub fn file(self) -> &'static str {
        match self {
            Self::Toml => "parameters.toml",
            Self::Json => "parameters.json",
        }
    }
}

/// Where the solver leaves its results, relative to the folder that it runs in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalResults {
    /// Pressure and volume of the cavity over the last beat: columns `time_ms`, `pressure_mmHg` (or `pressure_kPa`),
    /// `volume_mL` and, where known, `aortic_pressure_mmHg`, `aortic_flow_mL_per_s`, `mitral_flow_mL_per_s`.
    pub traces: String,
    /// Active stress, calcium where the model has it, and stretch of every node: a file as `nodal.csv` of our own solvers.
    pub nodal: String,
    /// The same in openCARP's `.igb` format, in place of `nodal`: files by quantity, `Sa_kPa`, `lambda`, `Ca_uM`.
    pub igb: BTreeMap<String, String>,
    /// With `igb`: activation time of each node in ms, one number a line. Absent: all at the first activation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub activation: Option<String>,
    /// With `igb`: weight of each node in medians, one number a line, or 0 for nodes that do not contract. Absent: all alike.
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

/// What exit codes other than 0 mean; those that are not listed are `numerics`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExitCodes {
    /// Data or settings are wrong: not tried again as it is.
    pub input: Vec<i32>,
    /// The machine or the site failed: tried again.
    pub site: Vec<i32>,
    /// The simulation diverged.
    pub numerics: Vec<i32>,
    /// A defect of the solver: stop there.
    pub bug: Vec<i32>,
}

impl ExitCodes {
    /// The class of an exit code other than 0.
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

/// `[solver.external]`: the solver of `fidelity = "external"`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalSettings {
    /// Program and arguments. `{parameters}` stands for the file with the parameters, `{out}` for the folder that the
    /// solver runs in and leaves its results in, `{threads}` for the threads it may use, `{NAME}` for a file of `files`;
    /// `{{` and `}}` for braces.
    pub command: Vec<String>,
    /// Files that simulations depend on, by the name that stands for them: relative to the patient's folder where they are
    /// there, else to the folder of `cohort.toml`. A changed file makes simulations that used it be done again.
    pub files: BTreeMap<String, String>,
    /// Files that are made for each simulation in the folder that the solver runs in: name of the file, and the name in
    /// `files` of its template, in which `{KEY}` stands for a parameter (docs/external-solvers.md has the list). A file named
    /// `NAME@MODEL` (`par@land2017-rice`) goes before `NAME` in simulations with that model of active stress.
    pub templates: BTreeMap<String, String>,
    /// How the parameters are written.
    pub parameters: ParametersFormat,
    /// Where results are left.
    pub results: ExternalResults,
    /// What exit codes mean.
    pub exit_codes: ExitCodes,
}

/// The organ that another solver simulates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalOrgan {
    /// Volumes, pressure and one-fibre law of step 0: the state that a beat begins with.
    pub passive: OneFibrePassive,
    /// Activation as the reduced ventricle would have it.
    pub activation: ActivationSpec,
    /// Command, templates, results, exit codes; `files` is empty here.
    pub settings: ExternalSettings,
    /// The files by their content.
    pub files: Vec<InputFile>,
}

/// What produces the active stress, flat: model and parameters by the names of files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalContraction {
    /// `tanh`, `land2017-rice` or `land2017-trace`.
    pub model: String,
    /// All of its parameters, with those that keep their default.
    pub parameters: BTreeMap<String, f64>,
    /// `land2017-trace`: calcium from activation on, columns `time_ms` and `Ca_uM`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium_file: Option<String>,
}

/// `parameters.toml` or `parameters.json`: what an external solver is handed for one simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ExternalParameters {
    /// Format version.
    pub schema_version: u32,
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Largest time step that was asked for.
    pub time_step_ms: f64,
    /// Beats to simulate; the last one is reported.
    pub beats: u32,
    /// Active stress.
    pub contraction: ExternalContraction,
    /// Valves.
    pub valves: ValveParameters,
    /// State at the beat's start, end-diastole, and the one-fibre law through it.
    pub start: OneFibrePassive,
    /// Activation.
    pub activation: ActivationSpec,
    /// Arterial load, its pressure at the start, filling pressure, accepted effects.
    pub circulation: CirculationSpec,
}

/// A placeholder that stands for nothing, or a brace without its partner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PlaceholderError {
    /// `{NAME}` of an unknown name.
    Unknown {
        /// The name.
        name: String,
        /// Line, from 1.
        line: usize,
    },
    /// `{` without `}`, or the other way round.
    Brace {
        /// Line, from 1.
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

/// `text` with each `{NAME}` replaced by what `value_of` has for it, `{{` and `}}` by braces.
///
/// # Errors
/// The first placeholder that stands for nothing, or brace without its partner.
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
