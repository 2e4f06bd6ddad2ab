//! Fault confinement (RM0090, 32.7.6; ISO 11898-1): the two error counters and the states.

use super::{BusError, ErrorState, Fault};

/// The warning limit.
const WARNING: u16 = 96;
/// The highest count of an error active controller.
const ACTIVE: u16 = 127;
/// The maximum of the transmit counter of a controller on the bus.
const MOST: u16 = 255;
/// The new value of a receive counter above [`RECOVERS`] after a valid frame (32.9.2 ESR).
const RECOVERED: u16 = 120;
const RECOVERS: u16 = 128;

/// The counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Confinement {
    transmit: u16,
    receive: u16,
    bus_off: bool,
}

impl Confinement {
    pub(crate) fn state(self) -> ErrorState {
        match (self.bus_off, self.transmit.max(self.receive) > ACTIVE) {
            (true, _) => ErrorState::BusOff,
            (false, true) => ErrorState::Passive,
            (false, false) => ErrorState::Active,
        }
    }

    pub(crate) fn warns(self) -> bool {
        self.transmit.max(self.receive) >= WARNING
    }

    pub(crate) fn is_passive(self) -> bool {
        self.transmit.max(self.receive) > ACTIVE
    }

    /// TEC: the eight low bits of a counter of nine.
    pub(crate) fn transmit(self) -> u32 {
        u32::from(self.transmit & 0xFF)
    }

    /// REC.
    pub(crate) fn receive(self) -> u32 {
        u32::from(self.receive)
    }

    /// A frame of its own failed. A missing acknowledge does not count in error passive.
    pub(crate) fn transmit_error(&mut self, error: BusError) {
        if error == BusError::Acknowledge && self.state() == ErrorState::Passive {
            return;
        }
        self.transmit += 8;
        self.bus_off = self.transmit > MOST;
    }

    /// A received frame failed: adds one, and eight more if the other nodes respond to its error flag.
    pub(crate) fn receive_error(&mut self) {
        let more = if self.state() == ErrorState::Active { 9 } else { 1 };
        self.receive = (self.receive + more).min(MOST);
    }

    /// The same, but adds one if a third node destroyed the frame: its error flag is an error here, and no node
    /// responds to this node's flag.
    pub(crate) fn receive_fault(&mut self, fault: Fault) {
        if fault.is_own {
            self.receive_error();
        } else {
            self.receive = (self.receive + 1).min(MOST);
        }
    }

    pub(crate) fn transmitted(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
    }

    pub(crate) fn received(&mut self) {
        self.receive = match self.receive {
            0..=RECOVERS => self.receive.saturating_sub(1),
            _ => RECOVERED,
        };
    }

    /// The node has recovered from bus-off.
    pub(crate) fn recover(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_flag_of_another_receiver_counts_one() {
        let mut counters = Confinement::default();
        counters.receive_fault(Fault {
            error: BusError::Stuff,
            in_data_phase: false,
            is_own: false,
        });
        assert_eq!(counters.receive(), 1);
    }

    #[test]
    fn errors_make_it_warn_then_passive_then_off() {
        let mut counters = Confinement::default();
        let mut at = Vec::new();
        for nth in 1..=32 {
            counters.transmit_error(BusError::RecessiveBit);
            at.push((nth, counters.warns(), counters.state()));
        }
        assert_eq!(at[10], (11, false, ErrorState::Active));
        assert_eq!(at[11], (12, true, ErrorState::Active));
        assert_eq!(at[15], (16, true, ErrorState::Passive));
        assert_eq!(at[30], (31, true, ErrorState::Passive));
        assert_eq!(at[31], (32, true, ErrorState::BusOff));
        assert_eq!(counters.transmit(), 0, "the ninth bit does not show");
    }

    #[test]
    fn missing_acknowledge_never_ends_in_bus_off() {
        let mut counters = Confinement::default();
        for _ in 0..1_000 {
            counters.transmit_error(BusError::Acknowledge);
        }
        assert_eq!((counters.transmit(), counters.state()), (128, ErrorState::Passive));
    }

    #[test]
    fn good_frames_count_down() {
        let mut counters = Confinement::default();
        counters.transmit_error(BusError::RecessiveBit);
        counters.receive_error();
        counters.transmitted();
        counters.received();
        assert_eq!((counters.transmit(), counters.receive()), (7, 8));
    }

    #[test]
    fn passive_receiver_recovers_with_one_good_frame() {
        let mut counters = Confinement::default();
        for _ in 0..1_000 {
            counters.receive_error();
        }
        assert_eq!((counters.receive(), counters.state()), (255, ErrorState::Passive));
        counters.received();
        assert_eq!((counters.receive(), counters.state()), (120, ErrorState::Active));
    }

    #[test]
    fn only_receive_counter_above_128_becomes_120() {
        for (before, after) in [(0, 0), (1, 0), (127, 126), (128, 127), (129, 120), (255, 120)] {
            let mut counters = Confinement {
                receive: before,
                ..Confinement::default()
            };
            counters.received();
            assert_eq!(counters.receive(), after, "from {before}");
        }
    }
}
