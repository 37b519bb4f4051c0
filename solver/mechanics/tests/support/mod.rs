//! A generated heart and its circulation.

#![allow(dead_code, reason = "each test uses a part of it")]

use cardiotwin_mesh::eikonal::{Conduction, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::{TetMesh, tags};
use cardiotwin_models::circulation::{Circulation, LeftHeart};
use cardiotwin_units::{Ml, Mmhg, Ms};

/// Tags of the tissue that contracts.
pub const MUSCLE: [i32; 1] = [tags::LEFT_VENTRICLE];

/// A mesh of 500 nodes for 112 mL with fibres, and its activation times.
pub fn heart() -> (TetMesh, Vec<f64>) {
    // A ring high enough that what its springs pull with hardly reaches the muscle.
    let spec = EllipsoidSpec {
        ring_height: 0.12,
        ..EllipsoidSpec::new(Ml(112.0), Ml(140.0), 500)
    };
    let made = generate(&spec).expect("a mesh");
    let mut mesh = made.mesh;
    make(&mut mesh, &MUSCLE, &FibreAngles::default()).expect("fields");
    let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
    let times = activation_ms(&mesh, &conduction).expect("times");
    (mesh, times)
}

/// A left heart with a cycle of 660 ms.
pub fn circulation() -> Circulation {
    let heart = LeftHeart::of_an_adult(Mmhg(9.0), Ms(660.0));
    heart.build().expect("a circulation")
}
