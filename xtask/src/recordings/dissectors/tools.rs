//! `armwire decode`, tshark and sigrok-cli.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use super::lines::{Line, SERVO_BUS};
use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::files::empty_folder;
use crate::process::{output, run};
use crate::workspace::root;

/// The tools and their packages.
const TOOLS: [(&str, &str); 2] = [("tshark", "tshark"), ("sigrok-cli", "sigrok-cli")];
const DISSECTOR: &str = "tools/wireshark/armwire.lua";
const DECODERS: &str = "tools/sigrok";
/// Samples of a bit on a line, at 1 Mbaud and 8 MHz.
const BIT: usize = 8;

/// A frame of a recording, or bytes between frames, and its text.
pub(super) type Item = (Vec<u8>, String);

/// The tools, and the folder of their files.
pub(super) struct Tools {
    armwire: PathBuf,
    dir: PathBuf,
}

impl Tools {
    /// Installs missing tools, and builds the command.
    pub(super) fn find() -> Result<Self> {
        apt::require(&TOOLS)?;
        run(&mut cargo("build --quiet --package armwire-cli"))?;
        let dir = target_dir()?.join("recordings/dissectors");
        empty_folder(&dir)?;
        let armwire = target_dir()?.join("debug/armwire");
        Ok(Self { armwire, dir })
    }

    /// The items of a recording, by `armwire decode`.
    pub(super) fn decode(&self, line: &Line, recording: &[u8]) -> Result<Vec<Item>> {
        let text = output(&mut self.decode_command(line, recording)?)?;
        let lines: Vec<_> = text
            .lines()
            .filter(|line| line.starts_with(' '))
            .map(str::trim)
            .collect();
        let mut items = Vec::new();
        for pair in lines.chunks_exact(2) {
            let (_, hex) = pair[0].split_once("  ").context("an item has an offset and bytes")?;
            let bytes = hex.split(' ').map(|byte| u8::from_str_radix(byte, 16));
            items.push((bytes.collect::<Result<_, _>>()?, pair[1].to_owned()));
        }
        Ok(items)
    }

    fn decode_command(&self, line: &Line, recording: &[u8]) -> Result<Command> {
        let file = self.dir.join("recording");
        fs::write(&file, recording)?;
        let mut decode = Command::new(&self.armwire);
        decode.args(["decode", "--format", "raw", "--arm", line.arm]).arg(file);
        // Ling's frames identify their sender, and the servo bus has both.
        if !["ling", SERVO_BUS.arm].contains(&line.arm) {
            decode.args(["--from", line.from]);
        }
        Ok(decode)
    }

    /// The items of a recording, by Wireshark from the command's packets.
    pub(super) fn dissect(&self, line: &Line, recording: &[u8]) -> Result<Vec<String>> {
        let file = self.dir.join("recording.pcapng");
        let _ = fs::remove_file(&file);
        output(self.decode_command(line, recording)?.arg("--pcapng").arg(&file))?;
        self.tshark(&file, line.protocol())
    }

    /// A capture file of these packets.
    pub(super) fn capture(&self, name: &str, options: &str, packets: &[Vec<u8>]) -> Result<PathBuf> {
        let (dump, file) = (self.dir.join(name), self.dir.join(format!("{name}.pcapng")));
        let mut text = String::new();
        for packet in packets {
            text += "000000";
            for byte in packet {
                write!(text, " {byte:02x}")?;
            }
            text += "\n";
        }
        fs::write(&dump, text)?;
        let mut make = Command::new("text2pcap");
        output(make.arg("-q").args(options.split(' ')).args([dump, file.clone()]))?;
        Ok(file)
    }

    /// Messages and damage in a capture file.
    pub(super) fn tshark(&self, file: &Path, arm: &str) -> Result<Vec<String>> {
        let mut tshark = self.tshark_command(file);
        tshark.args(["-T", "fields", "-E", "aggregator=|", "-E", "separator=|"]);
        for field in ["message", "damage"] {
            tshark.args(["-e", &format!("{arm}.{field}")]);
        }
        let text = output(&mut tshark)?;
        let texts = text
            .lines()
            .flat_map(|line| line.split('|'))
            .filter(|text| !text.is_empty());
        Ok(texts.map(str::to_owned).collect())
    }

    /// Errors of the script on a capture file.
    pub(super) fn script_errors(&self, file: &Path) -> Result<String> {
        output(self.tshark_command(file).args(["-Y", "_ws.lua.error"]))
    }

    fn tshark_command(&self, file: &Path) -> Command {
        let mut tshark = Command::new("tshark");
        let script = root().join(DISSECTOR);
        tshark
            .args(["-X", &format!("lua_script:{}", script.display()), "-r"])
            .arg(file);
        // The dissector may be installed for the user, too.
        tshark.env("WIRESHARK_CONFIG_DIR", &self.dir);
        tshark
    }

    /// Frames and damage on two lines, by sigrok.
    pub(super) fn annotate(&self, arm: &str, events: &[(&str, Vec<u8>)]) -> Result<Vec<String>> {
        let file = self.dir.join("samples");
        fs::write(&file, samples(events))?;
        let mut sigrok = Command::new("sigrok-cli");
        sigrok
            .args(["-I", "binary:numchannels=2:samplerate=8000000", "-i"])
            .arg(file);
        sigrok.args(["-P", &format!("uart:tx=0:rx=1:baudrate=1000000,armwire:arm={arm}")]);
        sigrok.args(["-A", "armwire=rx-frame:tx-frame:rx-warning:tx-warning"]);
        sigrok
            .env("SIGROKDECODE_DIR", root().join(DECODERS))
            .env("PYTHONDONTWRITEBYTECODE", "1");
        let text = output(&mut sigrok)?;
        let texts = text
            .lines()
            .map(|line| line.split_once(": ").map_or(line, |(_, text)| text));
        Ok(texts.map(str::to_owned).collect())
    }
}

/// Samples of a logic analyser: bit 0 is the line from the host, bit 1 the line from the arm.
fn samples(events: &[(&str, Vec<u8>)]) -> Vec<u8> {
    const IDLE: u8 = 0b11;
    let mut samples = vec![IDLE; 100 * BIT];
    for (from, bytes) in events {
        let line = if *from == "host" { 0b01 } else { 0b10 };
        for byte in bytes {
            // A start bit, the data, lowest bit first, and a stop bit.
            let bits = u16::from(*byte) << 1 | 1 << 9;
            for bit in 0..10 {
                let level = if bits >> bit & 1 == 1 { IDLE } else { IDLE & !line };
                samples.extend([level; BIT]);
            }
        }
        samples.extend([IDLE; 20 * BIT]);
    }
    samples
}
