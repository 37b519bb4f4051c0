//! Step 0 of the finite-element ventricle: mesh, fibres, activation, unloaded geometry and
//! stiffness, in one artefact.
//!
//! Artefact: `ventricle.bin` (`ventricle`), see [`crate::finite_element::stored`].

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::Instant;

use cardiotwin_mechanics::organ::{
    Anatomy, FoundState, PassiveFit, PassiveJob, PassiveStateError, RightPressure, Search,
    SearchProgress, UnloadingSettings,
};
use cardiotwin_mechanics::tissue::TissueJob;
use cardiotwin_mesh::eikonal::{Conduction, Speeds};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::frames_at_centroids;
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::quality::Quality;
use cardiotwin_mesh::tags;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};
use cardiotwin_models::effects::{EffectError, EffectSetting, InThreeDimensions};
use cardiotwin_models::ventricle::passive_state::klotz_unloaded_volume;
use cardiotwin_schemas::finite_element::{
    AnatomySpec, FiniteElementOrgan, VentricleFigures, WallSettings,
};
use cardiotwin_schemas::muscle::MuscleLaw;
use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::settings::StartMode;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_signals::image::is_before_end_diastole;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg};

use super::measurements::{EndDiastole, Measurements};
use super::onset::onset_ms;
use super::own_mesh::{Taken, take};
use super::passive_tags;
use crate::context::Context;
use crate::error::TaskError;
use crate::finite_element::passive::{Workers, found};
use crate::finite_element::right_ventricle;
use crate::finite_element::stored::About;
use crate::finite_element::{FiniteElementError, StoredVentricle, tissue, wall};

/// Number of nodes in the first mesh on which the passive law is fitted, if the final mesh has more
/// than four times as many. Each further mesh has eight times as many nodes.
const FIRST_NODES: u32 = 1000;

/// Initial factor of the exponents in their search; most hearts need about this value.
const USUAL_FACTOR: f64 = 0.85;

/// Organ from step 0, with the costs of making it.
pub(super) struct Made {
    pub(super) organ: FiniteElementOrgan,
    pub(super) counters: BTreeMap<String, f64>,
    pub(super) remarks: Vec<String>,
}

/// Image for which the mesh is made, and the volumes and pressures to which the stiffness is
/// fitted.
struct Target {
    image_ml: f64,
    image_pressure_mmhg: f64,
    end_diastole: EndDiastole,
    /// Volume at zero pressure.
    unloaded_ml: f64,
    /// Whether the image shows the heart before end-diastole.
    before_end_diastole: bool,
}

impl Target {
    /// An image of `volume_ml`, assumed to be at end-diastolic pressure.
    fn loaded(volume_ml: f64, end: EndDiastole) -> Self {
        Self {
            image_ml: volume_ml,
            image_pressure_mmhg: end.pressure_mmhg,
            end_diastole: EndDiastole { volume_ml, ..end },
            unloaded_ml: klotz_unloaded_volume(Ml(volume_ml), Mmhg(end.pressure_mmhg)).0,
            before_end_diastole: false,
        }
    }

    fn of(
        spec: &PassiveStateSpec,
        measured: &Measurements,
        end: EndDiastole,
        remarks: &mut Vec<String>,
    ) -> Self {
        let loaded = |volume_ml| Self::loaded(volume_ml, end);
        let pressure = measured
            .pressure
            .as_ref()
            .zip(spec.diastasis_time_ms)
            .map(|(trace, time)| trace.at(time));
        match (spec.start, spec.diastasis_volume_ml, pressure) {
            (StartMode::Diastasis, Some(volume), _) => loaded(volume),
            (StartMode::EndDiastole, Some(volume), Some(pressure)) => {
                let unloaded_ml =
                    klotz_unloaded_volume(Ml(end.volume_ml), Mmhg(end.pressure_mmhg)).0;
                let at_end = (Ml(end.volume_ml), Mmhg(end.pressure_mmhg));
                if is_before_end_diastole((Ml(volume), Mmhg(pressure)), at_end) {
                    return Self {
                        image_ml: volume,
                        image_pressure_mmhg: pressure,
                        end_diastole: end,
                        unloaded_ml,
                        before_end_diastole: true,
                    };
                }
                remarks.push(format!(
                    "diastasis ({volume:.1} mL, {pressure:.2} mmHg) is not between Klotz's unloaded volume ({unloaded_ml:.1} mL) \
                     and end-diastole ({:.1} mL, {:.2} mmHg): the mesh is made for end-diastole",
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
        let unloaded_volume_mm3 = 1e3 * self.unloaded_ml;
        if stiffness_given {
            PassiveFit::Given {
                image_pressure_kpa,
                end_diastolic_pressure_kpa,
            }
        } else if self.before_end_diastole {
            PassiveFit::ThreePoints {
                image_pressure_kpa,
                end_diastolic_pressure_kpa,
                end_diastolic_volume_mm3: 1e3 * self.end_diastole.volume_ml,
                unloaded_volume_mm3,
            }
        } else {
            PassiveFit::Unloaded {
                end_diastolic_pressure_kpa,
                unloaded_volume_mm3,
            }
        }
    }
}

/// Mesh with fibres, and activation times of its nodes from the first activation on. Adds the wall
/// times of mesh, fibres and activation to `seconds`.
///
/// - `own`: the patient's own mesh as it was read; without it, an ellipsoid with `n_nodes` is
///   generated
fn mesh(
    anatomy: &AnatomySpec,
    own: Option<Taken>,
    n_nodes: u32,
    (image_ml, wall_ml): (f64, f64),
    workers: Workers<'_>,
    seconds: &mut [f64; 3],
) -> Result<(TetMesh, Vec<f64>), FiniteElementError> {
    let begun = Instant::now();
    let Taken {
        mut mesh,
        times_ms,
        sites,
        ..
    } = match own {
        Some(taken) => taken,
        None => {
            let made = generate(&EllipsoidSpec::new(
                Ml(image_ml),
                Ml(wall_ml),
                n_nodes as usize,
            ))?;
            let mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
            let sites = made.shape.fascicles().to_vec();
            Taken {
                mesh,
                times_ms: None,
                sites,
                cavity_ml: image_ml,
                wall_ml,
                beside: BTreeSet::new(),
                right_cavity_ml: None,
            }
        }
    };
    let meshed = begun.elapsed().as_secs_f64();
    let muscle = vec![tags::LEFT_VENTRICLE];
    let passive = mesh
        .tags
        .iter()
        .copied()
        .filter(|tag| !muscle.contains(tag));
    passive_tags::check(&anatomy.wall.passive, passive)?;
    sprung_surfaces(&anatomy.wall, &mesh)?;
    let fibres = mesh.frames.is_empty().then_some(anatomy.fibres);
    let speeds = &anatomy.conduction;
    let conduction = times_ms.is_none().then(|| Conduction {
        speeds: Speeds {
            fibre: speeds.along_m_per_s,
            sheet: speeds.across_m_per_s,
            normal: speeds.across_m_per_s,
        },
        endocardial_speed: (speeds.endocardium_m_per_s > 0.0).then_some(speeds.endocardium_m_per_s),
        tags: muscle.clone(),
        sites,
    });
    let job = TissueJob {
        muscle,
        fibres,
        conduction,
    };
    let fibres_done = OnceLock::new();
    let made = tissue::found(&job, &mesh, workers, &|| {
        _ = fibres_done.set(begun.elapsed().as_secs_f64())
    })?;
    if job.fibres.is_some() {
        mesh.fibres = made.fibres;
        mesh.frames = frames_at_centroids(&mesh, &job.muscle);
    }
    let times = times_ms.map_or(made.activation_ms, from_the_first);
    let fibred = fibres_done.into_inner().unwrap_or(meshed);
    let activated = begun.elapsed().as_secs_f64();
    for (sum, own) in seconds
        .iter_mut()
        .zip([meshed, fibred - meshed, activated - fibred])
    {
        *sum += own;
    }
    Ok((mesh, times))
}

/// Checks that the mesh has all surfaces for which springs are given.
fn sprung_surfaces(wall: &WallSettings, mesh: &TetMesh) -> Result<(), FiniteElementError> {
    match wall
        .surface
        .keys()
        .find(|name| mesh.surface(name).is_none())
    {
        Some(name) => {
            let found = mesh
                .surfaces
                .iter()
                .map(|surface| surface.name.clone())
                .collect();
            Err(FiniteElementError::SprungSurface {
                name: name.clone(),
                found,
            })
        }
        None => Ok(()),
    }
}

/// Anatomy of the generated mesh on which the law of a patient's own mesh is fitted first, without
/// the settings that refer to that mesh alone.
fn of_a_stand_in(spec: &AnatomySpec) -> AnatomySpec {
    let mut plain = spec.clone();
    plain.wall.passive.clear();
    plain.wall.surface.clear();
    plain
}

/// Times relative to the earliest one; nodes without a time are never activated.
fn from_the_first(times: Vec<f64>) -> Vec<f64> {
    let first = times
        .iter()
        .copied()
        .filter(|t| t.is_finite())
        .fold(f64::INFINITY, f64::min);
    times
        .into_iter()
        .map(|t| {
            if t.is_finite() {
                t - first
            } else {
                f64::INFINITY
            }
        })
        .collect()
}

/// Factor of the exponents due to the patient's effects.
fn exponent_factor(anatomy: &AnatomySpec) -> Result<f64, TaskError> {
    let mut factor = 1.0;
    for spec in &anatomy.effects {
        let setting = EffectSetting::named(&spec.name, &spec.parameters)?;
        if let InThreeDimensions::PassiveExponents { factor: name } = setting.effect.in_3d {
            if anatomy.wall.muscle_law == MuscleLaw::NeoHookean && !setting.is_off() {
                return Err(EffectError::NotInThreeDimensions {
                    effect: setting.effect.name,
                    why: "it multiplies exponents, and the neo-Hookean muscle has none",
                }
                .into());
            }
            factor *= setting.parameters().get(name).copied().unwrap_or(1.0);
        }
    }
    Ok(factor)
}

/// A search's progress in words.
fn said(p: &SearchProgress) -> String {
    let residual = p
        .relative_residual
        .map_or_else(String::new, |residual| format!(", residual {residual:.0e}"));
    format!(
        "law {}, pass {}: {:.2} kPa, {} Newton and {} linear iterations so far{residual}",
        p.trials, p.passes, p.pressure_kpa, p.work.newton_iterations, p.work.krylov_iterations
    )
}

/// Searches for the passive state, on the context's team or threads if the mesh is large.
fn searched(
    mesh: &TetMesh,
    anatomy: &Anatomy,
    job: &PassiveJob,
    subdomains: u32,
    context: &mut Context,
) -> Result<FoundState, TaskError> {
    let team = context.team.clone();
    let workers = Workers::of(team.as_ref(), context.parts(subdomains));
    let mut watch = |p: &SearchProgress| {
        context
            .progress
            .report("unloading", p.work.newton_iterations as f64, None, || {
                said(p)
            });
        match context.check_stop() {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    };
    let mut search = Search::watched(UnloadingSettings::for_anatomy(anatomy), &mut watch);
    found(job, anatomy, workers, &mut search).map_err(|error| match error {
        PassiveStateError::Stopped => TaskError::Cancelled,
        error @ PassiveStateError::TooMuchWork { .. } => {
            TaskError::FiniteElement(FiniteElementError::too_much_work(mesh, error))
        }
        error => TaskError::FiniteElement(error.into()),
    })
}

/// A mesh with the law that was fitted on it.
struct Built {
    mesh: TetMesh,
    /// Activation times of its nodes \[ms\].
    times: Vec<f64>,
    degrees_of_freedom: usize,
    state: FoundState,
    /// Factor of all exponents.
    exponent_factor: f64,
    /// Wall times of mesh, fibres, activation and fit \[s\].
    seconds: [f64; 4],
}

/// Mesh, fibres, activation and passive state for a target. For a large mesh, the law is fitted on
/// a smaller one first.
///
/// - `right`: pressure of the right ventricle, if the patient's own mesh has one
fn build(
    spec: &AnatomySpec,
    wall_ml: f64,
    of_effects: f64,
    target: &Target,
    (given, mut own, right): (bool, Option<Taken>, Option<RightPressure>),
    context: &mut Context,
) -> Result<Built, TaskError> {
    let goal = target.fit(given);
    let first_factor = match goal {
        PassiveFit::Given { .. } => of_effects,
        PassiveFit::ThreePoints { .. } => USUAL_FACTOR,
        PassiveFit::Unloaded { .. } | PassiveFit::ImageUnloaded { .. } => 1.0,
    };
    let wall = wall::parameters(&spec.wall, first_factor, 0.0);
    let mut job = PassiveJob {
        wall,
        target: goal,
        slope: None,
        steepened_by: None,
    };
    let begun = Instant::now();
    let mut seconds = [0.0; 3];
    let mut sizes = vec![];
    let mut smaller = FIRST_NODES;
    let last = own
        .as_ref()
        .map_or(spec.mesh_nodes, |own| own.mesh.n_nodes() as u32);
    while !given && last > 4 * smaller {
        sizes.push(smaller);
        smaller *= 8;
    }
    sizes.push(last);
    for n_nodes in sizes {
        context.check_stop()?;
        context
            .progress
            .report("mesh", 0.0, None, || format!("about {n_nodes} nodes"));
        let stand_in = (own.is_some() && n_nodes < last).then(|| of_a_stand_in(spec));
        let taken = if n_nodes == last { own.take() } else { None };
        let workers = Workers::of(context.team.as_ref(), context.parts(spec.subdomains));
        let volumes = (target.image_ml, wall_ml);
        let made_of = stand_in.as_ref().unwrap_or(spec);
        let (mesh, times) = mesh(made_of, taken, n_nodes, volumes, workers, &mut seconds)?;
        let element = wall::element(spec.element, spec.wall.pointwise_share);
        let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], element)
            .map_err(FiniteElementError::from)?;
        let degrees_of_freedom = 3 * anatomy.nodes.len();
        context.progress.report("unloading", 0.0, None, || {
            format!(
                "{} nodes, {} tetrahedra, {degrees_of_freedom} degrees of freedom",
                mesh.n_nodes(),
                mesh.n_tets()
            )
        });
        if n_nodes < last {
            match searched(&mesh, &anatomy, &job, spec.subdomains, context) {
                Ok(found) => (job.wall.muscle, job.slope) = (found.wall.muscle, found.slope),
                Err(TaskError::Cancelled) => return Err(TaskError::Cancelled),
                // If the small mesh has no law, the large one reports the error.
                Err(_) => {}
            }
            continue;
        }
        // The law is fitted to the measured data. The patient's effects then steepen it around the
        // same end-diastole, as in the reduced ventricle.
        job.wall.right_pressure.clone_from(&right);
        job.steepened_by = (!given && of_effects != 1.0).then_some(of_effects);
        let state = searched(&mesh, &anatomy, &job, spec.subdomains, context)?;
        let exponents = state
            .wall
            .muscle
            .exponent()
            .zip(wall::muscle(&spec.wall).exponent());
        let exponent_factor = exponents.map_or(1.0, |(found, own)| found / own);
        let [meshed, fibres, activation] = seconds;
        let seconds = [
            meshed,
            fibres,
            activation,
            begun.elapsed().as_secs_f64() - meshed - fibres - activation,
        ];
        return Ok(Built {
            mesh,
            times,
            degrees_of_freedom,
            state,
            exponent_factor,
            seconds,
        });
    }
    unreachable!("the last size returns")
}

/// Makes the ventricle and writes its file.
///
/// # Errors
/// [`TaskError::FiniteElement`] when mesh, fibres, activation or passive state fail.
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
    let of_effects = exponent_factor(anatomy_spec)?;
    let mut adapted = anatomy_spec.clone();
    if let Some(given) = spec.guccione_c_kpa {
        if adapted.wall.muscle_law != MuscleLaw::Guccione {
            return Err(FiniteElementError::StiffnessOfAnotherLaw {
                law: wall::muscle(&adapted.wall).name(),
            }
            .into());
        }
        adapted.wall.guccione_c_kpa = given;
    }
    let given = spec.guccione_c_kpa.is_some();
    let mut target = Target::of(spec, measured, end_diastole, &mut remarks);
    let named = std::mem::take(&mut adapted.wall.passive);
    let sprung: Vec<&str> = anatomy_spec
        .wall
        .surface
        .keys()
        .map(String::as_str)
        .collect();
    let own = spec
        .own_mesh
        .as_ref()
        .map(|own| take(own, target.image_ml, &named, &sprung))
        .transpose()?;
    adapted.wall.passive = own.as_ref().map_or_else(
        || named.clone(),
        |own| passive_tags::renamed(&named, &own.beside),
    );
    let right = spec
        .own_mesh
        .as_ref()
        .and_then(|own| own.right_ventricle.as_ref());
    if let Some(right) = right
        && let Some(spring) = adapted.wall.surface.remove(&right.surface)
    {
        adapted
            .wall
            .surface
            .insert(surface_names::RIGHT_VENTRICLE.to_owned(), spring);
    }
    // The volumes of wall and image are the mesh's own, whatever other images gave.
    let wall_ml = own.as_ref().map_or(wall_ml, |own| own.wall_ml);
    if let Some(own) = &own {
        if target.before_end_diastole {
            target.image_ml = own.cavity_ml;
        } else {
            target = Target::loaded(own.cavity_ml, end_diastole);
        }
    }
    let end_mmhg = target.end_diastole.pressure_mmhg;
    let right = right
        .map(|own| right_ventricle::read(&own.pressure, spec.cycle_length_ms, end_mmhg))
        .transpose()?;
    if let (Some(right), Some(volume_ml)) =
        (&right, own.as_ref().and_then(|own| own.right_cavity_ml))
    {
        count("right_ventricular_volume_mL", volume_ml);
        remarks.push(format!(
            "the right ventricle is passive: {volume_ml:.1} mL in the image, {:.1} mmHg at end-diastole",
            right.course.at(0.0) * MMHG_PER_KPA
        ));
    }
    let right_pressure = right.clone();
    let built = match build(
        &adapted,
        wall_ml,
        of_effects,
        &target,
        (given, own, right),
        context,
    ) {
        // A patient's own mesh cannot be replaced by one made for end-diastole.
        Err(TaskError::FiniteElement(error))
            if target.before_end_diastole && !given && spec.own_mesh.is_none() =>
        {
            remarks.push(format!(
                "{error}: the mesh is made for end-diastole, with Klotz's unloaded volume alone"
            ));
            target = Target::loaded(end_diastole.volume_ml, end_diastole);
            build(
                &adapted,
                wall_ml,
                of_effects,
                &target,
                (given, None, None),
                context,
            )?
        }
        built => built?,
    };
    let Built {
        mesh,
        times,
        degrees_of_freedom,
        state,
        exponent_factor,
        seconds,
    } = built;
    let mut activated: Vec<f64> = times.iter().copied().filter(|t| t.is_finite()).collect();
    activated.sort_by(f64::total_cmp);
    let (middle, spread_ms) = (
        activated[activated.len() / 2],
        activated.last().copied().unwrap_or_default(),
    );
    let onset_ms = onset_ms(spec, measured, 2.0 * middle, estimates);
    if exponent_factor != of_effects {
        estimates.push(Estimate {
            key: "passive.exponent_factor".to_owned(),
            value: exponent_factor / of_effects,
            sd: None,
            method: format!(
                "with the stiffness of {}'s law, so that unloaded volume (Klotz 2006), image and end-diastole are met",
                state.wall.muscle.name()
            ),
        });
    }
    let names = [
        "seconds_mesh",
        "seconds_fibres",
        "seconds_activation",
        "seconds_unloading",
    ];
    for (name, seconds) in names.into_iter().zip(seconds) {
        count(name, seconds);
    }
    let quality = Quality::of(&mesh);
    count("mesh_edge_shortest_mm", quality.min_edge_mm);
    count("mesh_edge_longest_mm", quality.max_edge_mm);
    count("mesh_mean_ratio_least", quality.min);
    count("mesh_mean_ratio_mean", quality.mean);
    count("mesh_dihedral_largest_deg", quality.max_dihedral_deg);
    count("newton_iterations", state.newton_iterations as f64);
    count("krylov_iterations", state.krylov_iterations as f64);
    count("unloading_passes", state.passes as f64);

    let FoundState {
        end_diastole: found,
        wall: fitted,
        ..
    } = state;
    adapted.wall = wall::with_stiffness(&adapted.wall, fitted.muscle.stiffness_kpa());
    let volumes = (1e-3 * state.unloaded_volume_mm3, 1e-3 * state.volume_mm3);
    let figures = VentricleFigures {
        nodes: mesh.n_nodes() as u64,
        elements: mesh.n_tets() as u64,
        degrees_of_freedom: degrees_of_freedom as u64,
        mean_edge_mm: mesh.mean_edge_mm(),
        wall_volume_ml: wall_ml,
        image_volume_ml: target.image_ml,
        image_pressure_mmhg: target.image_pressure_mmhg,
        unloaded_volume_ml: volumes.0,
        end_diastolic_volume_ml: volumes.1,
        end_diastolic_pressure_mmhg: target.end_diastole.pressure_mmhg,
        stiffness_kpa: fitted.muscle.stiffness_kpa(),
        exponent_factor,
        onset_ms,
        spread_ms,
        epicardial_duration_share: adapted.wall.epicardial_duration_share,
    };
    let stored = StoredVentricle {
        about: About {
            element: anatomy_spec.element,
            wall: adapted.wall,
            exponent_factor,
            effects_exponent_factor: of_effects,
            end_diastolic_pressure_kpa: found.pressure_kpa,
            surfaces: mesh.surfaces.iter().map(|s| s.name.clone()).collect(),
            is_own_mesh: spec.own_mesh.is_some(),
            right_pressure,
        },
        activation_ms: times,
        unloaded: found.unloaded,
        anchor: found.anchor,
        u: found.u,
        mesh,
    };
    let ventricle =
        context
            .artefacts
            .write_bytes("ventricle", "ventricle.bin", &stored.to_bytes())?;
    let volume_error_ml = volumes.1 - target.end_diastole.volume_ml;
    count("end_diastolic_volume_error_mL", volume_error_ml);
    if volume_error_ml.abs() > 0.01 * target.end_diastole.volume_ml {
        remarks.push(format!(
            "end-diastolic volume minus the measured one: {volume_error_ml:.1} mL"
        ));
    }
    Ok(Made {
        organ: FiniteElementOrgan { ventricle, figures },
        counters,
        remarks,
    })
}
