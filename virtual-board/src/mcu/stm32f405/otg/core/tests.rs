//! The controller driven by hand: registers on one side, the wire on the other.

use super::*;

mod fifos;
mod states;
mod transfers;

const ACTIVE_OUT: u32 = epctl::USBAEP | epctl::SD0PID | 64;

/// A controller that is connected, reset and enumerated, with a receive FIFO of 64 words and transmit FIFOs of 16.
fn connected() -> Core {
    let mut core = Core {
        clocked: true,
        ..Core::new()
    };
    core.write(GCCFG, gccfg::PWRDWN | gccfg::NOVBUSSENS);
    core.write(GAHBCFG, gahbcfg::GINTMSK);
    core.write(GRXFSIZ, 64);
    for (fifo, start) in [(DIEPTXF0, 64), (DIEPTXF1, 80)] {
        core.write(fifo, 16 << 16 | start);
    }
    core.power(true);
    core.reset();
    core.reset_done();
    core.write(GINTSTS, !0);
    core
}

/// The same with bulk endpoint 1 in both directions, ready to receive.
fn with_bulk() -> Core {
    let mut core = connected();
    core.write(
        DIEP + ENDPOINT_SPAN + CTL,
        epctl::USBAEP | epctl::SD0PID | epctl::SNAK | 64,
    );
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 64);
    core.write(DOEP + ENDPOINT_SPAN + CTL, ACTIVE_OUT | epctl::CNAK | epctl::EPENA);
    core
}

/// Arms IN endpoint 1 with `bytes`, as a driver does: size, enable, data.
fn send(core: &mut Core, bytes: &[u8]) {
    core.write(DIEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | bytes.len() as u32);
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::CNAK | epctl::EPENA);
    for word in bytes.chunks(4) {
        let mut padded = [0; 4];
        padded[..word.len()].copy_from_slice(word);
        core.write(FIFO + FIFO_SPAN, u32::from_le_bytes(padded));
    }
}

fn kind(status: u32) -> u32 {
    status >> grxsts::PKTSTS_AT & 0xF
}

#[test]
fn pull_up_needs_clock_transceiver_and_session() {
    assert!(connected().pulls_up());

    let mut unclocked = connected();
    unclocked.clocked = false;
    assert!(!unclocked.pulls_up());

    let mut off = connected();
    off.write(GCCFG, gccfg::NOVBUSSENS);
    assert!(!off.pulls_up());

    let mut soft = connected();
    soft.write(DCTL, device::SDIS);
    assert!(!soft.pulls_up());
    soft.write(DCTL, 0);
    assert!(soft.pulls_up());
}

#[test]
fn vbus_sensing_detects_cable_plug_and_unplug() {
    let mut core = connected();
    core.write(GCCFG, gccfg::PWRDWN | gccfg::VBUSBSEN);
    core.power(false);
    assert!(!core.pulls_up());
    assert_eq!(core.read(GOTGINT), gotg::SEDET);
    assert_ne!(core.read(GINTSTS) & gint::OTGINT, 0);
    core.write(GOTGINT, gotg::SEDET);
    core.power(true);
    assert!(core.pulls_up());
    assert_ne!(core.read(GINTSTS) & gint::SRQINT, 0);
}

#[test]
fn bus_reset_silences_endpoints_enumeration_reports_speed() {
    let mut core = with_bulk();
    core.reset();
    assert_ne!(core.read(GINTSTS) & gint::USBRST, 0);
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::NoResponse);
    core.reset_done();
    assert_ne!(core.read(GINTSTS) & gint::ENUMDNE, 0);
    assert_eq!(core.read(DSTS) & device::ENUMSPD_FULL, device::ENUMSPD_FULL);
}

#[test]
fn interrupts_are_masked_at_three_levels() {
    let mut core = with_bulk();
    core.write(GINTMSK, gint::IEPINT);
    core.write(DIEPMSK, epint::XFRC);
    send(&mut core, b"x");
    core.input(0, 1);
    core.acknowledged(1);
    assert!(!core.interrupt(), "DAINTMSK");
    core.write(DAINTMSK, 1 << 1);
    assert!(core.interrupt());
    core.write(DIEPMSK, 0);
    assert!(!core.interrupt(), "DIEPMSK");
    core.write(DIEPMSK, epint::XFRC);
    core.write(GAHBCFG, 0);
    assert!(!core.interrupt(), "GINTMSK of GAHBCFG");
}

#[test]
fn setup_is_always_accepted_until_next_token() {
    let mut core = connected();
    for control in [DIEP, DOEP] {
        core.write(control + CTL, epctl::STALL);
    }
    assert!(core.setup(0, [1, 2, 3, 4, 5, 6, 7, 8]));
    assert_eq!(
        core.read(DIEP + CTL) & epctl::STALL,
        0,
        "a SETUP clears a protocol stall"
    );
    let status = core.read(GRXSTSP);
    assert_eq!(
        (kind(status), status >> grxsts::BCNT_AT & 0x7FF),
        (grxsts::SETUP_DATA, 8)
    );
    assert_eq!([core.read(FIFO), core.read(FIFO)], [0x0403_0201, 0x0807_0605]);
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0, "the phase is not over yet");

    assert!(core.ready(0, Direction::In));
    assert_eq!(core.input(0, 0), Reply::Nak);
    assert_eq!(kind(core.read(GRXSTSP)), grxsts::SETUP_DONE);
    assert_eq!(core.read(DOEP + INT) & epint::STUP, epint::STUP);
}

#[test]
fn out_packet_is_read_by_words_then_done() {
    let mut core = with_bulk();
    assert_eq!(core.output(0, 1, false, b"hello"), Handshake::Ack);
    let status = core.read(GRXSTSP);
    assert_eq!((status & 0xF, kind(status)), (1, grxsts::OUT_DATA));
    assert_eq!(core.read(FIFO).to_le_bytes(), *b"hell");
    assert_eq!(core.read(FIFO).to_le_bytes(), *b"o\0\0\0");
    assert_eq!(core.read(DOEP + ENDPOINT_SPAN + INT) & epint::XFRC, 0);
    assert_eq!(kind(core.read(GRXSTSP)), grxsts::OUT_DONE);
    assert_eq!(core.read(DOEP + ENDPOINT_SPAN + INT) & epint::XFRC, epint::XFRC);
}

#[test]
fn out_endpoint_naks_until_armed_again() {
    let mut core = with_bulk();
    assert_eq!(core.output(0, 1, false, &[1; 64]), Handshake::Ack);
    assert!(!core.ready(1, Direction::Out));
    assert_eq!(core.output(0, 1, true, &[2; 64]), Handshake::Nak);
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 64);
    let control = core.read(DOEP + ENDPOINT_SPAN + CTL);
    core.write(DOEP + ENDPOINT_SPAN + CTL, control | epctl::CNAK);
    assert_eq!(core.output(0, 1, true, &[2; 64]), Handshake::Ack);
}

#[test]
fn out_packet_beyond_receive_fifo_is_refused() {
    let mut core = with_bulk();
    core.write(GRXFSIZ, 17);
    assert_eq!(
        core.output(0, 1, false, &[0; 64]),
        Handshake::Nak,
        "16 words and two of status"
    );
    core.write(GRXFSIZ, 18);
    assert_eq!(core.output(0, 1, false, &[0; 64]), Handshake::Ack);
}

#[test]
fn repeated_out_packet_is_acknowledged_and_dropped() {
    let mut core = with_bulk();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
    assert_eq!(core.output(0, 1, false, &[7; 64]), Handshake::Ack);
    assert_eq!(core.output(0, 1, false, &[7; 64]), Handshake::Ack);
    core.read(GRXSTSP);
    for _ in 0..16 {
        core.read(FIFO);
    }
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0);
}

#[test]
fn in_packet_needs_all_its_data_in_fifo() {
    let mut core = with_bulk();
    core.now = Nanos(100);
    core.write(DIEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 5);
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::CNAK | epctl::EPENA);
    core.write(FIFO + FIFO_SPAN, u32::from_le_bytes(*b"hell"));
    assert_eq!(core.input(0, 1), Reply::Nak);
    core.now = Nanos(200);
    core.write(FIFO + FIFO_SPAN, u32::from_le_bytes(*b"o\0\0\0"));
    let reply = Reply::Data {
        toggle: false,
        bytes: b"hello".to_vec(),
        armed: Nanos(200),
    };
    assert_eq!(core.input(0, 1), reply);
    assert_eq!(core.input(0, 1), reply, "not acknowledged: it goes again");
    core.acknowledged(1);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::XFRC, epint::XFRC);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + CTL) & epctl::EPENA, 0);
    assert_eq!(core.input(0, 1), Reply::Nak);
}

#[test]
fn in_packets_alternate_their_data_pid() {
    let mut core = with_bulk();
    let toggles: Vec<bool> = (0..3)
        .map(|_| {
            send(&mut core, b"x");
            let Reply::Data { toggle, .. } = core.input(0, 1) else {
                panic!("armed");
            };
            core.acknowledged(1);
            toggle
        })
        .collect();
    assert_eq!(toggles, [false, true, false]);
}

#[test]
fn empty_packet_needs_no_fifo() {
    let mut core = with_bulk();
    send(&mut core, &[]);
    assert!(matches!(core.input(0, 1), Reply::Data { bytes, .. } if bytes.is_empty()));
}

#[test]
fn flushed_packet_does_not_go() {
    let mut core = with_bulk();
    send(&mut core, b"gone");
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control & !epctl::EPENA | epctl::SNAK);
    core.write(GRSTCTL, grstctl::TXFFLSH | 1 << grstctl::TXFNUM_AT);
    assert_eq!(core.take_misuse(), None);
    assert_eq!(core.read(GRSTCTL) & grstctl::TXFFLSH, 0, "done at once");
    assert_eq!(core.input(0, 1), Reply::Nak);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + TXFSTS), 16);
}

#[test]
fn disabled_in_endpoint_sets_epdisd() {
    let mut core = with_bulk();
    send(&mut core, b"x");
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::SNAK | epctl::EPDIS);
    let flags = core.read(DIEP + ENDPOINT_SPAN + INT);
    assert_eq!(flags & (epint::EPDISD | epint::INEPNE), epint::EPDISD | epint::INEPNE);
    assert_eq!(core.input(0, 1), Reply::Nak);
}

#[test]
fn nak_takes_effect_after_the_current_packet() {
    for is_acknowledged in [true, false] {
        let mut core = with_bulk();
        send(&mut core, b"x");
        assert!(matches!(core.input(0, 1), Reply::Data { .. }));
        let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
        core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::SNAK);
        assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::INEPNE, 0);
        match is_acknowledged {
            true => core.acknowledged(1),
            false => core.start_of_frame(1),
        }
        assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::INEPNE, epint::INEPNE);
        let enabled = core.read(DIEP + ENDPOINT_SPAN + CTL) & epctl::EPENA != 0;
        assert_eq!(enabled, !is_acknowledged);
    }
}

#[test]
fn withdrawn_packet_leaves_endpoint_unchanged() {
    let mut core = with_bulk();
    send(&mut core, b"gone");
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::SNAK | epctl::EPDIS);
    core.write(GRSTCTL, grstctl::TXFFLSH | 1 << grstctl::TXFNUM_AT);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + TXFSTS), 16);
    send(&mut core, b"next");
    let Reply::Data { toggle, bytes, .. } = core.input(0, 1) else {
        panic!("a packet is ready");
    };
    assert_eq!(
        (toggle, &bytes[..]),
        (false, &b"next"[..]),
        "the host has seen none before"
    );
}

#[test]
fn stalled_endpoint_stalls_unknown_one_is_silent() {
    let mut core = with_bulk();
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::STALL);
    assert_eq!(core.input(0, 1), Reply::Stall);
    assert_eq!(core.input(0, 2), Reply::NoResponse, "not active");
    assert_eq!(core.input(5, 1), Reply::NoResponse, "another address");
    assert!(!core.setup(5, [0; 8]));
}

#[test]
fn old_address_holds_until_new_is_used() {
    let mut core = with_bulk();
    core.write(DCFG, 7 << device::DAD_AT);
    assert_eq!(core.input(0, 1), Reply::Nak, "the status stage of SET_ADDRESS");
    assert_eq!(core.input(7, 1), Reply::Nak);
    assert_eq!(core.input(0, 1), Reply::NoResponse);
}

#[test]
fn three_milliseconds_of_silence_suspend_and_resume_wakes() {
    let mut core = connected();
    core.suspend();
    assert_ne!(core.read(GINTSTS) & gint::USBSUSP, 0);
    assert_eq!(core.read(DSTS) & device::SUSPSTS, device::SUSPSTS);
    core.resume();
    assert_ne!(core.read(GINTSTS) & gint::WKUPINT, 0);
    assert_eq!(core.read(DSTS) & device::SUSPSTS, 0);
}

#[test]
fn frames_are_numbered_and_flagged() {
    let mut core = connected();
    core.start_of_frame(0x7FF);
    assert_eq!(core.read(DSTS) >> device::FNSOF_AT, 0x7FF);
    assert_ne!(core.read(GINTSTS) & gint::SOF, 0);
    core.write(GINTSTS, gint::SOF);
    assert_eq!(core.read(GINTSTS) & gint::SOF, 0);
}

#[test]
fn global_nak_holds_every_endpoint() {
    let mut core = with_bulk();
    send(&mut core, b"x");
    core.write(DCTL, device::SGINAK | device::SGONAK);
    assert_eq!(core.input(0, 1), Reply::Nak);
    assert_eq!(core.output(0, 1, false, &[1]), Handshake::Nak);
    assert_eq!(core.read(GINTSTS) & (gint::GINAKEFF | gint::GONAKEFF), gint::GINAKEFF);
    assert_eq!(kind(core.read(GRXSTSP)), grxsts::GLOBAL_OUT_NAK);
    assert_eq!(
        core.read(GINTSTS) & (gint::GINAKEFF | gint::GONAKEFF | gint::RXFLVL),
        gint::GINAKEFF | gint::GONAKEFF,
        "in force once its word is popped (34.17.5)"
    );
    core.write(DCTL, device::SGONAK);
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0, "it is in force already");
    core.write(DCTL, device::CGINAK | device::CGONAK);
    assert_eq!(core.read(GINTSTS) & (gint::GINAKEFF | gint::GONAKEFF), 0);
    assert!(matches!(core.input(0, 1), Reply::Data { .. }));
    assert_eq!(core.output(0, 1, false, &[1]), Handshake::Ack);
}

#[test]
fn soft_reset_puts_the_registers_back() {
    let mut core = with_bulk();
    core.write(GRSTCTL, grstctl::CSRST);
    assert_eq!(core.read(GRSTCTL), grstctl::AHBIDL);
    assert_eq!(core.read(GCCFG), 0);
    assert!(!core.pulls_up());
}

#[test]
fn debugger_reads_without_popping() {
    let mut core = with_bulk();
    core.output(0, 1, false, b"data");
    assert_eq!(core.peek(GRXSTSP), core.peek(GRXSTSP));
    core.read(GRXSTSP);
    assert_eq!(core.peek(FIFO), core.read(FIFO));
}

#[test]
fn transmit_fifo_accepts_no_more_than_its_size() {
    let mut core = with_bulk();
    for word in 0..16 {
        core.write(FIFO + FIFO_SPAN, word);
    }
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + TXFSTS), 0);
    assert_eq!(core.take_misuse(), None);
    core.write(FIFO + FIFO_SPAN, 16);
    assert!(core.take_misuse().is_some_and(|reason| reason.starts_with("34.11.2")));
    assert_eq!(core.take_misuse(), None);
}

#[test]
fn fifo_that_shares_its_ram_is_noticed() {
    for (fifo, allocation) in [
        (DIEPTXF1, 16 << 16 | 63),
        (DIEPTXF1, 16 << 16 | 79),
        (DIEPTXF1, 16 << 16 | 305),
        (DIEPTXF0, 17 << 16 | 64),
    ] {
        let mut core = with_bulk();
        core.write(fifo, allocation);
        core.write(FIFO + FIFO_SPAN, 0);
        assert!(
            core.take_misuse().is_some_and(|reason| reason.starts_with("34.11:")),
            "{allocation:#x}"
        );
    }
    let mut core = with_bulk();
    core.write(DIEPTXF1, 16 << 16 | 304);
    core.write(FIFO + FIFO_SPAN, 0);
    assert_eq!(core.take_misuse(), None, "up to the last word");
}
