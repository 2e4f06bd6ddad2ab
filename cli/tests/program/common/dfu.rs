//! Updates of an adapter: a firmware image, and a `dfu-util` that writes nothing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use armwire_sim::pty::Pty;
use crc::{CRC_32_JAMCRC, Crc};

use super::{PROGRAM, TIMEOUT, finish, free_path, install, retry_while_busy, start};

/// A firmware for a board of this name, as a DfuSe file.
pub(crate) fn image(board: &str) -> Vec<u8> {
    let mut program = vec![0; 256];
    program[..8].copy_from_slice(&[0, 0, 2, 0x20, 0xA1, 1, 0, 8]);
    let mut elements = 0x0800_0000_u32.to_le_bytes().to_vec();
    elements.extend(256_u32.to_le_bytes());
    elements.extend(program);
    let mut name = board.as_bytes().to_vec();
    name.resize(255, 0);
    let mut file = b"DfuSe\x01".to_vec();
    file.extend((285 + elements.len() as u32).to_le_bytes());
    file.extend(b"\x01Target\x00\x01\0\0\0");
    file.extend(name);
    file.extend((elements.len() as u32).to_le_bytes());
    file.extend(1_u32.to_le_bytes());
    file.extend(elements);
    file.extend(b"\xFF\xFF\x11\xDF\x83\x04\x1A\x01UFD\x10");
    file.extend(Crc::<u32>::new(&CRC_32_JAMCRC).checksum(&file).to_le_bytes());
    file
}

/// The arguments of `dfu-util` that list boot loaders, and that start the firmware.
pub(crate) const LIST: &str = "--list";
pub(crate) const LEAVE: &str = "-d ,0483:df11 -a 0 -s 0x08000000:leave";

/// A folder with a `dfu-util` that finds a boot loader while the file `boot_loader` exists, and logs its arguments.
pub(crate) fn tools(name: &str, boot_loader: &Path, exit: i32) -> PathBuf {
    tools_with(name, "", boot_loader, exit)
}

/// The same, with commands in front.
fn tools_with(name: &str, commands: &str, boot_loader: &Path, exit: i32) -> PathBuf {
    let folder = free_path(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir(&folder).unwrap();
    let (boot_loader, log) = (boot_loader.display(), folder.join("log"));
    let script = format!(
        "#!/bin/sh\n\
         {commands}\
         case \"$*\" in\n\
         --list) [ ! -e {boot_loader} ] || echo 'Found DFU: [0483:df11] ver=2200' ;;\n\
         *:leave) echo \"$*\" >> {log}; rm {boot_loader}; exit 74 ;;\n\
         *) echo \"$*\" >> {log}; printf 'Download  50%%\\rDownload 100%%\\n'\n\
         [ {exit} = 0 ] || echo 'dfu-util: Lost device after RESET?' >&2\n\
         exit {exit} ;;\n\
         esac\n",
        log = log.display()
    );
    let source = folder.join("script");
    fs::write(&source, script).unwrap();
    install(&source, &folder.join("dfu-util"));
    folder
}

/// A `dfu-util` like that of [`tools`], each call of which waits until the test releases it.
pub(crate) struct WaitingDfuUtil {
    /// Carries the arguments to the test, and a line to the script. It hangs up with this value, which ends the script.
    pty: Pty,
    pub(crate) folder: PathBuf,
}

impl WaitingDfuUtil {
    pub(crate) fn new(name: &str, boot_loader: &Path, exit: i32) -> Self {
        let pty = Pty::open(None).unwrap();
        let commands = format!(
            "exec 3<>{}\ntrap 'echo SIGPIPE >&3; exit 1' PIPE\necho \"$*\" >&3\nread -r line <&3 || exit 1\n",
            pty.path().display()
        );
        let folder = tools_with(name, &commands, boot_loader, exit);
        Self { pty, folder }
    }

    /// Waits for a call. Returns its arguments.
    pub(crate) fn call(&self) -> String {
        let mut line = Vec::new();
        while line.last() != Some(&b'\n') {
            assert!(self.pty.wait(Some(TIMEOUT)).unwrap(), "no call of dfu-util");
            let mut byte = [0];
            let n = self.pty.read(&mut byte).unwrap();
            line.extend(&byte[..n]);
        }
        line.pop();
        String::from_utf8(line).unwrap()
    }

    /// Lets the call go on.
    pub(crate) fn release(&self) {
        assert_eq!(self.pty.write(b"\n").unwrap(), 1);
    }
}

impl Drop for WaitingDfuUtil {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Updates the adapter on the port with this image, with the `dfu-util` of the folder.
pub(crate) fn update(port: &str, image: &Path, folder: &Path) -> Output {
    retry_while_busy(|| finish(start(&mut update_command(port, image, folder))))
}

/// The command of [`update`].
pub(crate) fn update_command(port: &str, image: &Path, folder: &Path) -> Command {
    let mut update = Command::new(PROGRAM);
    update.args(["update", port]).arg(image).current_dir(folder);
    update.env("PATH", format!("{}:/bin:/usr/bin", folder.display()));
    update
}
