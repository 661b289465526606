"""A call of MAVSDK whose caller is cancelled ends first, however it ends."""

import asyncio
from typing import Any

import pytest

from mission.flight.pilot import mavsdk_calls
from mission.flight.pilot.mavsdk_calls import settled


@pytest.mark.parametrize("end", ["answers", "fails", "is cancelled", "hangs"])
def test_a_cancelled_caller_waits_for_the_call(end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavsdk_calls, "SETTLE_TIMEOUT_S", 0.02 if end == "hangs" else 60.0)
    seen, reported = list[str](), list[dict[str, Any]]()

    async def call() -> None:
        seen.append("begun")
        begun.set()
        await go_on.wait()
        seen.append("ended")
        if end == "fails":
            raise OSError("gone")
        if end == "is cancelled":
            raise asyncio.CancelledError

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, what: reported.append(what))
        caller = asyncio.create_task(settled(call()))
        await begun.wait()
        caller.cancel()
        await asyncio.sleep(0)
        assert not caller.done()
        if end != "hangs":
            go_on.set()
        with pytest.raises(asyncio.CancelledError):
            await caller
        assert seen == (["begun"] if end == "hangs" else ["begun", "ended"])

    begun, go_on = asyncio.Event(), asyncio.Event()
    asyncio.run(main())
    assert not reported
