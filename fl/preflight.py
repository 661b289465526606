"""What a configuration asks of learning, looked up before anything is loaded."""

from collections.abc import Callable, Iterator

from fl.config import BUILT_IN_NETWORKS, TASKS, CommunityConfig
from fl.data.load import CLASSES
from fl.data.partition import check_owners
from fl.errors import SettingError


def problems_of(
    community: CommunityConfig, *, is_users: Callable[[str], bool]
) -> Iterator[SettingError]:
    """Settings of a community that cannot be used, by their keys within it.

    A network of which `is_users` says that it is the researcher's own is not looked up.
    """
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
    if not is_users(community.network) and community.network not in BUILT_IN_NETWORKS:
        choices = ", ".join(map(repr, BUILT_IN_NETWORKS))
        yield SettingError(
            "network",
            community.network,
            f"must be one of {choices}, or your own as 'package.module:callable'",
        )
