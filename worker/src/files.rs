//! Files of an attempt: short files written in one piece, and long ones that are hashed while they
//! are written.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

pub use cardiotwin_protocol::files::{create_exclusive, write_atomic, write_synced};
use cardiotwin_schemas::hash::hex;
use sha2::{Digest as _, Sha256};

/// A file that is written piece by piece and hashed at the same time.
#[derive(Debug)]
pub struct Hashed {
    file: io::BufWriter<File>,
    hash: Sha256,
    bytes: u64,
}

impl Hashed {
    /// Creates the file, or truncates an existing one.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn create(path: &Path) -> io::Result<Self> {
        Ok(Self {
            file: io::BufWriter::new(File::create(path)?),
            hash: Sha256::new(),
            bytes: 0,
        })
    }

    /// Syncs the file to disk and returns its SHA-256 in hexadecimal and its length in bytes.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn finish(self) -> io::Result<(String, u64)> {
        self.file
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?
            .sync_all()?;
        Ok((hex(&self.hash.finalize()), self.bytes))
    }
}

impl Write for Hashed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.file.write(bytes)?;
        self.hash.update(&bytes[..n]);
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_written_in_pieces_has_the_hash_of_the_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("long.csv");
        let mut file = Hashed::create(&path).unwrap();
        (0..5000).for_each(|k| write!(file, "{k},").unwrap());
        let (hash, bytes) = file.finish().unwrap();
        let content = fs::read(&path).unwrap();
        assert_eq!(
            (hash, bytes),
            (
                cardiotwin_schemas::hash::sha256_hex(&content),
                content.len() as u64
            )
        );
        assert!(content.ends_with(b"4998,4999,"));
    }
}
