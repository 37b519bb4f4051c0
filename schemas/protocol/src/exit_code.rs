//! Exit codes that say why a worker published nothing.

/// Any reason other than the two below.
pub const FAILED: u8 = 1;
/// Another process had claimed the attempt.
pub const CLAIMED: u8 = 3;
/// The coordinator had revoked the attempt.
pub const REVOKED: u8 = 4;
