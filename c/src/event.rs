//! The events of clients and devices, common to all protocols.

use armwire::framing::Reason;
use armwire::{DeviceEvent, Event, Output, ParseError};

use crate::fault::ArmwireFault;

/// The kind of an `ArmwireEvent`. The members that it sets are named in parentheses.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireEventKind {
    /// Wait for bytes, a client until `until_us` at most. (`until_us`)
    Wait = 0,
    /// Client: transmit these bytes. Report the number that the line accepted with `transmitted`. (`bytes`, `len`)
    Transmit,
    /// Client: the answer to the request in flight. The request is complete. (the response; `bytes` and `len` are the
    /// data after its documented fields, which a newer Ling arm may send)
    Answer,
    /// Client: the request in flight was transmitted. It has no answer and is complete.
    Sent,
    /// Client: the request in flight got no answer in time. The request has ended. (`sends`)
    TimedOut,
    /// Client: the answer to the request in flight has an invalid value or length. The request is complete. (`fault`)
    Unacceptable,
    /// Client: the arm answered the request in flight with an error frame. The request is complete. (`bytes`, `len`)
    ErrorFrame,
    /// Client: an answer to a request that timed out, was cancelled, or was answered before. (the response)
    Late,
    /// Client: a response without a request. (the response)
    Unsolicited,
    /// Client: a request: an echo of the line, or a request of another host.
    Echo,
    /// Device: a request. (the request)
    Request,
    /// A valid frame that is not a message of the protocol. (`bytes`, `len`, `fault`)
    Unknown,
    /// Bytes that are not part of a frame. (`offset`, `bytes`, `len`, `fault`)
    Noise,
    /// A lossless stream broke here: no later byte can be decoded, or a request ended while it was partly transmitted.
    /// Close the connection. (`offset`, `fault`)
    Broken,
    /// Client: read the bytes that the port has, without waiting. Report their number with `received`, 0 if there are
    /// none.
    Receive,
}

/// An event of a client or a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireEvent {
    /// The kind: an `ArmwireEventKind`.
    pub kind: u32,
    /// The number of transmissions of the request.
    pub sends: u32,
    /// The latest time of the next poll; UINT64_MAX if no timeout is running.
    pub until_us: u64,
    /// The offset of the first byte, in bytes since `init`.
    pub offset: u64,
    /// Bytes, valid until the next call with the same client or device.
    pub bytes: *const u8,
    /// The number of `bytes`.
    pub len: usize,
    /// The error.
    pub fault: ArmwireFault,
}

impl ArmwireEvent {
    const fn set_bytes(&mut self, bytes: &[u8]) {
        (self.bytes, self.len) = (bytes.as_ptr(), bytes.len());
    }

    fn set_unknown(&mut self, frame: &[u8], error: ParseError) -> ArmwireEventKind {
        self.set_bytes(frame);
        self.fault.set_message(error);
        ArmwireEventKind::Unknown
    }

    fn set_noise(&mut self, offset: u64, bytes: &[u8], reason: Reason) -> ArmwireEventKind {
        self.offset = offset;
        self.set_bytes(bytes);
        self.fault.set_noise(reason);
        ArmwireEventKind::Noise
    }

    fn set_broken(&mut self, offset: u64, reason: Reason) -> ArmwireEventKind {
        self.offset = offset;
        self.fault.set_noise(reason);
        ArmwireEventKind::Broken
    }

    /// Sets all members from the output of a client, and returns its response.
    pub(crate) fn set_client<R>(&mut self, output: Output<'_, R>) -> Option<R> {
        *self = Self::default();
        let (kind, response) = match output {
            Output::Receive => (ArmwireEventKind::Receive, None),
            Output::Transmit(bytes) => {
                self.set_bytes(bytes);
                (ArmwireEventKind::Transmit, None)
            }
            Output::Timeout(until) => {
                self.until_us = until.map_or(u64::MAX, |until| until.as_micros());
                (ArmwireEventKind::Wait, None)
            }
            Output::Event(event) => match event {
                Event::Answer(response) => (ArmwireEventKind::Answer, Some(response)),
                Event::Late(response) => (ArmwireEventKind::Late, Some(response)),
                Event::Unsolicited(response) => (ArmwireEventKind::Unsolicited, Some(response)),
                Event::Sent => (ArmwireEventKind::Sent, None),
                Event::Echo => (ArmwireEventKind::Echo, None),
                Event::TimedOut { sends } => {
                    self.sends = sends.into();
                    (ArmwireEventKind::TimedOut, None)
                }
                Event::Unacceptable(error) => {
                    self.fault.set_message(error);
                    (ArmwireEventKind::Unacceptable, None)
                }
                Event::ErrorFrame { frame } => {
                    self.set_bytes(frame);
                    (ArmwireEventKind::ErrorFrame, None)
                }
                Event::Unknown { frame, error } => (self.set_unknown(frame, error), None),
                Event::Noise { offset, bytes, reason } => (self.set_noise(offset, bytes, reason), None),
                Event::Broken { offset, reason } => (self.set_broken(offset, reason), None),
            },
        };
        self.kind = kind as u32;
        response
    }

    /// Sets the data of an answer after its documented fields.
    pub(crate) const fn set_extra(&mut self, extra: &[u8]) {
        if self.kind == ArmwireEventKind::Answer as u32 && !extra.is_empty() {
            self.set_bytes(extra);
        }
    }

    /// Sets all members from the event of a device, and returns its request and the key of the response.
    pub(crate) fn set_device<R, K>(&mut self, event: Option<DeviceEvent<'_, R, K>>) -> (Option<R>, Option<K>) {
        *self = Self::default();
        let (kind, request, key) = match event {
            None => {
                self.until_us = u64::MAX;
                (ArmwireEventKind::Wait, None, None)
            }
            Some(DeviceEvent::Request { request, key }) => (ArmwireEventKind::Request, Some(request), key),
            Some(DeviceEvent::Unknown { frame, error, key }) => (self.set_unknown(frame, error), None, key),
            Some(DeviceEvent::Noise { offset, bytes, reason }) => (self.set_noise(offset, bytes, reason), None, None),
            Some(DeviceEvent::Broken { offset, reason }) => (self.set_broken(offset, reason), None, None),
        };
        self.kind = kind as u32;
        (request, key)
    }
}
