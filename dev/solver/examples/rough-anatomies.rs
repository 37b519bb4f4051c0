//! Writes a cohort of hearts with difficult meshes, or searches their passive states as step 0 does.
//!
//! ```text
//! rough-anatomies COHORT MESH PRESSURE
//! ```
//!
//! - `COHORT`: folder that `cardiotwin init` made
//! - `MESH`: stem of the CARP files of `examples/meshes/arostica_lv`
//! - `PRESSURE`: pressure trace that every heart gets
//!
//! ```text
//! rough-anatomies MESH THREADS SECONDS [NAME ...]
//! ```
//!
//! Searches the passive state of each heart, or of those named, as step 0 does, but on its own mesh alone, and prints a row of a
//! table as each ends. A search of more than `SECONDS` of processor time is stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use cardiotwin_linalg::parallel::ThreadSettings;
use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, PassiveFit, PassiveJob, Search, SearchProgress, SearchWork,
    UnloadingSettings, WallParameters,
};
use cardiotwin_mesh::LengthUnit;
use cardiotwin_mesh::cavity::Cavity;
use cardiotwin_mesh::checks::{Expected, Severity, check};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::files::carp;
use cardiotwin_mesh::find_surfaces::find_surfaces;
use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::quality::{Quality, mean_ratio};
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names, tags};
use cardiotwin_mesh::vec3::{Vec3, cross, distance, sub, unit};
use cardiotwin_models::ventricle::passive_state::klotz_unloaded_volume;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Mmhg};

/// End-diastolic pressure of every heart.
const FILLING_MMHG: f64 = 8.0;
/// Mean ratio of the flattest elements, just above the one that `cardiotwin check` refuses.
const LEAST: f64 = 0.021;
/// Height of a layer of the aortic root \[mm\], in which a layer's tetrahedra are flat.
const LAYER_MM: f64 = 1.2;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let limits = match &arguments[..] {
        [_, threads, seconds, ..] => threads.parse().ok().zip(seconds.parse().ok()),
        _ => None,
    };
    let source = match (&arguments[..], limits) {
        ([source, ..], Some(_)) | ([_, source, _], None) => source,
        _ => {
            return Err("expected COHORT MESH PRESSURE, or MESH THREADS SECONDS [NAME ...]".into());
        }
    };
    let mut public = carp::read(Path::new(source), LengthUnit::Micrometre)?;
    public.tags.fill(tags::LEFT_VENTRICLE);
    // Its axis is x; the shapes below have their base at the upper end of z.
    public.nodes_mm.iter_mut().for_each(|x| x.rotate_left(1));
    let ellipsoid = |cavity_ml: f64, wall_ml: f64, n_nodes: usize| {
        generate(&EllipsoidSpec::new(Ml(cavity_ml), Ml(wall_ml), n_nodes)).map(|made| made.mesh)
    };
    let usual = ellipsoid(140.0, 150.0, 4000)?;
    let shapes = [
        ("public", public.clone()),
        ("public-uneven", uneven(&public, 0.05)),
        ("public-slivers", slivers(&public, 0.05, LEAST)),
        ("public-fine-apex", fine_apex(&public, 3)),
        ("public-root", with_root(&public, 14, 1.5)?),
        ("notch-at-base", without_ball(&public, 0.9, 6.0)?),
        ("hole-at-base", without_ball(&public, 0.5, 8.0)?),
        ("thin-wall", ellipsoid(140.0, 45.0, 4000)?),
        ("thick-wall", ellipsoid(60.0, 260.0, 4000)?),
        ("large", ellipsoid(320.0, 240.0, 4000)?),
        ("small", ellipsoid(12.0, 11.0, 4000)?),
        ("uneven", uneven(&usual, 0.05)),
        (
            "root-13000",
            slivers(
                &with_root(&ellipsoid(140.0, 150.0, 9500)?, 8, 1.5)?,
                0.1,
                LEAST,
            ),
        ),
    ];
    if let Some((threads, seconds)) = limits {
        println!(
            "| shape | nodes | mean ratio: least, mean | Newton; linear iterations | s, processor s | outcome |"
        );
        println!("|---|---|---|---|---|---|");
        let wanted = &arguments[3..];
        for (name, mesh) in shapes {
            if wanted.is_empty() || wanted.iter().any(|own| own == name) {
                println!("{}", row(name, mesh, threads, seconds));
            }
        }
        return Ok(());
    }
    let [cohort, _, pressure] = &arguments[..] else {
        unreachable!("other arguments were handled above")
    };
    for (name, mesh) in shapes {
        write(
            &Path::new(cohort).join("patients").join(name),
            name,
            mesh,
            Path::new(pressure),
        )?;
    }
    Ok(())
}

/// A row of the table.
fn row(name: &str, mesh: TetMesh, threads: usize, seconds: f64) -> String {
    let quality = Quality::of(&mesh);
    let (begun, before) = (Instant::now(), processor_s());
    let (work, outcome) = match searched(mesh.clone(), threads, seconds) {
        Ok((work, outcome)) => (work, outcome),
        Err(error) => (SearchWork::default(), error.to_string()),
    };
    format!(
        "| {name} | {} | {:.3}, {:.2} | {}; {} | {:.0}, {:.0} | {outcome} |",
        mesh.n_nodes(),
        quality.min,
        quality.mean,
        work.newton_iterations,
        work.krylov_iterations,
        begun.elapsed().as_secs_f64(),
        processor_s() - before
    )
}

/// Processor time of this process, all threads together \[s\]; zero where the system does not tell.
fn processor_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields after the name: the 12th and 13th are user and system time in hundredths of a second.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(11).take(2);
    ticks.filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// Work and outcome of the search on a mesh that `cardiotwin check` accepts.
fn searched(
    mut mesh: TetMesh,
    threads: usize,
    seconds: f64,
) -> Result<(SearchWork, String), Box<dyn Error>> {
    mesh.frames.clear();
    mesh.surfaces = find_surfaces(&mesh)?;
    let found = check(&mesh, LengthUnit::Millimetre, &Expected::default());
    if let Some(defect) = found
        .into_iter()
        .find(|defect| defect.severity() == Severity::Error)
    {
        return Err(defect.to_string().into());
    }
    let inner = mesh
        .surface(surface_names::ENDOCARDIUM)
        .ok_or("no endocardium")?;
    let cavity = Cavity::behind(&inner.triangles)?.volume(&mesh.nodes_mm);
    let mut mesh = Renumbering::reverse_cuthill_mckee(&mesh).apply(&mesh);
    let muscle = &[tags::LEFT_VENTRICLE];
    make(&mut mesh, muscle, &FibreAngles::default())?;
    let anatomy = Anatomy::of(&mesh, muscle, ElementKind::LINEAR_NODAL)?;
    let job = PassiveJob {
        wall: WallParameters::default(),
        target: PassiveFit::Unloaded {
            end_diastolic_pressure_kpa: FILLING_MMHG / MMHG_PER_KPA,
            unloaded_volume_mm3: 1e3 * klotz_unloaded_volume(cavity, Mmhg(FILLING_MMHG)).0,
        },
        slope: None,
        steepened_by: None,
    };
    let (mut work, mut laws, mut passes) = (SearchWork::default(), 0, 0);
    let end_s = processor_s() + seconds;
    let mut watch = |progress: &SearchProgress| {
        (work, laws, passes) = (progress.work, progress.trials, progress.passes);
        if processor_s() < end_s {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    };
    let settings = UnloadingSettings::for_anatomy(&anatomy);
    let mut search = Search::watched(settings, &mut watch);
    let found = job.on_threads(&anatomy, &mut search, threads, ThreadSettings::default());
    let outcome = match found {
        Ok(found) => format!(
            "{:.2} kPa, {:.1} of {:.1} mL unloaded",
            found.wall.muscle.stiffness_kpa(),
            1e-3 * found.unloaded_volume_mm3,
            1e-3 * found.volume_mm3
        ),
        Err(error) => format!("law {laws}, pass {passes}: {}", chain(&error)),
    };
    Ok((work, outcome))
}

/// An error with its causes.
fn chain(error: &(dyn Error + 'static)) -> String {
    let causes = std::iter::successors(Some(error), |&error| error.source());
    let texts: Vec<String> = causes.map(ToString::to_string).collect();
    texts.join(": ")
}

/// Writes a patient, and prints a line about its mesh.
fn write(
    folder: &Path,
    name: &str,
    mut mesh: TetMesh,
    pressure: &Path,
) -> Result<(), Box<dyn Error>> {
    mesh.frames.clear();
    mesh.surfaces.clear();
    std::fs::create_dir_all(folder)?;
    carp::write(&mesh, &folder.join("heart"))?;
    std::fs::copy(pressure, folder.join("pressure.csv"))?;
    let quality = Quality::of(&mesh);
    println!(
        "{name}: {} nodes, mean ratio {:.3} or more, {:.2} on average, edges of {:.2} to {:.1} mm",
        mesh.n_nodes(),
        quality.min,
        quality.mean,
        quality.min_edge_mm,
        quality.max_edge_mm
    );
    let (volume_ml, sites) = match find_surfaces(&mesh) {
        Ok(surfaces) => {
            mesh.surfaces = surfaces;
            let inner = mesh
                .surface(surface_names::ENDOCARDIUM)
                .ok_or("no endocardium")?;
            let volume = Cavity::behind(&inner.triangles)?.volume(&mesh.nodes_mm).0;
            let sites =
                Landmarks::of(&mesh).map_or_else(Vec::new, |marks| marks.usual_sites_mm(&mesh));
            (volume, sites)
        }
        Err(error) => {
            println!("  no surfaces: {error}");
            (100.0, vec![[0.0; 3]])
        }
    };
    let sites: Vec<String> = sites
        .iter()
        .map(|[x, y, z]| format!("[{x:.1}, {y:.1}, {z:.1}]"))
        .collect();
    let stroke_ml = 0.5 * volume_ml;
    let patient = format!(
        "id = \"{name}\"\ncycle_length_ms = 659\n\n[measured]\npressure = \"pressure.csv\"\n\
         end_diastolic_pressure_mmHg = {FILLING_MMHG:.1}\nend_diastolic_volume_mL = {volume_ml:.2}\n\
         biomarkers = {{ SV_mL = {stroke_ml:.1} }}\n\n[measured.aortic_pressure]\nsystolic_mmHg = 115\n\
         diastolic_mmHg = 68.7\n\n[anatomy.mesh]\nfile = \"heart\"\nunit = \"um\"\nleft_ventricle = [{}]\n\
         activation_sites_mm = [{}]\n",
        tags::LEFT_VENTRICLE,
        sites.join(", ")
    );
    Ok(std::fs::write(folder.join("patient.toml"), patient)?)
}

/// Numbers between 0 and 1 that repeat nowhere and are the same in every run.
fn spread(k: usize) -> f64 {
    (k as f64 * 0.618_033_988_749_895).fract()
}

/// Elements around each node.
fn around(mesh: &TetMesh) -> Vec<Vec<usize>> {
    let mut around = vec![vec![]; mesh.n_nodes()];
    for (e, tet) in mesh.tets.iter().enumerate() {
        tet.iter().for_each(|node| around[*node as usize].push(e));
    }
    around
}

/// Triangles that belong to one element alone, ordered with normals out of the tissue, with their element.
fn boundary(mesh: &TetMesh) -> Vec<([u32; 3], usize)> {
    let mut faces = BTreeMap::new();
    for (e, [a, b, c, d]) in mesh.tets.iter().enumerate() {
        for face in [[*b, *c, *d], [*a, *d, *c], [*a, *b, *d], [*a, *c, *b]] {
            let mut key = face;
            key.sort_unstable();
            faces.entry(key).or_insert_with(Vec::new).push((face, e));
        }
    }
    let alone = faces.into_values().filter(|users| users.len() == 1);
    alone.map(|users| users[0]).collect()
}

fn on_boundary(mesh: &TetMesh) -> Vec<bool> {
    let mut on = vec![false; mesh.n_nodes()];
    for node in boundary(mesh).iter().flat_map(|(face, _)| face) {
        on[*node as usize] = true;
    }
    on
}

/// Moves a node as far towards `to` as its elements keep a mean ratio of `least`.
fn move_node(mesh: &mut TetMesh, node: usize, to: Vec3, elements: &[usize], least: f64) {
    let from = mesh.nodes_mm[node];
    let mut share = 1.0;
    while share > 0.01 {
        mesh.nodes_mm[node] = std::array::from_fn(|i| from[i] + share * (to[i] - from[i]));
        if elements
            .iter()
            .all(|e| mean_ratio(mesh.corners(*e)) > least)
        {
            return;
        }
        share *= 0.95;
    }
    mesh.nodes_mm[node] = from;
}

/// Moves every node inside the wall in some direction, as far as its elements keep a mean ratio of `least`.
fn uneven(mesh: &TetMesh, least: f64) -> TetMesh {
    let mut moved = mesh.clone();
    let (around, on) = (around(mesh), on_boundary(mesh));
    let edge_mm = mesh.mean_edge_mm();
    for node in (0..mesh.n_nodes()).filter(|node| !on[*node]) {
        let from = moved.nodes_mm[node];
        let to =
            std::array::from_fn(|i| from[i] + edge_mm * (2.0 * spread(3 * node + i + 1) - 1.0));
        move_node(&mut moved, node, to, &around[node], least);
    }
    moved
}

/// Flattens elements around a `share` of the inner nodes to a mean ratio of `least`.
fn slivers(mesh: &TetMesh, share: f64, least: f64) -> TetMesh {
    let mut flat = mesh.clone();
    let (around, on) = (around(mesh), on_boundary(mesh));
    for node in (0..mesh.n_nodes()).filter(|node| !on[*node] && spread(*node + 1) < share) {
        let element = around[node][0];
        let others = mesh.tets[element]
            .iter()
            .filter(|other| **other as usize != node);
        let mut to = [0.0; 3];
        for other in others {
            (0..3).for_each(|i| to[i] += flat.nodes_mm[*other as usize][i] / 3.0);
        }
        move_node(&mut flat, node, to, &around[node], least);
    }
    flat
}

/// Halves the longest edges of the elements in the lower third, `times` times.
fn fine_apex(mesh: &TetMesh, times: usize) -> TetMesh {
    let mut fine = mesh.clone();
    let (low, high) = heights(mesh);
    let limit = low + 0.3 * (high - low);
    for _ in 0..times {
        let mut by_edge: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
        for (e, tet) in fine.tets.iter().enumerate() {
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                let key = (tet[i].min(tet[j]), tet[i].max(tet[j]));
                by_edge.entry(key).or_default().push(e);
            }
        }
        let length =
            |(a, b): (u32, u32)| distance(fine.nodes_mm[a as usize], fine.nodes_mm[b as usize]);
        let mut edges: Vec<(u32, u32)> = by_edge.keys().copied().collect();
        edges.retain(|(a, b)| {
            fine.nodes_mm[*a as usize][2].max(fine.nodes_mm[*b as usize][2]) < limit
        });
        edges.sort_by(|a, b| length(*b).total_cmp(&length(*a)));
        let mut touched = BTreeSet::new();
        let mut chosen = vec![];
        for edge in edges {
            if by_edge[&edge].iter().all(|e| !touched.contains(e)) {
                touched.extend(by_edge[&edge].iter().copied());
                chosen.push(edge);
            }
        }
        for (a, b) in chosen {
            let [p, q] = [a, b].map(|node| fine.nodes_mm[node as usize]);
            let middle = fine.n_nodes() as u32;
            fine.nodes_mm
                .push(std::array::from_fn(|i| 0.5 * (p[i] + q[i])));
            for e in &by_edge[&(a, b)] {
                let (tet, tag) = (fine.tets[*e], fine.tags[*e]);
                fine.tets[*e] = tet.map(|node| if node == b { middle } else { node });
                fine.tets
                    .push(tet.map(|node| if node == a { middle } else { node }));
                fine.tags.push(tag);
            }
        }
    }
    fine
}

/// Lowest and highest node along z, the axis of the meshes.
fn heights(mesh: &TetMesh) -> (f64, f64) {
    let z = || mesh.nodes_mm.iter().map(|x| x[2]);
    (
        z().fold(f64::INFINITY, f64::min),
        z().fold(f64::NEG_INFINITY, f64::max),
    )
}

/// The cut at the base: triangles of the boundary near the highest node whose normals point up.
fn cut(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let (_, high) = heights(mesh);
    let is_cut = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|node| mesh.nodes_mm[node as usize]);
        let normal = unit(cross(sub(b, a), sub(c, a))).unwrap_or_default();
        normal[2] > 0.7 && [a, b, c].iter().all(|x| x[2] > high - 2.0)
    };
    let faces = boundary(mesh).into_iter().map(|(face, _)| face);
    faces.filter(is_cut).collect()
}

/// Grows a passive root of `layers` layers out of the cut, whose wall thins to `wall_mm` and narrows to two thirds.
fn with_root(mesh: &TetMesh, layers: u32, wall_mm: f64) -> Result<TetMesh, Box<dyn Error>> {
    let mut grown = mesh.clone();
    let faces = cut(mesh);
    let nodes: Vec<u32> = faces
        .iter()
        .flatten()
        .copied()
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    if nodes.is_empty() {
        return Err("the mesh has no flat cut at its base".into());
    }
    let n = nodes.len() as f64;
    let at = |node: &u32| mesh.nodes_mm[*node as usize];
    let centre: [f64; 2] =
        std::array::from_fn(|i| nodes.iter().map(|node| at(node)[i]).sum::<f64>() / n);
    let radius = |x: Vec3| (x[0] - centre[0]).hypot(x[1] - centre[1]);
    let radii = || nodes.iter().map(|node| radius(at(node)));
    let (inner, outer) = (
        radii().fold(f64::INFINITY, f64::min),
        radii().fold(0.0, f64::max),
    );
    let place: BTreeMap<u32, u32> = nodes.iter().zip(0..).map(|(node, k)| (*node, k)).collect();
    let mut below: Vec<u32> = nodes.clone();
    for layer in 1..=layers {
        let up = f64::from(layer) / f64::from(layers);
        let first = grown.n_nodes() as u32;
        for node in &nodes {
            let x = at(node);
            let depth = (radius(x) - inner) / (outer - inner);
            let thickness = (1.0 - up) * (outer - inner) + up * wall_mm;
            let wanted = (1.0 - up / 3.0) * inner + depth * thickness;
            let factor = wanted / radius(x);
            grown.nodes_mm.push([
                centre[0] + factor * (x[0] - centre[0]),
                centre[1] + factor * (x[1] - centre[1]),
                x[2] + LAYER_MM * f64::from(layer),
            ]);
        }
        let above: Vec<u32> = (0..nodes.len() as u32).map(|k| first + k).collect();
        for face in &faces {
            let mut k = face.map(|node| place[&node] as usize);
            // The order of a prism's columns is the same in its neighbours, so that their diagonals meet.
            k.sort_unstable();
            let [a, b, c] = k;
            for tet in [
                [below[a], below[b], below[c], above[c]],
                [below[a], below[b], above[c], above[b]],
                [below[a], above[b], above[c], above[a]],
            ] {
                let volume = mean_ratio(tet.map(|node| grown.nodes_mm[node as usize]));
                let [p, q, r, s] = tet;
                grown
                    .tets
                    .push(if volume < 0.0 { [p, r, q, s] } else { tet });
                grown.tags.push(tags::AORTIC_ROOT);
            }
        }
        below = above;
    }
    Ok(grown)
}

/// Takes a ball of `radius_mm` out of the wall near the base, at a share of the wall from the inside.
fn without_ball(mesh: &TetMesh, share: f64, radius_mm: f64) -> Result<TetMesh, Box<dyn Error>> {
    let (low, high) = heights(mesh);
    let z = high - 0.2 * (high - low);
    let level = || mesh.nodes_mm.iter().filter(move |x| (x[2] - z).abs() < 3.0);
    let x = || level().map(|x| x[0]).filter(|x| *x > 0.0);
    let (inner, outer) = (x().fold(f64::INFINITY, f64::min), x().fold(0.0, f64::max));
    let wall = level()
        .map(|x| x[0].hypot(x[1]))
        .fold(f64::INFINITY, f64::min)
        .max(inner);
    let centre = [wall + share * (outer - wall), 0.0, z];
    let mut left = TetMesh::default();
    let mut names = BTreeMap::new();
    for e in (0..mesh.n_tets()).filter(|e| distance(mesh.centroid_mm(*e), centre) > radius_mm) {
        left.tets.push(mesh.tets[e].map(|node| {
            *names.entry(node).or_insert_with(|| {
                left.nodes_mm.push(mesh.nodes_mm[node as usize]);
                left.nodes_mm.len() as u32 - 1
            })
        }));
        left.tags.push(mesh.tags[e]);
    }
    if left.n_tets() == mesh.n_tets() {
        return Err("the ball holds no element".into());
    }
    Ok(left)
}
