//! Stops a Ling arm from an nRF52840, and logs its joint positions.
//!
//! | nRF52840 | connect to |
//! |---|---|
//! | P0.06 (TX) | the arm's RX, 3.3 V |
//! | P0.08 (RX) | the arm's TX |
//! | GND | the arm's GND |
//! | SWDIO, SWCLK, GND | a debug probe, for the log too |
#![no_std]
#![no_main]

use armwire::Config;
use armwire::driver::{CallError, Clock};
use armwire::ling::{Arm, Stop};
use armwire::time::Instant;
use defmt::info;
use embassy_executor::Spawner;
use embassy_nrf::buffered_uarte::{self, BufferedUarte};
use embassy_nrf::config::HfclkSource;
use embassy_nrf::pac::{P0, gpio::vals::Pull};
use embassy_nrf::{bind_interrupts, peripherals, uarte};
use embassy_time::Timer;
use static_cell::StaticCell;
use {defmt_rtt as _, panic_probe as _};

type LingArm = Arm<BufferedUarte<'static>, EmbassyClock>;
type Error = CallError<buffered_uarte::Error>;

bind_interrupts!(struct Irqs {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
});

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let mut config = embassy_nrf::config::Config::default();
    // The UART needs the crystal: the internal oscillator is not exact enough for 1 Mbaud.
    config.hfclk_source = HfclkSource::ExternalXtal;
    let p = embassy_nrf::init(config);

    static TX: StaticCell<[u8; 256]> = StaticCell::new();
    static RX: StaticCell<[u8; 256]> = StaticCell::new();
    let (tx, rx) = (TX.init([0; 256]), RX.init([0; 256]));
    let mut config = uarte::Config::default();
    config.baudrate = uarte::Baudrate::Baud1m;
    let port = BufferedUarte::new(
        p.UARTE0,
        p.TIMER0,
        p.PPI_CH0,
        p.PPI_CH1,
        p.PPI_GROUP0,
        p.P0_08,
        p.P0_06,
        Irqs,
        config,
        rx,
        tx,
    );
    // The pull-up keeps P0.08 idle while no arm is connected. Without it the input floats and receives noise.
    P0.pin_cnf(8).modify(|pin| pin.set_pull(Pull::Pullup));

    // The size of the receive buffer: no more bytes are read before a request.
    let config = Config {
        backlog: 256,
        ..Config::DEFAULT
    };
    let mut arm = Arm::new(port, EmbassyClock, config);
    loop {
        if let Err(error) = stop_and_read(&mut arm).await {
            info!("no arm: {}", error);
        }
        Timer::after_millis(100).await;
    }
}

/// Stops the arm, and logs its joints in ticks, 4096 per turn, until a call fails.
async fn stop_and_read(arm: &mut LingArm) -> Result<(), Error> {
    // The last goal of the gripper is unknown.
    info!("{}", arm.stop(&mut Stop::new(None)).await?);
    loop {
        let state = arm.read_joints().await?;
        info!("joints {} gripper {} {}", state.joints, state.gripper, state.status);
        Timer::after_millis(20).await;
    }
}

/// Clock of the driver, from embassy's time.
struct EmbassyClock;

impl Clock for EmbassyClock {
    fn now(&self) -> Instant {
        Instant::from_micros(embassy_time::Instant::now().as_micros())
    }

    async fn wait_until(&self, instant: Instant) {
        Timer::at(embassy_time::Instant::from_micros(instant.as_micros())).await;
    }
}
