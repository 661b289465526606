"""Work beside the block of an asynchronous context manager, which it ends when it fails."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any


@asynccontextmanager
async def following(work: Coroutine[Any, Any, None], *, name: str) -> AsyncIterator[None]:
    """Do `work` beside the block. An error in it cancels the block, so that nobody in there waits
    any longer, and is raised in place of that; of errors that came as a group, the first.
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
