"""Options of a run that is small enough for a test, and still loses and learns something."""

SETTINGS = (
    *("--set", "mission.steps=5", "--set", "mission.path_budget_m=300"),
    *("--set", "communities.0.devices=3", "--set", "communities.1.devices=3"),
    *("--set", "learning.local_epochs=1"),
)
QUIET = ("--quiet", "--no-report")
SMALL = (*SETTINGS, *QUIET)


def last_counts(*words: str) -> list[str]:
    """The words of a command, where of a key that is set twice the last value is left."""
    left: dict[str, tuple[str, ...]] = {}
    rest = iter(words)
    for index, word in enumerate(rest):
        if word == "--set":
            setting = next(rest)
            left[setting.partition("=")[0]] = word, setting
        else:
            left[f"{index}"] = (word,)
    return [word for each in left.values() for word in each]
