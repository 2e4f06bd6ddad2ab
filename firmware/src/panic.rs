//! What happens when the firmware finds itself broken: it leaves a mark and starts again.
//!
//! An arm that lost its adapter for a millisecond is better off than one that lost it for good. The mark outlives the
//! reset, in memory that start-up does not clear, so that the next start can say that it happened. A debugger that wants
//! to see it happen sets a breakpoint on `rust_begin_unwind`.

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;

/// Says that [`COUNT`] was written by this firmware and is not what memory held at power-on.
const MARK: u32 = 0xA2_3D_91_4E;

#[unsafe(link_section = ".uninit.panic")]
static MARKED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.panic")]
static COUNT: AtomicU32 = AtomicU32::new(0);

/// How many panics there have been since power-on.
pub(crate) fn count() -> u32 {
    if MARKED.load(Ordering::Relaxed) == MARK {
        COUNT.load(Ordering::Relaxed)
    } else {
        0
    }
}

#[panic_handler]
fn panic(_info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    #[cfg(feature = "defmt")]
    defmt::error!("{}", defmt::Display2Format(_info));
    COUNT.store(count().wrapping_add(1), Ordering::Relaxed);
    MARKED.store(MARK, Ordering::Relaxed);
    SCB::sys_reset()
}
