//! Two ventricles, of which the right one is passive and has a given pressure; surfaces on springs of their own.

mod support;

use std::path::Path;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, EndDiastole, FiniteElementVentricle, PassiveState, Piece, PressureCourse,
    RightPressure, Search, Spring, SprungSurface, UnloadingSettings, VentricleParts, WallError,
    WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::files::{LengthUnit, carp};
use cardiotwin_mesh::tet_mesh::surface_names;
use cardiotwin_mesh::{Surface, TetMesh, tags};
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::{GroupContraction, Ventricle};
use cardiotwin_units::Ms;
use support::{MUSCLE, circulation, heart};

/// Ambit's bi-ventricle with fibres; see its README for source and licence.
fn both_ventricles() -> TetMesh {
    let stem =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/meshes/ambit_biv/ambit_biv");
    let mut mesh = carp::read(&stem, LengthUnit::Micrometre).expect("a mesh");
    for surface in mesh
        .surfaces
        .iter_mut()
        .filter(|surface| surface.name == "endo_rv")
    {
        surface.name = surface_names::RIGHT_VENTRICLE.to_owned();
    }
    for tag in mesh.tags.iter_mut().filter(|tag| **tag == 2) {
        *tag = tags::BESIDE;
    }
    make(&mut mesh, &MUSCLE, &FibreAngles::default()).expect("fields");
    mesh
}

/// Muscle that 1.2 kPa inflates by a third, with a right ventricle at a constant pressure or none.
fn wall(right_kpa: Option<f64>) -> WallParameters {
    let mut wall = WallParameters {
        passive_mu_kpa: 8.0,
        ..WallParameters::default()
    };
    wall.muscle = wall.muscle.with_stiffness(0.6);
    let course = right_kpa.map(PressureCourse::constant);
    wall.right_pressure = course.map(|course| RightPressure {
        per_left: course.at(0.0) / 1.2,
        course,
    });
    wall
}

fn inflated(anatomy: &Anatomy, wall: &WallParameters) -> PassiveState {
    let mut state = PassiveState::unloaded_image(&Piece::whole(anatomy), wall).expect("a wall");
    state
        .inflate(1.2, &mut Search::new(UnloadingSettings::default()))
        .expect("inflates");
    state
}

/// Pressures and volumes of the first steps of a beat, and where nodes are then.
fn steps(
    anatomy: &Anatomy,
    wall: &WallParameters,
    begin: &EndDiastole,
    n_ranks: usize,
    n: usize,
) -> [Vec<f64>; 2] {
    let times = vec![0.0; anatomy.n_vertices];
    let parts = VentricleParts {
        anatomy,
        wall,
        end_diastole: begin.clone(),
        contraction: GroupContraction::tanh(
            Tanh::new(TanhParameters::default()).expect("parameters"),
        ),
        activation_ms: &times,
        cycle_length: Ms(660.0),
        pressure_terms: vec![],
        viscosity: None,
        settings: StepSettings::default(),
    };
    let mut ventricle =
        FiniteElementVentricle::on_threads(parts, n_ranks, ThreadSettings::default())
            .expect("a ventricle");
    let (mut blood, mut seen) = (circulation(), vec![]);
    for _ in 0..n {
        let tried = ventricle.try_step(&mut blood, Ms(1.0)).expect("a step");
        ventricle.commit();
        blood.commit();
        seen.extend([tried.pressure.0, tried.volume.0]);
    }
    [seen, ventricle.displacement_mm()]
}

/// Mean of nodes' displacement along `direction`.
fn mean_along(u: &[f64], nodes: &[u32], direction: [f64; 3]) -> f64 {
    let along = |node: &u32| {
        (0..3)
            .map(|i| u[3 * *node as usize + i] * direction[i])
            .sum::<f64>()
    };
    nodes.iter().map(along).sum::<f64>() / nodes.len() as f64
}

fn middle(mesh: &TetMesh, nodes: &[u32]) -> [f64; 3] {
    let sum = |i: usize| {
        nodes
            .iter()
            .map(|node| mesh.nodes_mm[*node as usize][i])
            .sum::<f64>()
    };
    std::array::from_fn(|i| sum(i) / nodes.len() as f64)
}

/// Nodes of the septum's right side away from its edge, and the direction from there to the left cavity.
fn septum(mesh: &TetMesh) -> (Vec<u32>, [f64; 3]) {
    let of = |name: &str| mesh.surface(name).expect("a surface").nodes();
    let mut beside = vec![false; mesh.n_nodes()];
    for (tet, _) in mesh
        .tets
        .iter()
        .zip(&mesh.tags)
        .filter(|(_, tag)| **tag == tags::BESIDE)
    {
        tet.iter().for_each(|node| beside[*node as usize] = true);
    }
    let rim = of(surface_names::RIM);
    let nodes: Vec<u32> = (of(surface_names::RIGHT_VENTRICLE).into_iter())
        .filter(|node| !beside[*node as usize] && !rim.contains(node))
        .collect();
    let (to, from) = (
        middle(mesh, &of(surface_names::ENDOCARDIUM)),
        middle(mesh, &nodes),
    );
    let d: [f64; 3] = std::array::from_fn(|i| to[i] - from[i]);
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    (nodes, d.map(|x| x / length))
}

#[test]
fn pressure_in_the_right_ventricle_moves_the_septum_to_the_left_and_takes_volume_from_there() {
    let mesh = both_ventricles();
    let anatomy = Anatomy::of(&mesh, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy");
    let (nodes, to_the_left) = septum(&mesh);
    assert!(nodes.len() > 50, "{}", nodes.len());
    let states = [None, Some(0.4), Some(0.8)].map(|right| inflated(&anatomy, &wall(right)));
    let volumes = states.each_ref().map(|state| 1e-3 * state.volume_mm3());
    let moved = states
        .each_ref()
        .map(|state| mean_along(&state.u, &nodes, to_the_left));
    assert!(
        volumes[1] < volumes[0] - 0.5 && volumes[2] < volumes[1] - 1.0,
        "{volumes:?}"
    );
    assert!(
        moved[1] > moved[0] + 0.2 && moved[2] > moved[1] + 0.2,
        "{moved:?}"
    );
    // Closed valves pull at their rings: no load has a resultant, and nothing has to hold the heart.
    let state = &states[2];
    let given = &state.dynamics.given_cavities[0];
    assert!((given.pressure_kpa - 0.8).abs() < 1e-12);
    let (comm, reference) = (
        state.dynamics.comm.as_ref(),
        state.dynamics.body.reference(),
    );
    let mut force = vec![0.0; state.u.len()];
    given
        .cavity
        .add_forces(comm, 0.8, reference, &state.u, &mut force);
    let sum = |i: usize| force.iter().skip(i).step_by(3).sum::<f64>();
    let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    assert!(
        (0..3).all(|i| sum(i).abs() < 1e-9 * size),
        "{:?} of {size}",
        [sum(0), sum(1), sum(2)]
    );
    let right_ml = 1e-3
        * given
            .cavity
            .volume(comm, reference, &vec![0.0; state.u.len()]);
    assert!((right_ml - 83.8).abs() < 0.1, "{right_ml} mL");
}

#[test]
fn no_pressure_is_no_right_ventricle_to_the_bit_and_threads_share_its_load() {
    let mesh = both_ventricles();
    let anatomy = Anatomy::of(&mesh, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy");
    let of = |right, n_ranks| {
        let wall = wall(right);
        let state = inflated(&anatomy, &wall);
        let inflated = state.u.clone();
        (inflated, steps(&anatomy, &wall, &state.into(), n_ranks, 12))
    };
    let none = of(None, 1);
    assert_eq!(none, of(Some(0.0), 1));
    let (alone, several) = (of(Some(0.8), 1).1, of(Some(0.8), 3).1);
    let apart = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()))
    };
    assert!(apart(&alone[0], &several[0]) < 1e-3 && apart(&alone[1], &several[1]) < 1e-3);
    assert!(apart(&alone[0], &none.1[0]) > 0.1);
}

#[test]
fn a_course_of_pressure_acts_at_its_time() {
    let mesh = both_ventricles();
    let anatomy = Anatomy::of(&mesh, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy");
    let (nodes, to_the_left) = septum(&mesh);
    let state: EndDiastole = inflated(&anatomy, &wall(Some(0.4))).into();
    let mut risen = wall(Some(0.4));
    let course = PressureCourse {
        time_ms: vec![0.0, 10.0, 20.0],
        kpa: vec![0.4, 0.4, 3.0],
        cycle_ms: 660.0,
    };
    risen.right_pressure = Some(RightPressure {
        course,
        per_left: 0.4 / 1.2,
    });
    let after = |wall: &WallParameters, n| steps(&anatomy, wall, &state, 1, n);
    assert_eq!(
        after(&wall(Some(0.4)), 10),
        after(&risen, 10),
        "alike until it rises"
    );
    let moved =
        [wall(Some(0.4)), risen].map(|wall| mean_along(&after(&wall, 20)[1], &nodes, to_the_left));
    assert!(moved[1] > moved[0] + 0.1, "{moved:?}");
}

/// The generated heart with its lateral epicardium as a surface next to it.
fn beside_the_lung() -> (TetMesh, Vec<u32>) {
    let (mut mesh, _) = heart();
    let lateral = |t: &&[u32; 3]| t.iter().all(|node| mesh.nodes_mm[*node as usize][0] > 0.0);
    let triangles = mesh
        .surface(surface_names::EPICARDIUM)
        .expect("one")
        .triangles
        .iter()
        .filter(lateral)
        .copied();
    let surface = Surface {
        name: "lung".to_owned(),
        triangles: triangles.collect(),
    };
    let nodes = surface.nodes();
    mesh.surfaces.push(surface);
    (mesh, nodes)
}

#[test]
fn springs_of_a_named_surface_hold_it_where_it_was_in_end_diastole() {
    let (mesh, nodes) = beside_the_lung();
    let anatomy = Anatomy::of(&mesh, &MUSCLE, ElementKind::LINEAR_NODAL).expect("an anatomy");
    let sprung = |name: &str, stiffness, damping| WallParameters {
        surfaces: vec![SprungSurface {
            name: name.to_owned(),
            spring: Spring { stiffness, damping },
        }],
        ..wall(None)
    };
    let state: EndDiastole = inflated(&anatomy, &wall(None)).into();
    // Springs along the normal let the surface slide.
    let far = |wall: &WallParameters, n_ranks| {
        let [_, u] = steps(&anatomy, wall, &state, n_ranks, 60);
        let moved = |node: &u32| {
            (3 * *node as usize..3 * *node as usize + 3)
                .map(|k| (u[k] - state.u[k]).powi(2))
                .sum::<f64>()
        };
        nodes.iter().map(moved).sum::<f64>()
    };
    let free = far(&wall(None), 1);
    assert_eq!(
        free,
        far(&sprung("lung", 0.0, 0.0), 1),
        "springs of no stiffness"
    );
    let (held, damped) = (
        far(&sprung("lung", 20.0, 0.0), 1),
        far(&sprung("lung", 0.0, 200.0), 1),
    );
    assert!(
        held < 0.6 * free && damped < 0.8 * free,
        "{held} and {damped} of {free}"
    );
    assert!(
        (far(&sprung("lung", 20.0, 0.0), 3) / held - 1.0).abs() < 1e-2,
        "on threads"
    );
    // Springs are the beat's: step 0 does without them.
    assert_eq!(inflated(&anatomy, &sprung("lung", 20.0, 0.0)).u, state.u);
    let mut unknown = inflated(&anatomy, &wall(None));
    let error = sprung("liver", 1.0, 0.0)
        .support(&anatomy, &mut unknown.dynamics, &state.u)
        .expect_err("no liver");
    assert!(
        matches!(&error, WallError::NoSurface { name, .. } if name == "liver"),
        "{error}"
    );
}
