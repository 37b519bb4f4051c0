//! Limits between sound, poor and defective meshes, which the checks and their messages share.

/// Mean ratio below which an element counts as flat.
pub const DEGENERATE: f64 = 0.02;
/// Mean ratio below which an element counts as badly shaped. Computations are possible, but with
/// short steps.
pub const POOR_WARNING: f64 = 0.1;
/// Accepted extent of a left ventricle \[mm\], from a mouse's to a dilated human one with its
/// aortic root.
pub const EXTENT_MM: std::ops::RangeInclusive<f64> = 3.0..=400.0;
