"""MAVLink bytes and units: framing, telemetry, and what comes in as values in SI units."""
