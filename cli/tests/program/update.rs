//! The built program updating an adapter's firmware, with a `dfu-util` that writes nothing.

use std::fs::{self, File, Permissions};
use std::io::{self, BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStderr, Command};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

use crate::common::adapter::CanBus;
use crate::common::board::Board;
use crate::common::dfu::{LEAVE, LIST, WaitingDfuUtil, image, tools, update, update_command};
use crate::common::terminal::Terminal;
use crate::common::uf2::{self, Folders, RP2040};
use crate::common::{PROGRAM, failure, finish, free_path, run, start};

/// The adapter in the output.
const ADAPTER: &str = "virtual, serial number 0123456789AB, firmware 1.2.3";

#[test]
fn update_runs_through_the_boot_loader() {
    let bus = CanBus::start();
    let folder = tools("update", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let output = update(&bus.port(), &file, &folder);
    assert!(output.status.success(), "{output:?}");
    let file = file.display();
    let log = fs::read_to_string(folder.join("log")).unwrap();
    assert_eq!(
        log,
        format!("-d ,0483:df11 -a 0 -D {file}\n-d ,0483:df11 -a 0 -s 0x08000000:leave\n")
    );
    assert_eq!(output.stderr, b"");
    let name = bus.port();
    let (write, leave) = (
        format!("dfu-util -d ,0483:df11 -a 0 -D {file}"),
        "dfu-util -d ,0483:df11 -a 0 -s 0x08000000:leave",
    );
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        format!(
            "{name}: {ADAPTER}\n\
             {name}: restarts into its boot loader, to take 256 bytes; if interrupted, run '{write}' and then '{leave}'\n\
             {write}\n{leave}\n{name}: {ADAPTER}\n"
        )
    );
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn update_is_finished_without_a_reader() {
    let bus = CanBus::start();
    let folder = tools("unread", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    let mut update = update_command(&bus.port(), &file, &folder);
    assert!(update.stdout(writer).status().unwrap().success());
    let log = fs::read_to_string(folder.join("log")).unwrap();
    assert_eq!(log.lines().count(), 2, "{log}");
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn unfit_image_restarts_nothing() {
    let bus = CanBus::start();
    let folder = tools("bad-image", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    let mut damaged = image("virtual");
    damaged[400] ^= 1;
    for (image, message) in [
        (
            &b"\x7FELF"[..],
            "not a DfuSe or UF2 file: is it the .dfu or .uf2 of the firmware",
        ),
        (&damaged, "the file is damaged: its checksum is"),
        (
            &image("stm32g431"),
            "the image is for the board stm32g431, the adapter is a virtual",
        ),
        (
            &image("\x1B[2J"),
            r"the image is for the board \u{1b}[2J, the adapter is a virtual",
        ),
    ] {
        fs::write(&file, image).unwrap();
        let line = failure(&update(&bus.port(), &file, &folder));
        assert!(line.contains(message), "{line}");
        assert!(!bus.boot_loader.exists());
    }
    let line = failure(&run(&["update", &bus.port(), "/no/such.dfu"]));
    assert!(line.starts_with("/no/such.dfu: "), "{line}");
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn only_the_image_of_the_named_board_is_written() {
    // A named board, the board without a name with the same chip, and one that this command does not know.
    for adapter in ["pyboard", "stm32f405", "unknown-1"] {
        let bus = CanBus::start_board(adapter);
        let folder = tools("names", &bus.boot_loader, 0);
        let file = folder.join("new.dfu");
        for board in [
            "pyboard",
            // The same chip, and no name.
            "stm32f405",
            "feather-f405",
            // Another chip, and no name.
            "stm32g431",
            "weact-g431",
            "pico",
            "unknown-2",
            "stm32f4",
            "",
        ] {
            fs::write(&file, image(board)).unwrap();
            let output = update(&bus.port(), &file, &folder);
            if board == adapter {
                assert!(output.status.success(), "{output:?}");
                fs::remove_file(folder.join("log")).unwrap();
            } else {
                let refusal = format!("the image is for the board {board}, the adapter is a {adapter}");
                assert_eq!(failure(&output), format!("{}: {refusal}", bus.port()));
                assert!(!bus.boot_loader.exists() && !folder.join("log").exists());
            }
        }
        fs::remove_dir_all(folder).unwrap();
    }
}

#[test]
fn huge_file_is_refused_by_its_head() {
    // More than any memory holds.
    const SIZE: u64 = 1 << 40;
    let path = free_path("huge");
    for (len, message) in [
        (0, "not a DfuSe or UF2 file"),
        (
            u32::MAX,
            "the image has 4294967295 bytes, more than the 2101248 of the largest",
        ),
        (1000, "the file is truncated or damaged: its lengths are inconsistent"),
    ] {
        let mut head = image("virtual");
        head[6..10].copy_from_slice(&len.to_le_bytes());
        if len == 0 {
            head[0] = 0;
        }
        fs::write(&path, head).unwrap();
        File::options().write(true).open(&path).unwrap().set_len(SIZE).unwrap();
        let line = failure(&run(&["update", "/dev/no-such-port", path.to_str().unwrap()]));
        assert!(line.contains(message), "{line}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn virtual_board_is_not_restarted() {
    let board = Board::start("virtual-board");
    let folder = tools("virtual-board", &board.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let line = failure(&update(&board.control, &file, &folder));
    assert_eq!(
        line,
        format!(
            "{}: a virtual board has no boot loader: start it again, with the new image",
            board.control
        )
    );
    assert!(!board.boot_loader.exists());
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn board_in_its_boot_loader_is_not_overwritten() {
    let bus = CanBus::start();
    let folder = tools("already", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    fs::write(&bus.boot_loader, "").unwrap();
    let line = failure(&update(&bus.port(), &file, &folder));
    assert!(
        line.starts_with("dfu-util: a board is already in the boot loader: unplug it. If"),
        "{line}"
    );
    assert!(!folder.join("log").exists());
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn dfu_util_failure_is_reported_with_next_steps() {
    let bus = CanBus::start();
    let folder = tools("fails", &bus.boot_loader, 74);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let line = failure(&update(&bus.port(), &file, &folder));
    assert!(
        line.starts_with(
            "dfu-util: failed (exit status: 74): dfu-util: Lost device after RESET?; try again, the boot loader cannot be \
             overwritten: run 'dfu-util "
        ),
        "{line}"
    );
    assert!(line.contains("-s 0x08000000:leave'"), "{line}");
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn progress_of_dfu_util_is_shown_on_a_terminal() {
    let bus = CanBus::start();
    let folder = tools("terminal", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let mut terminal = Terminal::new(80, 24);
    let child = terminal.start_command(&mut update_command(&bus.port(), &file, &folder));
    let output = terminal.finish(child);
    assert!(output.status.success(), "{}", terminal.seen);
    assert!(
        terminal.seen.contains("Download  50%\rDownload 100%"),
        "{}",
        terminal.seen
    );
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn progress_of_dfu_util_is_shown_on_demand() {
    let bus = CanBus::start();
    let folder = tools("progress", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let mut update = update_command(&bus.port(), &file, &folder);
    let output = finish(start(update.arg("--progress")));
    assert!(output.status.success(), "{output:?}");
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("Download  50%\rDownload 100%\n"), "{errors}");
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn missing_dfu_util_restarts_nothing() {
    let bus = CanBus::start();
    let folder = tools("without", &bus.boot_loader, 0);
    let file = folder.join("new.dfu");
    fs::write(&file, image("virtual")).unwrap();
    let update = || {
        let mut command = Command::new(PROGRAM);
        command.args(["update", &bus.port()]).arg(&file).env("PATH", &folder);
        let output = finish(start(&mut command));
        assert_eq!(output.stdout, b"");
        assert!(!bus.boot_loader.exists());
        failure(&output)
    };
    fs::set_permissions(folder.join("dfu-util"), Permissions::from_mode(0o644)).unwrap();
    let line = update();
    assert!(line.starts_with("dfu-util: cannot be run: "), "{line}");
    fs::remove_file(folder.join("dfu-util")).unwrap();
    let line = update();
    assert!(
        line.starts_with("dfu-util: not installed: 'sudo apt install dfu-util' or the like installs it"),
        "{line}"
    );
    assert!(line.ends_with("; nothing was restarted"), "{line}");
    fs::remove_dir_all(folder).unwrap();
}

/// An update of an adapter, with a process group of its own like that of a shell's job.
struct Job {
    bus: CanBus,
    dfu_util: WaitingDfuUtil,
    child: Child,
    errors: BufReader<ChildStderr>,
}

impl Job {
    /// Starts an update, whose `dfu-util` ends a write with this status.
    fn start(name: &str, exit: i32) -> Self {
        let bus = CanBus::start();
        let dfu_util = WaitingDfuUtil::new(name, &bus.boot_loader, exit);
        let file = dfu_util.folder.join("new.dfu");
        fs::write(&file, image("virtual")).unwrap();
        let mut command = update_command(&bus.port(), &file, &dfu_util.folder);
        let mut child = start(command.process_group(0));
        let errors = BufReader::new(child.stderr.take().unwrap());
        Self {
            bus,
            dfu_util,
            child,
            errors,
        }
    }

    /// Sends a signal as a terminal does: to the whole job.
    fn signal(&self, signal: Signal) {
        kill_process_group(Pid::from_child(&self.child), signal).unwrap();
    }

    /// The next line on standard error.
    fn error(&mut self) -> String {
        let mut line = String::new();
        self.errors.read_line(&mut line).unwrap();
        line
    }

    /// Waits for the end. Returns true for a success, and the rest of standard error.
    fn finish(mut self) -> (bool, String) {
        let mut rest = String::new();
        self.errors.read_to_string(&mut rest).unwrap();
        (finish(self.child).status.success(), rest)
    }
}

const SIGNALS: [Signal; 3] = [Signal::INT, Signal::TERM, Signal::HUP];

#[test]
fn signal_before_the_restart_ends_the_update() {
    for signal in SIGNALS {
        let mut job = Job::start("early-signal", 0);
        assert_eq!(job.dfu_util.call(), LIST);
        job.signal(signal);
        assert_eq!(job.error(), "armwire: interrupted: nothing is restarted\n");
        job.dfu_util.release();
        let boot_loader = job.bus.boot_loader.clone();
        assert_eq!(job.finish(), (false, "armwire: cancelled\n".to_owned()));
        assert!(!boot_loader.exists());
    }
}

#[test]
fn signal_after_the_restart_ends_no_update() {
    for signal in SIGNALS {
        for phase in 1..4 {
            let mut job = Job::start("signal", 0);
            let port = job.bus.port();
            for call in 0..4 {
                let args = job.dfu_util.call();
                match call {
                    0 | 1 => assert_eq!(args, LIST),
                    2 => assert!(args.ends_with("new.dfu"), "{args}"),
                    _ => assert_eq!(args, LEAVE),
                }
                if call == phase {
                    job.signal(signal);
                    let line = job.error();
                    assert_eq!(
                        line,
                        format!(
                            "armwire: {port}: the update goes on: without it the adapter stays in its boot loader\n"
                        )
                    );
                }
                job.dfu_util.release();
            }
            assert_eq!(job.finish(), (true, String::new()));
        }
    }
}

#[test]
fn failed_write_is_reported_despite_a_signal() {
    let mut job = Job::start("signal-fails", 74);
    for _ in 0..2 {
        assert_eq!(job.dfu_util.call(), LIST);
        job.dfu_util.release();
    }
    job.dfu_util.call();
    job.signal(Signal::HUP);
    assert!(job.error().contains("the update goes on"));
    job.dfu_util.release();
    let (success, errors) = job.finish();
    assert!(!success);
    assert!(
        errors.contains("failed (exit status: 74)") && errors.contains(LEAVE),
        "{errors}"
    );
}

#[test]
fn killed_update_ends_dfu_util() {
    let mut job = Job::start("killed", 0);
    for _ in 0..2 {
        assert_eq!(job.dfu_util.call(), LIST);
        job.dfu_util.release();
    }
    job.dfu_util.call();
    let mut out = BufReader::new(job.child.stdout.take().unwrap());
    let restarts = out.by_ref().lines().nth(1).unwrap().unwrap();
    assert!(restarts.contains("; if interrupted, run 'dfu-util "), "{restarts}");
    kill_process(Pid::from_child(&job.child), Signal::KILL).unwrap();
    job.child.wait().unwrap();
    job.dfu_util.release();
    assert_eq!(job.dfu_util.call(), "SIGPIPE");
}

/// A Pico in the output.
const PICO: &str = "pico, serial number 0123456789AB, firmware 1.2.3";

#[test]
fn image_is_copied_to_the_drive_of_a_pico() {
    let folders = Folders::new();
    let bus = CanBus::start_pico(&folders.drive);
    let image = uf2::image("pico", RP2040);
    let output = folders.update(&bus.port(), &image);
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    assert_eq!(folders.taken(), Some(image));
    let (name, file, drive) = (bus.port(), folders.file.display(), folders.drive.display());
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        format!(
            "{name}: {PICO}\n\
             {name}: restarts into its boot loader, to take 4096 bytes; if interrupted, copy {file} to the drive RPI-RP2\n\
             copying {file} to {drive}\n\
             {name}: {PICO}\n"
        )
    );
}

#[test]
fn unfit_image_restarts_no_pico() {
    let folders = Folders::new();
    let bus = CanBus::start_pico(&folders.drive);
    let good = uf2::image("pico", RP2040);
    let mut damaged = good.clone();
    damaged[512 + 100] ^= 1;
    // The tag is another.
    let mut nameless = good.clone();
    nameless[289] ^= 1;
    for (image, message) in [
        (
            uf2::image("weact-f405", RP2040),
            "the image is for the board weact-f405, the adapter is a pico",
        ),
        (
            uf2::image("pico", 0xE48B_FF59),
            "the file is for chips of the UF2 family 0xe48bff59, not for the RP2040, 0xe48bff56",
        ),
        (damaged, "the file is damaged: its checksum is"),
        (
            nameless,
            "the file has no board's name and checksum: it is no image of the adapter",
        ),
        (
            good[..good.len() - 1].to_vec(),
            "the file is truncated or damaged: its length is not that of its blocks",
        ),
    ] {
        let line = failure(&folders.update(&bus.port(), &image));
        assert!(line.contains(message), "{line}");
        assert!(!bus.boot_loader.exists() && folders.taken().is_none());
    }
}

#[test]
fn image_of_a_pico_is_for_no_other_adapter() {
    let folders = Folders::new();
    let bus = CanBus::start_board("stm32f405");
    let line = failure(&folders.update(&bus.port(), &uf2::image("pico", RP2040)));
    assert!(
        line.ends_with("the image is for the board pico, the adapter is a stm32f405"),
        "{line}"
    );
    assert!(!bus.boot_loader.exists());
}

#[test]
fn pico_in_its_boot_loader_is_not_overwritten() {
    let folders = Folders::new();
    fs::write(folders.drive.join(uf2::INFO), uf2::DESCRIPTION).unwrap();
    let line = failure(&folders.update("/dev/no-such-port", &uf2::image("pico", RP2040)));
    assert!(
        line.contains("a board is already in the boot loader: unplug it. If"),
        "{line}"
    );
    assert!(!folders.drive.join("armwire.uf2").exists());
}

#[test]
fn failed_copy_is_reported_with_next_steps() {
    let folders = Folders::new();
    let bus = CanBus::start_pico(&folders.drive);
    // No file can have this name then.
    fs::create_dir(folders.drive.join("armwire.uf2")).unwrap();
    let line = failure(&folders.update(&bus.port(), &uf2::image("pico", RP2040)));
    let end = format!(
        "; try again, the boot loader cannot be overwritten: copy {} to the drive RPI-RP2",
        folders.file.display()
    );
    assert!(line.starts_with(&format!("{}: ", folders.drive.display())), "{line}");
    assert!(line.ends_with(&end), "{line}");
}

#[test]
fn drive_is_not_for_dfuse_files() {
    let path = free_path("not-for-a-drive");
    fs::write(&path, image("virtual")).unwrap();
    let output = run(&["update", "/dev/no-such-port", path.to_str().unwrap(), "--drive", "/mnt"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(
        String::from_utf8(output.stderr)
            .unwrap()
            .contains("--drive is for a .uf2 file only")
    );
    fs::remove_file(path).unwrap();
}
