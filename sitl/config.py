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

    path: Path | None = None
    """the binary: PX4's bin/px4, with its etc folder beside bin, or ArduPilot's arducopter; not
    given: the one that AEROFED_PX4 or AEROFED_ARDUCOPTER names"""
    parameters: dict[str, float] = Field(default_factory=dict)
    """the firmware's own parameters, over those that fit it to the aircraft"""
    arguments: tuple[str, ...] = ()
    """given to the binary beside those that it needs"""


class VehicleConfig(Table):
    """The aircraft, its autopilot and how closely it is watched."""

    aircraft: AircraftConfig = Field(default_factory=AircraftConfig)
    """physics, sensors, estimation and control"""
    autopilot: Literal["built-in", "px4", "ardupilot"] = "built-in"
    """who flies the aircraft: built-in, or a real firmware in our world (px4, ardupilot), see
    firmware"""
    firmware: FirmwareConfig = Field(default_factory=FirmwareConfig)
    """where autopilot is px4 or ardupilot"""
    sample_rate_hz: float = Field(10.0, ge=0.1, le=1000)
    """samples for log and track, simulated time"""
    control_rate_hz: float = Field(50.0, ge=0, le=1000)
    """of attitude, setpoints and motors in the log; 0: none"""
    system_id: int = Field(1, ge=1, le=250)
    """MAVLink system of the vehicle"""
    near_m: float = Field(3.0, ge=0, le=1e4)
    """another aircraft of its world that comes nearer is told and logged; 0: none"""
    traffic: Literal["off", "adsb", "utm"] = "off"
    """each second it tells the other aircraft of its world: as ADSB_VEHICLE or
    UTM_GLOBAL_POSITION"""
    parameters: dict[str, float] = Field(default_factory=dict)
    """autopilot parameters that differ from their defaults"""
    parameter_file: Path | None = None
    """parameters to start with, it may be empty; a ground station saves there too"""

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
