"""A run's events as log messages, written while they happen."""
