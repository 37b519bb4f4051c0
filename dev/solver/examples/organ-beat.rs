//! Step 0 and one beat of a generated ventricle, with its cost: `cargo run --release --manifest-path dev/Cargo.toml --example
//! organ-beat -- [nodes=2000] [c=0.8] [element=linear|pointwise|quadratic]
//! [law=guccione|ogden|neo] [convention=squared|first|second] [tau=0.1] [linear=levels|jacobi|sweep|direct] [static=direct|multigrid]
//! [tolerance=1e-4] [step=1] [late=0] [longest=0] [control=2] [end=659] [turn=60] [ring=0.04]`. With a stiffness `c` \[kPa\] step 0 only inflates, from the image
//! taken for unloaded. Steps of late filling may be `late` ms long, and controlled steps `longest` ms, with a tolerated error of `control`. Fibres go from `turn` degrees at the endocardium to its negative at the epicardium; `ring` is the height
//! of the passive ring at the base. What a beat is made of: `cardiotwin-dev bench beat --nodes N`.

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::time::Instant;

use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::material::{ActiveConvention, HolzapfelOgden, Law, NeoHookean};
use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::organ::motion::volume_ratios;
use cardiotwin_mechanics::organ::passive_fit::fit;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, FiniteElementVentricle, Fitted, PassiveFit, PassiveState, Piece, Search,
    UnloadingSettings, VentricleParts, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::eikonal::{Conduction, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_observed};
use cardiotwin_models::circulation::LeftHeart;
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::step_control::StepControl;
use cardiotwin_models::ventricle::GroupContraction;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace};
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};

/// Seconds of processor time so far: what a busy machine changes little; zero where the system does not tell.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    text.split(' ')
        .next()
        .and_then(|ns| ns.parse::<f64>().ok())
        .unwrap_or(0.0)
        * 1e-9
}

fn argument<T: std::str::FromStr>(name: &str, default: T) -> T {
    let found =
        std::env::args().find_map(|a| a.strip_prefix(name)?.strip_prefix('=')?.parse().ok());
    found.unwrap_or(default)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let kind = match argument("element", "linear".to_owned()).as_str() {
        "quadratic" => ElementKind::QUADRATIC_NODAL,
        "pointwise" => ElementKind::LINEAR_POINTWISE,
        _ => ElementKind::LINEAR_NODAL,
    };
    let share = argument("share", f64::NAN);
    let volume = match kind.volume {
        VolumeChange::Nodal { .. } if share >= 0.0 => VolumeChange::Nodal {
            pointwise_share: share,
        },
        volume => volume,
    };
    let kind = ElementKind { volume, ..kind };
    let linear = match argument("linear", "levels".to_owned()).as_str() {
        "direct" => LinearSolver::Direct,
        "sweep" => LinearSolver::SymmetricSweep,
        "jacobi" => LinearSolver::BlockJacobi,
        _ => LinearSolver::RigidLevels,
    };
    let begun = Instant::now();
    let (cavity, edv, p_image, edp) = (112.0, argument("edv", 126.0), 6.0, 9.0);
    let mut spec = EllipsoidSpec::new(Ml(cavity), Ml(140.0), argument("nodes", 2000));
    spec.ring_height = argument("ring", spec.ring_height);
    let made = generate(&spec)?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    let muscle = [tags::LEFT_VENTRICLE];
    let turn = argument("turn", 60.0);
    make(
        &mut mesh,
        &muscle,
        &FibreAngles {
            alpha_endo_deg: turn,
            alpha_epi_deg: -turn,
            ..FibreAngles::default()
        },
    )?;
    let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
    let times = activation_ms(&mesh, &conduction)?;
    if argument("nodal", 1) == 0 {
        mesh.fibres = cardiotwin_mesh::NodeFibres::PerElement;
    }
    let anatomy = Anatomy::of(&mesh, &muscle, kind)?;
    println!(
        "{} nodes, {} tets, {} degrees of freedom; mesh, fibres, activation {:.2} s",
        mesh.n_nodes(),
        mesh.n_tets(),
        3 * anatomy.nodes.len(),
        begun.elapsed().as_secs_f64()
    );
    let (begun, processor) = (Instant::now(), processor_seconds());
    let target = PassiveFit::ThreePoints {
        image_pressure_kpa: p_image / MMHG_PER_KPA,
        end_diastolic_pressure_kpa: edp / MMHG_PER_KPA,
        end_diastolic_volume_mm3: 1e3 * edv,
        // Klotz 2006.
        unloaded_volume_mm3: 1e3 * edv * (0.6 - 0.006 * edp),
    };
    let mut settings = UnloadingSettings::for_anatomy(&anatomy);
    match argument("static", String::new()).as_str() {
        "direct" => settings.newton.linear = LinearSolver::Direct,
        "multigrid" => settings.newton.linear = LinearSolver::Multigrid,
        _ => {}
    }
    let mut search = Search::new(settings);
    let mut wall = WallParameters::default();
    match argument("law", String::new()).as_str() {
        "ogden" => wall.muscle = Law::HolzapfelOgden(HolzapfelOgden::arostica2025()),
        "neo" => wall.muscle = Law::NeoHookean(NeoHookean { mu_kpa: 5.0 }),
        _ => {}
    }
    match argument("convention", String::new()).as_str() {
        "first" => wall.active.convention = ActiveConvention::FirstPiola,
        "second" => wall.active.convention = ActiveConvention::SecondPiola,
        _ => {}
    }
    wall.damping.stiffness_ms = argument("tau", wall.damping.stiffness_ms);
    let Fitted {
        state: end_diastole,
        wall,
        ..
    } = match argument("c", 0.0) {
        c if c > 0.0 => {
            wall.muscle = wall.muscle.with_stiffness(c);
            wall.rim.stiffness = argument("rim", wall.rim.stiffness);
            wall.pericardium.stiffness = argument("epi", wall.pericardium.stiffness);
            wall.pericardial_base_share = argument("base", wall.pericardial_base_share);
            let mut state = PassiveState::unloaded_image(&Piece::whole(&anatomy), &wall)?;
            state.inflate(edp / MMHG_PER_KPA, &mut search)?;
            Fitted {
                state,
                wall,
                slope: None,
            }
        }
        _ => fit(&Piece::whole(&anatomy), &wall, &target, None, &mut search)?,
    };
    println!(
        "step 0: stiffness {:.4} kPa, exponent {:.3}, unloaded {:.2} mL, end-diastole {:.2} mL; {} Newton iterations, {} passes, {:.1} s, {:.1} s of processor time",
        end_diastole.stiffness_kpa,
        wall.muscle.exponent().unwrap_or(0.0),
        1e-3 * end_diastole.unloaded_volume_mm3(),
        1e-3 * end_diastole.volume_mm3(),
        end_diastole.newton_iterations,
        end_diastole.passes,
        begun.elapsed().as_secs_f64(),
        processor_seconds() - processor
    );
    let (begun, processor) = (Instant::now(), processor_seconds());
    let cycle_length = Ms(argument("end", 659.0));
    let heart = LeftHeart::of_an_adult(Mmhg(9.0), cycle_length);
    let tanh = TanhParameters {
        smax_ref_kpa: argument("smax", 100.0),
        t_cr_ms: 400.0,
        ..TanhParameters::default()
    };
    let mut circulation = heart.build()?;
    let mut ventricle = FiniteElementVentricle::new(VentricleParts {
        anatomy: &anatomy,
        wall: &wall,
        end_diastole: end_diastole.into(),
        contraction: GroupContraction::tanh(Tanh::new(tanh)?),
        activation_ms: &times,
        cycle_length,
        pressure_terms: vec![],
        viscosity: None,
        settings: StepSettings {
            linear,
            relative_tolerance: argument("tolerance", 1e-4),
            volume_tolerance_mm3: argument("volume", 1e-2),
            ..StepSettings::default()
        },
    })?;
    let settings = BeatSettings {
        step: Ms(argument("step", 1.0)),
        diastolic_step: Ms(argument("late", 0.0)),
        control: (argument("longest", 0.0) > 0.0).then(|| StepControl {
            longest: Ms(argument("longest", 0.0)),
            tolerance_per_s: argument("control", 2.0),
        }),
        ..BeatSettings::one_beat(cycle_length)
    };
    let (mut volume_ratio, mut sample) = ([f64::INFINITY, f64::NEG_INFINITY], 0);
    let outcome = run_observed(&mut ventricle, &mut circulation, &settings, None, |seen| {
        if sample % 5 == 0 {
            let (unloaded, u) = (
                seen.ventricle.unloaded_mm(),
                seen.ventricle.displacement_mm(),
            );
            let x: Vec<f64> = unloaded.iter().zip(&u).map(|(x, u)| x + u).collect();
            let [least, largest] = volume_ratios(
                &mesh.tets,
                unloaded.as_chunks::<3>().0,
                x.as_chunks::<3>().0,
            );
            volume_ratio = [volume_ratio[0].min(least), volume_ratio[1].max(largest)];
        }
        sample += 1;
        ControlFlow::<Infallible>::Continue(())
    });
    let ControlFlow::Continue(outcome) = outcome;
    println!(
        "volumes of elements over their unloaded ones: {:.3} to {:.3}",
        volume_ratio[0], volume_ratio[1]
    );
    let (seconds, processor) = (
        begun.elapsed().as_secs_f64(),
        processor_seconds() - processor,
    );
    let traces = match &outcome {
        BeatOutcome::Finished(result) => {
            for check in &result.checks {
                println!(
                    "{}: {} ({})",
                    check.name,
                    if check.passed { "yes" } else { "NO" },
                    check.value
                );
            }
            println!("{} steps, {} cut", result.work.n_steps, result.work.n_cut);
            &result.traces
        }
        BeatOutcome::Diverged {
            t, reason, traces, ..
        } => {
            println!("diverged at {t}: {reason}");
            traces
        }
    };
    let work = ventricle.work();
    println!(
        "beat: {seconds:.1} s, {processor:.2} s of processor time; Newton {:.3} a step, Krylov {:.1} a Newton iteration, {} factorisations",
        work.newton_iterations as f64 / work.steps as f64,
        work.krylov_iterations as f64 / work.newton_iterations.max(1) as f64,
        work.factorisations
    );
    let (p, v) = (&traces.pressure_mmhg, &traces.volume_ml);
    let range = |x: &[f64]| {
        x.iter()
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)))
    };
    println!("P {:.3?} mmHg, V {:.4?} mL", range(p), range(v));
    let trace = |quantity, x: &[f64]| Trace::new(quantity, traces.time_ms.clone(), x.to_vec());
    let (pressure, volume) = (trace(Quantity::Pressure, p)?, trace(Quantity::Volume, v)?);
    let found = BeatBiomarkers::of(Some(&pressure), Some(&volume), Continuation::Single)?;
    let biomarkers = [
        ("P_max", found.values.p_max_mmhg, "mmHg"),
        (
            "dPdt_max",
            found.values.dpdt_max_mmhg_per_ms.map(|x| 1e3 * x),
            "mmHg/s",
        ),
        (
            "dPdt_min",
            found.values.dpdt_min_mmhg_per_ms.map(|x| 1e3 * x),
            "mmHg/s",
        ),
        ("PTD90", found.values.ptd90_ms, "ms"),
        ("SV", found.values.sv_ml, "mL"),
        ("tau_VD", found.values.tau_vd_ms, "ms"),
        ("tau_VR", found.values.tau_vr_ms, "ms"),
    ];
    let told = biomarkers
        .map(|(name, value, unit)| format!("{name} {:.3} {unit}", value.unwrap_or(f64::NAN)));
    println!("{}; {:?}", told.join(", "), found.flags);
    if std::env::args().any(|a| a == "trace") {
        for (k, t) in traces.time_ms.iter().enumerate().step_by(20) {
            println!("{t:6.0} ms  {:8.3} mmHg  {:8.3} mL", p[k], v[k]);
        }
    }
    Ok(())
}
