//! PVD files: index of a series of VTU files, which ParaView opens as an animation.

use super::error::{MeshFileError, write_bytes};
use cardiotwin_units::Ms;
use std::fmt::Write as _;
use std::path::Path;

/// Writes the index of files in the same folder, each with its time in ms. If it is written after
/// each frame, it is complete at any time.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written.
pub fn write(file: &Path, frames: &[(Ms, String)]) -> Result<(), MeshFileError> {
    write_bytes(file, text(frames).as_bytes())
}

/// Text of the index.
#[must_use]
pub fn text(frames: &[(Ms, String)]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n  <Collection>\n",
    );
    for (time, name) in frames {
        let name = name
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('"', "&quot;");
        let _ = writeln!(
            text,
            "    <DataSet timestep=\"{}\" part=\"0\" file=\"{name}\"/>",
            time.0
        );
    }
    text += "  </Collection>\n</VTKFile>\n";
    text
}
