//! Virtual environments of Python.

use std::path::Path;
use std::process::Command;

use anyhow::Result;

use crate::process::run;

/// Makes a virtual environment in this folder, unless a whole one is there. What an interrupted run left is removed.
///
/// # Errors
///
/// If Python or its `venv` is missing.
pub(crate) fn make(python: &Path, dir: &Path) -> Result<()> {
    if has_pip(dir) {
        return Ok(());
    }
    println!("making a Python environment in {}", dir.display());
    run(Command::new(python).args(["-m", "venv", "--clear"]).arg(dir))
}

/// Returns true if the environment is whole: pip is installed last.
fn has_pip(dir: &Path) -> bool {
    let mut pip = Command::new(dir.join("bin/python"));
    let output = pip.args(["-m", "pip", "--version"]).output();
    output.is_ok_and(|output| output.status.success())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn environment_without_pip_is_not_whole() {
        let dir = std::env::temp_dir().join(format!("armwire-venv-{}", std::process::id()));
        assert!(!has_pip(&dir));
        fs::create_dir_all(dir.join("bin")).unwrap();
        for (program, is_whole) in [("/bin/false", false), ("/bin/true", true)] {
            symlink(program, dir.join("bin/python")).unwrap();
            assert_eq!(has_pip(&dir), is_whole, "{program}");
            fs::remove_file(dir.join("bin/python")).unwrap();
        }
        fs::remove_dir_all(dir).unwrap();
    }
}
