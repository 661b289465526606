"""Configuration of the vehicle: aircraft, autopilot, firmware, sampling and parameters."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from flightdyn.config import AircraftConfig
from flightdyn.tables import Table

# The environment variable that names a firmware's binary where the configuration does not.
BINARIES = {"px4": "AEROFED_PX4", "ardupilot": "AEROFED_ARDUCOPTER"}


class FirmwareConfig(Table):
    """A real autopilot's firmware, which flies the aircraft instead of the built-in autopilot."""

    path: Path | None = Field(
        default=None,
        description="the binary: PX4's bin/px4, with its etc folder beside bin, or ArduPilot's "
        "arducopter; not given: the one that AEROFED_PX4 or AEROFED_ARDUCOPTER names",
    )
    parameters: dict[str, float] = Field(
        default_factory=dict,
        description="the firmware's own parameters, over those that fit it to the aircraft",
    )
    arguments: tuple[str, ...] = Field(
        default=(), description="given to the binary beside those that it needs"
    )


class VehicleConfig(Table):
    """The aircraft, its autopilot and how closely it is watched."""

    aircraft: AircraftConfig = Field(
        default_factory=AircraftConfig, description="physics, sensors, estimation and control"
    )
    autopilot: Literal["built-in", "px4", "ardupilot"] = Field(
        default="built-in",
        description="who flies the aircraft: built-in, or a real firmware in our world (px4, "
        "ardupilot), see firmware",
    )
    firmware: FirmwareConfig = Field(
        default_factory=FirmwareConfig, description="where autopilot is px4 or ardupilot"
    )
    sample_rate_hz: float = Field(
        default=10.0, ge=0.1, le=1000, description="samples for log and track, simulated time"
    )
    control_rate_hz: float = Field(
        default=50.0, ge=0, le=1000, description="of attitude, setpoints and motors in the log; "
        "0: none"
    )  # fmt: skip
    system_id: int = Field(default=1, ge=1, le=250, description="MAVLink system of the vehicle")
    near_m: float = Field(
        default=3.0, ge=0, le=1e4, description="another aircraft of its world that comes nearer "
        "is told and logged; 0: none"
    )  # fmt: skip
    traffic: Literal["off", "adsb", "utm"] = Field(
        default="off",
        description="each second it tells the other aircraft of its world: as ADSB_VEHICLE or "
        "UTM_GLOBAL_POSITION",
    )
    parameters: dict[str, float] = Field(
        default_factory=dict, description="autopilot parameters that differ from their defaults"
    )
    parameter_file: Path | None = Field(
        default=None,
        description="parameters to start with, it may be empty; a ground station saves there too",
    )

    @model_validator(mode="after")
    def _has_its_firmware(self) -> Self:
        if self.autopilot == "built-in":
            if self.firmware != FirmwareConfig():
                raise ValueError(
                    "firmware is given, but autopilot = 'built-in' flies: set autopilot to "
                    "'px4' or 'ardupilot', or leave firmware out"
                )
            return self
        if self.firmware.path is None:
            raise ValueError(
                f"autopilot = {self.autopilot!r} needs firmware.path, the firmware's binary, or "
                f"{BINARIES[self.autopilot]} in the environment, which names it"
            )
        if self.parameters or self.parameter_file:
            raise ValueError(
                "parameters and parameter_file are the built-in autopilot's: give those of "
                f"{self.autopilot} under firmware.parameters"
            )
        if self.aircraft.sensors.kind == "perfect":
            raise ValueError(
                "aircraft.sensors.kind = 'perfect': a firmware takes readings without noise for "
                "those of broken sensors; it must be 'realistic'"
            )
        return self
