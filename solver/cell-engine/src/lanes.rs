//! Quantities of one lane as a struct of numbers, and of all lanes as a struct of arrays.

/// Lanes that advance together: two vectors of eight, so that one hides the latency of the other.
pub const LANES: usize = 16;

/// Declares a struct of `f64` fields and its struct-of-arrays twin, with copies between them.
macro_rules! lanes {
    ($(#[$doc:meta])* $one:ident, $many:ident { $($(#[$field_doc:meta])* $field:ident),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct $one { $($(#[$field_doc])* pub $field: f64),+ }

        #[doc = concat!("[`", stringify!($one), "`] for every lane.")]
        #[derive(Debug, Clone)]
        #[repr(align(64))]
        pub struct $many { $($(#[$field_doc])* pub $field: [f64; $crate::lanes::LANES]),+ }

        impl $many {
            /// The same values in every lane.
            pub fn filled(value: &$one) -> Self {
                Self { $($field: [value.$field; $crate::lanes::LANES]),+ }
            }

            /// Copies `value` into lane `i`.
            #[allow(dead_code, reason = "not every struct needs every copy")]
            #[inline(always)]
            pub fn set(&mut self, i: usize, value: &$one) {
                $(self.$field[i] = value.$field;)+
            }

            /// Values of lane `i`.
            #[allow(dead_code, reason = "not every struct needs every copy")]
            #[inline(always)]
            pub fn get(&self, i: usize) -> $one {
                $one { $($field: self.$field[i]),+ }
            }
        }
    };
}

pub(crate) use lanes;
