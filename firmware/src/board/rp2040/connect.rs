//! The end of a bus reset, on revisions before B2.
//!
//! There the controller is connected only after 800 µs without traffic, which a hub with other devices may never leave
//! (RP2040-E5). It sees an idle bus here for a millisecond: GPIO15, which nothing else uses, is its D+ meanwhile. The
//! order is that of pico-sdk (`rp2040_usb_device_enumeration.c`), which then also waits, without a limit, for CONNECTED of
//! SIE_STATUS.

use embassy_rp::pac::io::vals::{Gpio15ctrlFuncsel, Inover, Oeover};
use embassy_rp::pac::{IO_BANK0, PADS_BANK0, USB};
use embassy_time::Timer;

/// The pin.
const DP: usize = 15;

/// LINE_STATE of SIE_STATUS during a reset: both lines are low.
const SE0: u8 = 0b00;

/// Waits for the end of the reset, and lets the controller see an idle bus.
pub(super) async fn connect() {
    while USB.sie_status().read().line_state() == SE0 {
        Timer::after_millis(1).await;
    }
    let idle = Idle::begin();
    Timer::after_millis(1).await;
    drop(idle);
}

/// The controller sees an idle bus.
struct Idle;

impl Idle {
    fn begin() -> Self {
        PADS_BANK0.gpio(DP).modify(|w| {
            w.set_pue(true);
            w.set_pde(true);
        });
        // The pin itself is driven by nothing. Its input counts as high; that of D-, which is no such pin, as low.
        IO_BANK0.gpio(DP).ctrl().modify(|w| {
            w.set_oeover(Oeover::DISABLE);
            w.set_funcsel(Gpio15ctrlFuncsel::USB_MUXING_DIGITAL_DP.to_bits());
            w.set_inover(Inover::HIGH);
        });
        // The host keeps seeing the device.
        USB.usbphy_direct().write(|w| w.set_dp_pullup_en(true));
        USB.usbphy_direct_override()
            .write(|w| w.set_dp_pullup_en_override_en(true));
        USB.usb_muxing().write(|w| {
            w.set_to_digital_pad(true);
            w.set_softcon(true);
        });
        Self
    }
}

impl Drop for Idle {
    fn drop(&mut self) {
        USB.usb_muxing().write(|w| {
            w.set_to_phy(true);
            w.set_softcon(true);
        });
        USB.usbphy_direct_override().write(|_| {});
        IO_BANK0
            .gpio(DP)
            .ctrl()
            .write(|w| w.set_funcsel(Gpio15ctrlFuncsel::NULL.to_bits()));
        PADS_BANK0.gpio(DP).modify(|w| w.set_pue(false));
    }
}
