//! Layers of settings, merged key by key. Every leaf keeps its origin.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::settings::{Settings, lay_over};
use cardiotwin_schemas::shared::Shared;
use cardiotwin_signals::{Position, Problem};
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};

use super::document::{Document, Node, Tree, value_from_text};
use super::report::Report;
use super::shape::{fit, join, schema_of};

/// Name for the command line's settings in messages.
pub const COMMAND_LINE: &str = "--set";
/// Name for options that a run keeps in messages.
pub const KEPT: &str = "kept option";
/// Name for settings stored by `rerun` in messages.
pub const RERUN: &str = "rerun";

/// Origin of a setting.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// Default of the program, which no layer overrides.
    Default,
    /// File and position of the key.
    File(PathBuf, Position),
    /// Stored by `cardiotwin rerun`.
    Rerun,
    /// Option of an earlier `run`, which the run keeps.
    Kept,
    /// An argument `--set KEY=VALUE` of the command.
    CommandLine,
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::File(file, at) => write!(f, "{}:{}", file.display(), at.line),
            Self::Rerun => f.write_str(RERUN),
            Self::Kept => f.write_str(KEPT),
            Self::CommandLine => f.write_str(COMMAND_LINE),
        }
    }
}

impl Serialize for Origin {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// One layer: its keys as JSON in the shape of [`Settings`], and the origin of each leaf.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layer {
    value: Map<String, Value>,
    origins: BTreeMap<String, Origin>,
}

impl Layer {
    /// The built-in defaults.
    ///
    /// # Panics
    /// Never, because the defaults are valid JSON.
    #[must_use]
    pub fn defaults() -> Self {
        Self::base(&Settings::default())
    }

    /// Existing settings as the lowest layer.
    ///
    /// # Panics
    /// Never, because settings are valid JSON.
    #[must_use]
    pub fn base(settings: &Settings) -> Self {
        Self::of(
            serde_json::to_value(settings).expect("settings are JSON"),
            |_| Origin::Default,
        )
    }

    /// The layer in a checked file. `prefix` is the dotted key of its table, empty for the whole
    /// file.
    #[must_use]
    pub fn from_file(layer: &SettingsLayer, document: &Document, prefix: &str) -> Self {
        let positions = positions(&document.root, prefix);
        let value = serde_json::to_value(layer).unwrap_or_default();
        let first = Position { line: 1, column: 1 };
        Self::of(value, |key| {
            let at = positions.get(key).copied().unwrap_or(first);
            Origin::File(document.file.clone(), at)
        })
    }

    /// Settings that `rerun` stored for a patient.
    pub fn from_rerun(value: &Value, patient: &str, report: &mut Report) -> Self {
        let root = Node::from_json(value).unwrap_or(Node {
            at: None,
            value: Tree::Table(BTreeMap::new()),
        });
        let document = Document {
            file: PathBuf::from(RERUN),
            root,
            sound: true,
        };
        let value = fit(
            &document,
            schema_of::<SettingsLayer>(),
            Some(patient),
            report,
        );
        Self::of(value, |_| Origin::Rerun)
    }

    /// Assignments `key=value` from the command line.
    pub fn from_command_line(assignments: &[String], report: &mut Report) -> Self {
        Self::from_assignments(assignments, (COMMAND_LINE, Origin::CommandLine), report)
    }

    /// Assignments `key=value` that a run keeps.
    pub fn from_kept(assignments: &[String], report: &mut Report) -> Self {
        Self::from_assignments(assignments, (KEPT, Origin::Kept), report)
    }

    fn from_assignments(
        assignments: &[String],
        (name, origin): (&str, Origin),
        report: &mut Report,
    ) -> Self {
        let mut root = BTreeMap::new();
        for assignment in assignments {
            match assignment.split_once('=') {
                Some((key, value)) if !key.trim().is_empty() => {
                    insert(&mut root, key.trim(), value_from_text(value.trim()));
                }
                _ => {
                    let remedy = "for example --set step1.damping=0.5; `cardiotwin config show` lists the keys";
                    let found = format!("`{assignment}`");
                    report.add(
                        None,
                        Problem::error(Path::new(name), found, "key=value", remedy),
                    );
                }
            }
        }
        let root = Node {
            at: None,
            value: Tree::Table(root),
        };
        let document = Document {
            file: PathBuf::from(name),
            root,
            sound: true,
        };
        let value = fit(&document, schema_of::<SettingsLayer>(), None, report);
        Self::of(value, |_| origin.clone())
    }

    /// The layer as JSON, in the form that `rerun` stores.
    #[must_use]
    pub fn into_value(self) -> Value {
        Value::Object(self.value)
    }

    /// Whether the layer sets nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    fn of(value: Value, origin: impl Fn(&str) -> Origin) -> Self {
        let mut origins = BTreeMap::new();
        for_each_leaf(&value, "", &mut |key, _| {
            origins.insert(key.to_owned(), origin(key));
        });
        match value {
            Value::Object(value) => Self { value, origins },
            _ => Self::default(),
        }
    }
}

/// Settings after merging, with the origin of every leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Merged {
    /// Settings that result from all layers.
    pub settings: Shared<Settings>,
    /// Origin of each leaf by dotted key.
    pub origins: BTreeMap<String, Origin>,
    /// The same settings as JSON.
    pub value: Value,
}

impl Merged {
    /// Merges layers, later ones over earlier ones.
    ///
    /// # Errors
    /// A layer does not fit [`Settings`]; `fit` has reported the reason.
    pub fn of<'a>(layers: impl IntoIterator<Item = &'a Layer>) -> Result<Self, serde_json::Error> {
        let mut value = Map::new();
        let mut origins = BTreeMap::new();
        for layer in layers {
            lay_over(&mut value, &layer.value);
            origins.extend(layer.origins.clone());
        }
        let value = Value::Object(value);
        Ok(Self {
            settings: serde_json::from_value::<Settings>(value.clone())?.into(),
            origins,
            value,
        })
    }

    /// Origin of a key; for a key without one, the origin of the nearest table around it or of a
    /// leaf inside it.
    #[must_use]
    pub fn origin(&self, key: &str) -> &Origin {
        let mut prefix = key;
        loop {
            if let Some(origin) = self.origins.get(prefix) {
                return origin;
            }
            match prefix.rfind('.') {
                Some(dot) => prefix = &prefix[..dot],
                None => break,
            }
        }
        let inside = format!("{key}.");
        self.origins
            .iter()
            .find(|(k, _)| k.starts_with(&inside))
            .map_or(&Origin::Default, |(_, origin)| origin)
    }

    /// A problem with a setting, at the place where it was set.
    ///
    /// - `document`: `patient.toml`, in which settings stand below `[settings]`
    /// - `said`: what was found, what was expected, what to do
    #[must_use]
    pub fn problem(&self, key: &str, document: Option<&Document>, said: [&str; 3]) -> Problem {
        let (file, at, key) = place(self.origin(key), key, document);
        let [found, expected, remedy] = said;
        Problem::error(file, found, expected, remedy)
            .at_key(key)
            .at(at)
    }

    /// All leaves with dotted key, value and origin.
    #[must_use]
    pub fn leaves(&self) -> Vec<(String, Value, Origin)> {
        let mut leaves = Vec::new();
        for_each_leaf(&self.value, "", &mut |key, value| {
            leaves.push((key.to_owned(), value.clone(), self.origin(key).clone()));
        });
        leaves
    }
}

fn for_each_leaf(value: &Value, key: &str, visit: &mut impl FnMut(&str, &Value)) {
    match value {
        Value::Object(map) => map
            .iter()
            .for_each(|(name, inner)| for_each_leaf(inner, &join(key, name), visit)),
        leaf => visit(key, leaf),
    }
}

/// Position of each dotted key below `prefix`.
#[must_use]
pub fn positions(root: &Node, prefix: &str) -> BTreeMap<String, Position> {
    fn walk(node: &Node, key: &str, out: &mut BTreeMap<String, Position>) {
        out.extend(node.at.map(|at| (key.to_owned(), at)));
        if let Tree::Table(table) = &node.value {
            table
                .iter()
                .for_each(|(name, inner)| walk(inner, &join(key, name), out));
        }
    }
    let start = prefix
        .split('.')
        .filter(|part| !part.is_empty())
        .try_fold(root, |node, part| match &node.value {
            Tree::Table(table) => table.get(part),
            _ => None,
        });
    let mut out = BTreeMap::new();
    if let Some(start) = start {
        walk(start, "", &mut out);
    }
    out
}

/// Position of a dotted key in a document; `None` if the key is absent.
#[must_use]
pub fn position_of(document: &Document, key: &str) -> Option<Position> {
    positions(&document.root, "").get(key).copied()
}

/// Place of a setting: file, position, and the key as it stands there.
///
/// - `document`: `patient.toml`, in which settings stand below `[settings]`
pub(super) fn place<'a>(
    origin: &'a Origin,
    key: &str,
    document: Option<&Document>,
) -> (&'a Path, Option<Position>, String) {
    match origin {
        Origin::File(file, at) if document.is_some_and(|document| document.file == *file) => {
            (file, Some(*at), format!("settings.{key}"))
        }
        Origin::File(file, at) => (file, Some(*at), key.to_owned()),
        Origin::Rerun => (Path::new(RERUN), None, key.to_owned()),
        Origin::Kept => (Path::new(KEPT), None, key.to_owned()),
        Origin::CommandLine | Origin::Default => (Path::new(COMMAND_LINE), None, key.to_owned()),
    }
}

fn insert(table: &mut BTreeMap<String, Node>, key: &str, value: Node) {
    match key.split_once('.') {
        None => {
            table.insert(key.to_owned(), value);
        }
        Some((head, rest)) => {
            let node = table.entry(head.to_owned()).or_insert_with(|| Node {
                at: None,
                value: Tree::Table(BTreeMap::new()),
            });
            if !matches!(node.value, Tree::Table(_)) {
                node.value = Tree::Table(BTreeMap::new());
            }
            if let Tree::Table(inner) = &mut node.value {
                insert(inner, rest, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_layer(name: &str, text: &str) -> Layer {
        let mut report = Report::default();
        let document = Document::parse(Path::new(name), text, None, &mut report);
        let value = fit(&document, schema_of::<SettingsLayer>(), None, &mut report);
        assert_eq!(report.findings(), []);
        Layer::from_file(&serde_json::from_value(value).unwrap(), &document, "")
    }

    #[test]
    fn later_layers_win_key_by_key_and_origins_follow() {
        let cohort = file_layer(
            "cohort.toml",
            "[step1]\ntolerance = 0.2\nbounds.t_CR_ms = [1, 2000]\n",
        );
        let patient = file_layer(
            "patient.toml",
            "[step1]\n\ntolerance = 0.3\nmax_iterations = 4\n",
        );
        let mut report = Report::default();
        let rerun = Layer::from_rerun(
            &serde_json::json!({"step1": {"damping": 0.5}}),
            "P1",
            &mut report,
        );
        let set = Layer::from_command_line(&["step1.max_iterations=7".into()], &mut report);
        assert_eq!(report.findings(), []);
        let merged = Merged::of([&Layer::defaults(), &cohort, &patient, &rerun, &set]).unwrap();
        assert_eq!(merged.settings.step1.tolerance, 0.3);
        assert_eq!(merged.settings.step1.max_iterations, 7);
        assert_eq!(merged.settings.step1.damping, 0.5);
        assert_eq!(merged.settings.step1.bounds["t_CR_ms"], [1.0, 2000.0]);
        assert_eq!(
            merged.settings.step1.bounds.len(),
            6,
            "the other bounds stay"
        );
        let origin = |key| merged.origin(key).to_string();
        assert_eq!(origin("step1.tolerance"), "patient.toml:3");
        assert_eq!(origin("step1.bounds.t_CR_ms"), "cohort.toml:3");
        assert_eq!(origin("step1.bounds.tau_SD_ms"), "default");
        assert_eq!(origin("step1.max_iterations"), "--set");
        assert_eq!(origin("step1.damping"), "rerun");
    }

    #[test]
    fn the_command_line_is_checked_like_a_file() {
        let mut report = Report::default();
        Layer::from_command_line(
            &[
                "step1.dampin=0.5".into(),
                "solver.beats=x".into(),
                "beats".into(),
            ],
            &mut report,
        );
        let said: Vec<_> = report
            .findings()
            .iter()
            .map(|f| f.problem.to_string())
            .collect();
        assert_eq!(said.len(), 3, "{said:?}");
        assert!(
            said.iter().any(|s| s.contains("did you mean `damping`?")),
            "{said:?}"
        );
        assert!(
            said.iter().all(|s| s.starts_with("error: --set")),
            "{said:?}"
        );
    }

    #[test]
    fn what_a_rerun_stored_under_an_older_name_is_an_error_not_a_silence() {
        let mut report = Report::default();
        Layer::from_rerun(
            &serde_json::json!({"step1": {"relaxation": 0.5}}),
            "P1",
            &mut report,
        );
        assert_eq!(report.n_errors(), 1);
    }
}
