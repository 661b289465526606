"""The radio of a run: the true one, which decides whose update arrives, and the believed one."""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from fl.config import RADIOS
from fl.plugins import PlugIn
from fl.radio.channel import Channel
from fl.radio.city import City
from fl.radio.learned import Heard, Learned, Listener
from fl.radio.per_grid import PerGrid
from fl.radio.place import (
    AverageRadio,
    CustomRadio,
    LinkTerms,
    PlacedRadio,
    Radio,
    RadioMap,
    SettledRadio,
    drawn_waves,
)
from flightdyn.random import RandomStreams
from mission.base.area import Area
from mission.base.arrays import Floats
from mission.config.area import HEIGHT_MARGIN_M
from mission.config.models import RunConfig
from mission.scenario.radio_maps import home_of, read_map
from native.errors import SettingError

_SAME_PLACE_M = 1.0
_LEAST_CELL_M, _MOST_CELLS = 5.0, 320  # of what is believed, along the longer side


@dataclass(frozen=True)
class CustomBelief(PlugIn):
    """A researcher's own belief, whose rates are checked."""

    setting = "radio.belief"
    members = ("success",)
    devices: int = 0  # K

    def success(self, heard: Heard, place_m: Floats) -> Floats:
        """(K, n) probabilities 1 - PER at places (n, 3), given pilot tones: `Belief.success`."""
        of, shape = f" after {len(heard.device)} tones", (self.devices, len(place_m))
        chances = self.ask("success", heard, place_m, of=of)
        return self.array(chances, f"what success(){of} gives", shape=shape, low=0, high=1)


def radio_of(
    config: RunConfig, channel: Channel, area: Area, devices_m: Floats, streams: RandomStreams
) -> Radio:
    """Return the true radio of devices at places (K, 2), which decides whose update arrives.

    Raises:
        InputError: a device stands where it must not, or the map is not of this run.
        UsersCodeError: a radio of the user's own cannot be made.
    """
    truth = config.radio.truth
    if truth == "channel":
        average, correlation_m = AverageRadio(channel, devices_m), config.channel.correlation_m
        if correlation_m is None:
            return average
        fields = drawn_waves(streams.generator("shadowing"), len(devices_m))
        return SettledRadio(average, fields, correlation_m)
    if truth not in RADIOS:
        return CustomRadio.made(truth, channel, devices_m)
    gains = (
        city_of(config, area, devices_m, streams)
        if truth == "buildings"
        else _map_of(config, devices_m)
    )
    return PlacedRadio(gains, _terms(config))


def believed(
    config: RunConfig, channel: Channel, truth: Radio, area: Area, devices_m: Floats
) -> tuple[PerGrid | None, Listener | None]:
    """Return the grid of packet error rates that plans believe at first, and what updates it.

    No grid: the channel's average. No listener: nothing is learned.

    Raises:
        InputError: as `radio_of`.
        UsersCodeError: a belief of the user's own raised something, or gave what cannot be used.
    """
    radio, belief, count = truth, config.radio.belief, len(devices_m)
    if belief == "channel":
        return None, None
    before = (config.radio.prior or "channel") if config.radio.listens else belief
    if before == "channel":
        radio = AverageRadio(channel, devices_m)
    elif before == "map" and config.radio.truth != "map":  # which is the same file
        radio = PlacedRadio(_map_of(config, devices_m), _terms(config))
    elif before == "buildings":  # as they stand, but nobody knows their shadowing before
        city = city_of(config, area, devices_m, None)
        unknown_db = city.unknown_db if config.radio.shadowing else None
        radio = PlacedRadio(city, _terms(config), unknown_db)
    prior = radio_grid(radio, channel, area, count)
    if not config.radio.listens:
        return prior, None
    assert isinstance(truth, PlacedRadio)
    learns = (
        Learned(prior, truth.terms, before)
        if belief == "learned"
        else replace(CustomBelief.made(belief, prior, truth.terms, devices_m), devices=count)
    )
    listener = Listener(learns, truth, prior, channel.altitude_m)
    return listener.grid(Heard()), listener


def radio_grid(radio: Radio, channel: Channel, area: Area, devices: int) -> PerGrid:
    """Sample a radio's packet error rates on a grid over an area, at the channel's altitude."""
    cell_m, height_m = max(_LEAST_CELL_M, max(area.size_m) / _MOST_CELLS), channel.altitude_m
    return PerGrid.of(radio, devices, size_m=area.size_m, height_m=height_m, cell_m=cell_m)


def _terms(config: RunConfig) -> LinkTerms:
    return LinkTerms(*(getattr(config.radio, item.name) for item in fields(LinkTerms)))


def city_of(
    config: RunConfig, area: Area, devices_m: Floats, streams: RandomStreams | None
) -> City:
    """Return the path gains from devices (K, 2) among the area's buildings, without shadowing
    where `streams` is None.

    Raises:
        InputError: a device stands within a building, and must not.
    """
    radio = config.radio
    city = City(
        area.buildings,
        devices_m,
        device_height_m=radio.device_height_m,
        carrier_hz=radio.carrier_hz,
        environment=radio.environment,
        walls=radio.walls,
        rng=streams.generator("shadowing") if streams and radio.shadowing else None,
    )
    if radio.indoors == "refused" and city.indoors.any():
        device = int(np.argmax(city.indoors))
        x, y = devices_m[device].tolist()
        reason = (
            f"device {device} at x = {x:.1f}, y = {y:.1f} m stands within a building; move it, or "
            "let it pay for the way through the wall: 'entry-loss'"
        )
        raise SettingError("radio.indoors", radio.indoors, reason)
    return city


def _map_of(config: RunConfig, devices_m: Floats) -> RadioMap:
    """Read the map that the configuration names, and refuse one that does not fit the run."""
    name = config.radio.map_file
    assert name is not None
    made = read_map(name)
    if (why := _misfit(made, config, devices_m)) is not None:
        raise SettingError("radio.map_file", str(name), why)
    return made


def _misfit(made: RadioMap, config: RunConfig, devices_m: Floats) -> str | None:
    """Why a map cannot be used in a run; None where it can."""
    if made.devices_m.shape != devices_m.shape:
        return f"is of {len(made.devices_m)} devices; the run has {len(devices_m)}"
    away = np.hypot(*(made.devices_m - devices_m).T)
    device = int(away.argmax())
    if away[device] > _SAME_PLACE_M:
        return f"has device {device} {away[device]:.0f} m from where it stands in the run"
    home, metres = home_of(config), 111_195.0  # of a degree
    scale = {"home_lat_deg": metres}
    scale["home_lon_deg"] = metres * math.cos(math.radians(config.area.home_lat_deg))
    for axis, value in made.home.items():
        if not abs(value - home[axis]) * scale.get(axis, 1.0) <= _SAME_PLACE_M:
            return f"is of another home: {axis} = {value:.7g}; the run has {home[axis]:.7g}"
    axes = (("x", made.x_m, config.area.size_m[0]), ("y", made.y_m, config.area.size_m[1]))
    for name, line, size in axes:
        cell = float(line[1] - line[0]) if len(line) > 1 else 0.0
        if line[0] > cell or line[-1] < size - cell:
            return f"covers {name} from {line[0]:g} to {line[-1]:g} m; the area has 0 to {size:g}"
    low, high = made.height_m[0] - HEIGHT_MARGIN_M, made.height_m[-1] + HEIGHT_MARGIN_M
    flown = config.heights_m
    if not low <= flown[0] <= flown[1] <= high:
        heights = ", ".join(f"{height:g}" for height in made.height_m)
        return (
            f"is of {heights} m above home; mission.altitude_m is not within {HEIGHT_MARGIN_M:g} m "
            "of that"
        )
    return None
