"""Records a virtual Ling arm with `armwire monitor --mcap`, and checks the file with the MCAP readers of Python.

Usage: recordings.py ARMWIRE [PORT CONTROL]

Without PORT, the script starts a virtual arm. PORT and CONTROL are the ports of an adapter with an arm.
"""

import json
import math
import statistics
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import ling
from checks import STEP_TIMEOUT, require

# The gripper's target, in percent.
GRIPPER = 50.0
# The gripper's strokes by code, the stroke of the virtual arm, and the gripper's resolution, in m.
STROKES = [0.05, 0.1]
STROKE = STROKES[0]
GRIPPER_STEP = STROKE / 1000
READINGS = 100
# Few readings: each damaged answer costs a timeout.
NOISY_READINGS = 20
# The adapter's polls per second.
POLL_HZ = 200
TO_ARM, FROM_ARM = 0, 1
NAMES = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "gripper"]


def main(armwire: str, port: str = "", control: str = "") -> None:
    with tempfile.TemporaryDirectory() as folder:
        if control:
            check_adapter(armwire, port, f"control:{control}", Path(folder, "adapter.mcap"))
        else:
            check_line(armwire, Path(folder, "arm"), Path(folder, "line.mcap"))
            check_damage(armwire, Path(folder, "noisy"), Path(folder, "noisy.mcap"))


def check_line(armwire: str, port: Path, file: Path) -> None:
    """An arm polled by the monitor: each answer is a reading."""
    with sim(armwire, port):
        move(armwire, str(port))
        rows = monitor(armwire, file, str(port), "--rate", "200", "--count", str(READINGS))
    recording = Recording(file)
    directions = recording.directions
    require("requests and answers alternate", directions == [TO_ARM, FROM_ARM] * (len(directions) // 2))
    recording.check(rows)
    require("stamps are those of this computer", recording.stamps == recording.log_times)
    require("stamps never decrease", recording.stamps == sorted(recording.stamps))


def check_damage(armwire: str, port: Path, file: Path) -> None:
    """A line with faults: damaged bytes are recorded too."""
    with sim(armwire, port, "--faults", "5000", "--seed", "1"):
        monitor(armwire, file, str(port), "--rate", "200", "--count", str(NOISY_READINGS))
    recording = Recording(file)
    print(f"{recording.damaged} runs of damaged bytes, {len(recording.stamps)} joint states")
    require("damaged bytes are recorded", recording.damaged > 0)
    require("each reading is recorded", len(recording.stamps) >= NOISY_READINGS)


def check_adapter(armwire: str, port: str, control: str, file: Path) -> None:
    """An adapter that polls: the recording has its stamps, in system time."""
    move(armwire, port)
    run(armwire, "config", control, "set", f"poll={POLL_HZ}")
    args = [armwire, "monitor", control, "--from-adapter", "--json", "--count", str(4 * READINGS), "--mcap", str(file)]
    with subprocess.Popen(args, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        # With the answer to this request, the monitor knows the gripper's opening in m.
        run(armwire, "call", "ling", port, "read-stroke")
        out = first + process.communicate()[0]
    require("the monitor succeeds", process.returncode == 0)
    rows = [json.loads(line) for line in out.splitlines()]
    run(armwire, "config", control, "set", "poll=off")
    recording = Recording(file)
    require("only answers are recorded", set(recording.directions) == {FROM_ARM})
    recording.check(rows)
    stamps = recording.stamps
    require("no stamp is in the future", all(stamp <= log for stamp, log in zip(stamps, recording.log_times)))
    # The monitor first has to estimate the messages' delay.
    require("stamps never decrease", stamps[READINGS:] == sorted(stamps[READINGS:]))
    periods = [later - earlier for earlier, later in pairwise(stamps)]
    period = statistics.median(periods)
    print(f"median period {period / 1e6} ms")
    require("the median period is the adapter's poll period", abs(period - 1e9 / POLL_HZ) < 100_000)
    adapter = [row["adapter_time_us"] for row in rows]
    exact = [(b - a) * 1000 == period for (a, b), period in zip(pairwise(adapter), periods)]
    require("most periods equal the adapter's to the microsecond", statistics.mean(exact) > 0.9)


class Recording:
    """All messages of a file. The constructor checks each of them."""

    def __init__(self, file: Path) -> None:
        self.directions: list[int] = []
        self.damaged = 0
        self.stamps: list[int] = []
        self.log_times: list[int] = []
        self.positions: list[dict[str, float]] = []
        # The positions in the frames.
        self.expected: list[dict[str, float]] = []
        self._stroke: float | None = None
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            require("the profile is ros2", reader.get_header().profile == "ros2")
            summary = reader.get_summary()
            assert summary is not None and summary.statistics is not None
            require("the file has an index", len(summary.chunk_indexes) > 0)
            count = 0
            for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
                count += 1
                stamp = decoded.stamp if channel.topic == "/frames" else decoded.header.stamp
                nanos = stamp.sec * 1_000_000_000 + stamp.nanosec
                assert schema is not None
                require("the publish time is the stamp", message.publish_time == nanos)
                if channel.topic == "/frames":
                    require("frames have their type", schema.name == "armwire_msgs/msg/Frame")
                    self._add_frame(decoded)
                else:
                    require("joint states have their topic", channel.topic == "/joint_states")
                    require("joint states have their type", schema.name == "sensor_msgs/msg/JointState")
                    self.stamps.append(nanos)
                    self.log_times.append(message.log_time)
                    self.positions.append(dict(zip(decoded.name, decoded.position, strict=True)))
                    require("velocity and effort are empty", not decoded.velocity and not decoded.effort)
            require("the statistics count each message", summary.statistics.message_count == count)

    def _add_frame(self, frame: Any) -> None:
        require("the frame names its arm", frame.arm == "ling")
        self.directions.append(frame.direction)
        data = bytes(frame.data)
        if not ling.is_frame(data):
            self.damaged += 1
            return
        key, body = tuple(data[1:3]), data[4:-2]
        if frame.direction == FROM_ARM and key == (0x04, 0x0E):
            self._stroke = STROKES[body[0]]
        if frame.direction == FROM_ARM and key == (0x06, 0x00):
            *joints, gripper = struct.unpack_from("<7H", body)
            values = [(ticks - ling.CENTRE) * ling.TICK for ticks in joints]
            if self._stroke is not None:
                values.append(gripper / 1000 * self._stroke)
            self.expected.append(dict(zip(NAMES, values)))

    def check(self, rows: list[dict[str, float]]) -> None:
        """Checks that joint states, frames and the monitor's rows agree."""
        require("no frame is damaged", self.damaged == 0)
        require("each frame with joints has a joint state", len(self.positions) == len(self.expected))
        for actual, expected in zip(self.positions, self.expected):
            require("joints have their names", list(actual) == list(expected))
            close = all(math.isclose(actual[name], expected[name], abs_tol=1e-6) for name in expected)
            require("joint states agree with frames", close)
        require("each row has a joint state", len(rows) == len(self.positions))
        for actual, row in zip(self.positions, rows):
            printed = [math.radians(row[f"joint_{n}_deg"]) for n in range(1, 7)]
            close = all(abs(actual[name] - value) < 1e-6 for name, value in zip(NAMES, printed))
            require("joint states agree with rows", close)
        last = self.positions[-1]
        for name, degrees in zip(NAMES, ling.POSE):
            require(f"{name} is at its target", abs(last[name] - math.radians(degrees)) <= 3.5 * ling.TICK)
        require("the gripper is at its target", abs(last["gripper"] - GRIPPER / 100 * STROKE) <= 5.5 * GRIPPER_STEP)
        print(f"{len(self.directions)} frames, {len(self.positions)} joint states")


@contextmanager
def sim(armwire: str, port: Path, *args: str) -> Iterator[None]:
    """A virtual arm that ends with its `with` block."""
    command = [armwire, "sim", "ling", "--plant", "ideal", "--pty", str(port), *args]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            require("the virtual arm starts", str(port) in process.stdout.readline())
            yield
        finally:
            process.terminate()


def move(armwire: str, port: str) -> None:
    joints = ",".join(map(str, ling.POSE))
    run(armwire, "move", port, f"--joints={joints}", "--speed", "180", "--gripper", str(GRIPPER), "--wait")


def monitor(armwire: str, file: Path, *args: str) -> list[dict[str, float]]:
    """The rows printed by a monitor that records to this file, without rows of missing answers."""
    out = run(armwire, "monitor", "--json", "--mcap", str(file), *args)
    rows = [json.loads(line) for line in out.splitlines()]
    return [row for row in rows if row["joint_1_deg"] is not None]


def run(*command: str) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, timeout=STEP_TIMEOUT).stdout


if __name__ == "__main__":
    if len(sys.argv) not in (2, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
