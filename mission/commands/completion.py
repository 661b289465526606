"""`aerofed completion`."""

from typing import Literal


def completion(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print what makes a shell complete commands and options on Tab.

    Example: aerofed completion bash > ~/.local/share/bash-completion/completions/aerofed

    Parameters
    ----------
    shell
        bash, zsh or fish.
    """
    from mission.cli import app

    print(app.generate_completion(shell=shell), end="")
    return 0
