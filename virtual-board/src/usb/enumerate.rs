//! From a connected device to a configured one (USB 2.0, 9.1.2).

use super::descriptor::{self, CONFIGURATION, Configuration, DEVICE, Device, Malformed, STRING};
use super::host::{Request, TransferError};
use super::timing;
use crate::time::Nanos;

/// Standard requests (table 9-4).
const SET_ADDRESS: u8 = 5;
const GET_DESCRIPTOR: u8 = 6;
const SET_CONFIGURATION: u8 = 9;

/// Request types: to and from the device, standard (table 9-2).
const TO_DEVICE: u8 = 0x00;
const FROM_DEVICE: u8 = 0x80;

/// US English, the language whose strings are read.
const ENGLISH: u16 = 0x0409;

/// What enumeration needs of a bus: time passes only inside these calls.
pub trait Bus {
    /// Lets `span` pass.
    fn wait(&mut self, span: Nanos);
    /// Resets the bus, until the reset is over.
    fn reset(&mut self);
    /// Runs one control transfer to its end, with the device at `address` whose endpoint 0 takes `packet` bytes.
    ///
    /// # Errors
    ///
    /// As the transfer ends.
    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Vec<u8>, TransferError>;
}

/// A device that has an address and is configured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Enumerated {
    /// The address it was given.
    pub address: u8,
    /// Its device descriptor.
    pub device: Device,
    /// Its first configuration, which is set.
    pub configuration: Configuration,
    /// What it calls its maker.
    pub manufacturer: Option<String>,
    /// What it calls itself.
    pub product: Option<String>,
    /// Its serial number.
    pub serial: Option<String>,
}

/// Why a device could not be enumerated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EnumerateError {
    /// A request failed.
    #[error("{what}: {error}")]
    Transfer {
        /// Which.
        what: &'static str,
        /// How.
        error: TransferError,
    },
    /// A descriptor made no sense.
    #[error(transparent)]
    Malformed(#[from] Malformed),
}

/// Resets the bus and brings the device on it to `address` and its first configuration.
///
/// # Errors
///
/// When the device does not answer as the specification demands.
pub fn enumerate(bus: &mut impl Bus, address: u8) -> Result<Enumerated, EnumerateError> {
    bus.wait(timing::DEBOUNCE);
    bus.reset();
    bus.wait(timing::RESET_RECOVERY);

    // The largest packet of endpoint 0 is in the first eight bytes, which every device can send in one packet.
    let start = read(
        bus,
        "device descriptor, first 8 bytes",
        0,
        8,
        descriptor(DEVICE, 0, 0, 8),
    )?;
    let packet = start.get(7).copied().unwrap_or(8);
    let set_address = Request::write(TO_DEVICE, SET_ADDRESS, address.into(), 0, Vec::new());
    read(bus, "set address", 0, packet, set_address)?;
    bus.wait(timing::ADDRESS_RECOVERY);

    let device = Device::parse(&read(
        bus,
        "device descriptor",
        address,
        packet,
        descriptor(DEVICE, 0, 0, 18),
    )?)?;
    let head = read(
        bus,
        "configuration descriptor, header",
        address,
        packet,
        descriptor(CONFIGURATION, 0, 0, 9),
    )?;
    let total = match head[..] {
        [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
        _ => 9,
    };
    let whole = descriptor(CONFIGURATION, 0, 0, total);
    let configuration = Configuration::parse(&read(bus, "configuration descriptor", address, packet, whole)?)?;

    let mut strings = [None, None, None];
    for (text, &index) in strings.iter_mut().zip(&device.strings) {
        if index != 0 {
            let request = descriptor(STRING, index, ENGLISH, 255);
            *text = Some(descriptor::string(&read(
                bus,
                "string descriptor",
                address,
                packet,
                request,
            )?)?);
        }
    }
    let configure = Request::write(TO_DEVICE, SET_CONFIGURATION, configuration.value.into(), 0, Vec::new());
    read(bus, "set configuration", address, packet, configure)?;

    let [manufacturer, product, serial] = strings;
    Ok(Enumerated {
        address,
        device,
        configuration,
        manufacturer,
        product,
        serial,
    })
}

fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Request {
    Request::read(
        FROM_DEVICE,
        GET_DESCRIPTOR,
        u16::from_be_bytes([kind, index]),
        language,
        length,
    )
}

fn read(
    bus: &mut impl Bus,
    what: &'static str,
    address: u8,
    packet: u8,
    request: Request,
) -> Result<Vec<u8>, EnumerateError> {
    bus.control(address, packet, request)
        .map_err(|error| EnumerateError::Transfer { what, error })
}
