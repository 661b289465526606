"""Aerofed's packages, imported from beside this one whatever else has their names.

A script's own folder comes first on the path, and with it a `mission.py` or `fl.py` of the user's.
"""

import importlib
import sys
from pathlib import Path

_HOME = str(Path(__file__).resolve().parents[1])
sys.path.insert(0, _HOME)
try:
    for _name in ("native", "flightdyn", "fl", "sitl", "mission"):
        _found = getattr(importlib.import_module(_name), "__file__", None)
        if _found != str(Path(_HOME, _name, "__init__.py")):
            raise ImportError(f"aerofed: another module is called {_name!r}: {_found}; rename it")
finally:
    sys.path.remove(_HOME)
