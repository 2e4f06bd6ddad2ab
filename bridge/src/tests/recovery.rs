//! Recovery: factory settings after crashed starts, CAN off, and the configuration in flash untouched until a save.

extern crate std;

use std::vec::Vec;

use super::rig::{Rig, at, ling, motion};
use crate::can::Node;
use crate::config::{ArmKind, Can, Config, HostTimeout, Poll};
use crate::control::{Event, Failure, Identity, Reply, Request, Subscription};
use crate::start::{Cause, MAX_CRASHED_STARTS, Recovery, StartLog};
use crate::store::Saved;
use crate::{Action, Bridge, CanEvent, Erase, Start, UsbEvent};

/// An adapter in recovery.
fn recovering(crashed_in_load: bool) -> Rig {
    let mut rig = Rig::new(Config::default());
    let start = Start {
        recovery_starts: 1,
        recovery: Some(Recovery { crashed_in_load }),
        ..Start::default()
    };
    rig.bridge = Bridge::new(Identity::default(), Config::default(), start);
    rig.bridge.usb_event(UsbEvent::Configured(true), at(0));
    rig
}

/// A configuration that uses the bus.
fn on_can() -> Config {
    Config {
        poll: Poll::Hertz(100),
        can: Can {
            node: Node::MAX,
            telemetry_hz: 100,
            unsolicited: true,
            ..Can::default()
        },
        ..Config::default()
    }
}

#[test]
fn recovery_is_reported_and_counted() {
    for (mut rig, active) in [(Rig::new(Config::default()), false), (recovering(false), true)] {
        assert_eq!(rig.call(Request::GetRecovery), Reply::Recovery { active });
        assert_eq!(rig.bridge.update(at(0)).is_in_recovery, active);
        assert_eq!(rig.bridge.counters().recovery_starts, active.into());
    }
}

#[test]
fn subscriber_learns_of_recovery_and_its_end() {
    let mut rig = recovering(false);
    let frames = Subscription {
        frames: true,
        events: false,
    };
    rig.call(Request::Subscribe(frames));
    assert_eq!(rig.events, []);
    for _ in 0..2 {
        rig.subscribe();
        rig.run(1_000);
        let events: Vec<_> = rig.events.drain(..).map(|(_, event)| event).collect();
        assert_eq!(events, [Event::Recovery { active: true }]);
    }
    rig.request(Request::SaveConfig);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(1_000);
    let events: Vec<_> = rig.events.drain(..).map(|(_, event)| event).collect();
    assert_eq!(events, [Event::Recovery { active: false }]);
    rig.subscribe();
    rig.run(1_000);
    assert_eq!(rig.events, []);
}

#[test]
fn can_is_silent_until_configuration_is_saved() {
    let mut rig = recovering(false);
    assert_eq!(rig.bridge.can_config(), None);
    rig.call(Request::SetConfig(on_can()));
    rig.arm_sends(&ling(0x05, 0, &[1]));
    for _ in 0..3 {
        rig.bridge.can_event(CanEvent::BusOff, at(rig.now));
        rig.run(1_000_000);
    }
    assert_eq!(rig.bridge.can_config(), None);
    assert_eq!(
        (&rig.frames[..], &rig.can[..], &rig.actions[..]),
        (&[][..], &[][..], &[][..])
    );
    let c = rig.bridge.counters();
    assert_eq!((c.can_frames_sent, c.dropped_events, c.dropped_can_answers), (0, 0, 0));
    assert!(c.requests_poll > 100);

    rig.request(Request::SaveConfig);
    assert_eq!(rig.actions, [Action::Save(on_can(), Erase::Allowed)]);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(1_000_000);
    assert_eq!(rig.replies.last().map(|(_, reply)| reply), Some(&Reply::Done));
    assert_eq!(rig.actions.last(), Some(&Action::RestartCan(on_can().can)));
    assert_eq!(rig.bridge.can_config(), Some(on_can().can));
    assert_eq!(rig.call(Request::GetRecovery), Reply::Recovery { active: false });
    assert!(rig.frames.len() > 100);
}

#[test]
fn failed_save_does_not_end_recovery() {
    let mut rig = recovering(true);
    rig.request(Request::SaveConfig);
    rig.bridge.saved(Err(Failure::Flash), at(rig.now));
    rig.run(1_000);
    assert_eq!(rig.call(Request::GetRecovery), Reply::Recovery { active: true });
    assert_eq!(rig.actions, [Action::Replace(Config::default())]);
}

#[test]
fn store_that_crashes_the_load_is_replaced_unread() {
    let mut rig = recovering(true);
    assert_eq!(rig.call(Request::GetSaved), Reply::Saved(Saved::Unreadable));
    for (request, action) in [
        (Request::SaveConfig, Action::Replace(Config::default())),
        (Request::ResetConfig, Action::Erase),
    ] {
        let mut rig = recovering(true);
        rig.request(request);
        assert_eq!(rig.actions, [action]);
        rig.bridge.saved(Ok(()), at(rig.now));
        rig.run(1_000);
        // Now it can be read.
        rig.request(Request::GetSaved);
        assert_eq!(rig.actions.last(), Some(&Action::Load));
    }
}

#[test]
fn saved_configuration_is_read_on_request() {
    for mut rig in [Rig::new(Config::default()), recovering(false)] {
        let config = Saved::Config(on_can());
        for (loaded, reply) in [
            (Ok(config), Reply::Saved(config)),
            (Ok(Saved::Nothing), Reply::Saved(Saved::Nothing)),
            (Err(Failure::Flash), Reply::Failed(Failure::Flash)),
        ] {
            let sequence = rig.request(Request::GetSaved);
            assert_eq!(rig.actions.pop(), Some(Action::Load));
            assert_eq!(rig.call(Request::SaveConfig), Reply::Failed(Failure::Busy));
            rig.bridge.loaded(loaded, at(rig.now));
            rig.run(1_000);
            assert_eq!(rig.replies.pop(), Some((sequence, reply)));
        }
        let c = rig.bridge.counters();
        assert_eq!((c.config_saves, c.config_failures), (0, 0));
    }
}

#[test]
fn flash_is_not_read_during_armed_stream() {
    let mut rig = Rig::new(Config {
        host_timeout: HostTimeout {
            after_ms: 300,
            torque_off: true,
        },
        ..Config::default()
    });
    for _ in 0..3 {
        rig.usb_out.extend(motion());
        rig.run(10_000);
    }
    assert_eq!(rig.call(Request::GetSaved), Reply::Failed(Failure::StreamArmed));
}

/// The adapter after watchdog resets of runs with these settings in force.
fn after_crashes(config: &Config) -> Bridge {
    let mut log = StartLog::begin([0; StartLog::WORDS], Cause::PowerOn);
    let mut words = log.running(at(0), config).unwrap();
    for _ in 0..MAX_CRASHED_STARTS {
        log = StartLog::begin(words, Cause::Watchdog);
        words = log.to_words();
    }
    let bridge = Bridge::new(Identity::default(), log.config(), log.start(false, false));
    assert!(bridge.can_config().is_none());
    bridge
}

#[test]
fn recovery_has_the_rate_of_the_arm() {
    let config = Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    };
    let mut bridge = after_crashes(&config);
    assert_eq!((bridge.config(), bridge.line_coding().baud), (config, 115_200));
    assert_eq!(bridge.counters().watchdog_resets, MAX_CRASHED_STARTS.into());
}

#[test]
fn torque_goes_off_in_recovery_if_configured() {
    for torque_off in [true, false] {
        let host_timeout = HostTimeout {
            after_ms: 300,
            torque_off,
        };
        let mut rig = Rig::new(Config::default());
        rig.bridge = after_crashes(&Config {
            host_timeout,
            ..Config::default()
        });
        rig.bridge.usb_event(UsbEvent::Configured(true), at(0));
        for _ in 0..3 {
            rig.usb_out.extend(motion());
            rig.run(10_000);
        }
        rig.run(400_000);
        assert_eq!(rig.line().ends_with(&ling(0x05, 0, &[0])), torque_off);
        assert_eq!(rig.bridge.counters().host_silences, 1);
    }
}
