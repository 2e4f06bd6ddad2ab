//! The boot loader of the RP2040: a drive that takes a UF2 file (RP2040 datasheet 2.8.4).

use std::path::{Path, PathBuf};

use super::boot_loader::BootLoader;
use super::rom_drive::{self, LABEL};
use super::text::{as_word, progress};
use super::volumes::Volumes;
use crate::error::Error;
use crate::output::print_error;
use crate::status::StatusArg;

/// The file's name on the drive.
const FILE: &str = "armwire.uf2";
/// Number of searches that find the drive unmounted until this program mounts it. A desktop does so within this time.
const PATIENCE: usize = 6;

/// The drive, and the image for it.
pub(super) struct Drive {
    image: PathBuf,
    bytes: Vec<u8>,
    volumes: Volumes,
    /// The folder that the user named, which is not searched.
    named: Option<PathBuf>,
    /// The folder of the drive, once it is found.
    folder: Option<PathBuf>,
    /// Number of searches that found the drive unmounted.
    unmounted: usize,
    /// The reason why it could not be mounted.
    mount_error: Option<String>,
}

impl Drive {
    /// The drive that will be mounted at the folder `named`, or anywhere.
    pub(super) fn new(image: &Path, bytes: Vec<u8>, named: Option<&Path>, volumes: Volumes) -> Self {
        Self {
            image: image.to_owned(),
            bytes,
            volumes,
            named: named.map(Path::to_owned),
            folder: None,
            unmounted: 0,
            mount_error: None,
        }
    }

    /// The folder of a boot loader's drive.
    fn find(&self) -> Option<PathBuf> {
        let folders = match &self.named {
            Some(folder) => vec![folder.clone()],
            None => self.volumes.folders(),
        };
        folders.into_iter().find(|folder| rom_drive::is_at(folder))
    }

    /// The device of the drive, which is not mounted. A user who named a folder mounts it there.
    fn unmounted_device(&self) -> Option<PathBuf> {
        match self.named {
            Some(_) => None,
            None => self.volumes.device(LABEL),
        }
    }
}

impl BootLoader for Drive {
    fn check(&mut self) -> Result<(), Error> {
        if let Some(named) = self.named.as_deref().filter(|named| named.exists() && !named.is_dir()) {
            return Err(Error::at(&named.display().to_string(), "--drive names a folder"));
        }
        let Some(place) = self.find().or_else(|| self.volumes.device(LABEL)) else {
            return Ok(());
        };
        let by_hand = self.by_hand();
        let what = format!("a board is already in the boot loader: unplug it. If it is the board to update, {by_hand}");
        Err(Error::at(&place.display().to_string(), what))
    }

    fn by_hand(&self) -> String {
        format!("copy {} to the drive {LABEL}", self.image.display())
    }

    fn entry(&self) -> &'static str {
        "BOOTSEL held down"
    }

    fn is_there(&mut self) -> bool {
        self.folder = self.find();
        if self.folder.is_none()
            && let Some(device) = self.unmounted_device()
        {
            self.unmounted += 1;
            if self.unmounted == PATIENCE {
                self.mount_error = self.volumes.mount(&device).err();
            }
        }
        self.folder.is_some()
    }

    fn absence(&self) -> String {
        let by_hand = self.by_hand();
        let what = match (&self.named, self.unmounted_device()) {
            (Some(folder), _) => format!(
                "no drive of the boot loader at {}: mount it, and {by_hand}",
                folder.display()
            ),
            (None, Some(device)) => {
                let (device, image) = (device.display(), as_word(&self.image.to_string_lossy()));
                let reason = self
                    .mount_error
                    .as_ref()
                    .map_or(String::new(), |reason| format!(" ({reason})"));
                format!(
                    "the drive of the boot loader is not mounted{reason}: run 'sudo mount {device} /mnt', 'sudo cp {image} \
                     /mnt' and 'sudo umount /mnt'"
                )
            }
            (None, None) => format!(
                "no drive {LABEL}: is the adapter's USB connected to this computer? Then {by_hand}, or name the drive's \
                 folder by --drive"
            ),
        };
        format!("{what}. Or unplug and replug the adapter: it still has its old firmware")
    }

    fn write(&mut self, status: StatusArg) -> Result<(), Error> {
        let Some(folder) = &self.folder else {
            return Err(Error::at(LABEL, self.absence()));
        };
        let (place, image) = (folder.display(), self.image.display());
        progress(format!("copying {image} to {place}"));
        let mut line = status.line();
        line.begin(0, format!("writing {} bytes", self.bytes.len()));
        let copied = rom_drive::write(folder, FILE, &self.bytes);
        let written = copied.and_then(|file| match file.sync_all() {
            // The chip starts the new firmware after the last page, perhaps before the system has written the rest.
            Err(error) if !rom_drive::is_at(folder) => {
                line.beside(|| print_error(&format_args!("{place}: the drive went away: {error}")));
                Ok(())
            }
            synced => synced,
        });
        drop(line);
        written.map_err(|error| {
            let again = format!("try again, the boot loader cannot be overwritten: {}", self.by_hand());
            Error::at(&place.to_string(), format!("{error}; {again}"))
        })
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs;
    use std::process::Command;

    use super::super::rom_drive::INFO;
    use super::*;

    /// A system with a drive of the boot loader, which is not mounted.
    struct System {
        root: PathBuf,
        drive: Drive,
    }

    impl System {
        fn new(name: &str) -> Self {
            let root = std::env::temp_dir().join(format!("armwire-drive-{name}-{}", std::process::id()));
            let _ = fs::remove_dir_all(&root);
            fs::create_dir_all(root.join("my drive")).unwrap();
            fs::write(
                root.join("my drive").join(INFO),
                "UF2 Bootloader v3.0\nModel: Raspberry Pi RP2\nBoard-ID: RPI-RP2\n",
            )
            .unwrap();
            fs::write(root.join("mounts"), "/dev/sda1 / ext4 rw 0 0\n").unwrap();
            fs::write(root.join(LABEL), "").unwrap();
            let drive = Drive::new(Path::new("new.uf2"), vec![1, 2, 3], None, Volumes::of(&root));
            Self { root, drive }
        }

        /// A line of the table of mounts, with the drive.
        fn mount(&self) -> String {
            format!("/dev/sdb1 {}/my\\040drive vfat rw 0 0\n", self.root.display())
        }

        /// Installs a `udisksctl` with these commands. `install` writes it: a process that another test starts would
        /// inherit this one's open file, and a file open for writing cannot be executed.
        fn install_udisksctl(&self, script: &str) {
            let source = self.root.join("script");
            fs::write(&source, format!("#!/bin/sh\n{script}\n")).unwrap();
            let mut install = Command::new("install");
            install.args(["-m", "755"]).arg(source).arg(self.root.join("udisksctl"));
            assert!(install.status().unwrap().success());
        }
    }

    impl Drop for System {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.root);
        }
    }

    #[test]
    fn mounted_drive_is_found_by_its_description() {
        let mut system = System::new("mounted");
        assert!(!system.drive.is_there());
        fs::write(system.root.join("mounts"), system.mount()).unwrap();
        assert!(system.drive.is_there());
        assert_eq!(system.drive.folder, Some(system.root.join("my drive")));
        // A drive of another chip.
        let info = "UF2 Bootloader v1.0\nModel: Raspberry Pi RP2350\nBoard-ID: RP2350\n";
        fs::write(system.root.join("my drive").join(INFO), info).unwrap();
        assert!(!system.drive.is_there());
    }

    #[test]
    fn drive_that_nobody_mounts_is_mounted() {
        let mut system = System::new("udisks");
        let (mounts, line) = (system.root.join("mounts"), system.mount().replace('\\', "\\\\"));
        let device = system.root.join(LABEL);
        system.install_udisksctl(&format!(
            "[ \"$*\" = \"mount --no-user-interaction --block-device {}\" ] && printf '{}' >> {}",
            device.display(),
            line.replace('\n', "\\n"),
            mounts.display()
        ));
        let searches = (1..).take_while(|_| !system.drive.is_there()).count();
        assert_eq!(searches, PATIENCE);
    }

    #[test]
    fn unmounted_drive_is_reported_with_commands() {
        let mut system = System::new("unmounted");
        for (script, reason) in [
            ("exit 1", "udisksctl failed (exit status: 1)"),
            (
                "echo 'Error mounting /dev/sdb1: Not authorized' >&2; exit 1",
                "udisksctl failed (exit status: 1): Error mounting /dev/sdb1: Not authorized",
            ),
        ] {
            system.install_udisksctl(script);
            system.drive.unmounted = 0;
            for _ in 0..PATIENCE {
                assert!(!system.drive.is_there());
            }
            let device = system.root.join(LABEL);
            let device = device.display();
            assert_eq!(
                system.drive.absence(),
                format!(
                    "the drive of the boot loader is not mounted ({reason}): run 'sudo mount {device} /mnt', 'sudo cp \
                     new.uf2 /mnt' and 'sudo umount /mnt'. Or unplug and replug the adapter: it still has its old firmware"
                )
            );
        }
        fs::remove_file(system.root.join("udisksctl")).unwrap();
        system.drive.unmounted = PATIENCE - 1;
        assert!(!system.drive.is_there());
        assert!(system.drive.absence().contains("(udisksctl is not installed)"));
        fs::remove_file(system.root.join(LABEL)).unwrap();
        assert!(
            system
                .drive
                .absence()
                .starts_with("no drive RPI-RP2: is the adapter's USB connected")
        );
    }

    #[test]
    fn drive_that_went_away_before_the_copy_is_an_error() {
        let mut system = System::new("gone");
        fs::write(system.root.join("mounts"), system.mount()).unwrap();
        assert!(system.drive.is_there());
        fs::remove_dir_all(system.root.join("my drive")).unwrap();
        let text = system.drive.write(StatusArg::default()).unwrap_err().to_string();
        assert!(text.contains("try again"), "{text}");
    }

    #[test]
    fn unmounted_board_is_not_overwritten() {
        let mut system = System::new("before");
        let text = system.drive.check().unwrap_err().to_string();
        assert!(
            text.contains("a board is already in the boot loader: unplug it"),
            "{text}"
        );
    }
}
