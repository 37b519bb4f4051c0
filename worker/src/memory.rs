//! What the allocator does with large blocks.

/// From here on \[bytes\] a block is returned to the system as soon as it is freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE: std::ffi::c_int = 4 << 20;

/// Has large blocks returned to the system when they are freed. Left to itself the GNU C library keeps what a finished phase
/// used, up to 32 MB a block, and fragments it: a beat at 64,000 nodes then holds 150 MB that nobody uses.
pub fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(
        unsafe_code,
        reason = "a function of the C library that takes two numbers"
    )]
    // SAFETY: no other thread allocates yet, nor would it matter.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
    }
}
