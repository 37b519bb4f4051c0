//! Kind of the file system of a run. On one that several hosts share, SQLite's write-ahead log does
//! not work.

use std::path::Path;

/// Environment variable that overrides the detection with `network` or `local`, for tests and for
/// file systems that are not listed.
pub const VARIABLE: &str = "CARDIOTWIN_FILE_SYSTEM";

/// Numbers reported by statfs(2), from the kernel's magic.h and the sources of the file systems.
const SHARED: [(u64, &str); 12] = [
    (0x6969, "NFS"),
    (0x0BD0_0BD0, "Lustre"),
    (0x4750_4653, "GPFS"),
    (0x1983_0326, "BeeGFS"),
    (0x517B, "SMB"),
    (0xFF53_4D42, "CIFS"),
    (0xFE53_4D42, "SMB 2"),
    (0x00C3_6400, "Ceph"),
    (0xAAD7_AAEA, "PanFS"),
    (0x0102_1997, "9P"),
    (0x7461_636F, "OCFS2"),
    (0x0116_1970, "GFS2"),
];

/// Name of the shared file system on which a directory lies; `None` for a local one.
#[must_use]
pub fn shared(directory: &Path) -> Option<&'static str> {
    match std::env::var(VARIABLE).as_deref() {
        Ok("network") => return Some("a network file system"),
        Ok("local") => return None,
        _ => {}
    }
    let kind = rustix::fs::statfs(directory).ok()?.f_type;
    // The width of the number differs between platforms; magic numbers have 32 bits.
    #[allow(clippy::cast_sign_loss, clippy::unnecessary_cast)]
    let kind = kind as u64 & 0xFFFF_FFFF;
    SHARED
        .iter()
        .find(|(magic, _)| *magic == kind)
        .map(|(_, name)| *name)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_temporary_folder_is_local() {
        assert_eq!(super::shared(&std::env::temp_dir()), None);
    }
}
