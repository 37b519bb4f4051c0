//! Settings of the memory allocator.

/// Size \[bytes\] from which on a block is returned to the system as soon as it is freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE: std::ffi::c_int = 4 << 20;

/// Makes the allocator return large blocks to the system when they are freed. By default, the GNU C
/// library keeps the blocks of a finished phase, up to 32 MB each, and fragments them; a beat at
/// 64,000 nodes then holds 150 MB of unused memory.
pub fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(
        unsafe_code,
        reason = "a function of the C library that takes two numbers"
    )]
    // SAFETY: no other thread allocates yet, and the call would be safe even then.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
    }
}
