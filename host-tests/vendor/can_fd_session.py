"""Exchanges CAN FD frames between SLCAN adapters on a virtual bus, with python-can, and checks each that arrives.

Usage: can_fd_session.py PORT PORT

Both PORTs are SLCAN adapters on one bus, and nobody else is on it.
"""

import sys

import can

# The arbitration phase, and the data phases that python-can knows, in bit/s.
RATE = 1_000_000
DATA_RATES = 2_000_000, 5_000_000
LENGTHS = *range(9), 12, 16, 20, 24, 32, 48, 64
# How long a frame may take, and how long none must come, in seconds.
ARRIVAL, NO_ARRIVAL = 30.0, 0.3


def main() -> None:
    ports = sys.argv[1:3]
    for data_rate in DATA_RATES:
        with open_bus(ports[0], data_rate) as first, open_bus(ports[1], data_rate) as second:
            for message in fd_messages():
                pass_on(message, first, second)
                pass_on(message, second, first)
            for message in classic_messages():
                pass_on(message, first, second)
            burst(first, second)
        print(f"CAN FD frames pass at {data_rate // 1_000_000} Mbit/s")
    wrong_data_rate(*ports)
    listener(*ports)
    print("python-can exchanges CAN FD frames")


def open_bus(port: str, data_rate: int, **params: object) -> can.BusABC:
    timing = can.BitTimingFd.from_sample_point(
        f_clock=80_000_000,
        nom_bitrate=RATE,
        nom_sample_point=80,
        data_bitrate=data_rate,
        data_sample_point=80,
    )
    bus = can.Bus(interface="slcan", channel=port, timing=timing, sleep_after_open=0.2, **params)
    # The reply comes when the channel is open.
    expect("the adapter tells its version", bus.get_version(ARRIVAL) != (None, None))
    return bus


def fd_messages() -> list[can.Message]:
    return [
        can.Message(
            arbitration_id=0x12345678 if extended else 0x123,
            is_extended_id=extended,
            is_fd=True,
            bitrate_switch=switch,
            data=bytes((length + n) & 0xFF for n in range(length)),
        )
        for length in LENGTHS
        for extended in (False, True)
        for switch in (False, True)
    ]


def classic_messages() -> list[can.Message]:
    return [
        can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"joints"),
        can.Message(arbitration_id=0x1FFFFFFF, is_extended_id=True, data=bytes(8)),
        can.Message(arbitration_id=0x100, is_extended_id=False, is_remote_frame=True, dlc=8),
    ]


def pass_on(message: can.Message, sender: can.BusABC, receiver: can.BusABC) -> None:
    sender.send(message)
    expect(f"{message} arrives unchanged", same(receiver.recv(ARRIVAL), message))


def burst(sender: can.BusABC, receiver: can.BusABC) -> None:
    """Many frames in a row keep their order, the classic frame among them."""
    messages = [message for message in fd_messages() + classic_messages() if not message.is_extended_id]
    for message in messages:
        sender.send(message)
    arrived = [receiver.recv(ARRIVAL) for _ in messages]
    expect("a burst arrives in order", all(map(same, arrived, messages)))


def wrong_data_rate(first: str, second: str) -> None:
    """Frames that switch the bit rate do not get through, and others do."""
    switching = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, bitrate_switch=True, data=bytes(64))
    steady = can.Message(arbitration_id=2, is_extended_id=False, is_fd=True, data=bytes(64))
    with open_bus(first, DATA_RATES[0]) as sender, open_bus(second, DATA_RATES[1]) as receiver:
        pass_on(steady, sender, receiver)
        sender.send(switching)
        expect("a frame at another data rate does not arrive", receiver.recv(NO_ARRIVAL) is None)


def listener(first: str, second: str) -> None:
    """An adapter that only listens acknowledges nothing, so that nothing is valid on this bus."""
    message = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(12))
    with open_bus(first, DATA_RATES[0]) as sender, open_bus(second, DATA_RATES[0], listen_only=True) as receiver:
        sender.send(message)
        expect("a frame without an acknowledge does not arrive", receiver.recv(NO_ARRIVAL) is None)


def same(got: can.Message | None, message: can.Message) -> bool:
    return got is not None and got.equals(message, timestamp_delta=None, check_channel=False, check_direction=False)


def expect(what: str, happened: bool) -> None:
    if not happened:
        sys.exit(f"not so: {what}")


if __name__ == "__main__":
    main()
