"""One round and one uplink as they stand in `rounds.csv` and `uplinks.csv`.

Field order is column order. Metres, seconds; positions are area coordinates: x east, y north.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class UplinkRecord:
    """One scheduled device of one round: where it was served and what became of its update."""

    round: int  # from 1
    device: int  # index over all communities
    community: str
    step: int  # 0-based time step n of the plan
    slot_t_s: float  # simulated time of the transmission; NaN where the slot was never reached
    plan_x_m: float
    plan_y_m: float
    est_x_m: float
    est_y_m: float
    est_alt_m: float
    true_x_m: float
    true_y_m: float
    true_alt_m: float
    plan_per: float
    est_per: float
    true_per: float  # 1 where the slot was never reached
    importance: float
    delivered: bool


@dataclass(frozen=True, slots=True)
class RoundRecord:
    """One round: what was planned, what was flown and what was learnt."""

    round: int  # from 1
    start_t_s: float
    duration_s: float
    plan_objective: float
    est_objective: float
    true_objective: float
    upper_bound: float  # NaN where the planner gives none
    plan_path_m: float
    flown_path_m: float
    budget_used_m: float  # metres of L_total spent so far, L_max a round at most
    scheduled: int
    delivered: int
    battery_remaining: float
    accuracy: dict[str, float]  # per community, after the round; one column each
    cov: dict[str, float]  # psi per community, in force for the next round


@dataclass(frozen=True, slots=True)
class Learnt:
    """What one round taught, per community."""

    accuracy: dict[str, float]
    cov: dict[str, float]  # psi, in force for the next round
    loss: dict[str, float]  # mean over the trained devices; NaN where none was trained
    device_accuracy: list[float]  # (K,) of the new models, on each device's validation set
    received_accuracy: list[float]  # (K,) the last eps_k that the UAV received; NaN: none yet
    device_loss: list[float]  # (K,) mean local loss; NaN where not trained


@dataclass(frozen=True, slots=True)
class DeviceRecord:
    """One device after one round, as it stands in `learning.csv`."""

    round: int  # 0: the untrained models
    device: int  # index over all communities
    community: str
    accuracy: float  # of its community's new model, on its validation set
    received_accuracy: float  # eps_k as the UAV last received it; NaN where it never did
    loss: float  # mean local training loss; NaN where its update did not arrive
