"""What can be chosen about the vehicle as MAVLink sees it."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from flightdyn.config import AircraftConfig


class VehicleConfig(BaseModel):
    """The aircraft, its autopilot and how closely it is watched."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    aircraft: AircraftConfig = Field(
        default_factory=AircraftConfig, description="physics, sensors, estimation and control"
    )
    sample_rate_hz: float = Field(
        default=10.0, ge=0.1, le=1000, description="samples for log and track, simulated time"
    )
    system_id: int = Field(default=1, ge=1, le=250, description="MAVLink system of the vehicle")
    parameters: dict[str, float] = Field(
        default_factory=dict, description="autopilot parameters that differ from their defaults"
    )
    parameter_file: Path | None = Field(
        default=None,
        description="parameters to start with, it may be empty; a ground station saves there too",
    )
