//! Valid configurations of an adapter.

use armwire_bridge::config::{ArmKind, CAN_BIT_RATES, CAN_DATA_BIT_RATES, Config, Poll};

use crate::{Result, Unstructured};

/// Any valid configuration.
pub fn any_good_config(u: &mut Unstructured<'_>) -> Result<Config> {
    let mut config: Config = u.arbitrary()?;
    config.can.bit_rate = *u.choose(&CAN_BIT_RATES)?;
    if config.can.data_bit_rate.is_some() {
        config.can.data_bit_rate = Some(*u.choose(&CAN_DATA_BIT_RATES)?);
    }
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
