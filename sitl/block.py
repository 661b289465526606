"""The block of an asynchronous context manager, ended by what fails behind its back."""

import asyncio


class Block:
    """Made by the task that enters the block."""

    def __init__(self) -> None:
        self._task = asyncio.current_task()
        self._ended = False

    def end(self) -> None:
        """Have nobody in it wait any longer; nothing where it was left already."""
        if self._task is not None and not self._ended:
            self._ended = True
            self._task.cancel()

    def leave(self) -> None:
        """It is over: an `end` was not meant for what comes after it."""
        task, self._task = self._task, None
        if self._ended and task is not None:
            task.uncancel()
