"""What every table of a configuration is."""

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A table of the configuration: no key beside those that it has, and no change later."""

    # Deferred: a model within another is built with that one, once.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
