//! Injection of each fault.

use armwire::ling::{self, MAX_FRAME};
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::{Reply, Request};
use armwire_bridge::{Counters, Duration, LineCoding};
use armwire_virtual_board::line::Fault as LineFault;
use armwire_virtual_board::usb::Direction;
use armwire_virtual_board::usb::host::Request as UsbRequest;
use armwire_virtual_board::{Error, Nanos};

use super::super::polled;
use super::Result;
use super::cable::{Damage, Way};
use super::matrix::Fault;
use super::rig::Rig;

/// Time limit from the planning of a fault to its occurrence.
const FAULT_TIMEOUT: Nanos = Nanos::from_millis(200);

/// Time limit for the firmware's restart: the watchdog's two seconds, with a clock up to 50 % slow, and the boot.
const RESTART_TIMEOUT: Nanos = Nanos::from_millis(4_500);

/// The symbol of the firmware's clock. Its first word is the borrow flag of the queue in it. The name and layout depend
/// on the compiler: if they change, the firmware does not panic, and the run fails.
const CLOCK: &str = "5board4time5CLOCK";
const IN_USE: u32 = 1;

/// Time limit for the device to accept the next SETUP.
const SETUP_TIMEOUT: Nanos = Nanos::from_millis(100);

/// Requests of the serial port (CDC PSTN 1.2, table 13).
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;

/// Length of a frame that fills a packet, and the number of 11-byte requests that fill packets.
const PACKET: usize = armwire_bridge::PACKET;
const FULL: u32 = 64;

impl Rig {
    /// Injects the fault. Returns the time of its end.
    ///
    /// Idle hosts resume their requests.
    pub(super) fn inject(&mut self, fault: Fault) -> Result<Nanos> {
        self.hosts.set_requesting(true);
        // Discards the traffic before the fault.
        self.traffic.count(&mut self.board);
        match fault {
            Fault::ByteDropped => self.damage(Way::FromArm, Damage::Drop)?,
            Fault::ByteDuplicated => self.damage(Way::FromArm, Damage::Duplicate)?,
            Fault::ByteLate => {
                let span = Duration::from_micros(self.random.between(100, 20_000));
                self.damage(Way::FromArm, Damage::Delay(span))?;
            }
            Fault::ByteCorrupted => {
                let bit = 1 << self.random.between(0, 7);
                self.damage(Way::FromArm, Damage::Corrupt(bit))?;
            }
            Fault::RequestByteDropped => self.damage(Way::ToArm, Damage::Drop)?,
            Fault::RequestByteCorrupted => {
                let bit = 1 << self.random.between(0, 7);
                self.damage(Way::ToArm, Damage::Corrupt(bit))?;
            }
            Fault::FramingError => self.plan(LineFault::Framing)?,
            Fault::NoiseFlag => self.plan(LineFault::Noise)?,
            Fault::Overrun => self.plan(LineFault::Overrun)?,
            Fault::NoiseBurst => self.noise_burst()?,
            Fault::InterruptsMasked => self.mask_interrupts()?,
            Fault::ArmCablePulled => self.without_arm(1_000, 60_000)?,
            Fault::ArmReset => {
                self.board.with_arm(|cable| cable.arm().restart());
                // The boot of the arm.
                self.without_arm(5_000, 50_000)?;
            }
            Fault::NakStorm => {
                // Up to 50 ms, as each NAK delays a packet to the device.
                for direction in [Direction::In, Direction::Out] {
                    let count = self.random.between(100, 1_000) as u32;
                    self.board.usb().inject_naks(direction, count);
                }
            }
            Fault::BusReset => {
                self.board.usb().reset_bus();
                self.disconnect_usb();
                self.work_between(1_000, 60_000)?;
                return self.reconnect_usb_now();
            }
            Fault::Suspend => {
                self.board.usb().suspend();
                self.work_between(5_000, 60_000)?;
                self.board.usb().resume();
            }
            Fault::Unplug => {
                self.board.usb().detach();
                self.disconnect_usb();
                self.work_between(5_000, 60_000)?;
                return self.reconnect_usb_now();
            }
            Fault::ControlAbandoned => {
                for _ in 0..self.random.between(1, 5) {
                    self.abandon_control()?;
                }
                self.expect_setup()?;
            }
            Fault::ResetInControl => {
                self.abandon_control()?;
                self.board.usb().reset_bus();
                self.disconnect_usb();
                self.work_between(1_000, 60_000)?;
                return self.reconnect_usb_now();
            }
            Fault::UnplugInControl => {
                self.abandon_control()?;
                self.board.usb().detach();
                self.disconnect_usb();
                self.work_between(5_000, 60_000)?;
                return self.reconnect_usb_now();
            }
            Fault::HaltCleared => {
                for _ in 0..self.random.between(1, 4) {
                    for direction in [Direction::In, Direction::Out] {
                        self.board.usb().clear_halt(direction)?;
                    }
                    self.expect_setup()?;
                    self.work_between(0, 2_000)?;
                }
            }
            Fault::InterfaceSetAgain => {
                for _ in 0..self.random.between(1, 4) {
                    self.board.usb().set_interface()?;
                    self.expect_setup()?;
                    self.work_between(0, 2_000)?;
                }
            }
            Fault::ConfigurationSetAgain => {
                self.board.usb().set_configuration(1)?;
                let now = self.board.now();
                self.expect_setup()?;
                self.disconnect_usb();
                self.open_usb();
                return Ok(now);
            }
            Fault::NeverReads => {
                self.board.usb().set_reading(false);
                self.ignore_window(true);
                self.work_between(100_000, 200_000)?;
                self.ignore_window(false);
                self.board.usb().set_reading(true);
            }
            Fault::FullPackets => self.full_packets()?,
            Fault::BusOff => {
                self.board.can().short();
                self.work_between(1_000, 30_000)?;
                self.board.can().release();
            }
            Fault::ErrorPassive => {
                let count = self.random.between(17, 30) as u32;
                let broken = self.traffic.broken_frames + count;
                self.board.can().destroy_next(count);
                self.await_fault(&mut |rig| rig.traffic.broken_frames >= broken)?;
            }
            Fault::NoAcknowledge => {
                self.board.can().set_acknowledging(false);
                self.work_between(2_000, 30_000)?;
                self.board.can().set_acknowledging(true);
            }
            Fault::Flood => {
                let first = Id::new(0).map_err(|error| format!("{error:?}"))?;
                let frame = Frame::new(first, &[0x5A; 8]).map_err(|error| format!("{error:?}"))?;
                self.board.can().flood(Some(&frame))?;
                self.work_between(2_000, 30_000)?;
                self.board.can().flood(None)?;
            }
            Fault::OutOfSequence => {
                // A consecutive frame with an unexpected sequence number.
                let number = self.random.between(5, 15) as u8;
                let id = Function::ArmRequest.id(Node::default());
                let frame = Frame::new(id, &[0x20 | number; 8]).map_err(|error| format!("{error:?}"))?;
                self.board.can().send_from(1, &frame)?;
                self.await_fault(&mut |rig| rig.board.can().unsent() == 0)?;
            }
            Fault::PowerLossInSave => return self.lose_power_in_save(),
            Fault::Panic => return self.panic(),
            Fault::Watchdog => {
                self.board.hold_core();
                return self.await_restart();
            }
        }
        Ok(self.board.now())
    }

    /// Runs the load until the fault has happened.
    pub(super) fn await_fault(&mut self, happened: &mut dyn FnMut(&mut Self) -> bool) -> Result {
        if self.work_until(FAULT_TIMEOUT, happened)? {
            Ok(())
        } else {
            Err("the fault did not occur".into())
        }
    }

    /// Damages one of the next bytes on the cable.
    fn damage(&mut self, way: Way, damage: Damage) -> Result {
        self.requests_damaged |= way == Way::ToArm;
        let after = self.random.between(0, 14) as u32;
        let hits = self.board.with_arm(|cable| {
            cable.damage(way, after, damage);
            cable.hits()
        });
        self.await_fault(&mut |rig| rig.board.with_arm(|cable| cable.hits()) > hits)?;
        if let Damage::Delay(span) = damage {
            self.work(span.into())?;
        }
        Ok(())
    }

    /// Plans a line fault for one of the next bytes from the arm.
    pub(super) fn plan(&mut self, fault: LineFault) -> Result {
        let met = |rig: &Self| rig.traffic.framing_faults + rig.traffic.noise_faults + rig.traffic.overruns;
        let before = met(self);
        // A byte without a predecessor cannot overrun it, and has no effect. The fault is then planned again, once that
        // byte has passed: two consecutive overruns count as one in the receiver.
        for _ in 0..20 {
            let after = self.random.between(0, 14) as u32;
            self.board.uart().plan_fault(after.into(), fault);
            // One more byte may already be on the line.
            let past = self.traffic.bytes_from_arm + after + 2;
            self.await_fault(&mut |rig| met(rig) > before || rig.traffic.bytes_from_arm >= past)?;
            self.traffic.count(&mut self.board);
            if met(self) > before {
                return Ok(());
            }
        }
        Err("the fault did not occur".into())
    }

    /// Sends noise on the arm's line, with errors that a receiver detects.
    fn noise_burst(&mut self) -> Result {
        let count = self.random.between(20, 200);
        let bytes: Vec<u8> = (0..count).map(|_| self.random.any() as u8).collect();
        for nth in 0..count {
            let faults = [
                None,
                Some(LineFault::Framing),
                Some(LineFault::Noise),
                Some(LineFault::Break),
            ];
            if let Some(fault) = self.random.one_of(&faults) {
                self.board.uart().plan_fault(nth, fault);
            }
        }
        self.board.with_arm(|cable| cable.arm().send(&bytes));
        let sent_by_arm = self.traffic.bytes_from_arm + count as u32;
        self.await_fault(&mut |rig| rig.traffic.bytes_from_arm >= sent_by_arm)
    }

    /// Sends from the arm without a pause while the core is halted: more than the receive ring holds.
    fn mask_interrupts(&mut self) -> Result {
        const BYTES_PER_MILLISECOND: u64 = 100;
        const NO_FRAME: u8 = 0x55;
        let millis = self.random.between(11, 30);
        let noise = vec![NO_FRAME; (millis * BYTES_PER_MILLISECOND) as usize];
        self.board.with_arm(|cable| cable.arm().send(&noise));
        self.board.hold_core();
        self.work(Nanos::from_millis(millis))?;
        self.board.let_core_go();
        Ok(())
    }

    /// Unplugs the cable for a while.
    fn without_arm(&mut self, low: u64, high: u64) -> Result {
        self.requests_damaged = true;
        self.board.with_arm(|cable| cable.set_out(true));
        self.work_between(low, high)?;
        self.board.with_arm(|cable| cable.set_out(false));
        Ok(())
    }

    fn ignore_window(&mut self, ignores_window: bool) {
        if let Some(usb) = &mut self.hosts.usb {
            usb.ignores_window = ignores_window;
        }
    }

    /// Sends requests and frames of the arm that fill packets exactly: only an empty packet shows the host the end of
    /// the transfer.
    fn full_packets(&mut self) -> Result {
        let mut frame = [0; MAX_FRAME];
        let data = [0x11; PACKET - ling::OVERHEAD];
        let len = ling::Frame {
            command: 0x7E,
            function: 0x00,
            data: &data,
        }
        .encode(&mut frame)
        .map_err(|error| format!("{error:?}"))?;
        let count = self.random.between(1, 3) as usize;
        self.unasked.extend(vec![frame[..len].to_vec(); count]);
        self.board
            .with_arm(|cable| cable.arm().send(&frame[..len].repeat(count)));
        if let Some(usb) = &mut self.hosts.usb {
            usb.request_burst(&mut self.board, FULL);
        }
        Ok(())
    }

    /// Reconnects the device. Returns the time.
    fn reconnect_usb_now(&mut self) -> Result<Nanos> {
        let now = self.board.now();
        self.reconnect_usb();
        Ok(now)
    }

    /// Abandons a control transfer in a random stage.
    fn abandon_control(&mut self) -> Result {
        let (kind, request) = Counters::READ_REQUEST;
        let requests = [
            UsbRequest::read(0xA1, GET_LINE_CODING, 0, 0, 7),
            UsbRequest::write(0x21, SET_LINE_CODING, 0, 0, LineCoding::LING.to_cdc().to_vec()),
            UsbRequest::read(kind, request, 0, 0, Counters::MAX_LEN as u16),
        ];
        let which = self.random.between(0, requests.len() as u64 - 1) as usize;
        let span = Duration::from_micros(self.random.between(0, 400));
        self.board.usb().abandon(requests[which].clone(), span)?;
        Ok(())
    }

    /// Checks that the device accepts the next SETUP in time.
    fn expect_setup(&mut self) -> Result {
        let before = self.board.now();
        let coding = self.board.usb().line_coding()?;
        let took = self.board.now().since(before);
        if coding.is_none() || took > SETUP_TIMEOUT {
            return Err(format!("a control transfer took {took}, and the line coding is {coding:?}").into());
        }
        Ok(())
    }

    /// Cuts the power during a save of the configuration, and restores it. The configuration must be the old or the new
    /// one.
    fn lose_power_in_save(&mut self) -> Result<Nanos> {
        let [first, old, new] = [40, 50, 70].map(|hertz| Config {
            poll: Poll::Hertz(hertz),
            ..Config::default()
        });
        // The first save takes more flash operations than later ones.
        self.order(Request::SetConfig(first))?;
        self.order(Request::SaveConfig)?;
        let before = self.board.flash_operations();
        self.order(Request::SetConfig(old))?;
        self.order(Request::SaveConfig)?;
        let operations = u64::from(self.board.flash_operations() - before);
        self.order(Request::SetConfig(new))?;
        let after = self.random.between(0, operations - 1) as u32;
        self.board.cut_power_after(after);
        let subscriber = self.hosts.subscriber.as_mut().ok_or("no subscriber")?;
        subscriber.control.send(&mut self.board, Request::SaveConfig);
        match self.work_until(FAULT_TIMEOUT, &mut |_| false) {
            Err(error) if matches!(error.downcast_ref(), Some(Error::PowerCut { .. })) => {}
            Err(error) => return Err(error),
            Ok(_) => return Err("the power was not cut".into()),
        }
        self.disconnect_usb();
        self.board.power_cycle()?;
        let now = self.board.now();
        self.reconnect_usb();
        let subscriber = self.hosts.subscriber.as_mut().ok_or("no subscriber")?;
        let found = subscriber.control.call(&mut self.board, Request::GetConfig);
        if found != Reply::Config(old) && found != Reply::Config(new) {
            return Err(format!("a configuration that was never saved: {found:?}").into());
        }
        self.configure(polled(200))?;
        Ok(now)
    }

    fn order(&mut self, request: Request) -> Result {
        let subscriber = self.hosts.subscriber.as_mut().ok_or("no subscriber")?;
        subscriber.control.order(&mut self.board, request);
        Ok(())
    }

    /// Corrupts memory: the firmware finds its queue borrowed, and panics.
    fn panic(&mut self) -> Result<Nanos> {
        let clock = self.board.symbol(CLOCK).ok_or("the image has no symbol of a clock")?;
        // A user of the queue at that instant clears the flag when done.
        for _ in 0..10 {
            self.board.write_word(clock, IN_USE)?;
            match self.work_until(Nanos::from_millis(20), &mut |_| false) {
                Err(error) if matches!(error.downcast_ref(), Some(Error::Crashed { .. })) => {
                    return self.await_restart();
                }
                Err(error) => return Err(error),
                Ok(_) => {}
            }
        }
        Err("the firmware did not panic".into())
    }

    /// Waits for the restart of the board, and reconnects.
    fn await_restart(&mut self) -> Result<Nanos> {
        if !self.work_until(RESTART_TIMEOUT, &mut |rig| !rig.is_open())? {
            return Err(format!("the board did not restart in {RESTART_TIMEOUT}").into());
        }
        let now = self.board.now();
        self.disconnect_usb();
        self.set_up_again()?;
        Ok(now)
    }
}
