//! Stops a Ling arm from an ESP32-C3, and logs its joint positions.
//!
//! | ESP32-C3 | connect to |
//! |---|---|
//! | GPIO4 (UART1 TX) | the arm's RX, 3.3 V |
//! | GPIO5 (UART1 RX) | the arm's TX |
//! | GND | the arm's GND |
//! | USB | a computer, for the log too |
#![no_std]
#![no_main]

use armwire::Config;
use armwire::driver::{CallError, Clock};
use armwire::ling::{Arm, Stop};
use armwire::time::Instant;
use embassy_executor::Spawner;
use embassy_time::Timer;
use esp_backtrace as _;
use esp_hal::Async;
use esp_hal::clock::CpuClock;
use esp_hal::timer::timg::TimerGroup;
use esp_hal::uart::{self, IoError, Uart};
use esp_println::println;

type LingArm = Arm<Uart<'static, Async>, EmbassyClock>;
type Error = CallError<IoError>;

esp_bootloader_esp_idf::esp_app_desc!();

#[esp_rtos::main]
async fn main(_spawner: Spawner) {
    let p = esp_hal::init(esp_hal::Config::default().with_cpu_clock(CpuClock::max()));
    esp_rtos::start(TimerGroup::new(p.TIMG0).timer0, p.FROM_CPU_INTR0);

    // The FIFO stores 128 bytes between reads. `with_rx` enables the pull-up of GPIO5, which keeps the line idle
    // while no arm is connected.
    let config = uart::Config::default().with_baudrate(1_000_000);
    let port = Uart::new(p.UART1, config).unwrap();
    let port = port.with_tx(p.GPIO4).with_rx(p.GPIO5).into_async();

    // The size of the receive buffer: no more bytes are read before a request.
    let config = Config {
        backlog: 128,
        ..Config::DEFAULT
    };
    let mut arm = Arm::new(port, EmbassyClock, config);
    loop {
        if let Err(error) = stop_and_read(&mut arm).await {
            println!("no arm: {error}");
        }
        Timer::after_millis(100).await;
    }
}

/// Stops the arm, and logs its joints in ticks, 4096 per turn, until a call fails.
async fn stop_and_read(arm: &mut LingArm) -> Result<(), Error> {
    // The last goal of the gripper is unknown.
    println!("{:?}", arm.stop(&mut Stop::new(None)).await?);
    loop {
        let state = arm.read_joints().await?;
        println!("joints {:?} gripper {} {}", state.joints, state.gripper, state.status);
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
