//! The program at the USB serial port: a client, in virtual time.

use std::error::Error;

use armwire::ling::{Ling, LingClient, Request, Response};
use armwire::time::Instant;
use armwire::{Config, Event, Output};
use armwire_bridge::Duration;
use armwire_sim::ling::LingArm;
use armwire_virtual_board::latency::{self, Mismatch};
use armwire_virtual_board::line::Direction;
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Nanos, VirtualBoard, usb};

use crate::figures::{BYTE, Figures};

/// The longest request, 34 bytes, on the arm's line.
const MOVE_ON_WIRE: Duration = Duration::from_micros(34 * BYTE.as_micros());

/// Longer than any pause within an answer.
const ANSWER_PAUSE: Nanos = Nanos::from_millis(1);

/// The program, and its board.
pub(crate) struct Host {
    pub(crate) board: VirtualBoard<LingArm>,
    pub(crate) figures: Figures,
    client: LingClient,
}

impl Host {
    pub(crate) fn new(board: VirtualBoard<LingArm>) -> Self {
        Self {
            board,
            figures: Figures::default(),
            client: LingClient::new(Ling, Config::DEFAULT),
        }
    }

    /// Plugs the adapter in and opens its serial port.
    pub(crate) fn open(&mut self) -> Result<(), Box<dyn Error>> {
        let mut usb = self.board.usb();
        usb.attach();
        usb.open(0, LineCoding::new(1_000_000))?;
        Ok(())
    }

    /// Makes one call. Returns the answer, if the request has one, and the duration.
    pub(crate) fn call(&mut self, request: Request) -> Result<(Option<Response>, Nanos), Box<dyn Error>> {
        self.board.uart().forget_bytes();
        self.board.usb().forget_packets();
        let start = self.board.now();
        self.client.submit(&request)?;
        let mut bytes = Vec::new();
        loop {
            let left = self.client.receive(self.board.now().instant(), &bytes).len();
            bytes.drain(..bytes.len() - left);
            match self.client.poll(self.board.now().instant()) {
                Output::Receive => bytes.extend(self.board.usb().read()),
                Output::Transmit(out) => {
                    let n = out.len();
                    self.board.usb().write(out)?;
                    self.client.transmitted(self.board.now().instant(), n)?;
                }
                Output::Timeout(until) => bytes.extend(self.receive(until)?),
                Output::Event(Event::Answer(response)) => {
                    let took = self.board.now().since(start);
                    self.measure(start, took)?;
                    return Ok((Some(response), took));
                }
                Output::Event(Event::Sent) => {
                    // The request is queued for the adapter; wait until it is with the arm.
                    self.board
                        .run_until(Duration::from_millis(10), |board| board.usb().unsent() == 0)?;
                    self.board.run_for(MOVE_ON_WIRE)?;
                    return Ok((None, self.board.now().since(start)));
                }
                Output::Event(Event::TimedOut { sends }) => {
                    return Err(format!("the arm did not answer {request:?}, sent {sends} times").into());
                }
                Output::Event(other) => {
                    return Err(format!("while waiting for the answer to {request:?}: {other:?}").into());
                }
            }
        }
    }

    /// Runs until bytes arrive from the adapter, or until this time.
    fn receive(&mut self, until: Option<Instant>) -> Result<Vec<u8>, Box<dyn Error>> {
        if let Some(until) = until {
            let limit = until.since(self.board.now().instant());
            match self.board.run_until(limit, |board| board.usb().unread() > 0) {
                Ok(_) | Err(armwire_virtual_board::Error::TimedOut { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(self.board.usb().read())
    }

    /// Records the time that the adapter added to a call.
    fn measure(&mut self, start: Nanos, took: Nanos) -> Result<(), Mismatch> {
        let bytes = self.board.uart().bytes();
        let packets = self.board.usb().packets();
        let answer = latency::bursts(&bytes, &packets, ANSWER_PAUSE)?.pop();
        let first_out = bytes.iter().find(|byte| byte.direction == Direction::ToArm);
        let request = packets.iter().find(|packet| packet.direction == usb::Direction::Out);
        if let (Some(request), Some(first_out), Some(answer)) = (request, first_out, answer) {
            let start_bit = first_out.at.since(BYTE.into());
            let line = answer.last_stop.since(start_bit);
            self.figures.calls.add(took);
            self.figures.line.add(line);
            self.figures.added.add(took.since(line));
            self.figures.to_usb.add(request.end.since(start));
            self.figures.to_uart.add(start_bit.since(request.end));
            self.figures.armed.add(answer.to_armed());
            self.figures.to_host.add(answer.to_arrival());
        }
        Ok(())
    }
}
