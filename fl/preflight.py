"""What a configuration asks of learning, looked up before anything is loaded."""

from collections.abc import Iterator

from fl.config import BUILT_IN_NETWORKS, TASKS, CommunityConfig
from fl.data.load import CLASSES
from fl.data.partition import check_owners
from fl.errors import SettingError
from fl.plugins import needs_torch


def problems_of(community: CommunityConfig) -> Iterator[SettingError]:
    """Settings of a community that cannot be used, by their keys within it."""
    if community.partition == "labels" and community.task in TASKS[:-1]:
        try:
            check_owners(
                community.devices,
                CLASSES,
                per_device=community.labels_per_device,
                coverage=community.coverage,
            )
        except SettingError as error:
            yield error
    if community.network not in BUILT_IN_NETWORKS and (reason := needs_torch()):
        yield SettingError("network", community.network, reason)
