//! Requests and answers as text. Bytes are hexadecimal.

use core::fmt::{self, Display, Formatter};

use crate::message::ERRORS;
use crate::{BROADCAST, Request, Status, register};

/// Writes data, after a colon.
fn write_bytes(f: &mut Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    f.write_str(if bytes.is_empty() { "" } else { ":" })?;
    bytes.iter().try_for_each(|byte| write!(f, " {byte:02X}"))
}

/// For example `WRITE servo 2, goal-position (42): 00 08`.
impl Display for Request<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (name, _, id, [address, len], rest) = self.parts();
        match id {
            BROADCAST => write!(f, "{name} all")?,
            id => write!(f, "{name} servo {id}")?,
        }
        if let Some(address) = address {
            let name = register::at(address).map_or("address", |register| register.name);
            write!(f, ", {name} ({address})")?;
        }
        len.map_or(Ok(()), |len| write!(f, ", {len} bytes"))?;
        write_bytes(f, rest)
    }
}

/// For example `servo 2 with voltage, overload: 00 08`.
impl Display for Status<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "servo {}", self.id)?;
        let set = (0..).zip(ERRORS).filter(|(bit, _)| self.error >> bit & 1 != 0);
        set.enumerate()
            .try_for_each(|(n, (_, name))| write!(f, "{} {name}", if n == 0 { " with" } else { "," }))?;
        write_bytes(f, self.data)
    }
}
