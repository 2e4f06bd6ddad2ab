//! Transfers of several packets, NAK, STALL and SETUP (RM0090, 34.17.5, 34.17.6, 34.16.4).

use super::*;

const DIEPCTL_1: u32 = DIEP + ENDPOINT_SPAN + CTL;
const DOEPCTL_1: u32 = DOEP + ENDPOINT_SPAN + CTL;

fn set(core: &mut Core, register: u32, bits: u32) {
    let held = core.read(register);
    core.write(register, held | bits);
}

/// Sends a packet to the host, which acknowledges it.
fn collect(core: &mut Core, endpoint: u8) -> Option<usize> {
    let Reply::Data { bytes, .. } = core.input(0, endpoint) else {
        return None;
    };
    core.acknowledged(endpoint);
    Some(bytes.len())
}

#[test]
fn in_transfer_sends_counted_empty_packet_at_end() {
    let mut core = with_bulk();
    core.write(DIEPTXF1, 32 << 16 | 80);
    core.write(DIEP + ENDPOINT_SPAN + TSIZ, 3 << eptsiz::PKTCNT_AT | 128);
    set(&mut core, DIEPCTL_1, epctl::CNAK | epctl::EPENA);
    (0..32).for_each(|word| core.write(FIFO + FIFO_SPAN, word));
    let mut packets = Vec::new();
    for _ in 0..3 {
        assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::XFRC, 0);
        packets.push((
            collect(&mut core, 1),
            core.read(DIEP + ENDPOINT_SPAN + TSIZ) >> eptsiz::PKTCNT_AT,
            core.read(DIEP + ENDPOINT_SPAN + TSIZ) & eptsiz::XFRSIZ,
        ));
    }
    assert_eq!(packets, [(Some(64), 2, 64), (Some(64), 1, 0), (Some(0), 0, 0)]);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::XFRC, epint::XFRC);
    assert_eq!(collect(&mut core, 1), None);
}

#[test]
fn out_transfer_ends_by_count_or_short_packet() {
    for (lengths, left) in [(&[64, 64][..], 0), (&[64, 63], 1), (&[0], 128)] {
        let mut core = with_bulk();
        core.write(GRXFSIZ, 80);
        core.write(DOEP + ENDPOINT_SPAN + TSIZ, 2 << eptsiz::PKTCNT_AT | 128);
        for (nth, &length) in lengths.iter().enumerate() {
            assert_eq!(core.output(0, 1, nth % 2 == 1, &vec![0; length]), Handshake::Ack);
        }
        assert_eq!(core.read(DOEP + ENDPOINT_SPAN + TSIZ) & eptsiz::XFRSIZ, left);
        assert_eq!(core.read(DOEPCTL_1) & epctl::NAKSTS, epctl::NAKSTS, "{lengths:?}");
        let kinds: Vec<u32> = std::iter::from_fn(|| {
            let more = core.read(GINTSTS) & gint::RXFLVL != 0;
            more.then(|| kind(core.read(GRXSTSP)))
        })
        .collect();
        let done = kinds.iter().filter(|&&kind| kind == grxsts::OUT_DONE).count();
        assert_eq!((done, kinds.last()), (1, Some(&grxsts::OUT_DONE)));
    }
}

#[test]
fn variant_disables_out_endpoint_after_its_transfer() {
    for disables_out_endpoints in [false, true] {
        let mut core = with_bulk();
        core.variant.disables_out_endpoints = disables_out_endpoints;
        assert_eq!(core.output(0, 1, false, &[1]), Handshake::Ack);
        let enabled = core.read(DOEP + ENDPOINT_SPAN + CTL) & epctl::EPENA != 0;
        assert_eq!(enabled, !disables_out_endpoints);
        core.write(DOEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 64);
        set(&mut core, DOEP + ENDPOINT_SPAN + CTL, epctl::CNAK);
        let answer = if enabled { Handshake::Ack } else { Handshake::Nak };
        assert_eq!(core.output(0, 1, true, &[2]), answer);
    }
}

#[test]
fn variant_keeps_the_count_of_setups() {
    let mut core = connected();
    core.variant.keeps_setup_count = true;
    core.write(DOEP + TSIZ, 3 << eptsiz::STUPCNT_AT);
    assert!(core.setup(0, [0; 8]));
    assert_eq!(core.read(DOEP + TSIZ) >> eptsiz::STUPCNT_AT, 3);
}

#[test]
fn disabled_out_endpoint_naks_and_flags_it() {
    let mut core = connected();
    core.write(DOEP + ENDPOINT_SPAN + TSIZ, 1 << eptsiz::PKTCNT_AT | 64);
    core.write(DOEPCTL_1, ACTIVE_OUT | epctl::CNAK);
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::Nak);
    let flags = core.read(DOEP + ENDPOINT_SPAN + INT);
    assert_eq!(flags & epint::OTEPDIS, epint::OTEPDIS);
}

#[test]
fn in_token_without_data_sets_flag() {
    let mut core = with_bulk();
    assert_eq!(core.input(0, 1), Reply::Nak);
    let flags = core.read(DIEP + ENDPOINT_SPAN + INT);
    assert_eq!(flags & epint::ITTXFE, epint::ITTXFE);
}

#[test]
fn snak_holds_ready_packet_cnak_releases_it() {
    let mut core = with_bulk();
    send(&mut core, b"x");
    set(&mut core, DIEPCTL_1, epctl::SNAK);
    assert_eq!(core.read(DIEPCTL_1) & epctl::NAKSTS, epctl::NAKSTS);
    assert_eq!(core.read(DIEP + ENDPOINT_SPAN + INT) & epint::INEPNE, epint::INEPNE);
    assert_eq!(core.input(0, 1), Reply::Nak);
    set(&mut core, DIEPCTL_1, epctl::CNAK);
    assert_eq!(
        core.read(DIEP + ENDPOINT_SPAN + INT) & epint::INEPNE,
        0,
        "CNAK clears it"
    );
    assert_eq!(collect(&mut core, 1), Some(1));

    set(&mut core, DOEPCTL_1, epctl::SNAK);
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::Nak);
    set(&mut core, DOEPCTL_1, epctl::CNAK);
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::Ack);
}

#[test]
fn stall_precedes_nak_until_firmware_clears_it() {
    let mut core = with_bulk();
    send(&mut core, b"x");
    for control in [DIEPCTL_1, DOEPCTL_1] {
        set(&mut core, control, epctl::STALL | epctl::SNAK);
    }
    core.write(DCTL, device::SGINAK | device::SGONAK);
    assert_eq!(core.input(0, 1), Reply::Stall);
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::Stall);
    assert!(core.setup(0, [0; 8]), "a SETUP is taken");
    assert_eq!(core.input(0, 1), Reply::Stall, "and clears endpoint 0's stall only");
    core.write(DCTL, device::CGINAK | device::CGONAK);
    for control in [DIEPCTL_1, DOEPCTL_1] {
        let held = core.read(control);
        core.write(control, held & !epctl::STALL | epctl::CNAK);
    }
    assert_eq!(collect(&mut core, 1), Some(1));
    assert_eq!(core.output(0, 1, false, &[0]), Handshake::Ack);
}

#[test]
fn endpoint_0_stalls_until_the_next_setup() {
    let mut core = connected();
    core.setup(0, [0xFF; 8]);
    for control in [DIEP, DOEP] {
        set(&mut core, control + CTL, epctl::STALL);
    }
    assert_eq!(core.input(0, 0), Reply::Stall);
    assert_eq!(core.output(0, 0, true, &[0; 8]), Handshake::Stall);
    for control in [DIEP, DOEP] {
        core.write(control + CTL, 0);
    }
    assert_eq!(core.input(0, 0), Reply::Stall, "the firmware cannot take it back");
    assert_eq!(core.output(0, 0, true, &[0; 8]), Handshake::Stall);
    for control in [DIEP, DOEP] {
        set(&mut core, control + CTL, epctl::CNAK);
    }
    assert!(core.setup(0, [0x80; 8]));
    for control in [DIEP, DOEP] {
        let held = core.read(control + CTL);
        assert_eq!(held & (epctl::STALL | epctl::NAKSTS), epctl::NAKSTS);
    }
    assert_eq!(core.input(0, 0), Reply::Nak);
    assert_eq!(core.output(0, 0, true, &[0; 8]), Handshake::Nak, "both NAKs are set");
}

#[test]
fn firmware_sets_data_pid_after_stall() {
    for (command, toggle) in [(epctl::SD0PID, false), (epctl::SD1PID, true)] {
        let mut core = with_bulk();
        send(&mut core, b"x");
        assert_eq!(collect(&mut core, 1), Some(1));
        set(&mut core, DIEPCTL_1, command);
        send(&mut core, b"y");
        assert!(matches!(core.input(0, 1), Reply::Data { toggle: pid, .. } if pid == toggle));
    }
}

#[test]
fn consecutive_setups_are_counted_and_done_once() {
    let mut core = connected();
    core.write(DOEP + TSIZ, 3 << eptsiz::STUPCNT_AT);
    core.write(DCTL, device::SGONAK);
    core.read(GRXSTSP);
    let mut left = Vec::new();
    for nth in 0..4 {
        assert!(core.setup(0, [nth; 8]));
        left.push(core.read(DOEP + TSIZ) >> eptsiz::STUPCNT_AT);
    }
    assert_eq!(left, [2, 1, 0, 0]);
    core.input(0, 0);
    let mut setups = Vec::new();
    loop {
        match kind(core.read(GRXSTSP)) {
            grxsts::SETUP_DATA => setups.push([core.read(FIFO), core.read(FIFO)].map(|word| word & 0xFF)),
            last => {
                assert_eq!(last, grxsts::SETUP_DONE);
                break;
            }
        }
    }
    assert_eq!(setups, [[0; 2], [1; 2], [2; 2], [3; 2]]);
    assert_eq!(core.read(GINTSTS) & gint::RXFLVL, 0);
    assert_eq!(core.read(DOEP + INT) & epint::STUP, epint::STUP);
}
