//! `cargo xtask c`: the C library, its header, tests, sizes and packages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use object::Endianness;
use object::read::elf::ElfFile32;
use object::{Object, ObjectSection, ObjectSymbol};

use crate::apt;
use crate::cargo::{cargo, target_dir, tool};
use crate::process::{output, run};
use crate::toolchain::{cargo_for, rustc_property};
use crate::workspace::root;

/// The version of cbindgen: another version may generate a different header.
const CBINDGEN: &str = "0.29.4";
pub(crate) const HEADER: &str = "c/include/armwire.h";
/// Other tools, and their packages.
pub(crate) const TOOLS: [(&str, &str); 7] = [
    ("gcc", "gcc"),
    ("g++", "g++"),
    ("cmake", "cmake"),
    ("pkg-config", "pkg-config"),
    ("arm-none-eabi-gcc", "gcc-arm-none-eabi"),
    ("riscv64-unknown-elf-gcc", "gcc-riscv64-unknown-elf"),
    ("qemu-system-arm", "qemu-system-arm"),
];
const PROTOCOL_SETS: &str =
    "--feature-powerset --skip default,prove-panic,small-crc --at-least-one-of ling,alpha1,xarm";
const WARNINGS: &str = "-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror";
const SANITIZERS: &str = "-g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all";
/// Requests of each protocol to an arm in C.
const EXCHANGES: &str = "20000";
/// Steps of the random programs.
const STEPS: &str = "1000000";
/// Requests and steps where an emulator runs them.
const FEW: &str = "2000";
/// The requests with their effects, for a test.
const EFFECTS: &str = "protocol/tests/effects.txt";

/// The target whose sizes are printed.
const SMALLEST: &str = "thumbv6m-none-eabi";
/// Each target, and the C compiler for it.
pub(crate) const TARGETS: [(&str, &str); 3] = [
    (SMALLEST, "arm-none-eabi-gcc -mcpu=cortex-m0plus"),
    (
        "thumbv7em-none-eabihf",
        "arm-none-eabi-gcc -mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16",
    ),
    (
        "riscv32imc-unknown-none-elf",
        "riscv64-unknown-elf-gcc -march=rv32imc -mabi=ilp32",
    ),
];
/// An Arduino library's folder for a processor's archive, by target.
const ARDUINO_FOLDERS: [(&str, &[&str]); 3] = [
    (SMALLEST, &["cortex-m0", "cortex-m0plus"]),
    ("thumbv7em-none-eabihf", &["cortex-m4/fpv4-sp-d16-hard"]),
    ("riscv32imc-unknown-none-elf", &["esp32c3"]),
];
/// Maximum size of the protocol code in a program with Ling's client alone, in bytes.
const LING_LIMIT: u64 = 20 * 1024;
/// The symbol that is linked if a panic is reachable.
const PANIC: &str = "armwire_panicked";

/// An action instead of all checks.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Only write the header
    #[arg(long)]
    write: bool,
    /// Only write a library for Arduino and PlatformIO to this folder
    #[arg(long, value_name = "FOLDER")]
    arduino: Option<PathBuf>,
}

/// Checks the header, runs the tests in C, and builds the library for every target and the packages.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    if let Some(folder) = &options.arduino {
        return write_arduino(folder);
    }
    find_tools()?;
    check_header(options.write)?;
    if options.write {
        return Ok(());
    }
    compile_header()?;
    check_versions()?;
    let dir = target_dir()?.join("c-tests");
    fs::create_dir_all(&dir)?;
    run(&mut tool(&format!(
        "hack clippy --quiet --package armwire-c {PROTOCOL_SETS} -- -D warnings"
    ))?)?;
    run(&mut cargo("test --quiet --package armwire-c"))?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    test(&dir, &armwire)?;
    for (target, compiler) in TARGETS {
        check_panics(&dir, target, compiler)?;
    }
    print_sizes(&dir)?;
    test_emulated(&dir)?;
    emulate(&dir, &armwire)?;
    package(&dir)?;
    check_arduino(&dir)?;
    check_zephyr(&dir)
}

/// Installs missing tools.
fn find_tools() -> Result<()> {
    apt::require(&TOOLS)?;
    // A C library for the tests on a Cortex-M. The compiler prints the name alone if there is no such file.
    if !output(Command::new("arm-none-eabi-gcc").arg("-print-file-name=rdimon.specs"))?.contains('/') {
        let is_installed = apt::install(&["libnewlib-arm-none-eabi"])?;
        ensure!(
            is_installed,
            "newlib is missing; run `sudo apt-get install --no-install-recommends libnewlib-arm-none-eabi`"
        );
    }
    let version = output(Command::new("cbindgen").arg("--version"));
    if version.is_ok_and(|version| version.trim() == format!("cbindgen {CBINDGEN}")) {
        return Ok(());
    }
    let mut install = cargo(&format!("install --locked --debug cbindgen@{CBINDGEN}"));
    println!("cbindgen {CBINDGEN} is missing");
    run(&mut install)
}

/// Compares the header with cbindgen's output, or writes it.
fn check_header(write: bool) -> Result<()> {
    let header = root().join(HEADER);
    let mut cbindgen = Command::new("cbindgen");
    cbindgen
        .args(["--quiet", "--config", "c/cbindgen.toml", "--crate", "armwire-c", "c"])
        // The stable compiler expands macros only so.
        .env("RUSTC_BOOTSTRAP", "1")
        .env("CARGO_EXPAND_TARGET_DIR", target_dir()?.join("cbindgen"))
        .current_dir(root());
    let text = output(&mut cbindgen)?;
    if write {
        fs::write(&header, text)?;
        return Ok(());
    }
    let is_current = fs::read_to_string(&header)? == text;
    ensure!(is_current, "{HEADER} is outdated: run `cargo xtask c --write`");
    Ok(())
}

/// Checks that the packages have the version of the library.
fn check_versions() -> Result<()> {
    let manifest = fs::read_to_string(root().join("c/Cargo.toml"))?;
    let version = manifest.lines().find_map(|line| line.strip_prefix("version = "));
    let version = version.context("c/Cargo.toml has no version")?.trim_matches('"');
    let lines = [
        (
            "c/CMakeLists.txt",
            format!("project(armwire VERSION {version} LANGUAGES C)"),
        ),
        ("c/arduino/library.properties", format!("version={version}")),
        ("c/arduino/library.json", format!("  \"version\": \"{version}\",")),
    ];
    for (file, expected) in lines {
        let text = fs::read_to_string(root().join(file))?;
        ensure!(
            text.lines().any(|line| line == expected),
            "{file} has no line `{expected}`"
        );
    }
    Ok(())
}

/// Compiles the header as C99 and C++17, without warnings.
fn compile_header() -> Result<()> {
    let check = |compiler: &str, language: &str, standard: &str| {
        let mut compile = Command::new(compiler);
        compile
            .args(WARNINGS.split(' '))
            .args(["-fsyntax-only", "-x", language]);
        run(compile.arg(standard).arg(root().join(HEADER)))
    };
    check("gcc", "c", "-std=c99")?;
    check("g++", "c++", "-std=c++17")
}

/// Runs the tests in C with sanitizers in the tests and the library.
fn test(dir: &Path, armwire: &Path) -> Result<()> {
    let library = sanitized()?;
    for test in ["device", "endings", "misuse", "effects", "ling", "alpha1", "xarm"] {
        let mut program = Command::new(compile(dir, test, SANITIZERS, Some(&library))?);
        match test {
            "device" => drop(program.arg(EXCHANGES)),
            "endings" | "misuse" => drop(program.arg(STEPS)),
            "effects" => drop(program.arg(root().join(EFFECTS))),
            _ => drop(program.arg(armwire)),
        }
        println!("{test}");
        run(&mut program)?;
    }
    Ok(())
}

/// Runs the tests without a line for another system: this compiler makes the programs, and `command` starts each.
///
/// # Errors
///
/// The first test that fails, or does not compile.
pub(crate) fn test_by(gcc: &str, library: &Path, dir: &Path, command: impl Fn(&Path) -> Command) -> Result<()> {
    fs::create_dir_all(dir)?;
    for test in ["device", "endings", "misuse", "effects"] {
        let program = compile_by(gcc, dir, test, "", Some(library))?;
        let mut program = command(&program);
        match test {
            "effects" => drop(program.arg(EFFECTS)),
            _ => drop(program.arg(FEW)),
        }
        run(&mut program)?;
    }
    Ok(())
}

/// Compiles a test for this machine and returns the program.
fn compile(dir: &Path, test: &str, options: &str, library: Option<&Path>) -> Result<PathBuf> {
    compile_by("gcc", dir, test, options, library)
}

fn compile_by(gcc: &str, dir: &Path, test: &str, options: &str, library: Option<&Path>) -> Result<PathBuf> {
    let program = dir.join(test);
    let mut compile = Command::new(gcc);
    compile.args(["-std=c99", "-Ic/include"]).args(WARNINGS.split(' '));
    compile.args(options.split_whitespace());
    compile.arg(format!("c/test/{test}.c"));
    compile.args(["c/test/harness.c", "c/test/events.c"]).args(library);
    run(compile.arg("-o").arg(&program).current_dir(root()))?;
    Ok(program)
}

/// Builds the library for this machine with the address sanitizer, an unstable option of the compiler.
fn sanitized() -> Result<PathBuf> {
    let host = rustc_property("host")?;
    let dir = target_dir()?.join("c-sanitized");
    let mut build = cargo(&library_command(""));
    build.args(["--target", &host]).env("CARGO_TARGET_DIR", &dir);
    build
        .env("RUSTC_BOOTSTRAP", "1")
        .env("RUSTFLAGS", "-Zsanitizer=address -Zexternal-clangrt");
    run(&mut build)?;
    Ok(dir.join(host).join("c/libarmwire_c.a"))
}

/// Arguments of cargo that build the static library with all protocols and these features.
pub(crate) fn library_command(features: &str) -> String {
    format!("rustc --quiet --package armwire-c --profile c --crate-type staticlib --features={features}")
}

/// Builds the library for a microcontroller.
fn library(target: &str, features: &str) -> Result<PathBuf> {
    run(&mut cargo_for(target, &library_command(features))?)?;
    Ok(target_dir()?.join(target).join("c/libarmwire_c.a"))
}

/// The functions in the header.
fn functions() -> Result<Vec<String>> {
    let header = fs::read_to_string(root().join(HEADER))?;
    let mut functions = Vec::new();
    for line in header.lines().filter(|line| !line.starts_with(' ')) {
        let Some((before, _)) = line.split_once('(') else {
            continue;
        };
        let name = before.rsplit([' ', '*']).next().unwrap_or_default();
        if name.starts_with("armwire_") {
            functions.push(name.to_owned());
        }
    }
    ensure!(functions.len() > 80, "{HEADER} has {} functions", functions.len());
    Ok(functions)
}

/// A program that calls these functions only.
struct Linked {
    file: Vec<u8>,
}

impl Linked {
    fn new(dir: &Path, compiler: &str, library: &Path, functions: &[&str]) -> Result<Self> {
        let program = dir.join("linked.elf");
        let mut words = compiler.split(' ');
        let mut link = Command::new(words.next().unwrap_or_default());
        link.args(words).args(["-nostdlib", "-Wl,--gc-sections", "-Wl,-e,0"]);
        link.args(functions.iter().map(|function| format!("-Wl,-u,{function}")));
        run(link.arg(library).arg("-o").arg(&program))?;
        let file = fs::read(program)?;
        Ok(Self { file })
    }

    fn elf(&self) -> Result<ElfFile32<'_, Endianness>> {
        Ok(ElfFile32::parse(&*self.file)?)
    }

    fn contains(&self, symbol: &str) -> Result<bool> {
        Ok(self.elf()?.symbols().any(|found| found.name() == Ok(symbol)))
    }

    /// Bytes of code and tables: the total, and the part that a C library contains, too (memory functions and divisions).
    fn size(&self) -> Result<(u64, u64)> {
        let elf = self.elf()?;
        let is_flash = |name: &str| [".text", ".rodata", ".data", ".ARM.exidx"].contains(&name);
        let sections = elf.sections().filter(|section| section.name().is_ok_and(is_flash));
        let all = sections.map(|section| section.size()).sum();
        let is_common =
            |name: &str| name.contains("compiler_builtins") || name.starts_with("__aeabi") || name.starts_with("mem");
        let mut common: Vec<_> = elf
            .symbols()
            .filter(|symbol| symbol.name().is_ok_and(is_common))
            .collect();
        // One function may have several names.
        common.sort_by_key(|symbol| symbol.address());
        common.dedup_by_key(|symbol| symbol.address());
        Ok((all, common.iter().map(|symbol| symbol.size()).sum()))
    }
}

/// Checks that no function can panic, and that an added panic is detected.
fn check_panics(dir: &Path, target: &str, compiler: &str) -> Result<()> {
    let functions = functions()?;
    let mut names: Vec<_> = functions.iter().map(|name| &**name).collect();
    let good = Linked::new(dir, compiler, &library(target, "")?, &names)?;
    ensure!(!good.contains(PANIC)?, "{target}: the library can panic");
    names.push("armwire_prove_panic");
    let bad = Linked::new(dir, compiler, &library(target, "prove-panic")?, &names)?;
    ensure!(bad.contains(PANIC)?, "{target}: an added panic is not detected");
    println!(
        "{target}: none of {} functions can panic; an added panic is detected",
        functions.len()
    );
    Ok(())
}

/// Prints the size of each protocol in a program, and checks the limit of Ling's client.
fn print_sizes(dir: &Path) -> Result<()> {
    let (target, compiler) = TARGETS[0];
    let (library, functions) = (library(target, "")?, functions()?);
    println!("bytes on a Cortex-M0+, and in addition those that a C library has, too (memcpy, division):");
    for protocol in ["ling", "alpha1", "xarm"] {
        for side in ["client", "device"] {
            let prefix = format!("armwire_{protocol}_{side}_");
            // Alternatives and extras that a program may omit.
            let optional = ["receive", "idle", "cancel", "fault"].map(|name| format!("{prefix}{name}"));
            let names = functions
                .iter()
                .filter(|name| name.starts_with(&prefix) && !optional.contains(name));
            let names: Vec<_> = names.map(|name| &**name).collect();
            let (all, common) = Linked::new(dir, compiler, &library, &names)?.size()?;
            let own = all - common;
            println!(
                "  {protocol:6} {side}, {:2} functions: {own:5} and {common}",
                names.len()
            );
            if (protocol, side) == ("ling", "client") {
                ensure!(own <= LING_LIMIT, "Ling's client has {own} bytes, limit {LING_LIMIT}");
            }
        }
    }
    Ok(())
}

/// Runs the tests without a line on a Cortex-M3 in QEMU, where structures have another layout.
fn test_emulated(dir: &Path) -> Result<()> {
    for test in ["device", "misuse"] {
        let program = dir.join(format!("{test}.elf"));
        let mut compile = Command::new("arm-none-eabi-gcc");
        compile
            .args("-std=c99 -Os -mcpu=cortex-m3 --specs=rdimon.specs -nostartfiles".split(' '))
            .args(WARNINGS.split(' '))
            .args("-Wl,--gc-sections -Wl,-z,noexecstack -Tc/test/semihosting.ld -Ic/include".split(' '))
            .arg(format!("c/test/{test}.c"))
            .args(["c/test/events.c", "c/test/semihosting.c"])
            .arg(library(SMALLEST, "")?)
            .arg("-o")
            .arg(&program)
            .current_dir(root());
        run(&mut compile)?;
        println!("{test} on a Cortex-M3");
        let mut qemu = Command::new("qemu-system-arm");
        qemu.args("-machine mps2-an385 -display none -monitor none -serial null -semihosting -kernel".split(' '));
        run(qemu.arg(program))?;
    }
    Ok(())
}

/// Runs the example for a Cortex-M in QEMU, with a UART to a virtual arm.
fn emulate(dir: &Path, armwire: &Path) -> Result<()> {
    let program = dir.join("cortex-m.elf");
    let mut compile_example = Command::new("arm-none-eabi-gcc");
    compile_example
        .args("-std=c99 -Wall -Wextra -Wconversion -Werror -Os -mcpu=cortex-m3 -ffreestanding -nostdlib".split(' '))
        .args("-ffunction-sections -Wl,--gc-sections -Wl,-z,noexecstack -I../../../c/include -Tlink.ld".split(' '))
        .args(["main.c", "start.c"])
        .arg(library(SMALLEST, "")?)
        .args(["-lgcc", "-o"])
        .arg(&program)
        .current_dir(root().join("examples/c/cortex-m"));
    run(&mut compile_example)?;
    let test = compile(dir, "cortex_m", "", None)?;
    run(Command::new(test).arg(armwire).arg("qemu-system-arm").arg(program))
}

/// Builds and installs the CMake package, and finds it with CMake and pkg-config.
fn package(dir: &Path) -> Result<()> {
    let (build, prefix, found) = (dir.join("build"), dir.join("prefix"), dir.join("found"));
    let cmake = |source: &str, build: &Path, prefix: &Path| {
        let mut configure = Command::new("cmake");
        configure.arg("-S").arg(root().join(source)).arg("-B").arg(build);
        configure.arg(format!("-DCMAKE_INSTALL_PREFIX={}", prefix.display()));
        run(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())))?;
        run(Command::new("cmake").arg("--build").arg(build))
    };
    cmake("c", &build, &prefix)?;
    run(Command::new("cmake").arg("--install").arg(&build))?;
    cmake("examples/c", &found, &prefix)?;

    let mut pkg_config = Command::new("pkg-config");
    pkg_config.args(["--cflags", "--libs", "armwire"]);
    pkg_config.env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"));
    let flags = output(&mut pkg_config)?;
    let mut compile = Command::new("gcc");
    compile
        .arg(root().join("examples/c/serial.c"))
        .args(flags.split_whitespace());
    run(compile.arg("-o").arg(dir.join("serial")))?;
    for program in [found.join("serial"), dir.join("serial")] {
        match output(&mut Command::new(&program)) {
            Err(error) if error.to_string().contains("usage") => {}
            result => bail!("{} ended with {result:?}", program.display()),
        }
    }
    Ok(())
}

/// Writes a library in the layout of Arduino and PlatformIO.
fn write_arduino(folder: &Path) -> Result<()> {
    let (from, source) = (root().join("c/arduino"), folder.join("src"));
    let example = "examples/ReadJoints/ReadJoints.ino";
    fs::create_dir_all(&source)?;
    fs::create_dir_all(folder.join("examples/ReadJoints"))?;
    for file in ["library.properties", "library.json", "platformio.py", example] {
        fs::copy(from.join(file), folder.join(file))?;
    }
    fs::copy(root().join(HEADER), source.join("armwire.h"))?;
    for (target, processors) in ARDUINO_FOLDERS {
        let library = library(target, "")?;
        for processor in processors {
            let to = source.join(processor);
            fs::create_dir_all(&to)?;
            fs::copy(&library, to.join("libarmwire_c.a"))?;
        }
    }
    println!("{}", folder.display());
    Ok(())
}

/// Compiles and links the example in the Arduino library, with stubs of Arduino's own functions.
fn check_arduino(dir: &Path) -> Result<()> {
    let library = dir.join("arduino");
    write_arduino(&library)?;
    let mut compile = Command::new("arm-none-eabi-g++");
    compile
        .args(
            "-std=gnu++17 -mcpu=cortex-m0plus -Wall -Wextra -Werror -Os -ffreestanding -fno-exceptions -x c++"
                .split(' '),
        )
        .arg("-I")
        .arg(library.join("src"))
        .args(["-include", "c/arduino/stub/Arduino.h"])
        .arg(library.join("examples/ReadJoints/ReadJoints.ino"))
        .args(["-x", "none"])
        .arg(library.join("src/cortex-m0plus/libarmwire_c.a"))
        .args("-r -nostdlib -Wl,-z,noexecstack -o".split(' '))
        .arg(dir.join("arduino.o"));
    run(compile.current_dir(root()))
}

/// Builds the library for a Cortex-M by CMake with the Zephyr module. Two functions replace Zephyr itself.
fn check_zephyr(dir: &Path) -> Result<()> {
    let (source, build) = (dir.join("zephyr"), dir.join("zephyr-build"));
    fs::create_dir_all(&source)?;
    let project = format!(
        "cmake_minimum_required(VERSION 3.20)\n\
         project(application LANGUAGES C)\n\
         function(zephyr_include_directories)\n  include_directories(${{ARGN}})\nendfunction()\n\
         function(zephyr_link_libraries)\n  link_libraries(${{ARGN}})\nendfunction()\n\
         set(CONFIG_ARMWIRE y)\nset(CONFIG_CPU_CORTEX_M y)\nset(CONFIG_ARMWIRE_PROTOCOLS ling)\n\
         add_subdirectory({} armwire)\n",
        root().join("c/zephyr").display()
    );
    fs::write(source.join("CMakeLists.txt"), project)?;
    run(Command::new("cmake").arg("-S").arg(&source).arg("-B").arg(&build))?;
    run(Command::new("cmake").arg("--build").arg(&build))?;
    let library = build.join("armwire/cargo").join(SMALLEST).join("c/libarmwire_c.a");
    ensure!(library.exists(), "the build made no {}", library.display());
    Ok(())
}
