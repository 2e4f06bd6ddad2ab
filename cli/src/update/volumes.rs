//! The drives of this computer: where they are mounted, and the one that is not.

#[cfg(target_os = "linux")]
mod system {
    use std::ffi::OsString;
    use std::fs;
    use std::io::ErrorKind;
    use std::os::unix::ffi::OsStringExt;
    use std::path::{Path, PathBuf};
    use std::process::Command;
    use std::time::Duration;

    use crate::update::child;

    /// Maximum duration of a mount.
    const LIMIT: Duration = Duration::from_secs(10);

    /// The drives of a Linux system.
    pub(in crate::update) struct Volumes {
        /// The table of mounts, as proc_mounts(5) has it.
        mounts: PathBuf,
        /// The folder with a link to the device of each label.
        labels: PathBuf,
        /// The program that mounts a drive for the user logged in at the machine.
        udisksctl: PathBuf,
    }

    impl Volumes {
        /// Those of this computer.
        pub(in crate::update) fn new() -> Self {
            Self {
                mounts: "/proc/self/mounts".into(),
                labels: "/dev/disk/by-label".into(),
                udisksctl: "udisksctl".into(),
            }
        }

        /// The folders of all mounted FAT drives.
        pub(in crate::update) fn folders(&self) -> Vec<PathBuf> {
            // Without the table no drive is mounted.
            let mounts = fs::read(&self.mounts).unwrap_or_default();
            mounts.split(|byte| *byte == b'\n').filter_map(fat_folder).collect()
        }

        /// The device of the drive with this label, mounted or not.
        pub(in crate::update) fn device(&self, label: &str) -> Option<PathBuf> {
            Some(self.labels.join(label)).filter(|device| device.exists())
        }

        /// Mounts a drive, as a desktop does. The error is the reason in words.
        pub(in crate::update) fn mount(&self, device: &Path) -> Result<(), String> {
            let mut udisksctl = Command::new(&self.udisksctl);
            udisksctl.args(["mount", "--no-user-interaction", "--block-device"]);
            match child::run(udisksctl.arg(device), LIMIT, false) {
                Ok(ended) if ended.status.success() => Ok(()),
                Ok(ended) => Err(format!("udisksctl failed ({}){}", ended.status, ended.last_line())),
                Err(error) if error.kind() == ErrorKind::NotFound => Err("udisksctl is not installed".to_owned()),
                Err(error) => Err(format!("udisksctl: {error}")),
            }
        }
    }

    /// The folder of a FAT drive in a line of the table: device, folder, file system and more.
    fn fat_folder(line: &[u8]) -> Option<PathBuf> {
        let mut words = line.split(|byte| *byte == b' ');
        let (_, folder, kind) = (words.next()?, words.next()?, words.next()?);
        (kind == b"vfat").then(|| OsString::from_vec(unescaped(folder)).into())
    }

    /// A word of the table, in which some characters are three octal digits behind a backslash.
    fn unescaped(mut word: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some((&first, rest)) = word.split_first() {
            let code = rest.get(..3).and_then(|digits| str::from_utf8(digits).ok());
            match code.and_then(|digits| u8::from_str_radix(digits, 8).ok()) {
                Some(code) if first == b'\\' => {
                    bytes.push(code);
                    word = &rest[3..];
                }
                _ => {
                    bytes.push(first);
                    word = rest;
                }
            }
        }
        bytes
    }

    /// The drives of a system in a folder of a test.
    #[cfg(test)]
    impl Volumes {
        pub(in crate::update) fn of(root: &Path) -> Self {
            Self {
                mounts: root.join("mounts"),
                labels: root.to_owned(),
                udisksctl: root.join("udisksctl"),
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn folder_of_a_fat_drive_is_unescaped() {
            let line = b"/dev/sdb1 /media/me/a\\040b\\134c\xFF vfat rw,nosuid 0 0";
            let folder = OsString::from_vec(b"/media/me/a b\\c\xFF".to_vec());
            assert_eq!(fat_folder(line), Some(folder.into()));
            for line in [
                &b"/dev/sda1 / ext4 rw 0 0"[..],
                b"server:/ /mnt nfs4 rw 0 0",
                b"",
                b"/dev/sdb1 /mnt",
            ] {
                assert_eq!(fat_folder(line), None);
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::path::{Path, PathBuf};

    /// The drives of a system that mounts each by itself.
    pub(in crate::update) struct Volumes;

    impl Volumes {
        /// Those of this computer.
        pub(in crate::update) fn new() -> Self {
            Self
        }

        /// The folders of all drives.
        #[cfg(target_os = "macos")]
        pub(in crate::update) fn folders(&self) -> Vec<PathBuf> {
            let folders = std::fs::read_dir("/Volumes").into_iter().flatten();
            folders.filter_map(|folder| Some(folder.ok()?.path())).collect()
        }

        /// The folders of all drives. A and B are floppy disks.
        #[cfg(windows)]
        pub(in crate::update) fn folders(&self) -> Vec<PathBuf> {
            ('C'..='Z').map(|letter| format!("{letter}:\\").into()).collect()
        }

        /// The folders of drives are unknown.
        #[cfg(not(any(target_os = "macos", windows)))]
        pub(in crate::update) fn folders(&self) -> Vec<PathBuf> {
            Vec::new()
        }

        /// No drive stays without a folder.
        pub(in crate::update) fn device(&self, _: &str) -> Option<PathBuf> {
            None
        }

        /// Never called: there is no device.
        pub(in crate::update) fn mount(&self, _: &Path) -> Result<(), String> {
            Ok(())
        }
    }
}

pub(super) use system::Volumes;
