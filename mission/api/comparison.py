"""The table of `aerofed.compare`: a pandas DataFrame with a check of limits."""

from typing import TYPE_CHECKING, ClassVar

import pandas as pd

if TYPE_CHECKING:
    from mission.analysis.compare import RunComparison
    from mission.analysis.limits import Verdict


class Comparison(pd.DataFrame):  # type: ignore[misc]  # pandas has no types here
    """A DataFrame with `check`; what is computed from it is a plain DataFrame.

    `flights` are the comparisons that it was made of.
    """

    _metadata: ClassVar[list[str]] = ["flights"]
    flights: "tuple[RunComparison, ...]"

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

        return kept(self.flights, known_limits(limits, "check"))
