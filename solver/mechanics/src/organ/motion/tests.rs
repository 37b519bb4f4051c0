use super::*;
use cardiotwin_linalg::vec3::scale;
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_units::Ml;

/// Components of a node's position along and perpendicular to an axis through the origin.
fn about(origin: Vec3, axis: Vec3, x: Vec3) -> [Vec3; 2] {
    let along = scale(axis, dot(sub(x, origin), axis));
    [along, reject(sub(x, origin), axis)]
}

/// Moves points by a rotation and a translation.
fn moved(x: &[Vec3]) -> Vec<Vec3> {
    let axis = unit([0.3, -0.8, 0.5]).expect("a direction");
    let (s, c) = 2.1f64.sin_cos();
    let turned = |v: Vec3| {
        axpy(
            axpy(scale(v, c), s, cross(axis, v)),
            (1.0 - c) * dot(axis, v),
            axis,
        )
    };
    x.iter()
        .map(|v| add(turned(*v), [120.0, -35.0, 7.0]))
        .collect()
}

fn mesh(n_nodes: usize) -> TetMesh {
    generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), n_nodes))
        .expect("a mesh")
        .mesh
}

/// A mesh in a general orientation, its landmarks, its apex and its axis.
fn lying(n_nodes: usize) -> (TetMesh, Landmarks, Vec3, Vec3) {
    let mut mesh = mesh(n_nodes);
    mesh.nodes_mm = moved(&mesh.nodes_mm);
    let landmarks = Landmarks::of(&mesh).expect("landmarks");
    let (axis, apex) = (
        landmarks.axis(&mesh.nodes_mm).0,
        landmarks.apex[0].mean(&mesh.nodes_mm),
    );
    (mesh, landmarks, apex, axis)
}

#[test]
fn the_axis_of_an_ellipsoid_is_its_own_on_any_mesh() {
    for n_nodes in [500, 2000, 8000] {
        let mesh = mesh(n_nodes);
        let landmarks = Landmarks::of(&mesh).expect("landmarks");
        let (axis, _) = landmarks.axis(&mesh.nodes_mm);
        assert!(
            axis[2] < -0.9999,
            "the apex lies at the lower end: {axis:?}"
        );
        let shape = landmarks.shape(&mesh.nodes_mm, &mesh.nodes_mm);
        assert!(
            shape.wall_mm() > 5.0 && shape.cavity_length_mm > 2.0 * shape.radius_mm[0],
            "{shape:?}"
        );
    }
}

#[test]
fn a_rigid_motion_changes_no_shape() {
    let (mesh, landmarks, ..) = lying(1000);
    let x = &mesh.nodes_mm;
    let (a, b) = (landmarks.shape(x, x), landmarks.shape(x, &moved(x)));
    assert!((a.cavity_length_mm - b.cavity_length_mm).abs() < 1e-9);
    assert!((0..2).all(|k| (a.radius_mm[k] - b.radius_mm[k]).abs() < 1e-9));
    // All levels turn alike in a rigid rotation, so there is no twist.
    assert!(
        b.twist_deg().iter().all(|twist| twist.abs() < 1e-9),
        "{b:?}"
    );
    let [least, most] = volume_ratios(&mesh.tets, x, &moved(x));
    assert!((least - 1.0).abs() < 1e-9 && (most - 1.0).abs() < 1e-9);
}

#[test]
fn a_stretch_along_and_across_the_axis_is_measured() {
    let (mesh, landmarks, apex, axis) = lying(1000);
    let x = &mesh.nodes_mm;
    // The cavity is shortened by 15 % and narrowed by 10 %, with the apex fixed.
    let squeezed: Vec<Vec3> = x
        .iter()
        .map(|x| {
            let [along, across] = about(apex, axis, *x);
            add(apex, add(scale(along, 0.85), scale(across, 0.9)))
        })
        .collect();
    let mut series = Series::new(landmarks.shape(x, x));
    series.push(10, landmarks.shape(x, &squeezed));
    series.strained(volume_ratios(&mesh.tets, x, &squeezed));
    let phases = Phases {
        ejection_ms: 5.0,
        end_systole_ms: 10.0,
        filling_ms: None,
    };
    let times: Vec<f64> = (0..=10).map(f64::from).collect();
    let m = series.measures(&phases, &times, &[9.0, 4.0, 6.0]);
    let length = landmarks.axis(x).1;
    for (found, expected) in [
        (m.shortening_percent, 15.0),
        (m.base_descent_mm, 0.15 * length),
        (m.epicardial_radius_change_percent, -10.0),
        (m.wall_thickening_percent, -10.0),
        // Halfway between the two samples half of the shortening is reached.
        (m.isovolumic_lengthening_percent, -7.5),
        (m.twist_epi_deg, 0.0),
        (m.least_pressure_mmhg, 4.0),
        (m.least_volume_ratio, 0.85 * 0.81),
        (m.largest_volume_ratio, 0.85 * 0.81),
    ] {
        assert!(
            (found - expected).abs() < 1e-6,
            "{found} for {expected}: {m:?}"
        );
    }
    assert_eq!(m.isovolumic_untwisting_percent, None);
    // The epicardial apex lies a wall thickness beyond the endocardial apex, which is fixed.
    let wall = dot(sub(landmarks.apex[1].mean(x), apex), axis);
    assert!(
        (m.apex_rise_mm - 0.15 * wall).abs() < 1e-6 && wall > 3.0,
        "{m:?}"
    );
}

#[test]
fn a_torsion_is_twist_with_the_sense_of_the_literature() {
    for n_nodes in [500, 4000] {
        let (mesh, landmarks, apex, axis) = lying(n_nodes);
        let x = &mesh.nodes_mm;
        let length = landmarks.axis(x).1;
        // Counter-clockwise rotation as seen from the apex: 40 degrees at the apex, falling to zero at the rim.
        let turned = |whole_deg: f64| -> Vec<Vec3> {
            let point = |x: &Vec3| {
                let [along, across] = about(apex, axis, *x);
                let height = -dot(along, axis) / length;
                let (s, c) = (whole_deg * (1.0 - height)).to_radians().sin_cos();
                add(
                    apex,
                    add(along, axpy(scale(across, c), s, cross(axis, across))),
                )
            };
            x.iter().map(point).collect()
        };
        let shape = landmarks.shape(x, &turned(40.0));
        for rotation in [shape.endo_rotation_deg, shape.epi_rotation_deg] {
            assert!(
                (rotation[0] - 30.0).abs() < 2.0 && (rotation[1] - 10.0).abs() < 2.0,
                "{n_nodes}: {shape:?}"
            );
        }
        assert!(
            shape
                .twist_deg()
                .iter()
                .all(|twist| (twist - 20.0).abs() < 2.0),
            "{n_nodes}: {shape:?}"
        );
        let mut series = Series::new(landmarks.shape(x, x));
        series.push(10, landmarks.shape(x, &turned(40.0)));
        series.push(20, landmarks.shape(x, &turned(28.0)));
        let times: Vec<f64> = (0..=20).map(f64::from).collect();
        let m = series.measures(
            &Phases {
                ejection_ms: 3.0,
                end_systole_ms: 10.0,
                filling_ms: Some(20.0),
            },
            &times,
            &[],
        );
        assert!(
            (m.isovolumic_untwisting_percent.unwrap_or_default() - 30.0).abs() < 0.5,
            "{m:?}"
        );
        assert!(
            m.shortening_percent.abs() < 1e-6 && m.base_descent_mm.abs() < 1e-6,
            "{m:?}"
        );
    }
}

/// Mean radius of an ellipsoid of revolution around a height, and the same after a motion of its points, by integration over the
/// smooth surface: nothing of the landmarks' code.
fn smooth_radius(
    [short, long]: [f64; 2],
    (from_z, to_z): (f64, f64),
    moved: impl Fn(f64) -> f64,
) -> f64 {
    let (middle, half) = (0.5 * (from_z + to_z), 0.125 * (to_z - from_z));
    let (mut sum, mut weight) = (0.0, 0.0);
    for k in 0..4000 {
        let z = middle + half * (f64::from(k) / 2000.0 - 0.9995);
        let across = (1.0 - (z / long).powi(2)).sqrt();
        let (r, slope) = (short * across, -short * z / (long * long * across));
        let w = (1.0 - (z - middle).abs() / half) * r * (1.0 + slope * slope).sqrt();
        sum += w * moved(r);
        weight += w;
    }
    sum / weight
}

#[test]
fn thickening_and_radii_are_those_of_the_smooth_wall_with_and_without_a_septum() {
    for (septum_deg, n_nodes) in [
        (0.0, 4000),
        (60.0, 4000),
        (120.0, 4000),
        (180.0, 4000),
        (120.0, 1000),
    ] {
        let spec = EllipsoidSpec {
            septum_deg,
            ..EllipsoidSpec::new(Ml(112.0), Ml(140.0), n_nodes)
        };
        let heart = generate(&spec).expect("a mesh");
        let (mesh, smooth) = (&heart.mesh, heart.shape);
        assert_eq!(
            mesh.surface(surface_names::SEPTUM).is_some(),
            septum_deg > 0.0
        );
        // The ring of the wall narrows as an incompressible one does: the area inside each radius falls by as much.
        let narrowed = |r: f64| (r * r - 0.6 * smooth.short_mm.powi(2)).max(0.0).sqrt();
        let x = &mesh.nodes_mm;
        let systole: Vec<Vec3> = x
            .iter()
            .map(|[a, b, z]| {
                let r = a.hypot(*b);
                let ratio = if r > 0.0 { narrowed(r) / r } else { 1.0 };
                [a * ratio, b * ratio, *z]
            })
            .collect();
        let ends = (-smooth.axes_mm(0.0)[1], smooth.rim_z_mm());
        let radii = |moved: &dyn Fn(f64) -> f64| {
            [0.0, 1.0].map(|depth| smooth_radius(smooth.axes_mm(depth), ends, moved))
        };
        let (before, after) = (radii(&|r| r), radii(&narrowed));
        let expected = 100.0 * ((after[1] - after[0]) / (before[1] - before[0]) - 1.0);
        let landmarks = Landmarks::of(mesh).expect("landmarks");
        let mut series = Series::new(landmarks.shape(x, x));
        series.push(1, landmarks.shape(x, &systole));
        let phases = Phases {
            ejection_ms: 0.5,
            end_systole_ms: 1.0,
            filling_ms: None,
        };
        let m = series.measures(&phases, &[0.0, 1.0], &[]);
        let begin = landmarks.shape(x, x);
        for k in 0..2 {
            assert!(
                (begin.radius_mm[k] / before[k] - 1.0).abs() < 0.015,
                "{septum_deg}°, {n_nodes} nodes: {:?} mm, expected {before:?}",
                begin.radius_mm
            );
        }
        assert!(expected > 30.0 && expected < 90.0, "{expected} %");
        assert!(
            (m.wall_thickening_percent - expected).abs() < 0.05 * expected,
            "{septum_deg}°, {n_nodes} nodes: {} %, expected {expected} %",
            m.wall_thickening_percent
        );
        let of_radius = 100.0 * (after[1] / before[1] - 1.0);
        assert!(
            (m.epicardial_radius_change_percent - of_radius).abs() < 0.5,
            "{septum_deg}°: {} %, expected {of_radius} %",
            m.epicardial_radius_change_percent
        );
    }
}

#[test]
fn a_twist_has_its_angle_about_the_ventricles_axis_whether_or_not_a_septum_is_marked() {
    for septum_deg in [0.0, 120.0, 180.0] {
        let spec = EllipsoidSpec {
            septum_deg,
            ..EllipsoidSpec::new(Ml(112.0), Ml(140.0), 4000)
        };
        let mesh = generate(&spec).expect("a mesh").mesh;
        let landmarks = Landmarks::of(&mesh).expect("landmarks");
        let x = &mesh.nodes_mm;
        // The wall turns by 12° as a whole about the long axis.
        let (s, c) = 12f64.to_radians().sin_cos();
        let turned: Vec<Vec3> = x
            .iter()
            .map(|[a, b, z]| [c * a - s * b, s * a + c * b, *z])
            .collect();
        let shape = landmarks.shape(x, &turned);
        for angle in [shape.endo_rotation_deg, shape.epi_rotation_deg].concat() {
            // Counter-clockwise about +z is clockwise as seen from the apex at −z.
            assert!((angle + 12.0).abs() < 1e-6, "{septum_deg}°: {shape:?}");
        }
        let spread = |patch: &Patch| norm(reject(patch.mean(x), [0.0, 0.0, 1.0]));
        for patch in landmarks.levels.iter().flatten() {
            assert!(
                spread(patch) < 0.3,
                "{septum_deg}°: centre {} mm off",
                spread(patch)
            );
        }
    }
}

#[test]
fn a_triangle_that_epicardium_and_septum_both_name_counts_once() {
    let mesh = mesh(1000);
    let mut doubled = mesh.clone();
    let septum = mesh
        .surface(surface_names::SEPTUM)
        .expect("a septum")
        .clone();
    let outer = (doubled.surfaces.iter_mut()).find(|s| s.name == surface_names::EPICARDIUM);
    outer
        .expect("an epicardium")
        .triangles
        .extend(septum.triangles);
    let [a, b] = [&mesh, &doubled].map(|mesh| {
        let landmarks = Landmarks::of(mesh).expect("landmarks");
        landmarks.shape(&mesh.nodes_mm, &mesh.nodes_mm)
    });
    for k in 0..2 {
        assert!(
            (a.radius_mm[k] - b.radius_mm[k]).abs() < 1e-9,
            "{a:?} {b:?}"
        );
    }
}

#[test]
fn a_series_survives_as_numbers() {
    let (mesh, landmarks, ..) = lying(500);
    let mut series = Series::new(landmarks.shape(&mesh.nodes_mm, &mesh.nodes_mm));
    series.push(3, landmarks.shape(&mesh.nodes_mm, &moved(&mesh.nodes_mm)));
    series.strained([0.9, 1.1]);
    assert_eq!(Series::of_numbers(&series.numbers()), Some(series.clone()));
    assert_eq!(
        (
            series.last_sample(),
            Series::of_numbers(&series.numbers()[1..])
        ),
        (3, None)
    );
}

#[test]
fn a_mesh_without_a_rim_has_no_landmarks() {
    let mut mesh = mesh(500);
    mesh.surfaces
        .retain(|surface| surface.name != surface_names::RIM);
    assert_eq!(
        Landmarks::of(&mesh),
        Err(LandmarkError::NoSurface {
            name: surface_names::RIM
        })
    );
}
