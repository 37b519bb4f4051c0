//! Series of VTU files over a beat, with a PVD file that ParaView opens as an animation.
//!
//! Frames are stored in `vtu/` of the attempt's directory; the index `vtu/beat.pvd` is written
//! last. Points are the current positions of the nodes. The fields are displacement from
//! end-diastole, stretch, active stress, and calcium if the contraction model has it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_mechanics::organ::FiniteElementVentricle;
use cardiotwin_mesh::files::{pvd, vtu};
use cardiotwin_mesh::vec3::sub;
use cardiotwin_mesh::{NodeFibres, TetMesh};
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_units::Ms;

use crate::error::TaskError;
use crate::files;

/// Name of the folder in the attempt's directory.
pub const FOLDER: &str = "vtu";
/// Name of the index file in this folder.
pub const INDEX: &str = "beat.pvd";

/// A series in progress.
#[derive(Debug)]
pub struct Series {
    folder: PathBuf,
    every_ms: f64,
    with_calcium: bool,
    /// The mesh, with its nodes at their current positions.
    mesh: TetMesh,
    begin: Vec<[f64; 3]>,
    beat: usize,
    /// Time of each frame in the beat.
    times_ms: Vec<f64>,
}

impl Series {
    /// Starts a series in `directory` with the ventricle's first state. Also returns the size of a
    /// frame in bytes.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of the file system.
    pub fn begin(
        directory: &Path,
        mesh: TetMesh,
        ventricle: &FiniteElementVentricle,
        every_ms: f64,
        with_calcium: bool,
    ) -> Result<(Self, u64), TaskError> {
        let folder = directory.join(FOLDER);
        fs::create_dir_all(&folder).map_err(|source| TaskError::Write {
            file: folder.clone(),
            source,
        })?;
        let mesh = TetMesh {
            frames: vec![],
            fibres: NodeFibres::PerElement,
            surfaces: vec![],
            ..mesh
        };
        let (begin, times_ms) = (Vec::new(), Vec::new());
        let mut series = Self {
            folder,
            every_ms,
            with_calcium,
            mesh,
            begin,
            beat: 1,
            times_ms,
        };
        series.move_to(ventricle);
        series.begin.clone_from(&series.mesh.nodes_mm);
        let bytes = series.write(0.0, ventricle)?;
        Ok((series, bytes))
    }

    /// Copies the frames up to `time_ms` of a beat that an earlier attempt wrote in the directory
    /// `earlier`. A missing frame is logged and leaves a gap in the series.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of the file system.
    pub fn resume(&mut self, earlier: &Path, beat: usize, time_ms: f64) -> Result<(), TaskError> {
        self.beat = beat;
        self.times_ms.clear();
        while self.due_ms() <= time_ms + 1e-6 {
            let name = frame_name(self.times_ms.len());
            let file = self.folder.join(&name);
            match fs::copy(earlier.join(FOLDER).join(&name), &file) {
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    tracing::warn!("{}: the earlier attempt left no such frame", file.display());
                }
                Err(source) => return Err(TaskError::Write { file, source }),
            }
            self.times_ms.push(self.due_ms());
        }
        Ok(())
    }

    /// Writes a frame if one is due at this time of the beat. The first frame of a new beat
    /// replaces those of the previous one.
    ///
    /// # Errors
    /// [`TaskError::Write`] for an error of the file system.
    pub fn observe(
        &mut self,
        beat: usize,
        time_ms: f64,
        ventricle: &FiniteElementVentricle,
    ) -> Result<(), TaskError> {
        if beat != self.beat {
            self.beat = beat;
            self.times_ms.clear();
        }
        if time_ms >= self.due_ms() - 1e-6 {
            self.move_to(ventricle);
            self.write(time_ms, ventricle)?;
        }
        Ok(())
    }

    /// Text of the index, for the frames written so far.
    #[must_use]
    pub fn index(&self) -> String {
        let frames = self
            .times_ms
            .iter()
            .enumerate()
            .map(|(k, time)| (Ms(*time), frame_name(k)));
        pvd::text(
            &frames
                .filter(|(_, name)| self.folder.join(name).exists())
                .collect::<Vec<_>>(),
        )
    }

    /// Number of frames in a beat of length `length_ms`.
    #[must_use]
    pub fn n_frames_of(every_ms: f64, length_ms: f64) -> u64 {
        (length_ms / every_ms + 1e-6).floor() as u64 + 1
    }

    fn due_ms(&self) -> f64 {
        self.times_ms.len() as f64 * self.every_ms
    }

    fn move_to(&mut self, ventricle: &FiniteElementVentricle) {
        let (unloaded, u) = (ventricle.unloaded_mm(), ventricle.displacement_mm());
        for (k, node) in self.mesh.nodes_mm.iter_mut().enumerate() {
            *node = std::array::from_fn(|i| unloaded[3 * k + i] + u[3 * k + i]);
        }
    }

    fn write(
        &mut self,
        time_ms: f64,
        ventricle: &FiniteElementVentricle,
    ) -> Result<u64, TaskError> {
        let displacement = self
            .mesh
            .nodes_mm
            .iter()
            .zip(&self.begin)
            .flat_map(|(now, begin)| sub(*now, *begin))
            .collect();
        let nodes = ventricle.nodes();
        let mut values = vec![0.0; nodes.len()];
        let mut field = |name: &str, fill: &dyn Fn(&mut [f64]), elsewhere: f64| {
            fill(&mut values);
            let mut all = vec![elsewhere; self.mesh.n_nodes()];
            nodes
                .iter()
                .zip(&values)
                .for_each(|(node, value)| all[*node as usize] = *value);
            vtu::Field::scalar(name, all)
        };
        let mut fields = vec![
            field("lambda", &|out| ventricle.stretch(out), 1.0),
            field("Sa_kPa", &|out| ventricle.active_stress_kpa(out), 0.0),
        ];
        if self.with_calcium {
            fields.push(field("Ca_uM", &|out| ventricle.calcium_um(out), 0.0));
        }
        fields.push(vtu::Field {
            name: "displacement_mm".to_owned(),
            n_components: 3,
            values: displacement,
        });
        let content = vtu::Content {
            point_fields: &fields,
            compact: true,
            ..vtu::Content::default()
        };
        let file = self.folder.join(frame_name(self.times_ms.len()));
        let text = vtu::encode(&self.mesh, &content);
        files::write_synced(&file, text.as_bytes())
            .map_err(|source| TaskError::Write { file, source })?;
        self.times_ms.push(time_ms);
        Ok(text.len() as u64)
    }
}

fn frame_name(k: usize) -> String {
    format!("beat-{k:05}.vtu")
}
