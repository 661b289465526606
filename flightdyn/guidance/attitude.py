"""From a wanted specific thrust and heading to an attitude error: the tilt first, yaw apart."""

import math

from flightdyn.frames import Matrix9, Quaternion, Triple, quaternion_from_euler, wrap_pi


def limit_thrust(wanted: Triple, *, slope: float, least: float, most: float) -> tuple[Triple, bool]:
    """Thrust over mass (m/s2, NED) within lean and strength; height goes before position.

    `slope`: tangent of the largest lean; `least`: upwards, `most`: in all, m/s2. Returns the
    limited vector and whether it had to be cut by more than a hundredth.
    """
    x, y, z = wanted
    up = min(max(-z, least), most)
    across = math.hypot(x, y)
    room = min(up * slope, math.sqrt(max(most * most - up * up, 0.0)))
    if across > room:
        k = room / across
        return (x * k, y * k, -up), across > 1.01 * room
    return (x, y, -up), False


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


def attitude_error(r: Matrix9, thrust: Triple, *, heading: float, wanted_heading: float) -> Triple:
    """Rotation vector (rad, body) that turns the thrust axis onto `thrust` the short way and,
    about the body's own z axis, towards the wanted heading.
    """
    size = math.sqrt(thrust[0] ** 2 + thrust[1] ** 2 + thrust[2] ** 2)
    n, e, d = -thrust[0] / size, -thrust[1] / size, -thrust[2] / size  # wanted body z axis
    x = r[0] * n + r[3] * e + r[6] * d
    y = r[1] * n + r[4] * e + r[7] * d
    z = r[2] * n + r[5] * e + r[8] * d
    sine = math.hypot(x, y)
    angle = math.atan2(sine, z)
    k = angle / sine if sine > 1e-9 else 1.0
    turn = wrap_pi(wanted_heading - heading)
    return (-y * k, x * k, turn * max(r[8], 0.0))
