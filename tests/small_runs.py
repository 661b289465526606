"""Options of a run that is small enough for a test, and still loses and learns something."""

SMALL = (
    *("--set", "mission.steps=5", "--set", "mission.path_budget_m=300"),
    *("--set", "communities.0.devices=3", "--set", "communities.1.devices=3"),
    *("--set", "learning.local_epochs=1", "--quiet"),
)
