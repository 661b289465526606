"""Work that follows a block: its errors end the block, and nothing else does."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from patience import HANG_S

from sitl.block import following

Work = Callable[[], Coroutine[Any, Any, None]]


async def for_ever() -> None:
    await asyncio.Event().wait()


async def fails() -> None:
    await asyncio.sleep(0)
    raise ValueError("the work")


async def fails_in_a_group() -> None:
    async with asyncio.TaskGroup() as outer:
        outer.create_task(_group())
        outer.create_task(for_ever())


async def _group() -> None:
    async with asyncio.TaskGroup() as inner:
        inner.create_task(fails())


async def fails_at_its_end() -> None:
    try:
        await for_ever()
    finally:
        raise ValueError("the work")


async def done() -> None:
    """Nothing."""


async def inside(work: Work, body: Work) -> None:
    async with asyncio.timeout(HANG_S), following(work(), name="work"):
        await asyncio.sleep(0)
        await body()


async def cancelling_after(work: Work, body: Work) -> int:
    """How many cancellations are left over once the error has come out."""
    task = asyncio.current_task()
    assert task is not None
    with pytest.raises(ValueError, match="the work"):
        await inside(work, body)
    return task.cancelling()


@pytest.mark.parametrize("work", [fails, fails_in_a_group])
def test_an_error_ends_the_block_that_would_wait_for_ever(work: Work) -> None:
    assert asyncio.run(cancelling_after(work, for_ever)) == 0


def test_what_fails_as_it_is_ended_does_not_cancel_what_comes_after_the_block() -> None:
    assert asyncio.run(cancelling_after(fails_at_its_end, done)) == 0


def test_an_error_of_the_block_is_its_own() -> None:
    assert asyncio.run(cancelling_after(for_ever, fails)) == 0


def test_a_block_that_is_cancelled_from_outside_stays_cancelled() -> None:
    async def run() -> None:
        task = asyncio.create_task(inside(for_ever, for_ever))
        for _ in range(5):
            await asyncio.sleep(0)
        task.cancel()
        await task

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(run())
