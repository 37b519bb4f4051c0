//! A beat of the finite-element ventricle.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{
    ElementKind, FiniteElementVentricle, RankParts, VentricleParts, VentricleWork,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_observed};
use cardiotwin_models::cell0d::CellSolverSettings;
use cardiotwin_models::circulation::Circulation;
use cardiotwin_models::effects::{InThreeDimensionsParts, Surroundings, in_three_dimensions};
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_models::ventricle::{
    OneFibrePassive, PassiveLaw as _, Ventricle as _, end_diastolic_stretch,
};
use cardiotwin_schemas::finite_element::{
    EquationSettings, FiniteElementOrgan, FiniteElementSettings,
};
use cardiotwin_schemas::outcome::Ending;
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::circuit::{fill, loop_state};
use super::late_sector::LateSector;
use super::models::{
    closed_loop, contraction, effects, has_calcium, heart as left_heart, settings,
};
use super::potentials;
use super::result::{Seen, ending};
use crate::call::Call;
use crate::context::Context;
use crate::error::TaskError;
use crate::files;
use crate::finite_element::checkpoint::{BeatCheckpoint, Due, FILE};
use crate::finite_element::frames::Frames;
use crate::finite_element::heart::{self, Wall};
use crate::finite_element::motion::{Followed, Motion};
use crate::finite_element::rows::NodalRows;
use crate::finite_element::series::{self, Series};
use crate::finite_element::shapes::Shapes;
use crate::finite_element::stored::About;
use crate::finite_element::wall_means::WallMeans;
use crate::finite_element::{FiniteElementError, StoredVentricle, wall};
use crate::nodal;
use crate::team::{Session, Team};

/// Ventricle and circulation at the beginning of the beat.
pub(super) struct Organ {
    /// Work shared with the other processes, if any.
    pub(super) session: Option<Session>,
    pub(super) ventricle: FiniteElementVentricle,
    pub(super) circulation: Circulation,
    /// Number of nodes in the image's mesh. Once the ranks have their parts, only pictures need it.
    pub(super) n_nodes: usize,
    /// Parts whose motion is measured; `None` if the mesh has no landmarks.
    pub(super) followed: Option<Followed>,
    /// Wall that is drawn; `None` if the mesh has no cavity to look into.
    pub(super) drawn: Option<Wall>,
}

/// Simulates a beat of the ventricle from step 0.
///
/// # Errors
/// [`TaskError`] when the ventricle's file is not the planned one, an effect has no counterpart in
/// the model, or files cannot be written.
pub(super) fn run(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    context: &mut Context,
) -> Result<Ending, TaskError> {
    let begun = Instant::now();
    context.progress.report("setting up", 0.0, None, || {
        format!(
            "{} nodes, {} tetrahedra",
            organ.figures.nodes, organ.figures.elements
        )
    });
    // The session must outlive the ventricle; bindings are dropped in reverse order.
    let Organ {
        session: _session,
        mut ventricle,
        mut circulation,
        n_nodes,
        followed,
        drawn,
    } = assemble(spec, organ, context)?;
    fill(spec, ventricle.volume(), &mut circulation)?;
    let seconds_setup = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let length = spec.cycle_length_ms;
    let settings = BeatSettings {
        record_nodes: false,
        ..settings(spec)
    };
    let task = TaskSpec::OrganBeat(Box::new(spec.clone()))
        .key()
        .to_string();
    let earlier = BeatCheckpoint::first_of(&context.checkpoints.earlier_files(FILE), &task);
    let (mut before, mut resumed_at_ms) = (VentricleWork::default(), None);
    let mut series = begin_series(spec, organ, &ventricle, context)?;
    let mut shapes = Shapes::of(&ventricle, n_nodes);
    let mut motion =
        followed.map(|followed| Motion::begin(followed, &shapes, ventricle.unloaded_mm()));
    let mut frames =
        drawn.map(|wall| Frames::begin(wall, length, &shapes, ventricle.unloaded_mm()));
    let own = context.checkpoints.own_file(FILE);
    let directory = context.artefacts.directory().to_owned();
    let rows_folder = own
        .as_ref()
        .and_then(|file| file.parent())
        .unwrap_or(&directory);
    let not_kept = |source| TaskError::Write {
        file: rows_folder.to_owned(),
        source,
    };
    let mut resumed = None;
    let earlier = earlier.filter(|(checkpoint, file)| {
        let traces = &checkpoint.progress.traces;
        let rows = (
            file.parent().unwrap_or(file),
            checkpoint.progress.n_beats,
            traces.time_ms.len(),
        );
        match NodalRows::resume(
            rows_folder,
            rows,
            ventricle.nodes().len(),
            has_calcium(spec),
        ) {
            Ok(rows) => resumed = Some(rows),
            Err(error) => tracing::warn!(
                "checkpoint {} is left aside: its nodal traces: {error}",
                file.display()
            ),
        }
        resumed.is_some()
    });
    let mut rows = match resumed {
        Some(rows) => rows,
        None => NodalRows::begin(rows_folder, &ventricle, has_calcium(spec)).map_err(not_kept)?,
    };
    let from = match earlier {
        Some((
            BeatCheckpoint {
                progress,
                circulation: blood,
                ventricle: states,
                work,
                shapes: seen,
                motion: moved,
                frames: drawn,
            },
            file,
        )) => {
            ventricle.restore(&states).map_err(TaskError::Organ)?;
            circulation
                .restore(&blood)
                .map_err(TaskError::Circulation)?;
            tracing::info!("going on from a checkpoint at {} ms", ventricle.time().0);
            (before, resumed_at_ms) = (work, Some(ventricle.time().0));
            shapes = seen.resumed(&ventricle, n_nodes);
            if let Some(motion) = &mut motion {
                motion.resume(&shapes, ventricle.unloaded_mm(), &moved);
            }
            if let Some(frames) = &mut frames {
                frames.resume(&shapes, &drawn);
            }
            if let (Some(series), Some(attempt)) = (&mut series, file.ancestors().nth(2)) {
                series.resume(
                    attempt,
                    progress.n_beats,
                    ventricle.time().0 - progress.beat_start_ms,
                )?;
            }
            Some(progress)
        }
        None => None,
    };
    let mut due = Due::new(
        context.checkpoint_ms,
        context.checkpoint_apart,
        ventricle.time().0,
    );
    let outcome = run_observed(&mut ventricle, &mut circulation, &settings, from, |seen| {
        let time = seen.ventricle_time_ms();
        let beat = seen.progress.n_beats;
        shapes.observe(beat, seen.progress.intervals, seen.ventricle);
        if let Some(motion) = &mut motion {
            motion.observe(&shapes, seen.ventricle.unloaded_mm());
        }
        if let Some(frames) = &mut frames {
            let time_ms = time - seen.progress.beat_start_ms;
            frames.observe(&shapes, time_ms, seen.ventricle.unloaded_mm());
        }
        if let Err(source) =
            rows.observe((beat, seen.progress.traces.time_ms.len()), seen.ventricle)
        {
            return ControlFlow::Break(not_kept(source));
        }
        if let Some(series) = &mut series
            && let Err(error) =
                series.observe(beat, time - seen.progress.beat_start_ms, seen.ventricle)
        {
            return ControlFlow::Break(error);
        }
        let stop = context.check_stop();
        if let Some(file) = &own
            && (due.at(time) || stop.is_err() || context.stop.take_checkpoint())
        {
            let checkpoint = BeatCheckpoint {
                progress: seen.progress.clone(),
                circulation: seen.circulation.snapshot(),
                ventricle: seen.ventricle.snapshot(),
                work: sum(before, seen.ventricle.work()),
                shapes: shapes.clone(),
                motion: motion.as_ref().map(Motion::numbers).unwrap_or_default(),
                frames: frames.as_ref().map(Frames::numbers).unwrap_or_default(),
            };
            if let Err(source) = rows
                .sync()
                .and_then(|()| write(file, &checkpoint.to_bytes(&task)))
            {
                return ControlFlow::Break(TaskError::Checkpoint(source));
            }
            rows.forget_earlier();
        }
        if let Err(stop) = stop {
            return ControlFlow::Break(stop);
        }
        context.progress.report(
            "simulating",
            time - seen.progress.beat_start_ms,
            Some(length),
            || {
                let work = seen.ventricle.work();
                let newton = work.newton_iterations as f64 / work.steps.max(1) as f64;
                format!("beat {beat}: {time:.0} ms, {newton:.2} Newton iterations a step")
            },
        );
        ControlFlow::Continue(())
    });
    let outcome = match outcome {
        ControlFlow::Continue(outcome) => outcome,
        ControlFlow::Break(stopped) => return Err(stopped),
    };
    let work = sum(before, ventricle.work());
    let figures = &organ.figures;
    let mut counters: BTreeMap<String, f64> = [
        ("nodes", figures.nodes as f64),
        ("elements", figures.elements as f64),
        ("degrees_of_freedom", figures.degrees_of_freedom as f64),
        ("steps_tried", work.steps as f64),
        ("newton_iterations_tried", work.newton_iterations as f64),
        ("krylov_iterations", work.krylov_iterations as f64),
        ("factorisations", work.factorisations as f64),
        ("threads", ventricle.n_ranks() as f64),
        ("seconds_setup", seconds_setup),
        ("seconds_beat", begun.elapsed().as_secs_f64()),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into();
    counters.extend(resumed_at_ms.map(|time| ("resumed_at_ms".to_owned(), time)));
    if let Some(series) = &series {
        context.artefacts.write(
            "series",
            &format!("{}/{}", series::FOLDER, series::INDEX),
            &series.index(),
        )?;
    }
    let mut lambda_min = None;
    let mut means = WallMeans::default();
    let mut law = None;
    if let BeatOutcome::Finished(result) = &outcome {
        let of_nodes = [
            ventricle.activation_times_ms().to_vec(),
            ventricle.node_weights().to_vec(),
        ];
        if let Some((wall, frames)) = frames.as_ref().map(Frames::all) {
            let beat = heart::Beat {
                unloaded: ventricle.unloaded_mm(),
                nodes: ventricle.nodes(),
                traces: &result.traces,
            };
            let fields = |sample| rows.stress_and_stretch(sample).map_err(not_kept);
            if let Some(surface) = wall.surface(&beat, &shapes, frames, fields)? {
                context.artefacts.write_bytes(
                    "heart",
                    "heart.json",
                    heart::text(&surface).as_bytes(),
                )?;
            }
        }
        let (time_ms, n_nodes) = (&result.traces.time_ms, of_nodes[0].len());
        context
            .artefacts
            .write_pieces("nodal", "nodal.csv", |out| {
                nodal::write_csv(
                    out,
                    time_ms,
                    [&of_nodes[0], &of_nodes[1]],
                    has_calcium(spec),
                    |k| {
                        let row = rows.row(k)?;
                        let nodal_stretch = &row[row.len() - n_nodes..];
                        means.add(&row[..n_nodes], nodal_stretch, &of_nodes[1]);
                        let stretch = nodal_stretch.iter().copied();
                        lambda_min =
                            Some(stretch.fold(lambda_min.unwrap_or(f64::INFINITY), f64::min));
                        Ok(row)
                    },
                )
            })?;
        let fields = |sample| rows.stress_and_stretch(sample);
        let samples = means.samples(&result.traces, length, &of_nodes[1], fields);
        law = Some(samples.map_err(not_kept)?);
    }
    let closed = match &outcome {
        BeatOutcome::Finished(result) => {
            loop_state(&result.traces, ventricle.volume(), &circulation)
        }
        BeatOutcome::Diverged { .. } => None,
    };
    // The rest involves only rank 0, so the other ranks need not wait for it.
    drop(ventricle);
    if let BeatOutcome::Finished(result) = &outcome {
        if let Some(conduction) = spec
            .finite_element
            .and_then(|equations| equations.potentials)
        {
            let begun = Instant::now();
            potentials::write(
                &StoredVentricle::read(&organ.ventricle)?,
                &conduction,
                length,
                context,
            )?;
            counters.insert(
                "seconds_potentials".to_owned(),
                begun.elapsed().as_secs_f64(),
            );
        }
        counters.insert("newton_iterations_per_step".to_owned(), {
            result.work.n_iterations as f64 / result.work.n_steps.max(1) as f64
        });
    }
    ending(
        spec,
        outcome,
        counters,
        Seen {
            lambda_min,
            motion: motion.as_ref(),
            law: law.as_ref(),
            closed,
        },
        context,
    )
}

/// Starts a series of VTU files if requested. A beat with a cell model, such as the verification
/// beat, always has its first and last frame. The log gives the series' total size before the rest
/// is written.
fn begin_series(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    ventricle: &FiniteElementVentricle,
    context: &mut Context,
) -> Result<Option<Series>, TaskError> {
    let with_calcium = has_calcium(spec);
    let every_ms = match context.vtu_every_ms > 0.0 {
        true => context.vtu_every_ms.max(spec.time_step_ms),
        false if with_calcium => spec.cycle_length_ms,
        false => return Ok(None),
    };
    let mesh = StoredVentricle::read(&organ.ventricle)?.mesh;
    let (series, bytes) = Series::begin(
        context.artefacts.directory(),
        mesh,
        ventricle,
        every_ms,
        with_calcium,
    )?;
    let n_frames = Series::n_frames_of(every_ms, spec.cycle_length_ms);
    let (frame, all) = (bytes as f64 * 1e-6, (n_frames * bytes) as f64 * 1e-6);
    tracing::info!(
        "VTU series: {n_frames} frames of {frame:.2} MB, {all:.0} MB in all, in {}/",
        series::FOLDER
    );
    Ok(Some(series))
}

fn sum(a: VentricleWork, b: VentricleWork) -> VentricleWork {
    VentricleWork {
        steps: a.steps + b.steps,
        newton_iterations: a.newton_iterations + b.newton_iterations,
        krylov_iterations: a.krylov_iterations + b.krylov_iterations,
        factorisations: a.factorisations + b.factorisations,
    }
}

fn write(file: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder)?;
    }
    files::write_atomic(file, bytes)
}

/// Whether several ranks can share a beat with these elements and equations.
fn is_shared(kind: ElementKind, equations: &EquationSettings) -> bool {
    !kind.quadratic && equations.linear_solver.is_parallel()
}

/// Ventricle and circulation of a specification with its effects, at the beginning of the beat.
/// They use the context's team or threads if elements and equations permit.
///
/// # Errors
/// Same as for [`run`].
pub(super) fn assemble(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    context: &Context,
) -> Result<Organ, TaskError> {
    let stored = StoredVentricle::read(&organ.ventricle)?;
    let made = with_parts(spec, organ, &stored, |parts, is_shared| {
        let Some(team) = context.team.as_ref().filter(|team| team.n_ranks() > 1) else {
            let n_ranks = if is_shared {
                context.parts(equations(spec).subdomains)
            } else {
                1
            };
            let ventricle =
                FiniteElementVentricle::on_threads(parts, n_ranks, ThreadSettings::default());
            return ventricle.map(|ventricle| (None, ventricle));
        };
        if !is_shared {
            tracing::warn!(
                "one rank of {} computes: the others lack these elements or solver",
                team.n_ranks()
            );
            return FiniteElementVentricle::new(parts).map(|ventricle| (None, ventricle));
        }
        FiniteElementVentricle::check(&parts, team.n_ranks())?;
        let about = Box::new(stored.about.clone());
        let session = team.begin(&Call::Beat(Box::new(spec.clone()), about));
        match FiniteElementVentricle::lead(parts, team.comm()) {
            Ok(ventricle) => Ok((Some(session), ventricle)),
            Err(error) => {
                session.lose();
                Err(error)
            }
        }
    })?;
    let ((session, ventricle), circulation) = (made.0.map_err(TaskError::Organ)?, made.1);
    let (n_nodes, followed) = (stored.mesh.n_nodes(), Followed::of(&stored.mesh));
    let drawn = Wall::of(&stored.mesh);
    Ok(Organ {
        session,
        ventricle,
        circulation,
        n_nodes,
        followed,
        drawn,
    })
}

/// Takes part in a beat of rank 0.
///
/// # Errors
/// Same as for [`run`].
pub(super) fn serve(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    about: &About,
    team: &Team,
) -> Result<(), TaskError> {
    let parts = effected(spec, organ, about)?;
    let wall = about.wall(parts.cross_fibre_share);
    let own = RankParts {
        wall: &wall,
        contraction: parts.contraction,
        cycle_length: Ms(spec.cycle_length_ms),
        viscosity: parts.viscosity,
        settings: step_settings(spec),
    };
    FiniteElementVentricle::serve(own, team.comm()).map_err(TaskError::Organ)
}

/// Circulation and contraction around the mesh, with the specification's effects.
fn effected(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    about: &About,
) -> Result<InThreeDimensionsParts, TaskError> {
    let figures = &organ.figures;
    // A one-fibre ventricle with the same volumes, whose quantities some effects need.
    let reference = OneFibrePassive::through(
        Ml(figures.unloaded_volume_ml),
        Ml(figures.end_diastolic_volume_ml),
        Mmhg(figures.end_diastolic_pressure_mmhg),
        Ml(figures.wall_volume_ml),
        DEFAULT_EXPONENT,
    )
    .map_err(TaskError::PassiveState)?;
    let surroundings = Surroundings {
        heart: left_heart(spec),
        onset: Ms(figures.onset_ms),
    };
    let held = end_diastolic_stretch(&reference, None);
    let contraction = contraction(spec, &CellSolverSettings::default(), held)?;
    let effects = effects(&spec.circulation.effects)?;
    let closed = closed_loop(spec, figures.onset_ms);
    let around = (&surroundings, closed.as_ref());
    let parts = in_three_dimensions(around, reference, contraction, &effects)?;
    let (found, expected) = (about.effects_exponent_factor, parts.exponent_factor);
    if found != expected {
        return Err(FiniteElementError::Exponents { found, expected }.into());
    }
    Ok(parts)
}

fn equations(spec: &OrganBeatSpec) -> EquationSettings {
    spec.finite_element
        .unwrap_or_else(|| FiniteElementSettings::default().equations())
}

fn step_settings(spec: &OrganBeatSpec) -> StepSettings {
    wall::steps(&equations(spec), spec.newton_iterations)
}

/// Calls `work` with the parts of a ventricle and a flag that says whether several ranks can share
/// it. Also returns the circulation.
fn with_parts<T>(
    spec: &OrganBeatSpec,
    organ: &FiniteElementOrgan,
    stored: &StoredVentricle,
    work: impl FnOnce(VentricleParts<'_>, bool) -> T,
) -> Result<(T, Circulation), TaskError> {
    let parts = effected(spec, organ, &stored.about)?;
    let restored = stored.restore(parts.cross_fibre_share)?;
    let late = match parts.late {
        Some(late) => Some((
            late,
            LateSector::of(&stored.mesh, !stored.about.is_own_mesh)?,
        )),
        None => None,
    };
    let activation_ms: Vec<f64> = (stored.mesh.nodes_mm.iter().zip(&stored.activation_ms))
        .map(|(node, time)| {
            let delay_ms = late
                .as_ref()
                .map_or(0.0, |(late, sector)| sector.delay_ms(*late, node));
            organ.figures.onset_ms + time + delay_ms
        })
        .collect();
    let about = &stored.about;
    let is_shared = is_shared(
        wall::element(about.element, about.wall.pointwise_share),
        &equations(spec),
    );
    let of_ventricle = VentricleParts {
        anatomy: &restored.anatomy,
        wall: &restored.wall,
        end_diastole: restored.end_diastole,
        contraction: parts.contraction,
        activation_ms: &activation_ms,
        cycle_length: Ms(spec.cycle_length_ms),
        pressure_terms: parts.pressure_terms,
        viscosity: parts.viscosity,
        settings: step_settings(spec),
    };
    Ok((work(of_ventricle, is_shared), parts.circulation))
}
