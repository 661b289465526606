"""Simulated vehicles that stand alone, served to ground stations or to a firmware."""

# Where PX4's simulators stand by default, and with them the places in most tutorials: Zurich.
PX4_HOME = {
    "area.home_lat_deg": 47.397742,
    "area.home_lon_deg": 8.545594,
    "area.home_alt_msl_m": 488.0,
}
