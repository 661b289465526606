"""What comes in and goes out over MAVLink, as values in SI units and degrees."""
