//! The register table.

use armwire_feetech::register::{self, Access, REGISTERS};

#[test]
fn rows_are_in_order_and_do_not_overlap() {
    for pair in REGISTERS.windows(2) {
        assert!(pair[0].address + pair[0].len <= pair[1].address, "{}", pair[1].name);
    }
}

#[test]
fn rows_have_names_ranges_and_sources() {
    for (n, row) in REGISTERS.iter().enumerate() {
        assert!(
            REGISTERS[n + 1..].iter().all(|other| other.name != row.name),
            "{}",
            row.name
        );
        assert!(row.min <= row.max && matches!(row.len, 1 | 2), "{}", row.name);
        assert!(!row.sources.is_empty() && row.sources.chars().all(|letter| "TSLRF".contains(letter)));
        let factory = row.value(row.factory.to_le_bytes());
        assert!((row.min..=row.max).contains(&factory), "{}", row.name);
        let is_eeprom = row.access == Access::Eeprom;
        let is_late = row.address >= register::MOVING_THRESHOLD.address;
        assert_eq!(
            is_eeprom,
            row.access != Access::ReadOnly && (row.address < 40 || is_late),
            "{}",
            row.name
        );
    }
}

#[test]
fn every_value_has_bytes_and_back() {
    for row in REGISTERS {
        for value in row.min..=row.max {
            let bytes = row.bytes(value).unwrap();
            assert_eq!(row.value(bytes), value, "{}", row.name);
            assert!(row.len == 2 || bytes[1] == 0, "{}", row.name);
        }
        assert!(
            row.bytes(row.min - 1).is_err() && row.bytes(row.max + 1).is_err(),
            "{}",
            row.name
        );
    }
}

#[test]
fn sign_is_a_bit_above_the_magnitude() {
    assert_eq!(register::OFFSET.bytes(-1420).unwrap(), (0x800_u16 | 1420).to_le_bytes());
    assert_eq!(register::SPEED.value((0x8000_u16 | 500).to_le_bytes()), -500);
    assert_eq!(register::LOAD.value((0x400_u16 | 1000).to_le_bytes()), -1000);
    assert_eq!(register::POSITION.value([0xFF, 0x0F]), 4095);
    let error = register::OFFSET.bytes(2048).unwrap_err();
    assert_eq!(error.to_string(), "offset is 2048 steps, must be -2047..=2047");
}

#[test]
fn registers_are_found_by_their_first_address() {
    assert_eq!(register::at(56), Some(register::POSITION));
    assert_eq!(register::at(57), None);
}
