"""Records the joints of a Ling arm with an adapter's time stamps. Usage: record.py ADAPTER SECONDS FILE.npz.

ADAPTER is the adapter's serial port, or control:PORT of a virtual board. Other programs may use the arm during this.
"""

import sys

import numpy as np

import armwire

with armwire.Adapter(sys.argv[1]) as adapter:
    print(adapter.identify())
    adapter.set_config({"poll": 200})
    recording = adapter.record_joints(float(sys.argv[2]))
    adapter.set_config({"poll": "off"})
print(f"{len(recording.stamp_us)} readings, every {np.median(np.diff(recording.stamp_us)):.0f} µs")
np.savez(sys.argv[3], stamp_us=recording.stamp_us, joints_deg=recording.joints_deg, gripper=recording.gripper_permille)
