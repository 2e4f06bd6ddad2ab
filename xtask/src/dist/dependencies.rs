//! The crates in the programs of a release: their licences, and bills of materials.

use std::fs;
use std::path::Path;

use anyhow::Result;

use super::folder::write;
use super::release::{Release, SOURCES};
use crate::cargo::tool;
use crate::files::empty_folder;
use crate::process::run;

/// A program or library of a release.
pub(super) struct Program {
    pub(super) name: &'static str,
    /// The folder of its package.
    pub(super) package: &'static str,
    pub(super) target: &'static str,
    /// Arguments of cargo.
    pub(super) features: String,
}

impl Program {
    /// The program that has the default features.
    pub(super) fn new(name: &'static str, package: &'static str, target: &'static str) -> Self {
        Self {
            name,
            package,
            target,
            features: String::new(),
        }
    }

    /// Arguments of cargo's subcommands that list its crates.
    fn words(&self) -> String {
        let Self {
            package,
            target,
            features,
            ..
        } = self;
        format!("--manifest-path={package}/Cargo.toml --target {target} {features}")
    }
}

impl Release {
    /// Writes the licences and the bills of materials of these programs.
    pub(super) fn add_dependencies(&self, folder: &Path, programs: &[Program]) -> Result<()> {
        add_licences(&folder.join("licences"), programs)?;
        self.add_bills_of_materials(&folder.join("sbom"), programs)
    }

    /// The crates of each program, as CycloneDX.
    fn add_bills_of_materials(&self, folder: &Path, programs: &[Program]) -> Result<()> {
        const FILE: &str = "sbom-of-a-release";
        // cargo-cyclonedx writes a file beside each Cargo.toml of a workspace: a copy is used.
        let copy = self.dist.join("sbom-sources");
        empty_folder(&copy)?;
        self.extract("", &copy)?;
        for program in programs {
            let mut cyclonedx = tool(&format!(
                "cyclonedx {} --quiet --format json --spec-version 1.5 --no-build-deps --override-filename {FILE}",
                program.words()
            ))?;
            run(self.reproducible(&mut cyclonedx)?.current_dir(&copy))?;
            let sbom = fs::read_to_string(copy.join(program.package).join(FILE).with_extension("json"))?;
            // A crate of this workspace is identified by its folder.
            let sbom = sbom.replace(&copy.display().to_string(), SOURCES);
            write(&folder.join(format!("{}.cdx.json", program.name)), &sbom)?;
        }
        Ok(fs::remove_dir_all(&copy)?)
    }
}

/// The licence texts of all crates in the programs.
fn add_licences(folder: &Path, programs: &[Program]) -> Result<()> {
    fs::create_dir_all(folder)?;
    for program in programs {
        let words = program.words();
        let mut about = tool(&format!(
            "about generate --offline --locked --fail {words} -c about.toml -o"
        ))?;
        run(about.arg(folder.join(format!("{}.txt", program.name))).arg("about.hbs"))?;
    }
    Ok(())
}
