"""Scenario of a run: positions and data of devices, the radio, budgets, and strategies."""
