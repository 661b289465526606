"""The layout that fits our topics, as Foxglove's SDK describes layouts.

It goes into every log as an attachment, beside the same in the older form (`classic_layout`);
`aerofed log export FILE --to attachments` takes both out.
"""

import math
from collections.abc import Sequence
from typing import Literal

from foxglove import layouts as fl

from mission.base.area import Area
from mission.base.palette import FLOWN, PLANNED, community_colour
from mission.log.topics import BODY_FRAME, FRAME, SENSORS

ATTACHMENT = "foxglove-layout.json"

_MAP_PX = 300  # what the map panel has to spare on an ordinary screen
_WORLD_PX = 256  # of a web map at zoom 0
_EQUATOR_M = 40_075_017.0


def layout(area: Area, communities: Sequence[str]) -> bytes:
    """The layout as JSON: scene, map, log; modes, learning, links, flight, estimator, battery.

    Without communities, as in a flight of a plan file, it has no learning and no links.
    """
    below = _split("row", (1, _map(area)), (1, _log()))
    seen = _split("column", (3, _scene(area)), (2, below))
    served = ((5, _learning(communities)), (5, _per())) if communities else ()
    numbers = _split(
        "column", (3, _modes()), *served, (5, _height()), (5, _estimator()), (5, _battery())
    )
    text: str = fl.Layout(content=_split("row", (3, seen), (2, numbers))).to_json()
    return text.encode()


def _split(
    direction: Literal["row", "column"], *items: tuple[float, fl.Content]
) -> fl.SplitContainer:
    """Contents beside each other, by their shares."""
    return fl.SplitContainer(
        direction=direction,
        items=[fl.SplitItem(proportion=share, content=content) for share, content in items],
    )


def _scene(area: Area) -> fl.ThreeDeePanel:
    width, height = area.size_m
    shown = ("/scene/ground", "/scene/devices", "/scene/links")
    topics: dict[str, fl.BaseRendererTopicSettings] = {
        topic: fl.BaseRendererSceneUpdateTopicSettings(visible=True) for topic in shown
    }
    topics["/plan/path"] = _path(PLANNED, 3.0)
    topics["/flown/path"] = _path(FLOWN, 4.0)
    topics["/true/pose"] = fl.BaseRendererPoseTopicSettings(
        visible=True, type="axis", axis_scale=30.0
    )
    topics["/est/pose"] = fl.BaseRendererPoseTopicSettings(
        visible=True, type="arrow", arrow_scale=(15.0, 1.5, 1.5), color="#D55E0099"
    )
    return fl.ThreeDeePanel(
        title="Scene",
        config=fl.ThreeDeeConfig(
            follow_tf=FRAME,
            follow_mode="follow-none",
            fixed_frame=FRAME,
            topics=topics,
            # The pose shows the aircraft; frames would draw a line to it from the area's corner.
            transforms={
                f"frame:{frame}": fl.BaseRendererLayerSettingsTransform(visible=False)
                for frame in (FRAME, BODY_FRAME)
            },
            scene=fl.BaseRendererSceneSettings(background_color="#F7F8FA"),
            camera_state=fl.ThreeDeeCameraState(
                perspective=True,
                distance=1.3 * max(width, height),
                phi=45.0,
                theta_offset=0.0,
                target_offset=(width / 2, height / 2, 0.0),
                far=20 * max(width, height),
            ),
        ),
    )


def _path(colour: str, width_m: float) -> fl.BaseRendererPosesTopicSettings:
    return fl.BaseRendererPosesTopicSettings(
        visible=True, type="line", line_width=width_m, gradient=(colour, colour)
    )


def _map(area: Area) -> fl.MapPanel:
    """The map, which viewers put about the take-off point; so far out that the area fits."""
    reach_m = max(
        max(home, size - home) for home, size in zip(area.home_m, area.size_m, strict=True)
    )
    parallel_m = _EQUATOR_M * math.cos(math.radians(area.home.lat_deg))
    zoom = math.log2(parallel_m / _WORLD_PX * _MAP_PX / (2 * reach_m))
    return fl.MapPanel(
        title="Map",
        config=fl.MapConfig(
            zoom_level=min(max(math.floor(zoom), 0), 19),
            topic_colors={"/true/location": FLOWN, "/gnss": "#D55E00", "/plan/map": PLANNED},
        ),
    )


def _modes() -> fl.StateTransitionsPanel:
    series = [fl.StateTransitionsSeries(value="/mode.mode", label="mode")]
    return fl.StateTransitionsPanel(
        title="Flight mode", config=fl.StateTransitionsConfig(paths=series, is_synced=True)
    )


def _learning(communities: Sequence[str]) -> fl.PlotPanel:
    series = [
        fl.PlotSeries(
            value=f'/learning{{community=="{name}"}}.accuracy',
            label=name,
            color=community_colour(index),
            show_line=True,
            line_size=2.0,
        )
        for index, name in enumerate(communities)
    ]
    return _plot("Validation accuracy", series, low=0.0, high=1.0)


def _per() -> fl.PlotPanel:
    series = [
        fl.PlotSeries(value=f"/uplinks.{kind}_per", label=label, color=colour, show_line=False)
        for kind, label, colour in (
            ("plan", "planned", PLANNED),
            ("est", "believed", "#D55E00"),
            ("true", "true", FLOWN),
        )
    ]
    return _plot("Packet error rate of each transmission", series, low=0.0, high=1.0)


def _height() -> fl.PlotPanel:
    series = [
        fl.PlotSeries(value="/true/pose.pose.position.z", label="true height (m)", color=FLOWN),
        fl.PlotSeries(value="/est/pose.pose.position.z", label="believed", color="#D55E00"),
        fl.PlotSeries(value="/true/velocity.x", label="eastward (m/s)", color="#0072B2"),
        fl.PlotSeries(value="/true/velocity.y", label="northward (m/s)", color="#56B4E9"),
    ]
    return _plot("Height and velocity", series)


def _estimator() -> fl.PlotPanel:
    series = [
        fl.PlotSeries(
            value=f"/innovations.{sensor.replace(' ', '_')}.ratio",
            label=sensor,
            color=community_colour(index),
        )
        for index, sensor in enumerate(SENSORS)
    ]
    return _plot("Innovations, divided by the largest that is accepted", series, low=0.0)


def _battery() -> fl.PlotPanel:
    series = [fl.PlotSeries(value="/battery.remaining", label="remaining", color="#009E73")]
    return _plot("Battery", series, low=0.0, high=1.0)


def _plot(
    title: str,
    series: list[fl.PlotSeries],
    *,
    low: float | None = None,
    high: float | None = None,
) -> fl.PlotPanel:
    return fl.PlotPanel(
        title=title,
        config=fl.PlotConfig(
            paths=series,
            show_legend=True,
            legend_display="left",  # beside what it would hide
            sidebar_dimension=130.0,
            is_synced=True,
            x_axis_val="timestamp",
            min_y_value=low,
            max_y_value=high,
        ),
    )


def _log() -> fl.LogPanel:
    return fl.LogPanel(title="Log", config=fl.LogConfig(topic_to_render="/log"))
