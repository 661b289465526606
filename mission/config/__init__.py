"""A run's configuration: its keys, where they are read from, what is refused at once."""

from typing import Literal

# Configurations that come along, by the names that stand for their files.
Shipped = Literal["quickstart", "paper", "paper-sweep", "apart", "town", "city", "munich"]

STRATEGIES = ("cov", "no_cov", "barycenter", "rectangular", "ideal")
PLANNED = ("cov", "no_cov")  # of them, those whose rounds a planner plans
# Keys and tables that count where no experiment is run.
OF_FLIGHT = ("vehicle", "link", "limits", "seed", "area.home_alt_msl_m")  # `aerofed fly`
OF_VEHICLE = ("area", "vehicle", "link", "seed")  # `aerofed sitl`
