//! Numbers whose key is absent from a file.

/// Number of an absent key that earlier programs took for 1.
pub(crate) const fn one() -> f64 {
    1.0
}

/// Whether a number is omitted from files.
pub(crate) fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Whether a count is omitted from files.
pub(crate) fn is_zero_count(value: &u32) -> bool {
    *value == 0
}

/// Ratio of the contraction's durations across the wall, where an earlier program's figures lack it.
pub(crate) const fn epicardial_duration_share() -> f64 {
    0.9
}
