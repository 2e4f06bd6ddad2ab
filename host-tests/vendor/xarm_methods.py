"""Calls every method of the vendor's `XArmAPI` on a virtual xArm, and compares the result with a page.

Usage: xarm_methods.py ARMWIRE PAGE [--write]

ARMWIRE is the `armwire` program, which serves the arm. PAGE has the lists of methods between two comments. `--write`
replaces them.
"""

import inspect
import itertools
import signal
import sys
import textwrap
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from xarm.core.wrapper.uxbus_cmd_tcp import UxbusCmdTcp
from xarm.wrapper import XArmAPI

from checks import expect, require, wait_until
from xarm_sdk import VirtualArm

START, END = "<!-- methods: start -->\n", "<!-- methods: end -->\n"
# Timeout of a method, in seconds: the SDK waits up to 5 s for a gripper.
CALL_TIMEOUT = 60
# Number of methods that are called at the same time, each on an arm of its own.
WORKERS = 8
# The state bit "invalid" of an answer.
INVALID = 0x08
# A pose in millimetres and degrees, and joints in degrees.
POSE, JOINTS = [300, 0, 200, 180, 0, 0], [1.0] * 6
# Methods that are not called.
LEFT_OUT = {
    "connect": "the connection",
    "disconnect": "the connection",
    "run_blockly_app": "a file",
    "run_gcode_app": "a file",
    "run_gcode_file": "a file",
    "system_control": "the end of the arm, in another check",
}
# Arguments of methods whose parameters have no default, or none that makes sense.
ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "calibrate_tcp_coordinate_offset": ([POSE] * 4,),
    "calibrate_tcp_orientation_offset": ([0] * 3, [0] * 3),
    "calibrate_user_coordinate_offset": ([0] * 3, [0] * 3),
    "calibrate_user_orientation_offset": ([POSE] * 3,),
    "delete_blockly_app": ("name",),
    "delete_trajectory": ("name",),
    "get_forward_kinematics": (JOINTS,),
    "get_inverse_kinematics": (POSE,),
    "get_pose_offset": (POSE, POSE),
    "getset_tgpio_modbus_data": ([1, 2],),
    "is_joint_limit": (JOINTS,),
    "is_tcp_limit": (POSE,),
    "load_trajectory": ("name.traj",),
    "move_arc_lines": ([POSE],),
    "move_circle": (POSE, POSE, 50),
    "save_record_trajectory": ("name.traj",),
    "send_hex_cmd": ([1],),
    "set_cgpio_analog_with_xyz": (0, 1, [0] * 3, 1),
    "set_cgpio_digital_with_xyz": (0, 1, [0] * 3, 1),
    "set_collision_tool_model": (0,),
    "set_dh_params": ([0] * 28,),
    "set_ft_admittance_ctrl_threshold": ([1] * 6,),
    "set_ft_collision_reb_distance": ([1] * 6,),
    "set_ft_collision_threshold": ([1] * 6,),
    "set_ft_sensor_admittance_parameters": (0, [0] * 6, [1] * 6, [1] * 6, [0] * 6),
    "set_ft_sensor_force_parameters": (0, [0] * 6, [0] * 6, [0] * 6, [0] * 6, [0] * 6, [0] * 6, [0] * 6),
    "set_ft_sensor_load_offset": ([0] * 10,),
    "set_gravity_direction": ([0, 0, -1],),
    "set_initial_point": (JOINTS,),
    "set_modbusrtu_params": (1, 115200),
    "set_position": tuple(POSE),
    "set_position_aa": (POSE,),
    "set_reduced_joint_range": ([0, 1] * 7,),
    "set_reduced_tcp_boundary": ([1, 0] * 3,),
    "set_rs485_baudrate": (115200,),
    "set_rs485_data": ([1, 2],),
    "set_servo_angle": (None, JOINTS, 50),
    "set_servo_angle_j": (JOINTS,),
    "set_servo_attach": (1,),
    "set_servo_cartesian": (POSE,),
    "set_servo_cartesian_aa": (POSE,),
    "set_servo_detach": (1,),
    # The SDK returns a timeout, and an integer would look like a code.
    "set_timeout": (5.0,),
    "set_tcp_load": (0, [0] * 3),
    "set_tcp_offset": ([0] * 6,),
    "set_world_offset": ([0] * 6,),
    "set_tgpio_digital_with_xyz": (0, 1, [0] * 3, 1),
    "set_tgpio_modbus_baudrate": (115200,),
    "set_xarm7_ik_redundancy": ([0] * 7, [1] * 7),
    "vc_set_cartesian_velocity": ([0] * 6,),
    "vc_set_joint_velocity": ([0] * 7,),
    "write_multiple_coil_bits": (0, [1]),
    "write_multiple_holding_registers": (0, [1]),
    "write_and_read_holding_registers": (0, 1, 0, [1]),
}
# The mode of methods that need another one than 0.
MODES = {"set_servo_angle_j": 1}
# Results, in the order of the page.
RESULTS = {
    "works": "The arm executes all requests, and the SDK returns no error",
    "local": "The SDK sends no request, and returns no error: callbacks, and its own settings",
    "refused": "The arm refuses a request, and the SDK returns an error code",
    "hidden": "The arm refuses a request, and the SDK returns no error nevertheless",
    "failed": "The arm executes all requests, and the SDK returns an error code",
    "unsent": "The SDK sends no request, and returns an error code",
    "web": "The SDK needs the web server of the vendor's software, and raises an exception",
    "raises": "The SDK raises an exception of its own after a refusal",
    "left out": "Not called here",
}

# True for each answer since the start of the method that was a refusal.
answers: list[bool] = []
_check = UxbusCmdTcp.check_private_protocol
_receive = UxbusCmdTcp.recv_modbus_response


def _checked(self: UxbusCmdTcp, data: bytes) -> int:
    answers.append(bool(data[7] & INVALID))
    return _check(self, data)


def _received(self: UxbusCmdTcp, *args: Any, **options: Any) -> list[int]:
    before = len(answers)
    received = _receive(self, *args, **options)
    if len(answers) == before:
        # Standard Modbus, which the arm refuses, or no answer.
        answers.append(True)
    return received


UxbusCmdTcp.check_private_protocol = _checked
UxbusCmdTcp.recv_modbus_response = _received


class CallTimeout(BaseException):
    """A method takes too long. The SDK catches every `Exception`."""


def fail(*_: object) -> None:
    raise CallTimeout


def main(armwire: str, page: Path, write: bool) -> None:
    names = [name for name, _ in inspect.getmembers(XArmAPI, inspect.isfunction) if not name.startswith("_")]
    results: dict[str, list[str]] = {result: [] for result in RESULTS}
    # Each method waits for reports: several at once take less time.
    with ProcessPoolExecutor(WORKERS) as workers:
        for name, result in zip(names, workers.map(called, itertools.repeat(armwire), names), strict=False):
            results[result].append(name)
    text = section(results)
    before, rest = page.read_text().split(START)
    _, after = rest.split(END)
    if write:
        page.write_text(before + START + text + END + after)
    else:
        expect(f"{page.name} has the result of every method", rest.startswith(text + END))
    print(f"the vendor's SDK has {len(names)} methods")


def called(armwire: str, name: str) -> str:
    """Calls a method on an arm of its own. Returns its result."""
    if name in LEFT_OUT:
        return "left out"
    with VirtualArm(armwire) as arm:
        sdk = arm.connect()
        wait_until("a report arrives", lambda: sdk._arm._first_report_over, quiet=True)
        sdk.motion_enable(True)
        sdk.set_mode(MODES.get(name, 0))
        sdk.set_state(0)
        wait_until("the arm is ready", lambda: sdk.state == 2, quiet=True)
        answers.clear()
        signal.signal(signal.SIGALRM, fail)
        signal.alarm(CALL_TIMEOUT)
        try:
            result = getattr(sdk, name)(*arguments(name))
        except OSError as error:
            # A connection that is refused.
            print(f"{name}: {error!r}")
            return "web"
        except (LookupError, ValueError) as error:
            print(f"{name}: {error!r}")
            require(f"{name} raises an exception after a refusal only", any(answers))
            return "raises"
        except CallTimeout:
            require(f"{name} returns within {CALL_TIMEOUT} s", False)
        finally:
            signal.alarm(0)
        seen = answers[:]
        sdk.disconnect()
    code = result[0] if isinstance(result, (tuple, list)) and result else result
    has_code = isinstance(code, int) and not isinstance(code, bool) and code != 0
    print(f"{name}: {result}, {len(seen)} answers, {sum(seen)} refused", flush=True)
    if any(seen):
        return "refused" if has_code else "hidden"
    if not seen:
        return "unsent" if has_code else "local"
    return "failed" if has_code else "works"


def arguments(name: str) -> tuple[Any, ...]:
    """The arguments of a method: 1 for each parameter without a default, unless the table has others."""
    if name in ARGUMENTS:
        return ARGUMENTS[name]
    parameters = list(inspect.signature(getattr(XArmAPI, name)).parameters.values())[1:]
    plain = [parameter for parameter in parameters if parameter.kind is parameter.POSITIONAL_OR_KEYWORD]
    return tuple(1 for parameter in plain if parameter.default is parameter.empty)


def section(results: dict[str, list[str]]) -> str:
    """The lists of methods, as the page has them."""
    total = sum(len(names) for names in results.values())
    lists = [f"All {total} methods, each on an arm of its own that is ready to move:\n\n"]
    for result, meaning in RESULTS.items():
        if names := results[result]:
            words = f"* **{meaning}** ({len(names)}): " + ", ".join(f"`{name}`" for name in names) + "."
            lists.append(textwrap.fill(words, 120, subsequent_indent="  ", break_on_hyphens=False) + "\n")
    return "\n" + "".join(lists) + "\n"


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4) or sys.argv[3:] not in ([], ["--write"]):
        sys.exit(__doc__)
    main(sys.argv[1], Path(sys.argv[2]), len(sys.argv) == 4)
