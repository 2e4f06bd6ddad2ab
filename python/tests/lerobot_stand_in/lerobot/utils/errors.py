"""Errors of devices."""


class DeviceNotConnectedError(ConnectionError):
    """The device is not connected."""


class DeviceAlreadyConnectedError(ConnectionError):
    """The device is connected already."""
