"""MAVLink encoding and decoding: framing, units, telemetry, and orders in SI units."""
