//! `armwire sim so101`: a virtual SO-101 on a pseudo-terminal, with faults on order.

use std::fmt::Display;
use std::io::{self, BufRead};
use std::str::FromStr;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use armwire_bridge::{Duration, Instant};
use armwire_sim::serial::SerialDevice;
use armwire_sim::so101::{Config, Order, OrderError, So101};
use clap::Args;

use super::line::{LineArgs, print_counts};
use crate::call::values::parse;
use crate::error::Error;
use crate::ids::ids;
use crate::output::print_line;

/// Longest time from an order on standard input to its effect.
const ORDERS: Duration = Duration::from_millis(5);
/// Maximum number of orders that are read ahead, and carried out at once: a flood of them leaves time for the line.
const MAX_ORDERS: usize = 16;

/// The arguments of `armwire sim so101`.
#[derive(Args)]
pub(crate) struct So101Sim {
    #[command(flatten)]
    line: LineArgs,
    /// Ids of the servos from the arm's base on, 0 to 253, such as '1-6' or '1,2,7'.
    #[arg(long, default_value = "1-6")]
    ids: Ids,
    /// Models of the servos, one for each or one for all: 777 is an STS3215, 2825 an STS3250.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "777")]
    models: Vec<u16>,
    /// Supply in volts, 0 to 25.4. Outside the limits of their registers the servos report an error.
    #[arg(long, value_name = "VOLTS", default_value_t = 7.4, allow_negative_numbers = true)]
    volts: f64,
    /// Steps that loaded joints rest below their goals when horizontal, -500 to 500. Without torque they sink.
    #[arg(long, value_name = "TICKS", allow_negative_numbers = true, value_parser = |text: &str| order("sag", text))]
    sag: Option<Order>,
    /// Echo every received byte immediately, as a board without a direction switch does.
    #[arg(long)]
    echo: bool,
    /// The Nth answer, and what follows in that time, arrives MS milliseconds later, 60 without it. No byte is lost.
    #[arg(long, value_name = "N[:MS]", value_parser = |text: &str| order("late", text))]
    late: Vec<Order>,
    /// The Nth answer has a flipped bit.
    #[arg(long, value_name = "N", value_parser = |text: &str| order("damaged", text))]
    damaged: Vec<Order>,
    /// The Nth answer is sent twice.
    #[arg(long, value_name = "N", value_parser = |text: &str| order("twice", text))]
    twice: Vec<Order>,
    /// Before the Nth answer the supply drops for MS milliseconds, 300 without it: all servos restart without torque.
    #[arg(long, value_name = "N[:MS]", value_parser = |text: &str| order("brownout", text))]
    brownout: Vec<Order>,
    /// This servo executes requests and does not answer.
    #[arg(long, value_name = "ID", value_parser = |text: &str| order("silent", text))]
    silent: Vec<Order>,
    /// This servo and those behind it have no supply.
    #[arg(long, value_name = "ID", value_parser = |text: &str| order("unplugged", text))]
    unplugged: Vec<Order>,
    /// Answers of a servo have these error bits, for example '2 1': voltage 1, sensor 2, temperature 4, current 8, overload
    /// 32.
    #[arg(long, value_name = "ID BITS", value_parser = |text: &str| order("error", text))]
    error: Vec<Order>,
    /// Take orders from standard input, a line each, such as 'late 1', 'silent 3' or 'state'.
    ///
    /// The orders are late N[:MS], damaged [N], twice [N], brownout [N[:MS]], silent ID, unplugged ID, error ID BITS, echo,
    /// sag TICKS, hand ID POSITION (a hand moves a servo), clear (the faults end) and state. Answers are counted from the
    /// order on; 1 is the next one. Each order is answered by 'ok' on standard output, or by 'error: ' and the reason.
    /// The lines of 'state' come before its 'ok'.
    #[arg(long)]
    stdin: bool,
}

/// The ids of servos. They are an argument of their own, which clap does not split.
#[derive(Clone, Debug)]
struct Ids(Vec<u8>);

impl FromStr for Ids {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        ids(text, |text| parse(text, "an id from 0 to 253")).map(Self)
    }
}

/// The order of an option and its value.
fn order(name: &str, value: &str) -> Result<Order, OrderError> {
    format!("{name} {value}").parse()
}

impl So101Sim {
    pub(super) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let usage = |error: &dyn Display| Error::Usage(error.to_string());
        let config = Config::new(&self.ids.0, &self.models, self.volts).map_err(|error| usage(&error))?;
        let mut arm = So101::new(config);
        for order in self.orders() {
            arm.order(Instant::ZERO, order).map_err(|error| usage(&error))?;
        }
        let name = match self.ids.0.len() {
            1 => "SO-101 with 1 servo".to_owned(),
            servos => format!("SO-101 with {servos} servos"),
        };
        let ordered = Ordered {
            arm,
            orders: self.stdin.then(lines),
            looked: Instant::ZERO,
        };
        let (line, served) = self.line.serve(name, ordered, stop)?;
        print_counts(served, line.device().arm.counters())
    }

    /// The orders of the options.
    fn orders(&self) -> impl Iterator<Item = Order> {
        let faults = [
            &self.late,
            &self.damaged,
            &self.twice,
            &self.brownout,
            &self.silent,
            &self.unplugged,
            &self.error,
        ];
        let echo = self.echo.then_some(Order::Echo);
        faults.into_iter().flatten().copied().chain(self.sag).chain(echo)
    }
}

/// The lines of standard input, as they come.
fn lines() -> Receiver<String> {
    let (sender, lines) = sync_channel(MAX_ORDERS);
    // It ends with the input, or with the program.
    thread::spawn(move || {
        for line in io::stdin().lock().split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line).into_owned();
            if sender.send(line).is_err() {
                break;
            }
        }
    });
    lines
}

/// An arm that takes orders while it is served.
struct Ordered {
    arm: So101,
    orders: Option<Receiver<String>>,
    /// The time at which it last looked for orders.
    looked: Instant,
}

impl Ordered {
    fn take_orders(&mut self, now: Instant) {
        self.looked = now;
        for line in self.orders.iter().flat_map(Receiver::try_iter).take(MAX_ORDERS) {
            let done = line.parse().and_then(|order| self.arm.order(now, order));
            // Without a reader the output is lost. The order is carried out all the same.
            let _ = match done {
                Ok(lines) => lines.iter().try_for_each(print_line).and_then(|()| print_line("ok")),
                Err(error) => print_line(format_args!("error: {error}")),
            };
        }
    }
}

impl SerialDevice for Ordered {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.arm.receive(now, byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.take_orders(now);
        self.arm.transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let orders = self.orders.as_ref().map(|_| self.looked + ORDERS);
        [orders, self.arm.poll_timeout()].into_iter().flatten().min()
    }

    fn set_baud(&mut self, baud: u32) {
        self.arm.set_baud(baud);
    }
}
