"""Moves a Ling arm slowly, waits, and prints its position. Usage: move.py PORT. Ctrl-C stops the arm."""

import sys

import armwire

TARGET_DEG = [0, 10, -20, 0, 0, 45]

with armwire.Ling(sys.argv[1]) as arm:
    print(arm.read_info())
    input(f"The arm will move to {TARGET_DEG} degrees: keep clear of it. Enter starts, Ctrl-C cancels. ")
    arm.set_torque(True)
    arm.move_deg(TARGET_DEG, gripper_permille=500, speed_deg_s=15)
    state = arm.wait_until_at_deg(TARGET_DEG)
    print("joints in degrees:", state.joints_deg.round(2), "gripper:", state.gripper_permille)
    print("temperatures in °C:", arm.read_temperatures_celsius())
    print("faulty servos:", arm.self_check())
