"""`python -m mission` is the `aerofed` command."""

from mission.cli import main

main()
