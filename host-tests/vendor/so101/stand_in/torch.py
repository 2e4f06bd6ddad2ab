"""Stands in for PyTorch. LeRobot imports it for the types of functions that its arm does not call."""

device = dtype = Tensor = None
