//! An adapter without CAN: settings of the bus are refused by name, and nothing is due on it.

extern crate std;

use super::rig::{Rig, at};
use crate::can::Node;
use crate::config::{ArmKind, Can, Config, ConfigError, HostTimeout, Poll};
use crate::control::{Identity, Reply, Request};
use crate::start::Recovery;
use crate::store::Saved;
use crate::{Action, Bridge, Erase, Start, UsbEvent};

/// An adapter without CAN, and this configuration in its flash.
fn started(saved: Config, start: Start) -> Rig {
    let mut rig = Rig::new(Config::default());
    let identity = Identity {
        no_can: true,
        ..Identity::default()
    };
    rig.bridge = Bridge::new(identity, saved, start);
    rig.bridge.usb_event(UsbEvent::Configured(true), at(0));
    rig
}

/// A configuration with settings of the bus, and others that matter.
fn on_can() -> Config {
    Config {
        arm: ArmKind::Ling,
        poll: Poll::Hertz(100),
        can: Can {
            node: Node::MAX,
            telemetry_hz: 100,
            commands: true,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: 200,
            torque_off: true,
        },
    }
}

/// The same without settings of the bus.
fn without_can() -> Config {
    Config {
        can: Can::default(),
        ..on_can()
    }
}

#[test]
fn each_setting_of_the_bus_is_refused_by_name() {
    let mut rig = started(Config::default(), Start::default());
    let usual = Can::default();
    #[rustfmt::skip]
    let settings = [
        Can { node: Node::MAX, ..usual },
        Can { bit_rate: 500_000, ..usual },
        Can { bit_rate: 300_000, ..usual },
        Can { data_bit_rate: Some(2_000_000), ..usual },
        Can { telemetry_hz: 1, ..usual },
        Can { commands: true, ..usual },
        Can { command_timeout_ms: 40, ..usual },
        Can { unsolicited: true, ..usual },
    ];
    for can in settings {
        let config = Config { can, ..without_can() };
        assert_eq!(
            rig.call(Request::SetConfig(config)),
            Reply::BadConfig(ConfigError::NoCan),
            "{can:?}"
        );
        assert_eq!(rig.bridge.config(), Config::default());
    }
    assert_eq!(rig.call(Request::SetConfig(without_can())), Reply::Done);
    assert_eq!(rig.call(Request::GetConfig), Reply::Config(without_can()));
    rig.run(1_000);
    assert_eq!(rig.actions, []);
}

#[test]
fn saved_settings_of_the_bus_are_left_out() {
    let mut rig = started(on_can(), Start::default());
    assert_eq!(rig.bridge.config(), without_can());
    assert_eq!(rig.bridge.counters().config_failures, 0);
    let sequence = rig.request(Request::GetSaved);
    assert_eq!(rig.actions.pop(), Some(Action::Load));
    rig.bridge.loaded(Ok(Saved::Config(on_can())), at(rig.now));
    rig.run(1_000);
    let saved = Reply::Saved(Saved::Config(without_can()));
    assert_eq!(rig.replies.pop(), Some((sequence, saved)));
    rig.request(Request::SaveConfig);
    assert_eq!(rig.actions, [Action::Save(without_can(), Erase::Allowed)]);
}

#[test]
fn invalid_saved_settings_are_still_lost() {
    let mut saved = on_can();
    saved.poll = Poll::Hertz(0);
    let mut rig = started(saved, Start::default());
    assert_eq!(rig.bridge.config(), Config::default());
    assert_eq!(rig.bridge.counters().config_failures, 1);
}

#[test]
fn events_wait_for_no_bus() {
    let mut rig = started(without_can(), Start::default());
    // Polls are refused while the line is reserved.
    for _ in 0..40 {
        assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
        rig.run(50_000);
        assert_eq!(rig.call(Request::ReleaseLine), Reply::Done);
        assert!(!rig.bridge.update(at(rig.now)).can);
        assert_eq!(rig.bridge.can_transmit(at(rig.now)), None);
    }
    let counters = rig.bridge.counters();
    assert!(counters.refused_line_reserved >= 40);
    assert_eq!((counters.dropped_events, counters.can_frames_sent), (0, 0));
    assert_eq!(rig.bridge.can_config(), None);
}

#[test]
fn save_that_ends_recovery_starts_no_can() {
    let start = Start {
        recovery: Some(Recovery { crashed_in_load: false }),
        ..Start::default()
    };
    let mut rig = started(Config::default(), start);
    rig.request(Request::SaveConfig);
    rig.bridge.saved(Ok(()), at(rig.now));
    rig.run(1_000);
    assert_eq!(rig.call(Request::GetRecovery), Reply::Recovery { active: false });
    assert_eq!(rig.actions, [Action::Save(Config::default(), Erase::Allowed)]);
    assert_eq!(rig.bridge.can_config(), None);
}
