//! Packages of Debian that are unpacked in a folder, not installed: of a newer release, or for another processor.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result};

use crate::files::empty_folder;
use crate::process::{output, run};

/// Downloads packages of this release and architecture, from the mirror that this machine uses, and unpacks them into
/// `folder`, if it does not exist.
///
/// # Errors
///
/// On another system than Debian, and if apt-get fails.
pub(super) fn unpack(release: &str, architecture: &str, packages: &[&str], folder: &Path) -> Result<()> {
    if folder.exists() {
        return Ok(());
    }
    let state = folder.with_extension("apt");
    empty_folder(&state)?;
    for part in ["lists/partial", "cache/archives/partial"] {
        fs::create_dir_all(state.join(part))?;
    }
    let sources = state.join("sources.list");
    fs::write(&sources, format!("deb {} {release} main\n", mirror()?))?;
    let apt = |words: &str| {
        let mut apt = Command::new("apt-get");
        for (option, value) in [
            ("Dir::Etc::SourceList", &*sources.to_string_lossy()),
            ("Dir::Etc::SourceParts", "/dev/null"),
            ("Dir::State::Lists", &*state.join("lists").to_string_lossy()),
            ("Dir::Cache", &*state.join("cache").to_string_lossy()),
            ("APT::Architecture", architecture),
            ("APT::Architectures", architecture),
            // The folder is not that of the user who downloads otherwise.
            ("APT::Sandbox::User", "root"),
        ] {
            apt.args(["-o", &format!("{option}={value}")]);
        }
        apt.arg("--quiet").args(words.split(' ')).current_dir(&state);
        // `cargo run` set it to the compiler's libraries.
        apt.env_remove("LD_LIBRARY_PATH");
        apt
    };
    run(&mut apt("update"))?;
    run(apt("download").args(packages))?;
    let unpacked = state.join("unpacked");
    for file in fs::read_dir(&state)? {
        let file = file?.path();
        if file.extension().is_some_and(|extension| extension == "deb") {
            run(Command::new("dpkg-deb").arg("--extract").arg(&file).arg(&unpacked))?;
        }
    }
    fs::rename(unpacked, folder)?;
    Ok(fs::remove_dir_all(state)?)
}

/// The address of the first archive of packages in this machine's configuration.
fn mirror() -> Result<String> {
    let mut targets = Command::new("apt-get");
    targets.args(["indextargets", "--format", "$(REPO_URI)", "Created-By: Packages"]);
    let targets = output(&mut targets).context("packages of Debian are needed")?;
    let first = targets.lines().next();
    Ok(first.context("apt-get knows no archive of packages")?.to_owned())
}
