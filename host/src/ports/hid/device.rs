//! HID devices of this computer, through hidraw on Linux, Win32 on Windows and IOKit on macOS.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::time::Duration;

use armwire::alpha1::hid::REPORT;
use async_hid::{AsyncHidRead, AsyncHidWrite, DeviceId, DeviceReaderWriter, HidBackend, HidError};
use async_io::{Timer, block_on};
use futures_lite::{StreamExt, future};

use super::reports::{Failure, Named, Reports};

/// Timeout of a write.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// An open device.
pub(super) struct Device(DeviceReaderWriter);

/// All devices, without duplicates.
///
/// # Errors
///
/// The system cannot list them.
pub(super) fn list() -> Result<Vec<(Named, async_hid::Device)>, HidError> {
    let backend = HidBackend::default();
    let found: Vec<_> = match block_on(async { Ok(backend.enumerate().await?.collect().await) }) {
        // Linux reports an empty list as `NotFound`.
        Err(error) if kind(&error) == Some(ErrorKind::NotFound) => return Ok(Vec::new()),
        found => found?,
    };
    let mut devices: Vec<(Named, async_hid::Device)> = Vec::new();
    // The system lists a device once per usage.
    for device in found {
        let name = name(&device.id);
        if devices.iter().all(|(named, _)| named.name != name) {
            let ids = (device.vendor_id, device.product_id);
            devices.push((Named { name, ids }, device));
        }
    }
    Ok(devices)
}

/// The system's name of a device.
fn name(id: &DeviceId) -> String {
    match id {
        // The folder of `/dev/hidraw3` in sysfs ends with the same name.
        #[cfg(target_os = "linux")]
        DeviceId::DevPath(path) => match path.file_name() {
            Some(name) => format!("/dev/{}", name.to_string_lossy()),
            None => path.to_string_lossy().into_owned(),
        },
        #[cfg(windows)]
        DeviceId::UncPath(path) => path.to_string_lossy(),
        #[cfg(target_os = "macos")]
        DeviceId::RegistryEntryId(id) => id.to_string(),
        _ => format!("{id:?}"),
    }
}

impl Device {
    pub(super) fn open(device: &async_hid::Device) -> Result<Self, Failure> {
        Ok(Self(block_on(device.open())?))
    }
}

impl Reports for Device {
    fn read(&mut self, report: &mut [u8; REPORT], wait: Duration) -> Result<usize, Failure> {
        Ok(within(wait, self.0.read_input_report(report))?.unwrap_or(0))
    }

    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), Failure> {
        // All systems expect a report number in front: 0 for unnumbered reports.
        let mut numbered = [0; 1 + REPORT];
        numbered[1..].copy_from_slice(report);
        within(WRITE_TIMEOUT, self.0.write_output_report(&numbered))?.ok_or(Failure::Stuck)
    }
}

/// Runs `act` with a timeout. `None` on timeout.
fn within<T>(wait: Duration, act: impl Future<Output = Result<T, HidError>>) -> Result<Option<T>, HidError> {
    let act = async { act.await.map(Some) };
    let expire = async {
        Timer::after(wait).await;
        Ok(None)
    };
    block_on(future::or(act, expire))
}

/// The kind of the system's error, if the error is one.
fn kind(error: &HidError) -> Option<ErrorKind> {
    match error {
        HidError::Other(error) => error.downcast_ref::<io::Error>().map(io::Error::kind),
        _ => None,
    }
}

impl From<HidError> for Failure {
    fn from(error: HidError) -> Self {
        match (&error, kind(&error)) {
            (HidError::Disconnected | HidError::NotConnected, _) => Self::Gone,
            // Linux reports these for an unplugged device.
            (_, Some(ErrorKind::BrokenPipe | ErrorKind::NotFound)) => Self::Gone,
            (_, Some(ErrorKind::PermissionDenied)) => Self::Denied,
            _ => Self::Other(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_of_this_computer_are_listed() {
        assert!(list().is_ok());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn device_is_named_by_its_file() {
        let id = DeviceId::DevPath("/sys/devices/virtual/misc/uhid/0003:0483:5750.0001/hidraw/hidraw3".into());
        assert_eq!(name(&id), "/dev/hidraw3");
    }

    #[test]
    fn failures_are_told_apart() {
        let failure = |kind: ErrorKind| Failure::from(HidError::from(io::Error::from(kind)));
        assert!(matches!(Failure::from(HidError::Disconnected), Failure::Gone));
        assert!(matches!(failure(ErrorKind::NotFound), Failure::Gone));
        assert!(matches!(failure(ErrorKind::PermissionDenied), Failure::Denied));
        assert!(matches!(failure(ErrorKind::Unsupported), Failure::Other(_)));
    }

    #[test]
    fn wait_for_a_report_ends() {
        let never = future::pending::<Result<(), HidError>>();
        assert!(matches!(within(Duration::ZERO, never), Ok(None)));
        assert!(matches!(within(Duration::ZERO, async { Ok(5) }), Ok(Some(5))));
    }
}
