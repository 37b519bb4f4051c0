//! Reading of files that users name.
//!
//! A pipe would keep the reader waiting, a device never ends, and a sparse file of 10 GB fills the
//! memory. All readers of input files therefore read through [`read`].

use std::fmt;
use std::fs::{self, Metadata};
use std::io;
use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;

/// Largest size of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaxBytes(pub u64);

impl MaxBytes {
    /// Settings and tables that a person writes.
    pub const TEXT: Self = Self(16 << 20);
    /// Recorded traces.
    pub const TRACE: Self = Self(256 << 20);
    /// Meshes and their fields: 10 million nodes in a text format.
    pub const MESH: Self = Self(8 << 30);
}

/// Content of a regular file of at most `max` bytes. Links are followed.
///
/// # Errors
/// Any error of the file system; [`io::ErrorKind::InvalidInput`] for a folder, a pipe, a device, a
/// socket and for a larger file, with a message that tells what was found and expected.
pub fn read(path: &Path, max: MaxBytes) -> io::Result<Vec<u8>> {
    check(path, max)?;
    fs::read(path)
}

/// As [`read`] for text.
///
/// # Errors
/// As [`read`]; [`io::ErrorKind::InvalidData`] for bytes that are not UTF-8.
pub fn read_text(path: &Path, max: MaxBytes) -> io::Result<String> {
    check(path, max)?;
    fs::read_to_string(path)
}

/// Checks that the file is regular and has at most `max` bytes.
///
/// # Errors
/// As [`read`].
pub fn check(path: &Path, max: MaxBytes) -> io::Result<()> {
    let found = fs::metadata(path)?;
    let message = if !found.is_file() {
        format!("{}, expected a regular file", kind(&found))
    } else if found.len() > max.0 {
        format!("{}, expected at most {max}", MaxBytes(found.len()))
    } else {
        return Ok(());
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, message))
}

fn kind(found: &Metadata) -> &'static str {
    let kind = found.file_type();
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

impl fmt::Display for MaxBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = self.0 as f64 / f64::from(1 << 20);
        if mib >= 1024.0 {
            write!(f, "{:.1} GiB", mib / 1024.0)
        } else {
            write!(f, "{mib:.0} MiB")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(path: &Path, max: MaxBytes) -> String {
        let error = read(path, max).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidInput);
        assert_eq!(
            read_text(path, max).unwrap_err().to_string(),
            error.to_string()
        );
        error.to_string()
    }

    #[test]
    fn only_regular_files_of_sane_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("small"), "abc").unwrap();
        std::os::unix::fs::symlink(at("small"), at("link")).unwrap();
        for name in ["small", "link"] {
            assert_eq!(read(&at(name), MaxBytes::TEXT).unwrap(), b"abc");
        }
        assert_eq!(
            read(&at("none"), MaxBytes::TEXT).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );

        let huge = fs::File::create(at("sparse")).unwrap();
        huge.set_len(10 << 30).unwrap();
        assert_eq!(
            refused(&at("sparse"), MaxBytes::MESH),
            "10.0 GiB, expected at most 8.0 GiB"
        );
        huge.set_len(20 << 20).unwrap();
        assert_eq!(
            refused(&at("sparse"), MaxBytes::TEXT),
            "20 MiB, expected at most 16 MiB"
        );

        std::os::unix::fs::symlink("/dev/zero", at("zero")).unwrap();
        let made = std::process::Command::new("mkfifo")
            .arg(at("pipe"))
            .status();
        assert!(made.is_ok_and(|status| status.success()));
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        for (name, kind) in [
            ("zero", "a device"),
            ("pipe", "a pipe"),
            ("socket", "a socket"),
            ("", "a folder"),
        ] {
            assert_eq!(
                refused(&at(name), MaxBytes::TEXT),
                format!("{kind}, expected a regular file")
            );
        }
    }
}
