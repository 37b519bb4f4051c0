//! Checks of the surfaces that a patient's file names in addition to those of the left ventricle:
//! the right ventricle's inner wall, and surfaces with springs.

use std::collections::BTreeSet;

use super::surfaces::openings_off_rim;
use super::{Defect, Expected};
use crate::cavity::Cavity;
use crate::tet_mesh::{TetMesh, surface_names};

pub(super) fn check(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) {
    let there = |name: &str| {
        mesh.surface(name)
            .is_some_and(|surface| !surface.triangles.is_empty())
    };
    let lacks = |name: &str, key| Defect::NoFurther {
        name: name.to_owned(),
        key,
        found: mesh
            .surfaces
            .iter()
            .map(|surface| surface.name.clone())
            .collect(),
    };
    for name in expected.sprung.iter().filter(|name| !there(name)) {
        found.push(lacks(name, "solver.finite_element.wall.surface"));
    }
    let Some(name) = expected.right_ventricle else {
        return;
    };
    let lefts = [
        surface_names::ENDOCARDIUM,
        surface_names::EPICARDIUM,
        surface_names::RIM,
        surface_names::SEPTUM,
    ];
    if lefts.contains(&name) {
        found.push(Defect::NotRight {
            name: name.to_owned(),
        });
        return;
    }
    let Some(surface) = mesh
        .surface(name)
        .filter(|surface| !surface.triangles.is_empty())
    else {
        found.push(lacks(name, "anatomy.mesh.right_ventricle.surface"));
        return;
    };
    let Ok(cavity) = Cavity::behind(&surface.triangles) else {
        return;
    }; // reported with the surface's tangles
    let rim: BTreeSet<u32> = mesh
        .surface(surface_names::RIM)
        .map(|s| s.nodes())
        .into_iter()
        .flatten()
        .collect();
    let places = openings_off_rim(mesh, &cavity, &rim);
    if !places.is_empty() {
        found.push(Defect::RightHole {
            name: name.to_owned(),
            places,
        });
    }
}
