//! The log, with feature `defmt`. `docs/logs.md` explains each line. Nothing on the path of a byte is logged.

use crate::control::{Event, LineReservation};

/// Logs an event other than a frame.
pub(crate) fn event(event: &Event) {
    match event {
        // One for each frame.
        Event::Frame { .. } => {}
        Event::HostSilent {
            initiator,
            dropped,
            torque_off,
        } => defmt::warn!(
            "the host on {} went silent: {=u16} bytes dropped, torque off: {=bool}",
            initiator,
            *dropped,
            *torque_off
        ),
        // A host may cause thousands a second.
        Event::Refused { initiator, reason } => defmt::debug!("a request of {} refused: {}", initiator, reason),
        Event::BusOff { off: true } => defmt::warn!("CAN: bus-off"),
        Event::BusOff { off: false } => defmt::info!("CAN: recovered from bus-off"),
        // The start logs it.
        Event::Recovery { active: true } => {}
        Event::Recovery { active: false } => defmt::info!("recovery ended"),
    }
}

pub(crate) fn reservation(reservation: LineReservation) {
    defmt::info!("reservation of the line: {}", reservation);
}
