//! Reset, suspend and disconnect, with a host where needed (RM0090, 34.4.2, 34.16.2, 34.16.4, 34.17.3).

use super::*;
use crate::usb::host::Host;

/// Runs the wire for this time.
fn run(host: &mut Host, core: &mut Core, span: Nanos) {
    let until = core.now + span;
    while let Some(next) = host.poll(core.now, core).filter(|&next| next <= until) {
        core.now = next;
    }
    core.now = until;
    host.poll(until, core);
}

/// A controller that a host has reset, with frames on the wire.
fn on_a_host() -> (Host, Core) {
    let mut core = Core {
        clocked: true,
        ..Core::new()
    };
    core.write(GCCFG, gccfg::PWRDWN | gccfg::NOVBUSSENS);
    core.write(GAHBCFG, gahbcfg::GINTMSK);
    let mut host = Host::default();
    host.set_cable(true);
    run(&mut host, &mut core, Nanos(1));
    host.reset();
    run(&mut host, &mut core, Nanos::from_millis(20));
    assert!(host.running());
    core.write(GINTSTS, !0);
    (host, core)
}

#[test]
fn reset_values_match_the_manual() {
    let mut core = Core::new();
    for (register, value) in [
        (GAHBCFG, 0),
        (GUSBCFG, 0x0000_0A00),
        (GRSTCTL, 0x8000_0000),
        (GINTSTS, 0x0400_0020),
        (GRXFSIZ, 0x0000_0200),
        (CID, 0x0000_1200),
        (DCFG, 0x0220_0000),
        (DIEP + CTL, epctl::USBAEP),
        (DOEP + CTL, epctl::USBAEP),
        (DIEP + ENDPOINT_SPAN + CTL, 0),
    ] {
        assert_eq!(core.read(register), value, "{register:#x}");
    }
}

#[test]
fn host_sees_soft_disconnect_and_return() {
    let (mut host, mut core) = on_a_host();
    let epoch = host.epoch();
    core.write(DCTL, device::SDIS);
    run(&mut host, &mut core, Nanos::from_millis(5));
    assert!(!host.connected() && !host.running());
    assert_eq!(
        core.read(GINTSTS) & gint::USBSUSP,
        0,
        "a disconnected device does not suspend"
    );
    core.write(DCTL, 0);
    run(&mut host, &mut core, Nanos::from_millis(1));
    assert!(host.connected() && host.epoch() > epoch);
    host.reset();
    run(&mut host, &mut core, Nanos::from_millis(20));
    assert_eq!(
        core.read(GINTSTS) & (gint::USBRST | gint::ENUMDNE),
        gint::USBRST | gint::ENUMDNE
    );
}

#[test]
fn quiet_bus_suspends_until_resume_or_reset() {
    for resets in [false, true] {
        let (mut host, mut core) = on_a_host();
        core.write(GINTMSK, gint::USBSUSP | gint::WKUPINT);
        host.suspend();
        run(&mut host, &mut core, Nanos(2_999_999));
        assert_eq!((core.read(DSTS) & device::SUSPSTS, core.interrupt()), (0, false));
        run(&mut host, &mut core, Nanos(1));
        assert_eq!(core.read(DSTS) & device::SUSPSTS, device::SUSPSTS);
        assert_eq!(
            core.read(GINTSTS) & (gint::ESUSP | gint::USBSUSP),
            gint::ESUSP | gint::USBSUSP
        );
        assert!(core.interrupt());
        core.write(GINTSTS, gint::ESUSP | gint::USBSUSP);
        assert!(!core.interrupt());
        run(&mut host, &mut core, Nanos::from_millis(100));
        assert_eq!(core.read(GINTSTS) & gint::USBSUSP, 0, "once");
        if resets {
            host.reset();
        } else {
            host.resume();
        }
        run(&mut host, &mut core, Nanos::from_millis(30));
        assert!(host.running());
        assert_eq!(core.read(DSTS) & device::SUSPSTS, 0);
        assert_eq!(core.interrupt(), !resets, "WKUPINT");
        let frame = core.read(DSTS) >> device::FNSOF_AT;
        run(&mut host, &mut core, Nanos::from_millis(3));
        assert_eq!(core.read(DSTS) >> device::FNSOF_AT, frame + 3, "frames pass");
    }
}

#[test]
fn active_device_is_not_woken() {
    let mut core = connected();
    core.resume();
    assert_eq!(core.read(GINTSTS) & gint::WKUPINT, 0);
}

#[test]
fn reset_in_transfer_keeps_received_and_holds_pending() {
    let mut core = with_bulk();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
    assert_eq!(core.output(0, 1, false, &[7; 64]), Handshake::Ack);
    send(&mut core, b"half");
    assert!(matches!(core.input(0, 1), Reply::Data { .. }), "and no acknowledge yet");
    core.reset();
    core.reset_done();
    assert_eq!(core.input(0, 1), Reply::NoResponse);
    assert_eq!(core.output(0, 1, true, &[7; 64]), Handshake::NoResponse);
    for control in [DIEP, DOEP] {
        let held = core.read(control + ENDPOINT_SPAN + CTL);
        assert_eq!(held & (epctl::USBAEP | epctl::NAKSTS), epctl::NAKSTS);
        core.write(control + ENDPOINT_SPAN + CTL, epctl::USBAEP | epctl::SD0PID | 64);
    }
    assert_eq!(core.input(0, 1), Reply::Nak, "until the firmware clears NAK");
    assert_eq!(core.output(0, 1, false, &[8; 64]), Handshake::Nak);
    let status = core.read(GRXSTSP);
    assert_eq!(
        (status & 0xF, kind(status)),
        (1, grxsts::OUT_DATA),
        "the firmware flushes it or reads it"
    );
    assert_eq!(
        core.read(DIEP + ENDPOINT_SPAN + TXFSTS),
        15,
        "and so with what was to go"
    );
}

#[test]
fn reset_in_setup_ends_the_setup() {
    let mut core = connected();
    core.setup(0, [1; 8]);
    core.reset();
    core.reset_done();
    core.write(GRSTCTL, grstctl::RXFFLSH);
    core.input(0, 0);
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0, "no setup is done");
    assert_eq!(core.read(DOEP + INT) & epint::STUP, 0);
}

#[test]
fn reset_leaves_address_and_stall_to_firmware() {
    let mut core = with_bulk();
    core.write(DCFG, 7 << device::DAD_AT);
    core.input(7, 0);
    core.write(DIEP + ENDPOINT_SPAN + CTL, epctl::USBAEP | epctl::STALL | 64);
    core.reset();
    core.reset_done();
    assert!(!core.setup(0, [0; 8]), "it has the old address");
    core.write(DCFG, 0);
    assert!(core.setup(0, [0; 8]));
    let held = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, held | epctl::USBAEP);
    assert_eq!(core.input(0, 1), Reply::Stall);
    core.write(DIEP + ENDPOINT_SPAN + CTL, epctl::USBAEP | 64);
    assert_eq!(core.input(0, 1), Reply::Nak);
}

#[test]
fn simultaneous_set_and_clear_nak_is_reported() {
    for register in [DIEP + ENDPOINT_SPAN + CTL, DOEP + ENDPOINT_SPAN + CTL] {
        let mut core = with_bulk();
        core.write(register, epctl::USBAEP | epctl::SNAK);
        core.write(register, epctl::USBAEP | epctl::CNAK);
        assert_eq!(core.take_misuse(), None);
        core.write(register, epctl::USBAEP | epctl::SNAK | epctl::CNAK);
        assert!(core.take_misuse().is_some());
    }
}

#[test]
fn setup_leaves_unread_answer_enabled_but_silent() {
    let mut core = connected();
    core.write(DIEP + TSIZ, 1 << eptsiz::PKTCNT_AT);
    core.write(DIEP + CTL, epctl::CNAK | epctl::EPENA);
    assert!(core.setup(0, [0; 8]));
    assert_eq!(core.input(0, 0), Reply::Nak);
    assert_ne!(core.read(DIEP + CTL) & epctl::EPENA, 0);
}

/// The same controller with steps of maximum duration.
fn slow() -> Core {
    let mut core = with_bulk();
    core.clock = Clock::new(crate::Timing::Worst, 0);
    core
}

fn later(core: &mut Core, nanos: u64) {
    core.now = core.now + Nanos(nanos);
    core.advance();
}

#[test]
fn endpoint_stays_enabled_until_disable_is_done() {
    let mut core = slow();
    send(&mut core, &[1; 64]);
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::SNAK | epctl::EPDIS);
    later(&mut core, 19_000);
    assert_ne!(core.read(DIEP + ENDPOINT_SPAN + CTL) & epctl::EPENA, 0);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::EPDISD, 0);
    later(&mut core, 1_000);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + CTL) & epctl::EPENA, 0);
    assert_ne!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::EPDISD, 0);
}

#[test]
fn enable_during_disable_is_reported() {
    let mut core = slow();
    send(&mut core, &[1; 64]);
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::SNAK | epctl::EPDIS);
    assert_eq!(core.take_misuse(), None);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control | epctl::CNAK | epctl::EPENA);
    assert!(core.take_misuse().is_some());
}

#[test]
fn flush_and_reset_bits_read_set_until_done() {
    for (bits, nanos) in [
        (grstctl::TXFFLSH | 1 << grstctl::TXFNUM_AT, 1_000),
        (grstctl::RXFFLSH, 1_000),
        (grstctl::CSRST, 10_000),
    ] {
        let bit = bits & !grstctl::TXFNUM;
        let mut core = slow();
        core.write(GRSTCTL, bits);
        later(&mut core, nanos - 1);
        assert_ne!(core.read(GRSTCTL) & bit, 0, "{bits:#x}");
        later(&mut core, 1);
        assert_eq!(core.read(GRSTCTL) & bit, 0, "{bits:#x}");
    }
}

#[test]
fn transmit_fifo_write_during_flush_is_reported() {
    let mut core = slow();
    core.write(GRSTCTL, grstctl::TXFFLSH | 1 << grstctl::TXFNUM_AT);
    core.write(FIFO + FIFO_SPAN, 0);
    assert!(core.take_misuse().is_some());
}

#[test]
fn flush_of_an_endpoint_that_may_send_is_reported() {
    const FLUSH: u32 = grstctl::TXFFLSH | 1 << grstctl::TXFNUM_AT;
    for everything in [FLUSH, grstctl::TXFFLSH | grstctl::ALL << grstctl::TXFNUM_AT] {
        let mut core = slow();
        send(&mut core, b"x");
        core.write(GRSTCTL, everything);
        assert!(core.take_misuse().is_some());
    }
    let mut core = slow();
    core.write(GRSTCTL, FLUSH);
    assert_eq!(core.take_misuse(), None, "disabled");
    later(&mut core, 1_000);
    send(&mut core, b"x");
    assert!(matches!(core.input(0, 1), Reply::Data { .. }));
    let control = core.read(DIEP + ENDPOINT_SPAN + CTL);
    core.write(DIEP + ENDPOINT_SPAN + CTL, control & !epctl::EPENA | epctl::SNAK);
    core.write(GRSTCTL, FLUSH);
    assert!(core.take_misuse().is_some(), "the NAK is not in force");
    later(&mut core, 2_000);
    core.write(GRSTCTL, FLUSH);
    assert!(core.take_misuse().is_some(), "the packet is on the wire");
    core.start_of_frame(1);
    core.write(GRSTCTL, FLUSH);
    assert_eq!(core.take_misuse(), None);
}

#[test]
fn global_naks_are_in_force_after_their_time() {
    let mut core = slow();
    core.write(DCTL, device::SGINAK | device::SGONAK);
    later(&mut core, 9_999);
    assert_eq!(core.read(DCTL) & (device::GINSTS | device::GONSTS), 0);
    later(&mut core, 1);
    assert_eq!(
        core.read(DCTL) & (device::GINSTS | device::GONSTS),
        device::GINSTS | device::GONSTS
    );
    core.write(DCTL, device::CGINAK | device::CGONAK);
    assert_eq!(core.read(DCTL) & (device::GINSTS | device::GONSTS), 0);
}
