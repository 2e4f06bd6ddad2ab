"""ftservo-python-sdk, the maker's newer SDK."""

from scservo_sdk import sms_sts

from programs.scservo import ScservoProgram, opened


class Program(ScservoProgram):
    def __init__(self, port: str) -> None:
        handler = opened(port)
        super().__init__(handler, sms_sts(handler), is_own_port=True)
