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
    task = asyncio.create_task(work, name=name)
    block = _Block()
    task.add_done_callback(block.end)
    try:
        yield
    finally:
        block.leave()
        task.cancel()
        (error,) = await asyncio.gather(task, return_exceptions=True)
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if isinstance(error, BaseException) and not isinstance(error, asyncio.CancelledError):
            raise error


class _Block:
    """Cancels the task that entered the block when the work beside it fails."""

    def __init__(self) -> None:
        self._inside = asyncio.current_task()
        self._ended = False

    def end(self, work: asyncio.Task[None]) -> None:
        """Cancel the block where the work has failed."""
        if self._inside is not None and not work.cancelled() and work.exception() is not None:
            self._ended = True
            self._inside.cancel()

    def leave(self) -> None:
        """The block is over: undo an `end` that came too late for it."""
        inside, self._inside = self._inside, None
        if self._ended and inside is not None:
            inside.uncancel()
