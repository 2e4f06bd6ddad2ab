//! A debugger on a TCP port: gdb's remote serial protocol (the GDB manual, appendix E), as needed for a core without an
//! operating system.
//!
//! The core halts when gdb connects, at a breakpoint, and when gdb interrupts it. Virtual time does not advance while
//! it is halted.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Polling period of a halted core for the end of the run.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The byte by which gdb interrupts a running core.
const INTERRUPT: u8 = 3;

/// Stop replies: by a trap, and by an interrupt.
const TRAPPED: &str = "S05";
const INTERRUPTED: &str = "S02";

/// Registers of a core, in the order of `TARGET`: R0 to R15 and xPSR.
pub(crate) const REGISTERS: usize = 17;

const TARGET: &str = r#"<?xml version="1.0"?><!DOCTYPE target SYSTEM "gdb-target.dtd"><target version="1.0">
<architecture>arm</architecture><feature name="org.gnu.gdb.arm.m-profile">
<reg name="r0" bitsize="32"/><reg name="r1" bitsize="32"/><reg name="r2" bitsize="32"/><reg name="r3" bitsize="32"/>
<reg name="r4" bitsize="32"/><reg name="r5" bitsize="32"/><reg name="r6" bitsize="32"/><reg name="r7" bitsize="32"/>
<reg name="r8" bitsize="32"/><reg name="r9" bitsize="32"/><reg name="r10" bitsize="32"/><reg name="r11" bitsize="32"/>
<reg name="r12" bitsize="32"/><reg name="sp" bitsize="32" type="data_ptr"/><reg name="lr" bitsize="32"/>
<reg name="pc" bitsize="32" type="code_ptr"/><reg name="xpsr" bitsize="32"/></feature></target>"#;

pub(crate) trait Target {
    fn register(&self, nth: usize) -> u32;
    fn set_register(&mut self, nth: usize, value: u32);
    /// Reads memory or registers. `None` if there is a hole in the range.
    fn read(&mut self, address: u32, length: u32) -> Option<Vec<u8>>;
    /// Writes memory or registers. `None` if there is a hole in the range.
    fn write(&mut self, address: u32, bytes: &[u8]) -> Option<()>;
    fn set_breakpoint(&mut self, address: u32, on: bool);
    /// Executes one instruction.
    fn step(&mut self);
}

/// The reaction to a packet.
enum Answer {
    Reply(String),
    Go,
    Step,
    Leave,
}

/// The port, and its connection.
#[derive(Debug)]
pub(crate) struct Debugger {
    listener: TcpListener,
    client: Option<TcpStream>,
    received: Vec<u8>,
    halted: bool,
    /// Ends the run, even while the core is halted.
    interrupt: Arc<AtomicBool>,
}

impl Debugger {
    /// A debugger at this port.
    ///
    /// # Errors
    ///
    /// If the port cannot be made non-blocking.
    pub(crate) fn new(listener: TcpListener, interrupt: Arc<AtomicBool>) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            client: None,
            received: Vec::new(),
            halted: false,
            interrupt,
        })
    }

    pub(crate) fn address(&self) -> Option<SocketAddr> {
        self.listener.local_addr().ok()
    }

    /// The core reached a breakpoint.
    pub(crate) fn halt(&mut self) {
        if self.client.is_some() {
            self.halted = true;
            self.send(TRAPPED);
        }
    }

    /// Executes gdb's requests until the core continues. Returns false if the run must end.
    pub(crate) fn attend(&mut self, target: &mut dyn Target) -> bool {
        self.accept();
        while self.receive() || self.halted {
            if self.interrupt.load(Ordering::Relaxed) {
                return false;
            }
            if let Some(packet) = self.take_packet() {
                match answer(&packet, target) {
                    Answer::Reply(reply) => self.send(&reply),
                    Answer::Go => self.halted = false,
                    Answer::Step => {
                        target.step();
                        self.send(TRAPPED);
                    }
                    Answer::Leave => self.leave(),
                }
            }
        }
        true
    }

    fn accept(&mut self) {
        if self.client.is_none()
            && let Ok((stream, _)) = self.listener.accept()
        {
            let is_ready = stream.set_nonblocking(false).is_ok()
                && stream.set_read_timeout(Some(POLL_PERIOD)).is_ok()
                && stream.set_nodelay(true).is_ok();
            self.client = is_ready.then_some(stream);
            self.halted = self.client.is_some();
            self.received.clear();
        }
    }

    fn leave(&mut self) {
        self.send("OK");
        self.client = None;
        self.halted = false;
    }

    /// Receives available bytes. A halted core waits briefly. Returns true if there are any.
    fn receive(&mut self) -> bool {
        let Some(client) = &mut self.client else {
            return false;
        };
        let mut bytes = [0; 1024];
        let waits = self.halted && self.received.is_empty();
        if client.set_nonblocking(!waits).is_err() {
            return false;
        }
        match client.read(&mut bytes) {
            Ok(0) => {
                self.client = None;
                self.halted = false;
            }
            Ok(length) => self.received.extend(&bytes[..length]),
            // No bytes are available.
            Err(_) => {}
        }
        !self.received.is_empty()
    }

    /// The next complete packet, acknowledged.
    fn take_packet(&mut self) -> Option<String> {
        loop {
            match *self.received.first()? {
                INTERRUPT => {
                    self.received.remove(0);
                    self.halted = true;
                    self.send(INTERRUPTED);
                }
                b'$' => break,
                _ => _ = self.received.remove(0),
            }
        }
        let end = self.received.iter().position(|&byte| byte == b'#');
        let Some(end) = end.filter(|end| self.received.len() >= end + 3) else {
            // The packet is incomplete.
            return None;
        };
        let packet: Vec<u8> = self.received.drain(..end + 3).collect();
        self.write(b"+");
        Some(String::from_utf8_lossy(&packet[1..end]).into_owned())
    }

    fn send(&mut self, data: &str) {
        let sum = data.bytes().fold(0u8, u8::wrapping_add);
        self.write(format!("${data}#{sum:02x}").as_bytes());
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(client) = &mut self.client {
            let written = client.set_nonblocking(false).and_then(|()| client.write_all(bytes));
            if written.is_err() {
                self.client = None;
                self.halted = false;
            }
        }
    }
}

fn answer(packet: &str, target: &mut dyn Target) -> Answer {
    let reply = |reply: &str| Answer::Reply(reply.to_owned());
    let done = |result: Option<()>| reply(if result.is_some() { "OK" } else { "E01" });
    let Some((command, rest)) = packet.split_at_checked(1) else {
        return reply("");
    };
    match command {
        "?" => reply(TRAPPED),
        "g" => Answer::Reply((0..REGISTERS).map(|nth| word(target.register(nth))).collect()),
        "G" => done(write_registers(rest, target)),
        "p" => match usize::from_str_radix(rest, 16) {
            Ok(nth) if nth < REGISTERS => Answer::Reply(word(target.register(nth))),
            _ => reply("E01"),
        },
        "P" => done(write_register(rest, target)),
        "m" => match place(rest).and_then(|(address, length)| target.read(address, length)) {
            Some(bytes) => Answer::Reply(bytes.iter().map(|byte| format!("{byte:02x}")).collect()),
            None => reply("E01"),
        },
        "M" => done(write_memory(rest, target)),
        "Z" | "z" => done(breakpoint(rest, command == "Z", target)),
        "c" => Answer::Go,
        "s" => Answer::Step,
        "D" | "k" => Answer::Leave,
        "H" | "T" => reply("OK"),
        "q" => Answer::Reply(query(rest)),
        _ => reply(""),
    }
}

fn query(what: &str) -> String {
    if what.starts_with("Supported") {
        return "PacketSize=800;qXfer:features:read+".to_owned();
    }
    let Some(range) = what.strip_prefix("Xfer:features:read:target.xml:") else {
        return if what == "Attached" { "1" } else { "" }.to_owned();
    };
    let hex = |text: &str| usize::from_str_radix(text, 16).ok();
    let range = range
        .split_once(',')
        .and_then(|(start, length)| Some((hex(start)?, hex(length)?)));
    let Some((start, length)) = range else {
        return "E01".to_owned();
    };
    let rest = TARGET.get(start..).unwrap_or_default();
    match rest.get(..length) {
        Some(part) if part.len() < rest.len() => format!("m{part}"),
        _ => format!("l{rest}"),
    }
}

/// A word in gdb's format: its bytes in order.
fn word(value: u32) -> String {
    value.to_le_bytes().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Bytes from their digits.
fn bytes(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok())
        .collect()
}

fn parse_word(digits: &str) -> Option<u32> {
    Some(u32::from_le_bytes(bytes(digits)?.try_into().ok()?))
}

/// An address and a length: `address,length`.
fn place(text: &str) -> Option<(u32, u32)> {
    let (address, length) = text.split_once(',')?;
    Some((
        u32::from_str_radix(address, 16).ok()?,
        u32::from_str_radix(length, 16).ok()?,
    ))
}

fn write_registers(digits: &str, target: &mut dyn Target) -> Option<()> {
    for nth in 0..REGISTERS {
        target.set_register(nth, parse_word(digits.get(8 * nth..8 * nth + 8)?)?);
    }
    Some(())
}

fn write_register(text: &str, target: &mut dyn Target) -> Option<()> {
    let (nth, digits) = text.split_once('=')?;
    let nth = usize::from_str_radix(nth, 16).ok().filter(|&nth| nth < REGISTERS)?;
    target.set_register(nth, parse_word(digits)?);
    Some(())
}

fn write_memory(text: &str, target: &mut dyn Target) -> Option<()> {
    let (at, digits) = text.split_once(':')?;
    let (address, length) = place(at)?;
    let bytes = bytes(digits).filter(|bytes| bytes.len() == length as usize)?;
    target.write(address, &bytes)
}

/// A software or hardware breakpoint of gdb: `kind,address,length`.
fn breakpoint(text: &str, on: bool, target: &mut dyn Target) -> Option<()> {
    let (kind, rest) = text.split_once(',')?;
    let (address, _) = place(rest)?;
    if !matches!(kind, "0" | "1") {
        return None;
    }
    target.set_breakpoint(address, on);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Words {
        registers: [u32; REGISTERS],
        memory: [u8; 8],
        breakpoints: Vec<u32>,
        steps: u32,
    }

    impl Target for Words {
        fn register(&self, nth: usize) -> u32 {
            self.registers[nth]
        }

        fn set_register(&mut self, nth: usize, value: u32) {
            self.registers[nth] = value;
        }

        fn read(&mut self, address: u32, length: u32) -> Option<Vec<u8>> {
            let range = address as usize..(address + length) as usize;
            self.memory.get(range).map(<[u8]>::to_vec)
        }

        fn write(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
            let range = address as usize..address as usize + bytes.len();
            self.memory.get_mut(range)?.copy_from_slice(bytes);
            Some(())
        }

        fn set_breakpoint(&mut self, address: u32, on: bool) {
            self.breakpoints.retain(|&breakpoint| breakpoint != address);
            if on {
                self.breakpoints.push(address);
            }
        }

        fn step(&mut self) {
            self.steps += 1;
        }
    }

    /// A debugger with a connected gdb, whose first packet halts the core.
    fn connected() -> (Debugger, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let debugger = Debugger::new(listener, Arc::default()).unwrap();
        let gdb = TcpStream::connect(debugger.address().unwrap()).unwrap();
        (debugger, gdb)
    }

    fn packet(data: &str) -> Vec<u8> {
        let sum = data.bytes().fold(0u8, u8::wrapping_add);
        format!("${data}#{sum:02x}").into_bytes()
    }

    #[test]
    fn gdb_reads_and_writes_registers_and_memory() {
        let (mut debugger, mut gdb) = connected();
        let mut words = Words::default();
        for (request, reply) in [
            ("P1=78563412", "OK"),
            ("p1", "78563412"),
            ("M4,2:aabb", "OK"),
            ("m4,4", "aabb0000"),
            ("m6,4", "E01"),
            ("Z0,8000100,2", "OK"),
            ("vMustReplyEmpty", ""),
        ] {
            gdb.write_all(&packet(request)).unwrap();
            gdb.write_all(&packet("c")).unwrap();
            debugger.halted = true;
            assert!(debugger.attend(&mut words));
            let mut expected = b"+".to_vec();
            expected.extend(packet(reply));
            expected.push(b'+');
            let mut got = vec![0; expected.len()];
            gdb.read_exact(&mut got).unwrap();
            assert_eq!(got, expected, "{request}");
        }
        assert_eq!(
            (words.registers[1], &words.breakpoints[..]),
            (0x1234_5678, &[0x0800_0100][..])
        );
    }

    #[test]
    fn gdb_halts_steps_and_resumes_core() {
        let (mut debugger, mut gdb) = connected();
        let mut words = Words::default();
        gdb.write_all(&[packet("?"), packet("s"), packet("c")].concat())
            .unwrap();
        assert!(debugger.attend(&mut words));
        assert_eq!((words.steps, debugger.halted), (1, false));
        debugger.halt();
        gdb.write_all(&packet("D")).unwrap();
        assert!(debugger.attend(&mut words));
        assert!(debugger.client.is_none() && !debugger.halted);
    }

    #[test]
    fn halted_core_ends_on_request() {
        let (mut debugger, _gdb) = connected();
        debugger.interrupt.store(true, Ordering::Relaxed);
        assert!(!debugger.attend(&mut Words::default()));
    }
}
