"""A message as pymavlink has it, which comes without types."""

from typing import Any, TypeAlias

MavlinkMessage: TypeAlias = Any  # the fields of its kind are attributes
