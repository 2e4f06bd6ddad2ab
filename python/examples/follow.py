"""Makes a follower follow a leader for some seconds, with asyncio. Usage: follow.py LEADER FOLLOWER SECONDS.

The follower moves at once: keep clear of it. It is stopped at the end, and by Ctrl-C.
"""

import asyncio
import sys
import time

from armwire import aio


async def main(leader_port: str, follower_port: str, seconds: float) -> None:
    """Read both arms concurrently, 100 times per second."""
    async with await aio.Ling.open(leader_port) as leader, await aio.Ling.open(follower_port) as follower:
        await follower.set_torque(True)
        until = time.monotonic() + seconds
        try:
            while time.monotonic() < until:
                pose, actual = await asyncio.gather(leader.read_joints(), follower.read_joints())
                off = abs(pose.joints_deg - actual.joints_deg).max()
                print(f"\rfarthest joint is {off:5.1f}° behind", end="", flush=True)
                await follower.move_deg(pose.joints_deg, gripper_permille=pose.gripper_permille, speed_deg_s=200)
                await asyncio.sleep(0.01)
        finally:
            # Ctrl-C cancels this task.
            await follower.stop()
    print()


asyncio.run(main(sys.argv[1], sys.argv[2], float(sys.argv[3])))
