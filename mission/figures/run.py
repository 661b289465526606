"""The picture files of a run, and of several runs side by side."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from mission.analysis.compare import RunComparison, compare_run
from mission.analysis.comparison_text import labels_of
from mission.analysis.load import LoadedRun, load_run, vehicles_of
from mission.analysis.numbers import Comparison
from mission.analysis.several import load_several
from mission.analysis.together import SEPARATIONS, Together
from mission.base.palette import community_colour
from mission.base.tables import count
from mission.figures.charts import Series, line_chart
from mission.figures.flight import profiles
from mission.figures.learning import experiment_charts, learning_charts
from mission.figures.maps import overview, round_map, round_maps
from mission.figures.radio import beliefs
from mission.figures.render import engine, save_all, stacked
from mission.figures.style import Chart, arranged, heading, unchecked
from mission.figures.together import separation_chart, timetable, together_map
from mission.figures.told import side_by_side_charts

_KINDS: tuple[tuple[str, str, Callable[[Comparison], float]], ...] = (
    ("Cross-track error on straights, rms", "distance (m)", lambda c: c.straight_rms_m),
    ("Slots later than planned, mean", "delay (s)", lambda c: c.slot_late_mean_s),
    ("True objective", "importance times success", lambda c: c.true_objective),
    ("Updates arrived", "updates", lambda c: float(c.delivered)),
)


def draw_run(folder: Path) -> tuple[Path, ...]:
    """Draw a run's pictures into `folder/figures`: `map.png`, `rounds.png`, `learning.png`, and
    `belief.png` where the log has maps of believed and of true PER.

    Of a plan file's flight they are `map.png` and `profile.png`. A picture for which there are no
    data (nothing flown, no round finished) is left out. Returns the files that were written.

    Raises:
        InputError: the folder is not a run, or the pictures cannot be written.
    """
    with engine() as started:  # it does so while the pictures are described
        several = vehicles_of(folder)
        pictures = fleet_pictures(folder) if several else run_pictures(load_run(folder))
        return save_all(pictures, folder / "figures", started)


@unchecked
def fleet_pictures(folder: Path) -> dict[str, Chart]:
    """The pictures of a run of several aircraft: `map.png`, `apart.png`, `timetable.png` and
    `learning.png`."""
    found = load_several((folder,))
    pictures: dict[str, Chart] = {}
    if (world := found.world) is not None:
        apart_m = world.flights[0].run.data.config.get("mission", {}).get("separation_m")
        limits = {} if apart_m is None else {next(iter(SEPARATIONS)): apart_m}
        pictures["map.png"] = together_map(world)
        if world.pairs:
            pictures["apart.png"] = separation_chart(world, limits)
        pictures["timetable.png"] = timetable(world)
    if charts := experiment_charts([item.run for item in found.flights]):
        about = replace(found.flights[0].run, path=folder).about
        pictures["learning.png"] = stacked(charts, title="What was learnt", about=about)
    return pictures


@unchecked
def run_pictures(loaded: LoadedRun) -> dict[str, Chart]:
    """The pictures of a run, by the name of their file."""
    run, about = loaded.data, loaded.about
    pictures: dict[str, Chart] = {}
    if run.planned is not None:
        if loaded.judged is not None:
            pictures["map.png"] = round_map(run, run.plans, about=about)
            pictures["profile.png"] = profiles([compare_run(loaded)])
        return pictures
    if run.plans and len(run.truth.t_ns):
        pictures["map.png"] = overview(run, about)
        pictures["rounds.png"] = round_maps(run, about)
        if panels := beliefs(run):
            title = heading("What was believed of a device's radio, and what was true", about)
            rows = arranged(panels, how="concat", columns=3, spacing=24, title=title)
            pictures["belief.png"] = rows
    if run.rounds:
        charts = learning_charts(run)
        pictures["learning.png"] = stacked(charts, title="What was learnt", about=about)
    return pictures


def comparison_figure(
    runs: Sequence[RunComparison],
    world: Together | None = None,
    limits: Mapping[str, float] | None = None,
) -> Chart:
    """Runs against each other, round by round: tracking, timing, objective and arrivals.

    Flights of plan files, which have no rounds, stand against each other along their plans; those
    of one world are on one map, with their distances over time.
    """
    if world is not None:
        charts = [together_map(world)]
        charts += [separation_chart(world, limits or {})] if world.pairs else []
        return stacked(charts, title="Flown together", about=count(len(runs), "flight"))
    if all(run.run.judged is not None for run in runs):
        return profiles(runs)
    if all(run.run.data.planned is not None for run in runs):
        about = runs[0].run.about if len(runs) == 1 else f"{len(runs)} flights"
        charts = side_by_side_charts(runs)
        return stacked(charts, title="Against what it was told", about=about, together=2)
    labels = labels_of(runs)
    charts = [
        line_chart(
            title,
            [
                Series(
                    labels[index],
                    community_colour(index),
                    [item.round or 0 for item in run.rounds],
                    [value(item) for item in run.rounds],
                )
                for index, run in enumerate(runs)
            ],
            x="round",
            y=unit,
            whole_x=True,
            height=150.0,
        )
        for title, unit, value in _KINDS
    ]
    return stacked(charts, title="Run against run", about="round by round", one_key=True)
