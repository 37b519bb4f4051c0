//! Opening of a page or picture in the desktop's own viewer.

use std::path::Path;
use std::process::{Command, Stdio};

use super::talk::Talk;

/// Opener of the desktop.
const OPENER: &str = if cfg!(target_os = "macos") {
    "open"
} else {
    "xdg-open"
};

/// Opens a file or an address in the viewer of the desktop. Without a desktop or its opener, says so:
/// the file is there all the same.
pub fn open(file: impl AsRef<Path>, talk: &Talk) {
    let file = file.as_ref();
    let has_display = cfg!(target_os = "macos")
        || ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if !has_display {
        talk.say(&format!(
            "there is no display to open {} on",
            file.display()
        ));
        return;
    }
    let started = Command::new(OPENER)
        .arg(file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if let Err(error) = started {
        talk.say(&format!(
            "cannot open {} with {OPENER}: {error}",
            file.display()
        ));
    }
}
