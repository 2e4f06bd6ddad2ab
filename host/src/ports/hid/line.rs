//! A robot on USB as a HID device: a [`Line`] over reports of 64 bytes.

use std::collections::VecDeque;
use std::io::Read;
use std::time::Duration;

use armwire::alpha1::hid::{self, REPORT};

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

use super::device::{self, Device};
use super::reports::{Named, Reports};
use super::selector::{ALPHA1, Selector};

/// The names of all devices with the ids of an Alpha1. Empty if the system cannot list HID devices.
pub(super) fn alpha1_names() -> Vec<String> {
    let devices = device::list().unwrap_or_default().into_iter();
    let robots = devices
        .map(|(named, _)| named)
        .filter(|named| Selector::Alpha1.selects(&named.name, named.ids));
    robots.map(|robot| robot.name).collect()
}

/// Opens the device that matches the selector.
///
/// # Errors
///
/// No device or several devices match, or the system refuses to open the device.
pub(super) fn open(selector: &Selector) -> Result<Box<dyn Line>, Error> {
    let name = format!("hid:{selector}");
    let mut devices = device::list().map_err(|error| Error::at(&name, error))?;
    let named: Vec<_> = devices.iter().map(|(named, _)| named.clone()).collect();
    let chosen = choose(selector, &named).map_err(|reason| Error::at(&name, reason))?;
    let (Named { ids, .. }, found) = devices.swap_remove(chosen);
    let device = Device::open(&found).map_err(|error| error.on(&name, ids))?;
    Ok(Box::new(HidLine::new(name, ids, device)))
}

/// The index of the only matching device.
///
/// # Errors
///
/// No device matches, or several do.
fn choose(selector: &Selector, devices: &[Named]) -> Result<usize, String> {
    let selected = |&i: &usize| selector.selects(&devices[i].name, devices[i].ids);
    let selected: Vec<_> = (0..devices.len()).filter(selected).collect();
    match (selected.as_slice(), selector) {
        ([one], _) => Ok(*one),
        ([], Selector::Name(_)) => {
            let names: Vec<_> = devices.iter().map(|device| format!("hid:{}", device.name)).collect();
            Err(match names.as_slice() {
                [] => "no such HID device; there are none".to_owned(),
                names => format!("no such HID device; there are: {}", names.join(", ")),
            })
        }
        ([], Selector::Alpha1) => {
            let (vendor, product) = ALPHA1;
            Err(format!(
                "no HID device {vendor:04x}:{product:04x}: is the robot plugged in and on, and is it a HID device and not a \
                 serial port? Other ids: hid:VID:PID"
            ))
        }
        ([], Selector::Ids(..)) => Err("no HID device has these ids".to_owned()),
        (several, _) => {
            let names: Vec<_> = several.iter().map(|&i| format!("hid:{}", devices[i].name)).collect();
            Err(format!(
                "several HID devices have these ids; choose one of: {}",
                names.join(", ")
            ))
        }
    }
}

/// A byte stream over reports.
struct HidLine<R> {
    name: String,
    /// Vendor and product id.
    ids: (u16, u16),
    reports: R,
    /// The rest of a report that did not fit in the reader's buffer.
    unread: VecDeque<u8>,
}

impl<R: Reports> HidLine<R> {
    fn new(name: String, ids: (u16, u16), reports: R) -> Self {
        let unread = VecDeque::new();
        Self {
            name,
            ids,
            reports,
            unread,
        }
    }
}

impl<R: Reports> Line for HidLine<R> {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        if self.unread.is_empty() {
            let mut report = [0; REPORT];
            let n = self
                .reports
                .read(&mut report, wait)
                .map_err(|failure| failure.on(&self.name, self.ids))?;
            self.unread.extend(&report[..n]);
        }
        self.unread.read(buf).map_err(|error| Error::at(&self.name, error))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        // One at a time: the bytes of an accepted report count, whatever becomes of the next.
        if let Some(report) = hid::reports(bytes).next() {
            self.reports
                .write(&report)
                .map_err(|failure| failure.on(&self.name, self.ids))?;
        }
        Ok(bytes.len().min(REPORT))
    }

    fn hint(&self, reception: Reception, names: Names) -> Text {
        match reception {
            Reception::Silence => format!(
                "is the robot on, is it {}, and is the port free of other programs?",
                names.arm
            ),
            Reception::Garbage => format!("is it {}, and not another HID device?", names.arm),
        }
        .into()
    }
}

#[cfg(test)]
mod tests {
    use armwire::alpha1::{Alpha1, Outcome, Request, Response};
    use armwire::time;
    use armwire_sim::alpha1::{Alpha1Robot, RobotConfig};
    use armwire_sim::serial::SerialDevice;

    use super::super::reports::Failure;
    use super::*;
    use crate::describe::Arm;
    use crate::ports::link::Link;

    /// A virtual robot as a HID device. Virtual time advances while a read waits.
    struct VirtualDevice {
        robot: Alpha1Robot,
        now: time::Instant,
        written: usize,
    }

    impl VirtualDevice {
        fn new() -> Self {
            let config = RobotConfig {
                hid: true,
                ..RobotConfig::default()
            };
            Self {
                robot: Alpha1Robot::new(config),
                now: time::Instant::ZERO,
                written: 0,
            }
        }
    }

    impl Reports for VirtualDevice {
        fn read(&mut self, report: &mut [u8; REPORT], _: Duration) -> Result<usize, Failure> {
            let Some(due) = self.robot.poll_timeout() else {
                return Ok(0);
            };
            self.now = self.now.max(due);
            let sent = std::iter::from_fn(|| self.robot.transmit(self.now)).take(REPORT);
            Ok(report.iter_mut().zip(sent).map(|(to, byte)| *to = byte).count())
        }

        fn write(&mut self, report: &[u8; REPORT]) -> Result<(), Failure> {
            self.written += 1;
            report.iter().for_each(|&byte| self.robot.receive(self.now, byte));
            Ok(())
        }
    }

    #[test]
    fn robot_answers_in_reports() {
        let line = HidLine::new("hid:".to_owned(), ALPHA1, VirtualDevice::new());
        let mut link = Link::<Alpha1>::new(Box::new(line), Alpha1::CONFIG);
        let version = link.call(&Request::ReadHardwareVersion, |response| response.to_string());
        assert_eq!(version.unwrap().unwrap(), "arm: Alpha1, hardware: Alpha1_V2.0");
        let stopped = link.call(&Request::Stop, |response| {
            response == Response::Stopped(Outcome::Success)
        });
        assert_eq!(stopped.unwrap(), Some(true));
        assert_eq!(link.line_errors().noise_bytes, 0);
    }

    #[test]
    fn long_frame_takes_several_reports() {
        let mut line = HidLine::new("hid:".to_owned(), ALPHA1, VirtualDevice::new());
        for (bytes, accepted) in [(65, REPORT), (1, 1), (0, 0)] {
            assert_eq!(line.write(&vec![1; bytes]).unwrap(), accepted);
        }
        assert_eq!(line.reports.written, 2);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn udev_rule_names_the_devices_own_ids() {
        /// A device that the user may not use.
        struct Denied;

        impl Reports for Denied {
            fn read(&mut self, _: &mut [u8; REPORT], _: Duration) -> Result<usize, Failure> {
                Err(Failure::Denied)
            }

            fn write(&mut self, _: &[u8; REPORT]) -> Result<(), Failure> {
                Err(Failure::Denied)
            }
        }

        let mut line = HidLine::new("hid:1234:abcd".to_owned(), (0x1234, 0xabcd), Denied);
        let error = line.write(&[1]).unwrap_err().to_string();
        let ids = "ATTRS{idVendor}==\"1234\", ATTRS{idProduct}==\"abcd\"";
        assert!(error.contains(ids), "{error}");
    }

    #[test]
    fn report_is_read_in_small_parts() {
        let mut line = HidLine::new("hid:".to_owned(), ALPHA1, VirtualDevice::new());
        line.write(&[0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED]).unwrap();
        let mut answer: Vec<u8> = Vec::new();
        let mut part = [0; 3];
        while answer.len() < REPORT {
            let n = line.read(&mut part, Duration::ZERO).unwrap();
            answer.extend(&part[..n]);
        }
        assert_eq!(answer[..5], [0xF2, 0x2F, 0xAA, 0xED, 0]);
        assert_eq!(answer.len(), REPORT);
    }

    #[test]
    fn device_is_chosen_by_ids_or_name() {
        let device = |name: &str, ids| Named {
            name: name.to_owned(),
            ids,
        };
        let devices = [
            device("/dev/hidraw0", (0x046d, 0xc52b)),
            device("/dev/hidraw1", ALPHA1),
            device("/dev/hidraw2", (0x1234, 0xabcd)),
            device("/dev/hidraw3", (0x1234, 0xabcd)),
        ];
        let choose = |text: &str| choose(&Selector::parse(text), &devices);
        for (text, chosen) in [("", 1), ("0483:5750", 1), ("046D:C52B", 0), ("/dev/hidraw3", 3)] {
            assert_eq!(choose(text), Ok(chosen), "{text}");
        }
        for (text, reason) in [
            (
                "1234:abcd",
                "several HID devices have these ids; choose one of: hid:/dev/hidraw2, hid:/dev/hidraw3",
            ),
            ("1234:0001", "no HID device has these ids"),
            (
                "/dev/hidraw4",
                "no such HID device; there are: hid:/dev/hidraw0, hid:/dev/hidraw1",
            ),
            ("123:4567", "no such HID device"),
        ] {
            let error = choose(text).unwrap_err();
            assert!(error.starts_with(reason), "{error}");
        }
        assert!(
            super::choose(&Selector::Alpha1, &devices[..1])
                .unwrap_err()
                .starts_with("no HID device 0483:5750")
        );
    }
}
