"""Every fault of the configuration, at the ends of its range: the run ends, and says why."""

import json
from pathlib import Path
from typing import Any, get_args

import pytest
from test_run import SMALL

from flightdyn.faults import Fault, ImuBias
from mission.cli import call

pytestmark = pytest.mark.slow

KINDS = {model.model_fields["kind"].default: model for model in get_args(get_args(Fault)[0])}


def ends(kind: str) -> list[dict[str, Any]]:
    """The fault with every strength at the lower and at the upper end of its range."""
    if kind == ImuBias.model_fields["kind"].default:
        axes = ("gyro_radps", 10.0), ("accel_mps2", 100.0)
        return [{name: [sign * most] * 3} for name, most in axes for sign in (-1.0, 1.0)]
    found: list[dict[str, Any]] = [{}, {}]
    for name, field in KINDS[kind].model_fields.items():
        if name in ("kind", "at_s", "after", "duration_s"):
            continue
        low = next(m.ge for m in field.metadata if hasattr(m, "ge"))
        high = next(m.le for m in field.metadata if hasattr(m, "le"))
        found[0][name], found[1][name] = low, high
    return found if found[0] else [{}]


CASES = [
    pytest.param(kind, strength, at_s, id=f"{kind}-{index}-at-{at_s:g}")
    for kind in KINDS
    for index, strength in enumerate(ends(kind))
    # Before take-off the upper end is enough: what differs by the sign is the flight.
    for at_s in ((0.0, 20.0) if strength == ends(kind)[-1] else (20.0,))
]


@pytest.mark.parametrize(("kind", "strength", "at_s"), CASES)
def test_it_ends_with_a_reason(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    strength: dict[str, Any],
    at_s: float,
) -> None:
    """`motor_loss` at 20 s and a bias of 100 hung a run for ever."""
    out = tmp_path / "run"
    table = ", ".join(
        f"{key} = {json.dumps(value)}"
        for key, value in {"kind": kind, "at_s": at_s, **strength}.items()
    )
    code = call(
        ["run", "--out", str(out), "--rounds", "1", *SMALL,
         "--set", f"vehicle.aircraft.faults=[{{{table}}}]", "--set", "link.stall_timeout_s=2",
         # For what never gets anywhere in such a wind.
         "--set", "vehicle.aircraft.battery.capacity_mah=500"]
    )  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    said = capsys.readouterr().err
    if code == 0:
        assert summary["status"] == "finished"
        return
    assert code in (4, 5), said
    assert said.count("\n") == 1, said
    assert summary["status"] == "failed"
    assert summary["error"] in said
