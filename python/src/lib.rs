//! The extension module of the Python package `armwire`: ports of arms and adapters, and virtual arms.
//!
//! Its calls use wire units. The Python sources around it add names, units and types.

mod adapter;
mod alpha1;
#[cfg(feature = "command")]
mod command;
mod error;
mod joints;
mod joints_file;
mod ling;
mod reader;
mod session;
#[cfg(unix)]
mod sim;
mod xarm;

/// Ports with an arm or an adapter, and virtual arms.
#[pyo3::pymodule]
mod _armwire {
    #[pymodule_export]
    use super::adapter::AdapterPort;
    #[pymodule_export]
    use super::alpha1::Alpha1Port;
    #[cfg(feature = "command")]
    #[pymodule_export]
    use super::command::run;
    #[pymodule_export]
    use super::joints_file::read_joints_file;
    #[pymodule_export]
    use super::ling::{
        LingModeSwitching, LingParking, LingPort, LingSwitching, LingWait, ling_angles, ling_is_holding, ling_joints,
        ling_motion_refusal,
    };
    #[pymodule_export]
    use super::reader::{LingReader, XArmReader};
    /// The slowest speed of a move of a Ling arm, in ticks per second.
    #[pymodule_export]
    const SLOWEST_TICKS_S: u16 = armwire::ling::Speed::SLOWEST.ticks_per_second();
    /// The slowest speed of a move of a force-feedback leader, in ticks per second.
    #[pymodule_export]
    const SLOWEST_OF_FORCE_FEEDBACK_TICKS_S: u16 = armwire::ling::Speed::SLOWEST_OF_FORCE_FEEDBACK.ticks_per_second();
    /// The version of the package.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[cfg(unix)]
    #[pymodule_export]
    use super::sim::{VirtualAlpha1, VirtualAlpha1Servos, VirtualLing, VirtualOlderLing, VirtualSo101, VirtualXArm};
    #[pymodule_export]
    use super::xarm::XArmPort;
}
