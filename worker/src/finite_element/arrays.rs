//! Format for files of numeric arrays: a line that identifies the format, a header in JSON, the
//! arrays in little endian, and a checksum of all of these.
//!
//! ```text
//! cardiotwin-arrays 1
//! {"kind":"…","about":{…},"arrays":[{"name":"nodes_mm","type":"f64","length":1494},…]}
//! …bytes of the arrays, one after the other…
//! …SHA-256 of everything before, 64 hexadecimal digits…
//! ```

use cardiotwin_schemas::formats::ARRAYS;
use cardiotwin_schemas::hash::sha256_hex;
use serde::{Deserialize, Serialize};

const MAGIC: &[u8] = b"cardiotwin-arrays ";
const CHECKSUM: usize = 64;

/// Values of an array.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Coordinates, displacements, states and other real numbers.
    F64(Vec<f64>),
    /// Indices of nodes and elements, tags and counts.
    U32(Vec<u32>),
}

/// Content of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrays {
    /// Kind of content, by which readers recognise their files.
    pub kind: String,
    /// All content other than arrays.
    pub about: serde_json::Value,
    /// Arrays with their names, in the order of the file.
    pub arrays: Vec<(String, Values)>,
}

/// Reasons why bytes are not a readable file of arrays.
#[derive(Debug, thiserror::Error)]
pub enum ArraysError {
    /// The file belongs to another program.
    #[error("this is not a file of arrays of this program")]
    Foreign,
    /// The file has another format version.
    #[error("the file has format {found}, but this program reads format {known}")]
    Format {
        /// Format version of the file.
        found: String,
        /// Format version that this program writes and reads.
        known: u32,
    },
    /// The file is truncated or was changed.
    #[error("the checksum does not match the content: the file is truncated or damaged")]
    Checksum,
    /// The header is invalid.
    #[error("cannot read the header")]
    Header(#[source] serde_json::Error),
    /// The arrays do not have the length given in the header.
    #[error("found {found} bytes of arrays, but the header states {expected}")]
    Length {
        /// Number of bytes found.
        found: usize,
        /// Number of bytes according to the header.
        expected: usize,
    },
    /// The file holds another kind of content.
    #[error("this is a file of kind {found}, expected {expected}")]
    Kind {
        /// Kind of content that the header states.
        found: String,
        /// Kind of content that the caller reads.
        expected: String,
    },
    /// An array is missing, or has another type or length.
    #[error("the file has no array {name} of {expected}")]
    Missing {
        /// Name of the array.
        name: &'static str,
        /// Expected type and length.
        expected: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Header {
    kind: String,
    about: serde_json::Value,
    arrays: Vec<Declared>,
}

#[derive(Serialize, Deserialize)]
struct Declared {
    name: String,
    #[serde(rename = "type")]
    of: Type,
    length: usize,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Type {
    F64,
    U32,
}

impl Type {
    fn bytes(self) -> usize {
        match self {
            Self::F64 => 8,
            Self::U32 => 4,
        }
    }
}

impl Arrays {
    /// An empty file of a kind, with its content other than arrays.
    #[must_use]
    pub fn new(kind: &str, about: serde_json::Value) -> Self {
        Self {
            kind: kind.to_owned(),
            about,
            arrays: Vec::new(),
        }
    }

    /// Adds an array of numbers.
    #[must_use]
    pub fn with(mut self, name: &str, values: impl Into<Vec<f64>>) -> Self {
        self.arrays
            .push((name.to_owned(), Values::F64(values.into())));
        self
    }

    /// Adds an array of indices.
    #[must_use]
    pub fn with_indices(mut self, name: &str, values: impl Into<Vec<u32>>) -> Self {
        self.arrays
            .push((name.to_owned(), Values::U32(values.into())));
        self
    }

    /// Removes and returns an array of numbers.
    ///
    /// # Errors
    /// [`ArraysError::Missing`] when there is no array of numbers with this name.
    pub fn take(&mut self, name: &'static str) -> Result<Vec<f64>, ArraysError> {
        match self.find(name) {
            Some(Values::F64(values)) => Ok(values),
            _ => Err(ArraysError::Missing {
                name,
                expected: "f64".to_owned(),
            }),
        }
    }

    /// Removes and returns an array of indices.
    ///
    /// # Errors
    /// [`ArraysError::Missing`] when there is no array of indices with this name.
    pub fn take_indices(&mut self, name: &'static str) -> Result<Vec<u32>, ArraysError> {
        match self.find(name) {
            Some(Values::U32(values)) => Ok(values),
            _ => Err(ArraysError::Missing {
                name,
                expected: "u32".to_owned(),
            }),
        }
    }

    fn find(&mut self, name: &str) -> Option<Values> {
        let place = self.arrays.iter().position(|(known, _)| known == name)?;
        Some(self.arrays.swap_remove(place).1)
    }

    /// Encodes the file.
    ///
    /// # Panics
    /// Never in practice: a header of plain fields is valid JSON.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let declared = self.arrays.iter().map(|(name, values)| {
            let (of, length) = match values {
                Values::F64(values) => (Type::F64, values.len()),
                Values::U32(values) => (Type::U32, values.len()),
            };
            Declared {
                name: name.clone(),
                of,
                length,
            }
        });
        let header = Header {
            kind: self.kind.clone(),
            about: self.about.clone(),
            arrays: declared.collect(),
        };
        let mut bytes = [MAGIC, ARRAYS.version.to_string().as_bytes(), b"\n"].concat();
        bytes.extend(serde_json::to_vec(&header).expect("a header is JSON"));
        bytes.push(b'\n');
        for (_, values) in &self.arrays {
            match values {
                Values::F64(values) => bytes.extend(values.iter().flat_map(|x| x.to_le_bytes())),
                Values::U32(values) => bytes.extend(values.iter().flat_map(|x| x.to_le_bytes())),
            }
        }
        let checksum = sha256_hex(&bytes);
        bytes.extend(checksum.as_bytes());
        bytes
    }

    /// Decodes the output of [`Self::to_bytes`].
    ///
    /// # Errors
    /// [`ArraysError`] for any other content, including a truncated or changed file.
    pub fn from_bytes(bytes: &[u8], kind: &str) -> Result<Self, ArraysError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(ArraysError::Foreign)?;
        let (format, _) = line(rest).ok_or(ArraysError::Checksum)?;
        if format != ARRAYS.version.to_string().as_bytes() {
            return Err(ArraysError::Format {
                found: String::from_utf8_lossy(format).into_owned(),
                known: ARRAYS.version,
            });
        }
        let (content, checksum) = bytes
            .split_last_chunk::<CHECKSUM>()
            .ok_or(ArraysError::Checksum)?;
        if sha256_hex(content).as_bytes() != checksum {
            return Err(ArraysError::Checksum);
        }
        let (_, rest) = line(content).ok_or(ArraysError::Foreign)?;
        let (header, mut data) = line(rest).ok_or(ArraysError::Foreign)?;
        let header: Header = serde_json::from_slice(header).map_err(ArraysError::Header)?;
        let expected = header
            .arrays
            .iter()
            .map(|a| a.of.bytes().saturating_mul(a.length))
            .sum();
        if data.len() != expected {
            return Err(ArraysError::Length {
                found: data.len(),
                expected,
            });
        }
        if header.kind != kind {
            return Err(ArraysError::Kind {
                found: header.kind,
                expected: kind.to_owned(),
            });
        }
        let mut arrays = Vec::with_capacity(header.arrays.len());
        for Declared { name, of, length } in header.arrays {
            let (own, others) = data.split_at(length * of.bytes());
            data = others;
            let values = match of {
                Type::F64 => Values::F64(
                    own.as_chunks()
                        .0
                        .iter()
                        .map(|x| f64::from_le_bytes(*x))
                        .collect(),
                ),
                Type::U32 => Values::U32(
                    own.as_chunks()
                        .0
                        .iter()
                        .map(|x| u32::from_le_bytes(*x))
                        .collect(),
                ),
            };
            arrays.push((name, values));
        }
        Ok(Self {
            kind: header.kind,
            about: header.about,
            arrays,
        })
    }
}

/// The first line without its line break, and the bytes after it.
fn line(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = bytes.iter().position(|b| *b == b'\n')?;
    Some((&bytes[..end], &bytes[end + 1..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Arrays {
        Arrays::new("test", serde_json::json!({ "t_ms": 0.1 }))
            .with("u", vec![1.5, f64::INFINITY, -0.0])
            .with_indices("tets", vec![1, 2, u32::MAX])
    }

    #[test]
    fn a_file_is_read_and_written_as_the_golden_one() {
        let golden = include_bytes!("../../tests/golden/arrays.bin");
        assert_eq!(sample().to_bytes(), golden);
        assert_eq!(Arrays::from_bytes(golden, "test").unwrap(), sample());
    }

    #[test]
    fn numbers_survive_to_the_bit() {
        let mut read = Arrays::from_bytes(&sample().to_bytes(), "test").unwrap();
        assert_eq!(read, sample());
        assert_eq!(read.take("u").unwrap()[2].to_bits(), (-0.0f64).to_bits());
        assert_eq!(read.take_indices("tets").unwrap(), [1, 2, u32::MAX]);
        assert!(matches!(
            read.take("u"),
            Err(ArraysError::Missing { name: "u", .. })
        ));
    }

    #[test]
    fn a_truncated_changed_or_foreign_file_is_refused() {
        let bytes = sample().to_bytes();
        for end in MAGIC.len()..bytes.len() {
            assert!(Arrays::from_bytes(&bytes[..end], "test").is_err(), "{end}");
        }
        for place in [20, 60, bytes.len() - 80, bytes.len() - 1] {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1;
            assert!(
                matches!(
                    Arrays::from_bytes(&damaged, "test"),
                    Err(ArraysError::Checksum)
                ),
                "{place}"
            );
        }
        assert!(matches!(
            Arrays::from_bytes(b"CARP mesh", "test"),
            Err(ArraysError::Foreign)
        ));
        assert!(matches!(
            Arrays::from_bytes(&bytes, "other"),
            Err(ArraysError::Kind { .. })
        ));
        let newer = [&b"cardiotwin-arrays 2\n"[..], &bytes[20..]].concat();
        assert!(matches!(
            Arrays::from_bytes(&newer, "test"),
            Err(ArraysError::Format { .. })
        ));
    }
}
