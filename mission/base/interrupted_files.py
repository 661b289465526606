"""The log and tables of a run that is resumed, kept until the new ones have caught up with them.

A resumed run flies its finished rounds again and writes its files from the beginning. Until it
has finished a round of its own, the old files hold more than the new ones, so they are put into
`checkpoint/interrupted` meanwhile, and stay there however often the run is killed on the way.
"""

import shutil

from mission.base.run_folder import RunFolder
from mission.base.user_files import or_input_error

_GONE = ".interrupted-gone"


class InterruptedFiles:
    """The files of one run that its resumption will write anew."""

    def __init__(self, folder: RunFolder) -> None:
        self._files = (folder.log, folder.rounds, folder.uplinks, folder.learning)
        self.path = folder.checkpoint / "interrupted"
        self._gone = folder.checkpoint / _GONE

    def set_aside(self) -> None:
        """Move the files away. Those of an earlier, longer flight that are kept already stay.

        Killed in between, what was not moved yet is moved the next time: nothing is written
        before all of them are away.

        Raises:
            InputError: they cannot be moved.
        """
        with or_input_error(self.path, "cannot keep the old files"):
            shutil.rmtree(self._gone, ignore_errors=True)
            self.path.mkdir(parents=True, exist_ok=True)
            for file in self._files:
                kept = self.path / file.name
                if file.exists() and not kept.exists():
                    file.replace(kept)

    def discard(self) -> None:
        """Remove the old files, all at once; for when the new ones hold as much. Twice is fine."""
        if self.path.exists():
            # Removed one by one under their name, a kill would leave some of them.
            self.path.replace(self._gone)
            shutil.rmtree(self._gone, ignore_errors=True)
