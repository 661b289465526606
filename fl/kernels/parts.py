"""Parts of kernels: optimised and made into machine code once, with the kernel that calls them.

Numba does both for every function by itself, together with all that it calls, so that what lies
under twelve levels of calls is compiled twelve times. Here only the kernel's own turn counts.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba has no type information
    """Code that waits, as it was written, to be linked into what calls it.

    Overrides the steps that `CPUCodeLibrary.finalize` goes through; were they renamed, parts
    would be compiled like any function.
    """

    @property
    def codegen(self) -> "_PartLibrary":
        """Numba only asks for it to set the environment of a function that Python can call."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """There is none in machine code that is never made."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalized = True


class PartCompiler(Compiler):  # type: ignore[misc]
    """`pipeline_class` of functions that only compiled code calls."""

    def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
        assert library is None
        super().__init__(typing, target, _PartLibrary(target.codegen(), "part"), *rest)
