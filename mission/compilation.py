"""Kernels that a command is about to call, compiled before it begins, in the sight of the user."""

import sys
from collections.abc import Callable

PLANNING = ("mission.planner.kernels.search", "mission.planner.kernels.exploration")
LEARNING = ("fl.convnet",)


def compile_kernels(*modules: str, say: Callable[[str], None]) -> None:
    """Compile what of the modules has been imported, unless it is on disk."""
    imported = [name for name in modules if name in sys.modules]
    if not imported:
        return
    from fl.kernels.ahead import compile_ahead

    compile_ahead(
        imported, lambda: say("compiling the inner loops, once after an installation: some 10 s")
    )
