"""Base class of the tables of a configuration."""

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """Base class of configuration tables, which are frozen and refuse unknown keys."""

    # Deferred: a model within another is built with that one, once.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
