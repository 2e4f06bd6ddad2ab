//! The order of transmission, within the controller and on the bus, and the end of a request (RM0090, 32.7.1, 32.9.2
//! TSR).

use super::*;

const DONE: u32 = tsr::RQCP | tsr::TXOK;

impl Bench {
    /// Requests a frame without data by `mailbox`, with this identifier register.
    fn request_frame(&mut self, mailbox: u32, identifier: u32) {
        let at = MAILBOXES + mailbox * MAILBOX_SPAN;
        self.write(at + LENGTH, 0);
        self.write(at + IDENTIFIER, identifier | identifier::TXRQ);
    }

    /// The status byte of a mailbox in TSR.
    fn status(&self, mailbox: u32) -> u32 {
        self.core.read(TSR) >> (8 * mailbox) & 0xFF
    }

    fn take_received(&mut self) -> Vec<Frame> {
        self.bus.take_received()
    }
}

#[test]
fn equal_identifiers_go_by_mailbox_number() {
    let mut bench = Bench::new();
    bench.request(0, 1, 0);
    bench.request(2, 7, 2);
    bench.request(1, 7, 1);
    bench.run(4 * LONG);
    assert_eq!(bench.take_received(), [frame(1, &[0]), frame(7, &[1]), frame(7, &[2])]);
}

#[test]
fn data_before_remote_and_standard_before_extended_identifier() {
    const BASE: u32 = 0x123;
    let mut bench = Bench::new();
    // While this frame is on the bus, all three become pending.
    bench.node_sends(0, 0, &[]);
    bench.request_frame(0, BASE << identifier::STID_AT | identifier::IDE);
    bench.request_frame(1, BASE << identifier::STID_AT | identifier::RTR);
    bench.request_frame(2, BASE << identifier::STID_AT);
    bench.run(5 * LONG);
    let received: Vec<(bool, Id)> = bench
        .take_received()
        .iter()
        .map(|frame| (frame.remote, frame.id))
        .collect();
    let standard = Id::Standard(0x123);
    assert_eq!(
        received,
        [(false, standard), (true, standard), (false, Id::Extended(BASE << 18))]
    );
}

#[test]
fn extended_identifier_loses_to_equal_standard_identifier() {
    let mut bench = Bench::new();
    bench.node_sends(1, 0, &[]);
    bench
        .bus
        .send(0, Frame::data_frame(Id::Extended(0x100 << 18), &[]).unwrap());
    bench.request(0, 0x100, 0);
    bench.run(4 * LONG);
    let senders: Vec<Sender> = bench.ids().iter().map(|&(sender, ..)| sender).collect();
    assert_eq!(senders, [Sender::Node(1), Sender::Board, Sender::Node(0)]);
    assert_eq!(bench.status(0), DONE, "it lost nothing");
}

#[test]
fn lower_identifier_does_not_interrupt_current_frame() {
    let mut bench = Bench::new();
    bench.request(0, 0x700, 0);
    bench.run(10);
    bench.request(1, 0, 1);
    assert_eq!(bench.status(1), 0);
    bench.run(3 * LONG);
    assert_eq!(bench.take_received(), [frame(0x700, &[0]), frame(0, &[1])]);
}

#[test]
fn mailbox_after_lost_arbitration_yields_to_better_one() {
    let mut bench = Bench::new();
    bench.node_sends(0, 0x010, &[]);
    bench.node_sends(0, 0x011, &[]);
    bench.request(0, 0x200, 0);
    // The second frame of the node wins arbitration against mailbox 0.
    bench.run(LONG / 2);
    assert_eq!(bench.status(0), tsr::ALST);
    bench.request(1, 0x100, 1);
    bench.run(4 * LONG);
    assert_eq!(bench.take_received(), [frame(0x100, &[1]), frame(0x200, &[0])]);
    assert_eq!((bench.status(0), bench.status(1)), (DONE | tsr::ALST, DONE));
}

#[test]
fn abort_after_lost_arbitration_drops_the_frame() {
    let mut bench = Bench::new();
    bench.node_sends(0, 0x010, &[]);
    bench.node_sends(0, 0x011, &[]);
    bench.request(0, 0x200, 0);
    bench.run(LONG / 2);
    assert_eq!(bench.core.read(TSR) & tsr::TME, 0);
    bench.write(TSR, tsr::ABRQ);
    assert_eq!(bench.status(0), tsr::RQCP | tsr::ALST, "complete, and not sent");
    assert_eq!(bench.core.read(TSR) & tsr::TME, tsr::TME);
    bench.run(4 * LONG);
    assert!(bench.take_received().is_empty());
}

#[test]
fn abort_of_an_empty_mailbox_does_nothing() {
    let mut bench = Bench::new();
    bench.write(TSR, tsr::ABRQ);
    assert_eq!(bench.core.read(TSR), 0x1C00_0000);
    bench.request(0, 1, 0);
    bench.run(LONG);
    assert_eq!(bench.status(0), DONE);
}

#[test]
fn rqcp_clear_or_new_request_clears_the_result() {
    let mut bench = Bench::new();
    bench.bus.destroy(1);
    bench.request(1, 1, 0);
    bench.run(3 * LONG);
    assert_eq!(bench.status(1), DONE | tsr::TERR);
    bench.write(TSR, (tsr::TXOK | tsr::TERR) << 8);
    assert_eq!(bench.status(1), DONE | tsr::TERR, "writing RQCP clears them");
    bench.write(TSR, tsr::RQCP << 8);
    assert_eq!(bench.status(1), 0);
    bench.request(1, 1, 0);
    bench.run(LONG);
    assert_eq!(bench.status(1), DONE);
    bench.request(1, 1, 0);
    assert_eq!(bench.status(1), 0, "a new request");
}

#[test]
fn transmit_interrupt_lasts_until_all_completions_are_cleared() {
    let mut bench = Bench::new();
    bench.write(IER, ier::TMEIE);
    bench.request(0, 1, 0);
    bench.request(2, 2, 0);
    bench.run(3 * LONG);
    assert_eq!(bench.core.interrupts(), [true, false, false, false]);
    bench.write(TSR, tsr::RQCP);
    assert!(bench.core.interrupts()[0], "mailbox 2");
    bench.write(TSR, tsr::RQCP << 16);
    assert_eq!(bench.core.interrupts(), [false; 4]);
}
