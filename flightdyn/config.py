"""Configuration of the aircraft, its sensors and its weather."""

from typing import Literal, Self

from pydantic import Field, model_validator

from flightdyn.faults import Fault
from flightdyn.tables import Table


class GustConfig(Table):
    """One gust of the shape (1 - cos) / 2, added to wind and turbulence."""

    start_s: float = Field(ge=0, le=1e6, description="simulated time at which it begins")
    duration_s: float = Field(default=5.0, gt=0, le=600, description="from calm to calm")
    north_mps: float = Field(default=0.0, ge=-30, le=30, description="peak, towards north")
    east_mps: float = Field(default=0.0, ge=-30, le=30, description="peak, towards east")
    down_mps: float = Field(default=0.0, ge=-15, le=15, description="peak, downwards")


class WindConfig(Table):
    """Steady wind, turbulence and gusts."""

    speed_mps: float = Field(default=0.0, ge=0, le=25, description="steady wind speed")
    from_deg: float = Field(
        default=270.0, ge=0, le=360, description="direction the wind comes from, from north"
    )
    turbulence_severity: int = Field(
        default=0,
        ge=0,
        le=7,
        description="MIL-F-8785C probability-of-exceedance index; 0 is smooth air",
    )
    wind_at_20ft_mps: float | None = Field(
        default=None,
        ge=0,
        le=30,
        description="sets the strength of low turbulence; unset: the steady wind speed",
    )
    gusts: tuple[GustConfig, ...] = Field(default=(), description="gusts in order of time")


class ImuConfig(Table):
    """Gyroscope and accelerometer; the defaults are Gazebo-classic's iris (ADIS16448 class).

    With more noise than the limits allow, landing fails: the attitude is lost at 1000 samples a
    second, or ground contact is detected too late.
    """

    gyro_noise_density: float = Field(
        default=1.87e-4, ge=0, le=0.005, description="white noise, rad/s/sqrt(Hz)"
    )
    gyro_random_walk: float = Field(
        default=3.88e-5, ge=0, le=0.01, description="bias random walk, rad/s/sqrt(s)"
    )
    gyro_turn_on_radps: float = Field(
        default=0.0087, ge=0, le=0.2, description="std of the bias at power-up"
    )
    accel_noise_density: float = Field(
        default=1.86e-3, ge=0, le=0.2, description="white noise, m/s2/sqrt(Hz)"
    )
    accel_random_walk: float = Field(
        default=6.0e-3, ge=0, le=0.1, description="bias random walk, m/s2/sqrt(s)"
    )
    accel_turn_on_mps2: float = Field(
        default=0.196, ge=0, le=2, description="std of the bias at power-up"
    )


class GnssConfig(Table):
    """Satellite receiver: correlated position error, delayed solutions."""

    interval_s: float = Field(default=0.2, ge=0.04, le=2, description="between solutions")
    delay_s: float = Field(default=0.12, ge=0, le=0.5, description="from epoch to delivery")
    std_horizontal_m: float = Field(
        default=0.7, ge=0, le=4, description="std of the correlated error, each horizontal axis"
    )
    std_vertical_m: float = Field(
        default=1.97, ge=0, le=40, description="std of the correlated error, vertical"
    )
    correlation_s: float = Field(
        default=12.0, ge=0.1, le=3600, description="time constant of the correlated error"
    )
    white_m: float = Field(
        default=0.05, ge=0, le=5, description="std of the white position error, each axis"
    )
    std_vel_horizontal_mps: float = Field(
        default=0.09, ge=0, le=5, description="std of the velocity error, each horizontal axis"
    )
    std_vel_vertical_mps: float = Field(
        default=0.18, ge=0, le=5, description="std of the velocity error, vertical"
    )
    satellites: int = Field(default=14, ge=0, le=60, description="used in the solution")


class BaroConfig(Table):
    """Barometer: errors of the static pressure."""

    interval_s: float = Field(default=0.08, ge=0.004, le=2, description="between samples")
    white_pa: float = Field(default=1.0, ge=0, le=50, description="std of the white noise")
    drift_pa: float = Field(default=1.2, ge=0, le=200, description="std of the drift")
    drift_correlation_s: float = Field(
        default=600.0, ge=1, le=1e5, description="time constant of the drift"
    )


class MagConfig(Table):
    """Magnetometer and the field at home (default: central Europe, WMM2025 rounded)."""

    interval_s: float = Field(
        default=0.2, ge=0.1, le=2, description="between samples; whole steps of the filter, 0.1 s"
    )
    field_north_gauss: float = Field(default=0.214, ge=-0.7, le=0.7, description="field at home")
    field_east_gauss: float = Field(default=0.013, ge=-0.7, le=0.7, description="field at home")
    field_down_gauss: float = Field(default=0.430, ge=-0.7, le=0.7, description="field at home")
    white_gauss: float = Field(default=0.004, ge=0, le=0.1, description="std of the white noise")
    hard_iron_gauss: float = Field(
        default=0.002, ge=0, le=0.05, description="std of the constant offset left by calibration"
    )

    @model_validator(mode="after")
    def _heading(self) -> Self:
        if self.field_north_gauss == self.field_east_gauss == 0:
            raise ValueError(
                "field_north_gauss and field_east_gauss are both 0: where the field is upright it "
                "tells no heading"
            )
        return self


class SensorsConfig(Table):
    """Sensors of the autopilot: IMU, GNSS, barometer, magnetometer."""

    kind: Literal["realistic", "perfect"] = Field(
        default="realistic", description="perfect: the autopilot is handed the truth"
    )
    imu: ImuConfig = Field(default_factory=ImuConfig, description="gyroscope, accelerometer")
    gnss: GnssConfig = Field(default_factory=GnssConfig, description="satellite receiver")
    baro: BaroConfig = Field(default_factory=BaroConfig, description="barometer")
    mag: MagConfig = Field(default_factory=MagConfig, description="magnetometer")
    alignment_s: float = Field(
        default=4.0, ge=1, le=60, description="at rest before time zero, to align the filter"
    )


class LimitsConfig(Table):
    """Limits of guidance: accelerations, smoothing, tilt and speeds."""

    acceleration_mps2: float = Field(default=5.0, ge=0.5, le=10, description="along and across")
    vertical_acceleration_mps2: float = Field(default=2.5, ge=0.3, le=6, description="up and down")
    smoothing_s: float = Field(
        default=0.4, ge=0, le=2, description="acceleration steps are spread over this time"
    )
    tilt_deg: float = Field(default=60.0, ge=10, le=75, description="largest lean")
    speed_mps: float = Field(default=25.0, ge=1, le=30, description="fastest path speed")
    hold_speed_mps: float = Field(default=10.0, ge=0.5, le=25, description="on the way to a hold")
    climb_mps: float = Field(default=4.0, ge=0.2, le=8, description="fastest climb")
    descent_mps: float = Field(default=2.5, ge=0.2, le=5, description="fastest descent")
    yaw_rate_degps: float = Field(default=60.0, ge=5, le=180, description="fastest turn of heading")
    corner_cut: float = Field(
        default=0.7, gt=0, le=1, description="share of the acceptance radius that corners cut"
    )


class BatteryConfig(Table):
    """Four-cell lithium-polymer pack."""

    capacity_mah: float = Field(default=5200.0, ge=100, le=100_000, description="full charge")
    resistance_ohm: float = Field(default=0.02, ge=0, le=0.5, description="inside the pack")
    initial: float = Field(default=1.0, gt=0, le=1, description="charge at time zero, share")


class AircraftConfig(Table):
    """The simulated aircraft: rates, weather, sensors, limits, battery and faults."""

    # The dampers of the legs take 136/s off the turning of an aircraft that touches the ground: in
    # longer steps they would kick it instead.
    physics_hz: int = Field(default=250, ge=200, le=1000, description="rate of the physics")
    guidance_interval_s: float = Field(
        default=0.02, ge=0.001, le=0.1, description="between outer-loop steps; whole ticks"
    )
    heading_deg: float = Field(default=0.0, ge=0, le=360, description="heading on the ground")
    wind: WindConfig = Field(default_factory=WindConfig, description="weather")
    sensors: SensorsConfig = Field(default_factory=SensorsConfig, description="sensors")
    limits: LimitsConfig = Field(default_factory=LimitsConfig, description="guidance limits")
    battery: BatteryConfig = Field(default_factory=BatteryConfig, description="battery")
    faults: tuple[Fault, ...] = Field(default=(), description="what fails, and when")
