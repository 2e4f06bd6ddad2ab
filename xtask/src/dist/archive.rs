//! The archive of a system.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use super::dependencies::Program;
use super::folder::{add_checksums, check_paths, copy, pack};
use super::release::Release;
use super::system::System;
use crate::files::empty_folder;
use crate::process::run;
use crate::{glibc, python};

impl Release {
    /// Makes the folder and the archive of this system.
    pub(super) fn make_archive(&self, system: System) -> Result<()> {
        let folder = self.folder(system);
        empty_folder(&folder)?;
        run(Command::new("cp").arg("-a").arg(self.common().join(".")).arg(&folder))?;
        self.add_command(system, &folder)?;
        if system.is_linux() {
            self.add_c_archive(system.target, &folder)?;
        }
        if system.has_wheel() {
            self.add_wheels(system, &folder.join("python"))?;
        }
        self.add_dependencies(&folder, &programs(system))?;
        check_paths(&folder)?;
        add_checksums(&folder)?;
        let archive = pack(&folder, &self.time)?;
        println!("{}\n{}", folder.display(), archive.display());
        Ok(())
    }

    fn add_command(&self, system: System, folder: &Path) -> Result<()> {
        let program = self.command(system);
        if system.is_linux() {
            check_symbols(&program)?;
        }
        copy(&program, &folder.join("bin").join(system.program()))
    }

    fn add_wheels(&self, system: System, folder: &Path) -> Result<()> {
        let mut modules = 0;
        for wheel in fs::read_dir(self.wheels())? {
            let wheel = wheel?;
            let name = wheel.file_name();
            if system.takes_wheel(&name.to_string_lossy()) {
                modules += self.check_wheel(&wheel.path())?;
                copy(&wheel.path(), &folder.join(name))?;
            }
        }
        ensure!(modules > 0, "no wheel has a compiled module for {}", system.target);
        Ok(())
    }

    /// Checks the content of a wheel: neither paths nor symbols are found in a compressed file. Returns the number of its
    /// compiled modules.
    fn check_wheel(&self, wheel: &Path) -> Result<usize> {
        let unpacked = self.dist.join("wheel");
        let modules = python::check_modules(wheel, &unpacked)?;
        check_paths(&unpacked)?;
        Ok(modules)
    }
}

/// Checks that a program for Linux starts on the oldest system that the manual names.
fn check_symbols(file: &Path) -> Result<()> {
    glibc::check(&fs::read(file)?).with_context(|| file.display().to_string())
}

/// The programs for this system alone.
fn programs(system: System) -> Vec<Program> {
    let mut programs = vec![Program::new("armwire", "cli", system.target)];
    if system.has_wheel() {
        programs.push(Program::new("python", "python", system.target));
    }
    programs
}
