//! What fibres and activation times of a generated ventricle take on one thread and on several, and how far they differ.
//!
//! `tissue-ranks NODES THREADS…`

use std::sync::OnceLock;
use std::time::Instant;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::tissue::{Tissue, TissueJob};
use cardiotwin_mesh::eikonal::Conduction;
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::FibreAngles;
use cardiotwin_mesh::tags;
use cardiotwin_units::Ml;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = std::env::args()
        .skip(1)
        .map(|word| word.parse())
        .collect::<Result<Vec<usize>, _>>()?;
    let [n_nodes, of_threads @ ..] = arguments.as_slice() else {
        return Err("expected NODES THREADS…".into());
    };
    let made = generate(&EllipsoidSpec::new(Ml(112.0), Ml(140.0), *n_nodes))?;
    let job = TissueJob {
        muscle: vec![tags::LEFT_VENTRICLE],
        fibres: Some(FibreAngles::default()),
        conduction: Some(Conduction::of_left_ventricle(&made.shape.fascicles())),
    };
    println!(
        "{} nodes, {} tetrahedra",
        made.mesh.n_nodes(),
        made.mesh.n_tets()
    );
    let mut first: Option<Tissue> = None;
    for n_threads in of_threads {
        let (begun, fibred) = (Instant::now(), OnceLock::new());
        let done = || _ = fibred.set(begun.elapsed().as_secs_f64());
        let found = job.on_threads(&made.mesh, *n_threads, ThreadSettings::default(), &done)?;
        let (all, fibres) = (
            begun.elapsed().as_secs_f64(),
            fibred.into_inner().unwrap_or_default(),
        );
        println!(
            "{n_threads} threads: cut and fibres {fibres:.2} s, activation {:.2} s",
            all - fibres
        );
        let Some(first) = &first else {
            first = Some(found);
            continue;
        };
        let apart = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() };
        let most = first
            .activation_ms
            .iter()
            .zip(&found.activation_ms)
            .map(apart)
            .fold(0.0, f64::max);
        println!(
            "  fibres the same to the bit: {}; times differ by {most:.1e} ms at most",
            first.fibres == found.fibres
        );
    }
    Ok(())
}
