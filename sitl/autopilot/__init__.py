"""The autopilot: protocol cores without I/O or clock, modes, failsafes, telemetry."""
