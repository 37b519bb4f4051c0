use super::*;
use crate::ellipsoid::{EllipsoidSpec, generate};
use crate::fibres::{FibreAngles, make};
use crate::order::Renumbering;
use crate::test_meshes::{block, cube};
use crate::tet_mesh::tags;
use crate::vec3::{add, scale, unit};
use cardiotwin_units::Ml;

const SPEEDS: Speeds = Speeds {
    fibre: 0.6,
    sheet: 0.4,
    normal: 0.25,
};

/// Gives all elements the same oblique frame.
fn oblique(mesh: &mut TetMesh) -> Frame {
    let fibre = unit([1.0, 2.0, 0.5]).unwrap();
    let sheet = crate::vec3::any_perpendicular(fibre);
    let frame = Frame {
        fibre,
        sheet,
        normal: crate::vec3::cross(fibre, sheet),
    };
    mesh.frames = vec![frame; mesh.n_tets()];
    frame
}

fn conduction(sites: Vec<Site>) -> Conduction {
    Conduction {
        speeds: SPEEDS,
        endocardial_speed: None,
        tags: vec![1],
        sites,
    }
}

fn order(errors: &[(f64, f64)]) -> Vec<f64> {
    errors
        .windows(2)
        .map(|pair| (pair[0].1 / pair[1].1).ln() / (pair[0].0 / pair[1].0).ln())
        .collect()
}

/// Edge length, and largest error in a cube of 20 mm around a point source in its centre.
fn point_source_error(n: usize, radius_mm: f64) -> (f64, f64) {
    let mut mesh = cube(n, 20.0);
    let frame = oblique(&mut mesh);
    let centre = [10.0; 3];
    let site = Site {
        at_mm: centre,
        radius_mm,
        time: Ms(5.0),
    };
    let times = activation_ms(&mesh, &conduction(vec![site])).unwrap();
    let error =
        |(x, t): (&Vec3, &f64)| (t - 5.0 - norm(slowness(&frame, &SPEEDS, sub(*x, centre)))).abs();
    (
        20.0 / n as f64,
        mesh.nodes_mm
            .iter()
            .zip(&times)
            .map(error)
            .fold(0.0, f64::max),
    )
}

#[test]
fn a_point_source_converges_with_its_logarithmic_first_order() {
    let errors = [6, 12, 24].map(|n| point_source_error(n, 0.0));
    // The error near a point source propagates through the whole field. It is h ln(L/h), whose
    // observed order is 0.5 to 0.7 here.
    let scaled = errors.map(|(h, error)| error / (h * (20.0 / h).ln()));
    for pair in scaled.windows(2) {
        assert!(
            (pair[0] / pair[1] - 1.0).abs() < 0.05,
            "{scaled:?}: {errors:?}"
        );
    }
}

#[test]
fn an_exact_ball_around_the_point_restores_first_order() {
    let errors = [6, 12, 24].map(|n| point_source_error(n, 6.0));
    for order in order(&errors) {
        assert!((0.8..1.3).contains(&order), "{order}: {errors:?}");
    }
    assert!(errors[2].1 < 0.6 * point_source_error(24, 0.0).1);
}

#[test]
fn a_plane_wave_is_exact() {
    // A wave from the left face along x, with an anisotropic tensor whose axes differ from the
    // block's.
    let mut mesh = block([12, 5, 4], [24.0, 8.0, 8.0]);
    let frame = oblique(&mut mesh);
    let along = [frame.fibre[0], frame.sheet[0], frame.normal[0]];
    let speed = (0..3)
        .map(|i| (along[i] * [0.6, 0.4, 0.25][i]).powi(2))
        .sum::<f64>()
        .sqrt();
    // All nodes of the faces on which the exact wave is prescribed.
    let given = |x: &Vec3| x[0] == 0.0 || x[1] == 0.0 || x[2] == 0.0 || x[1] == 8.0 || x[2] == 8.0;
    let mut front_times = vec![f64::INFINITY; mesh.n_nodes()];
    for (node, x) in mesh.nodes_mm.iter().enumerate().filter(|(_, x)| given(x)) {
        front_times[node] = x[0] / speed;
    }
    let site = Site {
        at_mm: [0.0; 3],
        radius_mm: 0.0,
        time: Ms(0.0),
    };
    let conduction = conduction(vec![site]);
    let alone = Alone(mesh.n_nodes());
    let front = Front::new(&mesh, &alone, &conduction).unwrap();
    front.run(&mut front_times);
    for (x, t) in mesh.nodes_mm.iter().zip(&front_times) {
        assert!(
            (t - x[0] / speed).abs() < 1e-10,
            "{x:?}: {t}, exactly {}",
            x[0] / speed
        );
    }
}

/// A wave from the face x = 0 through tissue whose fibres turn from x to y.
#[test]
fn a_plane_wave_in_changing_tissue_converges_with_first_order_or_better() {
    let errors: Vec<(f64, f64)> = [8, 16, 32]
        .iter()
        .map(|n| {
            // Wide enough for the ray that drifts along the fibre on its way to the far end.
            let mut mesh = block([*n, 3 * *n / 4, 2], [20.0, 15.0, 40.0 / *n as f64]);
            // The fibre turns from x to y. Along x, the squared speed is 0.36 cos² + 0.09 sin².
            let angle = |x: f64| x / 20.0 * std::f64::consts::FRAC_PI_2;
            mesh.frames = (0..mesh.n_tets())
                .map(|e| {
                    let (s, c) = angle(mesh.centroid_mm(e)[0]).sin_cos();
                    Frame {
                        fibre: [c, s, 0.0],
                        sheet: [-s, c, 0.0],
                        normal: [0.0, 0.0, 1.0],
                    }
                })
                .collect();
            let speeds = Speeds {
                fibre: 0.6,
                sheet: 0.3,
                normal: 0.3,
            };
            let faces: Vec<usize> = (0..mesh.n_nodes())
                .filter(|i| mesh.nodes_mm[*i][0] == 0.0)
                .collect();
            let sites = faces
                .iter()
                .map(|node| Site {
                    at_mm: mesh.nodes_mm[*node],
                    radius_mm: 0.0,
                    time: Ms(0.0),
                })
                .collect();
            let times = activation_ms(
                &mesh,
                &Conduction {
                    speeds,
                    ..conduction(sites)
                },
            )
            .unwrap();
            // Exact time by Simpson's rule, with dt/dx = 1/speed(x).
            let slow = |x: f64| {
                let (s, c) = angle(x).sin_cos();
                1.0 / (0.36 * c * c + 0.09 * s * s).sqrt()
            };
            let exact: f64 = (0..1000)
                .map(|i| {
                    let (a, b) = (
                        20.0 * f64::from(i) / 1000.0,
                        20.0 * f64::from(i + 1) / 1000.0,
                    );
                    (b - a) / 6.0 * (slow(a) + 4.0 * slow(0.5 * (a + b)) + slow(b))
                })
                .sum();
            // At other nodes of the far face, the ray would come from outside the block, and the
            // computed wave is later.
            let last = (0..mesh.n_nodes())
                .filter(|i| mesh.nodes_mm[*i][0] == 20.0)
                .map(|i| times[i])
                .fold(f64::INFINITY, f64::min);
            (20.0 / *n as f64, (last - exact).abs())
        })
        .collect();
    for order in order(&errors) {
        assert!(order > 0.8, "{order}: {errors:?}");
    }
    assert!(errors[2].1 < 1.0, "{errors:?}");
}

fn heart(n_nodes: usize) -> (TetMesh, crate::ellipsoid::Shape) {
    let made = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes)).unwrap();
    let mut mesh = made.mesh;
    let muscle = &[tags::LEFT_VENTRICLE];
    make(&mut mesh, muscle, &FibreAngles::default()).unwrap();
    (mesh, made.shape)
}

fn sinus(shape: &crate::ellipsoid::Shape) -> Conduction {
    Conduction::of_left_ventricle(&shape.fascicles())
}

#[test]
fn a_ventricle_with_a_fast_endocardium_is_activated_within_forty_to_sixty_ms_at_any_resolution() {
    let last = |n_nodes: usize| {
        let (mesh, shape) = heart(n_nodes);
        let times = activation_ms(&mesh, &sinus(&shape)).unwrap();
        times
            .into_iter()
            .filter(|t| t.is_finite())
            .fold(0.0, f64::max)
    };
    let ends = [1500, 10_000].map(last);
    for end in ends {
        assert!((40.0..60.0).contains(&end), "{ends:?}");
    }
    assert!((ends[0] / ends[1] - 1.0).abs() < 0.1, "{ends:?}");
    let (mesh, shape) = heart(1500);
    let slow = activation_ms(
        &mesh,
        &Conduction {
            endocardial_speed: None,
            ..sinus(&shape)
        },
    )
    .unwrap();
    assert!(
        slow.into_iter()
            .filter(|t| t.is_finite())
            .fold(0.0, f64::max)
            > 1.4 * ends[0]
    );
}

#[test]
fn times_do_not_depend_on_the_numbering() {
    let (mesh, shape) = heart(1500);
    let times = activation_ms(&mesh, &sinus(&shape)).unwrap();
    let other = Renumbering::shuffled(&mesh, 7);
    let again = activation_ms(&other.apply(&mesh), &sinus(&shape)).unwrap();
    for (new, old) in other.nodes.iter().enumerate() {
        let (a, b) = (times[*old as usize], again[new]);
        assert!(a == b || (a - b).abs() < 1e-9, "{a} {b}");
    }
}

#[test]
fn passive_tissue_is_not_activated_and_errors_name_their_cause() {
    let (mesh, shape) = heart(600);
    let good = sinus(&shape);
    let times = activation_ms(&mesh, &good).unwrap();
    let rim = mesh.surface(surface_names::RIM).unwrap().nodes();
    assert!(rim.iter().all(|node| times[*node as usize].is_infinite()));
    let told = |change: &dyn Fn(&mut Conduction)| {
        let mut broken = good.clone();
        change(&mut broken);
        activation_ms(&mesh, &broken).unwrap_err().to_string()
    };
    assert!(told(&|c| c.sites.clear()).contains("no activation site"));
    assert!(told(&|c| c.speeds.sheet = 0.0).contains("the sheet speed is 0 mm/ms"));
    assert!(told(&|c| c.tags = vec![9]).contains("conducting tags [9]"));
    assert!(told(&|c| c.tags = vec![1, 2]).contains("conducts, but has no fibre"));
    let far = told(&|c| c.sites[1].at_mm = scale(add(c.sites[1].at_mm, [1.0; 3]), 1000.0));
    assert!(
        far.contains("site 1 lies") && far.contains("check its unit"),
        "{far}"
    );
}
