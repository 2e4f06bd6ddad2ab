//! Requests and answers.

use armwire::framing::write;
use armwire::messages::Messages;
use armwire::{BufferTooShort, Cause, EncodeError, MessageId, OutOfRange, ParseError};

use crate::frame::{checksum, code};
use crate::register::within;
use crate::{BROADCAST, Expect, Feetech, Key, MAX_FRAME, MAX_ID};

/// A packet of the host. `id` is a servo, 0 to 253, or [`BROADCAST`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs)]
pub enum Request<'a> {
    /// 01: asks for a status packet.
    Ping { id: u8 },
    /// 02: reads `len` registers from `address` on.
    Read { id: u8, address: u8, len: u8 },
    /// 03: writes registers from `address` on.
    Write { id: u8, address: u8, data: &'a [u8] },
    /// 04: stores a write for [`Action`](Self::Action).
    RegWrite { id: u8, address: u8, data: &'a [u8] },
    /// 05: executes the stored write.
    Action { id: u8 },
    /// 06: **restores the factory settings**, except for the id.
    FactoryReset { id: u8 },
    /// 08: restarts the servo. **Its torque is off afterwards: a load falls.**
    Reboot { id: u8 },
    /// 0A: zeroes the count of turns.
    ResetTurns { id: u8 },
    /// 82: reads the same registers of several servos. Each answers, in the order of `ids`.
    SyncRead { address: u8, len: u8, ids: &'a [u8] },
    /// 83: writes the same registers of several servos. `data` has for each its id and `len` bytes.
    SyncWrite { address: u8, len: u8, data: &'a [u8] },
}

/// The name and code of a request, its id, its address and length, and the data after them.
type Parts<'a> = (&'static str, u8, u8, [Option<u8>; 2], &'a [u8]);

impl<'a> Request<'a> {
    pub(crate) fn parts(&self) -> Parts<'a> {
        let bare = |name, code, id| (name, code, id, [None; 2], &[][..]);
        let sync = |name, code, head: [u8; 2], rest| (name, code, BROADCAST, head.map(Some), rest);
        match *self {
            Self::Ping { id } => bare("PING", code::PING, id),
            Self::Read { id, address, len } => ("READ", code::READ, id, [Some(address), Some(len)], &[]),
            Self::Write { id, address, data } => ("WRITE", code::WRITE, id, [Some(address), None], data),
            Self::RegWrite { id, address, data } => ("REG_WRITE", code::REG_WRITE, id, [Some(address), None], data),
            Self::Action { id } => bare("ACTION", code::ACTION, id),
            Self::FactoryReset { id } => bare("FACTORY_RESET", code::FACTORY_RESET, id),
            Self::Reboot { id } => bare("REBOOT", code::REBOOT, id),
            Self::ResetTurns { id } => bare("RESET_TURNS", code::RESET_TURNS, id),
            Self::SyncRead { address, len, ids } => sync("SYNC_READ", code::SYNC_READ, [address, len], ids),
            Self::SyncWrite { address, len, data } => sync("SYNC_WRITE", code::SYNC_WRITE, [address, len], data),
        }
    }
}

/// The bits of a status packet's error byte, and of the register `status`: their names, the lowest first.
pub const ERRORS: [&str; 8] = [
    "voltage",
    "sensor",
    "temperature",
    "current",
    "bit 4",
    "overload",
    "bit 6",
    "bit 7",
];

/// A packet of a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status<'a> {
    /// The servo.
    pub id: u8,
    /// The bits of [`ERRORS`]. A request is executed whatever they are.
    pub error: u8,
    /// The registers that were read. They do not name their address.
    pub data: &'a [u8],
}

/// The most data bytes of a packet.
const MAX_DATA: u16 = MAX_FRAME as u16 - 6;

/// Writes a packet.
fn put(out: &mut [u8], id: u8, code: u8, data: impl Iterator<Item = u8> + Clone) -> Result<usize, BufferTooShort> {
    // No length byte states a longer packet.
    let most = out.len().min(MAX_FRAME);
    let out = out.get_mut(..most).unwrap_or_default();
    let len = (data.clone().count() as u8).wrapping_add(2);
    let covered = [id, len, code].into_iter().chain(data);
    let check = checksum(covered.clone());
    write(out, [0xFF, 0xFF].into_iter().chain(covered).chain([check]))
}

/// The most servos of a request to several: behind its address and length, without data for each.
const MAX_SERVOS: u16 = MAX_DATA - 2;

/// Checks the servos of a request to several, and that each has its data.
fn check_servos(request: &Request<'_>) -> Result<(), OutOfRange> {
    let (data, len) = match *request {
        Request::SyncRead { ids, .. } => (ids, 0),
        Request::SyncWrite { len, data, .. } => (data, len),
        _ => return Ok(()),
    };
    let (size, len) = (usize::from(len) + 1, u16::from(len));
    let ids = data.iter().step_by(size);
    within("count of ids", "", ids.len() as u16, 1..=MAX_SERVOS)?;
    for id in ids.clone() {
        within("id", "", (*id).into(), 0..=MAX_ID.into())?;
        let count = ids.clone().filter(|other| *other == id).count();
        within("count of one id", "", count as u16, 1..=1)?;
    }
    match data.len() % size {
        0 => Ok(()),
        cut => within("data of the last servo", "bytes", cut as u16 - 1, len..=len),
    }
}

/// The error of a request whose code is unknown, or whose data does not have its length.
fn refusal(code: u8, got: usize) -> ParseError {
    let message = MessageId::Command(code);
    let cause = match code {
        code::READ => Cause::Length { expected: &[2], got },
        code::PING | code::ACTION | code::FACTORY_RESET | code::REBOOT | code::RESET_TURNS => {
            Cause::Length { expected: &[0], got }
        }
        _ => Cause::Unknown,
    };
    ParseError { message, cause }
}

impl Messages for Feetech {
    type Request<'a> = Request<'a>;
    type Response<'a> = Status<'a>;

    type EncodeError = EncodeError;

    /// # Errors
    ///
    /// [`EncodeError`] also for an id above [`BROADCAST`], and for a packet of more than [`MAX_FRAME`] bytes. For several
    /// servos: for no id, an id above [`MAX_ID`] or twice, and for data that is not an id and `len` bytes for each.
    fn encode_request(&self, request: &Request<'_>, out: &mut [u8]) -> Result<usize, EncodeError> {
        let (_, code, id, head, rest) = request.parts();
        let data = head.into_iter().flatten().chain(rest.iter().copied());
        let len = u16::try_from(data.clone().count()).unwrap_or(u16::MAX);
        within("id", "", id.into(), 0..=BROADCAST.into())?;
        within("data", "bytes", len, 0..=MAX_DATA)?;
        check_servos(request)?;
        Ok(put(out, id, code, data)?)
    }

    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Request<'a>, ParseError> {
        // A packet is the same in both directions.
        let Status { id, error: code, data } = self.parse_response(frame, Expect::Requests)?;
        let (is_to_all, len_of_data) = (id == BROADCAST, data.len());
        Ok(match (code, data) {
            (code::PING, []) => Request::Ping { id },
            (code::READ, &[address, len]) => Request::Read { id, address, len },
            (code::WRITE, &[address, ref data @ ..]) => Request::Write { id, address, data },
            (code::REG_WRITE, &[address, ref data @ ..]) => Request::RegWrite { id, address, data },
            (code::ACTION, []) => Request::Action { id },
            (code::FACTORY_RESET, []) => Request::FactoryReset { id },
            (code::REBOOT, []) => Request::Reboot { id },
            (code::RESET_TURNS, []) => Request::ResetTurns { id },
            (code::SYNC_READ, &[address, len, ref ids @ ..]) if is_to_all => Request::SyncRead { address, len, ids },
            (code::SYNC_WRITE, &[address, len, ref data @ ..])
                if is_to_all && data.len() % (usize::from(len) + 1) == 0 =>
            {
                Request::SyncWrite { address, len, data }
            }
            _ => return Err(refusal(code, len_of_data)),
        })
    }

    fn encode_response(&self, status: &Status<'_>, _: Option<Key>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        put(out, status.id, status.error, status.data.iter().copied())
    }

    fn parse_response<'a>(&self, frame: &'a [u8], _expect: Expect) -> Result<Status<'a>, ParseError> {
        match *frame {
            [_, _, id, _, error, ref data @ .., _] => Ok(Status { id, error, data }),
            _ => Err(ParseError::NO_FRAME),
        }
    }
}
