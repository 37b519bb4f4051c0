//! The one-fibre ventricle: one beat with traces, and batches of parameter sets.

use std::collections::BTreeMap;

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::{
    ActivationSpec, BeatCount, ContractionSpec, OneFibrePassive, OrganSpec,
};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_worker::average_ventricle::average_ventricle;
use cardiotwin_worker::error::{TaskError, chain};
use cardiotwin_worker::tasks::organ_beat::{ReducedOrgan, reduced_beat, reduced_beat_with_traces};
use cardiotwin_worker::tasks::proposal::in_one_fibre;
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray2, ToPyArray as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::current_num_threads;
use rayon::prelude::*;

use crate::error::{ModelError, model};
use crate::threads;

/// Number of beats of a thread between two looks for Ctrl-C: about a quarter of a second.
const BEATS_UNTIL_SIGNALS: usize = 512;
const N_BIOMARKERS: usize = Biomarker::ALL.len();

/// A beat of a one-fibre ventricle with its loads, valves and contraction model.
#[pyclass(frozen, module = "cardiotwin._native")]
pub struct Ventricle {
    spec: OrganBeatSpec,
}

/// Biomarkers (sets × [`Biomarker::ALL`]), whether both valves opened and closed, the name of each
/// set's status, and the words about sets that the models refused.
type Batch<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
    Vec<&'static str>,
    BTreeMap<usize, String>,
);

#[pymethods]
impl Ventricle {
    /// The ventricle of a beat's specification as JSON. A finite-element ventricle becomes the
    /// one-fibre ventricle of the same volumes, pressure and activation.
    #[new]
    fn new(specification: &str) -> PyResult<Self> {
        let spec: OrganBeatSpec = serde_json::from_str(specification).map_err(|error| {
            ModelError::new_err(format!("not the specification of a beat: {error}"))
        })?;
        match in_one_fibre(TaskSpec::OrganBeat(Box::new(spec))) {
            Ok(TaskSpec::OrganBeat(spec)) => Ok(Self { spec: *spec }),
            Ok(_) => Err(ModelError::new_err("not the specification of a beat")),
            Err(error) => Err(model(&error)),
        }
    }

    /// A ventricle in the middle of the bundled cohort, with Tanh.
    #[staticmethod]
    fn average() -> Self {
        Self {
            spec: average_ventricle().0,
        }
    }

    /// The specification as JSON.
    fn specification(&self) -> PyResult<String> {
        serde_json::to_string(&self.spec).map_err(|error| model(&error))
    }

    /// Value of every parameter, by name.
    fn parameters(&self) -> Vec<(String, f64)> {
        let names = self.spec.parameter_names().into_iter();
        names
            .filter_map(|name| Some((name.to_owned(), self.spec.parameter(name)?)))
            .collect()
    }

    /// The same ventricle with other values of parameters, and another number of beats.
    fn changed(&self, parameters: BTreeMap<String, f64>, beats: Option<u32>) -> PyResult<Self> {
        let mut spec = self.spec.clone();
        for (name, value) in &parameters {
            set(&mut spec, name, *value)?;
        }
        if let Some(n) = beats {
            spec.beats = BeatCount::Fixed { n };
        }
        Ok(Self { spec })
    }

    /// The same ventricle with Land's and Rice's cell, whose periodic beat begins at `lambda_0`.
    fn with_cell(&self, parameters: BTreeMap<String, f64>, lambda_0: f64) -> PyResult<Self> {
        let spec = OrganBeatSpec {
            contraction: ContractionSpec::Land2017Rice {
                parameters: BTreeMap::new(),
                lambda_0,
            },
            ..self.spec.clone()
        };
        Self { spec }.changed(parameters, None)
    }

    /// The beat: `biomarkers` and `time_points_ms` by name, `checks`, `remarks`, `beats`,
    /// `periodic`, `lambda_min`, and `traces` by column.
    fn beat<'py>(&self, py: Python<'py>) -> PyResult<(String, Bound<'py, PyDict>)> {
        let (passive, activation) = self.wall()?;
        let (result, traces) = py
            .detach(|| {
                reduced_beat_with_traces(&self.spec, &ReducedOrgan::one_fibre(passive, activation))
            })
            .map_err(|error| model(&error))?;
        let columns = PyDict::new(py);
        for (name, values) in [
            ("time_ms", &traces.time_ms),
            ("pressure_mmHg", &traces.pressure_mmhg),
            ("volume_mL", &traces.volume_ml),
            ("aortic_pressure_mmHg", &traces.aortic_pressure_mmhg),
            ("aortic_flow_mL_per_s", &traces.aortic_flow_ml_per_s),
            ("mitral_flow_mL_per_s", &traces.mitral_flow_ml_per_s),
        ] {
            columns.set_item(name, values.to_pyarray(py))?;
        }
        let result = serde_json::to_string(&result).map_err(|error| model(&error))?;
        Ok((result, columns))
    }

    /// Biomarkers of many beats: `values` holds a row for each set and a column for each of
    /// `names`. A set without a beat has a row of NaN and a status that says why.
    fn batch<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
        n_threads: usize,
    ) -> PyResult<Batch<'py>> {
        let mut known = self.spec.clone();
        for name in &names {
            set(&mut known, name, 1.0)?;
        }
        let rows: Vec<Vec<f64>> = values
            .as_array()
            .rows()
            .into_iter()
            .map(|row| row.to_vec())
            .collect();
        let beat = |row: &Vec<f64>| self.row(&names, row);
        let mut results = Vec::with_capacity(rows.len());
        let slice = BEATS_UNTIL_SIGNALS * threads::run(py, n_threads, current_num_threads)?;
        for rows in rows.chunks(slice) {
            results.extend(threads::run(py, n_threads, || match n_threads {
                1 => rows.iter().map(beat).collect::<Vec<_>>(),
                _ => rows.par_iter().map(beat).collect(),
            })?);
            py.check_signals()?;
        }
        let mut biomarkers = Vec::with_capacity(results.len() * N_BIOMARKERS);
        let (mut opened, mut status, mut refused) = (Vec::new(), Vec::new(), BTreeMap::new());
        for (idx, result) in results.into_iter().enumerate() {
            let (word, row) = match result {
                Ok(Some(row)) => ("finished", row),
                Ok(None) => ("diverged", Row::NONE),
                Err(error) => {
                    refused.insert(idx, chain(&error));
                    ("refused", Row::NONE)
                }
            };
            biomarkers.extend(row.biomarkers);
            opened.push(row.valves_opened);
            status.push(word);
        }
        let biomarkers =
            PyArray1::from_vec(py, biomarkers).reshape([status.len(), N_BIOMARKERS])?;
        Ok((biomarkers, PyArray1::from_vec(py, opened), status, refused))
    }
}

impl Ventricle {
    fn wall(&self) -> PyResult<(OneFibrePassive, ActivationSpec)> {
        wall(&self.spec)
            .ok_or_else(|| ModelError::new_err("the ventricle is not a one-fibre ventricle"))
    }

    fn row(&self, names: &[String], row: &[f64]) -> Result<Option<Row>, TaskError> {
        let mut spec = self.spec.clone();
        for (name, value) in names.iter().zip(row) {
            if !spec.set_parameter(name, *value) {
                return Err(TaskError::UnknownParameter { name: name.clone() });
            }
        }
        let Some((passive, activation)) = wall(&spec) else {
            return Ok(None);
        };
        let beat = reduced_beat(&spec, &ReducedOrgan::one_fibre(passive, activation))?;
        Ok(beat.as_ref().map(Row::of))
    }
}

/// Part of a beat that a batch keeps: its traces would fill the memory.
struct Row {
    biomarkers: [f64; N_BIOMARKERS],
    valves_opened: bool,
}

impl Row {
    const NONE: Self = Self {
        biomarkers: [f64::NAN; N_BIOMARKERS],
        valves_opened: false,
    };

    fn of(beat: &OrganBeatResult) -> Self {
        Self {
            biomarkers: Biomarker::ALL.map(|b| beat.biomarkers.get(b).unwrap_or(f64::NAN)),
            valves_opened: beat.failed_valve().is_none(),
        }
    }
}

fn wall(spec: &OrganBeatSpec) -> Option<(OneFibrePassive, ActivationSpec)> {
    match &spec.organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => Some((*passive, *activation)),
        OrganSpec::FiniteElement(_) | OrganSpec::External(_) => None,
    }
}

fn set(spec: &mut OrganBeatSpec, name: &str, value: f64) -> PyResult<()> {
    if spec.set_parameter(name, value) {
        return Ok(());
    }
    Err(ModelError::new_err(format!(
        "the beat has no parameter `{name}`; it has {}",
        spec.parameter_names().join(", ")
    )))
}
