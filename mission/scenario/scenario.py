"""What planning needs of a run: devices, their data, the radio, budgets and the strategy.

Nothing of the vehicle is imported: with its filter it takes longer than planning does.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from fl.errors import FETCHED
from fl.federation import rounds as learning
from fl.federation.community import Community, Federation, build_federation
from fl.federation.device_work import DeviceWork
from fl.plugin_code import is_plugin
from fl.radio.channel import Channel, LinkBudget, link_budget
from fl.radio.learned import Listener
from fl.radio.per_grid import PerGrid
from fl.radio.place import Radio
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.arrays import Floats, Ints
from mission.base.errors import InputError
from mission.base.tables import count, csv_lines
from mission.config import STRATEGIES
from mission.config.models import RunConfig
from mission.config.polygons import check_start
from mission.planner.factory import make_planner
from mission.planner.performance import Performance
from mission.planner.problem import RoundProblem, Start
from mission.scenario.limits import (
    UNLIMITED,
    Aircraft,
    Amount,
    Budget,
    aircraft_of,
    budget_of_all,
    by,
    round_limits,
    separation,
    unflyable,
)
from mission.scenario.radio_maps import with_traced_map
from mission.scenario.radios import believed, radio_of
from mission.scenario.strategies import (
    CustomStrategy,
    ImportanceStrategy,
    RoundInfo,
    Strategy,
    StrategyContext,
    make_strategy,
)
from native.errors import SettingError

_HEARD_S = 0.1  # of hover at a stop until the aircraft knows whether it has heard a device
_LONGEST_UPLOAD_S = 3600.0  # no aircraft hovers as long


@dataclass(frozen=True)
class Scenario:
    """Area, devices, communities, aircraft and strategy of one run."""

    config: RunConfig
    streams: RandomStreams
    fleet: tuple[Aircraft, ...]
    devices_m: Floats  # (K, 2) area coordinates
    channel: Channel  # that rounds are planned with, at the mission's lowest altitude
    radio: Radio  # that decides whose update arrives
    per_grid: PerGrid | None  # that the first round is planned with; None: the channel
    listener: Listener | None  # what learns of the radio on the way
    federation: Federation
    budget: Budget  # of the run, for each aircraft
    strategy: Strategy | None  # None: ideal, nothing is flown

    @property
    def aircraft(self) -> tuple[str, ...]:
        """(A,) the name of each aircraft."""
        return tuple(one.name for one in self.fleet)

    @property
    def area(self) -> Area:
        """The area, with the home of the first aircraft."""
        return self.fleet[0].area

    @property
    def community_of(self) -> tuple[str, ...]:
        """(K,) the name of each device's community."""
        return tuple(self.federation.names[c] for c in self.federation.community_of)

    @property
    def device_times(self) -> bool:
        """Whether devices take time to train, or to send."""
        return self.upload_s is not None or any(
            value is not None
            for c in self.config.communities
            for value in (c.compute_s, c.compute_times_s, c.compute_s_per_sample)
        )

    @property
    def upload_s(self) -> Floats | None:
        """(K,) upload time of each device in seconds; None: uploads take no time."""
        rate_bps = self.config.channel.upload_rate_bps
        if rate_bps is None:
            return None
        return self.federation.upload_bits / (rate_bps * (1.0 - _tones_s(self.config)))

    @property
    def _turn_s(self) -> Floats | None:
        """(K,) seconds that the aircraft hovers for each device: its upload, and where rounds are
        replanned at stops at least until it has been heard; None: no hover."""
        if self.config.mission.replan == "round":
            return self.upload_s
        none = np.zeros(len(self.devices_m))
        return np.maximum(none if self.upload_s is None else self.upload_s, _HEARD_S)

    def first_problem(self) -> RoundProblem:
        """The planning problem of the first round, from where the strategy begins."""
        return self.problem(
            self._first_importance(),
            [(self._first_start_m(one), one.performance) for one in self.fleet],
            left=self.budget.total,
            work=self.work_before().round_begins(1, 0),
            t_ns=0,
            leaving=True,
        )

    def problem(
        self,
        importance: Floats,
        begins: Sequence[tuple[Floats, Performance] | None],
        *,
        left: Amount,
        work: DeviceWork,
        t_ns: int,
        leaving: bool,
    ) -> RoundProblem:
        """The planning problem of a round that begins at `t_ns`: of each aircraft (None: it is
        lost) `begins` has the place (2,), and how it flies.

        `left` is what remains of the run's budgets, `work` the devices' work as the round begins;
        `leaving`, where they begin at their homes.
        """
        ready_in_s = np.maximum(work.ready_ns - t_ns, 0) / 1e9
        several = sum(begin is not None for begin in begins) > 1
        apart = separation(self.config.mission, leaving=leaving) if several else {}
        timed = bool(ready_in_s.any())
        starts = []
        for one, begin in zip(self.fleet, begins, strict=True):
            if begin is None:
                continue
            (start_m, performance), mission = begin, one.config.mission
            height_m, chosen = mission.heights_m[0], mission.altitudes_m
            starts.append(
                Start(
                    start_m=start_m,
                    path_budget_m=min(mission.path_budget_m, left.metres),
                    limits=round_limits(
                        mission, performance, left=left, timed=timed or bool(apart)
                    ),
                    altitudes_m=chosen,
                    altitude_m=None if chosen or height_m == self.channel.altitude_m else height_m,
                    name=one.name,
                )
            )
        mission = self.config.mission
        return RoundProblem(
            devices_m=self.devices_m,
            importance=importance,
            starts=tuple(starts),
            steps=mission.steps,
            per_step=mission.devices_per_step,
            channel=self.channel,
            airspace=self.area.airspace,
            upload_s=self._turn_s,
            ready_in_s=ready_in_s if timed else None,
            per_grid=self.per_grid,
            **apart,
        )

    def importance(
        self,
        number: int,
        delta: Floats,
        *,
        cov: Floats,
        accuracy: Floats,
        last_heard: Ints,
        work: DeviceWork,
        t_ns: int,
    ) -> Floats:
        """(K,) importance in round `number`, which begins at `t_ns`: `delta`, the paper's, or what
        the strategy makes of it.

        `cov` (C,) of the communities, `work` of the devices as the round before left it; the rest
        (K,) as in `RoundInfo`.
        """
        if not isinstance(self.strategy, ImportanceStrategy):
            return delta
        of, work = self.federation.community_of, work.round_begins(number, t_ns)
        return self.strategy.importance(
            RoundInfo(
                round=number,
                delta=delta,
                p=self.federation.p,
                cov=cov[of],
                community_of=of,
                last_heard=last_heard.copy(),
                accuracy=accuracy.copy(),
                ready_in_s=np.maximum(work.ready_ns - t_ns, 0) / 1e9,
                staleness=number - work.begun,
            )
        )

    def work_before(self) -> DeviceWork:
        """The devices' work before the first round: everybody is idle."""
        late = self.federation.learning.late
        return DeviceWork.before(self.federation.compute_s, goes_on=late == "stale")

    def _first_importance(self) -> Floats:
        # Without the models of a `FederationState`: some networks take seconds to import.
        devices = len(self.devices_m)
        return self.importance(
            1,
            learning.first_importance(self.federation),
            cov=np.full(len(self.federation.names), learning.INITIAL_COV),
            accuracy=np.full(devices, np.nan),
            last_heard=np.zeros(devices, dtype=np.int64),
            work=self.work_before(),
            t_ns=0,
        )

    def _first_start_m(self, one: Aircraft) -> Floats:
        approach_m = None if self.strategy is None else self.strategy.approach_m
        if approach_m is None:
            return np.array(one.area.home_m, dtype=np.float64)
        points_m: Floats = self.area.airspace.moved(np.array([approach_m], dtype=np.float64))
        return np.asarray(points_m[0])

    def devices_csv(self) -> str:
        """Where every device stands and what it owns: `labels` lists class:samples, `share` is
        empty where none is configured. `communities.N.positions_file` takes it.

        Where devices take time, two columns more: `compute_s` and `upload_s`.
        """
        counts = [row for community in self.federation.communities for row in community.counts]
        shared = [
            share for c in self.config.communities for share in c.data_shares or (None,) * c.devices
        ]
        table: dict[str, Iterable[object]] = {
            "device": range(len(shared)),
            "community": self.community_of,
            "x_m": self.devices_m[:, 0],
            "y_m": self.devices_m[:, 1],
            "samples": [row.sum() for row in counts],
            "p": self.federation.p,
            "labels": [" ".join(f"{k}:{row[k]}" for k in np.flatnonzero(row)) for row in counts],
            "share": shared,
        }
        if self.device_times:
            table["compute_s"] = self.federation.compute_s
            table["upload_s"] = np.zeros(len(shared)) if self.upload_s is None else self.upload_s
        return csv_lines([table, *zip(*table.values(), strict=True)])

    def notices(self) -> list[str]:
        """What a user should know before the first round, a line each."""
        lines = []
        budget = min(self._overhead, key=lambda at: at.per)
        if budget.per > 0.5:
            lines.append(f"the channel hardly reaches anybody; {budget}")
        apart = separation(self.config.mission, leaving=True) if len(self.fleet) > 1 else {}
        if apart.get("late_s"):
            lines.append(
                f"mission.separation_m = {self.config.mission.separation_m:g}: as flying adds "
                f"errors, rounds are planned with {apart['separation_m']:g} m, and for one "
                f"aircraft up to {apart['late_s']:g} s later than another"
            )
        for index, community in enumerate(self.federation.communities):
            source = community.dataset.provenance
            if not source.official and community.config.task in FETCHED:
                lines.append(
                    f"{community.name}: data in {source.source} are intact, but not the official "
                    "files (a subset?); used as they are"
                )
            owned, asked = community.counts.sum(axis=0), community.dataset.held_out
            orphans = np.flatnonzero((owned == 0) & (asked > 0)).tolist()
            if orphans:
                classes = "class" if len(orphans) == 1 else "classes"
                lines.append(
                    f"{community.name}: no device owns {classes} {', '.join(map(str, orphans))}, "
                    f"so accuracy cannot reach 1{_owners_for_all(index, community)}"
                )
        return lines

    @property
    def _overhead(self) -> list[LinkBudget]:
        """Link budgets straight overhead, at the lowest and the highest altitude."""
        heights = self.config.heights_m
        return [link_budget(replace(self.channel, altitude_m=height)) for height in heights]

    def data_sources(self) -> dict[str, dict[str, object]]:
        """Per community: where its data come from, and whether they are the official files."""
        return {c.name: asdict(c.dataset.provenance) for c in self.federation.communities}


def _owners_for_all(index: int, community: Community) -> str:
    """Name the settings that give every class an owner; empty where none can."""
    config, classes = community.config, community.dataset.classes
    if config.partition != "labels" or config.coverage:  # nobody has a sample of it
        return ""
    way = f"communities.{index}.coverage = true gives all an owner"
    if config.devices * config.labels_per_device < classes:
        way = (
            f"{count(config.devices, 'device')} with {count(config.labels_per_device, 'label')} "
            f"each cannot own {classes} classes: with more devices or labels_per_device, {way}"
        )
    return f" ({way})"


def device_places(config: RunConfig, area: Area, streams: RandomStreams) -> Floats:
    """(K, 2) device positions, area coordinates in metres: as configured, else drawn at random."""
    total, first = sum(community.devices for community in config.communities), 0
    devices_m = streams.generator("devices").uniform((0.0, 0.0), area.size_m, (total, 2))
    for index, community in enumerate(config.communities):
        if community.positions_file is not None:
            raise InputError(
                f"communities.{index}.positions_file = {community.positions_file!r}: not read yet; "
                "load_config, or with_world, reads it"
            )
        if community.positions_m is not None:
            devices_m[first : first + community.devices] = community.positions_m
        first += community.devices
    devices_m.flags.writeable = False
    return devices_m


def _tones_s(config: RunConfig) -> float:
    """How long pilot tones take in each second: of all, or of as many as a round may serve."""
    mission, heard = config.mission, sum(community.devices for community in config.communities)
    if config.radio.pilots == "scheduled":
        heard = min(heard, mission.steps * mission.devices_per_step)
    return heard * (config.radio.pilot_s or 0.0)


def _check_sent(config: RunConfig) -> None:
    """Refuse sizes and tones that are given without an upload rate, or leave nothing of it."""
    tones = "radio.pilot_s", config.radio.pilot_s
    if (tones_s := _tones_s(config)) >= 1.0:
        raise SettingError(
            *tones,
            f"tones take {tones_s:g} s of each second, and leave nothing for uploads; have shorter "
            "ones, or hear fewer: radio.pilots = 'scheduled'",
        )
    sizes = (
        (f"communities.{i}.upload_bits", c.upload_bits) for i, c in enumerate(config.communities)
    )
    for key, value in (tones, *sizes):
        if value is not None and config.channel.upload_rate_bps is None:
            reason = "needs channel.upload_rate_bps, the rate of uploads; give both or none"
            raise SettingError(key, value, reason)


def _check_quick(config: RunConfig, bits: Floats) -> None:
    """Refuse an upload rate at which an update takes longer than an hour."""
    rate_bps, least_bps = config.channel.upload_rate_bps, bits.max() / _LONGEST_UPLOAD_S
    left = 1.0 - _tones_s(config)
    if rate_bps is not None and rate_bps * left < least_bps:
        raise SettingError(
            "channel.upload_rate_bps",
            rate_bps,
            f"the largest update, {bits.max():.0f} bits, takes {bits.max() / rate_bps / left:.0f} "
            f"s to send; {_LONGEST_UPLOAD_S:g} s at most are allowed, so at least "
            f"{math.ceil(least_bps / left)} bits a second",
        )


def build_scenario(config: RunConfig, *, data_dir: Path | None) -> Scenario:
    """Place the devices, read and partition the data, set up radio, budget and strategy.

    Raises:
        InputError: data is missing or damaged, or a setting contradicts another.
    """
    with config.blame.named():
        return _built(config, data_dir)


def _built(config: RunConfig, data_dir: Path | None) -> Scenario:
    streams = RandomStreams(config.seed)
    check_start(config)
    aircraft = aircraft_of(config)
    for one in aircraft:
        for wrong in unflyable(one.config, one.performance):
            raise SettingError(*wrong)
    _check_sent(config)
    budget = budget_of_all(aircraft)
    area = aircraft[0].area
    devices_m = device_places(config, area, streams)
    config = with_traced_map(config, devices_m)
    channel = config.channel.channel(altitude_m=config.heights_m[0])
    radio = radio_of(config, channel, area, devices_m, streams)
    per_grid, listener = believed(config, channel, radio, area, devices_m)
    federation = build_federation(
        config.communities, config.learning, data_dir=data_dir, stream=streams.generator
    )
    _check_quick(config, federation.upload_bits)
    mission, planner = config.mission, make_planner(config.planner)
    limits = round_limits(mission, aircraft[0].performance, left=UNLIMITED)
    strategy = (
        CustomStrategy.made(
            mission.strategy, StrategyContext(mission, planner, devices_m, area, config.seed)
        )
        if mission.strategy not in STRATEGIES and is_plugin(mission.strategy)
        else make_strategy(mission, planner, devices_m=devices_m, area=area, limits=limits)
    )
    if len(aircraft) > 1 and strategy is not None and strategy.approach_m is not None:
        reason = "approach_m must be None with several aircraft: each begins above its home"
        raise SettingError("mission.strategy", mission.strategy, reason)
    return Scenario(
        config, streams, by(config, aircraft), devices_m, channel, radio, per_grid, listener,
        federation, budget, strategy,
    )  # fmt: skip
