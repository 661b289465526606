"""One round of learning as a run records it."""

from fl.errors import DivergedError
from fl.federation import rounds as learning
from mission.base.arrays import Bools
from mission.base.errors import TrainingError
from mission.base.user_code import plugins_of_learning


def learn(
    federation: learning.Federation,
    state: learning.FederationState,
    *,
    scheduled: Bools,
    delivered: Bools,
    workers: int,
) -> tuple[learning.FederationState, learning.RoundLearning]:
    """Train those whose update is delivered; `scheduled` and `delivered` are (K,).

    Raises:
        TrainingError: the training diverged; names round, community and device.
        UsersCodeError, InputError: a plug-in failed, or answered what cannot be used.
    """
    try:
        with plugins_of_learning():
            return learning.play_round(
                federation, state, scheduled=scheduled, delivered=delivered, workers=workers
            )
    except DivergedError as error:
        raise TrainingError(f"learning diverged: {error}") from None
