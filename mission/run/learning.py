"""One round of learning as a run records it."""

from fl.errors import DivergedError
from fl.federation import rounds as learning
from mission.base.arrays import Bools, Ints
from mission.base.errors import TrainingError
from mission.base.user_code import plugins_of_learning


def learn(
    federation: learning.Federation,
    state: learning.FederationState,
    *,
    scheduled: Bools,
    delivered: Bools,
    begun: Ints | None = None,
    kept: Bools | None = None,
    workers: int,
) -> tuple[learning.FederationState, learning.RoundLearning]:
    """Train those whose update is delivered, or `kept`; all arrays as in `play_round`.

    Raises:
        TrainingError: the training diverged; names round, community and device.
        UsersCodeError, InputError: a plug-in failed, or answered what cannot be used.
    """
    try:
        with plugins_of_learning():
            return learning.play_round(
                federation,
                state,
                scheduled=scheduled,
                delivered=delivered,
                begun=begun,
                kept=kept,
                workers=workers,
            )
    except DivergedError as error:
        raise TrainingError(f"learning diverged: {error}") from None
