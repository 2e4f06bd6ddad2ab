//! `cargo xtask dist`: a reproducible release of the current commit, independent of the folder.

mod trial;

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::board::{self, Board};
use crate::c_library::{HEADER, TARGETS, library_command};
use crate::cargo::{cargo, target_dir, tool};
use crate::files::empty_folder;
use crate::process::{output, run, run_to};
use crate::toolchain::{cargo_for, rustc, rustc_property};
use crate::workspace::root;
use crate::{python, web};

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Files of the repository that a release contains unchanged.
const FILES: &str = "README.md CONTRIBUTING.md CHANGELOG.md SECURITY.md LICENSE-MIT LICENSE-APACHE docs tools examples/README.md examples/c examples/joints python/examples cli/doc/monitor.svg";
/// The shells, and where each looks for completions below `/usr/local` or `~/.local`.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "share/bash-completion/completions/armwire"),
    ("fish", "share/fish/vendor_completions.d/armwire.fish"),
    ("zsh", "share/zsh/site-functions/_armwire"),
];
/// The arguments of cargo that build the command.
const COMMAND: &str = "build --quiet --release --package armwire-cli --config=profile.release.strip=true";
/// Source folder recorded in the programs.
const SOURCES: &str = "/armwire";

#[derive(Args)]
pub(crate) struct Options {
    /// Use it without Rust, build it again in another folder, and compare every byte
    #[arg(long)]
    check: bool,
}

impl Options {
    /// The release is used, and made twice.
    pub(crate) const CHECK: Self = Self { check: true };
}

/// Makes the release as a folder and an archive of it.
///
/// # Errors
///
/// If there are uncommitted changes, if a build fails or contains a path of this machine, if the release cannot be used, or if a
/// second one differs.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    let release = Release::new()?;
    release.make()?;
    if options.check {
        trial::run_all(&release.archive(&release.dist), &release.dist.join("trial"))?;
        release.compare_with_another()?;
    }
    Ok(())
}

/// A release for the architecture and system of this machine.
struct Release {
    commit: String,
    /// The time of the commit, in seconds since 1970.
    time: String,
    /// The target of this machine.
    host: String,
    /// `target/dist`.
    dist: PathBuf,
}

impl Release {
    fn new() -> Result<Self> {
        check_tree("a release needs a commit, and there are uncommitted changes")?;
        Ok(Self {
            commit: git("rev-parse HEAD")?,
            time: git("log -1 --format=%ct")?,
            host: rustc_property("host")?,
            dist: target_dir()?.join("dist"),
        })
    }

    /// `armwire-0.1.0`.
    fn name() -> String {
        format!("armwire-{VERSION}")
    }

    /// The folder of the release.
    fn folder(&self) -> PathBuf {
        self.dist.join(Self::name())
    }

    /// The archive of the folder, in `dist` of this or another checkout.
    fn archive(&self, dist: &Path) -> PathBuf {
        dist.join(format!("{}-{}.tar.gz", Self::name(), self.host))
    }

    fn make(&self) -> Result<()> {
        run(&mut cargo("fetch --locked"))?;
        let folder = self.folder();
        empty_folder(&folder)?;
        self.add_files()?;
        self.add_images()?;
        self.add_command()?;
        self.add_c_library()?;
        self.add_wheels()?;
        self.add_page()?;
        self.add_licences()?;
        self.add_bills_of_materials()?;
        self.add_origin()?;
        check_paths(&folder)?;
        add_checksums(&folder)?;
        self.pack()?;
        check_tree("the release changed the sources")
    }

    fn add_files(&self) -> Result<()> {
        self.extract(FILES, &self.folder())
    }

    /// The images, by `cargo fw`.
    fn add_images(&self) -> Result<()> {
        for board in Board::all() {
            self.xtask(&["fw", "--board", board.name()])?;
            for extension in ["elf", "bin", board.update().extension()] {
                let file = format!("armwire-{}.{extension}", board.name());
                copy(
                    &self.build_dir().join(&file),
                    &self.folder().join("firmware").join(file),
                )?;
            }
        }
        Ok(())
    }

    /// The command, with its completions and manual. It has no symbols: the compiler's names of some differ from build to
    /// build.
    fn add_command(&self) -> Result<()> {
        let folder = self.folder();
        run(self.reproducible(&mut cargo(COMMAND))?)?;
        let program = folder.join("bin/armwire");
        copy(&self.build_dir().join("release/armwire"), &program)?;
        for (shell, path) in COMPLETIONS {
            let completions = output(Command::new(&program).args(["completions", shell]))?;
            write(&folder.join(path), &completions)?;
        }
        let manual = folder.join("share/man/man1");
        fs::create_dir_all(&manual)?;
        run(Command::new(&program).arg("man").arg(manual))
    }

    /// The header, and the library for this machine and each microcontroller.
    fn add_c_library(&self) -> Result<()> {
        let folder = self.folder().join("c");
        copy(&root().join(HEADER), &folder.join("include/armwire.h"))?;
        let targets = TARGETS.map(|(target, _)| target);
        let mut native = cargo(&library_command(""));
        native.args(["--target", &self.host]);
        run(self.reproducible(&mut native)?)?;
        for target in targets {
            run(self.reproducible(&mut cargo_for(target, &library_command(""))?)?)?;
        }
        for target in targets.into_iter().chain([&*self.host]) {
            let library = self.build_dir().join(target).join("c/libarmwire_c.a");
            copy(&library, &folder.join("lib").join(target).join("libarmwire_c.a"))?;
        }
        Ok(())
    }

    /// The wheels for Python, by `cargo xtask python`.
    fn add_wheels(&self) -> Result<()> {
        self.xtask(&["python", "--build"])?;
        let wheels = self.build_dir().join(python::WHEELS);
        // Paths cannot be found in compressed files.
        let unpacked = self.dist.join("wheels");
        empty_folder(&unpacked)?;
        for wheel in fs::read_dir(&wheels)? {
            let mut unzip = Command::new("python3");
            run(unzip.args(["-m", "zipfile", "-e"]).arg(wheel?.path()).arg(&unpacked))?;
        }
        check_paths(&unpacked)?;
        copy_folder(&wheels, &self.folder().join("python"))
    }

    /// The page, by `cargo xtask web`.
    fn add_page(&self) -> Result<()> {
        self.xtask(&["web", "--build"])?;
        copy_folder(&self.build_dir().join(web::PAGE), &self.folder().join("web"))
    }

    /// Runs a command of this program, whose builds are [reproducible](Self::reproducible).
    fn xtask(&self, words: &[&str]) -> Result<()> {
        let mut xtask = Command::new(env::current_exe()?);
        run(self.reproducible(xtask.args(words))?)
    }

    /// The licence texts of all crates in the programs.
    fn add_licences(&self) -> Result<()> {
        let folder = self.folder().join("licences");
        fs::create_dir_all(&folder)?;
        for (program, package, options) in self.programs() {
            let mut about = tool(&format!(
                "about generate --offline --locked --fail --manifest-path={package}/Cargo.toml {options} -c about.toml -o"
            ))?;
            run(about.arg(folder.join(format!("{program}.txt"))).arg("about.hbs"))?;
        }
        // Those of Rust's own libraries are part of the compiler.
        copy(
            &sysroot()?.join("share/doc/rust/COPYRIGHT-library.html"),
            &folder.join("rust-libraries.html"),
        )
    }

    /// The crates of each program, as CycloneDX.
    fn add_bills_of_materials(&self) -> Result<()> {
        const FILE: &str = "sbom-of-a-release";
        // cargo-cyclonedx writes a file beside each Cargo.toml of a workspace: a copy is used.
        let copy = self.dist.join("sbom-sources");
        empty_folder(&copy)?;
        self.extract("", &copy)?;
        for (program, package, options) in self.programs() {
            let mut cyclonedx = tool(&format!(
                "cyclonedx --manifest-path={package}/Cargo.toml {options} --quiet --format json --spec-version 1.5 \
                 --no-build-deps --override-filename {FILE}"
            ))?;
            run(self.reproducible(&mut cyclonedx)?.current_dir(&copy))?;
            let sbom = fs::read_to_string(copy.join(package).join(FILE).with_extension("json"))?;
            // A crate of this workspace is identified by its folder.
            let sbom = sbom.replace(&copy.display().to_string(), SOURCES);
            write(&self.folder().join(format!("sbom/{program}.cdx.json")), &sbom)?;
        }
        fs::remove_dir_all(&copy)?;
        Ok(())
    }

    /// Copies files of the commit, or all of them if none are named, into a folder.
    fn extract(&self, files: &str, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder)?;
        let archive = self.dist.join("sources.tar");
        let words = format!("archive {} {files}", self.commit);
        run(git_command(words.trim_end()).arg("-o").arg(&archive))?;
        run(Command::new("tar").arg("-xf").arg(archive).arg("-C").arg(folder))
    }

    /// The programs of a release, each with its package and with cargo's arguments for its dependencies.
    fn programs(&self) -> [(&'static str, &'static str, String); 5] {
        let target = |target: &str| format!("--target {target}");
        // The other board is a default feature.
        let firmware = format!("{} --features board-stm32g431", target(board::TARGET));
        let (pico_target, feature) = (Board::PICO.target(), Board::PICO.feature());
        let pico = format!("{} --no-default-features --features {feature}", target(pico_target));
        [
            ("armwire", "cli", target(&self.host)),
            ("firmware", "firmware", firmware),
            ("firmware-pico", "firmware", pico),
            ("c", "c", target(&self.host)),
            ("python", "python", target(&self.host)),
        ]
    }

    /// The commit and the compiler, for a repetition of the build.
    fn add_origin(&self) -> Result<()> {
        let compiler = output(rustc().arg("-vV"))?;
        write(
            &self.folder().join("BUILD"),
            &format!("commit: {}\n{compiler}", self.commit),
        )
    }

    fn pack(&self) -> Result<()> {
        let archive = self.archive(&self.dist);
        let mut tar = Command::new("tar");
        tar.args(
            "--create --format=ustar --sort=name --owner=0 --group=0 --numeric-owner --mode=u=rwX,go=rX".split(' '),
        );
        tar.arg(format!("--mtime=@{}", self.time));
        tar.args(["--use-compress-program=gzip --no-name --best", "--file"])
            .arg(&archive);
        run(tar.arg("-C").arg(&self.dist).arg(Self::name()).env("LC_ALL", "C"))?;
        println!("{}\n{}", self.folder().display(), archive.display());
        Ok(())
    }

    /// A separate target directory: the different flags would invalidate all other builds.
    fn build_dir(&self) -> PathBuf {
        self.dist.join("build")
    }

    /// Makes cargo build in [`Self::build_dir`], and write no path and no time of this machine. The command is cargo or
    /// starts it.
    fn reproducible<'a>(&self, command: &'a mut Command) -> Result<&'a mut Command> {
        let library = sysroot()?.join("lib/rustlib/src/rust");
        let build_dir = self.build_dir();
        // The last matching prefix applies.
        let flags = [
            (&*cargo_home()?, "/cargo"),
            (&library, &format!("/rustc/{}", rustc_property("commit-hash")?)),
            (root(), SOURCES),
            (&build_dir, &format!("{SOURCES}/target")),
        ]
        .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()));
        Ok(command
            .env("CARGO_TARGET_DIR", self.build_dir())
            .env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"))
            .env("SOURCE_DATE_EPOCH", &self.time))
    }

    /// Builds the release in a clone, with the clone's own commands, and compares the archives.
    fn compare_with_another(&self) -> Result<()> {
        let clone = self.dist.join("clone");
        empty_folder(&clone)?;
        run(git_command("clone --quiet --shared --no-checkout .").arg(&clone))?;
        run(git_command(&format!("checkout --quiet {}", self.commit)).current_dir(&clone))?;
        let other = clone.join("target/dist");
        let mut dist = cargo("run --quiet --package xtask -- dist");
        dist.current_dir(&clone).env("CARGO_TARGET_DIR", clone.join("target"));
        run(&mut dist)?;
        run(Command::new("diff")
            .args(["--recursive", "--brief"])
            .arg(self.folder())
            .arg(other.join(Self::name())))?;
        let is_same = fs::read(self.archive(&self.dist))? == fs::read(self.archive(&other))?;
        ensure!(is_same, "the files are equal, but the archives differ");
        fs::remove_dir_all(&clone)?;
        println!("a second release, built in {}, has the same bytes", clone.display());
        Ok(())
    }
}

/// Checks that no source file is new or changed.
fn check_tree(otherwise: &str) -> Result<()> {
    let changes = git("status --porcelain")?;
    ensure!(changes.is_empty(), "{otherwise}:\n{changes}");
    Ok(())
}

/// Checks that no file contains a path of this machine.
fn check_paths(folder: &Path) -> Result<()> {
    let mut grep = Command::new("grep");
    grep.args(["--recursive", "--text", "--files-with-matches", "--fixed-strings"]);
    for path in [root(), &*cargo_home()?, &*sysroot()?] {
        grep.arg("-e").arg(path);
    }
    // Exit code 1: nothing found.
    run_to(&[1], grep.arg(folder)).context("the files above contain paths of this machine")
}

/// The folder of the compiler.
fn sysroot() -> Result<PathBuf> {
    Ok(output(rustc().args(["--print", "sysroot"]))?.trim_end().into())
}

fn cargo_home() -> Result<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    home.or_else(|| Some(env::home_dir()?.join(".cargo")))
        .context("neither CARGO_HOME nor HOME is set")
}

/// Writes `SHA256SUMS` of all files in a folder.
fn add_checksums(folder: &Path) -> Result<()> {
    let mut files = Vec::new();
    list(folder, &mut files)?;
    files.sort();
    let names = files.iter().map(|file| file.strip_prefix(folder));
    let names = names.collect::<Result<Vec<_>, _>>()?;
    let sums = output(Command::new("sha256sum").args(names).current_dir(folder))?;
    write(&folder.join("SHA256SUMS"), &sums)
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        match path.is_dir() {
            true => list(&path, files)?,
            false => files.push(path),
        }
    }
    Ok(())
}

fn git_command(words: &str) -> Command {
    let mut git = Command::new("git");
    git.args(words.split(' ')).current_dir(root());
    git
}

fn git(words: &str) -> Result<String> {
    Ok(output(&mut git_command(words))?.trim_end().into())
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    create_parent(to)?;
    fs::copy(from, to).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(())
}

/// Copies the files of a folder that has no folders in it.
fn copy_folder(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        copy(&entry.path(), &to.join(entry.file_name()))?;
    }
    Ok(())
}

fn write(file: &Path, text: &str) -> Result<()> {
    create_parent(file)?;
    fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

fn create_parent(file: &Path) -> Result<()> {
    let Some(parent) = file.parent() else {
        bail!("{} is in no folder", file.display());
    };
    Ok(fs::create_dir_all(parent)?)
}
