//! An independent VTK reader: `meshio` from PyPI, in a Python environment below the target folder
//! that the mesh's tests also use.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python with meshio, or the reason why there is none.
pub fn python() -> Result<PathBuf, String> {
    // The variable is set for integration tests only; examples share this module and do not have
    // it.
    let target = option_env!("CARGO_TARGET_TMPDIR").ok_or("no folder for it")?;
    let folder = Path::new(target).join("vtk-reader");
    let python = folder.join("bin/python");
    let has_meshio = || {
        Command::new(&python)
            .args(["-c", "import meshio"])
            .output()
            .is_ok_and(|out| out.status.success())
    };
    if has_meshio() {
        return Ok(python);
    }
    let run = |program: &Path, args: &[&str]| {
        let out = Command::new(program)
            .args(args)
            .output()
            .map_err(|e| format!("{}: {e}", program.display()))?;
        if out.status.success() {
            Ok(())
        } else {
            Err(String::from_utf8_lossy(&out.stderr).trim().to_owned())
        }
    };
    run(
        Path::new("python3"),
        &["-m", "venv", &folder.to_string_lossy()],
    )?;
    let quick = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--retries",
        "0",
        "--timeout",
        "10",
        "meshio",
    ];
    run(&python, &quick)?;
    if has_meshio() {
        Ok(python)
    } else {
        Err("meshio cannot be imported".into())
    }
}
