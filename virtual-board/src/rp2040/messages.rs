//! The messages between the virtual board and the emulator's process: `rp2040/messages.mjs`. Numbers are little-endian.

use crate::time::Nanos;

/// The numbers of commands, as in `rp2040/messages.mjs`.
mod command {
    pub(super) const RUN: u8 = 0;
    pub(super) const START: u8 = 1;
    pub(super) const RESET: u8 = 2;
    pub(super) const HOLD: u8 = 3;
    pub(super) const FLASH: u8 = 4;
    pub(super) const FLASH_DONE: u8 = 5;
    pub(super) const RECEIVED: u8 = 6;
    pub(super) const TAKEN: u8 = 7;
    pub(super) const SENT: u8 = 8;
    pub(super) const BUS_RESET: u8 = 9;
    pub(super) const SETUP: u8 = 10;
    pub(super) const OUT: u8 = 11;
    pub(super) const IN_DONE: u8 = 12;
    pub(super) const SUSPEND: u8 = 13;
    pub(super) const RESUME: u8 = 14;
    pub(super) const ABORTED: u8 = 15;
    pub(super) const READ: u8 = 16;
    pub(super) const WRITE: u8 = 17;
    pub(super) const MOVE_STACK: u8 = 18;
    pub(super) const BUS_RESET_DONE: u8 = 19;
    pub(super) const START_OF_FRAME: u8 = 20;
}

/// The numbers of events, as there.
mod event {
    pub(super) const STOPPED: u8 = 0;
    pub(super) const BYTE: u8 = 1;
    pub(super) const UART: u8 = 2;
    pub(super) const USB: u8 = 3;
    pub(super) const BUFFER: u8 = 4;
    pub(super) const ENDPOINT: u8 = 5;
    pub(super) const ERASE: u8 = 6;
    pub(super) const PROGRAM: u8 = 7;
    pub(super) const RESET: u8 = 8;
    pub(super) const BOOT_LOADER: u8 = 9;
    pub(super) const CRASH: u8 = 10;
    pub(super) const VALUE: u8 = 11;
    pub(super) const FAILED: u8 = 12;
}

/// Errors of a received byte, in the order of their bits in the UART's registers (4.2.8).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ByteErrors {
    pub(super) framing: bool,
    pub(super) parity: bool,
    pub(super) line_break: bool,
    /// The FIFO was full: the byte is lost.
    pub(super) overrun: bool,
}

/// Commands to the process. It executes them in order, at the time of its last stop.
#[derive(Debug, Default)]
pub(super) struct Commands(Vec<u8>);

impl Commands {
    /// Starts the chip: the duration of a cycle in nanoseconds, the number of its revision, the flash's unique id, the
    /// addresses that are reached only in a crash, and the content of the flash.
    pub(super) fn start(
        &mut self,
        cycle: f64,
        revision: u8,
        unique_id: &[u8],
        crashes: impl ExactSizeIterator<Item = u32>,
        flash: &[u8],
    ) {
        self.byte(command::START);
        self.0.extend(cycle.to_le_bytes());
        self.byte(revision);
        self.bytes(unique_id);
        self.word(crashes.len() as u32);
        crashes.for_each(|address| self.word(address));
        self.bytes(flash);
    }

    /// Runs the chip until this time, or until an event that the board must handle.
    pub(super) fn run(&mut self, until: Nanos) {
        self.byte(command::RUN);
        self.0.extend((until.0 as f64).to_le_bytes());
    }

    /// Starts the chip again, with this value in the watchdog's REASON (4.7.6). The ROM clears SCRATCH4 before.
    pub(super) fn reset(&mut self, reason: u8, by_rom: bool) {
        self.byte(command::RESET);
        self.byte(reason);
        self.byte(by_rom.into());
    }

    /// Holds or releases the core.
    pub(super) fn hold(&mut self, held: bool) {
        self.byte(command::HOLD);
        self.byte(held.into());
    }

    /// Moves the top of the stack to this address, with this number of bytes.
    pub(super) fn move_stack(&mut self, to: u32, bytes: u32) {
        self.byte(command::MOVE_STACK);
        self.word(to);
        self.word(bytes);
    }

    /// Changes the content of the flash.
    pub(super) fn flash(&mut self, offset: usize, bytes: &[u8]) {
        self.byte(command::FLASH);
        self.word(offset as u32);
        self.bytes(bytes);
    }

    /// The operation of the flash has ended, and the core continues.
    pub(super) fn flash_done(&mut self) {
        self.byte(command::FLASH_DONE);
    }

    /// The UART received a byte.
    pub(super) fn received(&mut self, byte: u8, errors: ByteErrors) {
        let ByteErrors {
            framing,
            parity,
            line_break,
            overrun,
        } = errors;
        let bits = [framing, parity, line_break, overrun];
        self.byte(command::RECEIVED);
        self.byte(byte);
        self.byte((0..).zip(bits).fold(0, |all, (at, bit)| all | u8::from(bit) << at));
    }

    /// The UART's shift register took a byte from the transmit FIFO.
    pub(super) fn taken(&mut self) {
        self.byte(command::TAKEN);
    }

    /// The UART sent the last byte.
    pub(super) fn sent(&mut self) {
        self.byte(command::SENT);
    }

    /// The USB bus is in reset.
    pub(super) fn bus_reset(&mut self) {
        self.byte(command::BUS_RESET);
    }

    /// The reset of the USB bus has ended.
    pub(super) fn bus_reset_done(&mut self) {
        self.byte(command::BUS_RESET_DONE);
    }

    /// A USB frame starts.
    pub(super) fn start_of_frame(&mut self, number: u16) {
        self.byte(command::START_OF_FRAME);
        self.word(number.into());
    }

    /// A SETUP packet.
    pub(super) fn setup(&mut self, request: [u8; 8]) {
        self.byte(command::SETUP);
        self.bytes(&request);
    }

    /// A packet for an OUT endpoint.
    pub(super) fn output(&mut self, endpoint: u8, packet: &[u8]) {
        self.byte(command::OUT);
        self.byte(endpoint);
        self.bytes(packet);
    }

    /// The host fetched the packet of an IN endpoint.
    pub(super) fn fetched(&mut self, endpoint: u8) {
        self.byte(command::IN_DONE);
        self.byte(endpoint);
    }

    /// The bus is suspended.
    pub(super) fn suspend(&mut self) {
        self.byte(command::SUSPEND);
    }

    /// The host woke the bus.
    pub(super) fn resume(&mut self) {
        self.byte(command::RESUME);
    }

    /// The endpoints with these bits of EP_ABORT have no transaction in progress (4.1.2.9).
    pub(super) fn aborted(&mut self, endpoints: u32) {
        self.byte(command::ABORTED);
        self.word(endpoints);
    }

    /// Reads a word of memory or of a register.
    pub(super) fn read(&mut self, address: u32) {
        self.byte(command::READ);
        self.word(address);
    }

    /// Writes a word of memory or of a register.
    pub(super) fn write(&mut self, address: u32, value: u32) {
        self.byte(command::WRITE);
        self.word(address);
        self.word(value);
    }

    /// Moves the commands of `other` to the end.
    pub(super) fn append(&mut self, other: &mut Self) {
        self.0.append(&mut other.0);
    }

    /// Takes the batch, with its length in front.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let length = self.0.len() as u32;
        let batch = [&length.to_le_bytes(), &self.0[..]].concat();
        self.0.clear();
        batch
    }

    fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    fn word(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.word(bytes.len() as u32);
        self.0.extend(bytes);
    }
}

/// A register of the USB controller that a host can notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UsbRegister {
    Address,
    SieControl,
    Abort,
    StallArm,
    /// USB_MUXING: nonzero if the controller is at pins instead of the PHY, [`IDLE`](Self::IDLE) if it sees an idle bus there.
    Muxing,
}

impl UsbRegister {
    pub(super) const IDLE: u32 = 2;
}

/// An event in the chip.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Event {
    /// The run has stopped.
    Stopped {
        at: Nanos,
        instructions: u64,
        /// Time in which the core executed them.
        busy: Nanos,
    },
    /// A byte was written to the transmit FIFO.
    Byte(u8),
    /// The settings of the UART: the divisor in 64ths, the clock in hertz, UARTLCR_H, UARTCR, and true for one wire.
    Uart {
        divisor: u32,
        clock: u32,
        format: u32,
        control: u32,
        one_wire: bool,
    },
    /// A write to a register of the USB controller.
    Usb(UsbRegister, u32),
    /// The control of a USB buffer, by twice the endpoint's number, and one for OUT; and its packet for the host.
    Buffer { index: u8, control: u32, packet: Vec<u8> },
    /// The control of an endpoint other than 0, by the same number.
    Endpoint { index: u8, control: u32 },
    /// The core waits for the erase of sectors of the flash.
    Erase { from: usize, length: usize },
    /// The core waits for the programming of pages of the flash.
    Program { to: usize, bytes: Vec<u8> },
    /// The watchdog resets the chip, with this REASON.
    Reset { reason: u8 },
    /// The core started the boot loader.
    BootLoader,
    /// The core reached an address that it reaches only in a crash.
    Crash { address: u32 },
    /// The answer to a debugger's access: the word, if there is one.
    Value(Option<u32>),
    /// The emulator cannot continue.
    Failed(String),
}

/// The events in a batch. `None` if it is malformed.
pub(super) fn events(batch: &[u8]) -> Option<Vec<Event>> {
    let mut reader = Reader(batch);
    let mut events = Vec::new();
    while !reader.0.is_empty() {
        events.push(reader.event()?);
    }
    Some(events)
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn event(&mut self) -> Option<Event> {
        Some(match self.byte()? {
            event::STOPPED => Event::Stopped {
                at: Nanos(self.number()?),
                instructions: self.number()?,
                busy: Nanos(self.number()?),
            },
            event::BYTE => Event::Byte(self.byte()?),
            event::UART => Event::Uart {
                divisor: self.word()?,
                clock: self.word()?,
                format: self.word()?,
                control: self.word()?,
                one_wire: self.byte()? != 0,
            },
            event::USB => {
                let register = match self.byte()? {
                    0 => UsbRegister::Address,
                    1 => UsbRegister::SieControl,
                    2 => UsbRegister::Abort,
                    3 => UsbRegister::StallArm,
                    4 => UsbRegister::Muxing,
                    _ => return None,
                };
                Event::Usb(register, self.word()?)
            }
            event::BUFFER => Event::Buffer {
                index: self.byte()?,
                control: self.word()?,
                packet: self.bytes()?.to_vec(),
            },
            event::ENDPOINT => Event::Endpoint {
                index: self.byte()?,
                control: self.word()?,
            },
            event::ERASE => Event::Erase {
                from: self.word()? as usize,
                length: self.word()? as usize,
            },
            event::PROGRAM => Event::Program {
                to: self.word()? as usize,
                bytes: self.bytes()?.to_vec(),
            },
            event::RESET => Event::Reset { reason: self.byte()? },
            event::BOOT_LOADER => Event::BootLoader,
            event::CRASH => Event::Crash { address: self.word()? },
            event::VALUE => {
                let is_there = self.byte()? != 0;
                let value = self.word()?;
                Event::Value(is_there.then_some(value))
            }
            event::FAILED => Event::Failed(String::from_utf8_lossy(self.bytes()?).into_owned()),
            _ => return None,
        })
    }

    fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(byte)
    }

    fn word(&mut self) -> Option<u32> {
        let (&word, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(u32::from_le_bytes(word))
    }

    /// A whole number, which JavaScript has as a float.
    fn number(&mut self) -> Option<u64> {
        let (&number, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(f64::from_le_bytes(number) as u64)
    }

    fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.word()? as usize;
        let (bytes, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_of_a_batch_are_in_order() {
        let stopped = [
            &[0][..],
            &1.5e9_f64.to_le_bytes(),
            &7.0_f64.to_le_bytes(),
            &56.0_f64.to_le_bytes(),
        ]
        .concat();
        let batch = [&[1, 0xAA, 4, 4, 0x02, 0x24, 0, 0, 2, 0, 0, 0, 8, 9][..], &stopped].concat();
        let expected = [
            Event::Byte(0xAA),
            Event::Buffer {
                index: 4,
                control: 0x2402,
                packet: vec![8, 9],
            },
            Event::Stopped {
                at: Nanos(1_500_000_000),
                instructions: 7,
                busy: Nanos(56),
            },
        ];
        assert_eq!(events(&batch).unwrap(), expected);
        assert_eq!(events(&batch[..batch.len() - 1]), None);
        assert_eq!(events(&[0xEE]), None);
    }

    #[test]
    fn batch_of_commands_has_its_length_in_front() {
        let mut commands = Commands::default();
        commands.output(2, &[8, 9]);
        commands.aborted(0x30);
        let output = [11, 2, 2, 0, 0, 0, 8, 9];
        let aborted = [15, 0x30, 0, 0, 0];
        assert_eq!(commands.take(), [&[13, 0, 0, 0][..], &output, &aborted].concat());
        assert_eq!(commands.take(), [0; 4]);
    }
}
