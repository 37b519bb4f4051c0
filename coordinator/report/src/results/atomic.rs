//! Result files that are either the old or the new ones, never half of each.

pub use cardiotwin_protocol::files::{replace_with as replace, write_with as write};
