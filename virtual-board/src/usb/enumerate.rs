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

/// US English, the language of the strings.
const ENGLISH: u16 = 0x0409;

/// The bus during enumeration: time passes only inside these calls.
pub trait Bus {
    /// Waits for `span`.
    fn wait(&mut self, span: Nanos);
    /// Resets the bus, and returns at the end of the reset.
    fn reset(&mut self);
    /// Runs one control transfer with the device at `address`, whose endpoint 0 has packets of `packet` bytes.
    ///
    /// # Errors
    ///
    /// The transfer's error.
    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Vec<u8>, TransferError>;
}

/// An addressed and configured device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Enumerated {
    /// Its address.
    pub address: u8,
    /// Its device descriptor.
    pub device: Device,
    /// Its first configuration, which is active.
    pub configuration: Configuration,
    /// The name of its manufacturer.
    pub manufacturer: Option<String>,
    /// The product name.
    pub product: Option<String>,
    /// Its serial number.
    pub serial: Option<String>,
}

/// The error of an enumeration.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EnumerateError {
    /// A request failed.
    #[error("{what}: {error}")]
    Transfer {
        /// The request.
        what: &'static str,
        /// Its error.
        error: TransferError,
    },
    /// A malformed descriptor.
    #[error(transparent)]
    Malformed(#[from] Malformed),
}

/// Resets the bus, and brings the device to `address` and its first configuration.
///
/// # Errors
///
/// If the device does not answer as specified.
pub fn enumerate(bus: &mut impl Bus, address: u8) -> Result<Enumerated, EnumerateError> {
    bus.wait(timing::DEBOUNCE);
    bus.reset();
    bus.wait(timing::RESET_RECOVERY);

    // The maximum packet size of endpoint 0 is in the first eight bytes, which every device can send in one packet.
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
