"""Faults that an aircraft can be given, by configuration or in flight."""

from typing import Annotated, Literal

from pydantic import Field

from flightdyn.tables import Table

_Rate = Annotated[float, Field(ge=-10, le=10)]
_Item = Annotated[int, Field(ge=0, le=65_535)]
_Force = Annotated[float, Field(ge=-100, le=100)]


class _Fault(Table):
    at_s: float = Field(0.0, ge=0, le=1e6)
    """simulated time at which a configured fault begins"""
    after: Literal["arming", "take-off"] | _Item | None = None
    """from when at_s counts: the first arming, the first take-off, or the number of a mission item,
    from when it is first reached or carried out; unset: from power-up"""
    duration_s: float | None = Field(None, gt=0, le=1e6)
    """how long it lasts; unset: for good"""


class GnssOff(_Fault):
    """The receiver gives no solutions."""

    kind: Literal["gnss_off"] = "gnss_off"


class GnssJump(_Fault):
    """The receiver's position is off by a constant."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    north_m: float = Field(0.0, ge=-1e5, le=1e5)
    """added to the position"""
    east_m: float = Field(0.0, ge=-1e5, le=1e5)
    """added to the position"""
    down_m: float = Field(0.0, ge=-1e4, le=1e4)
    """added to the position"""


class MotorLoss(_Fault):
    """A motor gets only a share of the voltage ordered."""

    kind: Literal["motor_loss"] = "motor_loss"
    motor: int = Field(0, ge=0, le=3)
    """0 front right, 1 rear left, 2 front left, 3 rear right"""
    share: float = Field(0.0, ge=0, le=1)
    """of the voltage; 0: it stops"""


class ImuBias(_Fault):
    """A constant is added to gyroscope and accelerometer, body axes."""

    kind: Literal["imu_bias"] = "imu_bias"
    gyro_radps: tuple[_Rate, _Rate, _Rate] = (0.0, 0.0, 0.0)
    """added to the body rates"""
    accel_mps2: tuple[_Force, _Force, _Force] = (0.0, 0.0, 0.0)
    """added to the specific force"""


class WindBurst(_Fault):
    """Wind that begins and ends abruptly, added to the rest."""

    kind: Literal["wind_burst"] = "wind_burst"
    north_mps: float = Field(0.0, ge=-30, le=30)
    """towards north"""
    east_mps: float = Field(0.0, ge=-30, le=30)
    """towards east"""
    down_mps: float = Field(0.0, ge=-15, le=15)
    """downwards"""


class LinkOff(_Fault):
    """Nothing comes in or goes out over its links; of the built-in autopilot."""

    kind: Literal["link_off"] = "link_off"


Fault = Annotated[
    GnssOff | GnssJump | MotorLoss | ImuBias | WindBurst | LinkOff, Field(discriminator="kind")
]
