//! The file with the names and units of joints.

use std::path::PathBuf;

use armwire_host::joints_file;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The names, factors and offsets of the joints and of the gripper of an arm in a file: of this one, or of the only one.
#[pyfunction]
pub(crate) fn read_joints_file(path: PathBuf, arm: Option<&str>) -> PyResult<Vec<(String, f64, f64)>> {
    let joints = joints_file::read_arm(&path, arm).map_err(|error| PyValueError::new_err(error.to_string()))?;
    let joint = |joint: joints_file::Joint| (joint.name, joint.scale.factor(), joint.scale.offset());
    Ok(joints.all.into_iter().map(joint).collect())
}
