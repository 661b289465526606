"""The `aerofed` command: parses, calls a command, and turns errors into lines and exit codes."""

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from io import TextIOWrapper
from typing import Any, Literal

from cyclopts import App, CycloptsError, Parameter, Token, convert
from cyclopts.help import DefaultFormatter, HelpPanel
from rich.console import Console, ConsoleOptions
from rich.text import Text

from mission.base.console import PLAIN, Terminal
from mission.base.errors import EXIT_CODES, INTERRUPTED, AerofedError, InputError
from mission.base.interrupts import hear_interruptions, prepare_exit
from mission.commands import usage
from native.errors import printable


def _version() -> str:
    # Imported here: it takes a sixth of `aerofed --help`.
    from importlib.metadata import version

    return version("aerofed")


def _read(kind: Any, tokens: Sequence[Token]) -> Any:
    """Convert an option's value; refuse a fraction for an int, which cyclopts would round."""
    if kind is int and "." in tokens[0].value:
        raise ValueError
    return convert(kind, tokens)


def _default(value: object) -> str | None:
    """Return a default as the help shows it; None where it is empty, False or 0."""
    if isinstance(value, tuple):
        value = ", ".join(map(str, value))
    return str(value) if value else None


class _Help(DefaultFormatter):
    """Help whose descriptions are wrapped to the terminal only, not where the code's lines end."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        for entry in panel.entries:
            text = getattr(entry.description, "primary_renderable", None)
            if isinstance(text, Text):
                text.plain = text.plain.replace("\n", " ")
        super().__call__(console, options, panel)


_MOST = 20_000  # characters of an error, which may tell of many keys
_PARAMETER = Parameter(converter=_read, show_default=_default)
_CODES = "\n".join(f"  {code:>3}  {what}" for code, what in EXIT_CODES.items())

app = App(
    name="aerofed",
    version=_version,
    console=Terminal(),
    help="Drone missions that collect federated-learning updates from ground devices.",
    help_epilogue=f"Exit codes:\n{_CODES}",
    help_format="plaintext",
    help_formatter=_Help(),
    default_parameter=_PARAMETER,
    result_action="return_value",
    # Ctrl-C is ours to report.
    suppress_keyboard_interrupt=False,
)
_log = App(
    name="log", help="Look into flight logs, mend and export them.", default_parameter=_PARAMETER
)
_data = App(
    name="data",
    help="Fetch the data sets from where they are published, and check a folder.",
    default_parameter=_PARAMETER,
)
_firmware = App(
    name="firmware",
    help="Fetch an autopilot's firmware from where its project publishes it, list what is here.",
    default_parameter=_PARAMETER,
)
# By their paths, so that a command is imported when it is called.
for _app, _names in (
    (app, "init run compare report plan link_budget radio_map sitl world fly sweep"),
    (_log, "info check recover export diff"),
    (_data, "fetch check"),
    (_firmware, "fetch list_"),
):
    for _name in _names.split():
        _module = _name if _app is app else _app.name[0]
        _app.command(f"mission.commands.{_module}:{_name}", name=_name.strip("_").replace("_", "-"))
app.command(_log)
app.command(_data)
app.command(_firmware)


@app.command
def completion(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print what makes a shell complete commands and options on Tab.

    Example: aerofed completion bash > ~/.local/share/bash-completion/completions/aerofed

    Args:
        shell: bash, zsh or fish.
    """
    Terminal(**PLAIN).print(app.generate_completion(shell=shell), end="")
    return 0


def main(tokens: Sequence[str] | None = None) -> None:
    """Run the command, and exit with its code."""
    hear_interruptions()
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # as in containers that know ASCII only
    code = call(tokens)
    prepare_exit(code)
    sys.exit(code)


def call(tokens: Sequence[str] | None = None) -> int:
    """Run the command that `tokens` (default: `sys.argv`) name; return its exit code."""
    # Without emoji, whose table would be loaded for the first line: there may be no memory for it.
    errors = Console(stderr=True, emoji=False, **PLAIN)
    Terminal.failure, Terminal.stream = None, sys.stdout
    try:
        given = sys.argv[1:] if tokens is None else tokens
        if not given or given[-1] in ("--help", "-h", *_log.name, *_data.name, *_firmware.name):
            for listing in (app, _log, _data, _firmware):
                for name in listing:  # what is not imported has nothing to say there
                    listing[name]
        # What code of users' own prints is none of our output, which may be JSON.
        with redirect_stdout(sys.stderr):
            result = app(usage.spread(given), exit_on_error=False, print_error=False)
    except CycloptsError as error:
        errors.print(f"aerofed: {usage.in_words(error)}")
        return InputError.exit_code
    except AerofedError as error:
        for line in printable(error, most=_MOST).splitlines():
            errors.print(f"aerofed: {line}")
        return error.exit_code
    except MemoryError:
        errors.print("aerofed: out of memory")
        return AerofedError.exit_code
    except ModuleNotFoundError as error:  # as in the image of the vehicle alone
        errors.print(f"aerofed: {error.name} is not installed here; pip install aerofed brings it")
        return InputError.exit_code
    except KeyboardInterrupt:
        errors.print("aerofed: interrupted")
        return INTERRUPTED
    finally:
        Terminal.stream = None
    if Terminal.failure is not None:
        errors.print(f"aerofed: cannot write to standard output: {Terminal.failure}")
        return InputError.exit_code
    return result if isinstance(result, int) else 0
