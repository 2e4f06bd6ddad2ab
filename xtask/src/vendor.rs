//! `cargo xtask vendor`: the arm vendors' Python SDKs drive virtual arms: a Ling arm through the firmware image, an
//! xArm on TCP ports.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus};
use std::thread;
use std::time::{Duration, Instant};

use crate::Result;
use crate::demo;
use crate::image::{self, Options};
use crate::process::{cargo, run as run_command, shown};
use crate::workspace;

/// How long the virtual board may take until its serial port is there.
const BOOT: Duration = Duration::from_secs(30);
/// How long an SDK may take for all it does: several times what it takes on a slow machine.
const DRIVE: Duration = Duration::from_secs(300);
/// How long the virtual board may take to end when asked to.
const END: Duration = Duration::from_secs(10);

/// Installs the SDKs and lets the scripts in `host-tests/vendor` do their work.
///
/// # Errors
///
/// If anything on the way fails, an SDK reads anything but what it must, or something takes too long.
pub(crate) fn run() -> Result {
    let dir = workspace::target_dir()?.join("vendor");
    fs::create_dir_all(&dir)?;
    let sdk = Sdk::install(dir)?;
    xarm(&sdk)?;
    ling(&sdk)
}

/// The SDK of the xArm, on virtual arms that the script starts by itself.
fn xarm(sdk: &Sdk) -> Result {
    run_command(cargo().args(["build", "--package", "armwire-cli"]))?;
    let armwire = workspace::target_dir()?.join("debug/armwire");
    Process::start(sdk.script("xarm_drive.py").arg(armwire))?.succeed_within(DRIVE)
}

/// The SDK of the Ling arm, on a virtual arm behind the virtual board.
fn ling(sdk: &Sdk) -> Result {
    let image = image::build(&Options::default())?;
    println!("building the virtual board, about 3 minutes the first time");
    run_command(&mut demo::command("build"))?;

    let port = sdk.dir.join("arm");
    // A link left behind by a board that was killed may lead to somebody's terminal by now.
    let _ = fs::remove_file(&port);
    let mut serve = demo::command("run");
    serve
        .args(["--quiet", "--", "--image"])
        .arg(image.path)
        .arg("--serve")
        .arg(&port);
    let mut board = Process::start(&mut serve)?;
    board.wait_for_file(&port)?;

    let mut drive = Process::start(sdk.script("drive.py").arg(&port))?;
    let driven = drive.succeed_within(DRIVE);
    board.interrupt()?;
    driven.and(board.succeed_within(END))
}

/// The SDKs in a Python environment of their own.
struct Sdk {
    /// Where they leave what they leave.
    dir: PathBuf,
    python: PathBuf,
    scripts: PathBuf,
}

impl Sdk {
    /// Makes a Python environment with the SDKs and what they need for what is done here.
    fn install(dir: PathBuf) -> Result<Self> {
        let environment = dir.join("python");
        let python = environment.join("bin/python");
        let scripts = workspace::root().join("host-tests/vendor");
        if !python.exists() {
            println!("making a Python environment in {}", environment.display());
            run_command(Command::new("python3").args(["-m", "venv"]).arg(&environment))?;
        }
        println!("installing the vendors' SDKs");
        // Without their dependencies, which include all of PyTorch.
        let mut pip = Command::new(&python);
        pip.args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
            "--requirement",
        ]);
        run_command(pip.arg(scripts.join("requirements.txt")))?;
        Ok(Self { dir, python, scripts })
    }

    /// A script, ready to run. The SDKs write logs to the folder they run in and to the home folder, and Python is to
    /// write nothing beside the script.
    fn script(&self, name: &str) -> Command {
        let mut script = Command::new(&self.python);
        script.arg("-B").arg(self.scripts.join(name));
        script.current_dir(&self.dir).env("HOME", &self.dir);
        script
    }
}

/// A process that does not outlive us.
struct Process {
    child: Child,
    name: String,
}

impl Process {
    fn start(command: &mut Command) -> Result<Self> {
        let name = shown(command);
        let child = command
            .spawn()
            .map_err(|error| format!("cannot run `{name}`: {error}"))?;
        Ok(Self { child, name })
    }

    /// Waits until it has made a file.
    fn wait_for_file(&mut self, file: &Path) -> Result {
        let status = self.wait(BOOT, || file.exists())?;
        match status {
            Some(status) => Err(format!("`{}` ended early: {status}", self.name).into()),
            None if file.exists() => Ok(()),
            None => Err(format!("`{}` made no {} within {BOOT:?}", self.name, file.display()).into()),
        }
    }

    /// Waits until it ends, successfully.
    fn succeed_within(&mut self, patience: Duration) -> Result {
        match self.wait(patience, || false)? {
            Some(status) if status.success() => Ok(()),
            Some(status) => Err(format!("`{}` failed: {status}", self.name).into()),
            None => Err(format!("`{}` did not end within {patience:?}", self.name).into()),
        }
    }

    /// Waits until it ends, `or` something else happens, or patience does.
    fn wait(&mut self, patience: Duration, or: impl Fn() -> bool) -> Result<Option<ExitStatus>> {
        let start = Instant::now();
        while start.elapsed() < patience && !or() {
            if let Some(status) = self.child.try_wait()? {
                return Ok(Some(status));
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(None)
    }

    /// Asks it to end, as Ctrl-C does.
    fn interrupt(&self) -> Result {
        run_command(Command::new("kill").args(["-INT", &self.child.id().to_string()]))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Both fail when it has ended, as it should have.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
