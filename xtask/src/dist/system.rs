//! The systems that a release is for, each with a command of its own.

use std::process::Command;

use anyhow::Result;

use crate::toolchain::{cargo_for, require_target};
use crate::venv::Environment;
use crate::workspace::root;
use crate::{glibc, python};

/// The arguments of cargo for the command. It has no symbols: the compiler's names of some differ from build to build.
const COMMAND: &str = "--quiet --release --package armwire-cli --config=profile.release.strip=true";

/// A system, by its target.
#[derive(Clone, Copy)]
pub(super) struct System {
    pub(super) target: &'static str,
}

/// The systems: those that `cargo xtask platforms` runs.
pub(super) const SYSTEMS: [System; 4] = [
    System {
        target: "x86_64-unknown-linux-gnu",
    },
    System {
        target: "aarch64-unknown-linux-gnu",
    },
    System {
        target: "armv7-unknown-linux-gnueabihf",
    },
    System {
        target: "x86_64-pc-windows-gnu",
    },
];

/// The system that makes releases.
pub(super) const HERE: System = SYSTEMS[0];

impl System {
    pub(super) fn is_linux(self) -> bool {
        self.target.contains("linux")
    }

    /// Returns true if pip installs the package for Python from a wheel.
    pub(super) fn has_wheel(self) -> bool {
        python::TARGETS.contains(&self.target)
    }

    /// Returns true if a wheel with this name is for this system: its own, or one without compiled code.
    pub(super) fn takes_wheel(self, name: &str) -> bool {
        let processor = self.target.split('-').next().unwrap_or_default();
        self.has_wheel() && (name.ends_with("-any.whl") || name.ends_with(&format!("_{processor}.whl")))
    }

    /// The file of the command.
    pub(super) fn program(self) -> &'static str {
        if self.is_linux() { "armwire" } else { "armwire.exe" }
    }

    /// Cargo that builds the command. Zig links it for Linux, with the versions of symbols of an old C library.
    ///
    /// # Errors
    ///
    /// If the target is missing and rustup cannot add it.
    pub(super) fn build(self, tools: &Environment) -> Result<Command> {
        if !self.is_linux() {
            // The linker would write the time of the commit, but cargo does not link again for a later commit.
            let mut cargo = cargo_for(self.target, &format!("rustc {COMMAND} --bin armwire"))?;
            cargo.args(["--", "-Clink-arg=-Wl,--no-insert-timestamp"]);
            return Ok(cargo);
        }
        require_target(self.target)?;
        let mut zigbuild = tools.tool("cargo-zigbuild");
        zigbuild.arg("zigbuild").args(COMMAND.split(' '));
        zigbuild.args(["--target", &format!("{}.{}", self.target, glibc::OLDEST)]);
        zigbuild.current_dir(root());
        Ok(zigbuild)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archive_has_the_wheels_for_its_system_only() {
        const WHEELS: [&str; 3] = [
            "armwire-0.1.0-cp310-abi3-manylinux2014_x86_64.manylinux_2_17_x86_64.whl",
            "armwire-0.1.0-cp310-abi3-manylinux2014_aarch64.manylinux_2_17_aarch64.whl",
            "lerobot_robot_alicia_d_armwire-0.1.0-py3-none-any.whl",
        ];
        let taken = SYSTEMS.map(|system| WHEELS.map(|wheel| system.takes_wheel(wheel)));
        let none = [false; 3];
        assert_eq!(taken, [[true, false, true], [false, true, true], none, none]);
    }
}
