//! Step 0 of the finite-element ventricle: mesh, fibres, activation, unloaded geometry and stiffness, in one artefact.
//!
//! Artefact: `ventricle.bin` (`ventricle`), see [`crate::finite_element::stored`].

use std::collections::BTreeMap;
use std::time::Instant;

use cardiotwin_mechanics::organ::passive_state::fit;
use cardiotwin_mechanics::organ::{
    Anatomy, PassiveFit, PassiveState, PassiveStateError, UnloadingSettings, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::eikonal::{Conduction, Speeds, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{Angles, Longitudinal, fields, frames};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_mesh::tet_mesh::TetMesh;
use cardiotwin_models::effects::{EffectSetting, InThreeDimensions};
use cardiotwin_models::ventricle::passive_state::klotz_unloaded_volume;
use cardiotwin_schemas::finite_element::{AnatomySpec, FiniteElementOrgan, VentricleFigures};
use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::settings::StartMode;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg};

use super::{EndDiastole, Measurements, onset_ms};
use crate::context::Context;
use crate::error::TaskError;
use crate::finite_element::stored::About;
use crate::finite_element::{FiniteElementError, StoredVentricle, wall};

/// Where no stiffness fits, the law's exponents are lowered by this factor, again and again …
const SOFTER: f64 = 0.7;
/// … so many times at most.
const MOST_SOFTENINGS: usize = 5;

/// What step 0 made, and what it cost.
pub(super) struct Made {
    pub(super) organ: FiniteElementOrgan,
    pub(super) counters: BTreeMap<String, f64>,
    pub(super) remarks: Vec<String>,
}

/// The image that the mesh is made for, and what the stiffness is fitted to.
struct Target {
    image_ml: f64,
    image_pressure_mmhg: f64,
    end_diastole: EndDiastole,
    /// Volume without pressure, where the image is end-diastole.
    unloaded_ml: Option<f64>,
}

impl Target {
    fn of(spec: &PassiveStateSpec, measured: &Measurements, end: EndDiastole, remarks: &mut Vec<String>) -> Self {
        let klotz = |volume_ml: f64| klotz_unloaded_volume(Ml(volume_ml), Mmhg(end.pressure_mmhg)).0;
        let loaded = |volume_ml: f64| Self {
            image_ml: volume_ml,
            image_pressure_mmhg: end.pressure_mmhg,
            end_diastole: EndDiastole { volume_ml, ..end },
            unloaded_ml: Some(klotz(volume_ml)),
        };
        let pressure = measured.pressure.as_ref().zip(spec.diastasis_time_ms).map(|(trace, time)| trace.at(time));
        match (spec.start, spec.diastasis_volume_ml, pressure) {
            (StartMode::Diastasis, Some(volume), _) => loaded(volume),
            (StartMode::EndDiastole, Some(volume), Some(pressure)) => {
                if pressure > 0.0 && pressure < end.pressure_mmhg && volume < end.volume_ml {
                    return Self {
                        image_ml: volume,
                        image_pressure_mmhg: pressure,
                        end_diastole: end,
                        unloaded_ml: None,
                    };
                }
                remarks.push(format!(
                    "diastasis ({volume:.1} mL, {pressure:.2} mmHg) is not below end-diastole ({:.1} mL, {:.2} mmHg): \
                     the mesh is made for end-diastole, the unloaded volume is Klotz's",
                    end.volume_ml, end.pressure_mmhg
                ));
                loaded(end.volume_ml)
            }
            _ => loaded(end.volume_ml),
        }
    }

    fn fit(&self, stiffness_given: bool) -> PassiveFit {
        let kpa = |mmhg: f64| mmhg / MMHG_PER_KPA;
        let image_pressure_kpa = kpa(self.image_pressure_mmhg);
        let end_diastolic_pressure_kpa = kpa(self.end_diastole.pressure_mmhg);
        match self.unloaded_ml {
            _ if stiffness_given => PassiveFit::Given { image_pressure_kpa, end_diastolic_pressure_kpa },
            Some(volume) => PassiveFit::Unloaded { end_diastolic_pressure_kpa, unloaded_volume_mm3: 1e3 * volume },
            None => PassiveFit::EndDiastole {
                image_pressure_kpa,
                end_diastolic_pressure_kpa,
                end_diastolic_volume_mm3: 1e3 * self.end_diastole.volume_ml,
            },
        }
    }
}

/// Mesh with fibres, and activation times of its nodes from the first on.
fn mesh(anatomy: &AnatomySpec, image_ml: f64, wall_ml: f64) -> Result<(TetMesh, Vec<f64>), FiniteElementError> {
    let made = generate(&EllipsoidSpec::new(Ml(image_ml), Ml(wall_ml), anatomy.mesh_nodes as usize))?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    let muscle = [tags::LEFT_VENTRICLE];
    let found = fields(&mesh, &muscle, Longitudinal::FromBase)?;
    let f = &anatomy.fibres;
    let angles = Angles {
        alpha_endo_deg: f.alpha_endo_deg,
        alpha_epi_deg: f.alpha_epi_deg,
        beta_endo_deg: f.beta_endo_deg,
        beta_epi_deg: f.beta_epi_deg,
    };
    mesh.frames = frames(&mesh, &muscle, &found, &angles);
    let speeds = &anatomy.conduction;
    let conduction = Conduction {
        speeds: Speeds { fibre: speeds.along_m_per_s, sheet: speeds.across_m_per_s, normal: speeds.across_m_per_s },
        endocardial_speed: (speeds.endocardium_m_per_s > 0.0).then_some(speeds.endocardium_m_per_s),
        tags: muscle.to_vec(),
        sites: made.shape.fascicles().to_vec(),
    };
    let times = activation_ms(&mesh, &conduction)?;
    Ok((mesh, times))
}

/// Factor of the exponents that the patient's effects ask for.
fn exponent_factor(anatomy: &AnatomySpec) -> Result<f64, TaskError> {
    let mut factor = 1.0;
    for spec in &anatomy.effects {
        let setting = EffectSetting::named(&spec.name, &spec.parameters)?;
        if let InThreeDimensions::PassiveExponents { factor: name } = setting.effect.in_3d {
            factor *= setting.parameters().get(name).copied().unwrap_or(1.0);
        }
    }
    Ok(factor)
}

/// The fit, with exponents lowered until a stiffness fits: how much a ventricle grows between two pressures is limited by
/// them, however soft it is. Returns the factor by which they were lowered, too.
fn softened(
    anatomy: &Anatomy,
    spec: &AnatomySpec,
    factor: f64,
    target: &PassiveFit,
    context: &Context,
) -> Result<(PassiveState, WallParameters, f64), TaskError> {
    // Newton's method is linear in the unsymmetric part of the pressure's tangent, which counts in a small soft heart: more
    // iterations, and a residual that places nodes to a thousandth of the unloading's tolerance. Loads that small steps
    // cannot reach are given up soon: the next law is easier.
    let settings = UnloadingSettings::default();
    let newton = StepSettings { relative_tolerance: 1e-5, max_iterations: 40, ..settings.newton };
    let settings = UnloadingSettings { smallest_load: 0.02, newton, ..settings };
    let mut lowered = 1.0;
    for attempt in 0.. {
        context.check_stop()?;
        let mut wall = wall::parameters(&spec.wall, factor * lowered, 0.0);
        // What the exponents lose the scale has to gain.
        wall.muscle.c_kpa /= lowered;
        match fit(anatomy, &wall, target, &settings) {
            Ok((state, wall)) => return Ok((state, wall, lowered)),
            Err(error @ PassiveStateError::NoStiffness { .. }) if attempt < MOST_SOFTENINGS => {
                tracing::info!("exponents times {lowered:.3}: {error}");
                lowered *= SOFTER;
            }
            Err(error) => return Err(FiniteElementError::from(error).into()),
        }
    }
    unreachable!("the loop returns")
}

/// Makes the ventricle, and writes it.
///
/// # Errors
/// [`TaskError::FiniteElement`] when mesh, fibres, activation or passive state cannot be made.
pub(super) fn make(
    spec: &PassiveStateSpec,
    anatomy_spec: &AnatomySpec,
    measured: &Measurements,
    end_diastole: EndDiastole,
    wall_ml: f64,
    estimates: &mut Vec<Estimate>,
    context: &mut Context,
) -> Result<Made, TaskError> {
    let mut remarks = Vec::new();
    let mut counters = BTreeMap::new();
    let mut count = |name: &str, value: f64| counters.insert(name.to_owned(), value);
    let target = Target::of(spec, measured, end_diastole, &mut remarks);
    let begun = Instant::now();
    context.progress.report("mesh", 0.0, None, || format!("about {} nodes", anatomy_spec.mesh_nodes));
    let (mesh, times) = mesh(anatomy_spec, target.image_ml, wall_ml)?;
    let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], wall::element(anatomy_spec.element))
        .map_err(FiniteElementError::from)?;
    count("seconds_mesh", begun.elapsed().as_secs_f64());

    let mut activated: Vec<f64> = times.iter().copied().filter(|t| t.is_finite()).collect();
    activated.sort_by(f64::total_cmp);
    let (middle, spread_ms) = (activated[activated.len() / 2], activated.last().copied().unwrap_or_default());
    let onset_ms = onset_ms(spec, measured, 2.0 * middle, estimates);

    let begun = Instant::now();
    let dof = 3 * anatomy.nodes.len();
    context.progress.report("unloading", 0.0, None, || {
        format!("{} nodes, {} tetrahedra, {dof} degrees of freedom", mesh.n_nodes(), mesh.n_tets())
    });
    let of_effects = exponent_factor(anatomy_spec)?;
    let mut adapted = anatomy_spec.clone();
    if let Some(given) = spec.guccione_c_kpa {
        adapted.wall.guccione_c_kpa = given;
    }
    let goal = target.fit(spec.guccione_c_kpa.is_some());
    let (state, fitted, lowered) = softened(&anatomy, &adapted, of_effects, &goal, context)?;
    if lowered < 1.0 {
        remarks.push(format!(
            "no stiffness fits with the exponents of the settings: they were multiplied by {lowered:.3}"
        ));
        estimates.push(Estimate {
            key: "passive.exponent_factor".to_owned(),
            value: lowered,
            method: "lowered until a stiffness fits the volumes and pressures of image and end-diastole".to_owned(),
        });
    }
    count("seconds_unloading", begun.elapsed().as_secs_f64());
    count("newton_iterations", state.newton_iterations as f64);
    count("unloading_passes", state.passes as f64);

    adapted.wall.guccione_c_kpa = fitted.muscle.c_kpa;
    let exponent_factor = of_effects * lowered;
    let volumes = (1e-3 * state.unloaded_volume_mm3(), 1e-3 * state.volume_mm3());
    let figures = VentricleFigures {
        nodes: mesh.n_nodes() as u64,
        elements: mesh.n_tets() as u64,
        degrees_of_freedom: dof as u64,
        mean_edge_mm: mesh.mean_edge_mm(),
        wall_volume_ml: wall_ml,
        image_volume_ml: target.image_ml,
        image_pressure_mmhg: target.image_pressure_mmhg,
        unloaded_volume_ml: volumes.0,
        end_diastolic_volume_ml: volumes.1,
        end_diastolic_pressure_mmhg: target.end_diastole.pressure_mmhg,
        stiffness_kpa: fitted.muscle.c_kpa,
        exponent_factor,
        onset_ms,
        spread_ms,
    };
    let stored = StoredVentricle {
        about: About {
            element: anatomy_spec.element,
            wall: adapted.wall,
            exponent_factor,
            effects_exponent_factor: of_effects,
            end_diastolic_pressure_kpa: state.pressure_kpa,
            surfaces: mesh.surfaces.iter().map(|s| s.name.clone()).collect(),
        },
        activation_ms: times,
        unloaded: state.unloaded().to_vec(),
        anchor: state.anchor().to_vec(),
        u: state.u.clone(),
        mesh,
    };
    let ventricle = context.artefacts.write_bytes("ventricle", "ventricle.bin", &stored.to_bytes())?;
    let volume_error_ml = volumes.1 - target.end_diastole.volume_ml;
    count("end_diastolic_volume_error_mL", volume_error_ml);
    if volume_error_ml.abs() > 0.01 * target.end_diastole.volume_ml {
        remarks.push(format!("end-diastolic volume minus the measured one: {volume_error_ml:.1} mL"));
    }
    Ok(Made { organ: FiniteElementOrgan { ventricle, figures }, counters, remarks })
}
