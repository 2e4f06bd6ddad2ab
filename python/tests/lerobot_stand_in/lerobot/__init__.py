"""A stub of the robots and teleoperators of LeRobot 0.6, from its documentation, as far as a plugin uses them.

The tests of the plugin use it because LeRobot needs Python 3.12 and 5 GB. `cargo xtask lerobot` runs the same tests
with LeRobot itself.
"""
