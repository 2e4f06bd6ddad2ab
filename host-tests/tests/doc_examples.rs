//! The examples of the drivers' documentation, run against the virtual arms in virtual time.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use armwire::Config;
use armwire::driver;
use armwire::time::Instant;
use armwire_bridge::Duration;
use armwire_sim::serial::SerialDevice;
use embedded_io_async::ErrorType;

/// Time limit of an example.
const LIMIT: Instant = Instant::from_millis(30_000);
/// The time of a byte at 1 Mbaud. The virtual arms work at any rate.
const BYTE: Duration = Duration::from_micros(10);

/// A device, and the current time.
struct World<D> {
    device: D,
    now: Instant,
    wake: Option<Instant>,
}

impl<D> World<D> {
    fn wake_at(&mut self, at: Instant) {
        self.wake = Some(self.wake.map_or(at, |wake| wake.min(at)));
    }
}

struct Port<'w, D>(&'w RefCell<World<D>>);

impl<D> ErrorType for Port<'_, D> {
    type Error = Infallible;
}

impl<D: SerialDevice> embedded_io_async::Read for Port<'_, D> {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let world = &mut *self.0.borrow_mut();
            if let Some(byte) = world.device.transmit(world.now) {
                buf[0] = byte;
                world.now += BYTE;
                return Poll::Ready(Ok(1));
            }
            if let Some(at) = world.device.poll_timeout() {
                world.wake_at(at);
            }
            Poll::Pending
        })
        .await
    }
}

impl<D: SerialDevice> embedded_io_async::Write for Port<'_, D> {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, Infallible> {
        let world = &mut *self.0.borrow_mut();
        for byte in buf {
            world.now += BYTE;
            world.device.receive(world.now, *byte);
        }
        Ok(buf.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

struct Clock<'w, D>(&'w RefCell<World<D>>);

impl<D> driver::Clock for Clock<'_, D> {
    fn now(&self) -> Instant {
        self.0.borrow().now
    }

    async fn wait_until(&self, instant: Instant) {
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            if instant <= world.now {
                return Poll::Ready(());
            }
            world.wake_at(instant);
            Poll::Pending
        })
        .await;
    }
}

fn world<D>(device: D) -> RefCell<World<D>> {
    RefCell::new(World {
        device,
        now: Instant::ZERO,
        wake: None,
    })
}

/// Runs a future to its end, within [`LIMIT`].
fn run<D, T>(world: &RefCell<World<D>>, future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        world.borrow_mut().wake = None;
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return output;
        }
        let mut world = world.borrow_mut();
        let wake = world.wake.expect("a pending wake-up");
        world.now = world.now.max(wake);
        assert!(world.now < LIMIT, "it does not end");
    }
}

mod ling {
    use armwire::ling::{GripperSpeed, JOINTS, Opening, Position, Speed};
    use armwire_sim::ling::{Config as ArmConfig, LingArm};

    use super::{Clock as VirtualClock, Config, Instant, Port, run, world};

    include!("../../protocol/doc/ling_tour.rs");

    #[test]
    fn ling_tour_ends_at_its_target() {
        // The last joints are in the last servos, and have the longest way.
        for joint in 0..JOINTS {
            let mut joints = [(Position::CENTRE, Speed::new(2_000).unwrap()); JOINTS];
            joints[joint].0 = Position::new(2_048 + 400).unwrap();
            let target = Move {
                joints,
                gripper: (Opening::new(500).unwrap(), GripperSpeed(1_000)),
            };
            let world = world(LingArm::new(ArmConfig::follower()));
            let clock = VirtualClock(&world);
            let mut arm = Arm::new(Port(&world), &clock, Config::default());
            let (info, arrived) = run(&world, tour(&mut arm, target)).unwrap();
            assert!(arrived);
            assert_eq!(info.serial, ArmConfig::follower().serial);
            let world = world.borrow();
            let arm = &world.device;
            assert!(!arm.is_holding());
            assert_eq!(arm.stroke(), Stroke::Mm50);
            // It sinks since then.
            let centre = Position::CENTRE.ticks();
            assert!(
                arm.joints().iter().all(|at| at.abs_diff(centre) < 10),
                "the pose is the zero"
            );
            assert_eq!((arm.counters().refused, arm.counters().unknown), (0, 0));
            // 400 ticks at 2000 ticks/s.
            assert!(world.now >= Instant::from_millis(190), "joint {joint} had not arrived");
        }
    }
}

mod stop {
    use armwire::ling::stop::{Grip, Stopped};
    use armwire::ling::{Arm, GripperSpeed, JOINTS, Move, Opening, Position, Speed, Stop};
    use armwire_sim::ling::{Config as ArmConfig, LingArm};

    use super::{Clock as VirtualClock, Config, Instant, Port, driver, run, world};

    #[test]
    fn moving_arm_stops_and_holds() {
        let target = Move {
            joints: [(Position::MAX, Speed::new(1_000).unwrap()); JOINTS],
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1_000)),
        };
        let world = world(LingArm::new(ArmConfig::follower()));
        let clock = VirtualClock(&world);
        let mut arm = Arm::new(Port(&world), &clock, Config::default());
        let stopped = run(&world, async {
            arm.move_to(target).await.unwrap();
            driver::Clock::wait_until(&clock, Instant::from_millis(1_000)).await;
            arm.stop(&mut Stop::after(&target)).await.unwrap()
        });
        let Stopped::AtRest {
            state,
            grip: Grip::Goal,
            ..
        } = stopped
        else {
            panic!("{stopped:?}");
        };
        let world = world.borrow();
        assert!(world.device.is_holding() && !world.device.is_moving());
        assert_eq!(world.device.gripper(), 500);
        // 1000 ticks in the first second, less the lag and the sag of the arm.
        for (ticks, at) in state.joints.into_iter().zip(world.device.joints()) {
            assert!((2_985..3_030).contains(&ticks) && ticks.abs_diff(at) <= 3, "{state:?}");
        }
    }
}

mod alpha1_robot {
    use armwire::alpha1::{Angle, Interval, MoveTime};
    use armwire_sim::alpha1::{Alpha1Robot, RobotConfig, SERVOS};

    use super::{Clock as VirtualClock, Config, Instant, Port, run, world};

    include!("../../protocol/doc/alpha1_robot.rs");

    #[test]
    fn robot_example_ends_at_its_target() {
        let mut angles = [None; 20];
        angles[..SERVOS].fill(Some(Angle::new(100).unwrap()));
        let action = Action {
            angles,
            time: MoveTime::new(50),
            interval: Interval::new(50),
        };
        let world = world(Alpha1Robot::new(RobotConfig::default()));
        let clock = VirtualClock(&world);
        let mut arm = Arm::new(Port(&world), &clock, Config::default());
        let name = Text::new(b"dance").unwrap();
        assert_eq!(run(&world, robot(&mut arm, &clock, action, name)), Ok(true));
        assert_eq!(world.borrow().device.usb(), UsbType::SerialPort);
        assert!(world.borrow().now >= Instant::from_millis(1_000), "it waited");
    }
}

mod alpha1_servo {
    use std::convert::Infallible;

    use armwire_sim::alpha1::{BusConfig, ServoBus};

    use super::{Clock as VirtualClock, Config, Port, run, world};

    include!("../../protocol/doc/alpha1_servo.rs");

    fn example(faulty: bool) -> (Result<bool, CallError<Infallible>>, i16) {
        let mut bus = ServoBus::new(BusConfig::default());
        bus.servos_mut()[0].set_faulty(faulty);
        let world = world(bus);
        let mut arm = Arm::new(Port(&world), VirtualClock(&world), Config::default());
        let [one, free] = [1, 17].map(|id| ServoId::new(id).unwrap());
        let done = run(&world, servo(&mut arm, one, Angle::new(90).unwrap(), free));
        let world = world.borrow();
        (done, world.device.servos()[0].offset().thirds())
    }

    #[test]
    fn servo_example_sets_zero_offset() {
        assert_eq!(example(false), (Ok(true), 3));
    }

    #[test]
    fn servo_example_ends_at_a_failing_servo() {
        assert_eq!(example(true), (Err(CallError::Failed), 0));
    }
}

mod xarm {
    use std::collections::VecDeque;

    use armwire::time::Instant;
    use armwire::xarm::{MAX_FRAME, State, XArm};
    use armwire::{Device, DeviceEvent};
    use armwire_sim::serial::SerialDevice;
    use armwire_sim::xarm::{Config as ArmConfig, Model, VirtualXArm};

    use super::{Clock as VirtualClock, Config, Port, run, world};

    include!("../../protocol/doc/xarm_tour.rs");

    /// A virtual arm at the other end of a connection.
    struct Connection {
        arm: VirtualXArm,
        device: Device<XArm, MAX_FRAME>,
        tx_queue: VecDeque<u8>,
        heartbeats: u32,
    }

    impl Connection {
        fn new(arm: VirtualXArm) -> Self {
            Self {
                arm,
                device: Device::default(),
                tx_queue: VecDeque::new(),
                heartbeats: 0,
            }
        }
    }

    impl SerialDevice for Connection {
        fn receive(&mut self, now: Instant, byte: u8) {
            assert!(self.device.receive(&[byte]).is_empty());
            while let Some(event) = self.device.poll() {
                let DeviceEvent::Request { request, key } = event else {
                    panic!("the arm received {event:?}");
                };
                let Some(answer) = self.arm.answer(now, &request) else {
                    self.heartbeats += 1;
                    continue;
                };
                let mut bytes = [0; MAX_FRAME];
                let len = self.device.respond(&answer, key, &mut bytes).unwrap();
                self.tx_queue.extend(&bytes[..len]);
            }
        }

        fn transmit(&mut self, _now: Instant) -> Option<u8> {
            self.tx_queue.pop_front()
        }

        fn poll_timeout(&self) -> Option<Instant> {
            None
        }
    }

    /// Makes the tour with an arm that has this error. Returns true if the example reports a reboot, and the arm's
    /// final state.
    fn toured(error: u8) -> (bool, State) {
        let mut arm = VirtualXArm::new(ArmConfig::new(Model::XArm6));
        arm.set_error(error);
        let world = world(Connection::new(arm));
        let arm = Arm::new(Port(&world), VirtualClock(&world), Config::TCP);
        let (_, radius, is_rebooted) = run(&world, tour(arm, Joint::new(2).unwrap())).unwrap();
        assert!(radius.metres().unwrap() > 0.0);
        let world = world.borrow();
        assert_eq!(world.device.heartbeats, 1);
        (is_rebooted, world.device.arm.state())
    }

    #[test]
    fn xarm_tour_reboots_arm_with_an_error() {
        assert_eq!(toured(11), (true, State::NOT_READY));
    }

    #[test]
    fn xarm_tour_does_not_reboot_sound_arm() {
        assert_eq!(toured(0), (false, State::NOT_READY));
    }
}
