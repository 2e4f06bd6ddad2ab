"""Exchanges CAN FD frames between two SLCAN adapters on a virtual bus with python-can, and checks each received frame.

Usage: can_fd_session.py PORT PORT

The PORTs are two SLCAN adapters on the same bus. The bus has no other nodes.
"""

import sys

import can

from checks import SILENCE, STEP_TIMEOUT, require

# The bit rate of the arbitration phase, and the data rates that python-can supports, in bit/s.
BIT_RATE = 1_000_000
DATA_RATES = 2_000_000, 5_000_000
LENGTHS = *range(9), 12, 16, 20, 24, 32, 48, 64


def main(first_port: str, second_port: str) -> None:
    for data_rate in DATA_RATES:
        with open_bus(first_port, data_rate) as first, open_bus(second_port, data_rate) as second:
            for message in fd_messages():
                transfer(message, first, second)
                transfer(message, second, first)
            for message in classic_messages():
                transfer(message, first, second)
            transfer_burst(first, second)
        print(f"CAN FD frames pass at {data_rate // 1_000_000} Mbit/s")
    check_wrong_data_rate(first_port, second_port)
    check_listen_only(first_port, second_port)
    print("python-can exchanges CAN FD frames")


def open_bus(port: str, data_rate: int, **params: object) -> can.BusABC:
    timing = can.BitTimingFd.from_sample_point(
        f_clock=80_000_000,
        nom_bitrate=BIT_RATE,
        nom_sample_point=80,
        data_bitrate=data_rate,
        data_sample_point=80,
    )
    bus = can.Bus(interface="slcan", channel=port, timing=timing, sleep_after_open=0.2, **params)
    # The reply arrives when the channel is open.
    require("the adapter reports its version", bus.get_version(STEP_TIMEOUT) != (None, None))
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


def transfer(message: can.Message, sender: can.BusABC, receiver: can.BusABC) -> None:
    sender.send(message)
    require(f"{message} arrives unchanged", is_same(receiver.recv(STEP_TIMEOUT), message))


def transfer_burst(sender: can.BusABC, receiver: can.BusABC) -> None:
    """Checks the order of many consecutive frames, with a classic frame among them."""
    messages = [message for message in fd_messages() + classic_messages() if not message.is_extended_id]
    for message in messages:
        sender.send(message)
    received = [receiver.recv(STEP_TIMEOUT) for _ in messages]
    require("a burst arrives in order", all(map(is_same, received, messages)))


def check_wrong_data_rate(first_port: str, second_port: str) -> None:
    """Frames with a bit rate switch are lost between two data rates. Frames without it arrive."""
    switching = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, bitrate_switch=True, data=bytes(64))
    steady = can.Message(arbitration_id=2, is_extended_id=False, is_fd=True, data=bytes(64))
    with open_bus(first_port, DATA_RATES[0]) as sender, open_bus(second_port, DATA_RATES[1]) as receiver:
        transfer(steady, sender, receiver)
        sender.send(switching)
        require("a frame at another data rate does not arrive", receiver.recv(SILENCE) is None)


def check_listen_only(first_port: str, second_port: str) -> None:
    """A listen-only adapter does not acknowledge, and without an acknowledgement no frame is valid."""
    message = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(12))
    with (
        open_bus(first_port, DATA_RATES[0]) as sender,
        open_bus(second_port, DATA_RATES[0], listen_only=True) as receiver,
    ):
        sender.send(message)
        require("a frame without an acknowledgement does not arrive", receiver.recv(SILENCE) is None)


def is_same(received: can.Message | None, sent: can.Message) -> bool:
    return received is not None and received.equals(
        sent, timestamp_delta=None, check_channel=False, check_direction=False
    )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
