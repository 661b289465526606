"""Who flies: our simulated vehicle, a firmware on its plant, an external autopilot."""
