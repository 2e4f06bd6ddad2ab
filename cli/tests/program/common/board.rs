//! An adapter with a Ling arm, on two ptys: its serial port and its control port. The adapter's own state machine runs in
//! real time, without a UART: bytes between it and the arm take no time.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use std::{fs, io};

use armwire_bridge::can::Node;
use armwire_bridge::config::{ArmKind, Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{Identity, MAX_FRAME};
use armwire_bridge::start::Recovery;
use armwire_bridge::store::Saved;
use armwire_bridge::{Action, Bridge, PACKET, Start, Transmit, UartEvent, UsbEvent, time};
use armwire_sim::ling::{Config as ArmConfig, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;

/// The configuration in flash, which is never loaded.
const SAVED: Saved = Saved::Config(Config {
    arm: ArmKind::Ling,
    poll: Poll::Hertz(50),
    can: Can {
        node: Node::MAX,
        bit_rate: 500_000,
        data_bit_rate: None,
        telemetry_hz: 0,
        commands: false,
        command_timeout_ms: 100,
        unsolicited: false,
    },
    host_timeout: HostTimeout {
        after_ms: 300,
        torque_off: true,
    },
});

/// An adapter, served until dropped.
pub(crate) struct Board {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// The serial port's pty.
    pub(crate) port: String,
    /// The name of the control port for the command.
    pub(crate) control: String,
    /// A file that exists while the chip is in its boot loader.
    pub(crate) boot_loader: PathBuf,
}

impl Board {
    pub(crate) fn start(name: &str) -> Self {
        Self::start_as(name, None)
    }

    /// Starts an adapter in recovery.
    pub(crate) fn start_as(name: &str, recovery: Option<Recovery>) -> Self {
        Self::serve(name, identity(), recovery)
    }

    /// Starts an adapter without CAN.
    pub(crate) fn start_without_can(name: &str) -> Self {
        let identity = Identity {
            no_can: true,
            ..identity()
        };
        Self::serve(name, identity, None)
    }

    fn serve(name: &str, identity: Identity, recovery: Option<Recovery>) -> Self {
        let ports = [(); 2].map(|()| Pty::open(None).unwrap());
        let [port, control] = ports.each_ref().map(|pty| pty.path().to_str().unwrap().to_owned());
        let control = format!("control:{control}");
        let stop = Arc::default();
        let stopped = Arc::clone(&stop);
        let boot_loader = super::free_path(&format!("{name}-boot-loader"));
        let marker = boot_loader.clone();
        let thread = Some(thread::spawn(move || {
            Served::new(ports, marker, identity, recovery).serve(&stopped)
        }));
        Self {
            stop,
            thread,
            port,
            control,
            boot_loader,
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A failing test must not panic twice.
        let _ = self.thread.take().unwrap().join();
        let _ = fs::remove_file(&self.boot_loader);
    }
}

/// The identity of a board with classic CAN.
fn identity() -> Identity {
    Identity {
        version: armwire_bridge::control::VERSION,
        firmware: "1.2.3".try_into().unwrap(),
        commit: "1a2b3c4d5e6f".try_into().unwrap(),
        board: "virtual".try_into().unwrap(),
        serial: "0123456789AB".try_into().unwrap(),
        can_fd: false,
        no_can: false,
        chip: 0x1001_6413,
    }
}

struct Served {
    bridge: Bridge,
    arm: LingArm,
    port: Pty,
    control: Pty,
    boot_loader: PathBuf,
}

impl Served {
    fn new([port, control]: [Pty; 2], boot_loader: PathBuf, identity: Identity, recovery: Option<Recovery>) -> Self {
        let start = Start {
            recovery,
            ..Start::default()
        };
        let mut bridge = Bridge::new(identity, Config::default(), start);
        bridge.usb_event(UsbEvent::Configured(true), time::Instant::ZERO);
        bridge.usb_event(UsbEvent::Dtr(true), time::Instant::ZERO);
        Self {
            bridge,
            arm: LingArm::new(ArmConfig::follower()),
            port,
            control,
            boot_loader,
        }
    }

    fn serve(mut self, stop: &AtomicBool) {
        let start = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let now = time::Instant::from_micros(start.elapsed().as_micros() as u64);
            self.receive(now).unwrap();
            if self.bridge.timeout().is_some_and(|at| at <= now) {
                self.bridge.tick(now);
            }
            self.exchange(now);
            self.act(now);
            self.transmit(now).unwrap();
            self.control.wait(Some(Duration::from_micros(500))).unwrap();
        }
    }

    /// Receives bytes of the host, if there is room for them.
    fn receive(&mut self, now: time::Instant) -> io::Result<()> {
        let mut packet = [0; PACKET];
        if self.bridge.update(now).usb_room {
            match self.port.read(&mut packet)? {
                0 => {}
                n => {
                    self.bridge.usb_received(&packet[..n], now);
                }
            }
        }
        if self.bridge.update(now).control_room {
            match self.control.read(&mut packet)? {
                0 => {}
                n => {
                    self.bridge.control_received(&packet[..n], now);
                }
            }
        }
        Ok(())
    }

    /// Exchanges bytes between the adapter and the arm.
    fn exchange(&mut self, now: time::Instant) {
        let arm = &mut self.arm;
        let mut send = |bytes: &[u8], _| {
            for &byte in bytes {
                arm.receive(now, byte);
            }
        };
        while let Some(transmit) = self.bridge.uart_transmit(&mut [0; MAX_FRAME], now, &mut send) {
            if let Transmit::Configure(uart) = transmit {
                self.bridge.uart_event(UartEvent::Configured(uart), now);
            }
        }
        while let Some(byte) = self.arm.transmit(now) {
            self.bridge.uart_received(&[byte], now);
        }
        self.bridge.uart_event(UartEvent::Idle, now);
    }

    fn act(&mut self, now: time::Instant) {
        match self.bridge.action(now) {
            // The configuration need not be stored: this board never restarts.
            Some(Action::Save(..) | Action::Replace(_) | Action::Reset(_) | Action::Erase) => {
                self.bridge.saved(Ok(()), now);
            }
            Some(Action::Load) => self.bridge.loaded(Ok(SAVED), now),
            Some(Action::RestartIntoBootLoader) => fs::write(&self.boot_loader, "").unwrap(),
            Some(Action::Restart | Action::RestartCan(_)) | None => {}
        }
    }

    /// Transmits bytes to the host.
    fn transmit(&mut self, now: time::Instant) -> io::Result<()> {
        let mut packet = [0; PACKET];
        while let Some(n) = self.bridge.usb_transmit(&mut packet) {
            self.port.write(&packet[..n])?;
        }
        while self.bridge.update(now).control {
            if let Some(n) = self.bridge.control_transmit(&mut packet, now) {
                self.control.write(&packet[..n])?;
            }
        }
        Ok(())
    }
}
