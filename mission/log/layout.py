"""The layout that fits our topics, as Foxglove's SDK describes layouts.

It goes into every log as an attachment, beside the same in the older form (`classic_layout`);
`aerofed log export FILE --to attachments` takes both out.
"""

from collections.abc import Sequence

from foxglove import layouts as fl

from mission.area import Area
from mission.log.topics import FRAME, SENSORS
from mission.palette import FLOWN, PLANNED, community_colour

ATTACHMENT = "foxglove-layout.json"


def layout(area: Area, communities: Sequence[str]) -> bytes:
    """The layout as JSON: scene and map; height, speed and error; learning; log."""
    scene = fl.SplitContainer(
        direction="column",
        items=[
            fl.SplitItem(proportion=3, content=_scene(area)),
            fl.SplitItem(proportion=2, content=_map()),
        ],
    )
    numbers = fl.SplitContainer(
        direction="column",
        items=[
            fl.SplitItem(proportion=2, content=_learning(communities)),
            fl.SplitItem(proportion=2, content=_per()),
            fl.SplitItem(proportion=2, content=_height()),
            fl.SplitItem(proportion=2, content=_estimator()),
            fl.SplitItem(proportion=2, content=_battery()),
            fl.SplitItem(proportion=1, content=_log()),
        ],
    )
    whole = fl.Layout(
        content=fl.SplitContainer(
            direction="row",
            items=[
                fl.SplitItem(proportion=3, content=scene),
                fl.SplitItem(proportion=2, content=numbers),
            ],
        )
    )
    text: str = whole.to_json()
    return text.encode()


def _scene(area: Area) -> fl.ThreeDeePanel:
    width, height = area.size_m
    shown = ("/scene/ground", "/scene/devices", "/scene/links")
    topics: dict[str, fl.BaseRendererTopicSettings] = {
        topic: fl.BaseRendererSceneUpdateTopicSettings(visible=True) for topic in shown
    }
    topics["/plan/path"] = _path(PLANNED, 1.5)
    topics["/flown/path"] = _path(FLOWN, 2.0)
    topics["/true/pose"] = fl.BaseRendererPoseTopicSettings(
        visible=True, type="axis", axis_scale=15.0
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
            scene=fl.BaseRendererSceneSettings(
                background_color="#F7F8FA", transforms=fl.BaseRendererTransforms(visible=False)
            ),
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


def _map() -> fl.MapPanel:
    return fl.MapPanel(
        title="Map",
        config=fl.MapConfig(
            follow_topic="/true/location",
            zoom_level=15.0,
            topic_colors={"/true/location": FLOWN, "/gnss": "#D55E00"},
        ),
    )


def _learning(communities: Sequence[str]) -> fl.PlotPanel:
    series = [
        fl.PlotSeries(
            value=f'/learning{{community=="{name}"}}.accuracy',
            label=f"accuracy {name}",
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
    return _plot("Innovations: a share of what is still believed", series, low=0.0)


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
            legend_display="floating",
            is_synced=True,
            x_axis_val="timestamp",
            min_y_value=low,
            max_y_value=high,
        ),
    )


def _log() -> fl.LogPanel:
    return fl.LogPanel(title="Log", config=fl.LogConfig(topic_to_render="/log"))
