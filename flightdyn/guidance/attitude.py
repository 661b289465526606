"""The attitude that a thrust and a heading ask for."""

import math

from flightdyn.frames import Quaternion, Triple, quaternion_from_euler


def attitude_along(thrust: Triple, *, yaw: float) -> Quaternion:
    """The attitude of a body whose thrust points along `thrust` and its nose to `yaw`."""
    size = math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2)
    n, e, d = -thrust[0] / size, -thrust[1] / size, -thrust[2] / size  # body z axis
    c, s = math.cos(yaw), math.sin(yaw)
    # The body z axis in a frame that is turned by yaw alone tells pitch, then roll.
    ahead, right = c * n + s * e, c * e - s * n
    pitch = math.atan2(ahead, d)
    roll = math.atan2(-right, math.hypot(ahead, d))
    return quaternion_from_euler(roll, pitch, yaw)
