//! Stops a Ling arm from an STM32F303, and logs its joint positions.
//!
//! | STM32F303 | connect to |
//! |---|---|
//! | PA9 (USART1 TX) | the arm's RX, 3.3 V |
//! | PA10 (USART1 RX) | the arm's TX |
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
use embassy_stm32::gpio::Pull;
use embassy_stm32::rcc::{APBPrescaler, Pll, PllMul, PllPreDiv, PllSource, Sysclk};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, peripherals};
use embassy_time::Timer;
use static_cell::StaticCell;
use {defmt_rtt as _, panic_probe as _};

type LingArm = Arm<BufferedUart<'static>, EmbassyClock>;
type Error = CallError<usart::Error>;

bind_interrupts!(struct Irqs {
    USART1 => usart::BufferedInterruptHandler<peripherals::USART1>;
});

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let mut config = embassy_stm32::Config::default();
    // 64 MHz from the internal oscillator. At the 8 MHz after reset an interrupt would have only 80 cycles per byte.
    config.rcc.pll = Some(Pll {
        src: PllSource::HSI,
        prediv: PllPreDiv::DIV2,
        mul: PllMul::MUL16,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    let p = embassy_stm32::init(config);

    static TX: StaticCell<[u8; 256]> = StaticCell::new();
    static RX: StaticCell<[u8; 256]> = StaticCell::new();
    let (tx, rx) = (TX.init([0; 256]), RX.init([0; 256]));
    let mut config = usart::Config::default();
    config.baudrate = 1_000_000;
    // The pull-up keeps PA10 idle while no arm is connected. Without it the input floats and receives noise.
    config.rx_pull = Pull::Up;
    let port = BufferedUart::new(p.USART1, p.PA10, p.PA9, tx, rx, Irqs, config).unwrap();

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
