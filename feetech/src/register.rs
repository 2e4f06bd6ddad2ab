//! The registers of an STS3215.
//!
//! A register has one byte or two, the low one first. A signed one has the sign in one bit and the magnitude below it.
//!
//! The sources of each row are letters: `T` the maker's memory table, as published in the crate st3215 0.0.2; `S` the
//! maker's SDK, `SMS_STS.h`; `L` LeRobot, `motors/feetech/tables.py`; `R` rustypot 1.13, `sts3215.rs`; `F` feetech-cli,
//! `registers.py`. Ranges, units and factory settings are those of `T`, except for these:
//!
//! * `return-delay`: 250 at the factory by LeRobot, 0 by `T`. `lock`: 1 after power-on by feetech-cli, 0 by `T`.
//! * `mode` up to 3, `torque` 128, and `max-position` 0 for several turns: as in the descriptions of `T`, not its ranges.
//! * `goal-speed` is up to 254 by `T`, whose unit is that of the readings. The range here is that of the format.
//! * The sign of `goal-time` is bit 11 by `T`, 10 by `S`; that of `current` is stated by feetech-cli alone.
//! * Rows without `T` have the range of their bytes, and no known factory setting: values of the virtual arm.

use core::ops::RangeInclusive;

use armwire::OutOfRange;

/// The effect of a write to a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Nothing.
    ReadOnly,
    /// It changes the register until the servo restarts.
    Ram,
    /// It changes the register for good if `lock` is 0.
    Eeprom,
}

/// A register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Its name.
    pub name: &'static str,
    /// The address of its first byte.
    pub address: u8,
    /// 1 or 2 bytes.
    pub len: u8,
    /// The effect of a write.
    pub access: Access,
    /// Its value at the factory, or after power-on.
    pub factory: u16,
    /// The minimum.
    pub min: i32,
    /// The maximum.
    pub max: i32,
    /// The unit of its count, or an empty string.
    pub unit: &'static str,
    /// The bit of its sign; 0 for a number without a sign.
    pub sign: u16,
    /// The letters of its sources.
    pub sources: &'static str,
}

impl Register {
    /// The value of its bytes. Bits above the sign are ignored, as by the programs that read them.
    pub fn value(self, bytes: [u8; 2]) -> i32 {
        let raw = u16::from_le_bytes(bytes);
        let magnitude = i32::from(raw & self.sign.wrapping_sub(1));
        if raw & self.sign == 0 { magnitude } else { -magnitude }
    }

    /// Its bytes for a value, of which the first [`len`](Self::len) count.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] outside `min..=max`.
    pub fn bytes(self, value: i32) -> Result<[u8; 2], OutOfRange<i32>> {
        within(self.name, self.unit, value, self.min..=self.max)?;
        let sign = if value < 0 { self.sign } else { 0 };
        Ok((value.unsigned_abs() as u16 | sign).to_le_bytes())
    }
}

/// Checks a value.
pub(crate) fn within<T: Copy + PartialOrd>(
    what: &'static str,
    unit: &'static str,
    got: T,
    range: RangeInclusive<T>,
) -> Result<(), OutOfRange<T>> {
    match range.contains(&got) {
        true => Ok(()),
        false => Err(OutOfRange::new(what, unit, got, *range.start(), *range.end())),
    }
}

/// The register that begins at this address.
pub fn at(address: u8) -> Option<Register> {
    REGISTERS.iter().copied().find(|register| register.address == address)
}

/// The baud rate for each value of [`BAUD_RATE`].
pub const BAUD_RATES: [u32; 8] = [1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400];

/// Makes each row a constant, and an element of a list: a function can do one of them.
macro_rules! registers {
    ($($constant:ident = $name:literal, $address:literal, $len:literal, $access:ident, $factory:literal,
        $min:literal, $max:literal, $unit:literal, $sign:expr, $sources:literal;)*) => {
        $(
            #[doc = concat!("`", $name, "` at ", $address, ", ", $len, " bytes.")]
            pub const $constant: Register = Register {
                name: $name, address: $address, len: $len, access: Access::$access, factory: $factory,
                min: $min, max: $max, unit: $unit, sign: $sign, sources: $sources,
            };
        )*
        /// Every register, by address.
        pub const REGISTERS: &[Register] = &[$($constant),*];
    };
}

// Name, address, bytes, access, factory setting, minimum, maximum, unit, sign, sources.
registers! {
    FIRMWARE_MAJOR = "firmware-major", 0, 1, ReadOnly, 3, 0, 255, "", 0, "TLRF";
    FIRMWARE_MINOR = "firmware-minor", 1, 1, ReadOnly, 10, 0, 255, "", 0, "TLRF";
    MODEL = "model", 3, 2, ReadOnly, 777, 0, 65535, "", 0, "TSLRF";
    ID = "id", 5, 1, Eeprom, 1, 0, 253, "", 0, "TSLRF";
    BAUD_RATE = "baud-rate", 6, 1, Eeprom, 0, 0, 7, "", 0, "TSLRF";
    RETURN_DELAY = "return-delay", 7, 1, Eeprom, 250, 0, 254, "2 µs", 0, "TLRF";
    STATUS_LEVEL = "status-level", 8, 1, Eeprom, 1, 0, 1, "", 0, "TLRF";
    MIN_POSITION = "min-position", 9, 2, Eeprom, 0, 0, 4094, "steps", 0, "TSLRF";
    MAX_POSITION = "max-position", 11, 2, Eeprom, 4095, 0, 4095, "steps", 0, "TSLRF";
    MAX_TEMPERATURE = "max-temperature", 13, 1, Eeprom, 70, 0, 100, "°C", 0, "TLRF";
    MAX_VOLTAGE = "max-voltage", 14, 1, Eeprom, 80, 0, 254, "0.1 V", 0, "TLRF";
    MIN_VOLTAGE = "min-voltage", 15, 1, Eeprom, 40, 0, 254, "0.1 V", 0, "TLRF";
    MAX_TORQUE = "max-torque", 16, 2, Eeprom, 1000, 0, 1000, "0.1 %", 0, "TLRF";
    PHASE = "phase", 18, 1, Eeprom, 12, 0, 254, "", 0, "TLRF";
    UNLOAD_CONDITION = "unload-condition", 19, 1, Eeprom, 44, 0, 254, "", 0, "TLRF";
    ALARM_CONDITION = "alarm-condition", 20, 1, Eeprom, 47, 0, 254, "", 0, "TLRF";
    P = "p", 21, 1, Eeprom, 32, 0, 254, "", 0, "TLRF";
    D = "d", 22, 1, Eeprom, 32, 0, 254, "", 0, "TLRF";
    I = "i", 23, 1, Eeprom, 0, 0, 254, "", 0, "TLRF";
    STARTUP_FORCE = "startup-force", 24, 2, Eeprom, 16, 0, 1000, "0.1 %", 0, "TLRF";
    DEAD_ZONE_CW = "dead-zone-cw", 26, 1, Eeprom, 1, 0, 32, "steps", 0, "TSLRF";
    DEAD_ZONE_CCW = "dead-zone-ccw", 27, 1, Eeprom, 1, 0, 32, "steps", 0, "TSLRF";
    PROTECTION_CURRENT = "protection-current", 28, 2, Eeprom, 500, 0, 511, "6.5 mA", 0, "TLRF";
    RESOLUTION = "resolution", 30, 1, Eeprom, 1, 1, 100, "", 0, "TLRF";
    OFFSET = "offset", 31, 2, Eeprom, 0, -2047, 2047, "steps", 1 << 11, "TSLRF";
    MODE = "mode", 33, 1, Eeprom, 0, 0, 3, "", 0, "TSLRF";
    PROTECTIVE_TORQUE = "protective-torque", 34, 1, Eeprom, 20, 0, 254, "%", 0, "TLRF";
    PROTECTION_TIME = "protection-time", 35, 1, Eeprom, 200, 0, 254, "10 ms", 0, "TLRF";
    OVERLOAD_TORQUE = "overload-torque", 36, 1, Eeprom, 80, 0, 254, "%", 0, "TLRF";
    SPEED_P = "speed-p", 37, 1, Eeprom, 10, 0, 254, "", 0, "TLRF";
    OVERCURRENT_TIME = "overcurrent-time", 38, 1, Eeprom, 200, 0, 254, "10 ms", 0, "TLRF";
    SPEED_I = "speed-i", 39, 1, Eeprom, 10, 0, 254, "", 0, "TLRF";
    TORQUE = "torque", 40, 1, Ram, 0, 0, 128, "", 0, "TSLRF";
    ACCELERATION = "acceleration", 41, 1, Ram, 0, 0, 254, "100 steps/s²", 0, "TSLRF";
    GOAL_POSITION = "goal-position", 42, 2, Ram, 0, -32766, 32766, "steps", 1 << 15, "TSLRF";
    GOAL_TIME = "goal-time", 44, 2, Ram, 0, -1000, 1000, "0.1 %", 1 << 10, "TSLRF";
    GOAL_SPEED = "goal-speed", 46, 2, Ram, 0, -32767, 32767, "steps/s", 1 << 15, "TSLRF";
    TORQUE_LIMIT = "torque-limit", 48, 2, Ram, 1000, 0, 1000, "0.1 %", 0, "TLRF";
    LOCK = "lock", 55, 1, Ram, 1, 0, 1, "", 0, "TSLRF";
    POSITION = "position", 56, 2, ReadOnly, 0, -32767, 32767, "steps", 1 << 15, "TSLRF";
    SPEED = "speed", 58, 2, ReadOnly, 0, -32767, 32767, "steps/s", 1 << 15, "TSLRF";
    LOAD = "load", 60, 2, ReadOnly, 0, -1000, 1000, "0.1 %", 1 << 10, "TSLRF";
    VOLTAGE = "voltage", 62, 1, ReadOnly, 0, 0, 255, "0.1 V", 0, "TSLRF";
    TEMPERATURE = "temperature", 63, 1, ReadOnly, 0, 0, 255, "°C", 0, "TSLRF";
    STORED = "stored", 64, 1, ReadOnly, 0, 0, 1, "", 0, "TF";
    STATUS = "status", 65, 1, ReadOnly, 0, 0, 255, "", 0, "TLRF";
    MOVING = "moving", 66, 1, ReadOnly, 0, 0, 1, "", 0, "TSLRF";
    CURRENT = "current", 69, 2, ReadOnly, 0, -500, 500, "6.5 mA", 1 << 15, "TSLRF";
    GOAL_POSITION_2 = "goal-position-2", 71, 2, ReadOnly, 0, -32767, 32767, "steps", 1 << 15, "L";
    MOVING_THRESHOLD = "moving-threshold", 80, 1, Eeprom, 50, 0, 255, "", 0, "LR";
    DTS = "dts", 81, 1, Eeprom, 1, 0, 255, "ms", 0, "LR";
    SPEED_UNIT = "speed-unit", 82, 1, Eeprom, 1, 0, 255, "", 0, "LR";
    HTS = "hts", 83, 1, Eeprom, 32, 0, 255, "", 0, "LR";
    MAX_SPEED = "max-speed", 84, 1, Eeprom, 100, 0, 255, "", 0, "LR";
    MAX_ACCELERATION = "max-acceleration", 85, 1, Eeprom, 254, 0, 255, "", 0, "LR";
    ACCELERATION_FACTOR = "acceleration-factor", 86, 1, Eeprom, 1, 0, 255, "", 0, "LR";
}
