"""The vehicle of `aerofed.vehicle`: what tests do with it."""

from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from mission.api.comparing import compare
from mission.api.configuring import as_path
from mission.flight.serve.hosted import HostedVehicle

if TYPE_CHECKING:
    from mission.api.comparison import Comparison


class SimulatedVehicle(HostedVehicle):
    """A hosted vehicle, with tables and verdicts."""

    def truth(self) -> pd.DataFrame:
        """Where it was: `t_s`, `x_m`, `y_m`, `height_m`; ten rows a simulated second."""
        return pd.DataFrame(self.track, columns=["t_s", "x_m", "y_m", "height_m"], dtype=float)

    def fly(self, plan: Path | str) -> None:
        """As `HostedVehicle.fly`, of a file by any kind of path."""
        super().fly(as_path(plan, "plan"))

    def compare(self, plan: Path | str | None = None) -> "Comparison":
        """The last flight that has landed beside `plan`, else beside the missions it was given.

        vehicle.compare("survey.plan").check(cross_track_max_m=2)

        Raises:
            InputError: no flight is logged, or it cannot be compared.
        """
        return compare(self.log, plan=None if plan is None else as_path(plan, "plan"))
