"""Background work for an `async with` block, which ends when the work fails."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any


@asynccontextmanager
async def following(work: Coroutine[Any, Any, None], *, name: str) -> AsyncIterator[None]:
    """Async context manager: run `work` in the background of the block, cancel it at the end. An
    error in it cancels the block and is raised instead; of an exception group, its first error.
    """
    try:
        async with asyncio.TaskGroup() as group:
            task = group.create_task(work, name=name)
            try:
                yield
            finally:
                task.cancel()
                await asyncio.wait((task,))  # in here, or Python 3.11 counts a cancellation more
    except BaseExceptionGroup as errors:
        error: BaseException = errors
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        raise error from error.__cause__
