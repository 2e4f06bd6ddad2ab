//! Moves a Ling arm from an nRF52840, and logs its joint positions.
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
use armwire::ling::{Arm, GripperSpeed, JointState, Move, Opening, Position, Speed, Torque};
use armwire::time::Instant;
use defmt::{Display2Format, info};
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

/// Rotation of the wrist, in ticks: 30°.
const TURN: u16 = 341;

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

    let mut arm = Arm::open(port, EmbassyClock, Config::DEFAULT);
    connect(&mut arm).await;
    if let Err(error) = turn_wrist_and_grip(&mut arm).await {
        info!("arm lost: {}", error);
    }
    loop {
        let error = follow(&mut arm).await;
        info!("arm lost: {}", error);
        // A reconnected arm is followed but not moved: someone may be handling it.
        connect(&mut arm).await;
    }
}

/// Sends requests until an arm answers. Without an arm, each call ends with `TimedOut`, after three attempts.
async fn connect(arm: &mut LingArm) {
    info!("waiting for an arm");
    loop {
        if let Ok(info) = arm.read_info().await {
            info!(
                "arm {}, firmware {}",
                Display2Format(&info.serial),
                Display2Format(&info.firmware)
            );
            return;
        }
        Timer::after_millis(100).await;
    }
}

/// Turns the wrist by 30° with the gripper half open, then closes the gripper.
async fn turn_wrist_and_grip(arm: &mut LingArm) -> Result<(), Error> {
    let state = arm.read_joints().await?;
    show(&state);
    let Ok(mut joints) = state.positions() else {
        info!("a joint is out of range: not moved");
        return Ok(());
    };
    // The rotation is towards the centre, so that the goal is in range.
    let wrist = match joints[5] > Position::CENTRE {
        true => joints[5].ticks() - TURN,
        false => joints[5].ticks() + TURN,
    };
    joints[5] = Position::new(wrist).unwrap();
    // 26° per second.
    let speed = Speed::new(300).unwrap();
    let mut goal = Move {
        joints: joints.map(|position| (position, speed)),
        gripper: (Opening::new(500).unwrap(), GripperSpeed(1000)),
    };
    arm.set_torque(Torque::On).await?;
    move_to(arm, goal).await?;
    goal.gripper.0 = Opening::CLOSED;
    move_to(arm, goal).await
}

/// Moves, and logs positions until the goal is reached. The limit is 10 s, because a gripper that holds something does
/// not close.
async fn move_to(arm: &mut LingArm, goal: Move) -> Result<(), Error> {
    arm.move_to(goal).await?;
    info!("moving");
    for _ in 0..500 {
        let state = arm.read_joints().await?;
        show(&state);
        if goal.is_reached_by(&state) {
            info!("arrived");
            return Ok(());
        }
        Timer::after_millis(20).await;
    }
    info!("not arrived after 10 s");
    Ok(())
}

/// Logs each change of the joints until a call fails.
async fn follow(arm: &mut LingArm) -> Error {
    let mut last = None;
    loop {
        match arm.read_joints().await {
            Ok(state) if last == Some(state) => {}
            Ok(state) => {
                show(&state);
                last = Some(state);
            }
            Err(error) => return error,
        }
        Timer::after_millis(20).await;
    }
}

/// Logs the joints in ticks, 4096 per turn, and the gripper in thousandths of its stroke.
fn show(state: &JointState) {
    let JointState {
        joints,
        gripper,
        status,
    } = state;
    info!("joints {} gripper {} {}", joints, gripper, status);
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
