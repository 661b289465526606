"""Loads what `aerofed run`, `fly` and `sitl` load, and makes what their first call makes."""

from pathlib import Path

import mission.commands.fly
import mission.commands.run
import mission.commands.sitl
import mission.flight.flyers.built_in
import mission.flight.serve.vehicle
import mission.run.flown_experiment
import mission.run.plan_flight
import mission.run.session  # noqa: F401
from mission.config.loading import load_config

load_config(Path("quickstart"))
