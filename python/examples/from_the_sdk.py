"""A script for the vendor's SDK with a changed import. Usage: from_the_sdk.py PORT."""

import sys

from armwire.compat.alicia_d import create_robot

robot = create_robot(port=sys.argv[1])
print(robot.get_robot_state("version"))
robot.set_robot_state(target_joints=[10, -20, 30, 0, 45, -90], joint_format="deg", gripper_value=500, speed_deg_s=100)
print(robot.get_robot_state("joint_gripper"))
robot.set_home(speed_deg_s=100)
robot.disconnect()
