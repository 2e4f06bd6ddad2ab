"""The plugin through LeRobot's interface: LeRobot if it is installed, else a stand-in from its documentation."""

import importlib
import importlib.util
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest
from conftest import served
from scripted import MOVE, READ_JOINTS, TORQUE_OFF, TORQUE_ON, Row, RowArm, ScriptedArm, rows
from test_foreign import Bessica, UnknownStatus

import armwire
from armwire import MotionStatus, sim

HERE = Path(__file__).parent
if importlib.util.find_spec("lerobot") is None:
    sys.path.insert(0, str(HERE / "lerobot_stand_in"))
for package in ("lerobot_plugin", "lerobot_teleoperator"):
    sys.path.insert(0, str(HERE.parent / package))

plugin: Any = importlib.import_module("lerobot_robot_alicia_d_armwire")
leader_plugin: Any = importlib.import_module("lerobot_teleoperator_alicia_d_leader_armwire")
errors: Any = importlib.import_module("lerobot.utils.errors")
robots: Any = importlib.import_module("lerobot.robots")
teleoperators: Any = importlib.import_module("lerobot.teleoperators")

NAMES = [*(f"joint{joint}.pos" for joint in range(1, 7)), "gripper.pos"]
POSE = dict(zip(NAMES, [10.0, -20.0, 30.0, 0.0, 45.0, -90.0, 500.0], strict=True))
# In degrees: an arm with weight rests below its goals.
CLOSE = 2.0
# In degrees, and in ticks: the readings of an arm at rest.
REST_DEG, REST = 0.3, 3


def follower(port: str, tmp_path: Path, **options: Any) -> Any:
    config = plugin.AliciaDArmwireConfig(id="test", calibration_dir=tmp_path, port=port, speed_deg_s=400, **options)
    return plugin.AliciaDArmwire(config)


def leader(port: str, tmp_path: Path, **options: Any) -> Any:
    config = leader_plugin.AliciaDLeaderArmwireConfig(id="test", calibration_dir=tmp_path, port=port, **options)
    return leader_plugin.AliciaDLeaderArmwire(config)


@pytest.fixture
def virtual() -> Iterator[sim.VirtualLing]:
    """A virtual follower, with weight."""
    with sim.ling() as virtual:
        yield virtual


@pytest.fixture
def robot(virtual: sim.VirtualLing, tmp_path: Path) -> Iterator[Any]:
    robot = follower(virtual.port, tmp_path, action_timeout_s=0)
    robot.connect()
    yield robot
    if robot.is_connected:
        robot.disconnect()


@pytest.mark.parametrize(("kind", "reason"), [(Bessica, "not an Alicia-D"), (UnknownStatus, "status 0x42")])
def test_only_an_alicia_d_of_known_status_acts(kind: type[ScriptedArm], reason: str, tmp_path: Path) -> None:
    with kind(lambda _: 2048) as virtual:
        robot = follower(virtual.port, tmp_path, action_timeout_s=0)

        def act() -> None:
            with warnings.catch_warnings():
                # The status shows no torque.
                warnings.simplefilter("ignore")
                robot.connect()
            robot.send_action(POSE)

        with pytest.raises(errors.DeviceNotConnectedError, match=reason):
            act()
        assert MOVE not in virtual.requests
        if robot.is_connected:
            robot.disconnect()


def test_action_that_the_adapter_refuses_names_the_stop(board: Path, tmp_path: Path) -> None:
    robot = follower(f"slcan:{board / 'bus'}", tmp_path, action_timeout_s=0)
    robot.connect()
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.stop()
        with pytest.raises(errors.DeviceNotConnectedError, match=r"motion is refused for .* stopped by a host on USB"):
            robot.send_action(POSE)
    robot.disconnect()


def test_another_robot_leads_no_follower(tmp_path: Path) -> None:
    with Bessica(lambda _: 2048) as virtual:
        teleoperator = leader(virtual.port, tmp_path)
        teleoperator.connect()
        with pytest.raises(errors.DeviceNotConnectedError, match="not an Alicia-D but a Bessica-D"):
            teleoperator.get_action()
        teleoperator.disconnect()


def wait_until(holds: Any) -> None:
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def is_at(observation: dict[str, float], pose: dict[str, float]) -> bool:
    close = {name: 2 if name == "gripper.pos" else CLOSE for name in pose}
    return all(abs(observation[name] - value) <= close[name] for name, value in pose.items())


def refusal(robot: Any) -> str:
    """The reason why there is no observation; empty if there is one."""
    try:
        robot.get_observation()
    except errors.DeviceNotConnectedError as error:
        return str(error)
    return ""


def test_plugin_has_the_names_that_lerobot_expects(tmp_path: Path) -> None:
    robot, teleoperator = follower("/dev/none", tmp_path), leader("/dev/none", tmp_path)
    assert isinstance(robot, robots.Robot)
    assert isinstance(robot.config, robots.RobotConfig)
    assert isinstance(teleoperator, teleoperators.Teleoperator)
    assert isinstance(teleoperator.config, teleoperators.TeleoperatorConfig)
    assert robot.config.type == robot.name == "alicia_d_armwire"
    assert teleoperator.config.type == teleoperator.name == "alicia_d_leader_armwire"
    for device, kind in ((robot, "robot"), (teleoperator, "teleoperator")):
        # LeRobot finds the device class by its configuration's name, in the package or in a module with that name.
        assert type(device.config).__name__ == type(device).__name__ + "Config"
        assert type(device.config).__module__ == f"lerobot_{kind}_{device.name}.config_{device.name}"
        assert device.config_class is type(device.config)


def test_features_are_known_without_a_connection(tmp_path: Path) -> None:
    robot, teleoperator = follower("/dev/none", tmp_path), leader("/dev/none", tmp_path)
    assert list(robot.action_features) == list(robot.observation_features) == NAMES
    assert list(teleoperator.action_features) == NAMES
    assert teleoperator.feedback_features == {}
    assert not robot.is_connected
    assert not teleoperator.is_connected
    for call in (robot.get_observation, lambda: robot.send_action(POSE), robot.disconnect, teleoperator.get_action):
        with pytest.raises(errors.DeviceNotConnectedError, match="is not connected"):
            call()


def test_action_moves_and_is_observed_in_degrees(robot: Any) -> None:
    assert robot.send_action(POSE) == POSE
    wait_until(lambda: is_at(robot.get_observation(), POSE))
    assert set(robot.get_observation()) == set(robot.observation_features)


def test_action_out_of_range_is_clamped_and_returned(robot: Any) -> None:
    sent = robot.send_action({**POSE, "joint1.pos": 400.0, "joint2.pos": -400.0, "gripper.pos": 1200.0})
    assert (sent["joint1.pos"], sent["joint2.pos"], sent["gripper.pos"]) == (179.912, -180.0, 1000.0)


@pytest.mark.parametrize("wrong", [{"joint3.pos": float("nan")}, {"gripper.pos": float("inf")}])
def test_action_without_a_number_is_not_sent(tmp_path: Path, wrong: dict[str, float]) -> None:
    with ScriptedArm(lambda _: 2048) as scripted:
        robot = follower(scripted.port, tmp_path, action_timeout_s=0)
        robot.connect()
        with pytest.raises(ValueError, match="must be a number"):
            robot.send_action({**POSE, **wrong})
        with pytest.raises(ValueError, match=r"joint1.pos of the action is missing"):
            robot.send_action({"gripper.pos": 1.0})
        robot.disconnect()
    assert MOVE not in scripted.requests


def test_lost_answers_do_not_end_observations(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    # One answer of 21 bytes in a hundred.
    virtual.set_faults(sim.Faults(drop=500))
    robot = follower(virtual.port, tmp_path, action_timeout_s=0, observation_max_age_s=10)
    robot.connect()
    wait_until(lambda: robot._reader.counts().lost > 2 and robot.get_observation())
    robot.disconnect()


def test_observation_is_of_the_time_of_the_newest_image() -> None:
    poses = importlib.import_module("lerobot_robot_alicia_d_armwire.pose")
    with (
        ScriptedArm(lambda reading: 2048 + reading) as scripted,
        armwire.Ling(scripted.port) as arm,
        poses.start_reader(arm, 200) as reader,
    ):
        older, image, newer = (reader.next_after(number) for number in (1, 2, 3))
        patience = plugin.patience.Patience(1.0)
        observed = poses.observed(reader, [None, older.monotonic_ns, image.monotonic_ns], 10.0, patience)
        assert observed == poses.pose(image.pose)
        for times in ([], [None], [image.monotonic_ns + 10**12]):
            newest = poses.observed(reader, times, 10.0, patience)
            assert newest["joint1.pos"] >= newer.pose.joints_deg[0]


def test_image_has_the_time_of_its_camera() -> None:
    poses = importlib.import_module("lerobot_robot_alicia_d_armwire.pose")

    class Camera:
        """A camera that replaces its first image while it is read."""

        latest_timestamp = time.perf_counter()
        reads = 0

        def read_latest(self) -> str:
            self.reads += 1
            if self.reads == 1:
                self.latest_timestamp += 1
                return "old"
            return "new"

    camera, patience = Camera(), plugin.patience.Patience(1.0)
    image, monotonic_ns = poses.image(camera, patience)
    assert image == "new"
    seconds = camera.latest_timestamp - time.perf_counter()
    assert abs(monotonic_ns - time.monotonic_ns() - seconds * 1e9) < 1e9
    assert poses.image(type("Old", (), {"read_latest": lambda self: "image"})(), patience) == ("image", None)


def test_image_that_is_too_old_waits_for_the_next() -> None:
    poses = importlib.import_module("lerobot_robot_alicia_d_armwire.pose")

    class Camera:
        """A camera with an old image, which it has not returned before, and then another."""

        images: ClassVar = ["old", "new"]
        latest_timestamp = 0.0
        waits = 0

        def read_latest(self) -> str:
            if self.waits < len(self.images):
                raise TimeoutError("latest frame is too old: 800.0 ms")
            return self.images[-1]

        def async_read(self, timeout_ms: float) -> str:
            assert 0 < timeout_ms <= 20_000
            self.waits += 1
            return self.images[self.waits - 1]

    patience = plugin.patience.Patience(20.0)
    assert poses.image(Camera(), patience)[0] == "new"
    assert patience.waits == 1


@pytest.mark.parametrize("limit", [5.0, {f"joint{joint}": 5.0 for joint in range(1, 7)}])
def test_relative_target_is_limited(virtual: sim.VirtualLing, tmp_path: Path, limit: Any) -> None:
    robot = follower(virtual.port, tmp_path, max_relative_target=limit, action_timeout_s=0)
    robot.connect()
    sent = robot.send_action(POSE)
    # From the arm's pose, which is its goal less its sag.
    assert [sent[name] for name in NAMES] == pytest.approx([5.0, -5.0, 5.0, 0.0, 5.0, -5.0, 500.0], abs=1.5)
    robot.disconnect()


def test_stale_action_stops_the_arm(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    robot = follower(virtual.port, tmp_path, action_timeout_s=0.1)
    robot.config.speed_deg_s = 50
    robot.connect()
    robot.send_action({**POSE, "joint1.pos": 170.0})
    time.sleep(0.6)
    stopped = robot.get_observation()["joint1.pos"]
    assert 1 < stopped < 60
    time.sleep(0.3)
    assert robot.get_observation()["joint1.pos"] == pytest.approx(stopped, abs=REST_DEG)
    # It moves again with the next actions.
    for _ in range(20):
        robot.send_action({**POSE, "joint1.pos": 170.0})
        time.sleep(0.02)
    assert robot.get_observation()["joint1.pos"] > stopped + 5
    robot.disconnect()


def test_failed_stop_is_retried(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    robot = follower(virtual.port, tmp_path, action_timeout_s=0.05)
    robot.config.speed_deg_s = 20
    robot.connect()
    robot.send_action({**POSE, "joint1.pos": 170.0})
    virtual.set_faults(sim.Faults(drop=1_000_000))
    time.sleep(1.0)
    virtual.set_faults(sim.Faults())
    time.sleep(2.5)
    stopped = virtual.joints().ticks
    time.sleep(0.2)
    assert virtual.joints().ticks == pytest.approx(stopped, abs=REST)
    assert virtual.joints().joints_deg[0] < 120
    robot.disconnect()


def test_stop_waits_for_rest_and_ends_the_stream(tmp_path: Path) -> None:
    # It goes on at 2 ticks per reading: less than a step of a stop by distance.
    with ScriptedArm(lambda reading: 2048 + 2 * min(reading, 30)) as scripted:
        robot = follower(scripted.port, tmp_path, action_timeout_s=0)
        robot.connect()
        robot.send_action(POSE)
        robot.disconnect()
    assert scripted.requests.count(READ_JOINTS) > 30
    assert scripted.requests[-1] == TORQUE_ON


def test_action_without_torque_is_an_error(robot: Any, virtual: sim.VirtualLing) -> None:
    robot._arm.set_torque(False)
    with pytest.raises(errors.DeviceNotConnectedError, match="the torque is off"):
        robot.send_action(POSE)
    assert virtual.joints().status is MotionStatus.IDLE


def test_warm_arm_connects(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    with armwire.Ling(virtual.port) as arm:
        # The temperature of its servos: the arm reports overheating, and holds.
        arm.set_temperature_limit_celsius(25)
    robot = follower(virtual.port, tmp_path, action_timeout_s=0, observation_max_age_s=10)
    with pytest.warns(UserWarning, match="torque on: sent; status overheating does not show its effect"):
        robot.connect()
    assert virtual.joints().status is MotionStatus.OVERHEATING
    robot.send_action(POSE)
    wait_until(lambda: is_at(robot.get_observation(), POSE))
    robot.disconnect()


@pytest.mark.parametrize("row", [row for row in rows() if row.effect == TORQUE_ON], ids=str)
def test_rows_of_readings_have_their_verdicts(row: Row, tmp_path: Path) -> None:
    with RowArm(row) as scripted, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = follower(scripted.port, tmp_path)
        if row.verdict == "contradicted":
            with pytest.raises(errors.DeviceNotConnectedError, match="torque on was sent, but the status is"):
                robot.connect()
        else:
            robot.connect()
            robot.disconnect()
    texts = [str(warning.message) for warning in caught]
    assert [" does not show its effect" in text for text in texts] == [True] * (row.verdict == "not-shown")


@pytest.mark.parametrize("row", [row for row in rows() if row.effect == TORQUE_OFF], ids=str)
def test_rows_after_disconnect_have_their_verdicts(row: Row, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with RowArm(row) as scripted, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = follower(scripted.port, tmp_path, disable_torque_on_disconnect=True)
        # Only the torque-off of `disconnect` has a row.
        robot.configure = lambda: None
        robot.connect()
        with caplog.at_level("WARNING"):
            robot.disconnect()
    texts = [str(warning.message) for warning in caught]
    assert [" does not show its effect" in text for text in texts] == [True] * (row.verdict == "not-shown")
    assert ("torque off was sent, but the status is" in caplog.text) == (row.verdict == "contradicted")


@pytest.mark.parametrize("torque_off", [False, True])
def test_disconnect_stops_and_switches_torque_as_configured(
    virtual: sim.VirtualLing, tmp_path: Path, torque_off: bool
) -> None:
    robot = follower(virtual.port, tmp_path, disable_torque_on_disconnect=torque_off, action_timeout_s=0)
    robot.config.speed_deg_s = 50
    robot.connect()
    with pytest.raises(errors.DeviceAlreadyConnectedError):
        robot.connect()
    robot.send_action({**POSE, "joint1.pos": 170.0})
    wait_until(lambda: robot.get_observation()["joint1.pos"] > 1)
    robot.disconnect()
    assert not robot.is_connected
    # Joint 1 has no weight: without torque the others sink.
    stopped = virtual.joints().ticks[0]
    time.sleep(0.2)
    assert virtual.joints().ticks[0] == pytest.approx(stopped, abs=REST)
    assert virtual.joints().joints_deg[0] < 60
    assert virtual.joints().status == (MotionStatus.IDLE if torque_off else MotionStatus.LOCKED)


def test_disconnect_parks_the_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with sim.ling() as virtual:
        with armwire.Ling(virtual.port) as arm:
            arm.set_torque(False)
            saved = arm.save_park_pose()
        robot = follower(virtual.port, tmp_path, park_on_disconnect=True)
        robot.connect()
        robot.send_action({**dict(zip(NAMES, [*saved, 0.0], strict=True)), "joint1.pos": 15.0})
        wait_until(lambda: robot.get_observation()["joint1.pos"] > 5)
        robot.disconnect()
        assert virtual.joints().is_torque_off
        assert max(abs(virtual.joints().joints_deg - saved)) < 5.8


def test_arm_without_a_saved_pose_is_not_connected(
    virtual: sim.VirtualLing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    robot = follower(virtual.port, tmp_path, park_on_disconnect=True)
    with pytest.raises(errors.DeviceNotConnectedError, match="no pose is saved"):
        robot.connect()
    assert not robot.is_connected
    with pytest.raises(ValueError, match="exclude each other"):
        follower(virtual.port, tmp_path, park_on_disconnect=True, disable_torque_on_disconnect=True)


def test_disconnect_ends_the_stream_of_an_adapter(board: Path, tmp_path: Path) -> None:
    seen = []
    with armwire.Adapter(f"control:{board / 'control'}") as adapter:
        adapter.set_config({"poll": 100, "host-timeout.after-ms": 1000, "host-timeout.torque-off": True})
        robot = follower(str(board / "arm"), tmp_path, action_timeout_s=0)
        robot.connect()
        for _ in range(3):
            robot.send_action(POSE)
        # The answer comes after the actions. The stream is armed: flash is not written.
        robot._arm.read_joints()
        with pytest.raises(armwire.errors.RefusedError, match="stream"):
            adapter.save_config()
        robot.disconnect()
        for telemetry in adapter.telemetry(events=True):
            seen.append(telemetry)
            # Twice the host's timeout, by the adapter's clock.
            if telemetry.stamp_us > seen[0].stamp_us + 2_000_000:
                break
        adapter.reset_config()
    assert [each.event for each in seen if each.event] == []
    assert all(each.joints is not None and each.joints.is_holding for each in seen)


def test_unplugged_arm_is_a_clear_error(virtual: sim.VirtualLing, tmp_path: Path) -> None:
    robot = follower(virtual.port, tmp_path, action_timeout_s=0.05)
    robot.connect()
    robot.send_action(POSE)
    virtual.close()
    wait_until(lambda: "was it unplugged" in refusal(robot))
    with pytest.raises(errors.DeviceNotConnectedError, match="was it unplugged"):
        robot.send_action(POSE)
    time.sleep(0.2)
    robot.disconnect()
    assert not robot.is_connected


def test_arm_goes_on_after_a_loss_of_its_port(tmp_path: Path) -> None:
    port = tmp_path / "arm"
    robot = follower(str(port), tmp_path)
    with served(port):
        robot.connect()
        robot.send_action(POSE)
    wait_until(lambda: "was it unplugged" in refusal(robot))
    with served(port):
        wait_until(lambda: not refusal(robot))
        target = {**POSE, "joint1.pos": 20.0}
        robot.send_action(target)
        wait_until(lambda: robot.send_action(target) and is_at(robot.get_observation(), target))
        robot.disconnect()


def test_unusable_arm_is_a_clear_error(tmp_path: Path) -> None:
    for make in (follower, leader):
        with pytest.raises(errors.DeviceNotConnectedError, match="no such port"):
            make("/dev/no-such-port", tmp_path).connect()
    with (
        sim.ling(leader=True, plant="ideal") as virtual,
        pytest.raises(errors.DeviceNotConnectedError, match="is a leader, not a follower"),
    ):
        follower(virtual.port, tmp_path).connect()
    with sim.older_ling() as older, pytest.raises(errors.DeviceNotConnectedError, match="older generation"):
        leader(older.port, tmp_path).connect()


@pytest.mark.parametrize("make", [follower, leader])
def test_interrupted_connect_closes_the_port(tmp_path: Path, ctrl_c: Callable[[], None], make: Any) -> None:
    def interrupted(reading: int) -> int:
        if reading == 0:
            ctrl_c()
        return 2048

    def times_open(port: str) -> int:
        return [os.path.realpath(file) for file in Path("/proc/self/fd").iterdir()].count(port)

    with ScriptedArm(interrupted) as scripted:
        before = times_open(scripted.port)
        # Its traceback keeps what was left open, as in an interactive session.
        with pytest.raises(KeyboardInterrupt) as interrupt:
            make(scripted.port, tmp_path).connect()
        after = times_open(scripted.port)
        del interrupt
    assert after == before


@pytest.mark.parametrize(
    "options",
    [
        {"speed_deg_s": 4},
        {"reading_rate_hz": 0},
        {"observation_max_age_s": 0},
        {"observation_timeout_s": -1},
        {"observation_timeout_s": float("nan")},
        {"speed_deg_s": 500},
        {"action_timeout_s": -1},
        {"gripper_ticks_s": 99999},
        {"max_relative_target": -5.0},
        {"max_relative_target": float("nan")},
        {"max_relative_target": {"joint7": 5.0}},
    ],
)
def test_invalid_configuration_is_an_error(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        plugin.AliciaDArmwireConfig(port="/dev/none", **options)


def test_calibration_is_explained_and_changes_nothing(
    robot: Any, virtual: sim.VirtualLing, caplog: pytest.LogCaptureFixture
) -> None:
    assert robot.is_calibrated
    before = virtual.joints()
    with caplog.at_level("INFO"):
        robot.calibrate()
    assert "armwire set-zero PORT" in caplog.text
    assert virtual.joints() == before


def test_follower_follows_a_moving_leader(robot: Any, tmp_path: Path) -> None:
    with sim.ling(leader=True, plant="ideal") as hand:
        teleoperator = leader(hand.port, tmp_path)
        teleoperator.connect()
        for step in range(40):
            hand.push_joints_deg([step, -step, step / 2, 0, 0, 0])
            hand.push_gripper_permille(10 * step)
            action = teleoperator.get_action()
            robot.send_action(action)
            time.sleep(0.01)
        wait_until(lambda: is_at(teleoperator.get_action(), {"joint1.pos": 39, "joint2.pos": -39, "gripper.pos": 390}))
        action = teleoperator.get_action()
        robot.send_action(action)
        wait_until(lambda: is_at(robot.get_observation(), action))
        teleoperator.send_feedback({})
        teleoperator.disconnect()
