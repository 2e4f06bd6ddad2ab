"""What the documentation of LeRobot 0.6 says of robots and teleoperators, as far as a plugin meets it.

It stands in for LeRobot, which needs Python 3.12 and 5 GB, in the tests of the plugin. `cargo xtask lerobot` runs the
same tests with LeRobot itself.
"""
