"""The table of `aerofed.compare`: a pandas DataFrame with a check of limits."""

from collections.abc import Collection
from typing import TYPE_CHECKING, ClassVar

import pandas as pd

from mission.analysis.compare import names_of
from mission.analysis.told import ERRORS
from mission.analysis.whole import HEALTH
from mission.api.runs import frame

if TYPE_CHECKING:
    from mission.analysis.compare import RunComparison
    from mission.analysis.limits import Verdict
    from mission.analysis.several import Several


class Comparison(pd.DataFrame):  # type: ignore[misc]  # pandas has no types here
    """A DataFrame with `check`, `table`, `pairs`, `errors` and `health`; what is computed from it
    is a plain DataFrame.
    """

    _metadata: ClassVar[list[str]] = ["several"]
    several: "Several"

    @property
    def flights(self) -> "tuple[RunComparison, ...]":
        """The comparisons that it was made of."""
        return self.several.flights

    @property
    def table(self) -> pd.DataFrame:
        """A row for each stretch of each flight: mode, reference, errors, delay and health."""
        named = zip(names_of(self.flights), self.flights, strict=True)
        return frame(None, [{"run": name, **row} for name, of in named for row in of.stretches])

    @property
    def pairs(self) -> pd.DataFrame:
        """A row for each two flights that are judged together: least distances, planned and flown,
        when and where. Distances are NaN where positions are missing."""
        return frame(None, self.several.world.rows if self.several.world else [])

    @property
    def errors(self) -> pd.DataFrame:
        """The errors against what each vehicle was told over the log's time: a column an error,
        NaN where it was not told at that instant."""
        return self._over_time(ERRORS)

    @property
    def health(self) -> pd.DataFrame:
        """Vibration, estimator, GNSS, battery and motors over the log's time, likewise."""
        return self._over_time(HEALTH)

    def _over_time(self, names: Collection[str]) -> pd.DataFrame:
        found = {}
        for run, flight in zip(names_of(self.flights), self.flights, strict=True):
            series = flight.flown.series if flight.flown else {}
            columns = [
                pd.Series(of.values, index=pd.Index(of.t_s, name="t_s"), name=name)
                for name, of in series.items()
                if name in names
            ]
            found[run] = pd.concat(columns, axis=1).sort_index() if columns else pd.DataFrame()
        return pd.concat(found, names=["run"])

    def check(self, **limits: float) -> "tuple[Verdict, ...]":
        """Check limits, as `aerofed compare --limit` does: check(cross_track_max_m=3).

        Returns:
            each limit of each flight, with value, limit, and `met`.

        Raises:
            LimitsNotMetError: one is not met; its message has a line for each, with where and
                when, and its `verdicts` are all of them.
            InputError: the comparison has no such number.
        """
        from mission.analysis.limits import kept, known_limits

        return kept(self.several, known_limits(limits, "check"))
