//! The request for a run of the [service](crate::service).

use crate::board::ServiceInterrupt;
use crate::board::hal::interrupt::typelevel::Interrupt;

/// Runs the service, or repeats it. Any context may call this.
pub(crate) fn pend() {
    ServiceInterrupt::pend();
}
