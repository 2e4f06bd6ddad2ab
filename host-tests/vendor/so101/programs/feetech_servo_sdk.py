"""feetech-servo-sdk, which LeRobot uses: a copy of an older SDK of the maker."""

from scservo_sdk import PacketHandler

from programs.scservo import ScservoProgram, opened


class Program(ScservoProgram):
    def __init__(self, port: str) -> None:
        super().__init__(opened(port), PacketHandler(0), is_own_port=False)
