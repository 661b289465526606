"""A run's configuration: its keys, where they are read from, what is refused at once."""

STRATEGIES = ("cov", "no_cov", "barycenter", "rectangular", "ideal")
PLANNED = ("cov", "no_cov")  # of them, those whose rounds a planner plans
