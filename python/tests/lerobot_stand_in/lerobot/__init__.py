"""A stand-in for the robots and teleoperators of LeRobot 0.6, from its documentation, as far as a plugin uses them.

It stands in for LeRobot, which needs Python 3.12 and 5 GB, in the tests of the plugin. `cargo xtask lerobot` runs the
same tests with LeRobot itself.
"""
