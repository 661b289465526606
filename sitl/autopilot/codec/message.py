"""A message of whatever kind; pymavlink comes without types."""

from typing import Any, TypeAlias

MavlinkMessage: TypeAlias = Any  # the fields of its kind are attributes
Fields: TypeAlias = dict[str, Any]  # the same by MAVLink's names
