//! Step 0 and one beat of a generated ventricle, with its cost: `cargo run --release -p cardiotwin-mechanics --example
//! organ-beat -- [nodes=2000] [c=0.8] [element=linear|pointwise|quadratic] [linear=jacobi|sweep|direct] [static=direct|multigrid]
//! [tolerance=1e-4] [step=1] [end=659]`. With a stiffness `c` \[kPa\] step 0 only inflates, from the image taken for unloaded. What a beat is made of:
//! `cardiotwin-worker bench beat --nodes N`.

use std::time::Instant;

use cardiotwin_mechanics::element::kernel::VolumeChange;
use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::organ::passive_fit::fit;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, FiniteElementVentricle, Fitted, PassiveFit, PassiveState, Piece, Search, UnloadingSettings,
    VentricleParts, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::eikonal::{Conduction, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{Angles, make};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_beats};
use cardiotwin_models::circulation::LeftHeart;
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::GroupContraction;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg, Ms};

/// Seconds of processor time so far: what a busy machine changes little; zero where the system does not tell.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

fn argument<T: std::str::FromStr>(name: &str, default: T) -> T {
    let found = std::env::args().find_map(|a| a.strip_prefix(name)?.strip_prefix('=')?.parse().ok());
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
        VolumeChange::Nodal { .. } if share >= 0.0 => VolumeChange::Nodal { pointwise_share: share },
        volume => volume,
    };
    let kind = ElementKind { volume, ..kind };
    let linear = match argument("linear", "jacobi".to_owned()).as_str() {
        "direct" => LinearSolver::Direct,
        "sweep" => LinearSolver::SymmetricSweep,
        _ => LinearSolver::BlockJacobi,
    };
    let begun = Instant::now();
    let (cavity, edv, p_image, edp) = (112.0, argument("edv", 126.0), 6.0, 9.0);
    let made = generate(&EllipsoidSpec::new(Ml(cavity), Ml(140.0), argument("nodes", 2000)))?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    let muscle = [tags::LEFT_VENTRICLE];
    let turn = argument("turn", 60.0);
    make(&mut mesh, &muscle, &Angles { alpha_endo_deg: turn, alpha_epi_deg: -turn, ..Angles::default() })?;
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
    let mut start = WallParameters::default();
    start.static_spring = argument("hold", start.static_spring);
    start.rim.stiffness = argument("rim", start.rim.stiffness);
    start.rim.damping = argument("rimdash", start.rim.damping);
    start.pericardium.stiffness = argument("epi", start.pericardium.stiffness);
    start.pericardium.damping = argument("dash", start.pericardium.damping);
    start.pericardial_base_share = argument("base", start.pericardial_base_share);
    start.active.cross_fibre = argument("cross", 0.0);
    start.epicardial_duration = argument("epidur", start.epicardial_duration);
    start.active.sheet_normal = argument("crossn", start.active.sheet_normal);
    start.damping.mass_per_ms = argument("mass", start.damping.mass_per_ms);
    start.damping.stiffness_ms = argument("tau", start.damping.stiffness_ms);
    let Fitted { state: end_diastole, wall, .. } = match argument("c", 0.0) {
        c if c > 0.0 => {
            let mut wall = start.clone();
            wall.muscle = wall.muscle.with_stiffness(c);
            let mut state = PassiveState::unloaded_image(&Piece::whole(&anatomy), &wall)?;
            state.inflate(edp / MMHG_PER_KPA, &mut search)?;
            Fitted { state, wall, slope: None }
        }
        _ if argument("given", 0.0) > 0.0 => {
            start.muscle = start.muscle.with_stiffness(argument("given", 0.0)).scaled(1.0, argument("factor", 1.0));
            let target = PassiveFit::Given {
                image_pressure_kpa: argument("pi", p_image) / MMHG_PER_KPA,
                end_diastolic_pressure_kpa: argument("edp", edp) / MMHG_PER_KPA,
            };
            let found = fit(&Piece::whole(&anatomy), &start, &target, None, &mut search);
            if let Err(e) = &found {
                println!("{e}: {:?}", std::error::Error::source(e).map(|s| s.to_string()));
            }
            found?
        }
        _ => fit(&Piece::whole(&anatomy), &start, &target, None, &mut search)?,
    };
    println!(
        "step 0: C {:.4} kPa, b_f {:.3}, unloaded {:.2} mL, end-diastole {:.2} mL; {} Newton iterations, {} passes, {:.1} s, {:.1} s of processor time",
        end_diastole.stiffness_kpa,
        wall.muscle.stiffness_kpa(),
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
    let tanh = TanhParameters { smax_ref_kpa: argument("smax", 100.0), t_cr_ms: 400.0, ..TanhParameters::default() };
    let mut circulation = heart.build()?;
    let ventricle = FiniteElementVentricle::new(VentricleParts {
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
    let mut ventricle = Watched { inner: ventricle, frames: vec![] };
    let settings = BeatSettings { step: Ms(argument("step", 1.0)), ..BeatSettings::one_beat(cycle_length) };
    let outcome = run_beats(&mut ventricle, &mut circulation, &settings);
    let (seconds, processor) = (begun.elapsed().as_secs_f64(), processor_seconds() - processor);
    let traces = match &outcome {
        BeatOutcome::Finished(result) => {
            for check in &result.checks {
                println!("{}: {} ({})", check.name, if check.passed { "yes" } else { "NO" }, check.value);
            }
            println!("{} steps, {} cut", result.work.n_steps, result.work.n_cut);
            &result.traces
        }
        BeatOutcome::Diverged { t, reason, traces, .. } => {
            println!("diverged at {t}: {reason}");
            traces
        }
    };
    let work = ventricle.inner.work();
    motion(&ventricle, &anatomy);
    println!(
        "beat: {seconds:.1} s, {processor:.2} s of processor time; Newton {:.3} a step, Krylov {:.1} a Newton iteration, {} factorisations",
        work.newton_iterations as f64 / work.steps as f64,
        work.krylov_iterations as f64 / work.newton_iterations.max(1) as f64,
        work.factorisations
    );
    let (p, v) = (&traces.pressure_mmhg, &traces.volume_ml);
    let range = |x: &[f64]| x.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
    let slopes: Vec<f64> = p.windows(3).map(|w| 1e3 * (w[2] - w[0]) / (2.0 * settings.step.0)).collect();
    let (slowest, steepest) = range(&slopes);
    println!(
        "P {:.3?} mmHg, dP/dt {slowest:.1} to {steepest:.1} mmHg/s, V {:.4?} mL, SV {:.4} mL",
        range(p),
        range(v),
        range(v).1 - range(v).0
    );
    if std::env::args().any(|a| a == "trace") {
        for (k, t) in traces.time_ms.iter().enumerate().step_by(20) {
            println!("{t:6.0} ms  {:8.3} mmHg  {:8.3} mL", p[k], v[k]);
        }
    }
    Ok(())
}

struct Watched {
    inner: FiniteElementVentricle,
    frames: Vec<(f64, f64, f64, Vec<f64>, f64, f64, f64)>,
}
use cardiotwin_models::circulation::Circulation;
use cardiotwin_models::ventricle::{TriedStep, Ventricle, VentricleError, VentricleSnapshot};
impl Ventricle for Watched {
    fn time(&self) -> Ms {
        self.inner.time()
    }
    fn volume(&self) -> Ml {
        self.inner.volume()
    }
    fn pressure(&self) -> Mmhg {
        self.inner.pressure()
    }
    fn try_step(&mut self, c: &mut Circulation, dt: Ms) -> Result<TriedStep, VentricleError> {
        self.inner.try_step(c, dt)
    }
    fn commit(&mut self) {
        self.inner.commit();
        let u = self.inner.displacement_mm();
        let mut d = cardiotwin_mechanics::body::Deformation::default();
        self.inner.dynamics().body.deform(&u, &cardiotwin_mechanics::parallel::SingleProcess, &mut d);
        let (mut lo, mut hi) = (9.0_f64, 0.0_f64);
        for (idx, j) in d.volume_ratio.iter().enumerate() {
            let (n, _) = self.inner.dynamics().body.point_lanes(idx);
            for l in 0..n {
                lo = lo.min(j[l]);
                hi = hi.max(j[l]);
            }
        }
        let mut s = vec![0.0; self.inner.node_weights().len()];
        self.inner.stretch(&mut s);
        s.sort_by(f64::total_cmp);
        let x = self.inner.unloaded_mm().iter().zip(&u).map(|(a, b)| a + b).collect();
        self.frames.push((
            self.inner.time().0,
            self.inner.pressure().0,
            self.inner.volume().0,
            x,
            lo,
            hi,
            s[s.len() / 2],
        ));
    }
    fn roll_back(&mut self) {
        self.inner.roll_back()
    }
    fn activation_times_ms(&self) -> &[f64] {
        self.inner.activation_times_ms()
    }
    fn node_weights(&self) -> &[f64] {
        self.inner.node_weights()
    }
    fn active_stress_kpa(&self, out: &mut [f64]) {
        self.inner.active_stress_kpa(out)
    }
    fn calcium_um(&self, out: &mut [f64]) {
        self.inner.calcium_um(out)
    }
    fn stretch(&self, out: &mut [f64]) {
        self.inner.stretch(out)
    }
    fn snapshot(&self) -> VentricleSnapshot {
        self.inner.snapshot()
    }
    fn restore(&mut self, s: &VentricleSnapshot) -> Result<(), VentricleError> {
        self.inner.restore(s)
    }
}

fn motion(v: &Watched, a: &Anatomy) {
    use cardiotwin_mechanics::organ::anatomy::Triangles;
    let nodes = |t: &Triangles| -> Vec<usize> {
        let mut n: Vec<usize> = match t {
            Triangles::Linear(t) => t.as_flattened().iter().map(|n| *n as usize).collect(),
            Triangles::Quadratic(t) => t.as_flattened().iter().map(|n| *n as usize).collect(),
        };
        n.sort_unstable();
        n.dedup();
        n
    };
    let rim = nodes(&a.rim);
    let mut epi = nodes(&a.epicardium);
    if let Some(s) = &a.septum {
        epi.extend(nodes(s));
    }
    let endo = nodes(&a.endocardium);
    let z = |n: usize| a.nodes[n][2];
    let low = |l: &[usize]| *l.iter().min_by(|a, b| z(**a).total_cmp(&z(**b))).unwrap();
    let (apex_epi, apex_endo) = (low(&epi), low(&endo));
    let zb = rim.iter().map(|n| z(*n)).sum::<f64>() / rim.len() as f64;
    let h = |n: usize, f: usize| (z(n) - z(f)) / (zb - z(f));
    let level = |l: &[usize], f: usize, from: f64, to: f64| -> Vec<usize> {
        l.iter().copied().filter(|n| (from..to).contains(&h(*n, f))).collect()
    };
    let shape = |x: &[f64]| {
        let at = |n: usize| [x[3 * n], x[3 * n + 1], x[3 * n + 2]];
        let mean = |l: &[usize], g: &dyn Fn([f64; 3]) -> f64| l.iter().map(|n| g(at(*n))).sum::<f64>() / l.len() as f64;
        let base = mean(&rim, &|x| x[2]);
        let r = |x: [f64; 3]| x[0].hypot(x[1]);
        let (mid_epi, mid_endo) = (level(&epi, apex_epi, 0.4, 0.7), level(&endo, apex_endo, 0.4, 0.7));
        let angles = |l: Vec<usize>| -> Vec<f64> { l.iter().map(|n| at(*n)[1].atan2(at(*n)[0])).collect() };
        (
            base,
            at(apex_epi)[2],
            base - at(apex_endo)[2],
            mean(&mid_epi, &r),
            mean(&mid_endo, &r),
            [
                angles(level(&epi, apex_epi, 0.1, 0.3)),
                angles(level(&epi, apex_epi, 0.75, 0.95)),
                angles(level(&endo, apex_endo, 0.1, 0.3)),
                angles(level(&endo, apex_endo, 0.75, 0.95)),
            ],
        )
    };
    let turn = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| {
                let d = a - b;
                d.sin().atan2(d.cos())
            })
            .sum::<f64>()
            / a.len() as f64
            * 57.29578
    };
    let first = &v.frames[0];
    let f0 = shape(&first.3);
    let vmin = v.frames.iter().map(|f| f.2).fold(1e9, f64::min);
    let es = v.frames.iter().find(|f| f.2 <= vmin + 0.05).unwrap();
    let fe = shape(&es.3);
    // isovolumic contraction: while volume is above its highest less 0.3 mL and pressure rises
    let vmax = v.frames.iter().map(|f| f.2).fold(0.0, f64::max);
    let ivc = v
        .frames
        .iter()
        .take_while(|f| f.2 > vmax - 0.5)
        .filter(|f| f.1 > 12.0)
        .map(|f| shape(&f.3).2 / f0.2 - 1.0)
        .fold(-1.0, f64::max);
    let tw = |f: &(f64, f64, f64, Vec<f64>, f64, f64, f64), k: usize| {
        let s = shape(&f.3);
        turn(&s.5[k], &f0.5[k]) - turn(&s.5[k + 1], &f0.5[k + 1])
    };
    let max_tw = |k: usize| {
        v.frames.iter().step_by(5).map(|f| tw(f, k)).fold((0.0_f64, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)))
    };
    // end of isovolumic relaxation: pressure first below 15 mmHg after es
    let ivr = v.frames.iter().find(|f| f.0 > es.0 && f.1 < 12.0).unwrap_or(es);
    let lo = v.frames.iter().map(|f| f.4).fold(9.0, f64::min);
    let hi = v.frames.iter().map(|f| f.5).fold(0.0, f64::max);
    let pmin = v.frames.iter().map(|f| f.1).fold(1e9, f64::min);
    println!(
        "motion: base down {:.1} apex up {:.1} mm, shortening {:.1} %, epi radius {:.1} %, thickening {:.1} %, ivc length {:+.1} %, twist epi {:.1?} es {:.1} ivr {:.1}, endo {:.1?} es {:.1} ivr {:.1}, least P {:.2}, J {:.2}..{:.2}, median least stretch {:.3} (volumes {:.3})",
        f0.0 - fe.0,
        fe.1 - f0.1,
        100.0 * (1.0 - fe.2 / f0.2),
        100.0 * (fe.3 / f0.3 - 1.0),
        100.0 * ((fe.3 - fe.4) / (f0.3 - f0.4) - 1.0),
        100.0 * ivc,
        max_tw(0),
        tw(es, 0),
        tw(ivr, 0),
        max_tw(2),
        tw(es, 2),
        tw(ivr, 2),
        pmin,
        lo,
        hi,
        v.frames.iter().map(|f| f.6).fold(9.0, f64::min),
        ((vmin + 140.0 / 3.0) / (first.2 + 140.0 / 3.0)).cbrt()
    );
}
