//! The files that the archives of all systems have.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use super::dependencies::Program;
use super::folder::{copy, copy_folder, sysroot, write};
use super::release::Release;
use super::system::HERE;
use crate::board::Board;
use crate::c_library::{HEADER, TARGETS, library_command};
use crate::files::empty_folder;
use crate::process::{output, run};
use crate::toolchain::{cargo_for, rustc};
use crate::web;
use crate::workspace::root;

/// Files of the repository that a release contains unchanged.
const FILES: &str = "README.md CONTRIBUTING.md CHANGELOG.md SECURITY.md LICENSE-MIT LICENSE-APACHE docs tools firmware/README.md examples/README.md examples/c examples/joints python/examples cli/doc/monitor.svg";
/// The shells, and where each looks for completions below `/usr/local` or `~/.local`.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "share/bash-completion/completions/armwire"),
    ("fish", "share/fish/vendor_completions.d/armwire.fish"),
    ("zsh", "share/zsh/site-functions/_armwire"),
];

impl Release {
    /// The folder that each archive begins with.
    pub(super) fn common(&self) -> PathBuf {
        self.dist.join("common")
    }

    pub(super) fn make_common(&self) -> Result<()> {
        empty_folder(&self.common())?;
        self.extract(FILES, &self.common())?;
        self.add_images()?;
        self.add_manual()?;
        self.add_c_library()?;
        self.add_page()?;
        self.add_dependencies(&self.common(), &programs())?;
        // Rust's own libraries are part of the compiler.
        copy(
            &sysroot()?.join("share/doc/rust/COPYRIGHT-library.html"),
            &self.common().join("licences/rust-libraries.html"),
        )?;
        self.add_origin()
    }

    /// The images, by `cargo fw`.
    fn add_images(&self) -> Result<()> {
        for board in Board::all() {
            self.xtask(&["fw", "--board", board.name()])?;
            for extension in ["elf", "bin", board.update().extension()] {
                let file = format!("armwire-{}.{extension}", board.name());
                copy(
                    &self.build_dir().join(&file),
                    &self.common().join("firmware").join(file),
                )?;
            }
        }
        Ok(())
    }

    /// The command's completions and manual, from that of this machine.
    fn add_manual(&self) -> Result<()> {
        let program = self.command(HERE);
        for (shell, path) in COMPLETIONS {
            let completions = output(Command::new(&program).args(["completions", shell]))?;
            write(&self.common().join(path), &completions)?;
        }
        let manual = self.common().join("share/man/man1");
        fs::create_dir_all(&manual)?;
        run(Command::new(&program).arg("man").arg(manual))
    }

    /// The header, and the library for each microcontroller.
    fn add_c_library(&self) -> Result<()> {
        copy(&root().join(HEADER), &self.common().join("c/include/armwire.h"))?;
        TARGETS
            .into_iter()
            .try_for_each(|(target, _)| self.add_c_archive(target, &self.common()))
    }

    /// The library in C for this target.
    pub(super) fn add_c_archive(&self, target: &str, folder: &Path) -> Result<()> {
        run(self.reproducible(&mut cargo_for(target, &library_command(""))?)?)?;
        let library = self.build_dir().join(target).join("c/libarmwire_c.a");
        copy(&library, &folder.join("c/lib").join(target).join("libarmwire_c.a"))
    }

    /// The page, by `cargo xtask web`.
    fn add_page(&self) -> Result<()> {
        self.xtask(&["web", "--build"])?;
        copy_folder(&self.build_dir().join(web::PAGE), &self.common().join("web"))
    }

    /// The commit and the compiler, for a repetition of the build.
    fn add_origin(&self) -> Result<()> {
        let compiler = output(rustc().arg("-vV"))?;
        write(
            &self.common().join("BUILD"),
            &format!("commit: {}\n{compiler}", self.commit),
        )
    }
}

/// The programs for microcontrollers.
fn programs() -> [Program; 3] {
    let firmware = |name, board: Board, features| Program {
        features,
        ..Program::new(name, "firmware", board.target())
    };
    // The other board is a default feature.
    let stm32 = format!("--features {}", Board::STM32G431.feature());
    let pico = format!("--no-default-features --features {}", Board::PICO.feature());
    [
        firmware("firmware", Board::STM32G431, stm32),
        firmware("firmware-pico", Board::PICO, pico),
        Program::new("c", "c", TARGETS[0].0),
    ]
}
