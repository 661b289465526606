"""The checkpoint from which a killed run is resumed, written atomically.

A flight is a function of plan, configuration and seed, so it need not be stored: a resumed run
flies the finished rounds again, by the stored plans, in a fraction of the time, and the log, the
tables and the aircraft are the same to the last bit. The checkpoint holds the plans and what was
learnt, which would take long to compute again.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fl.errors import CheckpointError
from fl.federation.community import Federation
from fl.federation.rounds import RoundLearning
from fl.federation.state import FederationState, from_bytes, to_bytes
from mission.base.arrays import Bools, Floats
from mission.base.errors import InputError
from mission.base.run_folder import write_atomically
from mission.base.user_files import DATA_BYTES, read_bytes
from mission.config.models import RunConfig
from mission.config.preflight import code_digests
from mission.planner.plan import PlannedPath, RoundPlan
from mission.run.resume import ROUNDS, damaged, header, sealed
from mission.scenario.strategies import Sortie


@dataclass(frozen=True)
class RoundMemory:
    """What a checkpoint keeps of a finished round: flying it again tells the rest."""

    importance: Floats  # (K,)
    sortie: Sortie | None  # None: ideal
    learnt: RoundLearning
    true_objective: float  # flying again must give this very number
    rests: tuple[RoundPlan, ...] = ()  # that were planned at its stops, in order


class CheckpointFolder:
    """The checkpoint of one run: `rounds.json`, and the learning's state that it names."""

    def __init__(
        self, path: Path, *, config: RunConfig, data_dir: Path | None, **options: bool
    ) -> None:
        self.path = path
        plugins = code_digests(config, told=False)
        self._header = header(config.to_toml(), data_dir, plugins, **options)
        self._rounds: list[dict[str, Any]] = []

    def save(
        self, federation: Federation, state: FederationState, memory: RoundMemory | None
    ) -> None:
        """Write the checkpoint with one more round (None: none yet) and the learning after it.

        A reader finds the old checkpoint or the new one, whatever happens meanwhile.
        """
        if memory is not None:
            self._rounds.append(_plain(memory))
        self.path.mkdir(exist_ok=True)
        name = f"learning-{len(self._rounds):05}.bin"
        data = to_bytes(federation, state)
        write_atomically(self.path / name, data)
        values = {
            **self._header,
            "learning": name,
            "learning_sha256": hashlib.sha256(data).hexdigest(),
            "rounds": self._rounds,
        }
        write_atomically(self.path / ROUNDS, sealed(values))
        for old in self.path.glob("learning-*.bin"):
            if old.name != name:
                old.unlink()

    def load(
        self, federation: Federation, values: dict[str, Any]
    ) -> tuple[tuple[RoundMemory, ...], FederationState]:
        """The finished rounds and the state of learning after them, to go on from.

        `values` are what `read_checkpoint` has found.

        Raises:
            InputError: damaged, or of other data.
        """
        try:
            path = self.path / str(values["learning"])
            data = read_bytes(path, most=DATA_BYTES)
            if hashlib.sha256(data).hexdigest() != values["learning_sha256"]:
                raise damaged(path, "its checksum differs, so it was changed or cut short")
            state = from_bytes(federation, data)
            self._rounds = list(values["rounds"])
            rounds = tuple(_memory(item, len(federation.p)) for item in self._rounds)
        except CheckpointError as error:
            raise InputError(f"{path}: {error}") from None
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise damaged(self.path / ROUNDS, "not what aerofed run writes") from error
        return rounds, state


def _plain(memory: RoundMemory) -> dict[str, object]:
    return {
        "importance": memory.importance.tolist(),
        "sortie": None if memory.sortie is None else _plain_sortie(memory.sortie),
        "rests": [_plain_sortie(Sortie(rest)) for rest in memory.rests],
        "learnt": {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in vars(memory.learnt).items()
        },
        "true_objective": memory.true_objective,
    }


def _plain_sortie(sortie: Sortie) -> dict[str, object]:
    plan = sortie.plan
    return {
        "paths": [_plain_path(*own) for own in zip(plan.paths, plan.schedule, strict=True)],
        "value": float(plan.value),
        "upper_bound": float(plan.upper_bound),
        "nodes": int(plan.nodes),
        "hold_s": sortie.hold_s,
        "cost_m": sortie.cost_m,
        **({"mended": plan.mended} if plan.mended else {}),
    }


def _plain_path(path: PlannedPath, schedule: Bools) -> dict[str, object]:
    return {
        "waypoints_m": path.waypoints_m.tolist(),
        "via_m": [corners.tolist() for corners in path.via_m],
        "schedule": np.argwhere(schedule).tolist(),
        **({} if path.altitude_m is None else {"altitude_m": path.altitude_m}),
        **({"wait_s": path.wait_s} if path.wait_s else {}),
    }


def _memory(values: dict[str, Any], devices: int) -> RoundMemory:
    plan = values["sortie"]
    return RoundMemory(
        np.array(values["importance"], dtype=np.float64),
        None if plan is None else _sortie(plan, devices),
        _learnt(values["learnt"]),
        values["true_objective"],
        tuple(_sortie(rest, devices).plan for rest in values.get("rests", ())),
    )


def _sortie(plan: dict[str, Any], devices: int) -> Sortie:
    each = plan.get("paths", [plan])  # earlier versions kept one alone
    paths = tuple(
        PlannedPath(
            np.array(path["waypoints_m"], dtype=np.float64).reshape(-1, 2),
            tuple(np.array(c, dtype=np.float64).reshape(-1, 2) for c in path["via_m"]),
            path.get("altitude_m"),
            wait_s=path.get("wait_s", 0.0),
        )
        for path in each
    )
    schedule = np.zeros((len(paths), len(paths[0].waypoints_m), devices), dtype=bool)
    for of_path, path in zip(schedule, each, strict=True):
        for step, device in path["schedule"]:
            of_path[step, device] = True
    made = RoundPlan(
        paths, schedule, plan["value"], plan["upper_bound"], plan["nodes"],
        mended=plan.get("mended", ""),
    )  # fmt: skip
    return Sortie(made, hold_s=plan["hold_s"], cost_m=plan["cost_m"])


def _learnt(values: dict[str, Any]) -> RoundLearning:
    known: dict[str, Any] = {
        name: np.array(value, dtype=np.float64) if isinstance(value, list) else value
        for name, value in values.items()
    }
    return RoundLearning(**known)
