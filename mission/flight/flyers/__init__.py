"""Who flies: our autopilot or a firmware on the simulated aircraft, an external one, or nobody."""
