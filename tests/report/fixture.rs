//! The run of a finished cohort: measured traces of the bundled cohort, the paper's numbers (Jung
//! et al. 2022, Tables 2, A6, A7) as biomarkers and parameters, and simple curves as simulated
//! traces. Further patients have failures or lack data.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::biomarkers::{Biomarkers, CellBiomarkers, NoiseWindows, TimePoints};
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::motion::MotionMeasures;
use cardiotwin_schemas::organ::{
    ActivationSpec, CirculationSpec, OneFibrePassive, OrganSpec, Step1Parameters, TanhParameters,
    ValveParameters, WindkesselParameters,
};
use cardiotwin_schemas::outcome::{
    Artefact, CellFitResult, Check, Estimate, FittedParameter, OrganBeatResult, PassiveStateResult,
    TargetsResult,
};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::record::{
    IterationRecord, PatientRecord, RunRecord, StallReason, Step1Quality, Step1Summary, TaskRecord,
};
use cardiotwin_schemas::settings::{ActivationSettings, StartMode};
use cardiotwin_schemas::shared::Shared;
use cardiotwin_schemas::status::{PatientState, PatientStatus};
use cardiotwin_schemas::task::{InputFile, PassiveStateSpec};
use cardiotwin_schemas::verdict::{TwinTolerances, Verdict};

use crate::traces::{at, extreme, measured, time_points};

/// Numbers that the paper prints for a patient.
struct Printed {
    id: &'static str,
    cycle_length_ms: f64,
    /// P_max, dPdt_max, dPdt_min, PTD90, SV.
    clinical: [f64; 5],
    step1: [f64; 5],
    step2: [f64; 5],
    /// Parameters of step 1 (Table A6).
    organ: [f64; 6],
    /// Parameters of step 2 (Table A7).
    cell: [f64; 9],
    iterations: u32,
    evaluations: u64,
}

macro_rules! printed {
    ($($id:literal $cycle:literal $clinical:expr, $step1:expr, $step2:expr, $organ:expr, $cell:expr, $iterations:literal $evaluations:literal;)*) => {
        const PRINTED: &[Printed] = &[$(Printed {
            id: $id, cycle_length_ms: $cycle, clinical: $clinical, step1: $step1, step2: $step2, organ: $organ,
            cell: $cell, iterations: $iterations, evaluations: $evaluations,
        },)*];
    };
}

printed! {
    "01-CoA" 659.0 [119.0, 2.7, -2.9, 309.0, 100.0], [115.0, 1.9, -2.2, 330.0, 90.0], [125.0, 2.8, -1.2, 316.0, 92.6],
        [108.4, 20.5, 36.5, 376.4, 0.0068, 0.0444], [3.88, -1.2, 3.01, 0.615, 0.147, 0.076, 0.895, 105.6, 120.0], 2 13211;
    "02-CoA" 1231.0 [105.0, 1.3, -1.5, 452.0, 115.0], [105.0, 1.2, -1.5, 460.0, 123.0], [107.0, 1.5, -0.9, 446.0, 126.0],
        [103.2, 30.1, 48.8, 529.3, 0.0125, 0.0794], [3.22, -1.21, 5.47, 0.501, 0.046, 0.076, 0.9, 164.4, 149.0], 3 16061;
    "03-CoA" 917.0 [121.0, 1.9, -1.2, 450.0, 46.0], [114.0, 1.7, -1.3, 448.0, 46.0], [112.0, 2.5, -1.2, 431.0, 44.0],
        [182.3, 7.0, 77.5, 514.8, 0.0028, 0.0562], [4.99, -1.2, 6.02, 0.5, 0.25, 0.075, 0.9, 162.9, 152.8], 4 17261;
    "04-CoA" 631.0 [129.0, 3.6, -3.1, 290.0, 68.0], [126.0, 3.2, -3.1, 290.0, 53.0], [126.0, 3.8, -1.3, 302.0, 52.0],
        [220.4, 0.89, 35.0, 330.0, 0.0001, 0.0646], [5.0, -1.2, 5.68, 0.5, 0.031, 0.075, 0.899, 140.4, 67.6], 9 8561;
    "05-CoA" 654.0 [133.0, 2.7, -2.3, 309.0, 92.0], [120.0, 2.4, -2.5, 309.0, 81.0], [123.0, 3.4, -1.1, 310.0, 83.0],
        [145.2, 12.5, 39.2, 352.4, 0.004, 0.0472], [4.82, -1.24, 3.0, 0.505, 0.031, 0.082, 0.898, 103.6, 93.4], 3 16211;
    "06-CoA" 697.0 [152.0, 3.2, -2.7, 332.0, 100.0], [139.0, 2.7, -2.8, 332.0, 87.0], [142.0, 3.4, -1.2, 345.0, 83.0],
        [172.1, 6.1, 40.3, 376.0, 0.0026, 0.0324], [4.99, -1.2, 3.48, 0.511, 0.029, 0.076, 0.899, 113.8, 114.5], 4 14111;
    "07-CoA" 852.0 [110.0, 1.2, -1.2, 412.0, 55.0], [101.0, 1.3, -1.2, 409.0, 60.0], [101.0, 2.1, -1.0, 394.0, 59.0],
        [146.8, 26.1, 64.9, 475.5, 0.0069, 0.0593], [4.98, -1.2, 4.12, 0.5, 0.097, 0.076, 0.899, 139.4, 142.6], 3 20766;
}

const CELL: [&str; 9] = [
    "n_TRPN",
    "beta_1_uM",
    "n_Tm",
    "Ca50_ref_uM",
    "k_UW_per_ms",
    "Ca_res_uM",
    "Ca_max_uM",
    "tau_CR_ms",
    "tau_CD_ms",
];

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .join("examples/coa-seven/patients")
}

fn biomarkers(v: [f64; 5], edv: f64, gap: Option<f64>) -> Biomarkers {
    Biomarkers {
        p_max_mmhg: Some(v[0]),
        dpdt_max_mmhg_per_ms: Some(v[1]),
        dpdt_min_mmhg_per_ms: Some(v[2]),
        ptd90_ms: Some(v[3]),
        sv_ml: Some(v[4]),
        tau_vd_ms: Some(0.22 * v[3]),
        tau_vr_ms: Some(0.2 * v[3]),
        edv_ml: Some(edv),
        esv_ml: Some(edv - v[4]),
        edp_mmhg: Some(7.0),
        end_of_beat_gap_ml: gap,
    }
}

/// Folder in which a fixture writes its artefacts.
struct Folder<'a> {
    root: &'a Path,
}

impl Folder<'_> {
    fn record<T>(
        &self,
        name: &str,
        patient: &str,
        files: &[(&str, String)],
        wall_s: f64,
        seed: Option<u64>,
        result: T,
    ) -> TaskRecord<T> {
        let key = sha256_hex(format!("{patient} {name}").as_bytes());
        let directory = self
            .root
            .join("attempts")
            .join(&key[..2])
            .join(format!("{}-g1", &key[..16]));
        std::fs::create_dir_all(&directory).expect("a temporary folder takes folders");
        let artefacts = files
            .iter()
            .map(|(role, text)| {
                let file = format!("{role}.csv");
                std::fs::write(directory.join(&file), text)
                    .expect("a temporary folder takes files");
                Artefact {
                    name: (*role).into(),
                    file,
                    sha256: sha256_hex(text.as_bytes()),
                    bytes: text.len() as u64,
                }
            })
            .collect();
        let provenance = Provenance {
            version: "0.1.0".into(),
            commit: Some("0123456789abcdef0123456789abcdef01234567".into()),
            inputs: BTreeMap::from([("pressure".into(), sha256_hex(patient.as_bytes()))]),
            seed,
            threads: 1,
            ranks: 1,
            host: "ward".into(),
            arithmetic: "x86-64 scalar".into(),
            started: "2026-03-04T05:06:07.890Z".into(),
            wall_s,
            cpu_s: 0.97 * wall_s,
            peak_memory_mb: 21.3,
        };
        TaskRecord {
            key: TaskKey(key),
            generation: 1,
            directory,
            artefacts,
            provenance,
            result,
        }
    }
}

/// A simulated beat derived from a measured one: the peak and the stroke volume of `target`, no
/// atrial kick, and hence an open gap at the end.
fn simulated(
    p: &[(f64, f64)],
    v: &[(f64, f64)],
    cycle: f64,
    target: &[f64; 5],
    lag: f64,
) -> (String, f64, TimePoints) {
    let peak = p[extreme(p, 1.0)].1;
    let (edv, esv) = (v[0].1, v[extreme(v, -1.0)].1);
    let scale = target[4] / (edv - esv);
    let (mut ps, mut vs) = (Vec::new(), Vec::new());
    let mut text =
        "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg,aortic_flow_mL_per_s,mitral_flow_mL_per_s\n".to_owned();
    let (mut aortic, mut before): (f64, f64) = (68.0, edv);
    let mut highest = 0.0_f64;
    for ms in 0..=cycle as u32 {
        let t = f64::from(ms);
        let shifted = (t - lag).max(0.0);
        let low = at(p, 0.0);
        let pressure = low + (at(p, shifted) - low) * (target[0] - low) / (peak - low);
        let mut volume = edv - (edv - at(v, shifted)) * scale;
        if t > 0.5 * cycle {
            // The ventricle keeps the volume that it has before the kick.
            volume = volume.min(highest.max(edv - 0.28 * target[4]));
        } else {
            highest = highest.min(volume);
        }
        let rate = (volume - before) * 1e3;
        let (out, into) = ((-rate).max(0.0), rate.max(0.0));
        aortic = if out > 20.0 {
            pressure.max(aortic - 0.05)
        } else {
            (aortic - 0.06).max(60.0)
        };
        before = volume;
        let _ = writeln!(
            text,
            "{t},{pressure:.4},{volume:.4},{aortic:.4},{out:.3},{into:.3}"
        );
        ps.push((t, pressure));
        vs.push((t, volume));
    }
    (text, edv - before, time_points(&ps, &vs))
}

/// Active stress, calcium and stretch of one beat.
fn cell(
    cycle: f64,
    peak: f64,
    rise: f64,
    length: f64,
    lambda_min: f64,
    calcium: Option<(f64, f64)>,
) -> String {
    let mut text = format!(
        "time_ms,Sa_kPa{},lambda\n",
        if calcium.is_some() { ",Ca_uM" } else { "" }
    );
    for ms in 0..cycle as u32 {
        let t = f64::from(ms);
        let shape = (t / rise).tanh().powi(2) * ((length - t).max(0.0) / 45.0).tanh().powi(2);
        let stress = peak * shape;
        let stretch =
            1.0 - (1.0 - lambda_min) * (t / (0.5 * length)).min(1.0).powi(2) * shape.sqrt();
        let _ = match calcium {
            Some((rest, top)) => {
                let s = t / 110.0;
                writeln!(
                    text,
                    "{t},{stress:.5},{:.5},{stretch:.6}",
                    rest + (top - rest) * s * (1.0 - s).exp()
                )
            }
            None => writeln!(text, "{t},{stress:.5},{stretch:.6}"),
        };
    }
    text
}

fn convergence(evaluations: u64, cost: f64) -> String {
    let mut text = "generation,best_cost,mean_cost,evaluations\n".to_owned();
    for g in 0..=evaluations / 150 {
        let left = (-5.0 * g as f64 * 150.0 / evaluations as f64).exp();
        let _ = writeln!(
            text,
            "{g},{},{},{}",
            cost * (1.0 + 40.0 * left * left),
            cost * (1.01 + 900.0 * left * left),
            (g + 1) * 150
        );
    }
    text
}

fn status(id: &str, step: &str, state: &str) -> PatientStatus {
    PatientStatus {
        patient: id.into(),
        step: step.into(),
        state: PatientState::from_name(state).expect("a state"),
        iteration: None,
        step1_cost: None,
        step1_quality: None,
        step2_cost: None,
        for_s: 12.0,
        failure_class: None,
        note: String::new(),
    }
}

fn plan(printed: &Printed, id: &str) -> ResolvedPatient {
    let input = |name: &str| {
        let path = examples().join(printed.id).join(format!("{name}.csv"));
        let sha256 = sha256_hex(&std::fs::read(&path).expect("the bundled cohort is complete"));
        Some(InputFile {
            name: name.into(),
            path,
            sha256,
        })
    };
    ResolvedPatient {
        is_unconfirmed: false,
        id: PatientId::from(id),
        workflow: Workflow::Personalise,
        random_stream: None,
        step0: PassiveStateSpec {
            cycle_length_ms: printed.cycle_length_ms,
            pressure: input("pressure"),
            volume: input("volume"),
            biomarkers: Biomarkers::default(),
            end_diastolic_pressure_mmhg: Some(7.0),
            end_diastolic_volume_ml: None,
            diastasis_time_ms: Some(529.0),
            diastasis_volume_ml: Some(138.5),
            aortic_systolic_mmhg: Some(115.0),
            aortic_diastolic_mmhg: Some(68.7),
            wall_volume_ml: Some(120.9),
            passive_exponent: None,
            afterload: None,
            left_atrial_pressure_mmhg: Some(6.43),
            flows: Default::default(),
            start: StartMode::EndDiastole,
            activation: ActivationSettings::default(),
            biomarker_factors: BTreeMap::new(),
            passive_law: None,
            corrections: Vec::new(),
            finite_element: None,
            own_mesh: None,
            guccione_c_kpa: None,
        },
        law: None,
        calcium: None,
        noise: None,
        external_files: Vec::new(),
        settings: Shared::default(),
        effects: Vec::new(),
    }
}

fn parameters(v: [f64; 6]) -> Step1Parameters {
    Step1Parameters {
        tanh: TanhParameters::default(),
        valves: ValveParameters::default(),
    }
    .with_updated(v)
}

fn beat(biomarkers: Biomarkers, time_points: TimePoints) -> OrganBeatResult {
    OrganBeatResult {
        biomarkers,
        samples: cardiotwin_schemas::samples::BeatSamples::default(),
        time_points,
        checks: vec![Check {
            name: "aortic valve opened and closed".into(),
            passed: true,
            found: "1 opening".into(),
            expected: "at least 1".into(),
        }],
        beats: 1,
        periodic: false,
        remarks: Vec::new(),
        lambda_min: 0.81,
        motion: Some(MotionMeasures {
            base_descent_mm: 13.2,
            apex_rise_mm: 0.7,
            epicardial_radius_change_percent: -13.5,
            shortening_percent: 16.1,
            wall_thickening_percent: 49.2,
            twist_epi_deg: 18.4,
            twist_endo_deg: 19.3,
            isovolumic_lengthening_percent: 4.1,
            isovolumic_untwisting_percent: Some(31.0),
            least_pressure_mmhg: -0.49,
            least_volume_ratio: 0.66,
            largest_volume_ratio: 1.38,
        }),
        law: None,
        closed_loop: None,
        counters: BTreeMap::new(),
    }
}

fn cost(simulated: &[f64; 5], clinical: &[f64; 5]) -> f64 {
    (0..4)
        .map(|i| ((simulated[i] - clinical[i]) / clinical[i]).powi(2))
        .sum()
}

/// A patient with all steps finished.
fn finished(folder: &Folder, printed: &Printed, id: &str) -> PatientRecord {
    let plan = plan(printed, id);
    let cycle = printed.cycle_length_ms;
    let path = |input: &Option<InputFile>| {
        input
            .as_ref()
            .expect("planned with both traces")
            .path
            .clone()
    };
    let (p, v) = (
        measured(&path(&plan.step0.pressure)),
        measured(&path(&plan.step0.volume)),
    );
    let edv = v[0].1;
    let stalled = printed.id == "04-CoA";

    let step0 = PassiveStateResult {
        organ: OrganSpec::Reduced {
            passive: OneFibrePassive {
                wall_volume_ml: 120.9,
                unloaded_volume_ml: 0.55 * edv,
                end_diastolic_volume_ml: edv,
                end_diastolic_pressure_mmhg: 7.0,
                stiffness_kpa: 0.71,
                exponent: 9.24,
            },
            activation: ActivationSpec {
                spread_ms: 40.0,
                groups: 16,
                onset_ms: 28.0,
            },
        },
        circulation: CirculationSpec {
            afterload: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.0523,
                peripheral_resistance_mmhg_s_per_ml: 0.4934,
                compliance_ml_per_mmhg: 2.0263,
            },
            initial_windkessel_pressure_mmhg: 68.7,
            left_atrial_pressure_mmhg: 6.43,
            effects: Vec::new(),
            closed: None,
        },
        measured: biomarkers(printed.clinical, edv, None),
        biomarker_factors: BTreeMap::new(),
        noise_windows: NoiseWindows::default(),
        samples: cardiotwin_schemas::samples::BeatSamples::default(),
        time_points: time_points(&p, &v),
        estimates: vec![Estimate {
            key: "afterload.compliance_mL_per_mmHg".into(),
            value: 2.0263,
            sd: None,
            method: "fitted to the flow in ejection and the cuff pressure".into(),
        }],
        diastasis_volume_error_ml: Some(-1.4),
        remarks: Vec::new(),
        counters: BTreeMap::new(),
    };

    let first = parameters([100.0, 40.0, 110.0, 550.0, 0.01, 0.01]);
    let mut iterations = Vec::new();
    for k in 1..=printed.iterations {
        // Each iteration halves the remaining logarithmic difference; the last one has the paper's
        // values.
        let left = if k == printed.iterations {
            0.0
        } else {
            0.5_f64.powi(k as i32 - 1)
        };
        let mut values = first.updated();
        for (value, last) in values.iter_mut().zip(printed.organ) {
            *value = last * (*value / last).powf(left);
        }
        let mut found = printed.step1;
        for (value, clinical) in found.iter_mut().zip(printed.clinical) {
            *value += 0.5 * left * (*value - 1.3 * clinical);
        }
        let (traces, gap, times) = simulated(&p, &v, cycle, &found, 4.0);
        let result = beat(biomarkers(found, edv, Some(gap)), times);
        iterations.push(IterationRecord {
            number: k,
            parameters: parameters(values),
            proposal: None,
            run: Some(folder.record(
                &format!("iteration {k}"),
                id,
                &[("traces", traces)],
                0.0031,
                None,
                result,
            )),
            failure: None,
            cost: Some(cost(&found, &printed.clinical) + if stalled { 0.09 } else { 0.0 }),
            relative_differences: BTreeMap::new(),
        });
    }
    if stalled {
        let mut values = printed.organ;
        values[1] *= 0.7;
        iterations.push(IterationRecord {
            number: printed.iterations + 1,
            parameters: parameters(values),
            proposal: None,
            run: None,
            failure: Some(Failure::new(
                FailureClass::Numerics,
                "the beat diverged at t = 43 ms: volume below zero",
            )),
            cost: None,
            relative_differences: BTreeMap::new(),
        });
    }
    let quality = if stalled {
        Step1Quality::Stalled {
            reason: StallReason::SimulationFailed,
        }
    } else {
        Step1Quality::Converged
    };
    let taken = printed.iterations;
    let step1 = Step1Summary {
        quality,
        best_iteration: taken,
        cost: iterations[taken as usize - 1]
            .cost
            .expect("a simulation that succeeded has a cost"),
        first_converged: (!stalled).then_some(taken),
        parameters: parameters(printed.organ),
    };

    let targets = CellBiomarkers {
        sa_max_kpa: 0.42 * printed.organ[0],
        dsadt_max_kpa_per_ms: 1.61,
        std30_ms: 0.62 * printed.clinical[3],
        std50_ms: 0.81 * printed.clinical[3],
        std90_ms: 1.02 * printed.clinical[3],
        lambda_min: 0.828,
    };
    let reached = CellBiomarkers {
        dsadt_max_kpa_per_ms: 2.2,
        std50_ms: 0.86 * printed.clinical[3],
        ..targets
    };
    let median = cell(
        cycle,
        targets.sa_max_kpa,
        45.0,
        printed.clinical[3] + 20.0,
        0.828,
        None,
    );
    let fitted = cell(
        cycle,
        0.99 * targets.sa_max_kpa,
        32.0,
        printed.clinical[3] + 52.0,
        0.829,
        Some((printed.cell[5], printed.cell[6])),
    );
    let bounds = &plan.settings.step2.bounds;
    let fitted_parameters = std::iter::zip(CELL, printed.cell)
        .chain([("a_p_kPa", 47.3 + 3.0 * f64::from(taken))])
        .map(|(name, value)| {
            let [lower, upper] = bounds[name];
            let near = |bound: f64| (value - bound).abs() < 2e-3 * (upper - lower);
            FittedParameter {
                name: name.into(),
                value,
                lower,
                upper,
                at_bound: near(lower) || near(upper),
                near_optimal: None,
            }
        });
    let fit_cost = 0.05 + 0.01 * f64::from(taken);
    let fit = CellFitResult {
        lambda_0: 1.0,
        parameters: fitted_parameters.collect(),
        reached,
        targets,
        cost: fit_cost,
        cost_terms: BTreeMap::from([
            ("Sa_max_kPa".into(), 0.002),
            ("dSadt_max_kPa_per_ms".into(), 0.031),
            ("STD50_ms".into(), 0.0121),
            ("penalty_resting_stress".into(), 0.004),
        ]),
        evaluations: printed.evaluations,
        generations: printed.evaluations / 150,
        converged: true,
        unreachable_targets: if stalled {
            vec!["Sa_max 92.6 kPa: the cell reaches 88 kPa at most; a larger Smax_ref would reach it".into()]
        } else {
            Vec::new()
        },
        identifiability: None,
    };
    let (traces, gap, times) = simulated(&p, &v, cycle, &printed.step2, 11.0);
    let verification = beat(biomarkers(printed.step2, edv, Some(gap)), times);
    let clinical = biomarkers(printed.clinical, edv, None);
    // The printed results say nothing of the volume at the beat's end: the one made up here does not
    // count.
    let tolerances = TwinTolerances {
        volume_gap: 100.0,
        ..TwinTolerances::default()
    };
    let verdict = Verdict::of(&clinical, &verification.biomarkers, &tolerances);
    let seed = plan.settings.step2.seed;
    PatientRecord {
        status: status(id, "done", "done"),
        step0: Some(folder.record("step0", id, &[], 0.012, None, step0)),
        iterations,
        step1: Some(step1),
        targets: Some(folder.record(
            "targets",
            id,
            &[("median", median)],
            0.004,
            None,
            TargetsResult {
                lambda_0: 1.0,
                lambda_max: 1.0,
                targets,
                n_nodes: 16,
                has_calcium: false,
            },
        )),
        cell_fit: Some(folder.record(
            "cell-fit",
            id,
            &[
                ("cell", fitted),
                ("convergence", convergence(printed.evaluations, fit_cost)),
            ],
            14.2,
            Some(seed),
            fit,
        )),
        organ_fit: None,
        law: None,
        other_wall_s: 0.0,
        verification: Some(folder.record(
            "verification",
            id,
            &[("traces", traces)],
            0.021,
            None,
            verification,
        )),
        verification_cost: Some(cost(&printed.step2, &printed.clinical)),
        step3_iterations: vec![],
        step3: None,
        posterior: None,
        posterior_failure: None,
        verdict: Some(verdict),
        failure: None,
        before: None,
        plan,
    }
}

fn run(root: &Path, name: &str, patients: Vec<PatientRecord>) -> RunRecord {
    RunRecord {
        schema_version: cardiotwin_schemas::formats::RUN_RECORD.version,
        cohort: name.into(),
        description: "Measured traces of the bundled cohort with the numbers of Jung et al. 2022"
            .into(),
        run_directory: root.to_owned(),
        as_of: "2026-03-04T05:07:08.901Z".into(),
        version: "0.1.0".into(),
        revision: "1".into(),
        patients,
        refused: Vec::new(),
    }
}

/// The paper's seven patients, all finished, with 04-CoA stalled.
pub fn cohort(root: &Path) -> RunRecord {
    let folder = Folder { root };
    run(
        root,
        "coa-seven",
        PRINTED.iter().map(|p| finished(&folder, p, p.id)).collect(),
    )
}

/// `n` copies of one patient under numbered names.
pub fn many(root: &Path, n: usize) -> RunRecord {
    let one = finished(&Folder { root }, &PRINTED[0], "P0001");
    let patients = (1..=n).map(|k| {
        let mut patient = one.clone();
        patient.plan.id = PatientId(format!("P{k:04}"));
        patient
    });
    run(root, "many", patients.collect())
}

/// Patients with missing data or failures.
pub fn troubled(root: &Path) -> RunRecord {
    let folder = Folder { root };
    let [a, b, c, d] = [0, 1, 2, 4].map(|i| &PRINTED[i]);

    let mut pressure_only = finished(&folder, a, "pressure-only");
    pressure_only.plan.step0.volume = None;
    if let Some(step0) = &mut pressure_only.step0 {
        step0.result.measured = Biomarkers {
            sv_ml: None,
            tau_vd_ms: None,
            tau_vr_ms: None,
            esv_ml: None,
            ..step0.result.measured
        };
        step0.result.time_points = TimePoints {
            t4_ms: None,
            t5_ms: None,
            t6_ms: None,
            t7_ms: None,
            ..step0.result.time_points
        };
    }

    let mut no_passive_state = finished(&folder, b, "no-passive-state");
    no_passive_state.status = status("no-passive-state", "step-0", "failed");
    no_passive_state.failure = Some(Failure {
        class: FailureClass::Input,
        message: "the unloaded volume 131 mL is larger than the diastasis volume 124 mL".into(),
        remedy: Some("check measured.diastasis in patient.toml".into()),
        cause: None,
    });
    clear_after(&mut no_passive_state, 0);
    no_passive_state.step0 = None;

    let mut first_beat_failed = finished(&folder, c, "first-beat-failed");
    let failure = Failure::new(
        FailureClass::Numerics,
        "the beat diverged at t = 81 ms: Newton did not converge",
    );
    first_beat_failed.status = status("first-beat-failed", "step-1", "failed");
    clear_after(&mut first_beat_failed, 1);
    first_beat_failed.iterations[0].run = None;
    first_beat_failed.iterations[0].cost = None;
    first_beat_failed.iterations[0].failure = Some(failure.clone());
    first_beat_failed.failure = Some(failure);

    let mut running = finished(&folder, d, "running");
    running.status = status("running", "step-1", "running");
    clear_after(&mut running, 2);

    let mut files_lost = finished(&folder, a, "files-lost");
    files_lost
        .verification
        .as_mut()
        .expect("finished")
        .directory = root.join("gone");
    std::fs::write(
        files_lost
            .cell_fit
            .as_ref()
            .and_then(|r| r.artefact("convergence"))
            .expect("finished"),
        "generation\n1\n",
    )
    .expect("a temporary folder takes files");

    let mut waiting = finished(&folder, b, "not-begun");
    waiting.status = status("not-begun", "-", "waiting");
    clear_after(&mut waiting, 0);
    waiting.step0 = None;

    let patients = vec![
        pressure_only,
        no_passive_state,
        first_beat_failed,
        running,
        files_lost,
        waiting,
    ];
    run(root, "troubled <&> \"quoted\"", patients)
}

fn clear_after(patient: &mut PatientRecord, iterations: usize) {
    patient.iterations.truncate(iterations);
    patient.step1 = None;
    patient.targets = None;
    patient.cell_fit = None;
    patient.verification = None;
    patient.verification_cost = None;
    patient.verdict = None;
}
