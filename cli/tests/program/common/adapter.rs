//! An adapter on a CAN bus with a Ling arm, behind an SLCAN adapter on a pty.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Ling, MAX_FRAME};
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::config::Config as AdapterConfig;
use armwire_bridge::control::{
    self, FromAdapter, FromHost, Identity, LineReservation, LineState, MAX_MESSAGE, Reply, Request,
};
use armwire_bridge::isotp::{Config, Endpoint, Event, Link, RefusedPdu};
use armwire_bridge::slcan::Status;
use armwire_bridge::{LineCoding, time};
use armwire_sim::ling::{Config as ArmConfig, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use armwire_sim::slcan::Adapter as Slcan;

use super::uf2;

/// The default bit rate of the bus.
pub(crate) const BIT_RATE: u32 = 500_000;
/// The default node id of the adapter.
pub(crate) const NODE: u8 = 3;

/// A CAN bus, served until dropped.
pub(crate) struct CanBus {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// The pty.
    pub(crate) path: String,
    /// Every frame that a program sent.
    pub(crate) sent: Arc<Mutex<Vec<Frame>>>,
    /// True if the line is reserved at 9600 baud. Otherwise the adapter does not support the request.
    pub(crate) is_reserved: Arc<AtomicBool>,
    /// A file that exists while the adapter is in its boot loader, where it answers nothing.
    pub(crate) boot_loader: PathBuf,
}

impl CanBus {
    pub(crate) fn start() -> Self {
        Self::start_as(BIT_RATE, NODE)
    }

    /// The name of the adapter for the command.
    pub(crate) fn port(&self) -> String {
        format!("slcan:{}@{BIT_RATE}/{NODE}", self.path)
    }

    /// Starts a bus with this bit rate, and the adapter as this node.
    pub(crate) fn start_as(bit_rate: u32, node: u8) -> Self {
        Self::start_with(bit_rate, node, "virtual", super::free_path("boot-loader"))
    }

    /// Starts a bus with an adapter on the board of this name.
    pub(crate) fn start_board(board: &str) -> Self {
        Self::start_with(BIT_RATE, NODE, board, super::free_path("boot-loader"))
    }

    /// Starts a bus with an adapter on a Pico. The drive of its boot loader is this folder.
    pub(crate) fn start_pico(drive: &Path) -> Self {
        Self::start_with(BIT_RATE, NODE, "pico", drive.join(uf2::INFO))
    }

    fn start_with(bit_rate: u32, node: u8, board: &str, boot_loader: PathBuf) -> Self {
        let node = Node::new(node).unwrap();
        let pty = Pty::open(None).unwrap();
        let path = pty.path().to_str().unwrap().to_owned();
        let (stop, sent, is_reserved) = (Arc::default(), Arc::default(), Arc::default());
        let (stopped, log, reserved) = (Arc::clone(&stop), Arc::clone(&sent), Arc::clone(&is_reserved));
        let adapter = Adapter::new(node, board, reserved, boot_loader.clone());
        let thread = Some(thread::spawn(move || serve(&pty, bit_rate, adapter, &stopped, &log)));
        Self {
            stop,
            thread,
            path,
            sent,
            is_reserved,
            boot_loader,
        }
    }
}

impl Drop for CanBus {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A failing test must not panic twice.
        let _ = self.thread.take().unwrap().join();
        let _ = fs::remove_file(&self.boot_loader);
    }
}

fn serve(pty: &Pty, bit_rate: u32, mut adapter: Adapter, stop: &AtomicBool, log: &Mutex<Vec<Frame>>) {
    let start = Instant::now();
    let mut slcan = Slcan::new();
    let mut bytes = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        let now = time::Instant::from_micros(start.elapsed().as_micros() as u64);
        let n = pty.read(&mut bytes).unwrap();
        for &byte in &bytes[..n] {
            let mut sent = None;
            slcan.receive(byte, |frame| {
                sent = frame.to_adapter();
                true
            });
            let Some(frame) = sent else { continue };
            log.lock().unwrap().push(frame);
            match slcan.bit_rate() {
                Some(rate) if rate == bit_rate && adapter.boot_loader.exists() => {}
                Some(rate) if rate == bit_rate => adapter.receive(&frame, now),
                _ => slcan.report(Status::BUS_ERROR.and(Status::ERROR_PASSIVE)),
            }
        }
        uf2::take_file(&adapter.boot_loader);
        for frame in adapter.transmit(now) {
            slcan.on_frame(&frame.into(), now);
        }
        let n = pty.write(slcan.output()).unwrap();
        slcan.output().drain(..n);
        pty.wait(Some(Duration::from_millis(1))).unwrap();
    }
}

/// The CAN side of an adapter: ISO-TP to the arm and to the control port.
struct Adapter {
    arm: LingArm,
    answers: Decoder<Ling, MAX_FRAME>,
    to_arm: Endpoint<MAX_FRAME, MAX_FRAME>,
    control: Endpoint<MAX_MESSAGE, MAX_MESSAGE>,
    config: AdapterConfig,
    board: String,
    is_reserved: Arc<AtomicBool>,
    boot_loader: PathBuf,
}

impl Adapter {
    fn new(node: Node, board: &str, is_reserved: Arc<AtomicBool>, boot_loader: PathBuf) -> Self {
        let mut config = AdapterConfig::default();
        config.can.node = node;
        Self {
            arm: LingArm::new(ArmConfig::follower()),
            answers: Decoder::new(),
            to_arm: Endpoint::new(Config::new(Link::Classic, Function::ArmAnswer.id(node))),
            control: Endpoint::new(Config::new(Link::Classic, Function::ControlAnswer.id(node))),
            config,
            board: board.to_owned(),
            is_reserved,
            boot_loader,
        }
    }

    fn receive(&mut self, frame: &Frame, now: time::Instant) {
        let events = match Function::of(frame.id()) {
            Some((Function::ArmRequest, node)) if node == self.config.can.node => {
                self.to_arm.receive(frame.data(), now)
            }
            Some((Function::ControlRequest, node)) if node == self.config.can.node => {
                self.control.receive(frame.data(), now)
            }
            _ => return,
        };
        // This bus loses no frame, but on a busy system a host repeats its request early.
        for event in events {
            assert!(
                matches!(event, Event::Received | Event::Refused(RefusedPdu::Occupied { .. })),
                "{event:?}"
            );
        }
    }

    /// The frames that the adapter sends now.
    fn transmit(&mut self, now: time::Instant) -> Vec<Frame> {
        let is_reserved = self.is_reserved.load(Ordering::Relaxed);
        if let Some(request) = self.to_arm.received() {
            for &byte in request.iter().filter(|_| !is_reserved) {
                self.arm.receive(now, byte);
            }
            self.to_arm.release();
        }
        if !self.to_arm.is_sending() {
            while let Some(byte) = self.arm.transmit(now) {
                assert!(self.answers.push(&[byte]).is_empty());
                if let Some(answer) = self.answers.next(&Ling, ()) {
                    assert_eq!(answer.kind, Kind::Frame);
                    self.to_arm.send(answer.bytes).unwrap();
                    break;
                }
            }
        }
        if !self.control.is_sending()
            && let Some(request) = self.control.received()
        {
            let reply = self.reply(control::decode(request).unwrap());
            self.control.release();
            let mut pdu = [0; MAX_MESSAGE];
            let n = control::encode(&reply, &mut pdu).unwrap();
            self.control.send(&pdu[..n]).unwrap();
        }
        let mut frames = Vec::new();
        frames.extend(std::iter::from_fn(|| self.to_arm.transmit(now)));
        frames.extend(std::iter::from_fn(|| self.control.transmit(now)));
        frames
    }

    fn reply(&self, message: FromHost) -> FromAdapter {
        let reply = match message.request {
            Request::Identify => Reply::Identity(Identity {
                version: control::VERSION,
                firmware: "1.2.3".try_into().unwrap(),
                board: self.board.as_str().try_into().unwrap(),
                serial: "0123456789AB".try_into().unwrap(),
                ..Identity::default()
            }),
            Request::GetConfig => Reply::Config(self.config),
            Request::GetLine if self.is_reserved.load(Ordering::Relaxed) => Reply::Line(LineState {
                coding: LineCoding {
                    baud: 9_600,
                    ..LineCoding::LING
                },
                reservation: LineReservation::OtherRate,
                ..LineState::default()
            }),
            Request::RestartIntoBootLoader => {
                fs::write(&self.boot_loader, uf2::DESCRIPTION).unwrap();
                Reply::Done
            }
            _ => Reply::Unsupported {
                version: control::VERSION,
            },
        };
        FromAdapter::Reply {
            sequence: message.sequence,
            reply,
        }
    }
}
