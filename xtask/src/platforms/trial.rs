//! The trial of the command: virtual arms, and clients of them, from the same build.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use super::emulator::Emulator;
use crate::cargo::target_dir;
use crate::process::{output, shown};
use crate::vendor::background::Background;
use crate::workspace::root;

const VERSION: &str = concat!("armwire ", env!("CARGO_PKG_VERSION"));
/// Recordings that each system decodes with the same output.
const RECORDINGS: &str = "cli/tests/logs";

/// Uses the command of another system.
///
/// # Errors
///
/// The first step with another result than here.
pub(crate) fn run_all(program: &Path, emulator: &Emulator, folder: &Path) -> Result<()> {
    let trial = Trial { program, emulator };
    trial.says("--version", VERSION)?;
    trial.decode_as_here()?;
    trial.use_xarm()?;
    if program.extension().is_some() {
        let error = trial.command("sim ling").output()?;
        let text = String::from_utf8_lossy(&error.stderr);
        ensure!(
            text.contains("no pseudo-terminals") && !error.status.success(),
            "{text}"
        );
        return Ok(());
    }
    trial.move_ling(&folder.join("arm"))?;
    trial.use_alpha1(&folder.join("robot"))
}

/// A command of another system.
struct Trial<'a> {
    program: &'a Path,
    emulator: &'a Emulator,
}

impl Trial<'_> {
    fn command(&self, words: &str) -> Command {
        let mut command = self.emulator.command(self.program);
        command.args(words.split(' '));
        command
    }

    /// Checks that the command succeeds, and that its output contains this.
    fn says(&self, words: &str, expected: &str) -> Result<()> {
        let mut command = self.command(words);
        let text = output(&mut command)?;
        println!("{}", shown(&command));
        ensure!(text.contains(expected), "`{words}` printed no '{expected}':\n{text}");
        Ok(())
    }

    /// Starts a virtual arm. Returns the first line of its output, too.
    fn start(&self, words: &str) -> Result<(Background, String)> {
        Background::start_with_line(&mut self.command(words))
    }

    /// Decodes every recording as the command for this machine does.
    fn decode_as_here(&self) -> Result<()> {
        let here = target_dir()?.join("debug/armwire");
        let mut files = fs::read_dir(root().join(RECORDINGS))?.peekable();
        ensure!(files.peek().is_some(), "{RECORDINGS} is empty");
        for file in files {
            let file = format!("{RECORDINGS}/{}", file?.file_name().display());
            let mut native = Command::new(&here);
            native.args(["decode", &file]).current_dir(root());
            let (expected, got) = (native.output()?, self.command(&format!("decode {file}")).output()?);
            let is_same = (expected.status.code(), expected.stdout) == (got.status.code(), got.stdout);
            ensure!(is_same, "{} decodes {file} otherwise", self.program.display());
        }
        Ok(())
    }

    /// Asks a virtual xArm by TCP.
    fn use_xarm(&self) -> Result<()> {
        let (_arm, line) = self.start("sim xarm --listen 127.0.0.1:0 --no-report")?;
        let address = line.split_whitespace().find(|word| word.starts_with("127.0.0.1:"));
        let address = address.with_context(|| format!("no address in {line}"))?;
        let address = address.trim_end_matches(',');
        self.says(&format!("info --arm xarm {address}"), "xArm, 6 axes")
    }

    /// Moves, records and stops a virtual Ling arm.
    fn move_ling(&self, port: &Path) -> Result<()> {
        let recording = port.with_extension("mcap");
        if recording.exists() {
            fs::remove_file(&recording)?;
        }
        let (port, recording) = (port.display(), recording.display());
        let (_arm, _) = self.start(&format!("sim ling --pty {port}"))?;
        for (words, expected) in [
            (format!("info {port}"), "Ling follower"),
            (
                format!("move {port} --joints 0,10,-20,0,0,45 --speed 30 --gripper 50 --wait"),
                "",
            ),
            (format!("monitor {port} --csv --count 3"), "joint_6_deg"),
            (format!("monitor {port} --mcap {recording} --count 20 --rate 50"), ""),
            (format!("decode {recording}"), "read joints"),
            (format!("stop {port}"), "stopped"),
            (format!("call ling {port} read-temperatures"), "°C"),
            (format!("torque {port} off --yes"), ""),
        ] {
            self.says(&words, expected)?;
        }
        Ok(())
    }

    /// Asks a virtual Alpha1.
    fn use_alpha1(&self, port: &Path) -> Result<()> {
        let port = port.display();
        let (_robot, _) = self.start(&format!("sim alpha1 --pty {port}"))?;
        self.says(&format!("info --arm alpha1 {port}"), "Alpha1")
    }
}
