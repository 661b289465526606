"""A console whose failure to write never ends the program that it reports on."""

import errno
import os
import sys
from typing import IO, Any, ClassVar

from rich.console import Console

TABLE_WIDTH = 80  # characters: what tables are made for
# Lines as they are: neither wrapped, coloured, nor read as markup.
PLAIN: dict[str, Any] = {"soft_wrap": True, "highlight": False, "markup": False}


class Terminal(Console):
    """A console that falls silent, instead of raising, when it can no longer be written.

    A closed pipe means that somebody has read enough; any other failure is kept in `failure` for
    the command line to report at its end.
    """

    failure: ClassVar[str | None] = None
    # Where it writes; None: to sys.stdout. In a command that is left to what others print there.
    stream: ClassVar[IO[str] | None] = None

    @classmethod
    def for_tables(cls, **options: Any) -> "Terminal":
        """Make a console `TABLE_WIDTH` wide at least: narrow terminals break lines, not numbers."""
        console = cls(**options)
        return console if console.width >= TABLE_WIDTH else cls(width=TABLE_WIDTH, **options)

    @property  # type: ignore[misc]  # nobody sets it
    def file(self) -> IO[str]:
        """The stream that it writes to."""
        return self.stream or sys.stdout

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; nothing once the reader is gone."""
        try:
            super().print(*objects, **options)
        except OSError as error:
            self._fall_silent(error)

    def on_broken_pipe(self) -> None:
        """Go on silently; rich itself would exit."""
        self._fall_silent(BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)))

    def _fall_silent(self, error: OSError) -> None:
        self.quiet = True
        # What is still buffered must not fail again when the interpreter ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())
        if error.errno != errno.EPIPE:
            Terminal.failure = error.strerror
