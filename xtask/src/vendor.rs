//! `cargo xtask vendor`: the arm vendor's Python SDK drives a virtual arm through the firmware image.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus};
use std::thread;
use std::time::{Duration, Instant};

use crate::Result;
use crate::demo;
use crate::image::{self, Options};
use crate::process::{run as run_command, shown};
use crate::workspace;

/// How long the virtual board may take until its serial port is there.
const BOOT: Duration = Duration::from_secs(30);
/// How long the SDK may take for all it does: several times what it takes on a slow machine.
const DRIVE: Duration = Duration::from_secs(180);
/// How long the virtual board may take to end when asked to.
const END: Duration = Duration::from_secs(10);

/// Installs the SDK, starts the virtual board and lets `host-tests/vendor/drive.py` do its work.
///
/// # Errors
///
/// If anything on the way fails, the SDK reads anything but what it must, or something takes too long.
pub(crate) fn run() -> Result {
    let dir = workspace::target_dir()?.join("vendor");
    fs::create_dir_all(&dir)?;
    let scripts = workspace::root().join("host-tests/vendor");
    let python = install_sdk(&dir, &scripts)?;

    let image = image::build(&Options::default())?;
    println!("building the virtual board, about 3 minutes the first time");
    run_command(&mut demo::command("build"))?;

    let port = dir.join("arm");
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

    // The SDK writes its log to the folder it runs in; Python is to write nothing beside the script.
    let mut drive = Command::new(python);
    drive
        .arg("-B")
        .arg(scripts.join("drive.py"))
        .arg(&port)
        .current_dir(&dir);
    let mut sdk = Process::start(&mut drive)?;
    let driven = sdk.succeed_within(DRIVE);
    board.interrupt()?;
    driven.and(board.succeed_within(END))
}

/// Makes a Python environment with the SDK and what its serial layer needs, and returns its interpreter.
fn install_sdk(dir: &Path, scripts: &Path) -> Result<PathBuf> {
    let environment = dir.join("python");
    let python = environment.join("bin/python");
    if !python.exists() {
        println!("making a Python environment in {}", environment.display());
        run_command(Command::new("python3").args(["-m", "venv"]).arg(&environment))?;
    }
    println!("installing the vendor's SDK");
    // Without its dependencies, which include all of PyTorch.
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
    Ok(python)
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
