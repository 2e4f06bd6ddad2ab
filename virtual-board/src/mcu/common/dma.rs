//! The transfers of a DMA controller, independent of its registers.
//!
//! A transfer has four steps, each some nanoseconds after the previous one: the request wins arbitration and the source
//! is read; the destination is written; the count and the flags change. A stream that loads ahead reads its source before
//! the request. A handler may run between any two steps, as on silicon. The delays are seeded, within the range of a
//! shared bus.

use std::ops::RangeInclusive;

use crate::core::{Memory, Width};
use crate::soc::chance::Chance;
use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

/// Nanoseconds from a request to the read of the source, from there to the write, and from there to the count.
#[derive(Clone, Debug)]
pub(crate) struct Delays {
    pub(crate) arbitration: RangeInclusive<u64>,
    pub(crate) transfer: RangeInclusive<u64>,
    pub(crate) count: RangeInclusive<u64>,
}

/// The delays on a shared bus.
pub(crate) const DELAYS: Delays = Delays {
    arbitration: 25..=150,
    transfer: 6..=50,
    count: 6..=50,
};

/// The next step of a stream, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The request is low, or the stream is off.
    Waiting,
    Reading(Nanos),
    Writing(Nanos, u8),
    Counting(Nanos),
    /// The source is read without a request.
    Loading(Nanos),
    /// The byte waits for a request.
    Loaded(u8),
    /// The byte has its request.
    Requested(Nanos, u8),
}

/// The two ends of a transfer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Transfer {
    pub(crate) peripheral: u32,
    pub(crate) memory: u32,
    pub(crate) from_memory: bool,
}

/// A step for the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    ReadPeripheral(u32),
    ReadMemory(u32),
    WritePeripheral(u32, u8),
    WriteMemory(u32, u8),
    /// No bus access: the count changes.
    Count,
    /// No bus access: the request is no longer high.
    Nothing,
}

/// A failed step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Failure {
    pub(crate) address: u32,
    /// The register's refusal. `None` if the address has no memory and no register for the DMA.
    pub(crate) refused: Option<Refused>,
}

impl Step {
    /// Executes the step, and returns the byte of a read.
    ///
    /// `register` reads the register at an address, or writes a byte to it, and returns the byte; `None` if the DMA
    /// cannot access a register there.
    pub(crate) fn run(
        self,
        memory: &mut Memory,
        register: impl FnOnce(u32, Option<u8>) -> Option<Result<u8, Refused>>,
    ) -> Result<Option<u8>, Failure> {
        let none = |address| Failure { address, refused: None };
        let access = |address, value| {
            let done = register(address, value).ok_or(none(address))?;
            done.map_err(|refused| Failure {
                address,
                refused: Some(refused),
            })
        };
        match self {
            Self::ReadPeripheral(address) => access(address, None).map(Some),
            Self::ReadMemory(address) => {
                let value = memory.read(address, Width::Byte).ok_or(none(address))?;
                Ok(Some(value as u8))
            }
            Self::WritePeripheral(address, value) => access(address, Some(value)).map(|_| None),
            Self::WriteMemory(address, value) => {
                memory.write(address, Width::Byte, value.into()).ok_or(none(address))?;
                Ok(None)
            }
            Self::Count | Self::Nothing => Ok(None),
        }
    }
}

#[derive(Debug)]
pub(crate) struct Steps<const STREAMS: usize> {
    phases: [Phase; STREAMS],
    chance: Chance,
    delays: Delays,
}

impl<const STREAMS: usize> Steps<STREAMS> {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            phases: [Phase::Waiting; STREAMS],
            chance: Chance::new(seed, "DMA"),
            delays: DELAYS,
        }
    }

    #[cfg(test)]
    pub(crate) fn set_delays(&mut self, delays: Delays) {
        self.delays = delays;
    }

    /// Returns true if the stream waits for a request.
    #[inline]
    pub(crate) fn waits(&self, stream: usize) -> bool {
        matches!(self.phases[stream], Phase::Waiting | Phase::Loaded(_))
    }

    /// Returns true if the stream has a byte that it must write or count. A byte that was loaded ahead is dropped.
    pub(crate) fn moves(&self, stream: usize) -> bool {
        matches!(self.phases[stream], Phase::Writing(..) | Phase::Counting(_))
    }

    /// Starts a transfer of a waiting stream.
    pub(crate) fn start(&mut self, stream: usize, now: Nanos) {
        let delays = &self.delays;
        self.phases[stream] = match self.phases[stream] {
            Phase::Loaded(value) => Phase::Requested(now + self.chance.span(delays.transfer.clone()), value),
            _ => Phase::Reading(now + self.chance.span(delays.arbitration.clone())),
        };
    }

    /// Reads the source of a waiting stream before its request.
    pub(crate) fn load(&mut self, stream: usize, now: Nanos) {
        self.phases[stream] = Phase::Loading(now + self.chance.span(self.delays.arbitration.clone()));
    }

    /// Aborts the transfer of a stream.
    pub(crate) fn stop(&mut self, stream: usize) {
        self.phases[stream] = Phase::Waiting;
    }

    /// The first stream with a step that is due at `now`.
    pub(crate) fn first_due(&self, now: Nanos) -> Option<usize> {
        self.phases
            .iter()
            .position(|phase| phase.due().is_some_and(|at| at <= now))
    }

    /// Takes the next step of a stream. A request that is no longer high is not served.
    pub(crate) fn take(&mut self, stream: usize, is_high: bool, transfer: Transfer, now: Nanos) -> Step {
        let Transfer {
            peripheral,
            memory,
            from_memory,
        } = transfer;
        let phase = &mut self.phases[stream];
        match *phase {
            Phase::Waiting | Phase::Loaded(_) => Step::Nothing,
            Phase::Loading(_) => Step::ReadMemory(memory),
            Phase::Requested(_, value) if !is_high => {
                *phase = Phase::Loaded(value);
                Step::Nothing
            }
            Phase::Requested(_, value) => {
                *phase = Phase::Counting(now + self.chance.span(self.delays.count.clone()));
                Step::WritePeripheral(peripheral, value)
            }
            Phase::Reading(_) if !is_high => {
                *phase = Phase::Waiting;
                Step::Nothing
            }
            Phase::Reading(_) if from_memory => Step::ReadMemory(memory),
            Phase::Reading(_) => Step::ReadPeripheral(peripheral),
            Phase::Writing(_, value) => {
                *phase = Phase::Counting(now + self.chance.span(self.delays.count.clone()));
                if from_memory {
                    Step::WritePeripheral(peripheral, value)
                } else {
                    Step::WriteMemory(memory, value)
                }
            }
            Phase::Counting(_) => {
                *phase = Phase::Waiting;
                Step::Count
            }
        }
    }

    /// Passes the byte of a read.
    pub(crate) fn fetched(&mut self, stream: usize, value: u8, now: Nanos) {
        self.phases[stream] = match self.phases[stream] {
            Phase::Loading(_) => Phase::Loaded(value),
            _ => Phase::Writing(now + self.chance.span(self.delays.transfer.clone()), value),
        };
    }

    /// The time of the next step.
    #[inline]
    pub(crate) fn due(&self) -> Option<Nanos> {
        self.phases.iter().filter_map(|phase| phase.due()).min()
    }
}

impl Phase {
    #[inline]
    fn due(&self) -> Option<Nanos> {
        match *self {
            Self::Waiting | Self::Loaded(_) => None,
            Self::Reading(at) | Self::Writing(at, _) | Self::Counting(at) => Some(at),
            Self::Loading(at) | Self::Requested(at, _) => Some(at),
        }
    }
}

/// The count of transfers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Count {
    pub(crate) left: u32,
    pub(crate) programmed: u32,
}

/// The milestones that a transfer reached.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reached {
    pub(crate) half: bool,
    pub(crate) complete: bool,
}

impl Count {
    /// Number of completed transfers.
    pub(crate) fn done(self) -> u32 {
        self.programmed - self.left
    }

    /// Counts a transfer. A circular stream starts over after the last one.
    pub(crate) fn count(&mut self, circular: bool) -> Reached {
        self.left -= 1;
        let reached = Reached {
            half: self.left == self.programmed / 2,
            complete: self.left == 0,
        };
        if reached.complete && circular {
            self.left = self.programmed;
        }
        reached
    }
}

/// The DMA of a chip, as far as it serves the UART to the arm.
pub(crate) trait Dma: Peripheral {
    /// Starts the transfers of requests that are high.
    fn follow_requests(&mut self, requests: Requests, now: Nanos);

    /// Takes the next step that is due at `now`, with its stream. A request that is low by now is not served.
    fn step(&mut self, requests: Requests, now: Nanos) -> Option<(usize, Step)>;

    /// Passes the byte of a read.
    fn fetched(&mut self, stream: usize, value: u8, now: Nanos);

    /// The last step failed on the bus: the stream stops.
    fn fail(&mut self, stream: usize);
}

/// Levels of the requests of the UART to the arm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Requests {
    pub(crate) receive: bool,
    pub(crate) transmit: bool,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const RECEIVE: Requests = Requests {
        receive: true,
        transmit: false,
    };
    const NONE: Requests = Requests {
        receive: false,
        transmit: false,
    };

    /// Raises the request for one transfer, and returns the steps with their instants.
    pub(crate) fn transfer(dma: &mut impl Dma, now: Nanos) -> Vec<(Nanos, Step)> {
        dma.follow_requests(RECEIVE, now);
        let mut steps = Vec::new();
        while let Some(due) = dma.due() {
            let (stream, step) = dma.step(RECEIVE, due).unwrap();
            if matches!(step, Step::ReadPeripheral(_) | Step::ReadMemory(_)) {
                dma.fetched(stream, 0x42, due);
            }
            steps.push((due, step));
        }
        steps
    }

    /// Checks a transfer from the register at this address to the start of memory.
    pub(crate) fn check_steps(dma: &mut impl Dma, register: u32) {
        let (instants, kinds): (Vec<u64>, Vec<Step>) =
            (transfer(dma, Nanos(1_000)).into_iter().map(|(at, step)| (at.0, step))).unzip();
        assert_eq!(
            kinds,
            [
                Step::ReadPeripheral(register),
                Step::WriteMemory(0x2000_0000, 0x42),
                Step::Count
            ]
        );
        assert!(1_000 < instants[0] && instants[0] < instants[1] && instants[1] < instants[2]);
    }

    /// Checks that a request that goes away before the first step gets nothing.
    pub(crate) fn check_withdrawal(dma: &mut impl Dma, stream: usize) {
        dma.follow_requests(RECEIVE, Nanos(0));
        let due = dma.due().unwrap();
        assert_eq!(dma.step(NONE, due), Some((stream, Step::Nothing)));
        assert_eq!(dma.due(), None);
    }
}
