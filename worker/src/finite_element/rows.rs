//! Nodal traces of the current beat. Rows are kept in a file, because the traces of a large mesh do
//! not fit into memory next to the beat.
//!
//! A row holds the active stress, the calcium (if the contraction model has it) and the stretch of
//! each node, as little-endian numbers of 8 bytes. Each beat has its own file; the checkpoint
//! determines how many of its rows are valid.

use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use cardiotwin_mechanics::organ::FiniteElementVentricle;
use cardiotwin_models::ventricle::Ventricle as _;
use cardiotwin_protocol::files;

use super::checkpoint;

/// Rows of the current beat.
#[derive(Debug)]
pub struct NodalRows {
    folder: PathBuf,
    n_nodes: usize,
    with_calcium: bool,
    /// First beat whose file may still exist.
    oldest: usize,
    beat: usize,
    file: File,
    /// Number of rows in the beat so far.
    n_rows: usize,
    /// The last row, with which the next beat begins.
    last: Vec<u8>,
}

fn file_of(folder: &Path, beat: usize) -> PathBuf {
    folder.join(format!("nodal-{beat}.f64"))
}

fn create(folder: &Path, beat: usize) -> io::Result<File> {
    fs::create_dir_all(folder)?;
    File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(true)
        .open(file_of(folder, beat))
}

fn row_bytes(n_nodes: usize, with_calcium: bool) -> usize {
    8 * n_nodes * if with_calcium { 3 } else { 2 }
}

impl NodalRows {
    /// Starts the first beat with the ventricle's state at its beginning.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn begin(
        folder: &Path,
        ventricle: &FiniteElementVentricle,
        with_calcium: bool,
    ) -> io::Result<Self> {
        let n_nodes = ventricle.nodes().len();
        let file = create(folder, 1)?;
        let (folder, last) = (folder.to_owned(), vec![]);
        let mut rows = Self {
            folder,
            n_nodes,
            with_calcium,
            oldest: 1,
            beat: 1,
            file,
            n_rows: 0,
            last,
        };
        rows.append(1, ventricle)?;
        Ok(rows)
    }

    /// Continues after the first `n_rows` of a beat, which another attempt, or an earlier one in
    /// the same folder, has left in its folder.
    ///
    /// # Errors
    /// Any error of the file system; [`io::ErrorKind::UnexpectedEof`] if the file has fewer rows.
    pub fn resume(
        folder: &Path,
        (earlier, beat, n_rows): (&Path, usize, usize),
        n_nodes: usize,
        with_calcium: bool,
    ) -> io::Result<Self> {
        let row_bytes = row_bytes(n_nodes, with_calcium);
        let wanted = (n_rows * row_bytes) as u64;
        let from = File::open(file_of(earlier, beat))?;
        if n_rows == 0 || from.metadata()?.len() < wanted {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        fs::create_dir_all(folder)?;
        let path = file_of(folder, beat);
        files::replace_with(&path, |out| io::copy(&mut from.take(wanted), out).map(drop))?;
        let mut file = File::options().read(true).write(true).open(path)?;
        let mut last = vec![0; row_bytes];
        file.seek(SeekFrom::Start(wanted - row_bytes as u64))?;
        file.read_exact(&mut last)?;
        Ok(Self {
            folder: folder.to_owned(),
            n_nodes,
            with_calcium,
            oldest: beat,
            beat,
            file,
            n_rows,
            last,
        })
    }

    fn row_bytes(&self) -> usize {
        row_bytes(self.n_nodes, self.with_calcium)
    }

    /// Appends the ventricle's state as row number `n_rows`. Missing rows in between are
    /// interpolated linearly.
    fn append(&mut self, n_rows: usize, ventricle: &FiniteElementVentricle) -> io::Result<()> {
        let mut values = vec![0.0; self.n_nodes];
        let before = std::mem::take(&mut self.last);
        let mut take = |fill: &dyn Fn(&mut [f64])| {
            fill(&mut values);
            self.last
                .extend(values.iter().flat_map(|value| value.to_le_bytes()));
        };
        take(&|out| ventricle.active_stress_kpa(out));
        if self.with_calcium {
            take(&|out| ventricle.calcium_um(out));
        }
        take(&|out| ventricle.stretch(out));
        let n_new = n_rows.saturating_sub(self.n_rows).max(1);
        for k in 1..n_new {
            let share = k as f64 / n_new as f64;
            let pairs = before
                .as_chunks::<8>()
                .0
                .iter()
                .zip(self.last.as_chunks::<8>().0);
            let between = pairs.flat_map(|(from, to)| {
                let (from, to) = (f64::from_le_bytes(*from), f64::from_le_bytes(*to));
                (from + share * (to - from)).to_le_bytes()
            });
            self.file.write_all(&between.collect::<Vec<u8>>())?;
        }
        self.n_rows += n_new;
        self.file.write_all(&self.last)
    }

    /// Adds the state after one output interval, or after several that one step covered, so that
    /// the beat has `n_rows` rows. The first state of a new beat starts a new file.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn observe(
        &mut self,
        (beat, n_rows): (usize, usize),
        ventricle: &FiniteElementVentricle,
    ) -> io::Result<()> {
        if beat != self.beat {
            (self.beat, self.file, self.n_rows) = (beat, create(&self.folder, beat)?, 1);
            self.file.write_all(&self.last)?;
        }
        self.append(n_rows, ventricle)
    }

    /// Syncs the rows to disk before a checkpoint refers to them.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// Removes the files of earlier beats, to which no checkpoint refers any more.
    pub fn forget_earlier(&mut self) {
        // A file that cannot be removed only takes up space.
        (self.oldest..self.beat)
            .for_each(|beat| drop(fs::remove_file(file_of(&self.folder, beat))));
        self.oldest = self.beat;
    }

    /// Row `k`: active stress, calcium (if the model has it) and stretch.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn row(&mut self, k: usize) -> io::Result<Vec<f64>> {
        let mut bytes = vec![0; self.row_bytes()];
        self.file
            .seek(SeekFrom::Start((k * self.row_bytes()) as u64))?;
        self.file.read_exact(&mut bytes)?;
        Ok(bytes
            .as_chunks::<8>()
            .0
            .iter()
            .map(|bytes| f64::from_le_bytes(*bytes))
            .collect())
    }

    /// Active stress and stretch of row `k`.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn stress_and_stretch(&mut self, k: usize) -> io::Result<[Vec<f64>; 2]> {
        let mut stress = self.row(k)?;
        let stretch = stress.split_off(stress.len() - self.n_nodes);
        stress.truncate(self.n_nodes);
        Ok([stress, stretch])
    }
}

impl Drop for NodalRows {
    fn drop(&mut self) {
        if self.folder.join(checkpoint::FILE).exists() {
            return;
        }
        // No checkpoint refers to these files any more.
        (self.oldest..=self.beat)
            .for_each(|beat| drop(fs::remove_file(file_of(&self.folder, beat))));
        if self.folder.ends_with("checkpoint") {
            // The removal succeeds only if the folder is empty.
            let _ = fs::remove_dir(&self.folder);
        }
    }
}
