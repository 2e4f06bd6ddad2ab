//! The descriptors: each must match the firmware's declaration (USB 2.0, 9.6; CDC 1.2; PSTN 1.2).

use std::fmt::Debug;

use armwire_host::control::VENDOR_AND_PRODUCT;
use nusb::descriptors::{ConfigurationDescriptor, DeviceDescriptor, InterfaceDescriptor, TransferType};
use nusb::transfer::Direction::{self, In, Out};
use serde_json::json;

use super::bench::Bench;
use super::report::{Passed, Trouble, ensure};
use super::usb::{Payload, Request};
use super::{Checked, identify};

/// GET_DESCRIPTOR of the device (USB 2.0, 9.4.3) and the descriptor types (table 9-5; USB 3.2, 9.6.2).
const GET_DESCRIPTOR: u8 = 6;
const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const STRING: u8 = 3;
const BOS: u8 = 15;
const ENGLISH: u16 = 0x0409;

/// Class codes of a device with interface association descriptors.
const COMPOSITE: (u8, u8, u8) = (0xEF, 2, 1);
/// Maximum current of a port, in mA.
const MAX_CURRENT: u16 = 500;

/// The vendor request for the Microsoft OS 2.0 descriptors, the index of the set, and the platform capability that
/// announces it (Microsoft OS 2.0 Descriptors Specification).
const MSOS_REQUEST: u8 = 0x20;
const MSOS_SET: u16 = 7;
const MSOS_CAPABILITY: [u8; 20] = *b"\x1C\x10\x05\x00\xDF\x60\xDD\xD8\x89\x45\xC7\x4C\x9C\xD2\x65\x9D\x9E\x64\x8A\x9F";
/// The device interface class of the control interface on Windows.
const CONTROL_GUID: &str = "{4C757248-7066-47AD-9A38-E3D4ADFA1B0A}";

/// The interface associations: the serial port has interfaces 0 and 1, the control port has 2.
const ASSOCIATION: u8 = 11;
const ASSOCIATIONS: [&[u8]; 2] = [&[8, 11, 0, 2, 2, 2, 0, 0], &[8, 11, 2, 1, 0xFF, 0, 0, 0]];

/// The firmware's declaration of an interface.
struct Interface {
    name: &'static str,
    class: (u8, u8, u8),
    endpoints: &'static [(Direction, TransferType)],
    string: Option<&'static str>,
    /// Class-specific descriptors.
    functional: &'static [&'static [u8]],
}

const INTERFACES: [Interface; 3] = [
    Interface {
        name: "the serial port's first interface",
        class: (2, 2, 0),
        endpoints: &[(In, TransferType::Interrupt)],
        string: None,
        // Header of CDC 1.10; line coding and control lines; a union of the interfaces 0 and 1.
        functional: &[&[5, 0x24, 0, 0x10, 1], &[4, 0x24, 2, 2], &[5, 0x24, 6, 0, 1]],
    },
    Interface {
        name: "the serial port's data interface",
        class: (0x0A, 0, 0),
        endpoints: &[(Out, TransferType::Bulk), (In, TransferType::Bulk)],
        string: None,
        functional: &[],
    },
    Interface {
        name: "the control interface",
        class: (0xFF, 0, 0),
        endpoints: &[(In, TransferType::Bulk), (Out, TransferType::Bulk)],
        string: Some("armwire control"),
        functional: &[],
    },
];

/// Reads every descriptor.
pub(super) fn all(bench: &mut Bench<'_>) -> Checked {
    let serial = identify(bench)?.serial;
    let bytes = read(bench, DEVICE, 0, 18)?;
    let device = DeviceDescriptor::new(&bytes).ok_or_else(|| malformed("device", &bytes))?;
    let class = (device.class(), device.subclass(), device.protocol());
    same("the device's class", class, COMPOSITE)?;
    let ids = (device.vendor_id(), device.product_id());
    same("the vendor and product id", ids, VENDOR_AND_PRODUCT)?;
    same("the packet size of endpoint 0", device.max_packet_size_0(), 64)?;
    same("the number of configurations", device.num_configurations(), 1)?;
    for (what, index, text) in [
        ("the manufacturer", device.manufacturer_string_index(), "armwire"),
        ("the product", device.product_string_index(), "armwire adapter"),
        ("the serial number", device.serial_number_string_index(), &serial),
    ] {
        same_string(bench, what, index.map(Into::into), Some(text))?;
    }
    let bytes = configuration(bench)?;
    let configuration = parsed(&bytes)?;
    let number = configuration.configuration_value();
    same("the number of the configuration", number, 1)?;
    let current = 2 * u16::from(configuration.max_power());
    ensure(current <= MAX_CURRENT, format_args!("{current} mA from the bus"))?;
    let associations = configuration
        .descriptors()
        .filter(|it| it.descriptor_type() == ASSOCIATION);
    let associations: Vec<_> = associations.map(|it| it.as_bytes()).collect();
    same(
        "the list of interface associations",
        &associations[..],
        &ASSOCIATIONS[..],
    )?;
    let interfaces: Vec<_> = configuration.interface_alt_settings().collect();
    same("the number of interfaces", interfaces.len(), INTERFACES.len())?;
    for (number, (got, expected)) in interfaces.iter().zip(&INTERFACES).enumerate() {
        same_interface(bench, number, got, expected)?;
    }
    let mut addresses: Vec<_> = interfaces
        .iter()
        .flat_map(|it| it.endpoints())
        .map(|it| it.address())
        .collect();
    let count = addresses.len();
    addresses.sort_unstable();
    addresses.dedup();
    same("the number of different endpoints", addresses.len(), count)?;
    let msos = msos(bench)?;
    let text = format!("device, configuration, {count} endpoints, 4 strings, Microsoft OS 2.0");
    let figures = [("configuration_bytes", json!(bytes.len())), ("msos_bytes", json!(msos))];
    Ok(Passed::new(text, figures))
}

/// The addresses of the serial port's OUT and IN endpoints.
pub(super) fn port_endpoints(bench: &mut Bench<'_>) -> Result<(u8, u8), Trouble> {
    let bytes = configuration(bench)?;
    let configuration = parsed(&bytes)?;
    let data = configuration
        .interface_alt_settings()
        .find(|it| it.class() == INTERFACES[1].class.0);
    let address = |direction| {
        let mut endpoints = data.iter().flat_map(|data| data.endpoints());
        endpoints.find(|it| it.direction() == direction).map(|it| it.address())
    };
    let both = address(Out).zip(address(In));
    both.ok_or_else(|| Trouble::failed("the serial port has not an endpoint each way"))
}

/// The whole configuration descriptor. A first read of its head gives the length.
fn configuration(bench: &mut Bench<'_>) -> Result<Vec<u8>, Trouble> {
    let head = read(bench, CONFIGURATION, 0, 9)?;
    let length = total_length("configuration", &head)?;
    let bytes = read(bench, CONFIGURATION, 0, length)?;
    same("the length of the configuration", bytes.len(), length.into())?;
    Ok(bytes)
}

/// The length of a descriptor with all that follows it, wTotalLength.
fn total_length(what: &str, head: &[u8]) -> Result<u16, Trouble> {
    match head.get(2..4) {
        Some(&[low, high]) => Ok(u16::from_le_bytes([low, high])),
        _ => Err(malformed(what, head)),
    }
}

fn parsed(bytes: &[u8]) -> Result<ConfigurationDescriptor<'_>, Trouble> {
    ConfigurationDescriptor::new(bytes).ok_or_else(|| malformed("configuration", bytes))
}

fn same_interface(
    bench: &mut Bench<'_>,
    number: usize,
    got: &InterfaceDescriptor<'_>,
    expected: &Interface,
) -> Result<(), Trouble> {
    let name = expected.name;
    let of = |what| format!("{what} of {name}");
    same(&of("the number"), usize::from(got.interface_number()), number)?;
    let class = (got.class(), got.subclass(), got.protocol());
    same(&of("the class"), class, expected.class)?;
    let endpoints: Vec<_> = got.endpoints().map(|it| (it.direction(), it.transfer_type())).collect();
    same(&of("the endpoints"), &endpoints[..], expected.endpoints)?;
    let bulk = got.endpoints().filter(|it| it.transfer_type() == TransferType::Bulk);
    for endpoint in bulk {
        same(&of("the packet size"), endpoint.max_packet_size(), 64)?;
    }
    let functional: Vec<_> = got.descriptors().filter(|it| it.descriptor_type() == 0x24).collect();
    let functional: Vec<_> = functional.iter().map(|it| it.as_bytes()).collect();
    same(
        &of("the class-specific descriptors"),
        &functional[..],
        expected.functional,
    )?;
    let name = got.string_index().map(Into::into);
    same_string(bench, &of("the name"), name, expected.string)
}

/// The Microsoft OS 2.0 descriptors: WinUSB for the control interface. Returns their length, in bytes.
fn msos(bench: &mut Bench<'_>) -> Result<u16, Trouble> {
    let head = read(bench, BOS, 0, 5)?;
    let bos = read(bench, BOS, 0, total_length("BOS", &head)?)?;
    let place = bos
        .windows(MSOS_CAPABILITY.len())
        .position(|window| window == MSOS_CAPABILITY);
    // The version of Windows, the length of the set, the request that reads it, and an alternate setting.
    let Some(&[_, _, _, _, low, high, request, _]) = place.and_then(|place| bos.get(place + 20..place + 28)) else {
        return Err(malformed("BOS", &bos));
    };
    same(
        "the request for the Microsoft OS 2.0 descriptors",
        request,
        MSOS_REQUEST,
    )?;
    let length = u16::from_le_bytes([low, high]);
    let set = bench.usb.control(&Request {
        kind: 0xC0,
        request,
        value: 0,
        index: MSOS_SET,
        payload: Payload::Read(length),
    })?;
    same(
        "the length of the Microsoft OS 2.0 descriptors",
        set.len(),
        length.into(),
    )?;
    let guid: Vec<_> = CONTROL_GUID.encode_utf16().flat_map(u16::to_le_bytes).collect();
    for (what, part) in [
        ("WINUSB", &b"WINUSB\0\0"[..]),
        ("the GUID of the control interface", &guid),
    ] {
        ensure(
            set.windows(part.len()).any(|window| window == part),
            format_args!("{what} is not in the Microsoft OS 2.0 descriptors"),
        )?;
    }
    Ok(length)
}

fn same_string(bench: &mut Bench<'_>, what: &str, index: Option<u8>, expected: Option<&str>) -> Result<(), Trouble> {
    let got = match index {
        Some(index) => {
            let bytes = read_in(bench, STRING, index, ENGLISH, 255)?;
            let text = match bytes.as_slice() {
                [length, STRING, text @ ..] if usize::from(*length) == bytes.len() => text,
                _ => return Err(malformed("string", &bytes)),
            };
            let (units, _) = text.as_chunks::<2>();
            let units: Vec<_> = units.iter().map(|&unit| u16::from_le_bytes(unit)).collect();
            Some(String::from_utf16_lossy(&units))
        }
        None => None,
    };
    same(what, got.as_deref(), expected)
}

fn read(bench: &mut Bench<'_>, kind: u8, index: u8, length: u16) -> Result<Vec<u8>, Trouble> {
    read_in(bench, kind, index, 0, length)
}

fn read_in(bench: &mut Bench<'_>, kind: u8, index: u8, language: u16, length: u16) -> Result<Vec<u8>, Trouble> {
    let request = Request {
        kind: 0x80,
        request: GET_DESCRIPTOR,
        value: u16::from_be_bytes([kind, index]),
        index: language,
        payload: Payload::Read(length),
    };
    Ok(bench.usb.control(&request)?)
}

fn same<T: PartialEq + Debug>(what: &str, got: T, expected: T) -> Result<(), Trouble> {
    ensure(
        got == expected,
        format_args!("{what} is {got:02X?}, not {expected:02X?}"),
    )
}

fn malformed(what: &str, bytes: &[u8]) -> Trouble {
    Trouble::failed(format_args!("the {what} descriptor is malformed: {bytes:02X?}"))
}
