use super::*;
use crate::ellipsoid::{Ellipsoid, EllipsoidSpec, Shape, generate};
use crate::tet_mesh::tags;
use crate::vec3::{cross, dot};
use cardiotwin_units::Ml;

const MUSCLE: &[i32] = &[tags::LEFT_VENTRICLE];

/// Half an ellipsoid with confocal walls, in which the depth is a closed-form function of the
/// confocal coordinate.
fn confocal(n_nodes: usize) -> Ellipsoid {
    let mut spec = EllipsoidSpec {
        base_height: 0.0,
        ring_height: 0.0,
        septum_deg: 0.0,
        ..EllipsoidSpec::new(Ml(100.0), Ml(100.0), n_nodes)
    };
    let apex_wall = |shape: &Shape| {
        let ([a, c], [b, _]) = (shape.axes_mm(0.0), shape.axes_mm(1.0));
        ((c * c - a * a + b * b).sqrt() - c) / shape.wall_mm
    };
    for _ in 0..50 {
        spec.apex_wall = apex_wall(&Shape::from_volumes(&spec));
    }
    let mut heart = generate(&spec).unwrap();
    for _ in 0..2 {
        spec.apex_wall = apex_wall(&heart.shape);
        heart = generate(&spec).unwrap();
    }
    let ([a, c], [b, d]) = (heart.shape.axes_mm(0.0), heart.shape.axes_mm(1.0));
    assert!(((d * d - b * b) / (c * c - a * a) - 1.0).abs() < 1e-4);
    heart
}

/// Depth and frame in closed form. With ξ = (r₁ + r₂)/(2f) from the distances to the foci, ln((ξ +
/// 1)/(ξ − 1)) is harmonic; its gradient bisects the two focal directions.
fn exact(heart: &Ellipsoid, x: Vec3, angles: &FibreAngles) -> (f64, Frame) {
    let ([a, c], [_, d]) = (heart.shape.axes_mm(0.0), heart.shape.axes_mm(1.0));
    let focus = (c * c - a * a).sqrt();
    let (below, above) = ([x[0], x[1], x[2] + focus], [x[0], x[1], x[2] - focus]);
    let harmonic = |xi: f64| ((xi + 1.0) / (xi - 1.0)).ln();
    let xi = (norm(below) + norm(above)) / (2.0 * focus);
    let depth = (harmonic(xi) - harmonic(c / focus)) / (harmonic(d / focus) - harmonic(c / focus));
    let out = unit(add(unit(below).unwrap(), unit(above).unwrap())).unwrap();
    // On the axis, any direction is valid.
    let around = unit([-x[1], x[0], 0.0]).unwrap_or([1.0, 0.0, 0.0]);
    let up = cross(out, around);
    let between = |endo: f64, epi: f64| (endo + (epi - endo) * depth).to_radians();
    let alpha = between(angles.alpha_endo_deg, angles.alpha_epi_deg);
    (
        depth,
        turned(
            around,
            up,
            out,
            alpha,
            between(angles.beta_endo_deg, angles.beta_epi_deg),
        ),
    )
}

fn angle_deg(a: Vec3, b: Vec3) -> f64 {
    norm(cross(a, b)).atan2(dot(a, b).abs()).to_degrees()
}

#[test]
fn fibres_and_sheets_approach_the_closed_form_with_first_order_or_better() {
    let angles = FibreAngles::default();
    let errors: Vec<[f64; 4]> = [600, 4000, 20_000]
        .iter()
        .map(|n_nodes| {
            let heart = confocal(*n_nodes);
            let mesh = &heart.mesh;
            let fields = fields(mesh, MUSCLE, Longitudinal::FromBase).unwrap();
            let found = frames(mesh, MUSCLE, &fields, &angles);
            let mut sums = [0.0; 4];
            for (e, frame) in found.iter().enumerate() {
                let (_, exact) = exact(&heart, mesh.centroid_mm(e), &angles);
                sums[1] += angle_deg(frame.fibre, exact.fibre) / mesh.n_tets() as f64;
                sums[2] += angle_deg(frame.sheet, exact.sheet) / mesh.n_tets() as f64;
            }
            for (x, depth) in mesh.nodes_mm.iter().zip(&fields.depth) {
                sums[3] += (depth - exact(&heart, *x, &angles).0).abs() / mesh.n_nodes() as f64;
            }
            sums[0] = mesh.mean_edge_mm();
            sums
        })
        .collect();
    for pair in errors.windows(2) {
        for (quantity, least) in [(1, 0.8), (2, 0.8), (3, 1.0)] {
            let order =
                (pair[0][quantity] / pair[1][quantity]).ln() / (pair[0][0] / pair[1][0]).ln();
            assert!(order > least, "order {order} of {quantity}: {errors:?}");
        }
    }
    assert!(
        errors[1][1] < 2.0 && errors[2][1] < 1.0,
        "mean fibre error in degrees: {errors:?}"
    );
}

#[test]
fn the_helix_angle_runs_from_endocardium_to_epicardium() {
    let heart = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 12_000)).unwrap();
    let mesh = &heart.mesh;
    let fields = fields(mesh, MUSCLE, Longitudinal::FromBase).unwrap();
    let found = frames(mesh, MUSCLE, &fields, &FibreAngles::default());
    let mut worst: f64 = 0.0;
    for (e, frame) in found.iter().enumerate() {
        let x = mesh.centroid_mm(e);
        if mesh.tags[e] != tags::LEFT_VENTRICLE || x[2] > 0.0 || x[2] < -30.0 {
            continue;
        }
        let around = unit([-x[1], x[0], 0.0]).unwrap();
        let rise = frame.fibre[2].atan2(dot(frame.fibre, around)).to_degrees();
        let depth = mesh.tets[e]
            .iter()
            .map(|node| fields.depth[*node as usize])
            .sum::<f64>()
            / 4.0;
        // The wall is inclined by up to 20 degrees here, so that the rise is slightly less than α.
        worst = worst.max((rise - (60.0 - 120.0 * depth)).abs());
    }
    assert!(worst < 12.0, "{worst}");
}

#[test]
fn every_frame_of_muscle_is_orthonormal_and_passive_tissue_has_none() {
    for rule in [Longitudinal::FromBase, Longitudinal::FromApexNode(0)] {
        let heart = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 1000)).unwrap();
        let fields = fields(&heart.mesh, MUSCLE, rule).unwrap();
        let found = frames(&heart.mesh, MUSCLE, &fields, &FibreAngles::default());
        for (
            e,
            Frame {
                fibre: f,
                sheet: s,
                normal: n,
            },
        ) in found.into_iter().enumerate()
        {
            if heart.mesh.tags[e] != tags::LEFT_VENTRICLE {
                assert_eq!((f, s, n), ([0.0; 3], [0.0; 3], [0.0; 3]));
                continue;
            }
            for (a, b, product) in [
                (f, f, 1.0),
                (s, s, 1.0),
                (n, n, 1.0),
                (f, s, 0.0),
                (s, n, 0.0),
                (n, f, 0.0),
            ] {
                assert!((dot(a, b) - product).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn both_longitudinal_fields_give_nearly_the_same_fibres() {
    let heart = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 6000)).unwrap();
    let mesh = &heart.mesh;
    let [a, b] = [Longitudinal::FromBase, Longitudinal::FromApexNode(0)].map(|rule| {
        frames(
            mesh,
            MUSCLE,
            &fields(mesh, MUSCLE, rule).unwrap(),
            &FibreAngles::default(),
        )
    });
    let muscle: Vec<usize> = (0..mesh.n_tets())
        .filter(|e| mesh.tags[*e] == tags::LEFT_VENTRICLE)
        .collect();
    let mean = muscle
        .iter()
        .map(|e| angle_deg(a[*e].fibre, b[*e].fibre))
        .sum::<f64>()
        / muscle.len() as f64;
    assert!(mean < 4.0, "{mean}");
}

#[test]
fn a_vanishing_field_still_gives_whole_frames() {
    let mut mesh = crate::test_meshes::cube(2, 10.0);
    mesh.tags.fill(1);
    let fields = Fields {
        depth: vec![0.5; mesh.n_nodes()],
        longitudinal: vec![2.0; mesh.n_nodes()],
    };
    for frame in frames(&mesh, MUSCLE, &fields, &FibreAngles::default()) {
        assert!(
            (norm(frame.fibre) - 1.0).abs() < 1e-12 && dot(frame.fibre, frame.sheet).abs() < 1e-12
        );
    }
}

#[test]
fn a_missing_surface_is_named() {
    let mut mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 500))
        .unwrap()
        .mesh;
    mesh.surfaces
        .retain(|surface| surface.name != surface_names::ENDOCARDIUM);
    let error = fields(&mesh, MUSCLE, Longitudinal::FromBase)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("transmural field") && error.contains("endocardium and epicardium"),
        "{error}"
    );
}
