"""Tables as pandas DataFrames: the one home of pandas."""

from collections.abc import Mapping, Sequence

import pandas as pd

from mission.base.tables import columns
from mission.log.records import OfSeveral, is_by_community


def frame(
    record: type | None, values: Mapping[str, object] | Sequence[Mapping[str, object]]
) -> pd.DataFrame:
    """Make a DataFrame of columns by name, or of rows.

    An empty table has the columns of `record` all the same, but those by community.
    """
    frame = pd.DataFrame(values)
    if len(frame.columns) or record is None:
        return frame
    told = [c for c in columns(record) if c.find(OfSeveral) is None]
    known = {c.name: c.holds for c in told if not is_by_community(c)}
    return pd.DataFrame({name: pd.Series([], dtype=kind) for name, kind in known.items()})
