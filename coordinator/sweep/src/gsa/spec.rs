//! Settings of a sensitivity sweep: the paper's, the user's changes, and the changes that an
//! existing folder allows.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::sobol::{DesignSettings, SaltelliDesign};
use cardiotwin_schemas::cell::cell_intervals;
use cardiotwin_schemas::organ::{CELL_PARAMETERS, VALVE_PARAMETERS, cell_default, is_parameter};
use cardiotwin_schemas::settings::SolverSettings;
use cardiotwin_schemas::step3::Step3Settings;
use cardiotwin_schemas::sweep::{
    CellDesign, GsaAnalysis, GsaSpec, SweepFile, SweepSpec, SweptOrgan, SweptParameter,
};
use cardiotwin_schemas::task::TaskSpec;

use crate::SweepError;

/// Default number of blocks in a chunk: some 40 ms of work, next to which the start of a process is
/// short.
pub const CHUNK_BLOCKS: u32 = 64;

/// The paper's analysis: 1024 blocks of 44 samples, cycle length 1000 ms, λ₀ = 1.1, a_p = 42 kPa.
#[must_use]
pub fn published() -> GsaSpec {
    let parameters = cell_intervals().map(|(name, [lower, upper])| SweptParameter {
        name: name.into(),
        lower,
        upper,
    });
    GsaSpec {
        design: CellDesign {
            parameters: parameters.collect(),
            skip_points: 0,
            scramble_seed: None,
            cycle_length_ms: 1000.0,
            lambda_0: 1.1,
            fixed: BTreeMap::from([("a_p_kPa".to_owned(), 42.0)]),
            tolerance: 1e-4,
            organ: None,
        },
        n_blocks: 1024,
        chunk_blocks: CHUNK_BLOCKS,
        analysis: GsaAnalysis::default(),
    }
}

/// Default number of blocks in a chunk of an organ's sweep: some 2 s of work.
const ORGAN_CHUNK_BLOCKS: u32 = 32;
/// Shortest time step of an organ's sweep \[ms\], as in the search of step 3 (docs/sweeps.md says
/// what it changes).
const ORGAN_TIME_STEP_MS: f64 = 2.0;

/// Half width of an interval around a parameter of the twin's cell, as a share of its value.
pub const AROUND: f64 = 0.3;

/// Parameters and intervals of the published analysis.
#[must_use]
pub fn of_paper() -> Vec<(String, [f64; 2])> {
    cell_intervals()
        .map(|(name, interval)| (name.to_owned(), interval))
        .collect()
}

/// Intervals of the same parameters around a cell's values, or around the model's defaults where
/// the cell has none.
#[must_use]
pub fn around(cell: Option<&BTreeMap<String, f64>>) -> Vec<(String, [f64; 2])> {
    let interval = |(name, _): (&str, [f64; 2])| -> Option<(String, [f64; 2])> {
        let value = cell
            .and_then(|cell| cell.get(name).copied())
            .or_else(|| cell_default(name))?;
        let [a, b] = [1.0 - AROUND, 1.0 + AROUND].map(|share| share * value);
        Some((name.to_owned(), [a.min(b), a.max(b)]))
    };
    cell_intervals().filter_map(interval).collect()
}

/// The published design in an organ, with intervals around the parameters of its beat's cell.
///
/// - `lambda_0`: stretch from which the cell starts
#[must_use]
pub fn of_organ(mut organ: SweptOrgan, lambda_0: f64) -> GsaSpec {
    let mut spec = published();
    let swept = |(name, [lower, upper]): (String, [f64; 2])| SweptParameter { name, lower, upper };
    spec.design.parameters = around(organ.beat.contraction.cell_parameters())
        .into_iter()
        .map(swept)
        .collect();
    // The budget of iterations of a patient or of a finite-element ventricle does not suit the
    // one-fibre ventricle.
    let solver = SolverSettings::default();
    organ.beat.newton_iterations = solver.newton_iterations;
    organ.beat.shortest_step_ms = solver.shortest_step_ms;
    organ.beat.time_step_ms = organ.beat.time_step_ms.max(ORGAN_TIME_STEP_MS);
    spec.chunk_blocks = ORGAN_CHUNK_BLOCKS;
    spec.design = CellDesign {
        cycle_length_ms: organ.beat.cycle_length_ms,
        lambda_0,
        fixed: BTreeMap::new(),
        organ: Some(Box::new(organ)),
        ..spec.design
    };
    spec
}

/// Intervals of the valves' resistances for an organ's sweep with `--valves`: step 3's bounds.
#[must_use]
pub fn valves() -> Vec<(String, [f64; 2])> {
    let bounds = Step3Settings::default().bounds;
    VALVE_PARAMETERS
        .iter()
        .filter_map(|name| Some(((*name).to_owned(), *bounds.get(*name)?)))
        .collect()
}

/// Settings given by the user. The others stay as in the folder, or as published.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DesignOptions {
    /// Number of base points, each of which makes a block.
    pub samples: Option<u32>,
    /// Seed of bootstrap and scrambling.
    pub seed: Option<u64>,
    /// Whether the Sobol points are scrambled.
    pub scramble: bool,
    /// Number of blocks in a chunk.
    pub chunk_blocks: Option<u32>,
    /// Number of bootstrap resamples.
    pub resamples: Option<u32>,
    /// Probability that an interval covers the index.
    pub confidence: Option<f64>,
    /// Cycle length at which the cells are paced \[ms\].
    pub cycle_length_ms: Option<f64>,
    /// Initial stretch of the cell.
    pub lambda_0: Option<f64>,
    /// Tolerance of the cell engine.
    pub tolerance: Option<f64>,
    /// Intervals that replace those of the design or add parameters to it.
    pub bounds: Vec<(String, [f64; 2])>,
    /// Fixed values of parameters. A swept parameter leaves the design.
    pub set: Vec<(String, f64)>,
}

impl DesignOptions {
    /// The settings `base` with these changes.
    ///
    /// # Errors
    /// [`SweepError::Setting`] for an unknown name or an invalid number.
    pub fn on(&self, base: GsaSpec) -> Result<GsaSpec, SweepError> {
        let mut spec = base;
        let design = &mut spec.design;
        for (name, value) in &self.set {
            known("--set", name, design)?;
            design.parameters.retain(|p| p.name != *name);
            design.fixed.insert(name.clone(), *value);
        }
        for (name, [lower, upper]) in &self.bounds {
            known("--bounds", name, design)?;
            let swept = SweptParameter {
                name: name.clone(),
                lower: *lower,
                upper: *upper,
            };
            design.fixed.remove(name);
            match design.parameters.iter_mut().find(|p| p.name == *name) {
                Some(parameter) => *parameter = swept,
                None => design.parameters.push(swept),
            }
        }
        let seed = self.seed.unwrap_or(spec.analysis.seed);
        if self.scramble || design.scramble_seed.is_some() {
            design.scramble_seed = Some(seed);
        }
        spec.analysis.seed = seed;
        design.cycle_length_ms = self.cycle_length_ms.unwrap_or(design.cycle_length_ms);
        design.lambda_0 = self.lambda_0.unwrap_or(design.lambda_0);
        design.tolerance = self.tolerance.unwrap_or(design.tolerance);
        spec.n_blocks = self.samples.unwrap_or(spec.n_blocks);
        spec.chunk_blocks = self.chunk_blocks.unwrap_or(spec.chunk_blocks);
        spec.analysis.resamples = self.resamples.unwrap_or(spec.analysis.resamples);
        spec.analysis.confidence = self.confidence.unwrap_or(spec.analysis.confidence);
        check(&spec)?;
        Ok(spec)
    }
}

fn known(option: &str, name: &str, design: &CellDesign) -> Result<(), SweepError> {
    let has = |name: &str| {
        if design.organ.is_some() {
            is_parameter(name)
        } else {
            CELL_PARAMETERS.contains(&name)
        }
    };
    if has(name) {
        return Ok(());
    }
    let known: Vec<&str> = CELL_PARAMETERS
        .into_iter()
        .chain(VALVE_PARAMETERS)
        .filter(|name| has(name))
        .collect();
    let expected = format!("a parameter among {}", known.join(", "));
    Err(SweepError::Setting {
        name: option.into(),
        found: format!("about `{name}`"),
        expected,
    })
}

fn check(spec: &GsaSpec) -> Result<(), SweepError> {
    let refuse = |name: &str, found: String, expected: &str| {
        Err(SweepError::Setting {
            name: name.into(),
            found,
            expected: expected.into(),
        })
    };
    let (design, analysis) = (&spec.design, &spec.analysis);
    if !(2..=1 << 20).contains(&spec.n_blocks) {
        return refuse(
            "--samples",
            spec.n_blocks.to_string(),
            "2 to 1048576, best a power of two",
        );
    }
    if !(1..=1 << 16).contains(&spec.chunk_blocks) {
        return refuse(
            "--chunk-blocks",
            spec.chunk_blocks.to_string(),
            "1 to 65536",
        );
    }
    if !(1..=u64::from(u32::MAX)).contains(&analysis.seed) {
        return refuse("--seed", analysis.seed.to_string(), "1 to 4294967295");
    }
    if analysis.resamples > 100_000 {
        return refuse(
            "--resamples",
            analysis.resamples.to_string(),
            "up to 100000; 0 gives no intervals",
        );
    }
    if !(analysis.confidence > 0.0 && analysis.confidence < 1.0) {
        return refuse(
            "--confidence",
            analysis.confidence.to_string(),
            "above 0 and below 1",
        );
    }
    if !(10.0..=1e5).contains(&design.cycle_length_ms) {
        return refuse(
            "--cycle-length-ms",
            design.cycle_length_ms.to_string(),
            "10 to 100000",
        );
    }
    if !(0.2..=5.0).contains(&design.lambda_0) {
        return refuse("--lambda-0", design.lambda_0.to_string(), "0.2 to 5");
    }
    if !(1e-10..=0.1).contains(&design.tolerance) {
        return refuse("--tolerance", design.tolerance.to_string(), "1e-10 to 0.1");
    }
    if let Some((name, value)) = design.fixed.iter().find(|(_, value)| !value.is_finite()) {
        return refuse(&format!("--set {name}"), value.to_string(), "a number");
    }
    if let Some(p) = design
        .parameters
        .iter()
        .find(|p| !(p.lower < p.upper && p.upper - p.lower < f64::INFINITY))
    {
        return refuse(
            &format!("--bounds {}", p.name),
            format!("{},{}", p.lower, p.upper),
            "LOWER,UPPER in this order",
        );
    }
    saltelli(spec).map(drop)
}

/// The settings of a folder's sweep.
///
/// # Errors
/// [`SweepError::OtherKind`] if the sweep is of another kind.
pub fn of(file: SweepFile) -> Result<GsaSpec, SweepError> {
    match file.sweep {
        SweepSpec::Gsa(spec) => Ok(*spec),
        other => Err(SweepError::OtherKind {
            found: other.kind(),
        }),
    }
}

/// The whole Saltelli design.
///
/// # Errors
/// [`SweepError::Sobol`] for more parameters or points than the sequence has.
pub fn saltelli(spec: &GsaSpec) -> Result<SaltelliDesign, SweepError> {
    let design = &spec.design;
    let intervals: Vec<Interval> = design
        .parameters
        .iter()
        .map(|p| Interval::new(p.lower, p.upper))
        .collect();
    let settings = DesignSettings {
        n_blocks: spec.n_blocks as usize,
        skip_points: design.skip_points,
        scramble: design.scramble_seed,
    };
    Ok(SaltelliDesign::new(&intervals, settings)?)
}

/// Checks that a folder's sweep may continue with these settings. Only the number of blocks may
/// grow and the analysis may change.
///
/// # Errors
/// [`SweepError::Changed`] with each changed setting and both values.
pub fn may_follow(folder: &Path, before: &GsaSpec, now: &GsaSpec) -> Result<(), SweepError> {
    let mut changes = Vec::new();
    if now.n_blocks < before.n_blocks {
        changes.push(format!(
            "samples {} (now {}; the number may only grow)",
            before.n_blocks, now.n_blocks
        ));
    }
    if now.chunk_blocks != before.chunk_blocks {
        changes.push(format!(
            "chunk-blocks {} (now {})",
            before.chunk_blocks, now.chunk_blocks
        ));
    }
    let (a, b) = (&before.design, &now.design);
    let scramble = |seed: Option<u64>| {
        seed.map_or("plain points".to_owned(), |s| {
            format!("scrambled with seed {s}")
        })
    };
    let organ = |design: &CellDesign| {
        design
            .organ
            .as_ref()
            .map_or("the 0D cell".to_owned(), |organ| {
                format!("the organ of {}", organ.patient)
            })
    };
    // The key of the task identifies the beat regardless of where its files lie.
    let beat = |design: &CellDesign| {
        design
            .organ
            .as_ref()
            .map(|o| TaskSpec::OrganBeat(Box::new(o.beat.clone())).key())
    };
    if organ(a) != organ(b) {
        changes.push(format!("{} (now {})", organ(a), organ(b)));
    } else if beat(a) != beat(b) {
        changes.push(format!(
            "another state of {}: its run has continued, or its settings changed",
            organ(a)
        ));
    }
    if a.scramble_seed != b.scramble_seed {
        changes.push(format!(
            "{} (now {})",
            scramble(a.scramble_seed),
            scramble(b.scramble_seed)
        ));
    }
    let numbers = [
        ("skip-points", a.skip_points as f64, b.skip_points as f64),
        ("cycle-length-ms", a.cycle_length_ms, b.cycle_length_ms),
        ("lambda-0", a.lambda_0, b.lambda_0),
        ("tolerance", a.tolerance, b.tolerance),
    ];
    changes.extend(
        numbers
            .iter()
            .filter(|(_, a, b)| a != b)
            .map(|(name, a, b)| format!("{name} {a} (now {b})")),
    );
    let place = |design: &CellDesign, name: &str| {
        let swept = design.parameters.iter().find(|p| p.name == name);
        swept
            .map(|p| format!("in [{}, {}]", p.lower, p.upper))
            .or_else(|| design.fixed.get(name).map(|v| format!("= {v}")))
    };
    for name in CELL_PARAMETERS.into_iter().chain(VALVE_PARAMETERS) {
        let (a, b) = (place(a, name), place(b, name));
        if a != b {
            let word = |place: Option<String>| place.unwrap_or_else(|| "at its default".into());
            changes.push(format!("{name} {} (now {})", word(a), word(b)));
        }
    }
    if changes.is_empty() && a.parameters != b.parameters {
        changes.push("another order of the parameters".into());
    }
    if changes.is_empty() {
        return Ok(());
    }
    Err(SweepError::Changed {
        path: folder.to_owned(),
        changes: changes.join(", "),
    })
}

#[cfg(test)]
pub(super) mod tests {
    use cardiotwin_schemas::ids::PatientId;

    use super::*;

    /// A reduced ventricle whose cell has this `phi`.
    pub fn organ(patient: &str, phi: f64) -> SweptOrgan {
        let beat = serde_json::from_value(serde_json::json!({
            "cycle_length_ms": 700.0, "time_step_ms": 1.0, "shortest_step_ms": 0.015625, "newton_iterations": 60,
            "organ": {"fidelity": "reduced",
                "passive": {"wall_volume_mL": 90.0, "unloaded_volume_mL": 60.0, "end_diastolic_volume_mL": 120.0,
                            "end_diastolic_pressure_mmHg": 9.0, "stiffness_kPa": 0.5, "exponent": 9.24},
                "activation": {"spread_ms": 40.0, "groups": 16, "onset_ms": 20.0}},
            "circulation": {"afterload": {"characteristic_resistance_mmHg_s_per_mL": 0.03,
                "peripheral_resistance_mmHg_s_per_mL": 0.9, "compliance_mL_per_mmHg": 1.2},
                "initial_windkessel_pressure_mmHg": 70.0, "left_atrial_pressure_mmHg": 7.0},
            "valves": {}, "contraction": {"model": "land2017-rice", "parameters": {"phi": phi}, "lambda_0": 1.1},
            "beats": {"mode": "fixed", "n": 1}, "measured_end_diastolic_volume_mL": 120.0
        }));
        SweptOrgan {
            patient: PatientId::from(patient),
            beat: beat.unwrap(),
            law: None,
        }
    }

    #[test]
    fn the_published_analysis_has_45_056_samples_and_the_cell_s_names() {
        let spec = published();
        assert_eq!(saltelli(&spec).unwrap().n_rows(), 45_056);
        let names = cell_intervals().map(|(name, _)| name);
        assert!(names.eq(CELL_PARAMETERS[..21].iter().copied()));
        check(&spec).unwrap();
    }

    #[test]
    fn wishes_are_laid_on_top_and_nonsense_is_named() {
        let wishes = DesignOptions {
            samples: Some(16),
            scramble: true,
            seed: Some(3),
            bounds: vec![
                ("a_p_kPa".into(), [1.0, 100.0]),
                ("n_Tm".into(), [4.0, 5.0]),
            ],
            set: vec![("phi".into(), 2.0)],
            ..DesignOptions::default()
        };
        let spec = wishes.on(published()).unwrap();
        assert_eq!(
            (spec.n_blocks, spec.design.scramble_seed, spec.analysis.seed),
            (16, Some(3), 3)
        );
        assert_eq!(spec.design.fixed, BTreeMap::from([("phi".to_owned(), 2.0)]));
        let names: Vec<&str> = spec
            .design
            .parameters
            .iter()
            .map(|p| p.name.as_str())
            .collect();
        assert_eq!(
            (names.len(), names.contains(&"phi"), names[20]),
            (21, false, "a_p_kPa")
        );
        let refused = |wishes: DesignOptions| wishes.on(published()).unwrap_err().to_string();
        let unknown = refused(DesignOptions {
            set: vec![("Ca50".into(), 1.0)],
            ..DesignOptions::default()
        });
        assert!(
            unknown.contains("`Ca50`") && unknown.contains("Ca50_ref_uM"),
            "{unknown}"
        );
        let reversed = refused(DesignOptions {
            bounds: vec![("n_Tm".into(), [5.0, 4.0])],
            ..DesignOptions::default()
        });
        assert_eq!(
            reversed,
            "--bounds n_Tm is 5,4, expected LOWER,UPPER in this order"
        );
        assert!(
            refused(DesignOptions {
                samples: Some(1),
                ..DesignOptions::default()
            })
            .starts_with("--samples is 1")
        );
        assert!(
            refused(DesignOptions {
                seed: Some(0),
                ..DesignOptions::default()
            })
            .starts_with("--seed is 0")
        );
    }

    #[test]
    fn an_organ_s_sweep_is_around_its_cell_and_has_valves_where_asked() {
        let organ = organ("p1", 2.0);
        let spec = of_organ(organ, 1.1);
        assert_eq!(
            (
                spec.design.parameters.len(),
                spec.design.outputs().len(),
                spec.n_blocks
            ),
            (21, 7, 1024)
        );
        let interval = |spec: &GsaSpec, name: &str| {
            let found = spec.design.parameters.iter().find(|p| p.name == name)?;
            Some([found.lower, found.upper])
        };
        assert_eq!(
            interval(&spec, "phi"),
            Some([1.4, 2.6]),
            "30 % around the beat's own"
        );
        let [lower, upper] = interval(&spec, "beta_1_uM").unwrap();
        assert!(
            lower < upper && upper < 0.0,
            "around the model's default, {lower} {upper}"
        );
        let mut bounds = of_paper();
        bounds.extend(valves());
        let spec = DesignOptions {
            bounds,
            ..DesignOptions::default()
        }
        .on(spec)
        .unwrap();
        assert_eq!(
            (spec.design.parameters.len(), interval(&spec, "phi")),
            (23, Some([0.1, 4.0]))
        );
        let passive = DesignOptions {
            set: vec![("a_p_kPa".into(), 3.0)],
            ..DesignOptions::default()
        }
        .on(spec)
        .unwrap_err();
        assert!(
            passive.to_string().contains("R_AV_f_mmHg_s_per_mL"),
            "{passive}"
        );
        let cell = DesignOptions {
            bounds: valves(),
            ..DesignOptions::default()
        }
        .on(published())
        .unwrap_err();
        assert!(
            cell.to_string().starts_with("--bounds is about `R_AV_f"),
            "{cell}"
        );
    }

    #[test]
    fn an_organ_s_sweep_goes_on_with_the_same_organ_only() {
        let said = |before: SweptOrgan, now: SweptOrgan| {
            may_follow(
                Path::new("gsa"),
                &of_organ(before, 1.1),
                &of_organ(now, 1.1),
            )
            .map_err(|e| e.to_string())
        };
        said(organ("p1", 2.0), organ("p1", 2.0)).unwrap();
        let other = said(organ("p1", 2.0), organ("p2", 2.0)).unwrap_err();
        assert!(
            other.contains("the organ of p1 (now the organ of p2)"),
            "{other}"
        );
        let changed = said(organ("p1", 2.0), organ("p1", 2.1)).unwrap_err();
        assert!(
            changed.contains("another state of the organ of p1"),
            "{changed}"
        );
    }

    #[test]
    fn a_folder_s_sweep_may_grow_and_be_analysed_otherwise_and_nothing_else() {
        let folder = Path::new("gsa");
        let before = published();
        let follow = |wishes: DesignOptions| {
            may_follow(folder, &before, &wishes.on(before.clone()).unwrap())
        };
        follow(DesignOptions::default()).unwrap();
        follow(DesignOptions {
            samples: Some(2048),
            resamples: Some(10),
            seed: Some(4),
            ..DesignOptions::default()
        })
        .unwrap();
        let said = |wishes: DesignOptions| follow(wishes).unwrap_err().to_string();
        let text = said(DesignOptions {
            samples: Some(16),
            scramble: true,
            lambda_0: Some(1.0),
            ..DesignOptions::default()
        });
        for part in [
            "samples 1024 (now 16",
            "plain points (now scrambled with seed 1)",
            "lambda-0 1.1 (now 1)",
            "--out",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        assert!(
            said(DesignOptions {
                chunk_blocks: Some(5),
                ..DesignOptions::default()
            })
            .contains("chunk-blocks 64 (now 5)")
        );
        let fixed = said(DesignOptions {
            set: vec![("phi".into(), 2.0)],
            ..DesignOptions::default()
        });
        assert!(fixed.contains("phi in [0.1, 4] (now = 2)"), "{fixed}");
    }
}
