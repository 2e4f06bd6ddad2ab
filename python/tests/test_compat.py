import ast
import math
from pathlib import Path

import pytest
from scripted import TORQUE_ON, ZERO, Row, RowArm, rows, verdict_of

import armwire
from armwire import sim
from armwire.compat.alicia_d import SynriaRobotAPI, create_robot

TARGET = [10, -20, 30, 0, 45, -90]


@pytest.fixture
def robot(virtual: sim.VirtualLing) -> SynriaRobotAPI:
    return create_robot(virtual.port, variant="gripper_50mm", backend="numpy")


def test_states_have_the_sdks_shapes(robot: SynriaRobotAPI) -> None:
    state = robot.get_robot_state()
    assert state.angles == [0.0] * 6
    assert (state.gripper, state.run_status_text) == (0.0, "locked")
    assert robot.get_robot_state("joint") == [0.0] * 6
    assert robot.get_robot_state("gripper") == 0.0
    assert robot.get_robot_state("version") == {
        "serial_number": "ADFS251205123456",
        "hardware_version": "1.1.0",
        "firmware_version": "6.1.0",
    }
    assert robot.get_robot_state("temperature") == [25.0] * 10
    assert robot.get_robot_state("velocity") == [0.0] * 10
    assert robot.get_robot_state("gripper_type", cache=False) == "50mm"
    check = robot.get_robot_state("self_check")
    assert (check["raw_mask"], check["bits"]) == (0x3FF, [True] * 10)
    assert robot.robot_type == "follower"
    with pytest.raises(ValueError, match="Unsupported info type"):
        robot.get_robot_state("mood")


def test_move_waits_and_keeps_omitted_targets(robot: SynriaRobotAPI) -> None:
    assert robot.set_robot_state(TARGET, 500, joint_format="deg", speed_deg_s=200, tolerance=0.01)
    assert robot.set_robot_state(gripper_value=800)
    joints = robot.get_robot_state("joint")
    assert [math.degrees(joint) for joint in joints] == pytest.approx(TARGET, abs=0.3)
    assert robot.set_robot_state([0.0] * 6, speed_deg_s=[200] * 6)
    assert robot.get_robot_state("gripper") == pytest.approx(800, abs=5)
    robot.set_home(speed_deg_s=200)
    assert robot.get_robot_state("gripper") == pytest.approx(1000, abs=5)


def test_gripper_move_keeps_joints_moved_by_hand(robot: SynriaRobotAPI, virtual: sim.VirtualLing) -> None:
    assert robot.set_robot_state(TARGET, 500, joint_format="deg", speed_deg_s=200)
    robot.torque_control("off")
    virtual.push_joints_deg([40, 0, 0, 0, 0, 0])
    robot.torque_control("on")
    assert robot.set_robot_state(gripper_value=800)
    assert virtual.joints().joints_deg[0] == pytest.approx(40, abs=0.3)


def test_refused_move_changes_no_target(robot: SynriaRobotAPI, virtual: sim.VirtualLing) -> None:
    before = virtual.requests()
    with pytest.raises(ValueError, match="joint_format is 'degrees'"):
        robot.set_robot_state([1.0] * 6, joint_format="degrees")
    assert virtual.requests() == before
    with pytest.raises(ValueError, match="the time-out is nan s"):
        robot.set_robot_state([0.0] * 6, timeout=math.nan)
    assert virtual.requests() == before
    with pytest.raises(ValueError, match="angle of joint 1"):
        robot.set_robot_state([400.0] * 6, joint_format="deg")
    assert robot.set_robot_state(gripper_value=800)


def test_move_that_does_not_arrive_is_false(robot: SynriaRobotAPI) -> None:
    assert not robot.set_robot_state(TARGET, joint_format="deg", speed_deg_s=10, timeout=0.1)
    assert robot.set_robot_state(TARGET, joint_format="deg", wait_for_completion=False)


def test_torque_and_zero(robot: SynriaRobotAPI, virtual: sim.VirtualLing, monkeypatch: pytest.MonkeyPatch) -> None:
    assert robot.torque_control("off")
    assert robot.get_robot_state().run_status_text == "idle"
    questions: list[str] = []
    monkeypatch.setattr("builtins.input", questions.append)
    virtual.push_joints_deg(TARGET)
    assert robot.zero_calibration()
    assert len(questions) == 2
    assert robot.get_robot_state().angles == [0.0] * 6
    assert robot.get_robot_state().run_status_text == "locked"
    with pytest.raises(ValueError, match="'on' or 'off'"):
        robot.torque_control("maybe")


@pytest.mark.parametrize("row", [row for row in rows() if row.effect != ZERO], ids=str)
def test_rows_of_readings_have_their_verdicts(row: Row) -> None:
    with RowArm(row) as scripted, verdict_of(row):
        robot = create_robot(port=scripted.port)
        try:
            assert robot.torque_control("on" if row.effect == TORQUE_ON else "off")
        finally:
            robot.disconnect()


def test_connection_is_opened_and_closed(virtual: sim.VirtualLing) -> None:
    robot = create_robot(port=virtual.port, auto_connect=False)
    assert not robot.is_connected()
    with pytest.raises(ConnectionError):
        robot.get_robot_state()
    assert robot.connect()
    assert robot.is_connected()
    robot.disconnect()
    robot.disconnect()
    with armwire.Ling(virtual.port) as arm:
        arm.read_info()


def test_state_is_printed(robot: SynriaRobotAPI, capsys: pytest.CaptureFixture[str]) -> None:
    robot.print_state()
    assert "Joint angles (°): [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], Gripper (0-1000): 0" in capsys.readouterr().out


def test_port_is_required() -> None:
    with pytest.raises(ValueError, match="the port is required"):
        create_robot()


def test_every_sdk_call_exists_or_names_robocore(robot: SynriaRobotAPI) -> None:
    # The public calls of `SynriaRobotAPI` in alicia_d_sdk 6.1.0.
    calls = ["connect", "disconnect", "is_connected", "get_robot_state", "set_home", "set_robot_state"]
    for call in [*calls, "torque_control", "zero_calibration", "print_state"]:
        assert callable(getattr(robot, call)), call
    planning = ["plan_joint_trajectory", "plan_cartesian_trajectory", "solve_ik_for_trajectory"]
    for call in ["get_pose", "set_pose", *planning]:
        with pytest.raises(NotImplementedError, match="RoboCore"):
            getattr(robot, call)()


def test_example_differs_from_the_sdks_by_one_import() -> None:
    script = (Path(__file__).parent.parent / "examples" / "from_the_sdk.py").read_text()
    imports = [node.module for node in ast.walk(ast.parse(script)) if isinstance(node, ast.ImportFrom)]
    assert imports == ["armwire.compat.alicia_d"]
