"""The layout that fits our topics, as Foxglove's SDK describes layouts.

It goes into every log as an attachment; `aerofed log export FILE --to attachments` takes it out.
What does not depend on the run stands in `foxglove-layout.json`.
"""

import json
import math
from collections.abc import Sequence
from importlib.resources import files
from string import Template

from mission.base.area import Area
from mission.base.palette import FLOWN, PLANNED, community_colour

ATTACHMENT = "foxglove-layout.json"

_MAP_PX = 300  # what the map panel has to spare on an ordinary screen
_WORLD_PX = 256  # of a web map at zoom 0
_EQUATOR_M = 40_075_017.0


def layout(area: Area, communities: Sequence[str]) -> bytes:
    """The layout as JSON: scene, map, log; modes, learning, links, flight, estimator, battery.

    Without communities, as in a flight of a plan file, it has no learning and no links.
    """
    text = Template(files(__package__).joinpath(ATTACHMENT).read_text(encoding="utf-8"))
    document = json.loads(text.safe_substitute(planned=PLANNED, flown=FLOWN))
    seen, numbers = (item["content"]["items"] for item in document["content"]["items"])
    width, height = area.size_m
    seen[0]["content"]["config"]["cameraState"] |= {
        "distance": 1.3 * max(width, height),
        "targetOffset": [width / 2, height / 2, 0.0],
        "far": 20 * max(width, height),
    }
    seen[1]["content"]["items"][0]["content"]["config"]["zoomLevel"] = _zoom(area)
    learning = numbers[1]["content"]["config"]
    learning["paths"] = [
        _of_community(learning["paths"][0], name, community_colour(index))
        for index, name in enumerate(communities)
    ]
    if not communities:
        del numbers[1:3]
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()


def _of_community(series: dict[str, str], name: str, colour: str) -> dict[str, str]:
    value = series["value"].replace("$name", name)
    return series | {"color": colour, "label": name, "value": value}


def _zoom(area: Area) -> int:
    """Zoom level of the map at which the area fits about the take-off point, its centre."""
    reach_m = max(
        max(home, size - home) for home, size in zip(area.home_m, area.size_m, strict=True)
    )
    parallel_m = _EQUATOR_M * math.cos(math.radians(area.home.lat_deg))
    zoom = math.log2(parallel_m / _WORLD_PX * _MAP_PX / (2 * reach_m))
    return min(max(math.floor(zoom), 0), 19)
