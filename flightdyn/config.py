"""Configuration of the aircraft, its sensors and its weather."""

from typing import Literal, Self

from pydantic import Field, model_validator

from flightdyn.faults import Fault
from flightdyn.tables import Table


class GustConfig(Table):
    """One gust of the shape (1 - cos) / 2, added to wind and turbulence."""

    start_s: float = Field(ge=0, le=1e6)
    """simulated time at which it begins"""
    duration_s: float = Field(5.0, gt=0, le=600)
    """from calm to calm"""
    north_mps: float = Field(0.0, ge=-30, le=30)
    """peak, towards north"""
    east_mps: float = Field(0.0, ge=-30, le=30)
    """peak, towards east"""
    down_mps: float = Field(0.0, ge=-15, le=15)
    """peak, downwards"""


class WindConfig(Table):
    """Steady wind, turbulence and gusts."""

    speed_mps: float = Field(0.0, ge=0, le=25)
    """steady wind speed"""
    from_deg: float = Field(270.0, ge=0, le=360)
    """direction the wind comes from, from north"""
    turbulence_severity: int = Field(0, ge=0, le=7)
    """MIL-F-8785C probability-of-exceedance index; 0 is smooth air"""
    wind_at_20ft_mps: float | None = Field(None, ge=0, le=30)
    """sets the strength of low turbulence; unset: the steady wind speed"""
    gusts: tuple[GustConfig, ...] = ()
    """gusts in order of time"""


class ImuConfig(Table):
    """Gyroscope and accelerometer; the defaults are Gazebo-classic's iris (ADIS16448 class).

    With more noise than the limits allow, landing fails: the attitude is lost at 1000 samples a
    second, or ground contact is detected too late.
    """

    gyro_noise_density: float = Field(1.87e-4, ge=0, le=0.005)
    """white noise, rad/s/sqrt(Hz)"""
    gyro_random_walk: float = Field(3.88e-5, ge=0, le=0.01)
    """bias random walk, rad/s/sqrt(s)"""
    gyro_turn_on_radps: float = Field(0.0087, ge=0, le=0.2)
    """std of the bias at power-up"""
    accel_noise_density: float = Field(1.86e-3, ge=0, le=0.2)
    """white noise, m/s2/sqrt(Hz)"""
    accel_random_walk: float = Field(6.0e-3, ge=0, le=0.1)
    """bias random walk, m/s2/sqrt(s)"""
    accel_turn_on_mps2: float = Field(0.196, ge=0, le=2)
    """std of the bias at power-up"""


class GnssConfig(Table):
    """Satellite receiver: correlated position error, delayed solutions."""

    interval_s: float = Field(0.2, ge=0.04, le=2)
    """between solutions"""
    delay_s: float = Field(0.12, ge=0, le=0.5)
    """from epoch to delivery"""
    std_horizontal_m: float = Field(0.7, ge=0, le=4)
    """std of the correlated error, each horizontal axis"""
    std_vertical_m: float = Field(1.97, ge=0, le=40)
    """std of the correlated error, vertical"""
    correlation_s: float = Field(12.0, ge=0.1, le=3600)
    """time constant of the correlated error"""
    white_m: float = Field(0.05, ge=0, le=5)
    """std of the white position error, each axis"""
    std_vel_horizontal_mps: float = Field(0.09, ge=0, le=5)
    """std of the velocity error, each horizontal axis"""
    std_vel_vertical_mps: float = Field(0.18, ge=0, le=5)
    """std of the velocity error, vertical"""
    satellites: int = Field(14, ge=0, le=60)
    """used in the solution"""


class BaroConfig(Table):
    """Barometer: errors of the static pressure."""

    interval_s: float = Field(0.08, ge=0.004, le=2)
    """between samples"""
    white_pa: float = Field(1.0, ge=0, le=50)
    """std of the white noise"""
    drift_pa: float = Field(1.2, ge=0, le=200)
    """std of the drift"""
    drift_correlation_s: float = Field(600.0, ge=1, le=1e5)
    """time constant of the drift"""


class MagConfig(Table):
    """Magnetometer and the field at home (default: central Europe, WMM2025 rounded)."""

    interval_s: float = Field(0.2, ge=0.1, le=2)
    """between samples; whole steps of the filter, 0.1 s"""
    field_north_gauss: float = Field(0.214, ge=-0.7, le=0.7)
    """field at home"""
    field_east_gauss: float = Field(0.013, ge=-0.7, le=0.7)
    """field at home"""
    field_down_gauss: float = Field(0.430, ge=-0.7, le=0.7)
    """field at home"""
    white_gauss: float = Field(0.004, ge=0, le=0.1)
    """std of the white noise"""
    hard_iron_gauss: float = Field(0.002, ge=0, le=0.05)
    """std of the constant offset left by calibration"""

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

    kind: Literal["realistic", "perfect"] = "realistic"
    """perfect: the autopilot is handed the truth"""
    imu: ImuConfig = Field(default_factory=ImuConfig)
    """gyroscope, accelerometer"""
    gnss: GnssConfig = Field(default_factory=GnssConfig)
    """satellite receiver"""
    baro: BaroConfig = Field(default_factory=BaroConfig)
    """barometer"""
    mag: MagConfig = Field(default_factory=MagConfig)
    """magnetometer"""
    alignment_s: float = Field(4.0, ge=1, le=60)
    """at rest before time zero, to align the filter"""


class LimitsConfig(Table):
    """Limits of guidance: accelerations, smoothing, tilt and speeds."""

    acceleration_mps2: float = Field(5.0, ge=0.5, le=10)
    """along and across"""
    vertical_acceleration_mps2: float = Field(2.5, ge=0.3, le=6)
    """up and down"""
    smoothing_s: float = Field(0.4, ge=0, le=2)
    """acceleration steps are spread over this time"""
    tilt_deg: float = Field(60.0, ge=10, le=75)
    """largest lean"""
    speed_mps: float = Field(25.0, ge=1, le=30)
    """fastest path speed"""
    hold_speed_mps: float = Field(10.0, ge=0.5, le=25)
    """on the way to a hold"""
    climb_mps: float = Field(4.0, ge=0.2, le=8)
    """fastest climb"""
    descent_mps: float = Field(2.5, ge=0.2, le=5)
    """fastest descent"""
    yaw_rate_degps: float = Field(60.0, ge=5, le=180)
    """fastest turn of heading"""
    corner_cut: float = Field(0.7, gt=0, le=1)
    """share of the acceptance radius that corners cut"""


class BatteryConfig(Table):
    """Four-cell lithium-polymer pack."""

    capacity_mah: float = Field(5200.0, ge=100, le=100_000)
    """full charge"""
    resistance_ohm: float = Field(0.02, ge=0, le=0.5)
    """inside the pack"""
    initial: float = Field(1.0, gt=0, le=1)
    """charge at time zero, share"""


class AircraftConfig(Table):
    """The simulated aircraft: rates, weather, sensors, limits, battery and faults."""

    # The dampers of the legs take 136/s off the turning of an aircraft that touches the ground: in
    # longer steps they would kick it instead.
    physics_hz: int = Field(250, ge=200, le=1000)
    """rate of the physics"""
    guidance_interval_s: float = Field(0.02, ge=0.001, le=0.1)
    """between outer-loop steps; whole ticks"""
    heading_deg: float = Field(0.0, ge=0, le=360)
    """heading on the ground"""
    wind: WindConfig = Field(default_factory=WindConfig)
    """weather"""
    sensors: SensorsConfig = Field(default_factory=SensorsConfig)
    """sensors"""
    limits: LimitsConfig = Field(default_factory=LimitsConfig)
    """guidance limits"""
    battery: BatteryConfig = Field(default_factory=BatteryConfig)
    """battery"""
    faults: tuple[Fault, ...] = ()
    """what fails, and when"""
