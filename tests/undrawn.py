"""The command line without the pictures of runs, for processes that tests start."""

import sys
import types
from typing import Any


def stand_in() -> None:
    """In the place of the module, which would load all that draws."""
    module: Any = types.ModuleType("mission.figures.run")
    module.draw_run = lambda _: ()
    sys.modules[module.__name__] = module


if __name__ == "__main__":
    stand_in()

    from mission.__main__ import main

    main()
