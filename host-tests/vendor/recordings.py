"""Records a virtual Ling arm with `armwire monitor --mcap`, and checks the file with the MCAP readers of Python.

Usage: recordings.py ARMWIRE [PORT CONTROL]

Without a port it starts a virtual arm. PORT and CONTROL are the ports of an adapter in front of one.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

# The goals of joints, in degrees, and of the gripper, in percent.
JOINTS = [10.0, -20.0, 30.0, 0.0, 45.0, -90.0]
GRIPPER = 50.0
# One step of a joint's sensor, in rad, and of the gripper, in m.
TICK = 2 * math.pi / 4096
STEP = 0.05 / 1000
READINGS = 100
# Each damaged answer takes as long as its timeout.
NOISY_READINGS = 20
# The adapter's polls per second.
POLL = 200
TO_ARM, FROM_ARM = 0, 1
STROKES = [0.05, 0.1]
NAMES = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "gripper"]


def main(armwire: str, port: str = "", control: str = "") -> None:
    with tempfile.TemporaryDirectory() as folder:
        if control:
            check_adapter(armwire, port, f"control:{control}", Path(folder, "adapter.mcap"))
        else:
            check_line(armwire, Path(folder, "arm"), Path(folder, "line.mcap"))
            check_damage(armwire, Path(folder, "noisy"), Path(folder, "noisy.mcap"))


def check_line(armwire: str, port: Path, file: Path) -> None:
    """An arm that is asked: each answer is a reading."""
    with sim(armwire, port):
        move(armwire, str(port))
        rows = monitor(armwire, file, str(port), "--rate", "200", "--count", str(READINGS))
    recording = Recording(file)
    expect("requests and answers alternate", recording.directions == [TO_ARM, FROM_ARM] * (len(recording.directions) // 2))
    recording.check(rows)
    expect("stamps are those of this computer", recording.stamps == recording.log_times)
    expect("stamps never go back", recording.stamps == sorted(recording.stamps))


def check_damage(armwire: str, port: Path, file: Path) -> None:
    """A line with faults: the damaged bytes are there, too."""
    with sim(armwire, port, "--faults", "5000", "--seed", "1"):
        monitor(armwire, file, str(port), "--rate", "200", "--count", str(NOISY_READINGS))
    recording = Recording(file)
    print(f"{recording.damaged} runs of damaged bytes, {len(recording.stamps)} joint states")
    expect("damaged bytes are recorded", recording.damaged > 0)
    expect("every reading is recorded", len(recording.stamps) >= NOISY_READINGS)


def check_adapter(armwire: str, port: str, control: str, file: Path) -> None:
    """An adapter that polls: its stamps, in system time."""
    move(armwire, port)
    run(armwire, "config", control, "set", f"poll={POLL}")
    # A host that asks for the stroke makes the gripper's opening a length.
    args = [armwire, "monitor", control, "--from-adapter", "--json", "--count", str(4 * READINGS), "--mcap", str(file)]
    with subprocess.Popen(args, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        run(armwire, "call", "ling", port, "read-stroke")
        out = first + process.communicate()[0]
    expect("the monitor succeeds", process.returncode == 0)
    rows = [json.loads(line) for line in out.splitlines()]
    run(armwire, "config", control, "set", "poll=off")
    recording = Recording(file)
    expect("only answers are heard", set(recording.directions) == {FROM_ARM})
    recording.check(rows)
    stamps = recording.stamps
    expect("no stamp is in the future", all(stamp <= log for stamp, log in zip(stamps, recording.log_times)))
    # At first the delay of messages is not known yet.
    expect("stamps never go back", stamps[READINGS:] == sorted(stamps[READINGS:]))
    periods = [later - earlier for earlier, later in zip(stamps, stamps[1:])]
    period = statistics.median(periods)
    print(f"median period {period / 1e6} ms")
    expect("the polls' period is that of the adapter", abs(period - 1e9 / POLL) < 100_000)
    adapter = [row["adapter_time_us"] for row in rows]
    exact = [(b - a) * 1000 == period for a, b, period in zip(adapter, adapter[1:], periods)]
    expect("most periods are the adapter's to the microsecond", statistics.mean(exact) > 0.9)


class Recording:
    """All messages of a file, of which each frame is checked."""

    def __init__(self, file: Path) -> None:
        self.directions: list[int] = []
        self.damaged = 0
        self.stamps: list[int] = []
        self.log_times: list[int] = []
        self.positions: list[dict[str, float]] = []
        # What the frames say, to compare with the joint states.
        self.expected: list[dict[str, float]] = []
        self._stroke: float | None = None
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            expect("the profile is ros2", reader.get_header().profile == "ros2")
            summary = reader.get_summary()
            assert summary is not None and summary.statistics is not None
            expect("the file has an index", len(summary.chunk_indexes) > 0)
            count = 0
            for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
                count += 1
                stamp = decoded.stamp if channel.topic == "/frames" else decoded.header.stamp
                nanos = stamp.sec * 1_000_000_000 + stamp.nanosec
                assert schema is not None
                expect("the publish time is the stamp", message.publish_time == nanos)
                if channel.topic == "/frames":
                    expect("frames have their type", schema.name == "armwire_msgs/msg/Frame")
                    self._take_frame(decoded)
                else:
                    expect("joint states have their topic", channel.topic == "/joint_states")
                    expect("joint states have their type", schema.name == "sensor_msgs/msg/JointState")
                    self.stamps.append(nanos)
                    self.log_times.append(message.log_time)
                    self.positions.append(dict(zip(decoded.name, decoded.position, strict=True)))
                    expect("velocity and effort are empty", not decoded.velocity and not decoded.effort)
            expect("the statistics count each message", summary.statistics.message_count == count)

    def _take_frame(self, frame: object) -> None:
        data: bytes = bytes(frame.data)  # type: ignore[attr-defined]
        direction: int = frame.direction  # type: ignore[attr-defined]
        expect("the arm is named", frame.arm == "ling")  # type: ignore[attr-defined]
        self.directions.append(direction)
        length = data[3] if len(data) > 5 else -1
        is_whole = data[:1] == b"\xaa" and len(data) == length + 6 and data[-1] == 0xFF
        if not is_whole or zlib.crc32(data[1:-2]) & 0xFF != data[-2]:
            self.damaged += 1
            return
        command, function, body = data[1], data[2], data[4:-2]
        if direction == FROM_ARM and (command, function) == (0x04, 0x0E):
            self._stroke = STROKES[body[0]]
        if direction == FROM_ARM and (command, function) == (0x06, 0x00):
            words = [int.from_bytes(body[at : at + 2], "little") for at in range(0, 14, 2)]
            values = [(ticks - 2048) * TICK for ticks in words[:6]]
            if self._stroke is not None:
                values.append(words[6] / 1000 * self._stroke)
            self.expected.append(dict(zip(NAMES, values)))

    def check(self, rows: list[dict[str, float]]) -> None:
        """The joint states are what the frames say, and what the monitor printed."""
        expect("no frame is damaged", self.damaged == 0)
        expect("each frame with joints is a joint state", len(self.positions) == len(self.expected))
        for got, want in zip(self.positions, self.expected):
            expect("joints have their names", list(got) == list(want))
            expect("joints are as in the frame", all(math.isclose(got[n], want[n], abs_tol=1e-6) for n in want))
        expect("each row is a joint state", len(rows) == len(self.positions))
        for got, row in zip(self.positions, rows):
            printed = [row[f"joint_{n}_rad"] for n in range(1, 7)]
            expect("joints are as printed", all(abs(got[n] - p) < 1e-6 for n, p in zip(NAMES, printed)))
        last = self.positions[-1]
        for name, degrees in zip(NAMES, JOINTS):
            expect(f"{name} is where it was moved", abs(last[name] - math.radians(degrees)) <= 3.5 * TICK)
        expect("the gripper is where it was moved", abs(last["gripper"] - GRIPPER / 100 * 0.05) <= 5.5 * STEP)
        print(f"{len(self.directions)} frames, {len(self.positions)} joint states")


def sim(armwire: str, port: Path, *args: str) -> subprocess.Popen[str]:
    """A virtual arm, which ends with its `with` block."""

    class Sim(subprocess.Popen[str]):
        def __exit__(self, *what: object) -> None:
            self.terminate()
            super().__exit__(*what)  # type: ignore[arg-type]

    process = Sim([armwire, "sim", "ling", "--pty", str(port), *args], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    expect("the virtual arm starts", str(port) in process.stdout.readline())
    return process


def move(armwire: str, port: str) -> None:
    joints = ",".join(map(str, JOINTS))
    run(armwire, "move", port, f"--joints={joints}", "--speed", "180", "--gripper", str(GRIPPER), "--wait")


def monitor(armwire: str, file: Path, *args: str) -> list[dict[str, float]]:
    """The rows that a monitor prints while it records to this file, without those of missing answers."""
    out = run(armwire, "monitor", "--json", "--mcap", str(file), *args)
    rows = [json.loads(line) for line in out.splitlines()]
    return [row for row in rows if row["joint_1_rad"] is not None]


def run(*command: str) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, timeout=60).stdout


def expect(what: str, is_so: bool) -> None:
    if not is_so:
        sys.exit(f"FAILED: {what}")


if __name__ == "__main__":
    main(*sys.argv[1:])
