//! Moves a Ling arm from an RP2040, and logs its joint positions.
//!
//! | RP2040 | connect to |
//! |---|---|
//! | GP4 (UART1 TX) | the arm's RX, 3.3 V |
//! | GP5 (UART1 RX) | the arm's TX |
//! | GND | the arm's GND |
//! | GP0 (UART0 TX) | a serial terminal at 115200 baud, for the log |
#![no_std]
#![no_main]

use core::fmt::{self, Write};
use core::panic::PanicInfo;

use armwire::Config;
use armwire::driver::{CallError, Clock};
use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
use armwire::ling::{Arm, GripperSpeed, JointState, Move, Opening, Position, Speed, Torque};
use armwire::time::Instant;
use embassy_executor::Spawner;
use embassy_rp::bind_interrupts;
use embassy_rp::pac::PADS_BANK0;
use embassy_rp::peripherals::UART1;
use embassy_rp::uart::{self, Blocking, BufferedInterruptHandler, BufferedUart, UartTx};
use embassy_time::Timer;
use static_cell::StaticCell;

type LingArm = Arm<BufferedUart, EmbassyClock>;
type Error = CallError<uart::Error>;

/// Rotation of the wrist, in ticks: 30°.
const TURN: u16 = 341;

bind_interrupts!(struct Irqs {
    UART1_IRQ => BufferedInterruptHandler<UART1>;
});

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let p = embassy_rp::init(Default::default());
    let mut log = Log(UartTx::new_blocking(p.UART0, p.PIN_0, uart::Config::default()));

    static TX: StaticCell<[u8; 256]> = StaticCell::new();
    static RX: StaticCell<[u8; 256]> = StaticCell::new();
    let (tx, rx) = (TX.init([0; 256]), RX.init([0; 256]));
    let mut config = uart::Config::default();
    config.baudrate = 1_000_000;
    let port = BufferedUart::new(p.UART1, p.PIN_4, p.PIN_5, Irqs, tx, rx, config);
    // The pull-up keeps GP5 idle while no arm is connected. Without it the input floats and receives noise.
    PADS_BANK0.gpio(5).modify(|pad| pad.set_pue(true));

    // The size of the receive buffer: no more bytes are read before a request.
    let config = Config {
        backlog: 256,
        ..Config::DEFAULT
    };
    let mut arm = Arm::new(port, EmbassyClock, config);
    connect(&mut arm, &mut log).await;
    if let Err(error) = turn_wrist_and_grip(&mut arm, &mut log).await {
        log.line(format_args!("arm lost: {error}"));
    }
    loop {
        let error = follow(&mut arm, &mut log).await;
        log.line(format_args!("arm lost: {error}"));
        // A reconnected arm is followed but not moved: someone may be handling it.
        connect(&mut arm, &mut log).await;
    }
}

/// Sends requests until an arm answers. Without an arm, each call ends with `TimedOut`, after three attempts.
async fn connect(arm: &mut LingArm, log: &mut Log) {
    log.line(format_args!("waiting for an arm"));
    loop {
        if let Ok(info) = arm.read_info().await {
            log.line(format_args!("arm {}, firmware {}", info.serial, info.firmware));
            return;
        }
        Timer::after_millis(100).await;
    }
}

/// Turns the wrist by 30° with the gripper half open, then closes the gripper.
async fn turn_wrist_and_grip(arm: &mut LingArm, log: &mut Log) -> Result<(), Error> {
    let state = arm.read_joints().await?;
    show(log, &state);
    let mut joints = match state.positions() {
        Ok(joints) => joints,
        Err(error) => {
            log.line(format_args!("{error}: not moved"));
            return Ok(());
        }
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
    move_to(arm, log, goal).await?;
    goal.gripper.0 = Opening::CLOSED;
    move_to(arm, log, goal).await
}

/// Moves, and logs positions until the arm is at rest at the goal, 10 s at most: a gripper that holds something does not
/// close.
async fn move_to(arm: &mut LingArm, log: &mut Log, goal: Move) -> Result<(), Error> {
    arm.move_to(goal).await?;
    log.line(format_args!("moving"));
    let mut arrival = Arrival::new(goal, Tolerances::MOVE);
    for _ in 0..500 {
        let state = arm.read_joints().await?;
        show(log, &state);
        match arrival.on_joints(EmbassyClock.now(), &state) {
            Arrived::NotYet(_) => {}
            Arrived::Resend => arm.move_to(goal).await?,
            Arrived::AtTarget(_) | Arrived::GripperStandsStill(_) => {
                log.line(format_args!("arrived"));
                return Ok(());
            }
            Arrived::Elsewhere(away) => {
                log.line(format_args!("not arrived: {away}"));
                return Ok(());
            }
        }
        Timer::after_millis(20).await;
    }
    log.line(format_args!("not arrived after 10 s"));
    Ok(())
}

/// Logs each change of the joints until a call fails.
async fn follow(arm: &mut LingArm, log: &mut Log) -> Error {
    let mut last = None;
    loop {
        match arm.read_joints().await {
            Ok(state) if last == Some(state) => {}
            Ok(state) => {
                show(log, &state);
                last = Some(state);
            }
            Err(error) => return error,
        }
        Timer::after_millis(20).await;
    }
}

/// Logs the joints in ticks, 4096 per turn, and the gripper in thousandths of its stroke.
fn show(log: &mut Log, state: &JointState) {
    let JointState {
        joints,
        gripper,
        status,
    } = state;
    log.line(format_args!("joints {joints:?} gripper {gripper} {status}"));
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

/// The log, on UART0.
struct Log(UartTx<'static, Blocking>);

impl Log {
    fn line(&mut self, text: fmt::Arguments<'_>) {
        // Transmission has no errors.
        let _ = write!(self, "{text}\r\n");
    }
}

impl Write for Log {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.blocking_write(text.as_bytes()).map_err(|_| fmt::Error)
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::asm::udf();
}
