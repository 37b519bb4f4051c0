use super::*;
use crate::quality::Quality;
use crate::surface::{area_vector, openings};
use crate::vec3::{dot, sub};
use proptest::prelude::*;

fn made(n_nodes: usize) -> Ellipsoid {
    generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes)).unwrap()
}

#[test]
fn volumes_are_met_to_round_off_and_nodes_within_three_percent() {
    for n_nodes in [500, 1000, 3000, 20_000] {
        let heart = made(n_nodes);
        let endocardium = heart.mesh.surface(surface_names::ENDOCARDIUM).unwrap();
        let cavity = Cavity::behind(&endocardium.triangles)
            .unwrap()
            .volume(&heart.mesh.nodes_mm);
        assert!((cavity.0 / 120.0 - 1.0).abs() < 1e-9, "{cavity}");
        let wall = heart.mesh.tissue_volume(&[tags::LEFT_VENTRICLE]);
        assert!((wall.0 / 130.0 - 1.0).abs() < 1e-9, "{wall}");
        assert!(heart.mesh.tissue_volume(&[tags::AORTIC_ROOT]).0 > 3.0);
        let off = heart.mesh.n_nodes() as f64 / n_nodes as f64 - 1.0;
        assert!(
            off.abs() < 0.03,
            "{n_nodes} asked, {} made",
            heart.mesh.n_nodes()
        );
    }
}

#[test]
fn the_smooth_body_of_the_fitted_lengths_is_approached_with_second_order() {
    let errors: Vec<[f64; 3]> = [1000, 8000, 64_000]
        .iter()
        .map(|n_nodes| {
            let heart = made(*n_nodes);
            let edge = heart.mesh.mean_edge_mm();
            [
                edge,
                heart.shape.cavity_mm3() / 120e3 - 1.0,
                heart.shape.wall_mm3() / 130e3 - 1.0,
            ]
        })
        .collect();
    for pair in errors.windows(2) {
        for quantity in [1, 2] {
            let order = (pair[0][quantity].abs() / pair[1][quantity].abs()).ln()
                / (pair[0][0] / pair[1][0]).ln();
            assert!(
                (1.8..=2.4).contains(&order),
                "order {order} of quantity {quantity}: {errors:?}"
            );
        }
    }
}

#[test]
fn closed_form_volumes_are_those_of_a_half_ellipsoid_and_a_whole_one() {
    let shape = Shape {
        short_mm: 20.0,
        wall_mm: 10.0,
        long_to_short: 2.0,
        apex_wall: 1.0,
        base_height: 0.0,
        rim_height: 0.0,
    };
    let half = 2.0 / 3.0 * std::f64::consts::PI * 20.0 * 20.0 * 40.0;
    assert!((shape.cavity_mm3() / half - 1.0).abs() < 1e-14);
    assert!((shape.solid_mm3(0.0, 40.0) / (2.0 * half) - 1.0).abs() < 1e-14);
    let outer = 2.0 / 3.0 * std::f64::consts::PI * 30.0 * 30.0 * 50.0;
    assert!((shape.wall_mm3() / (outer - half) - 1.0).abs() < 1e-14);
}

#[test]
fn elements_are_well_shaped_at_every_resolution() {
    for n_nodes in [500, 1000, 2000, 8000, 32_000] {
        let q = Quality::of(&made(n_nodes).mesh);
        // The ring is thinner than an edge of the coarsest meshes.
        let (min, mean, max_deg) = if n_nodes <= 1000 {
            (0.38, 0.63, 155.0)
        } else {
            (0.5, 0.77, 145.0)
        };
        assert!(q.min > min, "{n_nodes}: {q:?}");
        assert!(q.mean > mean, "{n_nodes}: {q:?}");
        assert!(q.max_dihedral_deg < max_deg, "{n_nodes}: {q:?}");
    }
}

#[test]
fn no_more_elements_meet_at_the_apex_than_at_other_nodes() {
    let heart = made(8000);
    let around = crate::adjacency::Adjacency::node_to_tets(heart.mesh.n_nodes(), &heart.mesh.tets);
    let most = (0..heart.mesh.n_nodes())
        .map(|node| around.row(node).len())
        .max()
        .unwrap();
    let at_apex = (0..=heart.n_layers)
        .map(|node| around.row(node).len())
        .max()
        .unwrap();
    assert!(
        at_apex <= 36 && most <= 48,
        "{at_apex} at the apex, {most} at most"
    );
}

#[test]
fn surfaces_cover_the_boundary_once_and_point_outward() {
    let heart = made(2000);
    let mut covered: Vec<[u32; 3]> = heart
        .mesh
        .surfaces
        .iter()
        .flat_map(|s| s.triangles.iter().map(|t| sorted(*t)))
        .collect();
    covered.sort_unstable();
    let mut all: Vec<[u32; 3]> = boundary(&heart.mesh)
        .iter()
        .map(|face| sorted(face.triangle))
        .collect();
    all.sort_unstable();
    assert_eq!(covered, all);
    let count = |name: &str| {
        openings(&heart.mesh.surface(name).unwrap().triangles)
            .unwrap()
            .len()
    };
    assert_eq!(count(surface_names::ENDOCARDIUM), 1);
    assert_eq!(count(surface_names::RIM), 2);
    assert_eq!(count(surface_names::SEPTUM), 1);
    assert_eq!(count(surface_names::EPICARDIUM), 2);
    let septum = heart.mesh.surface(surface_names::SEPTUM).unwrap();
    for triangle in &septum.triangles {
        let at = heart.mesh.nodes_mm[triangle[0] as usize];
        assert!(
            dot(
                area_vector(*triangle, &heart.mesh.nodes_mm),
                sub(at, [0.0, 0.0, at[2]])
            ) > 0.0
        );
        assert!(at[0] < 0.0);
    }
    let epicardium = heart
        .mesh
        .surface(surface_names::EPICARDIUM)
        .unwrap()
        .area_mm2(&heart.mesh.nodes_mm);
    let share = septum.area_mm2(&heart.mesh.nodes_mm)
        / (epicardium + septum.area_mm2(&heart.mesh.nodes_mm));
    assert!((0.15..0.33).contains(&share), "{share}");
}

#[test]
fn the_same_spec_gives_the_same_mesh() {
    assert_eq!(made(3000), made(3000));
}

#[test]
fn a_setting_outside_its_range_is_named() {
    let spec = EllipsoidSpec {
        base_height: 0.75,
        ..EllipsoidSpec::new(Ml(120.0), Ml(130.0), 1000)
    };
    let message = generate(&spec).unwrap_err().to_string();
    assert_eq!(
        message,
        "ellipsoid: base_height is 0.75, expected a number from -0.5 to 0.7"
    );
    let spec = EllipsoidSpec::new(Ml(f64::NAN), Ml(130.0), 1000);
    assert!(
        generate(&spec)
            .unwrap_err()
            .to_string()
            .contains("cavity (mL) is NaN")
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_heart_in_range_is_sound(
        cavity in 30.0..300.0f64, wall_share in 0.6..2.0f64, long_to_short in 1.6..3.0f64,
        base in 0.0..0.4f64, ring in 0.05..0.2f64, apex_wall in 0.6..1.2f64, n_nodes in 500usize..4000,
    ) {
        let spec = EllipsoidSpec {
            long_to_short, base_height: base, ring_height: ring, apex_wall,
            ..EllipsoidSpec::new(Ml(cavity), Ml(cavity * wall_share), n_nodes)
        };
        let heart = generate(&spec).unwrap();
        let q = Quality::of(&heart.mesh);
        prop_assert!(q.min > 0.15, "{q:?}");
        prop_assert!(q.mean > 0.5, "{q:?}");
        let used: std::collections::BTreeSet<u32> = heart.mesh.tets.iter().flatten().copied().collect();
        prop_assert_eq!(used.len(), heart.mesh.n_nodes());
    }
}
