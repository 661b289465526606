"""The command line without the pictures of runs, for processes that tests start."""

import sys
import types
from typing import Any

if __name__ == "__main__":
    # In the place of the module, which would load all that draws.
    stand_in: Any = types.ModuleType("mission.figures.run")
    stand_in.draw_run = lambda _: ()
    sys.modules[stand_in.__name__] = stand_in

    from mission.__main__ import main

    main()
