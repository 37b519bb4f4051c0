//! Folders that appear as a whole or not at all.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::WriteError;

/// A folder that is filled next to its target and takes the target's place when it is complete. If
/// it is dropped before, it leaves nothing.
pub struct WholeFolder {
    beside: tempfile::TempDir,
    place: PathBuf,
}

impl WholeFolder {
    /// Begins a folder next to `place`, and makes the parents of `place`.
    ///
    /// # Errors
    /// [`WriteError::Folder`] if a folder cannot be made.
    pub fn begin(place: &Path) -> Result<Self, WriteError> {
        let parent = place
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or_else(|| Path::new("."));
        fs::create_dir_all(parent).map_err(WriteError::folder(parent))?;
        let beside = tempfile::Builder::new()
            .prefix(".preparing-")
            .tempdir_in(parent)
            .map_err(WriteError::folder(parent))?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // A temporary folder is private to its owner. This one gets the permissions of the
            // folder that contains it.
            let mode = fs::metadata(parent)
                .map_err(WriteError::folder(place))?
                .permissions()
                .mode()
                & 0o777;
            fs::set_permissions(beside.path(), fs::Permissions::from_mode(mode | 0o700))
                .map_err(WriteError::folder(place))?;
        }
        Ok(Self {
            beside,
            place: place.to_owned(),
        })
    }

    /// Path of the folder until it is published.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.beside.path()
    }

    /// Writes and syncs a new file, and makes the folders in its name.
    ///
    /// # Errors
    /// [`WriteError`] if the file exists already or cannot be written.
    pub fn write(&self, name: &str, content: &[u8]) -> Result<(), WriteError> {
        let path = self.path().join(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(WriteError::folder(folder))?;
        }
        let written = fs::File::create_new(&path)
            .and_then(|mut file| file.write_all(content).and_then(|()| file.sync_all()));
        written.map_err(WriteError::file(&self.place.join(name)))
    }

    /// Moves the folder to its place and removes the folder that was there before.
    ///
    /// # Errors
    /// [`WriteError::Folder`] if the folder cannot be moved; an earlier folder is then still in
    /// place.
    pub fn publish(self) -> Result<(), WriteError> {
        let occupied = fs::read_dir(&self.place).is_ok_and(|mut entries| entries.next().is_some());
        if occupied {
            // The two folders are exchanged at once, so that a whole one is in place at every
            // moment. The old one is deleted with `beside`.
            use rustix::fs::{CWD, RenameFlags, renameat_with};
            let exchanged =
                renameat_with(CWD, self.path(), CWD, &self.place, RenameFlags::EXCHANGE);
            return exchanged.map_err(|error| WriteError::folder(&self.place)(error.into()));
        }
        fs::rename(self.path(), &self.place).map_err(WriteError::folder(&self.place))?;
        let _ = self.beside.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_takes_its_place_whole_and_leaves_nothing_where_it_does_not() {
        let base = tempfile::tempdir().unwrap();
        let place = base.path().join("new/crate");
        let content = || fs::read_to_string(place.join("a/b.txt")).unwrap_or_default();
        let folder = WholeFolder::begin(&place).unwrap();
        folder.write("a/b.txt", b"first").unwrap();
        assert!(!place.exists());
        folder.publish().unwrap();
        assert_eq!(content(), "first");
        let folder = WholeFolder::begin(&place).unwrap();
        folder.write("a/b.txt", b"second").unwrap();
        drop(folder);
        assert_eq!(content(), "first");
        let folder = WholeFolder::begin(&place).unwrap();
        folder.write("a/b.txt", b"third").unwrap();
        folder.publish().unwrap();
        assert_eq!(content(), "third");
        assert_eq!(
            fs::read_dir(place.parent().unwrap()).unwrap().count(),
            1,
            "no litter"
        );
    }
}
