//! Injection of each fault.

use armwire::ling;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::{Reply, Request};
use armwire_bridge::{Counters, Duration, LineCoding, PACKET};
use armwire_virtual_board::line::{Direction, Fault as LineFault};
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::host::Request as UsbRequest;
use armwire_virtual_board::{Error, Nanos};

use super::super::requests::encoded;
use super::Result;
use super::cable::Damage;
use super::matrix::Fault;
use super::rig::Rig;

/// Time limit from the planning of a fault to its occurrence.
const FAULT_TIMEOUT: Nanos = Nanos::from_millis(200);

/// Time limit for the firmware's restart: the watchdog's two seconds, with a clock up to 50 % slow, and the boot.
const RESTART_TIMEOUT: Nanos = Nanos::from_millis(4_500);

/// The symbol of the firmware's clock. Its first word is the borrow flag of the queue in it. The name and layout depend
/// on the compiler: if they change, the firmware does not panic, and the run fails.
const CLOCK: &str = "5board6timers5CLOCK";
const IN_USE: u32 = 1;

/// Time limit for the device to accept the next SETUP.
const SETUP_TIMEOUT: Nanos = Nanos::from_millis(100);

/// Requests of the serial port (CDC PSTN 1.2, table 13).
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;

/// Number of 11-byte requests that fill packets exactly.
const FULL_BURST: u32 = 64;

impl Rig {
    /// Injects the fault. Returns the time of its end.
    ///
    /// Idle hosts resume their requests.
    pub(super) fn inject(&mut self, fault: Fault) -> Result<Nanos> {
        self.hosts.set_paused(false);
        // Discards the traffic before the fault.
        self.traffic.count(&mut self.board);
        match fault {
            Fault::ByteDropped => self.damage(Direction::ToBoard, Damage::Drop)?,
            Fault::ByteDuplicated => self.damage(Direction::ToBoard, Damage::Duplicate)?,
            Fault::ByteLate => {
                let span = Duration::from_micros(self.random.between(100, 20_000));
                self.damage(Direction::ToBoard, Damage::Delay(span))?;
                self.work(span.into())?;
            }
            Fault::ByteCorrupted => self.flip_bit(Direction::ToBoard)?,
            Fault::RequestByteDropped => self.damage(Direction::ToArm, Damage::Drop)?,
            Fault::RequestByteCorrupted => self.flip_bit(Direction::ToArm)?,
            Fault::FramingError => self.plan_line_fault(LineFault::Framing)?,
            Fault::NoiseFlag => self.plan_line_fault(LineFault::Noise)?,
            Fault::Overrun => self.plan_line_fault(LineFault::Overrun)?,
            Fault::NoiseBurst => self.noise_burst()?,
            Fault::InterruptsMasked => self.mask_interrupts()?,
            Fault::ArmCablePulled => self.without_arm(1_000, 60_000)?,
            Fault::ArmReset => {
                self.board.with_arm(|cable| cable.arm.restart());
                // The boot of the arm.
                self.without_arm(5_000, 50_000)?;
            }
            Fault::NakStorm => {
                // Up to 50 ms, as each NAK delays a packet to the device.
                for direction in [UsbDirection::In, UsbDirection::Out] {
                    let count = self.random.between(100, 1_000) as u32;
                    self.board.usb().inject_naks(direction, count);
                }
            }
            Fault::BusReset => return self.reset_bus(),
            Fault::Suspend => {
                self.board.usb().suspend();
                self.work_between(5_000, 60_000)?;
                self.board.usb().resume();
            }
            Fault::Unplug => return self.unplug(),
            Fault::ControlAbandoned => {
                for _ in 0..self.random.between(1, 5) {
                    self.abandon_control()?;
                }
                self.expect_setup()?;
            }
            Fault::ResetInControl => {
                self.abandon_control()?;
                return self.reset_bus();
            }
            Fault::UnplugInControl => {
                self.abandon_control()?;
                return self.unplug();
            }
            Fault::HaltCleared | Fault::InterfaceSetAgain => {
                for _ in 0..self.random.between(1, 4) {
                    if fault == Fault::HaltCleared {
                        self.board.usb().clear_halt(UsbDirection::In)?;
                        self.board.usb().clear_halt(UsbDirection::Out)?;
                    } else {
                        self.board.usb().set_interface()?;
                    }
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
                self.hosts.usb.ignores_window = true;
                self.work_between(100_000, 200_000)?;
                self.hosts.usb.ignores_window = false;
                self.board.usb().set_reading(true);
            }
            Fault::FullPackets => self.full_packets(),
            Fault::BusOff => {
                self.board.can().short();
                self.work_between(1_000, 30_000)?;
                self.board.can().release();
            }
            Fault::ErrorPassive => {
                let count = self.random.between(17, 30) as u32;
                let broken = self.traffic.broken_frames + count;
                self.board.can().destroy_next(count);
                self.await_fault(|rig| rig.traffic.broken_frames >= broken)?;
            }
            Fault::NoAcknowledge => {
                self.board.can().set_acknowledging(false);
                self.work_between(2_000, 30_000)?;
                self.board.can().set_acknowledging(true);
            }
            Fault::Flood => {
                let frame = Frame::new(Id::new(0).unwrap(), &[0x5A; 8]).unwrap();
                self.board.can().flood(Some(&frame))?;
                self.work_between(2_000, 30_000)?;
                self.board.can().flood(None)?;
            }
            Fault::OutOfSequence => {
                // A consecutive frame with an unexpected sequence number.
                let number = self.random.between(5, 15) as u8;
                let id = Function::ArmRequest.id(Node::default());
                let frame = Frame::new(id, &[0x20 | number; 8]).unwrap();
                self.board.can().send_from(1, &frame)?;
                self.await_fault(|rig| rig.board.can().unsent() == 0)?;
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
    pub(super) fn await_fault(&mut self, happened: impl FnMut(&mut Self) -> bool) -> Result {
        if self.work_until(FAULT_TIMEOUT, happened)? {
            Ok(())
        } else {
            Err("the fault did not occur".into())
        }
    }

    /// Damages one of the next bytes on the cable.
    fn damage(&mut self, direction: Direction, damage: Damage) -> Result {
        self.account.requests_damaged |= direction == Direction::ToArm;
        let after = self.random.between(0, 14) as u32;
        self.board
            .with_arm(|cable| cable.plan = Some((direction, after, damage)));
        self.await_fault(|rig| rig.board.with_arm(|cable| cable.plan.is_none()))
    }

    /// Flips a bit of one of the next bytes on the cable.
    fn flip_bit(&mut self, direction: Direction) -> Result {
        let mask = 1 << self.random.between(0, 7);
        self.damage(direction, Damage::Corrupt(mask))
    }

    /// Plans a line fault for one of the next bytes from the arm.
    pub(super) fn plan_line_fault(&mut self, fault: LineFault) -> Result {
        let count = |rig: &Self| rig.traffic.framing_faults + rig.traffic.noise_faults + rig.traffic.overruns;
        let before = count(self);
        // A byte without a predecessor cannot overrun it, and has no effect. The fault is then planned again, once that
        // byte has passed: two consecutive overruns count as one in the receiver.
        for _ in 0..20 {
            let after = self.random.between(0, 14) as u32;
            self.board.uart().plan_fault(after.into(), fault);
            // One more byte may already be on the line.
            let past = self.traffic.bytes_from_arm + after + 2;
            self.await_fault(|rig| count(rig) > before || rig.traffic.bytes_from_arm >= past)?;
            self.traffic.count(&mut self.board);
            if count(self) > before {
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
        self.board.with_arm(|cable| cable.arm.send(&bytes));
        let sent_by_arm = self.traffic.bytes_from_arm + count as u32;
        self.await_fault(|rig| rig.traffic.bytes_from_arm >= sent_by_arm)
    }

    /// Sends from the arm without a pause while the core is halted: more than the receive ring holds.
    fn mask_interrupts(&mut self) -> Result {
        const BYTES_PER_MILLISECOND: u64 = 100;
        const NO_FRAME: u8 = 0x55;
        let millis = self.random.between(11, 30);
        let noise = vec![NO_FRAME; (millis * BYTES_PER_MILLISECOND) as usize];
        self.board.with_arm(|cable| cable.arm.send(&noise));
        self.board.hold_core();
        self.work(Nanos::from_millis(millis))?;
        self.board.let_core_go();
        Ok(())
    }

    /// Unplugs the arm for a while.
    fn without_arm(&mut self, low: u64, high: u64) -> Result {
        self.account.requests_damaged = true;
        self.board.with_arm(|cable| cable.is_out = true);
        self.work_between(low, high)?;
        self.board.with_arm(|cable| cable.is_out = false);
        Ok(())
    }

    /// Sends requests and frames of the arm that fill packets exactly: only an empty packet shows the host the end of
    /// the transfer.
    fn full_packets(&mut self) {
        let frame = ling::Frame {
            command: 0x7E,
            function: 0x00,
            data: &[0x11; PACKET - ling::OVERHEAD],
        };
        let frame = encoded(|bytes| frame.encode(bytes));
        let count = self.random.between(1, 3) as usize;
        self.board.with_arm(|cable| cable.arm.send(&frame.repeat(count)));
        self.account.unsolicited.extend(vec![frame; count]);
        self.hosts.usb.request_burst(&mut self.board, FULL_BURST);
    }

    /// Resets the bus, and reconnects the device after a while. Returns the time of the reconnection.
    fn reset_bus(&mut self) -> Result<Nanos> {
        self.board.usb().reset_bus();
        self.disconnect_usb();
        self.work_between(1_000, 60_000)?;
        Ok(self.reconnect_usb())
    }

    /// Unplugs the device for a while. Returns the time of the reconnection.
    fn unplug(&mut self) -> Result<Nanos> {
        self.board.usb().detach();
        self.disconnect_usb();
        self.work_between(5_000, 60_000)?;
        Ok(self.reconnect_usb())
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
        let mut before = 0;
        for config in [first, old] {
            before = self.board.flash_operations();
            self.order(Request::SetConfig(config));
            self.order(Request::SaveConfig);
        }
        let operations = u64::from(self.board.flash_operations() - before);
        self.order(Request::SetConfig(new));
        let after = self.random.between(0, operations - 1) as u32;
        self.board.cut_power_after(after);
        let control = &mut self.hosts.subscriber.control;
        control.send(&mut self.board, Request::SaveConfig);
        if !self.work_until_error(FAULT_TIMEOUT, |error| matches!(error, Error::PowerCut { .. }))? {
            return Err("the power was not cut".into());
        }
        self.disconnect_usb();
        self.board.power_cycle()?;
        let now = self.reconnect_usb();
        let control = &mut self.hosts.subscriber.control;
        let found = control.call(&mut self.board, Request::GetConfig);
        if found != Reply::Config(old) && found != Reply::Config(new) {
            return Err(format!("a configuration that was never saved: {found:?}").into());
        }
        self.resume()?;
        Ok(now)
    }

    /// Corrupts memory: the firmware finds its queue borrowed, and panics.
    fn panic(&mut self) -> Result<Nanos> {
        let clock = self.board.symbol(CLOCK).ok_or("the image has no symbol of a clock")?;
        // A user of the queue at that instant clears the flag when done.
        for _ in 0..10 {
            self.board.write_word(clock, IN_USE)?;
            if self.work_until_error(Nanos::from_millis(20), |error| matches!(error, Error::Crashed { .. }))? {
                return self.await_restart();
            }
        }
        Err("the firmware did not panic".into())
    }

    /// Runs the load until the board fails with an expected error, for at most `limit`. Returns true if it did.
    fn work_until_error(&mut self, limit: Nanos, is_expected: impl Fn(&Error) -> bool) -> Result<bool> {
        match self.work(limit) {
            Err(error) if error.downcast_ref().is_some_and(is_expected) => Ok(true),
            result => result.map(|()| false),
        }
    }

    /// Waits for the restart of the board, and reconnects.
    fn await_restart(&mut self) -> Result<Nanos> {
        if !self.work_until(RESTART_TIMEOUT, |rig| !rig.board.usb().is_open())? {
            return Err(format!("the board did not restart in {RESTART_TIMEOUT}").into());
        }
        self.disconnect_usb();
        let now = self.reconnect_usb();
        self.resume()?;
        Ok(now)
    }
}
