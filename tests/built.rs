//! Programs of this workspace, for the tests that call them.

use std::path::PathBuf;

/// Path of a built program, which is next to the folder of the running test.
pub fn binary(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test knows its own path");
    let path = test
        .parent()
        .and_then(std::path::Path::parent)
        .expect("tests lie in target/PROFILE/deps")
        .join(name);
    assert!(
        path.is_file(),
        "{} is not there: `cargo build --release --workspace --bins` first",
        path.display()
    );
    path
}
