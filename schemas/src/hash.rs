//! Content hashes: SHA-256 over canonical JSON (object keys sorted) and over files.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

/// SHA-256 of `bytes` as 64 lower-case hexadecimal digits.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of a file as 64 lower-case hexadecimal digits.
///
/// # Errors
/// Any error of the file system.
pub fn sha256_of_file(file: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(
        &mut BufReader::with_capacity(1 << 20, File::open(file)?),
        &mut hash,
    )?;
    Ok(hex(&hash.finalize()))
}

/// Lower-case hexadecimal form, two digits per byte.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

/// Canonical JSON: keys sorted at every level, no white space, floats in shortest round-trip form.
///
/// # Errors
/// If `value` cannot be represented in JSON (a map with keys other than text).
pub fn canonical_json<T: Serialize>(value: &T) -> Result<String, serde_json::Error> {
    // serde_json's default map is a BTreeMap, so that going through `Value` sorts keys.
    let value: Value = serde_json::to_value(value)?;
    serde_json::to_string(&value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_sorted_so_that_order_of_fields_does_not_change_the_hash() {
        #[derive(Serialize)]
        struct A {
            b: f64,
            a: i32,
        }
        assert_eq!(
            canonical_json(&A { b: 0.1, a: 1 }).unwrap(),
            r#"{"a":1,"b":0.1}"#
        );
    }

    #[test]
    fn sha256_of_abc_is_the_published_one() {
        assert_eq!(&sha256_hex(b"abc")[..16], "ba7816bf8f01cfea");
    }
}
