//! Moves a Ling arm from an ESP32-C3, and logs its joint positions.
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
use armwire::ling::{Arm, GripperSpeed, JointState, Move, Opening, Position, Speed, Torque};
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

/// Rotation of the wrist, in ticks: 30°.
const TURN: u16 = 341;

#[esp_rtos::main]
async fn main(_spawner: Spawner) {
    let p = esp_hal::init(esp_hal::Config::default().with_cpu_clock(CpuClock::max()));
    esp_rtos::start(TimerGroup::new(p.TIMG0).timer0, p.FROM_CPU_INTR0);

    // The FIFO stores 128 bytes between reads. `with_rx` enables the pull-up of GPIO5, which keeps the line idle
    // while no arm is connected.
    let config = uart::Config::default().with_baudrate(1_000_000);
    let port = Uart::new(p.UART1, config).unwrap();
    let port = port.with_tx(p.GPIO4).with_rx(p.GPIO5).into_async();

    let mut arm = Arm::open(port, EmbassyClock, Config::DEFAULT);
    connect(&mut arm).await;
    if let Err(error) = turn_wrist_and_grip(&mut arm).await {
        println!("arm lost: {error}");
    }
    loop {
        let error = follow(&mut arm).await;
        println!("arm lost: {error}");
        // A reconnected arm is followed but not moved: someone may be handling it.
        connect(&mut arm).await;
    }
}

/// Sends requests until an arm answers. Without an arm, each call ends with `TimedOut`, after three attempts.
async fn connect(arm: &mut LingArm) {
    println!("waiting for an arm");
    loop {
        if let Ok(info) = arm.read_info().await {
            println!("arm {}, firmware {}", info.serial, info.firmware);
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
        println!("a joint is out of range: not moved");
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
    println!("moving");
    for _ in 0..500 {
        let state = arm.read_joints().await?;
        show(&state);
        if goal.is_reached_by(&state) {
            println!("arrived");
            return Ok(());
        }
        Timer::after_millis(20).await;
    }
    println!("not arrived after 10 s");
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
    println!("joints {joints:?} gripper {gripper} {status}");
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
