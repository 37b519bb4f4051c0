//! Random numbers of a patient.

use cardiotwin_schemas::hash::sha256_hex;

/// Seed of a patient's own stream of random numbers. It has 53 bits, so that every JSON reader gets
/// the same number.
#[must_use]
pub fn stream(seed: u64, patient: &str) -> u64 {
    let digest = sha256_hex(format!("{seed}/{patient}").as_bytes());
    u64::from_str_radix(&digest[..16], 16).expect("a digest is hexadecimal") >> 11
}
