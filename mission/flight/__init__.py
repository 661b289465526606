"""Flights as a run orders them: what is flown, by whom, and what was recorded of it."""
