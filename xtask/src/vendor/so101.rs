//! Programs for Feetech servos on a virtual SO-101, and the reproductions in `docs/upstream`.

use std::path::Path;

use anyhow::Result;

use super::python::Python;
use crate::python;
use crate::workspace::root;

/// Runs the programs with the wheel of the package, and compares the results with the pages, or writes them there.
///
/// # Errors
///
/// If a result is another than on a page, if there is no Python for LeRobot, or if something cannot be built or installed.
pub(crate) fn compare(write: bool) -> Result<()> {
    let newer = python::newer_python()?;
    let most = Python::of(&newer, "so101", "so101/requirements.txt")?;
    // Two of the programs have a module of the same name.
    let ftservo = Python::of(&newer, "so101-ftservo", "so101/requirements-ftservo.txt")?;
    let wheel = python::wheel(&most.dir)?;
    for python in [&most, &ftservo] {
        python::reinstall(&python.environment, &[&wheel])?;
    }
    let (docs, python, beside) = (
        root().join("docs"),
        most.environment.path("python"),
        ftservo.environment.path("python"),
    );
    let mut args = vec![docs.as_path(), &python, &beside];
    if write {
        args.push(Path::new("--write"));
    }
    most.run("so101/check.py", &args)
}
