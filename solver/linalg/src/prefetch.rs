//! Asking for memory before it is needed.
//!
//! A product with a matrix that no cache holds reads it once from end to end, some hundred bytes a row. Processors fetch ahead by
//! themselves, but not across pages of 4 kB and not far enough: on a server where memory is a tenth of a microsecond away, the
//! product took twice the time of a copy of the same bytes. Numbers are not touched: results are the same to the bit.

use std::ops::Range;

/// How far ahead \[bytes\]. From 2 to 16 kB made little difference.
const AHEAD: usize = 4096;
/// Of a cache line \[bytes\].
const LINE: usize = 64;

/// Asks for the part of `list` that lies [`AHEAD`] of `range`; nothing where the processor has no such instruction.
#[inline(always)]
pub fn prefetch<T>(list: &[T], range: &Range<usize>) {
    #[cfg(target_arch = "x86_64")]
    {
        let ahead = const { AHEAD / size_of::<T>() };
        let stride = const {
            if size_of::<T>() < LINE {
                LINE / size_of::<T>()
            } else {
                1
            }
        };
        let end = (range.end + ahead).min(list.len());
        for item in list[(range.start + ahead).min(end)..end]
            .iter()
            .step_by(stride)
        {
            safe_arch::prefetch_t0(item);
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (list, range);
}
