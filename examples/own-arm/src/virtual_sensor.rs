//! The sensor without hardware.

use armwire::{Device, DeviceEvent};

use crate::sensor::{Angle, JOINTS, MAX_FRAME, Sensor};

/// A virtual sensor.
pub struct VirtualSensor {
    device: Device<Sensor, 32>,
    /// The angle of each joint, in tenths of a degree.
    pub tenths: [u16; JOINTS as usize],
}

impl VirtualSensor {
    /// A sensor with these angles, in tenths of a degree.
    pub const fn new(tenths: [u16; JOINTS as usize]) -> Self {
        let device = Device::new(Sensor);
        Self { device, tenths }
    }

    /// Takes bytes of the host, and passes each answer to `send`. A sensor does not answer for a joint that it does not
    /// have.
    pub fn receive(&mut self, bytes: &[u8], mut send: impl FnMut(&[u8])) {
        let mut rest = bytes;
        loop {
            rest = self.device.receive(rest);
            while let Some(event) = self.device.poll() {
                let DeviceEvent::Request { request, key } = event else {
                    continue;
                };
                let joint = request.joint;
                let mut out = [0; MAX_FRAME];
                let angle = self.tenths.get(usize::from(joint).wrapping_sub(1));
                let answer = angle.map(|&tenths| self.device.respond(&Angle { joint, tenths }, key, &mut out));
                if let Some(Ok(n)) = answer {
                    send(&out[..n]);
                }
            }
            if rest.is_empty() {
                return;
            }
        }
    }
}
