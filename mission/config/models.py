"""A run's configuration: every package describes what it is configured by; here is the whole."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

import tomli_w
from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from fl.config import (
    ChannelConfig,
    CommunityConfig,
    LearningConfig,
    PluginName,
    RadioConfig,
    one_of,
)
from fl.plugin_code import label_of
from flightdyn.tables import Table
from mission.base.errors import InputError
from mission.base.explain import Blame
from mission.config import PLANNED, STRATEGIES
from mission.config.area import AreaConfig
from mission.config.link import LinkConfig
from mission.config.vehicles import Aircraft, Heights, Vehicles, aircraft_of, misplaced, unable
from mission.planner.config import PlannerConfig
from sitl.config import VehicleConfig

# What only one aircraft can do: a key, its values, and what several need instead.
_OF_ONE: tuple[tuple[str, tuple[object, ...], str], ...] = (
    (
        "mission.strategy",
        ("barycenter", "rectangular"),
        "cov, no_cov, ideal, or one of your own (in a sweep: --strategies cov,no_cov,ideal)",
    ),
    (
        "link.kind",
        ("udp", "external"),
        "'in_process', which flies our own autopilot, and PX4 and ArduPilot (vehicle.autopilot)",
    ),
)


class MissionConfig(Table):
    """What is flown: the paper's symbols stand in the descriptions."""

    strategy: Annotated[str, one_of(STRATEGIES)] = "cov"
    """who is served where, round by round: one of cov, no_cov, barycenter, rectangular, ideal, or
    one of your own as 'package.module:factory'; with 'LABEL=' before it, tables and pictures call
    it LABEL"""
    flight: Literal["flown", "none"] = "flown"
    """'none': nothing is flown, every waypoint is met exactly at the planned speed, as in the
    paper; an hour of rounds takes seconds"""
    replan: Literal["round", "stop"] = "round"
    """stop: the aircraft hovers wherever it serves until it knows who was heard; where somebody was
    lost, the rest of the round is planned anew with the steps, metres, seconds and joules left, and
    may serve the lost once more (strategies cov and no_cov)"""
    rounds: int = Field(50, ge=1, le=100_000)
    """M, communication rounds at most"""
    altitude_m: Heights = 60.0
    """H, height above home; [lowest, highest]: each round is flown at the best height between the
    two"""
    speed_mps: float = Field(20.0, ge=1, le=22)
    """v, ground speed along the path"""
    path_budget_m: float = Field(800.0, gt=0, le=20_000)
    """L_max, metres a round"""
    total_budget_m: float = Field(40_000.0, gt=0, le=1e7)
    """L_total, metres to fly in rounds; a round costs what it flies, L_max at most; a run ends when
    the rest pays for no whole round; only the first round may be shorter"""
    round_deadline_s: float | None = Field(None, gt=0, le=3600)
    """seconds a round takes at most; none: as its metres take"""
    total_deadline_s: float | None = Field(None, gt=0, le=1e7)
    """seconds to fly in rounds; a run ends when the rest pays for no whole round"""
    round_energy_j: float | None = Field(None, gt=0, le=1e8)
    """joules a round takes of the battery at most; not of an external vehicle, whose power nobody
    knows"""
    total_energy_j: float | None = Field(None, gt=0, le=1e10)
    """joules to fly with in rounds; a run ends when the rest pays for no whole round"""
    steps: int = Field(10, ge=1, le=500)
    """N, time steps a round"""
    devices_per_step: int = Field(3, ge=1, le=1000)
    """K_bar, devices served a step"""
    acceptance_radius_m: float = Field(5.0, ge=0.5, le=50)
    """how far a corner may be cut at most; less where that would cost the round 1 %"""
    separation_m: float | None = Field(None, ge=1, le=1000)
    """several aircraft: the distance in space that each pair keeps in the air; a round in which two
    come nearer is told"""
    when_lost: Literal["go on", "end"] = "go on"
    """several aircraft: where one is lost, the others go on with its devices in the next plan, or
    the run ends"""
    battery_reserve: float = Field(0.25, ge=0, le=0.9)
    """charge (0..1) that a round must leave: where what is left does not pay for as dear a round as
    any before and this, the aircraft returns, gets a full battery and comes back to where it was,
    outside the rounds; 0: never"""
    hover_s: float = Field(5.0, ge=1, le=600)
    """barycenter: hover of a round"""
    hover_cost_m: float = Field(100.0, gt=0, le=20_000)
    """barycenter: metres of budget a round costs"""
    tour_inset: float = Field(0.2, ge=0, lt=0.5)
    """rectangular: the tour's distance from the area's edge, as a fraction of its size"""

    @property
    def heights_m(self) -> tuple[float, float]:
        """The lowest and the highest altitude; equal, where there is one."""
        if isinstance(self.altitude_m, tuple):
            return self.altitude_m
        return self.altitude_m, self.altitude_m

    @property
    def altitudes_m(self) -> tuple[float, float] | None:
        """The lowest and highest altitude (m) that rounds choose from; None: there is one only."""
        return self.altitude_m if isinstance(self.altitude_m, tuple) else None

    @field_validator("replan")
    @classmethod
    def _planned_anew(cls, replan: str, info: ValidationInfo) -> str:
        strategy = info.data.get("strategy", "cov")
        if replan == "stop" and strategy not in PLANNED:
            raise ValueError(
                f"the rest of a round is planned by mission.strategy = {' or '.join(PLANNED)}, "
                f"not by {strategy!r}, which takes 'round'"
            )
        return replan


class RunConfig(Table):
    """Everything that a run depends on, apart from the data files."""

    name: str = Field("run", pattern=r"^[A-Za-z0-9._-]{1,64}$", examples=["paper-2"])
    """names the run"""
    seed: int = Field(1, ge=0, le=2**63 - 1)
    """root of every random stream"""
    area: AreaConfig = Field(default_factory=AreaConfig)
    mission: MissionConfig = Field(default_factory=MissionConfig)
    planner: PlannerConfig = Field(default_factory=PlannerConfig)
    channel: ChannelConfig = Field(default_factory=ChannelConfig)
    radio: RadioConfig = Field(default_factory=RadioConfig)
    communities: tuple[CommunityConfig, ...] = Field(min_length=1, max_length=100)
    learning: LearningConfig = Field(default_factory=LearningConfig)
    vehicle: VehicleConfig = Field(default_factory=VehicleConfig)
    vehicles: Vehicles | None = Field(None, examples=[3])
    """several aircraft: how many, alike and with homes 5 m apart; or a table [[vehicles]] for
    each"""
    link: LinkConfig = Field(default_factory=LinkConfig)
    callbacks: tuple[PluginName, ...] | None = Field(None, examples=[["my_package.my_module:make"]])
    """your own code that is told of every finished round, each as 'package.module:factory'"""

    limits: dict[str, float] | None = Field(None, examples=[{"cross_track_max_m": 3.0}])
    """numbers of `aerofed compare`, each with what it may be at most, or of what is better the
    more, at least: a run or flight that does not meet one ends with exit code 6"""

    _blame: Blame = PrivateAttr(default_factory=lambda: Blame("configuration"))

    def read_from(self, blame: Blame) -> Self:
        """Return a copy whose later errors name `blame` as the origin of its keys."""
        known = self.model_copy()
        known._blame = blame
        return known

    @property
    def notes(self) -> Sequence[str]:
        """Notes for the user on the files that were read for it, a line each."""
        return self._blame.notes

    @property
    def blame(self) -> Blame:
        """Where its keys come from, for the errors of whoever uses it."""
        return self._blame

    def contradiction(self, keys: Sequence[str], reason: str) -> InputError:
        """Make the error for keys that do not fit each other; it is about the first of them that
        was set over its file, which works without it, or else about the first."""
        key = next((key for key in keys if self._blame.sets(key)), keys[0])
        return InputError(f"{self._blame.on(key)}: {key}: {reason}")

    @property
    def run_name(self) -> str:
        """Name of the run and, by default, of its folder: configuration, strategy and seed."""
        return f"{self.name}-{label_of(self.mission.strategy)}-seed{self.seed}"

    @property
    def aircraft(self) -> tuple[Aircraft, ...]:
        """Each aircraft of the run, one at least."""
        return aircraft_of(self.vehicles, self.vehicle, self.area.home_m)

    def of(self, one: Aircraft) -> "RunConfig":
        """The configuration as one aircraft flies by it; home is not moved, and places the area."""
        own = {"altitude_m": one.altitude_m, "path_budget_m": one.path_budget_m}
        known = {key: value for key, value in own.items() if value is not None}
        mission = self.mission.model_copy(update=known)
        return self.model_copy(update={"mission": mission, "vehicle": one.vehicle})

    @property
    def heights_m(self) -> tuple[float, float]:
        """The lowest and the highest altitude of all aircraft."""
        each = [self.of(one).mission.heights_m for one in self.aircraft]
        return min(low for low, _ in each), max(high for _, high in each)

    @model_validator(mode="after")
    def _several(self) -> Self:
        aircraft = self.aircraft
        flaws = list(misplaced(aircraft, self.area.home_m, self.area.size_m))
        if len(aircraft) > 1:
            flaws += unable(aircraft)
            for key, values, others in _OF_ONE:
                table, _, name = key.partition(".")
                if (given := getattr(getattr(self, table), name)) in values:
                    flaws += [f"{key} = {given!r} is for one aircraft; several need {others}"]
            heights_m = {self.of(one).mission.heights_m for one in aircraft}
            if self.radio.belief != "channel" and len(heights_m) > 1:
                flaws += [
                    f"radio.belief = {self.radio.belief!r} is planned with at one height: give all "
                    "vehicles one altitude_m"
                ]
            if self.link.gcs:
                flaws += ["link.gcs is for one aircraft: leave it out, or vehicles"]
        for flaw in flaws:
            raise ValueError(flaw)
        return self

    @model_validator(mode="after")
    def _unique_names(self) -> Self:
        names = [community.name for community in self.communities]
        if len(set(names)) < len(names):
            raise ValueError(f"community names must differ, got {names}")
        return self

    @model_validator(mode="after")
    def _radio_has_what_it_needs(self) -> Self:
        area, by_key = self.area, self.radio.model_dump(include={"truth", "belief", "prior"})
        for key, name in by_key.items():
            if name == "buildings" and not area.buildings and area.buildings_file is None:
                raise ValueError(
                    f"radio.{key} = 'buildings' needs area.buildings, or area.buildings_file"
                )
        mapped = self.radio.map_file is not None or self.radio.scene is not None
        if ("map" in by_key.values()) != mapped:
            raise ValueError(
                "radio.map_file or .scene, and 'map' as radio.truth, .belief or .prior, need each "
                "other"
            )
        for key in ("prior", "pilots", "pilot_s"):
            if getattr(self.radio, key) is not None and not self.radio.listens:
                raise ValueError(
                    f"radio.{key} is of a belief that listens: radio.belief = 'learned', or your "
                    f"own, not {self.radio.belief!r}"
                )
        return self

    @model_validator(mode="after")
    def _planned_on_a_grid(self) -> Self:
        belief, kind = self.radio.belief, self.planner.kind
        if belief == "channel":
            return self
        if self.radio.listens and self.radio.truth not in ("buildings", "map"):
            raise ValueError(
                f"radio.belief = {belief!r} is learned from the SNR of places: radio.truth must be "
                f"'buildings' or 'map', not {self.radio.truth!r}"
            )
        if self.mission.altitudes_m is not None:
            raise ValueError(
                f"radio.belief = {belief!r} is planned with at one height: give one "
                "mission.altitude_m, or radio.belief = 'channel'"
            )
        if kind not in ("certified", "import"):
            raise ValueError(
                f"planner.kind = {kind!r} knows distances only: radio.belief = {belief!r} needs "
                "planner.kind = 'certified', or one of your own ('import')"
            )
        return self

    @model_validator(mode="after")
    def _drawn_on_the_channel(self) -> Self:
        gate, correlation_m = self.channel.gate, self.channel.correlation_m
        drawn = f"channel.correlation_m = {correlation_m}"
        if gate == "instantaneous":
            drawn = f"channel.gate = {gate!r}"
            if correlation_m is not None:
                raise ValueError(f"{drawn} draws each packet anew: leave out channel.correlation_m")
        elif correlation_m is None:
            return self
        if self.radio.truth != "channel":
            raise ValueError(
                f"{drawn} draws packets on the channel, so it needs "
                f"radio.truth = 'channel', not {self.radio.truth!r}"
            )
        return self

    @model_validator(mode="after")
    def _one_flyer(self) -> Self:
        flown = [self.vehicle.autopilot, *(one.vehicle.autopilot for one in self.aircraft)]
        firmware = next((name for name in flown if name != "built-in"), None)
        other = None if firmware is None else f"vehicle.autopilot = {firmware!r}"
        if self.link.kind == "external":
            other = "link.kind = 'external'"
        if self.mission.flight == "none" and other is not None:
            raise ValueError(f"mission.flight = 'none' flies nothing, and so needs no {other}")
        autopilot = self.vehicle.autopilot
        if self.link.kind == "external" and autopilot != "built-in":
            raise ValueError(
                f"link.kind = 'external' (--vehicle) flies another vehicle than "
                f"vehicle.autopilot = {autopilot!r} does: leave one of them out"
            )
        return self

    def to_toml(self) -> str:
        """The resolved configuration; reading it back gives an equal model."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))
