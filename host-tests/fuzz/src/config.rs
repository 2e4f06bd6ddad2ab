//! Arbitrary configurations of an adapter, and messages of its control port.

use armwire_bridge::can::Node;
use armwire_bridge::config::{ArmKind, CAN_BIT_RATES, CAN_DATA_BIT_RATES, Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{
    ArmIdentity, Event, Failure, FrameBytes, Histogram, Identity, Initiator, Latencies, LineHolder, LineState, Refusal,
    Reply, Request, Subscription,
};
use armwire_bridge::{Counters, LineCoding, Parity, StopBits};

use crate::subject::any_bytes;
use crate::{Result, Unstructured};

/// Any configuration. Most are valid.
pub fn any_config(u: &mut Unstructured<'_>) -> Result<Config> {
    let arm = *u.choose(&ArmKind::ALL)?;
    let poll = match u.int_in_range(0..=3)? {
        0 => Poll::Fastest,
        1 => Poll::Hertz(u.arbitrary::<u16>()? % 1_002),
        _ => Poll::Off,
    };
    let can = Can {
        node: Node::new(u.int_in_range(0..=15)?).expect("in range"),
        bit_rate: match u.arbitrary::<u8>()? {
            0 => u.arbitrary()?,
            n => CAN_BIT_RATES[usize::from(n) % CAN_BIT_RATES.len()],
        },
        data_bit_rate: match u.arbitrary::<u8>()? {
            0 => Some(u.arbitrary()?),
            n @ 1..64 => Some(CAN_DATA_BIT_RATES[usize::from(n) % CAN_DATA_BIT_RATES.len()]),
            _ => None,
        },
        telemetry_hz: u.arbitrary::<u16>()? % 1_002,
        commands: u.arbitrary()?,
        command_timeout_ms: u.arbitrary::<u16>()? % 10_002,
        unsolicited: u.arbitrary()?,
    };
    let host_timeout = HostTimeout {
        after_ms: u.arbitrary()?,
        torque_off: u.arbitrary()?,
    };
    Ok(Config {
        arm,
        poll,
        can,
        host_timeout,
    })
}

/// Any valid configuration.
pub fn any_good_config(u: &mut Unstructured<'_>) -> Result<Config> {
    let mut config = any_config(u)?;
    if !CAN_BIT_RATES.contains(&config.can.bit_rate) {
        config.can.bit_rate = 1_000_000;
    }
    config.can.data_bit_rate = config.can.data_bit_rate.map(|_| CAN_DATA_BIT_RATES[1]);
    config.can.telemetry_hz %= config.can.max_telemetry_hz() + 1;
    config.can.command_timeout_ms = config.can.command_timeout_ms.clamp(1, 10_000);
    config.can.commands &= config.arm == ArmKind::Ling;
    config.host_timeout.after_ms %= 1_000;
    config.poll = match (config.arm, config.poll) {
        (ArmKind::Alpha1Servo | ArmKind::Raw, _) => Poll::Off,
        (_, Poll::Hertz(hertz)) => Poll::Hertz(hertz.clamp(1, 1_000)),
        (_, poll) => poll,
    };
    assert_eq!(config.check(), Ok(()));
    Ok(config)
}

/// Any request on the control port.
pub fn any_request(u: &mut Unstructured<'_>) -> Result<Request> {
    Ok(match u.int_in_range(0..=13)? {
        0 => Request::Identify,
        1 => Request::IdentifyArm,
        2 => Request::GetConfig,
        3 if u.arbitrary()? => Request::SetConfig(any_config(u)?),
        3 => Request::SetConfig(any_good_config(u)?),
        4 => Request::SaveConfig,
        5 => Request::ResetConfig,
        6 => Request::GetCounters,
        7 => Request::GetLatencies,
        8 => Request::Subscribe(Subscription {
            frames: u.arbitrary()?,
            events: u.arbitrary()?,
        }),
        9 => Request::Restart,
        10 => Request::GetLine,
        11 => Request::HoldLine,
        12 => Request::ReleaseLine,
        _ if u.arbitrary()? => Request::EndStream,
        _ => Request::RestartIntoBootLoader,
    })
}

const INITIATORS: [Initiator; 5] = [
    Initiator::Usb,
    Initiator::Can,
    Initiator::Poll,
    Initiator::Command,
    Initiator::Adapter,
];

const REFUSALS: [Refusal; 7] = [
    Refusal::QueueFull,
    Refusal::NotAFrame,
    Refusal::Incomplete,
    Refusal::Stale,
    Refusal::OutOfRange,
    Refusal::LineHeld,
    Refusal::OtherRate,
];

fn any_frame(u: &mut Unstructured<'_>) -> Result<FrameBytes> {
    Ok(FrameBytes::from_slice(any_bytes(u, 74)?).unwrap_or_default())
}

/// Any event of an adapter.
pub fn any_event(u: &mut Unstructured<'_>) -> Result<Event> {
    let initiator = *u.choose(&INITIATORS)?;
    Ok(match u.int_in_range(0..=3)? {
        0 => Event::Frame {
            initiator: Some(initiator).filter(|_| u.arbitrary().unwrap_or(false)),
            bytes: any_frame(u)?,
        },
        1 => Event::HostSilent {
            initiator,
            dropped: u.arbitrary()?,
            torque_off: u.arbitrary()?,
        },
        2 => Event::Refused {
            initiator,
            reason: *u.choose(&REFUSALS)?,
        },
        _ => Event::BusOff { off: u.arbitrary()? },
    })
}

fn any_string<const N: usize>(u: &mut Unstructured<'_>) -> Result<heapless::String<N, u8>> {
    let text: &str = u.arbitrary()?;
    Ok(text.try_into().unwrap_or_default())
}

fn any_coding(u: &mut Unstructured<'_>) -> Result<LineCoding> {
    Ok(LineCoding {
        baud: u.arbitrary()?,
        parity: *u.choose(&[Parity::None, Parity::Odd, Parity::Even])?,
        stop_bits: *u.choose(&[StopBits::One, StopBits::Two])?,
    })
}

/// Any reply except [`Reply::BadConfig`].
pub fn any_reply(u: &mut Unstructured<'_>) -> Result<Reply> {
    Ok(match u.int_in_range(0..=8)? {
        0 => Reply::Done,
        1 => Reply::Unsupported {
            version: u.arbitrary()?,
        },
        2 => Reply::Identity(Identity {
            version: u.arbitrary()?,
            firmware: any_string(u)?,
            commit: any_string(u)?,
            board: any_string(u)?,
            serial: any_string(u)?,
            can_fd: u.arbitrary()?,
        }),
        3 => Reply::Arm(ArmIdentity {
            kind: *u.choose(&ArmKind::ALL)?,
            answer: Some(any_frame(u)?).filter(|_| u.arbitrary().unwrap_or(false)),
        }),
        4 => Reply::Config(any_config(u)?),
        5 => {
            // Few enough bytes.
            let mut counters = Counters::default();
            counters.frames = u.arbitrary()?;
            counters.config_failures = u.arbitrary()?;
            counters.dropped_can_frames = u.arbitrary()?;
            Reply::Counters(counters)
        }
        6 => Reply::Latencies(Latencies {
            answer: Histogram { counts: u.arbitrary()? },
            turn: Histogram { counts: u.arbitrary()? },
            poll: Histogram { counts: u.arbitrary()? },
        }),
        7 => Reply::Line(LineState {
            coding: any_coding(u)?,
            arm: any_coding(u)?,
            holder: *u.choose(&[LineHolder::Nobody, LineHolder::OtherRate, LineHolder::HoldLine])?,
            waiting: match u.arbitrary()? {
                true => Some(any_coding(u)?),
                false => None,
            },
        }),
        _ => Reply::Failed(match u.int_in_range(0..=5)? {
            0 => Failure::Flash,
            1 => Failure::Busy,
            2 => Failure::StreamArmed,
            3 => Failure::LineHeld,
            4 => Failure::SupplyLow,
            _ => Failure::TooManySaves { wait_s: u.arbitrary()? },
        }),
    })
}
