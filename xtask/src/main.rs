//! The project's commands, behind the aliases in `.cargo/config.toml`.

mod apt;
mod board;
mod c_library;
mod campaign;
mod cargo;
mod ci;
mod circles;
mod coverage;
mod demo;
mod deny;
mod dfu;
mod dist;
mod examples;
mod features;
mod files;
mod flash;
mod fuzz;
mod glibc;
mod image;
// The command's parser of images.
#[cfg(test)]
#[path = "../../cli/src/update/image/mod.rs"]
mod image_parser;
mod installation;
mod integrity;
mod latency;
mod linker_inputs;
mod mutants;
mod named_boards;
mod no_panic;
mod packages;
mod parallel;
mod performance;
mod pico;
mod platforms;
mod process;
mod program;
mod python;
mod readme;
mod recordings;
// The command's drive of a boot loader.
#[path = "../../cli/src/update/rom_drive.rs"]
mod rom_drive;
mod ros2;
mod semver;
mod soak;
mod steps;
mod targets;
mod toolchain;
mod uf2;
mod vendor;
mod venv;
mod web;
mod workflow;
mod workspace;

use std::env;
use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;

/// The project's commands. `cargo demo`, `fw` and `ci` are aliases.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", max_term_width = 80)]
enum Command {
    /// Run the firmware image on the virtual board, with an arm
    Demo(demo::Options),
    /// Build the firmware image, also for boot loaders, and flash it
    Fw(flash::FwOptions),
    /// Run all checks of a change
    Ci,
    /// Check that no imports between files form a circle
    Circles,
    /// Check the C library: header, tests, sizes and packages
    C(c_library::Options),
    /// Check the package for Python: types, wheel, tests, speed
    Python(python::Options),
    /// Drive virtual arms with LeRobot, which takes 5 GB
    Lerobot,
    /// Drive virtual arms with CAN software, SDKs and servo programs
    Vendor(vendor::Options),
    /// Inject faults around the firmware image
    Campaign(campaign::Options),
    /// Measure the images and protocols, and check the limits
    Performance(performance::Options),
    /// Measure how long a program waits for a pose of a virtual arm
    Latency(latency::Options),
    /// Prove that protocol and bridge never panic or allocate
    NoPanic,
    /// Decode damaged frames, and compare docs/integrity.md
    Integrity(integrity::Options),
    /// Check licences, versions, sources and advisories of dependencies
    Deny,
    /// Check each feature alone, and the oldest compilers
    Features,
    /// Lint for microcontrollers, Windows and macOS
    Targets,
    /// Use the command and the libraries on other systems, by emulators
    Platforms,
    /// Build the examples, and run the RP2040's on an emulated chip
    Examples,
    /// Run the Pico's image on an emulated chip
    Pico(pico::Options),
    /// Run the images of the other boards on the virtual board
    Boards,
    /// Type the firmware's ordinary commands, and compare the images
    Workflow,
    /// Build the page in web/, and test it in headless Chromium
    Web(web::Options),
    /// Test and use the crates to publish from their .crate files
    Packages,
    /// Drive virtual arms by ROS 2 messages, with another DDS library
    Ros2,
    /// Record virtual arms, and read the recordings in other programs
    Recordings,
    /// Build the README's example with its dependencies
    Readme,
    /// Build a release: images, command, C library, licences
    Dist(dist::Options),
    /// Compare the public API with the last release
    Semver,
    /// Run the checks that take hours
    Soak(soak::Options),
    /// Mutate the code and run the tests, for hours
    Mutants(mutants::Options),
    /// Run the fuzz targets
    Fuzz(fuzz::Options),
    /// Measure the coverage of protocol and bridge by the fuzz corpus
    Coverage(coverage::Options),
}

impl Command {
    /// Parses the program's name, a command and its options.
    fn from_args(args: impl Iterator<Item = OsString>) -> Result<Self, clap::Error> {
        // `cargo demo -- --serve` and `cargo demo --serve` mean the same.
        let args = args.enumerate().filter(|(nth, arg)| *nth != 2 || arg != "--");
        Self::try_parse_from(args.map(|(_, arg)| arg))
    }

    fn run(self) -> Result<()> {
        match self {
            Self::Demo(options) => demo::run(options),
            Self::Fw(options) => flash::run(&options),
            Self::Ci => ci::run(),
            Self::Circles => circles::check(),
            Self::C(options) => c_library::run_all(&options),
            Self::Python(options) => python::run_all(&options),
            Self::Lerobot => python::run_lerobot(),
            Self::Vendor(options) => vendor::run(&options),
            Self::Campaign(options) => campaign::run(&options),
            Self::Performance(options) => performance::run(&options),
            Self::Latency(options) => latency::measure(&options),
            Self::NoPanic => no_panic::run(),
            Self::Integrity(options) => integrity::run(&options),
            Self::Deny => deny::run(),
            Self::Features => features::each(),
            Self::Targets => targets::check(),
            Self::Platforms => platforms::check(),
            Self::Examples => examples::check(),
            Self::Pico(options) => pico::test(&options),
            Self::Boards => named_boards::test(),
            Self::Workflow => workflow::check(),
            Self::Web(options) => web::run_all(&options),
            Self::Packages => packages::check(packages::Tests::Run),
            Self::Ros2 => ros2::check(),
            Self::Recordings => recordings::run_all(),
            Self::Readme => readme::check(),
            Self::Dist(options) => dist::run_all(&options),
            Self::Semver => semver::run(),
            Self::Soak(options) => soak::run(&options),
            Self::Mutants(options) => mutants::run(&options),
            Self::Fuzz(options) => fuzz::run(&options),
            Self::Coverage(options) => coverage::run(&options),
        }
    }
}

fn main() -> ExitCode {
    match Command::from_args(env::args_os())
        .unwrap_or_else(|error| error.exit())
        .run()
    {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use clap::CommandFactory;

    use super::*;

    #[test]
    fn help_has_one_short_line_per_command() {
        let help = Command::command().render_help().to_string();
        for command in Command::command().get_subcommands() {
            let about = command.get_about().unwrap().to_string();
            assert!(help.lines().any(|line| line.ends_with(&about)), "{about}\n{help}");
        }
        assert!(help.lines().all(|line| line.len() <= 80), "{help}");
    }

    #[test]
    fn documented_commands_parse() {
        let root = workspace::root();
        let pages = fs::read_dir(root.join("docs")).unwrap();
        let pages = pages.map(|page| page.unwrap().path()).chain([root.join("README.md")]);
        let mut commands = 0;
        for page in pages.filter(|page| page.extension().is_some_and(|extension| extension == "md")) {
            let text = fs::read_to_string(&page).unwrap();
            for line in text.lines().filter_map(|line| line.strip_prefix("$ cargo ")) {
                let words = line.split_whitespace().take_while(|word| *word != "#");
                let words: Vec<_> = words.skip_while(|word| *word == "xtask").collect();
                let is_alias = ["demo", "fw", "ci"].contains(&words[0]);
                if line.starts_with("xtask ") || is_alias {
                    let args = ["xtask"].iter().chain(&words).map(OsString::from);
                    if let Err(error) = Command::from_args(args) {
                        panic!("{}: cargo {line}\n{error}", page.display());
                    }
                    commands += 1;
                }
            }
        }
        assert!(commands > 20, "{commands} commands in the documentation");
    }
}
