//! The FIFOs: content, order and reported space (RM0090, 34.11, 34.16.2 GRXSTSP, 34.16.4 DTXFSTSx and DIEPEMPMSK).

use super::*;

const DTXFSTS_1: u32 = DIEP + ENDPOINT_SPAN + TXFSTS;

/// Endpoint, kind and byte count of the entry at the front of the receive FIFO, which is popped.
fn pop(core: &mut Core) -> (u32, u32, u32) {
    let status = core.read(GRXSTSP);
    (status & 0xF, kind(status), status >> grxsts::BCNT_AT & 0x7FF)
}

fn read_words(core: &mut Core, count: u32) {
    for _ in 0..count {
        core.read(FIFO);
    }
}

/// Returns true if bulk endpoint 1 interrupts for space in its transmit FIFO.
fn reports_empty(core: &mut Core) -> bool {
    core.read(DAINT) & 1 << 1 != 0
}

#[test]
fn receive_fifo_keeps_order_across_endpoints() {
    let mut core = with_bulk();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
    assert_eq!(core.output(0, 1, false, &[1; 64]), Handshake::Ack);
    assert!(core.setup(0, [9; 8]));
    assert_eq!(core.output(0, 1, true, &[2; 3]), Handshake::Ack);
    let mut order = Vec::new();
    while core.read(GINTSTS) & gint::RXFLVL != 0 {
        let entry = pop(&mut core);
        let words: Vec<u32> = (0..entry.2.div_ceil(4)).map(|_| core.read(FIFO)).collect();
        order.push((entry, words.first().map(|word| word & 0xFF)));
    }
    assert_eq!(
        order,
        [
            ((1, grxsts::OUT_DATA, 64), Some(1)),
            ((0, grxsts::SETUP_DATA, 8), Some(9)),
            ((1, grxsts::OUT_DATA, 3), Some(2)),
            ((1, grxsts::OUT_DONE, 0), None),
        ]
    );
}

#[test]
fn grxstsr_peeks_and_grxstsp_pops() {
    let mut core = with_bulk();
    core.output(0, 1, false, b"abc");
    let first = core.read(GRXSTSR);
    assert_eq!(core.read(GRXSTSR), first);
    assert_eq!(core.read(GRXSTSP), first);
    assert_eq!(kind(core.read(GRXSTSR)), grxsts::OUT_DONE);
}

#[test]
fn status_word_has_packet_data_pid() {
    let mut core = with_bulk();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 3 << eptsiz::PKTCNT_AT | 192);
    let pids: Vec<u32> = [false, true, false]
        .into_iter()
        .map(|toggle| {
            core.output(0, 1, toggle, &[0; 64]);
            let pid = core.read(GRXSTSP) >> grxsts::DPID_AT & 3;
            read_words(&mut core, 16);
            pid
        })
        .collect();
    assert_eq!(pids, [0, 2, 0], "DATA0, DATA1, DATA0");
}

#[test]
fn receive_interrupt_lasts_until_last_status_is_popped() {
    let mut core = with_bulk();
    core.write(GINTMSK, gint::RXFLVL);
    assert!(!core.interrupt());
    core.output(0, 1, false, b"abc");
    assert!(core.interrupt());
    core.write(GINTSTS, gint::RXFLVL);
    assert!(core.interrupt(), "writing does not clear it");
    core.read(GRXSTSP);
    core.read(FIFO);
    assert!(core.interrupt(), "the transfer's end");
    core.read(GRXSTSP);
    assert!(!core.interrupt());
}

#[test]
fn popped_but_unread_data_still_takes_room() {
    let mut core = with_bulk();
    core.write(GRXFSIZ, 20);
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
    assert_eq!(core.output(0, 1, false, &[0; 64]), Handshake::Ack);
    core.read(GRXSTSP);
    assert_eq!(core.output(0, 1, true, &[0; 64]), Handshake::Nak);
    read_words(&mut core, 16);
    assert_eq!(core.output(0, 1, true, &[0; 64]), Handshake::Ack);
}

#[test]
fn receive_fifo_flush_drops_status_and_data() {
    let mut core = with_bulk();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
    core.output(0, 1, false, &[1; 64]);
    core.read(GRXSTSP);
    core.output(0, 1, true, &[2; 64]);
    core.write(GRSTCTL, grstctl::RXFFLSH);
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0);
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 64);
    let control = core.read(DOEP + ENDPOINT_SPAN + CTL);
    core.write(DOEP + ENDPOINT_SPAN + CTL, control | epctl::CNAK);
    core.output(0, 1, false, b"new!");
    core.read(GRXSTSP);
    assert_eq!(core.read(FIFO).to_le_bytes(), *b"new!");
}

#[test]
fn transmit_fifo_space_shrinks_and_returns_with_acknowledge() {
    let mut core = with_bulk();
    assert_eq!(core.read(DTXFSTS_1), 16);
    send(&mut core, &[0; 61]);
    assert_eq!(core.read(DTXFSTS_1), 0, "61 bytes are 16 words");
    core.input(0, 1);
    assert_eq!(core.read(DTXFSTS_1), 0, "it may have to go again");
    core.acknowledged(1);
    assert_eq!(core.read(DTXFSTS_1), 16);
}

#[test]
fn transmit_fifo_interrupts_half_or_fully_empty_unmasked() {
    for (level, words) in [(0, 8), (gahbcfg::TXFELVL, 0)] {
        let mut core = with_bulk();
        core.write(GAHBCFG, gahbcfg::GINTMSK | level);
        core.write(GINTMSK, gint::IEPINT);
        core.write(DAINTMSK, 1 << 1);
        assert!(!reports_empty(&mut core), "DIEPEMPMSK");
        core.write(DIEPEMPMSK, 1 << 1);
        for written in 0..=16 {
            assert_eq!(reports_empty(&mut core), written <= words, "{written} words");
            assert_eq!(core.interrupt(), written <= words);
            core.write(FIFO + FIFO_SPAN, 0);
        }
        core.write(DIEP + ENDPOINT_SPAN + INT, epint::TXFE);
        assert!(!reports_empty(&mut core), "writing does not set it");
    }
}

#[test]
fn flush_names_one_transmit_fifo_or_all() {
    for (number, left) in [(0, [16, 15]), (1, [15, 16]), (grstctl::ALL, [16, 16])] {
        let mut core = with_bulk();
        core.write(FIFO, 0);
        core.write(FIFO + FIFO_SPAN, 0);
        core.write(GRSTCTL, grstctl::TXFFLSH | number << grstctl::TXFNUM_AT);
        assert_eq!([core.read(DIEP + TXFSTS), core.read(DTXFSTS_1)], left, "{number:#x}");
    }
}
